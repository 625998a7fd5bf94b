"""One nonlinear solve at one load: Newton's method on the true tangent."""

from __future__ import annotations

import time
from collections.abc import Mapping

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import State
from dea_fenicsx.solvers.linear import LinearSolver
from dea_fenicsx.solvers.options import NewtonOptions
from dea_fenicsx.solvers.outcome import Attempt, Outcome, fault_of
from dea_fenicsx.solvers.residual_norms import References

LINEARISING = "linearising"
"""The stage with which each Newton iteration begins."""

FORCING = 3e-4
"""Relative tolerance of each linear solve.

An iteration of Newton's method costs little more than the Krylov iterations in it.  Measured on
strips, a bender and a helix: up to a quarter fewer of them than with a tolerance that shrinks with
the residual (Eisenstat and Walker), which a part that bends makes useless: there the residual falls
and rises by turns.  1e-3 spares a few more, but leaves so much of a thin part's bending, of which
the residual tells little, that Newton strays.
"""

LAST = 0.1
"""Share of the tolerance that Newton's last iteration aims at."""

STAGNANT = 1e3
"""How far above the tolerance a residual may come to rest and still count as rounding."""

AT_REST = 1e-6
"""Largest displacement of an increment, as a share of the device's size, that is none."""


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
        What each field's residual is compared with.
    """

    def __init__(self, problem: Problem, options: NewtonOptions | None = None) -> None:
        super().__init__(problem, options)
        self.references = References(problem)

    def renew(self) -> None:
        """Begin anew with other constants of the problem; matrices and analyses are kept."""
        super().renew()
        self.references = References(self.problem)

    def residual_of(self, residual: np.ndarray) -> float:
        """Largest scaled residual of a field (inf if it is not finite)."""
        norms = list(self.references.norms(residual).values())
        # Python's max would pass over a NaN that is not the first
        return max(norms) if np.all(np.isfinite(norms)) else np.inf

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
            Another load, from an equilibrium `start`: its fixed values are reached together with
            the first Newton step, linearised at `start` (a tangent predictor, safe for large
            prescribed motions).
        tolerance
            Instead of that of the options.
        patient
            Keep an old factor as long as it leads anywhere: for a state beside the path, from which
            no other is solved.
        """
        if factors is not None:
            start = self.problem.under(start, factors)
        with self.problem.at(start):
            return self._iterate(
                self.options.tolerance if tolerance is None else tolerance,
                self.problem.imposed(start) if factors is not None else None,
                patient,
            )

    def _iterate(self, tolerance: float, lifted: State | None, patient: bool) -> Attempt:
        """Newton's method from the present state; first to the `lifted` fixed values, if given."""
        problem = self.problem
        residual = problem.residual()
        norm = self.residual_of(residual)
        # with the loads lifted, the first residual is that of the old load and says nothing
        history = [] if lifted else [norm]
        iteration, increment = 0, None
        while lifted is not None or norm > tolerance:
            if iteration == self.options.max_iterations and increment is not None:
                return Attempt(self._slowness(history, increment), iteration, norm)
            self.notify(LINEARISING)
            rhs = -problem.unbalanced(residual)
            if lifted is not None:
                fixed = problem.fixed
                rhs -= self.tangent.times_fixed(
                    lifted.values[fixed] - problem.w.x.array[fixed]
                )
            increment = self.linear_solve(
                rhs, self._forcing(norm, tolerance, lifted is not None), patient
            )
            if increment is None:
                return Attempt(self.trouble, iteration, norm)
            start, lifted = lifted or problem.state, None
            iteration += 1
            self.counters.newton += 1
            residual, norm, outcome = self._advance(start, increment, history)
            if outcome is not Outcome.CONVERGED:
                return Attempt(outcome, iteration, norm)
            history.append(norm)
            self.notify(f"Newton {iteration}: residual {norm:.1e}")
            if not np.isfinite(norm) or (iteration > 3 and norm > 1e4 * min(history[1:])):
                return Attempt(Outcome.DIVERGED, iteration, norm)
        fault = fault_of(problem.probe())
        found = problem.state if fault is Outcome.CONVERGED else None
        return Attempt(fault, iteration, norm, found)

    @staticmethod
    def _forcing(norm: float, tolerance: float, lifting: bool) -> float:
        """Relative tolerance of the next linear solve."""
        if not lifting and norm * FORCING < tolerance / LAST:
            # the last iteration: well below the tolerance, and no further
            return min(LAST * tolerance / norm, 0.1)
        return FORCING

    def _slowness(self, history: list[float], increment: np.ndarray) -> Outcome:
        """Why Newton has not converged: rounding if all is at rest near the tolerance.

        At a load just beyond a limit point the residual comes to rest as well, but the state does
        not: there Newton's increments stay at about the root of the residual.
        """
        moved = float(np.max(np.abs(increment[self.problem.roles.free(Role.MOTION)]), initial=0.0))
        at_rest = self.problem.comm.allreduce(moved, op=MPI.MAX) < AT_REST
        near = min(history) <= STAGNANT * self.options.tolerance
        return Outcome.ROUNDING if near and at_rest else Outcome.SLOW

    def _advance(
        self, start: State, increment: np.ndarray, history: list[float]
    ) -> tuple[np.ndarray, float, Outcome]:
        """Add an increment, cut back until the state is admissible and the residual acceptable.

        A trial with det F <= 0, past a chain's lock-up or with a wildly growing residual is
        refused; energies are never clamped, which would change the material.
        """
        problem = self.problem
        size = 1.0
        limit = np.inf  # the first residual says little after a change of load
        if len(history) > 1:
            limit = 1e3 * max(history[-1], self.options.tolerance)
        outcome = Outcome.CONVERGED
        for _ in range(8):
            problem.show(problem.moved(start, size * increment))
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
