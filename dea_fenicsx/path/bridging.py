"""What lies behind the last state of a ramp whose steps have become too short.

Newton's method at a given load fails at two kinds of places.  At a limit point there is no
equilibrium at a larger load.  At a sharp bend there is one, but it lies so far away that each step
ends on another branch or does not converge.  The last states of the ramp cannot tell the two apart,
because the speed (displacement per load) grows towards both.  The branch itself can: we follow it
by arc length in short steps, until its load falls or until the bend lies behind it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dea_fenicsx.path.arclength import Point, TracedBranch
from dea_fenicsx.path.branch_steps import BranchSteps
from dea_fenicsx.path.events import Sentinel
from dea_fenicsx.path.load_course import LoadCourse
from dea_fenicsx.path.stability import Place
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.outcome import Attempt, Outcome

FIRST_ARC_OF_BRIDGE = 2.0**-6
"""First step along the branch, in units of arc.

A sharp bend has to be followed in steps that are short compared with its radius.
"""

LONGEST_ARC_OF_BRIDGE = 1.0
"""Longest step along the branch, in units of arc."""

MOST_STEPS_OF_BRIDGE = 60
"""Largest number of steps along the branch.

They reach the longest one after a dozen points.  So the way is at most twice the device's
size, which is more than a bend needs.
"""


@dataclass(frozen=True)
class Bridge:
    """A branch behind the last state of a ramp.

    Attributes
    ----------
    branch
        Steps along it; its load f is the position on the ramp.
    points
        Its points, from the last state of the ramp on, with loads that grow.
    limit
        Position of the limit point that ends them; None if none was found.
    """

    branch: TracedBranch
    points: Sequence[Point]
    limit: float | None = None

    def at(self, position: float) -> Attempt:
        """Find the equilibrium at a position."""
        for low, high in pairwise(self.points):
            if low.factor <= position <= high.factor:
                return self.branch.land(low, high, position)
        return Attempt(Outcome.SLOW, 0, np.inf)

    def place(self, end: float) -> Place:
        """A function that finds the equilibrium at a share (0 to 1) of the way to a position."""
        begin = self.points[0].factor
        return lambda share: self.at((1 - share) * begin + share * end)


def bridge(
    solver: NewtonSolver,
    sentinel: Sentinel,
    rates: Mapping[str, float],
    first: float,
    position: float,
    wanted: float,
) -> Bridge:
    """Follow the branch from the last state of a ramp to a limit point or to a given load.

    A step is halved if the number of negative eigenvalues changes in it, where this number is
    counted.  At a limit point it must change by one.  Collective; the problem is left in the state
    in which it was.

    Parameters
    ----------
    solver
        The solver, in equilibrium at the last state.
    sentinel
        Counts negative eigenvalues; holds the number of the last state.
    rates, first
        As in `TracedBranch`; the load f is the position on the ramp.
    position, wanted
        Position of the last state, and the position to come to.

    Returns
    -------
    Bridge
        Its last point lies at or behind `wanted`, or is a limit point.  It does neither if the
        branch could not be followed so far.
    """
    branch = TracedBranch(solver, LoadCourse(solver, rates, position), first)
    return follow(branch, sentinel, wanted)


def follow(branch: TracedBranch, sentinel: Sentinel, wanted: float) -> Bridge:
    """Follow a branch from the problem's present state, as `bridge` does.  Collective.

    Parameters
    ----------
    branch
        The branch.
    sentinel
        Counts negative eigenvalues; holds the number of the present state.
    wanted
        The load f to come to.
    """
    steps = BranchSteps(
        branch, FIRST_ARC_OF_BRIDGE, LONGEST_ARC_OF_BRIDGE, MOST_STEPS_OF_BRIDGE,
        lambda there: _is_same_branch(sentinel, there),
    )
    points, fall = steps.rise(wanted)
    found = None if fall is None else branch.limit_point(*fall)
    if found is None:
        return Bridge(branch, points)
    return Bridge(branch, [*points, found[0]], limit=found[0].factor)


def _is_same_branch(sentinel: Sentinel, there: Point) -> bool:
    """Whether the number of negative eigenvalues is that of a point on the same branch.

    It is that of the ramp's last state before a limit point, and differs from it by one behind a
    limit point, where the load falls.
    """
    before = sentinel.excess
    now = sentinel.count(there.state) if before is not None else None
    if before is None or now is None:
        return True
    return abs(now - before) == int(there.slope < 0)
