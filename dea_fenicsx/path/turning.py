"""Where a branch turns aside, because another branch almost crosses it.

On a symmetric structure two branches cross at a bifurcation.  An imperfection, or a mesh that is
not quite symmetric, opens the crossing, and each branch turns off into the other one.  Steps that
are long compared with the opening go straight over it (see `crossing`).  Shorter ones follow the
turn.  Each of them is on the branch of the one before, but the branch itself has left the
symmetric states.  So a turn is looked for, and told.

Where the direction of the motion has changed by a certain angle since a point, we look at the
softest shapes there, without the branch's own direction d.  With w the part of the change along
these shapes, as long as d, and b = dR/df, a turn aside is shown by four signs:

1.  w is most of the change;
2.  the stiffness w . K w has become smaller towards that point, and so quickly that it would be 0
    not far behind the present point;
3.  it is not 0, but has become larger again: the branches have not crossed;
4.  w . b is small compared with d . b: the load does not drive w.  (Towards a limit point the
    motion turns into the shape that the load drives.)
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from dea_fenicsx.path.arclength import Point, TracedBranch
from dea_fenicsx.path.crossing import MOST_POINTS_BACK, Crossings, TellsOnce
from dea_fenicsx.path.guiding import Guide
from dea_fenicsx.path.items import Turn
from dea_fenicsx.path.soft_shapes import SoftShapes, size, stiffness

TURN_ASIDE = "turn aside"
"""The event's name."""

LEAST_TURN = 0.15
"""Angle in rad between the directions of two points at which a turn aside is looked for."""

LEAST_SOFT_SHARE = 0.5
"""Least part of the change of direction that lies along the soft shapes, for a turn aside."""

FARTHEST_ZERO = 3.0
"""How far ahead the stiffness is to vanish, in distances between the two points, for a turn aside.

It is extrapolated from its change up to the first one of them.
"""

MOST_DRIVEN = 0.1
"""Largest ratio of w . b to d . b for a turn aside."""

SHAPES_LOOKED_AT = 8
"""How many soft shapes are taken into account."""


class Turns:
    """Looks for turns of a branch aside.

    Parameters
    ----------
    branch
        The branch.
    crossings
        Goes straight on.
    at_turn
        What the trace does there.  A turn that it follows is told once; with None we do not look.

    Attributes
    ----------
    first
        The point up to which turns are told, or None.
    told
        Counts the points at which no other turn is told.
    """

    def __init__(self, branch: TracedBranch, crossings: Crossings, at_turn: Turn | None) -> None:
        self.branch, self.crossings, self.at_turn = branch, crossings, at_turn
        self.forget()

    def forget(self) -> None:
        """Begin anew, as on another branch."""
        self.crossings.forget()
        self._shapes = SoftShapes(self.branch, SHAPES_LOOKED_AT)
        self.first: Point | None = None
        self.told = TellsOnce()

    def reached(self, point: Point, before: Point, arc: float) -> Point | None:
        """Take note of an accepted point, of the one before it, and of the arc between the two.

        Returns
        -------
        Point or None
            The point from which the branch has turned aside up to this one, if it has.
        """
        self.crossings.reached(point, before, arc)
        self.told.reached()
        is_looked_for = self.at_turn and not self.told.is_recent
        if not is_looked_for or not self.branch.problem.forms.is_symmetric:
            return None
        trail = self.crossings.trail
        begin = next((k for k, p in enumerate(trail) if p is self.first), 0)
        earlier = range(begin, len(trail) - 1)
        at = max((k for k in earlier if self._angle(trail[k], point) > LEAST_TURN), default=0)
        if at == 0:
            return None
        here, back = trail[at], trail[max(0, at - MOST_POINTS_BACK)]
        aside = self._aside(back, here, point)
        stiffness = [] if aside is None else [self._stiffness(aside, p) for p in (here, point)]
        if stiffness and 0 < stiffness[1] / stiffness[0] <= 1:
            return None  # it may still become 0, and is looked at again at the next point
        self.first = point
        if not stiffness or stiffness[1] / stiffness[0] < 0:
            return None
        if self.at_turn == "follow":
            self.told.begin()
        return here

    def _angle(self, first: Point, second: Point) -> float:
        """Angle between the directions of the motion at two points."""
        x, y = first.direction, second.direction
        both, one, other = (self.branch.dot(a, 0.0, b, 0.0) for a, b in ((x, y), (x, x), (y, y)))
        size = np.sqrt(one * other)
        return float(np.arccos(np.clip(both / size, -1.0, 1.0))) if size else 0.0

    def _aside(self, back: Point, here: Point, point: Point) -> np.ndarray | None:
        """The part of a change of direction along soft shapes that shows all signs but the third.

        None if some of them are missing.
        """
        found = self._shapes.at(here)
        guide = None if found is None else Guide.beside(self.branch, back, here, *found)
        if guide is None:
            return None
        first, last = self._unit(here.direction), self._unit(point.direction)
        aside = guide.part(last - first)
        if size(self.branch, aside) < LEAST_SOFT_SHARE * size(self.branch, last - first):
            return None
        before, now = (self._stiffness(aside, p) for p in (back, here))
        way, ahead = -self.branch.advanced(here, back), self.branch.advanced(here, point)
        if before * now <= 0 or abs(now) >= abs(before) or way <= 0:
            return None
        vanishes = now / (before - now) * way < FARTHEST_ZERO * ahead
        driven = self._driven(self._unit(aside), here) / self._driven(first, here)
        return aside if vanishes and driven <= MOST_DRIVEN else None

    def _driven(self, motion: np.ndarray, point: Point) -> float:
        """The work |w . b| of the load's derivative at a point on a motion."""
        problem = self.branch.problem
        with problem.at(point.state):
            load = self.branch.course.derivative()
        return abs(float(problem.comm.allreduce(motion @ load, op=MPI.SUM)))

    def _unit(self, motion: np.ndarray) -> np.ndarray:
        return motion / size(self.branch, motion)

    def _stiffness(self, shape: np.ndarray, point: Point) -> float:
        """The shape's stiffness w . K w at a point, per product of its motions.  Collective."""
        return float(stiffness(self.branch, shape[:, None], point)[0, 0])
