"""One nonlinear solve at one load: Newton's method on the true tangent."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import State
from dea_fenicsx.solvers.landing import MOST_LANDINGS, share_to_land
from dea_fenicsx.solvers.linear import LinearSolver
from dea_fenicsx.solvers.options import NewtonOptions
from dea_fenicsx.solvers.outcome import Attempt, Outcome, fault_of
from dea_fenicsx.solvers.residual_norms import References
from dea_fenicsx.solvers.squeezing import TOLERATED_SHARE, Squeezing, shortened

LINEARISING = "linearising"
"""The stage with which each Newton iteration begins."""

RAMP_SOLVE_TOLERANCE = 3e-4
"""Relative tolerance of each linear solve on a ramp.

It is constant, because the residual of a bending part does not fall steadily.  See "Measured
constants" in docs/developers/solver.md.
"""

FINAL_SOLVE_SHARE = 0.1
"""The last linear solve of a step aims at this share of Newton's tolerance."""

MOST_ROUNDING_OVER_TOLERANCE = 1e3
"""Largest residual, in units of Newton's tolerance, that can be explained by rounding errors."""

CONTACT_SOFTENING = (0.1, 0.01)
"""Factors on the stiffness r of contacts that are tried one after another when Newton fails."""

SOFTENED_CONTACT_TOLERANCE = 1e-8
"""Newton's tolerance where contacts are softened: this state only starts a further solve."""

NEGLIGIBLE_MOTION = 1e-6
"""Displacements below this share of the device's size are rounding errors."""


