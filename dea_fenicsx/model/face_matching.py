"""Which nodes of two periodic faces are the same place, and the classes that they form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dea_fenicsx.mesh.device import Device
from dea_fenicsx.model.components import Component
from dea_fenicsx.model.tied_unknowns import Rows
from dea_fenicsx.scene.periodic import PeriodicFaces
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.later import Later

spatial = Later("scipy.spatial")

MATCH_TOLERANCE = 1e-6
"""Largest distance of two nodes that are the same place, as a share of the device's extent."""


@dataclass(frozen=True)
class FacePair:
    """A pair of faces: their declaration, the axis and the length of the period, the unknowns d.

    `unknowns` are the local degrees of freedom of d along each axis: one constant a cell, all
    alike.
    """

    told: PeriodicFaces
    axis: int
    length: float
    unknowns: tuple[np.ndarray, ...]


@dataclass(frozen=True)
class Matches:
    """Pairs of degrees of freedom by number, the same on all ranks.

    In the order of the attributes: their numbers on the first and on the second face, the number of
    the pair of faces, that of the displacement component (-1 for another field), and the
    dimensionless position on the second face, shape (pairs, 3).
    """

    masters: np.ndarray
    slaves: np.ndarray
    faces: np.ndarray
    axes: np.ndarray
    x: np.ndarray


class Matched(NamedTuple):
    """Pairs of degrees of freedom of one component, by numbers that are the same on all ranks.

    Attributes
    ----------
    masters, slaves
        Their numbers on the first and on the second face.
    x
        Dimensionless position on the second face, shape (pairs, 3).
    """

    masters: np.ndarray
    slaves: np.ndarray
    x: np.ndarray


def classes(
    first: np.ndarray, second: np.ndarray, faces: np.ndarray, fixed: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """The leader of each node, and its offsets from it.

    Parameters
    ----------
    first, second, faces
        Places of the nodes of each pair, and its pair of faces.
    fixed
        Which nodes are fixed; these lead before others, and lower places before higher ones.
    count
        Number of pairs of faces.

    Returns
    -------
    tuple of ndarrays of shapes (nodes,) and (nodes, count)
    """
    size = len(fixed)
    places = np.arange(size)
    rank = np.where(fixed, places, places + size)
    while True:
        low = np.minimum(rank[first], rank[second])
        new = rank.copy()
        np.minimum.at(new, first, low)
        np.minimum.at(new, second, low)
        if np.array_equal(new, rank):
            break
        rank = new
    leader = rank % size
    offsets = np.zeros((size, count))
    known = leader == places
    step = np.eye(count)
    while not known.all():
        for a, b, sign in ((first, second, 1.0), (second, first, -1.0)):
            new = known[a] & ~known[b]
            offsets[b[new]] = offsets[a[new]] + sign * step[faces[new]]
            known[b[new]] = True
    return leader, offsets


def matched(
    told: PeriodicFaces, device: Device, parts: Sequence[Component], rows: Rows
) -> tuple[np.ndarray, list[Matched]]:
    """The period, shape (3,), and the pairs of each component.  Collective.

    Raises
    ------
    InputError
        If the nodes of the faces do not lie at the same places, one period apart along an axis.
    """
    names = (told.first, told.second)
    period, found = np.zeros(3), list[Matched]()
    for c, part in enumerate(parts):
        x = part.space.tabulate_dof_coordinates()
        sides = []
        for name in names:
            local = part.on(device.dim - 1, device.facets_by_surface[name])
            local = local[part.dofs[local] < rows.owned]
            # All ranks know the nodes of the faces, since ties may chain through several pairs of
            # faces; their number grows with the unknowns to the power 2/3 only.
            everyone = rows.comm.allgather((x[local], part.dofs[local].astype(np.int64)))
            starts = rows.comm.allgather(rows.start)
            numbers = [n + start for (_, n), start in zip(everyone, starts, strict=True)]
            sides.append((np.concatenate([e[0] for e in everyone]), np.concatenate(numbers)))
        (low, masters), (high, slaves) = sides
        if c == 0:
            period = _period(low, high, names)
        near, nearest = spatial.cKDTree(low + period).query(high)
        if (
            len(low) != len(high) or np.max(near, initial=0.0) > MATCH_TOLERANCE
            or len(np.unique(nearest)) != len(low)
        ):  # fmt: skip
            raise InputError(
                f"The nodes of {told.first!r} and {told.second!r} do not lie at the same places "
                "one period apart, so the faces cannot be periodic; mesh both alike."
            )
        found.append(Matched(masters[nearest], slaves, high))
    return period, found


def _period(low: np.ndarray, high: np.ndarray, names: tuple[str, str]) -> np.ndarray:
    """How far the second face is from the first, dimensionless, shape (3,)."""
    period = np.min(high, axis=0) - np.min(low, axis=0)
    other = np.max(high, axis=0) - np.max(low, axis=0)
    along = int(np.argmax(np.abs(period)))
    across = np.delete(period, along)
    if np.max(np.abs(other - period)) > MATCH_TOLERANCE:
        raise InputError(
            f"The periodic faces {names[0]!r} and {names[1]!r} have different extents; the second "
            "must be the first one moved along an axis."
        )
    if np.max(np.abs(across)) > MATCH_TOLERANCE or abs(period[along]) <= MATCH_TOLERANCE:
        raise InputError(
            f"The periodic faces {names[0]!r} and {names[1]!r} are not apart along one axis; the "
            "second must be the first one moved along x, y or z."
        )
    period[np.arange(3) != along] = 0.0
    return np.asarray(period)
