"""Obstacles as nets of lines, which a report moves from step to step."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.pictures import level_sets
from dea_fenicsx.pictures.drawn_body import room_for
from dea_fenicsx.pictures.obstacles import obstacles_of


def nets_of(
    folder: Path, steps: Sequence[int], places: np.ndarray, flat: bool
) -> tuple[list[Any], list[np.ndarray], np.ndarray]:
    """The obstacles of a run around its device.

    Parameters
    ----------
    folder, steps
        The run, and steps on disk.
    places
        Where the points of the device lie in all these steps, shape (n, 3), m.
    flat
        Whether the device lies in a plane.

    Returns
    -------
    told
        Of each obstacle its surface, and for each step the rotation, by rows, and the shift in mm.
    nets
        Of each obstacle the ends of its lines before it moves, shape (2 lines, 3), m.
    around
        Outermost points of the device and of the nets, shape (k, 3), m.
    """
    low, high = places.min(axis=0), places.max(axis=0)
    around, told, nets = [np.array([low, high])], [], []
    for moving in zip(*(obstacles_of(folder, step) for step in steps), strict=False):
        first, shifts = moving[0], np.array([one.shift for one in moving])
        pad = room_for(first) * (high - low).max() * (high > low if flat else np.ones(3))
        # An obstacle that comes from afar lies around the device only after its motion.
        ends = low - pad - shifts.max(axis=0), high + pad - shifts.min(axis=0)
        net = level_sets.net(first.shape, *ends).reshape(-1, 3)
        told.append([first.where, [[*one.turn.ravel().tolist(), *(1e3 * one.shift).tolist()]
                                   for one in moving]])  # fmt: skip
        nets.append(net)
        around += [net + one.displacements(net) for one in moving if len(net)]
    everywhere = np.vstack(around)
    return told, nets, np.array([everywhere.min(axis=0), everywhere.max(axis=0)])