class NewtonSolver(LinearSolver):
    """Solves a `Problem` for equilibrium.

    Parameters
    ----------
    problem
        What is to be solved.
    options
        Tolerances and limits.

    Attributes
    ----------
    references
        The forces, charges and volumes that the residual of each field is compared with.
    """

    def __init__(self, problem: Problem, options: NewtonOptions | None = None) -> None:
        super().__init__(problem, options)
        self.references = References(problem)
        self._squeezing = Squeezing(problem)

    def renew(self) -> None:
        """Begin anew with other constants of the problem; matrices and analyses are kept."""
        super().renew()
        self.references = References(self.problem)

    def residual_of(self, residual: np.ndarray, anew: bool = False) -> float:
        """Largest scaled residual of a field (inf if it is not finite); `anew` as of `norms`."""
        norms = list(self.references.norms(residual, anew).values())
        self.tangent.weights = self.references.weights()
        # Python's max would pass over a NaN that is not the first
        return max(norms) if np.all(np.isfinite(norms)) else np.inf

    def without_rounding(self, residual: np.ndarray, norm: float, wanted: float) -> float:
        """The scaled residual once more, if rounding may explain why it does not fall.  Collective.

        Where rounding of the displacements leaves more than Newton's tolerance, the forces that the
        residual is compared with are enlarged, so that later steps know it.

        Parameters
        ----------
        residual
            The residual of the present state.
        norm
            Its scaled size.
        wanted
            The size that it is to come to.  If this is below the usual tolerance, nothing is
            allowed for: who asks for more digits is told that rounding errors forbid them.
        """
        tolerance = self.options.tolerance
        if wanted < NewtonOptions.tolerance or not norm <= MOST_ROUNDING_OVER_TOLERANCE * tolerance:
            return norm
        self.references.allow_for_rounding(residual, tolerance)
        return self.residual_of(residual)

    def solve(
        self,
        start: State,
        factors: Mapping[str, float] | None = None,
        tolerance: float | None = None,
        patient: bool = False,
    ) -> Attempt:
        """Find the equilibrium that Newton's method leads to from a state.  Collective.

        The problem is left in the state in which it was.

        Parameters
        ----------
        start
            Where Newton's method starts.  Its load is the one that is solved for, and its fixed
            values are those of this load, unless `factors` are given.
        factors
            The load to solve for, if it is not that of `start`; `start` must then be an
            equilibrium.  The first Newton step is linearised at `start` and also moves the fixed
            values to the new load (a tangent predictor, safe for large prescribed motions).
        tolerance
            Newton's tolerance, if it is not that of the options.
        patient
            Keep an old factor as long as GMRES converges with it.  This pays for a state beside
            the path, from which no other state is computed.
        """
        if factors is not None:
            start = self.problem.under(start, factors)
        lifting = factors is not None
        tolerance = self.options.tolerance if tolerance is None else tolerance
        attempt = self._attempt(start, tolerance, lifting, patient)
        if attempt.converged or attempt.outcome.is_linear_failure:
            return attempt
        return self._by_soft_contact(start, tolerance, lifting) or attempt

    def _attempt(self, start: State, tolerance: float, lifting: bool, patient: bool) -> Attempt:
        """Newton's method from a state; with `lifting` its first step moves the fixed values."""
        with self.problem.at(start):
            lifted = self.problem.imposed(start) if lifting else None
            return self._iterate(tolerance, lifted, patient)

    def _by_soft_contact(self, start: State, tolerance: float, lifting: bool) -> Attempt | None:
        """Newton's method by way of states of softer contacts; None if there is no such way."""
        contacts = self.problem.forms.contacts
        for number, factor in enumerate(CONTACT_SOFTENING if contacts else (), 1):
            # From the soft state the stiffness grows again, each time from the state before.
            ladder = [factor, *reversed(CONTACT_SOFTENING[: number - 1])]
            state, iterations = start, 0
            for step, softer in enumerate(ladder):
                with contacts.softened(softer):
                    goal = max(tolerance, SOFTENED_CONTACT_TOLERANCE)
                    soft = self._attempt(state, goal, lifting and step == 0, False)
                iterations += soft.iterations
                if not soft.converged:
                    break
                state = soft.found
            else:
                found = self._attempt(state, tolerance, False, False)
                if found.converged:
                    return replace(found, iterations=iterations + found.iterations)
        return None

    def admits(self, guess: State, last: State) -> bool:
        """Whether Newton's method may start from a guess that follows the last state.  Collective.

        All energies must be defined there, and air must not be squeezed too much.
        """
        problem = self.problem
        if self._squeezing:
            with problem.at(last):
                self._squeezing.begin()
        with problem.at(guess):
            if not problem.probe().admissible:
                return False
            return not self._squeezing or self._squeezing.share() >= TOLERATED_SHARE

    def _iterate(self, tolerance: float, lifted: State | None, patient: bool) -> Attempt:
        """Newton's method from the present state.

        If `lifted` is given, the first step moves the fixed values to those of this state.
        """
        problem = self.problem
        residual = problem.residual()
        norm = self.residual_of(residual)
        # If the fixed values change, this residual belongs to the old load, so it is not kept.
        history = [] if lifted else [norm]
        iteration, increment, probed = 0, None, False
        while lifted is not None or norm > tolerance:
            if iteration == self.options.max_iterations and increment is not None:
                outcome = self._slowness(history, increment)
                if outcome is Outcome.ROUNDING:
                    norm = self.without_rounding(residual, norm, tolerance)
                    if norm <= tolerance:
                        break
                return Attempt(outcome, iteration, norm)
            self.notify(LINEARISING)
            rhs = -problem.unbalanced(residual)
            if lifted is not None:
                rhs -= self.tangent.times_lift(lifted.values)
            increment = self.linear_solve(
                rhs, self._forcing(norm, tolerance, lifted is not None), patient
            )
            if increment is None:
                return Attempt(self.trouble, iteration, norm)
            if lifted is not None and self._squeezing:
                start, lifted = self._lift(lifted, increment)
            else:
                start, lifted = lifted or problem.state, None
            iteration += 1
            self.counters.newton += 1
            if lifted is not None:  # only a part of the way: linearise again, and go on
                residual, norm, probed = self._timed_residual(), np.inf, False
                continue
            residual, norm, outcome = self._advance(start, increment, history)
            probed = True
            if outcome is not Outcome.CONVERGED:
                return Attempt(outcome, iteration, norm)
            if norm <= tolerance:
                # A trial state far off may have had larger load forces, and so a looser test.
                norm = self.residual_of(residual, anew=True)
            history.append(norm)
            self.notify(f"Newton {iteration}: residual {norm:.1e}")
            if not np.isfinite(norm) or (iteration > 3 and norm > 1e4 * min(history[1:] or [norm])):
                return Attempt(Outcome.DIVERGED, iteration, norm)
        fault = Outcome.CONVERGED if probed else fault_of(problem.probe())
        found = problem.state if fault is Outcome.CONVERGED else None
        return Attempt(fault, iteration, norm, found)

    @staticmethod
    def _forcing(norm: float, tolerance: float, lifting: bool) -> float:
        """Relative tolerance of the next linear solve."""
        if not lifting and norm * RAMP_SOLVE_TOLERANCE < tolerance / FINAL_SOLVE_SHARE:
            # This is the last iteration: a more exact solve would be wasted.
            return min(FINAL_SOLVE_SHARE * tolerance / norm, 0.1)
        return RAMP_SOLVE_TOLERANCE

    def _slowness(self, history: list[float], increment: np.ndarray) -> Outcome:
        """Why Newton has not converged: because of rounding errors, or for another reason.

        It is rounding if the residual is near the tolerance and the increments are negligible.
        Just beyond a limit point the residual also stops to fall, but the increments do not vanish:
        their size is about the square root of the residual.
        """
        moved = float(np.max(np.abs(increment[self.problem.roles.free(Role.MOTION)]), initial=0.0))
        at_rest = self.problem.comm.allreduce(moved, op=MPI.MAX) < NEGLIGIBLE_MOTION
        # Where all steps were parts of a way that air allowed, no residual has been kept.
        near = min(history, default=np.inf) <= MOST_ROUNDING_OVER_TOLERANCE * self.options.tolerance
        return Outcome.ROUNDING if near and at_rest else Outcome.SLOW

    def _lift(self, lifted: State, increment: np.ndarray) -> tuple[State, State | None]:
        """Move fixed values and unknowns as far as the air allows.

        Returns
        -------
        start : State
            Where the step starts if all of it can be made.
        lifted : State or None
            The state whose fixed values are still aimed at; then a part of the step has been made.
        """
        problem, here, size = self.problem, self.problem.state, 1.0
        self._squeezing.begin()
        for _ in range(8):
            mixed = (1 - size) * here.values + size * lifted.values
            part = lifted.with_values(mixed)
            problem.show(problem.moved(part, size * increment))
            share = self._squeezing.share()
            if share >= TOLERATED_SHARE:
                break
            size *= shortened(share)
        if size == 1.0 or share < TOLERATED_SHARE:
            problem.show(here)
            return lifted, None
        return part, lifted

    def _advance(
        self, start: State, increment: np.ndarray, history: list[float]
    ) -> tuple[np.ndarray, float, Outcome]:
        """Add an increment, halved until the state is admissible and the residual acceptable.

        A trial state is refused if det F <= 0, if a polymer chain is beyond its lock-up, or if the
        residual grows by more than a factor of 1000.  A step that squeezes air too much is
        shortened, see `Squeezing`, and so is one that leads far into an obstacle, see
        `share_to_land`.  Energies are never clamped, because this would change the material.
        """
        problem = self.problem
        size = 1.0
        if len(history) < MOST_LANDINGS:
            size = share_to_land(problem, problem.moved(start, increment))
        limit = np.inf  # The first residual after a change of load may be of any size.
        if len(history) > 1:
            limit = 1e3 * max(history[-1], self.options.tolerance)
        outcome = Outcome.CONVERGED
        self._squeezing.begin()
        for _ in range(8):
            problem.show(problem.moved(start, size * increment))
            if self._squeezing and (share := self._squeezing.share()) < TOLERATED_SHARE:
                outcome = Outcome.INVERTED
                size *= shortened(share)
                continue
            outcome = fault_of(problem.probe())
            if outcome is Outcome.CONVERGED:
                residual = self._timed_residual()
                norm = self.residual_of(residual)
                if norm <= limit:
                    return residual, norm, outcome
                outcome = Outcome.DIVERGED
            size /= 2
        return np.empty(0), np.inf, outcome

    def _timed_residual(self) -> np.ndarray:
        start = time.perf_counter()
        residual = self.problem.residual()
        self.counters.assembly_s += time.perf_counter() - start
        return residual
