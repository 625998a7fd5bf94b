"""Evidence that a continuous path of equilibria leads from one accepted state to the next.

A small residual tells that a state is an equilibrium.  It does not tell that the device would come
there: near an instability Newton's method often converges to an equilibrium of another branch, and
to which one depends on the length of the step.  So a step is accepted only with evidence from both
of its ends:

1.  Newton's method needed few iterations, the state lies near the extrapolation of those before,
    and it moves with the load at most 2.5 times as fast as in the step before.  (Towards a limit
    point the speed of a smooth path grows like an inverse square root, by a factor of 2.4 in the
    last of two equal steps.)
2.  Else the tangent of the path at the last state is compared with a state half-way.  That state
    must be found at once, lie near the tangent, and have the same number of negative eigenvalues;
    neither half of the way may be much faster than the other, and the second half must lie where
    the parabola through the first leads.
3.  The number of negative eigenvalues of the tangent is the same at both ends, wherever the model
    is small enough that counting costs little.  If it is not, the place of the change is searched
    by bisection.  On one and the same branch the two sides of that place are neighbours (a
    bifurcation of a symmetric device); if they are far apart, the step has changed branches.

A step without evidence is halved by the caller.
"""

from __future__ import annotations

from dea_fenicsx.model.state import State
from dea_fenicsx.path.events import Sentinel
from dea_fenicsx.path.predictor import Predictor
from dea_fenicsx.path.stability import path_slope
from dea_fenicsx.solvers.newton import AT_REST, NewtonSolver
from dea_fenicsx.solvers.outcome import Attempt, Outcome

FASTER = 4.0
"""Largest ratio of speeds (displacement per load coordinate) along one path.

Of a step to the tangent at its start, and of the two halves of a step to one another.
"""

QUICKENED = 2.5
"""Growth of the speed above which a state half-way is asked for.

A step that lands right on a limit point is 2.41 times as fast as the one before.
"""

WANDERING = 8
"""Newton iterations above which a state half-way is asked for.

A state half-way that itself needs more is no evidence.
"""

ASTRAY = 0.25
"""Distance of a solution from where it is expected, as a share of the motion, that is in doubt."""

OFF_PARABOLA = 0.5
"""Largest distance of a step's end from the parabola through its first half.

As a share of the motion in the second half; a step that lands right on a limit point has 0.46.
"""

HALFWAY_TOLERANCE = 1e-8
"""Newton's tolerance for a state half-way.

Close to a limit point a loose one leaves more of an error than the step's motion: with 1e-3 good
steps were refused there.
"""

BACKWARDS = 1e-3
"""Share of a step by which the second point of a tangent lies behind its first."""

LEVELS = 3
"""Most states half-way for one step, each within the faster half of the last."""

BISECTIONS = 10
"""Bisections of the place where the number of negative eigenvalues changes."""

BISECTION_TOLERANCE = 1e-7
"""Newton's tolerance within that bisection."""

NEIGHBOURS = 16.0
"""Largest distance of the two sides of that place, over what the step's mean speed makes of it.

With 10 bisections: 1.6 % of the step's motion.
"""


