"""Points at which another branch crosses the one that is followed, or almost crosses it.

Where a symmetric body bifurcates, two branches cross.  A mesh that is not quite symmetric opens the
crossing: each branch turns off into the other one, within an arc that becomes shorter with the
error of the mesh.  A trace with short steps would follow that turn and leave its branch.  So when
its steps become much shorter than they were, we go back to the last point with a long step, and
try to pass the crossing in one step from there.

Where many branches cross within such a step, as near the minimum of the voltage of a balloon, no
equilibrium lies near the branch for a while.  There we go on with the soft shapes held (see
`guiding`), until an equilibrium is found close to the state without the guiding forces.

Steps that are not shorter than usual can leave too (see `soft_watch`).  Where an unstable branch
does so, the same step is made with the soft shapes held.  A stable one is followed: a real device
with an imperfection turns off there.  A branch that is unstable at a given load alone, as behind a
limit point, counts as stable here: a device follows it if the charge is given, or a volume.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from dea_fenicsx.path.arclength import Point, TracedBranch
from dea_fenicsx.path.guiding import Guide
from dea_fenicsx.path.soft_watch import SoftWatch
from dea_fenicsx.solvers.outcome import Attempt

SHRINKAGE = 4.0
"""How many times shorter than the longest of late a step is when we try to pass a crossing."""

AHEAD = (0.25, 0.5, 0.75, 1.0)
"""How far beyond the trace's last point we try to land, in lengths of the longest step of late."""

MOST_ANCHORS = 3
"""How many points with a long step we go back at most."""

STRAIGHT = 0.8
"""Least cosine of the angle between the tangents before and behind a crossing."""

SMALL_STEPS = 12
"""Number of short steps after which the trace takes their length for granted."""

SOFT_SHAPES = 24
"""How many soft shapes are looked at where some are held."""

MOST_SOFT_SHAPES = 120
"""The same at most, where many negative eigenvalues may become 0 together."""

MOST_GUIDED_STEPS = 6
"""Most steps with held shapes, each as long as the longest of late."""

GROWTH_OF_GUIDED_STEPS, QUICK_ITERATIONS = 1.5, 3
"""Where many shapes are held, how much longer the next step is after so few iterations."""

POINTS_BEFORE_TURN = (4, 1)
"""How many points before the beginning of a turn we try to go straight on from."""

MOST_STEPS_OVER_TURN = 16
"""Most steps with held shapes over a turn, which may be wide."""

MOST_POINTS_BACK = 4
"""The chord that tells the branch's own direction goes back by at most so many points."""

POINTS_OF_ONE_TURN = 12
"""Number of points after a turn that is followed, at which no other one is told."""

MOST_LANDING = 0.1
"""Largest correction without the guiding forces, as a share of a step with them."""

MOST_HELD_STEPS, MOST_HELD_LANDING = 4, 1e-2
"""The same two where the watch has seen a motion aside: there the branches are not far apart."""

MOST_LANDING_OF_PASSAGE = 1e-2
"""Largest correction without the guiding forces, as a share of all steps with them together."""


@dataclass
class Passage:
    """A step over a crossing: how it ended, and its first and last point.

    Attributes
    ----------
    attempt, start, there
        How Newton's method ended, the anchor, and the point behind the crossing.
    arc
        Distance between the two in units of arc.
    done
        Distance from the anchor to the trace's last point: events before it are known already.
    guide
        Holds the soft shapes between the two points, or None.
    """

    attempt: Attempt
    start: Point
    there: Point
    arc: float
    done: float
    guide: Guide | None = None

    @property
    def has_limit(self) -> bool:
        """Whether a limit point lies within the step."""
        return self.start.slope * self.there.slope < 0

    @property
    def holds_many(self) -> bool:
        """Whether many shapes are held; then few states within are near equilibria."""
        return self.guide is not None and self.guide.shapes.shape[1] >= SOFT_SHAPES


class TellsOnce:
    """Counts the points after a turn that has been told, at which no other one is told.

    Attributes
    ----------
    left
        How many of these points are still to come.
    is_recent
        Whether a turn has been told a few points ago.
    """

    def __init__(self) -> None:
        self.left = 0

    @property
    def is_recent(self) -> bool:
        return self.left > 0

    def begin(self) -> None:
        """A turn has been told."""
        self.left = POINTS_OF_ONE_TURN

    def reached(self) -> None:
        """The trace has come to another point."""
        self.left = max(0, self.left - 1)


