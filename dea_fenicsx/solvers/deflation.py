"""Newton's method away from equilibria that are known: deflation.

With the known equilibria u_i and a length l, the residual R is multiplied by

    M(u) = prod_i (1 + l^2/|u - u_i|^2),   |.| the root mean square of the displacements,

which grows beyond limits at each u_i and tends to 1 far from all of them.  Newton's increment d of
M R follows from that of R, s = -J^-1 R, by the formula of Sherman and Morrison,

    d = s/(1 - g . s),   g = grad ln M,

so that the tangent, and the factor that is kept of it, stay as they are (P. E. Farrell,
A. Birkisson and S. W. Funke, SIAM J. Sci. Comput. 37 (2015) A2026).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.state import State
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.outcome import Outcome, fault_of

DEFLATION_SOLVE_TOLERANCE = 1e-6
"""Relative tolerance of each linear solve."""

MOST_ITERATIONS_FROM_START = 60
"""Most iterations from one start.  Deflation makes Newton's method wander before it converges."""

LONGEST_DISPLACEMENT = 0.3
"""Largest displacement of one increment, over the device's size and what it has moved so far."""

LEAST_DENOMINATOR = 1e-3
"""Least size of 1 - g . s: closer to 0 an increment has no length."""


class Deflation:
    """Finds equilibria at one load, other than those that are known.

    Parameters
    ----------
    solver
        The nonlinear solver with its problem.
    apart
        Smallest distance, over the device's length, at which two equilibria are two.
    """

    def __init__(self, solver: NewtonSolver, apart: float) -> None:
        self.solver, self.problem, self.apart = solver, solver.problem, apart
        self._length = apart
        self._motion = self.problem.roles.free(Role.MOTION)
        self._places = self.problem.free[self._motion]
        self._count = self.problem.comm.allreduce(len(self._places), op=MPI.SUM)
        self.known: list[State] = []

    def distance(self, one: State, other: State) -> float:
        """Root mean square of the displacements between two states.  Collective."""
        apart = (one.values - other.values)[self._places]
        return float(np.sqrt(self.mean(apart, apart)))

    def mean(self, x: np.ndarray, y: np.ndarray) -> float:
        """Mean product of two vectors of displacements (owned).  Collective."""
        total = self.problem.comm.allreduce(float(x @ y), op=MPI.SUM)
        return float(total) / max(1, self._count)

    def is_known(self, state: State) -> bool:
        """Whether a state is one of those that are known.  Collective."""
        return any(self.distance(state, k) <= self.apart for k in self.known)

    def moved(self, state: State, vector: np.ndarray, size: float) -> State:
        """A state moved along a vector by a root mean square `size`.  Collective."""
        part = vector[self._motion]
        rms = np.sqrt(self.mean(part, part))
        return self.problem.moved(state, vector * (size / rms))

    def search(self, start: State, length: float) -> State | None:
        """An equilibrium that is not known, from a start at its load; None if none is found.

        Collective; the problem is left in the state in which it was.

        Parameters
        ----------
        start
            Where Newton's method starts; not at an equilibrium that is known.
        length
            The length l over that of the device, such as the distance of the start from the
            nearest equilibrium that is known.
        """
        self._length = length
        self.solver.forget_factor()
        if any(self.distance(start, known) == 0 for known in self.known):
            return None  # there M has no value
        with self.problem.at(start):
            near = self._iterate()
        if near is None:
            return None
        attempt = self.solver.solve(near)
        if not attempt.converged or self.is_known(attempt.found):
            return None
        return attempt.found

    def carried(self, start: State, factors: Mapping[str, float]) -> State | None:
        """An equilibrium that is not known, from one at another load; None if none is found.

        Newton's method leads to it without deflation.  Collective.
        """
        self.solver.forget_factor()
        attempt = self.solver.solve(start, factors)
        if not attempt.converged or self.is_known(attempt.found):
            return None
        return attempt.found

    def _iterate(self) -> State | None:
        """Deflated Newton's method from the present state."""
        problem, solver = self.problem, self.solver
        if fault_of(problem.probe()) is not Outcome.CONVERGED:
            return None
        residual = problem.residual()
        for _ in range(MOST_ITERATIONS_FROM_START):
            norm = solver.residual_of(residual, anew=True)
            if not np.isfinite(norm):
                return None
            if norm <= solver.options.tolerance:
                return problem.state
            step = solver.linear_solve(-problem.unbalanced(residual), DEFLATION_SOLVE_TOLERANCE)
            if step is None:
                return None
            solver.counters.newton += 1
            moved = self._advance(step * self._stretch(step))
            if moved is None:
                return None
            residual = moved
        return None

    def _stretch(self, step: np.ndarray) -> float:
        """1/(1 - g . s) for Newton's increment s."""
        part, here, slope = step[self._motion], self.problem.state, 0.0
        for known in self.known:
            away = (here.values - known.values)[self._places]
            square = self.mean(away, away) / self._length**2
            change = 2 * self.mean(away, part) / self._length**2
            slope -= change / max(square * (square + 1), 1e-300)
        below = 1 - slope
        return 1 / (below if abs(below) > LEAST_DENOMINATOR else LEAST_DENOMINATOR)

    def _advance(self, step: np.ndarray) -> np.ndarray | None:
        """Add an increment, shortened until the state is admissible; the residual there."""
        problem, start = self.problem, self.problem.state
        longest, so_far = (
            problem.comm.allreduce(float(np.max(np.abs(x), initial=0.0)), op=MPI.MAX)
            for x in (step[self._motion], start.values[self._places])
        )
        share = min(1.0, LONGEST_DISPLACEMENT * (1 + so_far) / max(longest, 1e-300))
        for _ in range(10):
            problem.show(problem.moved(start, share * step))
            if fault_of(problem.probe()) is Outcome.CONVERGED:
                return problem.residual()
            share /= 2
        return None
