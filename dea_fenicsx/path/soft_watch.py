"""Steps along a branch that do not go over to another one that leaves it at a small angle.

Close to a bifurcation a long step may end on another branch, and neither the whole of its motion
nor the number of negative eigenvalues need show it.  Two cubics do.  The first one, through the
last two points with their tangents, predicts the state behind a step.  The second one, through both
ends of the step with their tangents, predicts the states within it.  With a step h, the step k
before it and the fourth derivative x'''' of the branch, their errors at the end of the step and at
its share t are

    e = h^2 (h + k)^2 x''''/24,     e_t = t^2 (1 - t)^2 h^4 x''''/24.

On one smooth branch e_t is at most a sixteenth of e.  If the step ends on another branch, which
leaves the first one at an angle within the step, the curve has a kink there, and e_t is a tenth of
e or more at one of two shares.  So after a step with a large e, the first Newton increment from the
second cubic is looked at in two states.  It costs one linear solve each, and estimates e_t.

A motion beside the first prediction that the load does not drive may also be the branch's own turn
into one that almost crosses it (see `crossing`).  Towards a limit point the load drives it.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from dea_fenicsx.path.arclength import Point, TracedBranch
from dea_fenicsx.path.bends import contact_changes
from dea_fenicsx.path.cubic import Cubic
from dea_fenicsx.path.soft_shapes import size
from dea_fenicsx.solvers.outcome import Attempt, Outcome

LEAST_MISSED = 7.5e-4
"""Motion beside the prediction, as a share of the arc, below which a step is accepted as it is."""

MOST_MISSED_BY_CUBIC = 3e-3
"""Motion beside the prediction, as a share of the arc, above which a step is always looked at."""

USUAL_GROWTH = 2.0
"""Growth of the error of the cubic, for equal steps, up to which a step is accepted as it is.

The growth is that of the fourth derivative from its smallest value since the last close look.
"""

SHARES_WITHIN = (0.5, 0.7)
"""Where equilibria within a step are looked for.  A kink that one of them misses the other sees."""

MOST_ERROR_WITHIN = 0.07, 2e-3
"""Largest error e_t of a step that is accepted, as a share of e and of the arc."""

SHORTEST_WATCHED = 2.0**-6
"""Shortest step that is judged, in units of arc."""

MOST_DRIVEN_BY_SHAPES = 0.5
"""Largest work of the load on a motion aside, over that on the branch's own direction.

Both motions are of the same length, and the part along this direction is left out.
"""


class SoftWatch:
    """Steps along a branch that do not leave it at a small angle.

    Parameters
    ----------
    branch
        The branch.

    Attributes
    ----------
    is_aside
        Whether the last step was refused, or moves aside while the load does not drive it.
    fourth
        The error of the cubic by which the next steps are judged, as a multiple of the branch's
        fourth derivative; None where it is not known.
    """

    def __init__(self, branch: TracedBranch) -> None:
        self.branch = branch
        self.forget()

    def forget(self) -> None:
        """Begin anew, as on another branch."""
        self.fourth: float | None = None
        self.is_aside = False

    def advance(
        self, here: Point, arc: float, before: Point | None
    ) -> tuple[Attempt, Point | None]:
        """As of `Branch.advance`, but refuse a step to another branch.  Collective."""
        self.is_aside = False
        attempt, there = self.branch.advance(here, arc, before)
        if there is None or before is None or self._continues(here, there, arc, before):
            return attempt, there
        self.is_aside = True
        return attempt.refused(Outcome.OTHER_BRANCH), None

    def _continues(self, here: Point, there: Point, arc: float, before: Point) -> bool:
        """As of `stays`, but costs little as long as the cubic is as good as before."""
        if self._has_own_kink(here, there, arc):
            self.fourth = None
            return True
        motion = self._missed(here, there, arc, before)
        missed = size(self.branch, motion)
        back = self.branch.advanced(here, before)
        fourth = missed / (arc * (arc - back)) ** 2  # a multiple of the fourth derivative
        known = self.fourth
        usual = known is not None and fourth <= USUAL_GROWTH * known
        if missed <= (MOST_MISSED_BY_CUBIC if usual else LEAST_MISSED) * arc:
            if usual and known is not None:
                self.fourth = min(fourth, known)
            return True
        if not self._is_smooth(here, there, arc, missed):
            return False
        self.fourth = fourth
        self.is_aside = missed > MOST_MISSED_BY_CUBIC * arc and not self._is_driven(motion, here)
        return True

    def _is_driven(self, motion: np.ndarray, point: Point) -> bool:
        """Whether the load drives a motion, as it does towards a limit point."""
        branch, problem = self.branch, self.branch.problem
        with problem.at(point.state):
            load = branch.course.derivative()
        along = point.direction
        ahead = size(branch, along)
        if ahead == 0:
            return True
        across = motion - branch.dot(motion, 0.0, along, 0.0) / ahead**2 * along
        works = np.array([across @ load, along @ load])
        works = np.abs(problem.comm.allreduce(works, op=MPI.SUM))
        ways = size(branch, across), ahead
        return bool(works[0] * ways[1] > MOST_DRIVEN_BY_SHAPES * works[1] * ways[0])

    def stays(self, here: Point, there: Point, arc: float, before: Point) -> bool:
        """Whether a step keeps to its branch.  Collective."""
        if self._has_own_kink(here, there, arc):
            return True
        missed = size(self.branch, self._missed(here, there, arc, before))
        return missed <= LEAST_MISSED * arc or self._is_smooth(here, there, arc, missed)

    def _has_own_kink(self, here: Point, there: Point, arc: float) -> bool:
        """Whether the branch itself may have a kink in a step.  Collective.

        It has one where points of a contact touch, leave or slide.  Other laws have kinks, too,
        such as that of a spring with a table of forces.  Such a kink stays however short a step is.
        So steps of less than `SHORTEST_WATCHED` are not judged.
        """
        solver = self.branch.solver
        return arc < SHORTEST_WATCHED or contact_changes(solver, here.state, there.state)

    def _missed(self, here: Point, there: Point, arc: float, before: Point) -> np.ndarray:
        """How a point lies beside its prediction; the size of this is the error e."""
        guess, _ = Cubic.through(self.branch, here, before).guess(arc)
        return np.asarray((there.state.values - guess.values)[self.branch.problem.free])

    def _is_smooth(self, here: Point, there: Point, arc: float, missed: float) -> bool:
        """Whether the branch lies as near to the cubic of a step as a smooth one.  Collective."""
        branch = self.branch
        cubic = Cubic.through(branch, here, there)
        share_of_missed, share_of_arc = MOST_ERROR_WITHIN
        most = min(share_of_missed * missed, share_of_arc * arc)
        for share in SHARES_WITHIN:
            away = branch.correction(here, cubic.guess(share * arc)[0])
            if away is None or size(branch, away) > most:
                return False
        return True
