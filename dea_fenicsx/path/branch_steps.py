"""Steps along a branch: halved where the branch is lost, longer where Newton's method is quick."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

from dea_fenicsx.path.arclength import SHORTEST_ARC, Point, TracedBranch
from dea_fenicsx.solvers.outcome import Attempt

ARC_GROWTH = 1.5
"""Length of the next step over that of the last one, if the last one needed few iterations."""

MOST_NEWTON_FOR_LONGER_ARC = 3
"""Largest number of Newton iterations of a step after which the next one is longer."""


class BranchStep(NamedTuple):
    """A step along a branch: its first and last point, and its length in units of arc."""

    here: Point
    there: Point
    arc: float


@dataclass
class BranchSteps:
    """The steps along a branch from its solver's present state, to be gone through once.

    Attributes
    ----------
    branch
        The branch.
    first_arc, longest_arc
        Lengths of the first and of the longest step, in units of arc.
    most
        Largest number of steps.
    accepts
        Whether a point that was found belongs to the branch.  It is asked for each new point.
    begin
        The present state as a point; None if it has no tangent.
    lost
        The attempt after which the branch was given up, since its steps had become too short; None
        as long as it has not been given up.
    """

    branch: TracedBranch
    first_arc: float
    longest_arc: float
    most: int
    accepts: Callable[[Point], bool] = lambda point: True

    def __post_init__(self) -> None:
        self.begin = self.branch.point(self.branch.problem.state, None, 1.0)
        self.lost: Attempt | None = None

    def __iter__(self) -> Iterator[BranchStep]:
        """Make the next step only when it is asked for.  Collective."""
        here, before, arc = self.begin, None, self.first_arc
        done = 0
        while here is not None and done < self.most:
            attempt, there = self.branch.advance(here, arc, before)
            if there is None or not self.accepts(there):
                arc /= 2
                if arc < SHORTEST_ARC:
                    self.lost = attempt
                    return
                continue
            yield BranchStep(here, there, arc)
            few = attempt.iterations <= MOST_NEWTON_FOR_LONGER_ARC
            arc = min(arc * (ARC_GROWTH if few else 1.0), self.longest_arc)
            before, here = here, there
            done += 1

    def rise(self, wanted: float) -> tuple[list[Point], BranchStep | None]:
        """Go along the branch while its load f grows, until it reaches a load.  Collective.

        Returns
        -------
        points : list of Point
            The points with a growing load, `begin` first.  The load of the last one is at least
            `wanted`, unless the load falls before, or the steps end.
        fall : BranchStep or None
            The step after the last point, at whose end the load falls; None if there is none.
        """
        points = [] if self.begin is None else [self.begin]
        for step in self:
            if step.there.slope < 0:
                return points, step
            points.append(step.there)
            if step.there.factor >= wanted:
                break
        return points, None
