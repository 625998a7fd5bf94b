"""Evidence that a continuous path of equilibria leads from one accepted state to the next.

A small residual shows that a state is an equilibrium.  It does not show that the device gets there.
Near an instability Newton's method often converges to an equilibrium of another branch, and the
step length decides which branch it is.  So a step is accepted only with evidence:

1.  Newton's method needs few iterations, the state lies near the extrapolation of the states
    before it, and its speed (displacement per load) is at most 2.5 times that of the step before.
    (On a smooth path towards a limit point the speed grows like an inverse square root, by a factor
    of 2.4 in the last of two equal steps.)
2.  If one of these conditions fails, we compute the tangent of the path at the last state, and an
    equilibrium half-way.  Newton's method must find this equilibrium in few iterations, near the
    tangent, and with the same number of negative eigenvalues.  The speeds of both halves must be
    similar, and the step must end near the parabola through its first half.
3.  In models that are small enough, the negative eigenvalues of the tangent are counted at both
    ends of the step.  If the counts differ, we find the place of the change by bisection.  If the
    states on its two sides are neighbours, the branch itself becomes unstable (a bifurcation of a
    symmetric device).  If they are far apart, the step has changed branches.

Where a surface closes on an obstacle, or opens, the path has a bend, see `bends`.

The caller halves a step without evidence.
"""

from __future__ import annotations

import math

from dea_fenicsx.model.state import State
from dea_fenicsx.path.bends import Bend, contact_begins, contact_changes
from dea_fenicsx.path.events import Sentinel
from dea_fenicsx.path.predictor import Predictor
from dea_fenicsx.path.stability import path_slope
from dea_fenicsx.solvers.newton import NEGLIGIBLE_MOTION, NewtonSolver
from dea_fenicsx.solvers.outcome import Attempt, Outcome

MOST_SPEED_RATIO = 4.0
"""Largest ratio of two speeds (displacement per load coordinate) on one smooth path.

It bounds the speed of a step over that of the tangent at its start, and the speed of one half of a
step over that of the other half.
"""

MOST_SPEED_GROWTH_WITHOUT_PROOF = 2.5
"""Largest speed of a step, over that of the step before, without a state half-way.

A step that lands right on a limit point is 2.41 times as fast as the step before.
"""

MOST_NEWTON_WITHOUT_PROOF = 8
"""Largest number of Newton iterations of a step without a state half-way.

A state half-way that needs more iterations itself proves nothing.
"""

MOST_DISTANCE_WITHOUT_PROOF = 0.25
"""Largest distance of a solution from its prediction without a state half-way.

It is a share of the motion in the step.
"""

MOST_DISTANCE_FROM_PARABOLA = 0.5
"""Largest distance of the end of a step from the parabola through its first half.

It is a share of the motion in the second half.  A step that lands right on a limit point has 0.46.
"""

HALFWAY_TOLERANCE = 1e-8
"""Newton's tolerance for a state half-way.

With a looser one the error of the state would be larger than the motion in a step close to a limit
point.  With 1e-3 good steps were refused there.
"""

TANGENT_STEP_BACK = 1e-3
"""Length of the step back along the tangent, as a share of the present step.

The tangent is represented by the last state and the point that this step leads to.
"""

MOST_HALFWAY_STATES = 3
"""Largest number of states half-way for one step.  Each lies in the faster half of the last way."""

COUNT_BISECTIONS = 10
"""Number of bisections to find where the number of negative eigenvalues changes."""

BISECTION_TOLERANCE = 1e-7
"""Newton's tolerance for the states of these bisections."""

