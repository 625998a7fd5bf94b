"""How much each ramp of a scene drives at factor 1, to carry a load from one scene to another.

A ramp's factor says nothing by itself: factor 1 may be 500 V in one scene and 1000 V in another.
So the amounts at factor 1 are compared, quantity by quantity.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from dea_fenicsx.support.errors import InputError

if TYPE_CHECKING:
    from dea_fenicsx.scene.scene import Scene

Amounts = Mapping[str, Sequence[float]]
"""For each quantity (``"volts"``, say) the amounts at factor 1, in the order of the scene."""

RATIO_TOLERANCE = 1e-9
"""Relative difference of two ratios that is rounding."""


def amounts_of(scene: Scene) -> dict[str, dict[str, list[float]]]:
    """For each ramp of a scene, what it drives at factor 1, in SI units."""
    found: dict[str, dict[str, list[float]]] = {ramp: {} for ramp in scene.ramps}

    def add(ramp: str | None, quantity: str, values: Sequence[float]) -> None:
        if ramp in found and values:
            found[ramp].setdefault(quantity, []).extend(float(v) for v in values)

    for electrode in scene.electrodes:
        if electrode.floats and not electrode.given_volts:
            add(electrode.ramp, "coulombs", [electrode.given_coulombs])
        elif electrode.given_volts:
            add(electrode.ramp, "volts", [electrode.given_volts])
    for item, told in scene.declared.told:
        ramp = item.moved_by
        for quantity, values in told.amounts().items() if ramp else ():
            add(ramp, quantity, values)
    return found


def carried(name: str, factor: float, old: Amounts, new: Amounts) -> float:
    """The factor at which a ramp drives as much as it drove at a factor in another scene.

    Parameters
    ----------
    name
        The ramp.
    factor
        Its factor in the other scene.
    old, new
        What it drove there, and drives here, at factor 1.

    Raises
    ------
    InputError
        If it drives other quantities now, or several of them in another proportion.
    """
    if factor == 0 or not (old or new):
        return factor
    ratios = [_ratio(old[q], new[q]) for q in old if q in new]
    usable = [r for r in ratios if r is not None]
    if set(old) != set(new) or not usable:
        raise InputError(
            f"The ramp {name!r} stands at factor {factor:.6g} of {_words(old)} in the run to start "
            f"from, but drives {_words(new)} here; give it another name here, or start from a "
            "state in which it is at 0."
        )
    if any(abs(r - usable[0]) > RATIO_TOLERANCE * abs(usable[0]) for r in usable):
        raise InputError(
            f"The ramp {name!r} drives {_words(new)}, of which some have changed against the run "
            "to start from and others have not; give each a ramp of its own."
        )
    return factor * usable[0]


def _ratio(old: Sequence[float], new: Sequence[float]) -> float | None:
    """Old amount over new one, each the largest in size; None where one of them is 0."""
    if list(old) == list(new):
        return 1.0
    before, now = max(old, key=abs), max(new, key=abs)
    found = before / now if before and now else math.nan
    return found if math.isfinite(found) else None


def _words(amounts: Amounts) -> str:
    told = [f"{max(values, key=abs):.6g} {quantity}" for quantity, values in amounts.items()]
    return " and ".join(told) or "nothing that has an amount"
