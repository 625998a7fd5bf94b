"""The points behind a step of a trace: what its checkpoint holds, and how a resumed trace gets it.

A checkpoint holds states, and a `TraceMemory` that says where they belong.  The tangents of the
points are computed anew.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from dea_fenicsx.model.state import State
from dea_fenicsx.path.arclength import TracedBranch
from dea_fenicsx.path.cubic import Point
from dea_fenicsx.path.trace_memory import NOT_KEPT, TraceMemory
from dea_fenicsx.path.turning import Turns


class Keeper:
    """Numbers the points that a checkpoint is to hold.

    Parameters
    ----------
    branch, here
        The branch, and its present point.
    """

    def __init__(self, branch: TracedBranch, here: Point) -> None:
        self.branch, self.here = branch, here
        self.states: list[State] = []
        self.signs: list[float] = []
        self._numbers: dict[int, int] = {id(here): 0}

    def number(self, point: Point | None) -> int:
        """The number of a point, which is kept from now on.  Collective."""
        if point is None:
            return NOT_KEPT
        if id(point) not in self._numbers:
            self._keep(point.state, float(np.sign(point.slope)))
            self._numbers[id(point)] = len(self.states)
            if point.slope == 0:
                self._keep(self.branch.problem.moved(point.state, point.direction), 0.0)
        return self._numbers[id(point)]

    def numbers(self, points: Iterable[Point | None]) -> tuple[int, ...]:
        """The number of each point, or `NOT_KEPT`.  Collective."""
        return tuple(map(self.number, points))

    def _keep(self, state: State, sign: float) -> None:
        self.states.append(state)
        self.signs.append(sign)


class Recalled:
    """The points that a checkpoint holds, with their tangents.

    Parameters
    ----------
    branch, here
        The branch, and its present point.
    memory, states
        What the checkpoint tells of the earlier states, and these.
    """

    def __init__(
        self, branch: TracedBranch, here: Point, memory: TraceMemory, states: tuple[State, ...]
    ) -> None:
        self.branch, self.memory, self.states = branch, memory, states
        self._known: dict[int, Point | None] = {0: here, NOT_KEPT: None}

    def point(self, number: int) -> Point | None:
        """The point of a number; None if it was not kept, or has no tangent.  Collective."""
        if number not in self._known:
            self._known[number] = self._made(number - 1)
        return self._known[number]

    def _made(self, k: int) -> Point | None:
        state, sign = self.states[k], self.memory.signs[k]
        if sign:
            return self.branch.point(state, None, sign)
        if k + 1 == len(self.states):
            return None
        problem = self.branch.problem
        direction = (self.states[k + 1].values - state.values)[problem.free]
        length = np.sqrt(self.branch.dot(direction, 0.0, direction, 0.0))
        factor = self.branch.factor_of(state)
        return Point(state, factor, direction / length, 0.0) if length > 0 else None


def kept(
    turns: Turns, here: Point, before: Point | None, cut: float
) -> tuple[tuple[State, ...], TraceMemory]:
    """The states behind a point that its checkpoint holds, and what it tells of them.  Collective.

    Parameters
    ----------
    turns
        What the trace knows of its points.
    here, before
        The present point, and the one before it.
    cut
        How much shorter the next step is because the end of the trace is near.
    """
    crossings, keeper = turns.crossings, Keeper(turns.branch, here)
    trail = crossings.trail if turns.at_turn else crossings.needed()
    turned = turns.first if any(point is turns.first for point in trail) else None
    last, first = keeper.number(before), keeper.number(turned)
    numbers = keeper.numbers(trail)
    anchors = tuple((keeper.number(one), keeper.number(other)) for one, other in crossings.anchors)
    pace = crossings.pace() | {"cut": cut, "quiet_turns": turns.told.left}
    memory = TraceMemory(
        tuple(keeper.signs), last, numbers, anchors, turned=first, pace=pace
    )  # all numbers are given by now, and so the signs are complete
    return tuple(keeper.states), memory


def recall(
    turns: Turns, here: Point, memory: TraceMemory, states: tuple[State, ...]
) -> tuple[Point | None, float]:
    """Give a resumed trace back what `kept` gave: the point before, and the cut.  Collective."""
    known, pace = Recalled(turns.branch, here, memory, states), memory.pace or {}
    # Nothing asks for the points that were not kept, but the places of the others must stay.
    nobody = replace(here)
    trail = [known.point(number) or nobody for number in memory.trail]
    anchors = []
    for pair in memory.anchors:
        first, second = map(known.point, pair)
        if first is not None and second is not None:
            anchors.append((first, second))
    turns.crossings.recall(trail, anchors, pace)
    turns.first = known.point(memory.turned)
    turns.told.left = int(pace.get("quiet_turns") or 0)
    before = known.point(memory.before) if trail else None
    return before, float(pace.get("cut") or 1.0)
