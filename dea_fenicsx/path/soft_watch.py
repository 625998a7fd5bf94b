"""Soft shapes watched along a branch, so that no step goes over to another branch by them.

Close to a bifurcation the equilibrium hardly determines the amplitudes of the shapes along which
other branches leave.  A long step then may end on another branch that makes a small angle with
this one, and neither the whole of the motion nor the number of negative eigenvalues need show it.
The soft shapes do.  With C the softest eigenvectors at the start of a step, without the direction
of the chord of the step before, M a matrix of the products of motions and x_p the prediction of the
cubic through the last two points,

    c = C^T M (x - x_start),     e = C^T M (x - x_p).

On a smooth branch e is small of fourth order in the arc.  A step with a large c, most of which the
cubic does not predict, is refused.  It is first tried again from a prediction without these shapes.
"""

from __future__ import annotations

import numpy as np

from dea_fenicsx.path.arclength import Point, TracedBranch
from dea_fenicsx.path.cubic import Cubic
from dea_fenicsx.path.guiding import Guide
from dea_fenicsx.path.soft_shapes import SoftShapes, size, stiffness
from dea_fenicsx.solvers.outcome import Attempt, Outcome

WATCHED_SHAPES = 8
"""How many soft shapes are watched."""

LEAST_ASIDE = 3e-3
"""Motion along the soft shapes, as a share of the arc, below which a step is accepted as it is."""

LEAST_MISSED = 7.5e-4
"""Motion beside the prediction, as a share of the arc, below which a step is accepted as it is."""

USUAL_GROWTH = 2.0
"""Growth of the error of the cubic, for equal steps, up to which a step is accepted as it is.

The error of the cubic through two points is h^2 (h + k)^2 / 24 times the fourth derivative of the
branch, for the step h and the step before k.  A step to another branch has a larger one.  The
growth is that from the smallest error since the soft shapes were looked at.
"""

LEAST_CHANGE = 0.5, 2.0
"""Stiffness of a shape at the end of a step over that at its start, between which it is no danger.

A shape along which another branch leaves is nearly neutral at the start, so that its stiffness
changes its sign or by a multiple of itself.
"""

LEAST_UNPREDICTED = 0.1
"""Share of this motion that must lie beside the prediction, where a step is refused."""


class SoftWatch:
    """Steps along a branch that do not leave it along its soft shapes.

    Parameters
    ----------
    branch
        The branch.
    """

    def __init__(self, branch: TracedBranch) -> None:
        self.branch = branch
        self.forget()

    def forget(self) -> None:
        """Begin anew, as on another branch."""
        self._known: tuple[Point, Guide | None] | None = None
        self._carried = SoftShapes(self.branch, WATCHED_SHAPES)
        self._fourth: float | None = None

    def advance(
        self, here: Point, arc: float, before: Point | None
    ) -> tuple[Attempt, Point | None]:
        """As of `TracedBranch.advance`, but refuse a step that leaves along a soft shape.

        Collective.
        """
        attempt, there = self.branch.advance(here, arc, before)
        if there is None or before is None or self._continues(here, there, arc, before):
            return attempt, there
        straight, there = self._straight(here, arc, before)
        if there is not None and self._continues(here, there, arc, before):
            return straight, there
        return attempt.refused(Outcome.OTHER_BRANCH), None

    def _continues(self, here: Point, there: Point, arc: float, before: Point) -> bool:
        """As of `stays`, but costs little as long as the cubic is as good as before."""
        motion = self._missed(here, there, arc, before)
        missed = size(self.branch, motion)
        back = self.branch.advanced(here, before)
        fourth = missed / (arc * (arc - back)) ** 2  # a multiple of the fourth derivative
        if self._fourth is not None and fourth <= USUAL_GROWTH * self._fourth:
            self._fourth = min(fourth, self._fourth)
            return True
        if missed <= LEAST_MISSED * arc:
            return True
        if not self._keeps_to(here, there, arc, before, motion):
            return False
        self._fourth = fourth
        return True

    def stays(self, here: Point, there: Point, arc: float, before: Point) -> bool:
        """Whether a step keeps to its branch.  Collective.

        It moves little along the soft shapes, or the cubic predicts most of this motion.
        """
        missed = self._missed(here, there, arc, before)
        if size(self.branch, missed) <= LEAST_MISSED * arc:
            return True
        return self._keeps_to(here, there, arc, before, missed)

    def _keeps_to(
        self, here: Point, there: Point, arc: float, before: Point, missed: np.ndarray
    ) -> bool:
        """As of `stays`, for a motion beside the prediction that is not small.  Collective."""
        shapes = self._shapes(here, before)
        if shapes is None:
            return True
        if self._stay_stiff(shapes, here, there):
            return True
        aside = size(self.branch, shapes.part(self._moved(here.state.values, there)))
        unpredicted = size(self.branch, shapes.part(missed))
        few = max(LEAST_MISSED * arc, LEAST_UNPREDICTED * aside)
        return aside <= LEAST_ASIDE * arc or unpredicted <= few

    def _missed(self, here: Point, there: Point, arc: float, before: Point) -> np.ndarray:
        """The motion beside the prediction of the cubic."""
        guess, _ = Cubic.through(self.branch, here, before).guess(arc)
        return self._moved(guess.values, there)

    def _stay_stiff(self, shapes: Guide, here: Point, there: Point) -> bool:
        """Whether the stiffnesses of the soft shapes hardly change in a step.  Collective."""
        first, last = (stiffness(self.branch, shapes.shapes, point) for point in (here, there))
        try:
            changes = np.linalg.eigvals(np.linalg.solve(first, last))
        except np.linalg.LinAlgError:
            return False
        least, most = LEAST_CHANGE
        return bool(np.all((changes.real > least) & (changes.real < most)))

    def _straight(self, here: Point, arc: float, before: Point) -> tuple[Attempt, Point | None]:
        """The same step from a prediction that keeps the amplitudes of the soft shapes."""
        branch, shapes = self.branch, self._shapes(here, before)
        assert shapes is not None
        guess, factor = Cubic.through(branch, here, before).guess(arc)
        attempt = branch.corrected(here, shapes.held(guess), factor)
        return branch.judged(attempt, here, arc)

    def _shapes(self, here: Point, before: Point) -> Guide | None:
        """The soft shapes at a point; None if they cannot be found."""
        branch = self.branch
        if not branch.problem.forms.is_symmetric:
            return None
        if self._known is None or self._known[0] is not here:
            found = self._carried.at(here)
            guide = None if found is None else Guide.beside(branch, before, here, *found)
            self._known = here, guide
        return self._known[1]

    def _moved(self, start: np.ndarray, there: Point) -> np.ndarray:
        return np.asarray((there.state.values - start)[self.branch.problem.free])
