"""Angular sectors of patterned electrodes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown

from . import _check
from ._structured import Floats

ANGLE_TOLERANCE_DEG = 1e-6
"""Degrees within which two angles are the same."""


@dataclass(frozen=True)
class Sector:
    """A sector of a ring, from `start` to `end` in degrees; 0 <= start < 360, end < start + 360.

    An electrode that is not patterned is one sector of 360 degrees from 0.
    """

    start: float
    end: float
    name: str = ""

    @property
    def share(self) -> float:
        """Of the whole angle."""
        return (self.end - self.start) / 360

    @property
    def whole(self) -> bool:
        return self.share == 1

    @property
    def suffix(self) -> str:
        """What its name adds to a group's name."""
        return f"_{self.name}" if self.name else ""

    @property
    def breaks(self) -> tuple[float, float]:
        """Its edges as angles from 0 to below 360."""
        return self.start, self.end - 360 if self.end >= 360 - ANGLE_TOLERANCE_DEG else self.end

    def holds(self, angle: Floats) -> np.ndarray:
        """Whether angles, in degrees, lie inside."""
        return np.mod(angle - self.start, 360.0) < self.end - self.start


def checked_sectors(owner: str, sectors: Any) -> tuple[Sector, ...]:
    """Sectors from what a user writes; empty stays empty.

    Parameters
    ----------
    owner
        Whose they are, for the messages.
    sectors
        Pairs (start, end) in degrees, or a mapping of names to pairs, or the result of this.

    Raises
    ------
    InputError
        For angles that make no sector, and for sectors that overlap or touch.
    """
    items: list[tuple[str, Any]]
    if isinstance(sectors, Mapping):
        items = [(_check.group_name(owner, "name of a sector", n), s) for n, s in sectors.items()]
    else:
        try:
            items = [("", s) for s in sectors]
        except TypeError:
            raise InputError(
                f"{owner}: sectors is {shown(sectors)}; it must hold pairs of angles in degrees, "
                "as ((0, 180),)."
            ) from None
    made = sorted((_sector(owner, *item) for item in items), key=lambda s: s.start)
    for here, there in pairwise([*made, *made[:1]]):
        wraps = 360 if there is made[0] else 0
        if here.end > there.start + wraps - ANGLE_TOLERANCE_DEG:
            both = (
                f"the sectors {here.start:g} to {here.end:g} and {there.start:g} to {there.end:g}"
                if len(made) > 1
                else f"the ends of the sector {here.start:g} to {here.end:g}"
            )
            raise InputError(
                f"{owner}: {both} degrees overlap or touch; leave a gap between them."
            )
    return tuple(made)


def _sector(owner: str, name: str, given: Any) -> Sector:
    if isinstance(given, Sector):
        return given
    try:
        start, end = (_check.number(owner, "angle of a sector", angle) for angle in given)
    except (TypeError, ValueError):
        raise InputError(
            f"{owner}: a sector is {shown(given)}; it must be a pair of angles in degrees, as "
            "(0, 180)."
        ) from None
    if not ANGLE_TOLERANCE_DEG < end - start <= 360:
        raise InputError(
            f"{owner}: a sector goes from {start:g} to {end:g} degrees; it must end at a larger "
            "angle than it starts at, and go round less than once."
        )
    turns = math.floor((start + ANGLE_TOLERANCE_DEG) / 360)
    return Sector(max(start - 360 * turns, 0.0), end - 360 * turns, name)


def angular_ends(owner: str, sectors: tuple[Sector, ...], cells: int) -> Floats:
    """Cell ends over one turn in degrees, from 0 to 360, with one at every edge of a sector.

    Between the edges the cells are equal; each stretch gets cells in proportion to its angle, and
    at least one.

    Raises
    ------
    InputError
        If there are fewer cells than stretches.
    """
    edges = sorted({0.0, *(angle for s in sectors if not s.whole for angle in s.breaks)})
    # rounding may leave an edge twice, or just beside 0
    kept = [a for k, a in enumerate(edges) if k == 0 or a - edges[k - 1] > ANGLE_TOLERANCE_DEG]
    ends = np.array([*kept, 360.0])
    sizes = np.diff(ends)
    if len(sizes) > cells:
        raise InputError(
            f"{owner}: angular is {cells}; with these sectors it must be at least {len(sizes)}."
        )
    counts = np.ones(len(sizes), dtype=int)
    for _ in range(cells - len(sizes)):
        counts[np.argmax(sizes / counts)] += 1
    starts = [a + size * np.arange(n) / n for a, size, n in zip(ends, sizes, counts, strict=False)]
    return np.append(np.concatenate(starts), 360.0)
