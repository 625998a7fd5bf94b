"""Paths that would let more out of a cavity than there is, refused before anything is computed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dea_fenicsx.path.items import Close, Item, March, Ramp, Trace
from dea_fenicsx.scene.cavity import Filling
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.errors import InputError

AMOUNT_TOLERANCE = 1e-3
"""A path may miss what a cavity holds at rest by this share of it.

The volume of a mesh differs by the error of its facets from the one that a user computes.
"""

CHECKED_TIMES = np.linspace(0, 1, 65)
"""Shares of a march at which its drives are looked at, besides their corners."""


def check_amounts(scene: Scene, item: Item) -> None:
    """Raise InputError if an item of a path empties a cavity to less than nothing.

    Parameters
    ----------
    scene, item
        The scene, and an item of the path whose numbers have been checked.
    """
    for told in scene.declared.fillings:
        if told.kind == "pressure" or not told.amount:
            continue
        there = told.held_at_rest(scene.device.length, scene.kinematics)
        for factor in _factors(item, told.ramp, scene):
            if there + factor * told.amount < -AMOUNT_TOLERANCE * there:
                raise InputError(_refusal(told, factor, there))


def _factors(item: Item, ramp: str, scene: Scene) -> Iterator[float]:
    """The factors of a ramp that an item is known to reach."""
    if isinstance(item, March):
        wave = item.waves.get(ramp)
        if wave is not None:
            times = [*(CHECKED_TIMES * item.seconds), *wave.corners(0.0, item.seconds)]
            yield from (wave(float(t)) for t in times)
    elif isinstance(item, Trace):
        if item.what == ramp:
            yield from item.at
    elif isinstance(item, Ramp | Close) and ramp in item.names(scene):
        yield float(item.to)


def _refusal(told: Filling, factor: float, there: float) -> str:
    unit = {"gas": "Pa m^3", "liquid": "m^3"}[told.kind]
    return (
        f"The ramp {told.ramp!r} at factor {factor:.6g} would let {-factor * told.amount:.6g} "
        f"{unit} out of the cavity behind {told.space.label!r}, which is more {told.kind} than "
        f"the {there:.6g} {unit} that it holds at rest; let out at most that."
    )
