"""Points of a branch, and the cubic through two of them.

The cubic through two points of a branch with their tangents predicts other points, between the two
and beyond them.  Its error is of fourth order in the arc.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import State
from dea_fenicsx.path.roots import root
from dea_fenicsx.solvers.newton import NewtonSolver


class Followed(Protocol):
    """What a branch is asked for: see `arclength.TracedBranch`."""

    problem: Problem
    solver: NewtonSolver

    def dot(self, x: np.ndarray, f: float, y: np.ndarray, g: float) -> float:
        """Scalar product of two directions."""

    def advanced(self, start: Point, end: Point) -> float:
        """How far a point lies ahead of another one, along the tangent there."""

    def point(
        self, state: State, along: Point | None, sign: float = 1.0, guide: Any = None
    ) -> Point | None:
        """An equilibrium with its tangent."""

    def loaded(self, state: State, factor: float) -> State:
        """A state with another load."""

    @property
    def products(self) -> Any:
        """The scalar products of motions."""


@dataclass(frozen=True)
class Point:
    """A point of the branch: its state, its load f, and the tangent there (of unit length).

    `direction` is the part of the tangent in the free unknowns.  `slope` is its part in f, which is
    0 at a limit point.
    """

    state: State
    factor: float
    direction: np.ndarray
    slope: float


@dataclass(frozen=True)
class Cubic:
    """The cubic through two points of a branch, with the tangents of the branch there.

    Its parameter s is the distance along the tangent at the first point.  The second point has the
    parameter `arc`, which is negative if this point lies behind the first.  `turn` is the cosine of
    the angle between the two tangents.
    """

    branch: Followed
    start: Point
    end: Point
    arc: float
    turn: float

    @classmethod
    def through(cls, branch: Followed, start: Point, end: Point) -> Cubic:
        turn = branch.dot(end.direction, end.slope, start.direction, start.slope)
        return cls(branch, start, end, branch.advanced(start, end), turn)

    def load(self, s: float) -> float:
        """The load at an arc."""
        far, first, last = _hermite(s / self.arc)
        ends = (1 - far) * self.start.factor + far * self.end.factor
        return float(ends + self.arc * (first * self.start.slope + last * self._last_slope))

    @property
    def _last_slope(self) -> float:
        return self.end.slope / self.turn

    @property
    def stationary(self) -> float:
        """The arc of the stationary load, if the load grows at one end and falls at the other."""
        rise = (self.end.factor - self.start.factor) / self.arc
        a, b = self.start.slope, self._last_slope

        def slope(t: float) -> float:
            return 6 * t * (1 - t) * rise + (1 - t) * (1 - 3 * t) * a + t * (3 * t - 2) * b

        return float(self.arc * root(slope, 0.0, 1.0))

    def guess(self, s: float) -> tuple[State, float]:
        """The state at an arc, which is not yet in equilibrium, and its load f."""
        branch, factor = self.branch, self.load(s)
        far, first, last = _hermite(s / self.arc)
        between = self.start.state.with_values(
            (1 - far) * self.start.state.values + far * self.end.state.values
        )
        ways = first * self.start.direction + last / self.turn * self.end.direction
        return branch.loaded(branch.problem.moved(between, self.arc * ways), factor), factor


def _hermite(t: float) -> tuple[float, float, float]:
    """Weights of the second value and of the two slopes."""
    return t * t * (3 - 2 * t), t * (1 - t) ** 2, t * t * (t - 1)