class Evidence:
    """Judges the solutions of one ramp, step by step.

    Parameters
    ----------
    solver
        The nonlinear solver with its problem.
    predictor
        Holds the accepted states of the ramp.
    sentinel
        Knows the number of negative eigenvalues of the last accepted state, and whether it is to
        be counted at this one.

    Attributes
    ----------
    count
        Negative eigenvalues, beyond those of a stable state, of the solution judged last; None
        where they were not counted.
    """

    def __init__(self, solver: NewtonSolver, predictor: Predictor, sentinel: Sentinel) -> None:
        self.solver, self.problem = solver, solver.problem
        self.predictor, self.sentinel = predictor, sentinel
        self.count: int | None = None

    def judge(self, attempt: Attempt, guess: State | None) -> Attempt:
        """Refuse a converged state that does not continue the path.  Collective.

        Parameters
        ----------
        attempt
            How the state was found.
        guess
            The extrapolation of the states before to its load, or None.

        Returns
        -------
        Attempt
            The attempt, with the outcome `Outcome.JUMPED` if the state is refused.
        """
        self.count = None
        if not attempt.converged:
            return attempt
        found = attempt.found
        if not self._is_smooth(found, attempt, guess) or not self._count_agrees(found):
            self.solver.forget_factor()  # it may have been made on the other branch
            return attempt.refused(Outcome.JUMPED)
        return attempt

    def _is_smooth(self, found: State, attempt: Attempt, guess: State | None) -> bool:
        """Whether the state moves with the load as it did before, or a state half-way shows it."""
        predictor, known = self.predictor, self.predictor.known
        moved = predictor.moved(known[-1], found)
        if moved < AT_REST:  # rounding alone moves a device that is held everywhere
            return True
        doubtful = attempt.iterations > WANDERING
        if guess is not None:
            usual = predictor.speed(known[-2], known[-1])
            doubtful = doubtful or predictor.speed(known[-1], found) > QUICKENED * usual > 0
            doubtful = doubtful or self._is_astray(guess, found)
        return not doubtful or self.leads_to(found)

    def _is_astray(self, guess: State, found: State) -> bool:
        """Whether a state lies far from where it was expected, measured by the step's motion."""
        predictor = self.predictor
        moved = predictor.moved(predictor.known[-1], found)
        return predictor.moved(guess, found) > ASTRAY * moved

    def leads_to(self, found: State) -> bool:
        """Whether states half-way show that a path leads from the last known state to this one.

        The way may not be much faster than the tangent at its start.  Newton's method, started
        between two states, must find the one half-way at once and near that tangent, and neither
        half may be passed much faster than the other, and the second half must go on where the
        parabola of the first leads.  Where one half is faster by more than a
        smooth path explains, that half is looked into in the same way: over a jump the ratio
        doubles each time, on a path with a limit point at its end it stays.
        """
        predictor = self.predictor
        low, high = predictor.known[-1], found
        start = self._start_of_tangent(found)
        verdict = start is None or (
            predictor.speed(low, high) <= FASTER * predictor.speed(start, low)
        )
        for _ in range(LEVELS):
            if not verdict:
                break
            share = predictor.middle(low, high)
            attempt = predictor.between(low, high, HALFWAY_TOLERANCE, patient=True)(share)
            if attempt.iterations > WANDERING or not attempt.converged:
                verdict = False
                break
            middle = attempt.found
            first, second = predictor.speed(low, middle), predictor.speed(middle, high)
            slow, fast = min(first, second), max(first, second)
            verdict = fast <= FASTER * slow and not self._is_other(middle, start)
            if verdict and start is not None and high is found:
                # A jump in the second half leaves the speed as it is where most of the motion is
                # prescribed; but then the parabola through the first half does not lead there.
                parabola = predictor.through([start, predictor.known[-1], middle], found)
                way = predictor.moved(middle, found)
                verdict = predictor.moved(parabola, found) <= OFF_PARABOLA * way
            if fast <= QUICKENED * slow:
                break
            low, high = (low, middle) if first > second else (middle, high)
        return verdict

    def _start_of_tangent(self, found: State) -> State | None:
        """A point on the tangent at the last known state, a little before it.

        The tangent is extrapolated as the secant through the two.  None where the tangent says
        nothing: at zero voltage, in whose square the displacement grows, or if it cannot be had.
        """
        problem, last = self.problem, self.predictor.known[-1]
        rates = {name: found.factors[name] - f for name, f in last.factors.items()}
        if self.predictor.even and last.factors[self.predictor.name] == 0:
            return None
        slope = path_slope(self.solver, last, rates)
        if slope is None:
            return None
        before = {n: f - BACKWARDS * rates[n] for n, f in last.factors.items()}
        back = problem.moved(last, -BACKWARDS * slope)
        return problem.imposed(problem.under(back, before))

    def _is_other(self, middle: State, start: State | None) -> bool:
        """Whether a state half-way is on another branch than the last accepted one."""
        if start is not None:
            pair = [start, self.predictor.known[-1]]
            if self._is_astray(self.predictor.through(pair, middle), middle):
                return True
        before = self.sentinel.excess
        count = self.sentinel.count(middle) if before is not None else None
        return count is not None and count != before

    def _count_agrees(self, found: State) -> bool:
        """Whether the number of negative eigenvalues is that of the last state, or changes on the
        way without a jump."""
        before = self.sentinel.excess
        self.count = after = self.sentinel.count(found)
        if before is None or after is None or before == after:
            return True
        low, high = self.predictor.known[-1], found
        distance = self.predictor.moved(low, high)
        continuous = self._change_is_continuous(low, high, before, distance)
        self.solver.forget_factor()  # it was made near a singular tangent
        return continuous

    def _change_is_continuous(
        self, low: State, high: State, before: int, distance: float
    ) -> bool:
        """Bisect the place where the count changes; whether its two sides are neighbours."""
        predictor = self.predictor
        for _ in range(BISECTIONS):
            attempt = predictor.between(low, high, BISECTION_TOLERANCE)(0.5)
            if not attempt.converged:
                return False
            middle = attempt.found
            count = self.sentinel.count(middle)
            if count is None:
                return False
            low, high = (middle, high) if count == before else (low, middle)
        gap = predictor.moved(low, high)
        return gap <= max(NEIGHBOURS * distance / 2**BISECTIONS, AT_REST)
