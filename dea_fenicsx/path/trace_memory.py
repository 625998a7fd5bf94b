"""What a trace knows of the points behind it, in a form that a checkpoint holds.

The next step follows the cubic through the last two points.  Where another branch almost crosses
this one, the trace goes straight on from points that lie farther back (see `crossing`).  So these
points belong to the checkpoint of a step: their states, and what is told of them here.
`recalling` makes it, and gives it back to a resumed trace.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import check_declared, is_number

NOT_KEPT = -1
"""The number of a point that a resumed trace does not need."""


@dataclass(frozen=True)
class TraceMemory:
    """Where the points behind a step belong, by the numbers of their states.

    The present state has the number 0, and the earlier states have 1, 2 and so on.

    Attributes
    ----------
    signs
        For each earlier state the sign of the load's change there.  It is 0 where the trace has
        left another branch; the state after such a one is moved from it along the new branch.
    before
        The point before the present one, or `NOT_KEPT`.
    trail
        The last points, the latest one at the end; `NOT_KEPT` for those that are not needed.
    anchors
        The points from which a step over a crossing may begin, each with the one before it.
    turned
        The last point to which the branch has turned aside, or `NOT_KEPT`.
    pace
        Numbers that say how long the steps of late were, and what was told of them, by name.
    """

    signs: tuple[float, ...] = ()
    before: int = NOT_KEPT
    trail: tuple[int, ...] = ()
    anchors: tuple[tuple[int, int], ...] = ()
    turned: int = NOT_KEPT
    pace: Mapping[str, float | None] | None = None

    @classmethod
    def read(cls, found: Any, states: int) -> TraceMemory:
        """What a checkpoint with some earlier states tells of them, if it can be used.

        Raises
        ------
        ValueError
            If it cannot.
        """
        if not isinstance(found, dict) or set(found) != {field.name for field in fields(cls)}:
            raise ValueError("it has other names")
        memory = cls(**found)
        try:
            check_declared(memory)
        except InputError as error:
            raise ValueError(str(error)) from error
        numbers = [memory.before, memory.turned, *memory.trail]
        numbers += [number for pair in memory.anchors for number in pair]
        pace = [value for value in (memory.pace or {}).values() if value is not None]
        if len(memory.signs) != states or not all(sign in (-1, 0, 1) for sign in memory.signs):
            raise ValueError("its signs are not those of its states")
        if not all(NOT_KEPT <= number <= states for number in numbers):
            raise ValueError("it names states that there are not")
        if not all(is_number(value) and math.isfinite(value) for value in pace):
            raise ValueError("it holds what is no finite number")
        return memory