class Crossings:
    """Passes crossings of a branch that steps shorter than usual announce.

    Parameters
    ----------
    branch
        The branch.
    longest
        Longest step in units of arc; a step over a crossing may begin farther back.
    watch
        Takes the steps, and refuses those to another branch.

    Attributes
    ----------
    trail
        The last accepted points, the latest one at the end.
    turns_aside
        Whether the last step turns aside, and no way leads straight on.
    """

    def __init__(self, branch: TracedBranch, longest: float, watch: SoftWatch) -> None:
        self.branch, self.longest, self.watch = branch, longest, watch
        self.forget()

    def forget(self) -> None:
        """Begin anew, as on another branch."""
        self._anchors: list[tuple[Point, Point]] = []
        self._arc, self._short, self._next = 0.0, 0, 0.0
        self.watch.forget()
        self.trail: list[Point] = []
        self._held: Point | None = None
        self._open = self.turns_aside = False
        self._told = TellsOnce()

    @property
    def anchors(self) -> Sequence[tuple[Point, Point]]:
        """The last points with a long step, the latest one first, each with the one before it."""
        return tuple(self._anchors)

    def needed(self) -> list[Point | None]:
        """The trail, with None for the points from which no later step begins or looks back."""
        last = range(len(self.trail) - 1 - MOST_POINTS_BACK, len(self.trail))
        ends = [k for k, p in enumerate(self.trail) if any(p is a for a, _ in self._anchors)]
        kept = {*last, *ends, *(max(0, k - MOST_POINTS_BACK) for k in ends)}
        return [p if k in kept else None for k, p in enumerate(self.trail)]

    def pace(self) -> dict[str, float | None]:
        """How long the steps of late were, and what was told: what `recall` takes."""
        return {
            "arc": self._arc, "short": self._short, "next": self._next, "quiet": self._told.left,
            "fourth": self.watch.fourth,
        }  # fmt: skip

    def recall(
        self,
        trail: Sequence[Point],
        anchors: Sequence[tuple[Point, Point]],
        pace: Mapping[str, float | None],
    ) -> None:
        """Go on in a resumed run with what is known of its points, see `needed` and `pace`."""
        self.trail, self._anchors = list(trail), list(anchors)
        self._arc, self._next = float(pace.get("arc") or 0.0), float(pace.get("next") or 0.0)
        self._short, self._told.left = int(pace.get("short") or 0), int(pace.get("quiet") or 0)
        self.watch.fourth = pace.get("fourth")

    def advance(
        self, here: Point, arc: float, before: Point | None
    ) -> tuple[Attempt, Point | None]:
        """As of `TracedBranch.advance`; a watched step must not leave the branch.  Collective."""
        return self.watch.advance(here, arc, before)

    def reached(self, point: Point, before: Point, arc: float) -> None:
        """Take note of an accepted point, of the one before it, and of the arc between the two."""
        arc = min(arc, self.longest)  # a step over a crossing may have been longer
        self._short += 1
        self._told.reached()
        # A step over a crossing begins at an earlier point: those after it are on the turn.
        last = next((k for k, p in enumerate(self.trail) if p is before), len(self.trail) - 1)
        kept = self.trail[: last + 1]
        self.trail = [*kept[-(MOST_POINTS_BACK + MOST_ANCHORS + SMALL_STEPS) :], point]
        if self._short > SMALL_STEPS:
            self._anchors, self._arc = [], arc
        if 2 * arc >= self._arc:
            self._anchors = [(point, before), *self._anchors[: MOST_ANCHORS - 1]]
            self._arc = max(arc, self._arc)
            self._short, self._next = 0, self._arc / SHRINKAGE

    def is_told(self) -> bool:
        """Whether the last step turns aside and that is to be told, which is done once a turn."""
        if not self.turns_aside or self._told.is_recent:
            return False
        self._told.begin()
        return True

    def announced(self, arc: float) -> bool:
        """Whether a step has become so short that a crossing is to be expected; asked once each."""
        if not self._anchors or arc > self._next:
            return False
        self._next = arc / SHRINKAGE
        return True

    def passage(self, here: Point) -> Passage | None:
        """A step from an anchor that passes what lies ahead of a point; None if there is none.

        Its last point must lie on a smooth curve with its first one.  The shapes of a limit point
        are soft, too, and a step over it must not hold them.  If a step without guiding forces
        passes the limit point as well, it is taken even if the watch doubts it.
        """
        branch, doubted = self.branch, None
        for anchor, before in self._anchors:
            done = branch.advanced(anchor, here)
            for ahead in AHEAD:
                arc = done + ahead * self._arc
                attempt, there = branch.advance(anchor, arc, before)
                if there is None:
                    continue
                turn = branch.dot(anchor.direction, anchor.slope, there.direction, there.slope)
                if turn > STRAIGHT and branch.is_smooth(anchor, there, arc):
                    found = Passage(attempt, anchor, there, arc, done)
                    if self.watch.stays(anchor, there, arc, before):
                        return found
                    if doubted is None or (found.has_limit and not doubted.has_limit):
                        doubted = found
        guided = self._guided_passage(here)
        if guided is None or doubted is None:
            return guided
        return doubted if guided.has_limit and doubted.has_limit else guided

    def held_passage(self, here: Point, arc: float) -> Passage | None:
        """A step from a point with the soft shapes held, if the watch has seen a motion aside.

        None if the state is stable, see `_is_unstable`: a device goes that way.  None if no
        equilibrium is near; then `turns_aside` is set.
        """
        self.turns_aside = False
        if not self.watch.is_aside:
            return None
        if self._held is not here:
            self._held, self._open = here, self._is_unstable(here)
            back = self.trail[max(0, len(self.trail) - 1 - MOST_POINTS_BACK)]
            for count in self._shapes_held(here) if self._open else ():
                if found := self._along_guides(
                    here, back, here, arc, MOST_HELD_STEPS, MOST_HELD_LANDING, count
                ):
                    return found
        self.turns_aside = self._open
        return None

    def _is_unstable(self, point: Point) -> bool:
        """Whether a device leaves a state by itself even where the load's own amount is held.

        The load's own amount is the charge for a voltage.  It is constant to first order in
        motions v with v . b = 0, b = dR/df.  With K x' = -b f', these motions and x' are
        K-orthogonal, so they have all negative eigenvalues of K but one if x' . K x' < 0.  Behind
        a limit point that one is its own.  False where the soft shapes cannot be held.  Collective.
        """
        problem, solver = self.branch.problem, self.branch.solver
        if not problem.forms.is_symmetric or not self.trail:
            return False
        with problem.at(point.state):
            solver.refresh_inertia()
            load = self.branch.course.derivative()
        work = float(problem.comm.allreduce(point.direction @ load, op=MPI.SUM))
        own = int(point.slope * work > 0)  # x' . K x' = -f' x' . b
        return (solver.inertia.excess or 0) > own

    def straight_on(self, begin: Point, here: Point) -> Passage | None:
        """A step with soft shapes held from before a turn to behind a later point, if there is one.

        Parameters
        ----------
        begin
            A point from which the branch has turned.
        here
            The last point.
        """
        place = next((k for k, p in enumerate(self.trail) if p is begin), 0)
        for k in (place - n for n in POINTS_BEFORE_TURN if n < place):
            back = self.trail[max(0, k - MOST_POINTS_BACK)]
            if found := self._along_guides(
                self.trail[k], back, here, self._arc, MOST_STEPS_OVER_TURN
            ):
                return found
        return None

    def _guided_passage(self, here: Point) -> Passage | None:
        """The same with soft shapes held on the way."""
        if not self.branch.problem.forms.is_symmetric:
            return None
        for count in self._shapes_held(here):
            for anchor, before in self._anchors:
                place = next((k for k, p in enumerate(self.trail) if p is anchor), 0)
                back = self.trail[max(0, place - MOST_POINTS_BACK)] if place else before
                if found := self._along_guides(anchor, back, here, self._arc, count=count):
                    return found
        return None

    def _along_guides(
        self,
        anchor: Point,
        back: Point,
        here: Point,
        step: float,
        most: int = MOST_GUIDED_STEPS,
        near: float = MOST_LANDING,
        count: int = SOFT_SHAPES,
    ) -> Passage | None:
        """Steps with held shapes from an anchor, until an equilibrium lies nearby."""
        branch, length, grows = self.branch, step, count > SOFT_SHAPES
        done, point = branch.advanced(anchor, here), anchor
        for _ in range(MOST_STEPS_OVER_TURN if grows else most):
            guide = Guide.across(branch, back, point, count)
            if guide is None:
                return None
            attempt = branch.step(guide.start, length, None, guide)
            if not attempt.converged:
                return None
            reached = branch.point(attempt.found, guide.start, guide=guide)
            if reached is None:
                return None
            point, way = reached, branch.advanced(anchor, reached)
            if way > done + AHEAD[0] * step:
                most_moved = max(near * step, MOST_LANDING_OF_PASSAGE * way)
                attempt, there = self._landed(point, most_moved)
                if there is not None:
                    arc = branch.advanced(anchor, there)
                    if branch.is_smooth(anchor, there, arc, guide):
                        return Passage(attempt, anchor, there, arc, done, guide)
            if grows and attempt.iterations <= QUICK_ITERATIONS:
                length = min(GROWTH_OF_GUIDED_STEPS * length, self.longest)
        return None

    def _shapes_held(self, point: Point) -> Sequence[int]:
        """How many soft shapes are held on the way from a point: more, if these fail.  Collective.

        Near a minimum of the voltage of a thin balloon all unstable shapes become stable within a
        short arc.  An equilibrium between them hardly determines any, so all must be held.
        """
        problem, solver = self.branch.problem, self.branch.solver
        with problem.at(point.state):
            solver.refresh_inertia()
        unstable = solver.inertia.excess or 0
        more = min(SOFT_SHAPES + unstable, MOST_SOFT_SHAPES)
        return (SOFT_SHAPES, more) if 2 * unstable > SOFT_SHAPES else (SOFT_SHAPES,)

    def _landed(self, point: Point, most: float) -> tuple[Attempt, Point | None]:
        """The equilibrium near a point with guiding forces, or None if none is near."""
        branch = self.branch
        attempt = branch.corrected(point, point.state, point.factor)
        there = branch.point(attempt.found, along=point) if attempt.converged else None
        if there is None:
            return attempt, None
        moved = (there.state.values - point.state.values)[branch.problem.free]
        change = there.factor - point.factor
        way = np.sqrt(branch.dot(moved, change, moved, change))
        turn = branch.dot(point.direction, point.slope, there.direction, there.slope)
        if way > most or turn < STRAIGHT:
            return attempt, None
        return attempt, there