MOST_GAP_OVER_MEAN = 16.0
"""Largest distance between the last two states of the bisection, if they are on one branch.

The unit is the mean distance, that is the motion of the step over 2^COUNT_BISECTIONS.  With 10
bisections the limit is 1.6 % of the motion of the step.
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
        Holds the number of negative eigenvalues of the last accepted state, and counts those of
        other states if they are to be counted.

    Attributes
    ----------
    count
        Negative eigenvalues, beyond those of a stable state, of the solution judged last; None
        where they were not counted.
    bent
        Whether the step to the solution judged last has a bend, beyond which no earlier state may
        be extrapolated.
    """

    def __init__(self, solver: NewtonSolver, predictor: Predictor, sentinel: Sentinel) -> None:
        self.solver, self.problem = solver, solver.problem
        self.predictor, self.sentinel = predictor, sentinel
        self.count: int | None = None
        self.bent = False
        self._refused: State | None = None

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
        self.count, self.bent = None, False
        if not attempt.converged:
            return attempt
        found = attempt.found
        if not self._is_smooth(found, attempt, guess) or not self._count_agrees(found):
            self.solver.forget_factor()  # The factor may belong to a state of the other branch.
            return attempt.refused(Outcome.JUMPED)
        return attempt

    def _is_smooth(self, found: State, attempt: Attempt, guess: State | None) -> bool:
        """Whether the state continues the motion of the steps before.

        If this is in doubt, a state half-way decides.
        """
        predictor, known = self.predictor, self.predictor.known
        moved = predictor.moved(known[-1], found)
        if moved < NEGLIGIBLE_MOTION:  # rounding alone moves a device that is held everywhere
            return True
        doubtful = attempt.iterations > MOST_NEWTON_WITHOUT_PROOF
        if guess is not None:
            usual = predictor.speed(known[-2], known[-1])
            limit = MOST_SPEED_GROWTH_WITHOUT_PROOF * usual
            doubtful = doubtful or predictor.speed(known[-1], found) > limit > 0
            doubtful = doubtful or self._is_astray(guess, found)
        if not doubtful:
            self.bent = contact_begins(self.solver, known[-1], found)
            return True
        if self._was_refused(found):
            return False
        if contact_changes(self.solver, known[-1], found):
            usual = predictor.speed(known[-2], known[-1]) if len(known) > 1 else 0.0
            self.bent = self._bends(known[-1], found, usual) or self._bends_twice(found, usual)
            if self.bent:
                return True
        proven = self.leads_to(found)
        if not proven:
            self._refused = found
        return proven

    def _was_refused(self, found: State) -> bool:
        """Whether this state was refused before: from another start it is still the same one."""
        last = self._refused
        if last is None or dict(last.factors) != dict(found.factors):
            return False
        return self.predictor.moved(last, found) < NEGLIGIBLE_MOTION

    def _bend(self, first: State, last: State) -> Bend | None:
        return Bend.between(self.solver, self.predictor, first, last)

    def _bends(self, first: State, last: State, usual: float) -> bool:
        """Whether a surface closes on an obstacle, or opens, between two states, and no more.

        `usual` is the speed of the way before; 0 if it is not known.
        """
        limit = MOST_SPEED_GROWTH_WITHOUT_PROOF * usual if usual else math.inf
        bend = self._bend(first, last)
        return bend is not None and (
            bend.is_gentle(limit) or bend.is_followed(self.solver, limit)
        )

    def _bends_twice(self, found: State, usual: float) -> bool:
        """Whether a surface closes in the first half of the step, and its contact grows after that.

        This is no single bend.  An equilibrium half-way divides it.  The halves need the evidence
        that two steps of half the length would need; the second one would begin behind a bend, and
        so it is enough that Newton's method leads from its start to its end in few iterations.
        """
        predictor, last = self.predictor, self.predictor.known[-1]
        place = predictor.between(last, found, HALFWAY_TOLERANCE, patient=True)
        attempt = place(predictor.middle(last, found))
        if attempt.iterations > MOST_NEWTON_WITHOUT_PROOF or not attempt.converged:
            return False
        middle = attempt.found
        if not self._bends(last, middle, usual):
            return False
        bend = self._bend(middle, found)
        limit = MOST_SPEED_GROWTH_WITHOUT_PROOF * predictor.speed(last, middle)
        return bend is not None and (bend.is_gentle(limit) or self._is_reached(middle, found))

    def _is_reached(self, start: State, found: State) -> bool:
        """Whether a tangent step from one state ends in another one after few iterations."""
        attempt = self.solver.solve(start, found.factors, HALFWAY_TOLERANCE, patient=True)
        if attempt.iterations > MOST_NEWTON_WITHOUT_PROOF or not attempt.converged:
            return False
        return self.predictor.moved(attempt.found, found) < NEGLIGIBLE_MOTION

    def _is_astray(self, guess: State, found: State) -> bool:
        """Whether a state lies far from its prediction, compared with the motion of the step."""
        predictor = self.predictor
        moved = predictor.moved(predictor.known[-1], found)
        return predictor.moved(guess, found) > MOST_DISTANCE_WITHOUT_PROOF * moved

    def leads_to(self, found: State) -> bool:
        """Whether states half-way show that a path leads from the last known state to this one.

        The speed of the step must not be much larger than that of the tangent at its start.
        Newton's method, started between the two states, must find an equilibrium half-way in few
        iterations and near that tangent.  The speeds of the two halves must be similar, and the
        second half must follow the parabola of the first.

        If one half is faster than a smooth path explains, we examine this half in the same way.
        Over a jump the ratio of the speeds doubles each time.  On a path with a limit point at its
        end the ratio stays the same.
        """
        predictor = self.predictor
        low, high = predictor.known[-1], found
        start = self._start_of_tangent(found)
        verdict = start is None or (
            predictor.speed(low, high) <= MOST_SPEED_RATIO * predictor.speed(start, low)
        )
        for _ in range(MOST_HALFWAY_STATES):
            if not verdict:
                break
            share = predictor.middle(low, high)
            attempt = predictor.between(low, high, HALFWAY_TOLERANCE, patient=True)(share)
            if attempt.iterations > MOST_NEWTON_WITHOUT_PROOF or not attempt.converged:
                verdict = False
                break
            middle = attempt.found
            first, second = predictor.speed(low, middle), predictor.speed(middle, high)
            slow, fast = min(first, second), max(first, second)
            verdict = fast <= MOST_SPEED_RATIO * slow and not self._is_other(middle, start)
            if verdict and start is not None and high is found:
                # If most of the motion is prescribed, a jump in the second half hardly changes the
                # speed.  But it ends far from the parabola through the first half.
                parabola = predictor.through([start, predictor.known[-1], middle], found)
                way = predictor.moved(middle, found)
                verdict = predictor.moved(parabola, found) <= MOST_DISTANCE_FROM_PARABOLA * way
            if fast <= MOST_SPEED_GROWTH_WITHOUT_PROOF * slow:
                break
            low, high = (low, middle) if first > second else (middle, high)
        return verdict

    def _start_of_tangent(self, found: State) -> State | None:
        """A point on the tangent at the last known state, a little before this state.

        The straight line through the two is the tangent.  None at zero voltage, where the
        displacement grows with the square of the voltage and the tangent predicts nothing, and
        None if the tangent cannot be computed.
        """
        problem, last = self.problem, self.predictor.known[-1]
        rates = {name: found.factors[name] - f for name, f in last.factors.items()}
        if self.predictor.even and last.factors[self.predictor.name] == 0:
            return None
        slope = path_slope(self.solver, last, rates)
        if slope is None:
            return None
        before = {n: f - TANGENT_STEP_BACK * rates[n] for n, f in last.factors.items()}
        back = problem.moved(last, -TANGENT_STEP_BACK * slope)
        return problem.imposed(problem.under(back, before))

    def _is_other(self, middle: State, start: State | None) -> bool:
        """Whether a state half-way is on a different branch from the last accepted state."""
        if start is not None:
            pair = [start, self.predictor.known[-1]]
            if self._is_astray(self.predictor.through(pair, middle), middle):
                return True
        before = self.sentinel.excess
        count = self.sentinel.count(middle) if before is not None else None
        return count is not None and count != before

    def _count_agrees(self, found: State) -> bool:
        """Whether the number of negative eigenvalues is that of the last accepted state.

        If it is not, whether the number changes without a jump of the state.
        """
        before = self.sentinel.excess
        self.count = after = self.sentinel.count(found)
        if before is None or after is None or before == after:
            return True
        low, high = self.predictor.known[-1], found
        distance = self.predictor.moved(low, high)
        continuous = self._change_is_continuous(low, high, before, distance)
        self.solver.forget_factor()  # The factor belongs to a nearly singular tangent.
        return continuous

    def _change_is_continuous(
        self, low: State, high: State, before: int, distance: float
    ) -> bool:
        """Whether the states on both sides of a change of the count are neighbours.

        The place of the change is found by bisection.
        """
        predictor = self.predictor
        for _ in range(COUNT_BISECTIONS):
            attempt = predictor.between(low, high, BISECTION_TOLERANCE)(0.5)
            if not attempt.converged:
                return False
            middle = attempt.found
            count = self.sentinel.count(middle)
            if count is None:
                return False
            low, high = (middle, high) if count == before else (low, middle)
        gap = predictor.moved(low, high)
        return gap <= max(MOST_GAP_OVER_MEAN * distance / 2**COUNT_BISECTIONS, NEGLIGIBLE_MOTION)
