"""Where a path loses stability: the load at which the tangent is singular, and its null vector.

The inertia of the tangent shows that an eigenvalue has changed its sign between two states.  The
eigenvalue m nearest to zero is found by inverse iteration with a new factor,

    A v = m M v,   where M is the identity in the displacements and 0 elsewhere.

The state at which m vanishes is found by a secant rule.  The inertia tells on which side of it a
trial lies, and so keeps a bracket.  With b = dR/df, the derivative of the residual by the load,
A x' = -b f' along the path.  At a limit point v . b is not 0, at a bifurcation it is 0
(H. B. Keller, Applications of Bifurcation Theory, 1977; E. Riks, Int. J. Solids Struct. 15 (1979)
529).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.state import State
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.outcome import Attempt
from dea_fenicsx.solvers.tangent import Tangent

BIFURCATION_COSINE = 1e-4
"""Cosine between load derivative and null vector below which a critical point is a bifurcation."""

SEARCH_TOLERANCE = 1e-7
"""The search for a critical state ends when its bracket or its eigenvalue is this small.

The bracket is measured as a share of the way between the two states, the eigenvalue as a share of
the larger one at the two ends.  Closer to the critical state Newton's method would not be reliable,
because its increments along the null vector are not determined.
"""

SMALL_MOTION = 1e-6
"""Largest dimensionless motion by which a null vector is laid out at all nodes."""

Place = Callable[[float], Attempt]
"""Finds an equilibrium at a share, 0 to 1, of the way between two states."""


@dataclass(frozen=True)
class Critical:
    """A state at which the tangent is singular.

    Attributes
    ----------
    share
        Its place between the two states of the search, 0 to 1.
    width
        Width of the last bracket, in the same measure.
    mode
        The null vector, laid out like the values of the state; its largest displacement is 1.
    is_bifurcation
        Whether the load's derivative is orthogonal to the mode.
    after
        Negative eigenvalues beyond those of a stable state on the far side.
    attempt
        How the equilibrium was found.
    """

    share: float
    width: float
    mode: np.ndarray
    is_bifurcation: bool
    after: int
    attempt: Attempt


def load_derivative(tangent: Tangent, rates: Mapping[str, float]) -> np.ndarray:
    """dR/df in the free rows where each ramp's factor changes at its rate with f."""
    return sum(
        (rate * tangent.by_load(name) for name, rate in rates.items()),
        np.zeros(len(tangent.problem.free)),
    )


PATH_TANGENT_TOLERANCE = 1e-7
"""Relative tolerance of the linear solve for the tangent of a path.

It must be small, because bending of a thin part hardly changes the residual: with 1e-3 the tangent
of a bilayer, 60 times as long as thick, was wrong by a factor of ten.
"""


def path_slope(
    solver: NewtonSolver,
    state: State,
    rates: Mapping[str, float],
    tolerance: float = PATH_TANGENT_TOLERANCE,
) -> np.ndarray | None:
    """dx/df of the free unknowns at a state, each ramp's factor at its rate with f.

    None if the linear solve, to a relative tolerance, fails.  Collective.
    """
    with solver.problem.at(state):
        return solver.linear_solve(-load_derivative(solver.tangent, rates), tolerance)


class CriticalEigenvalue:
    """The tangent's eigenvalue nearest zero, and the search for states at which it vanishes.

    Parameters
    ----------
    solver
        The nonlinear solver with its problem.
    """

    def __init__(self, solver: NewtonSolver) -> None:
        self.solver, self.problem = solver, solver.problem
        self.u = self.problem.roles.free(Role.MOTION)
        # The start vector is pseudo-random, so that it has a part along modes of any symmetry.  It
        # is the same in each run, so that results can be repeated.
        rng = np.random.default_rng(self.problem.comm.rank + 1)
        self._start = np.zeros(len(self.problem.free))
        self._start[self.u] = rng.standard_normal(len(self.u))
        # The scalar product of a mode with this vector is made positive.  So the sign of a mode
        # does not depend on the number of ranks.
        self._compass = np.zeros(self.problem.size)
        for part in self.problem.displacement:
            x = part.space.tabulate_dof_coordinates()
            self._compass[part.dofs] = 1 + x @ (0.37, 0.61, 0.83)

    def count(self, state: State) -> int | None:
        """Negative eigenvalues beyond those of a stable state; None if MUMPS fails."""
        with self.problem.at(state):
            self.solver.refresh_inertia()
        return self.solver.inertia.excess

    def _dot(self, x: np.ndarray, y: np.ndarray) -> float:
        return self.problem.comm.allreduce(float(x[self.u] @ y[self.u]), op=MPI.SUM)

    def nearest_zero(self, state: State) -> tuple[int, float, np.ndarray] | None:
        """Inertia, size of the eigenvalue nearest zero, and its vector in the free unknowns."""
        with self.problem.at(state):
            return self._nearest_zero()

    def _nearest_zero(self) -> tuple[int, float, np.ndarray] | None:
        self.solver.refresh_inertia()
        count = self.solver.inertia.excess
        if count is None:
            return None
        v = self._start / np.sqrt(self._dot(self._start, self._start))
        value = np.inf
        for _ in range(60):
            load = np.zeros_like(v)
            load[self.u] = v[self.u]
            w = self.solver.linear_solve(load, 1e-8)
            if w is None:
                return None
            size = self._dot(w, w)
            new = self._dot(w, v) / size
            v = w / np.sqrt(size)
            if abs(new - value) <= 1e-6 * abs(new):
                break
            value = new
        # The next search starts from this vector, with a small part of the old start vector: a
        # mode that is orthogonal to this one can still be found.
        self._start = v + 1e-3 * self._start / np.sqrt(self._dot(self._start, self._start))
        return count, abs(new), v

    def locate(
        self,
        place: Place,
        before: int,
        rates: Mapping[str, float],
        low: float = 0.0,
    ) -> Critical | None:
        """The first state behind `low` at which the inertia is no longer `before`.

        Parameters
        ----------
        place
            Finds an equilibrium at a share of the way; the inertia differs at 1.
        before
            Inertia at `low`.
        rates
            Change of each ramp's factor along the way, for the load's derivative.

        Returns
        -------
        Critical or None
            None if no equilibrium near it is found.
        """
        ends: list[tuple[float, float, int]] = []
        for share in (low, 1.0):
            end = place(share)
            if not end.converged or (found := self.nearest_zero(end.found)) is None:
                return None
            ends.append((share, found[1], found[0]))
        (a, fa, _), (b, fb, after) = ends
        scale = max(fa, fb)
        best: tuple[float, Critical] | None = None
        for k in range(60):
            # The eigenvalue changes its sign in the bracket, so the secant takes |m| of both ends
            # with different signs.  Each third trial is the middle of the bracket, because a secant
            # rule alone may move only one end.
            x = (a * fb + b * fa) / (fa + fb) if k % 3 != 2 else (a + b) / 2
            trial = self._tried(place, (x, (x + b) / 2, (a + x) / 2))
            if trial is None:
                break
            x, attempt, (count, size, vector) = trial
            if count == before:
                a, fa = x, size
            else:
                b, fb, after = x, size, count
            if best is None or size < best[0]:
                best = size, self._describe(x, b - a, vector, after, rates, attempt)
            if b - a <= SEARCH_TOLERANCE or size < SEARCH_TOLERANCE * scale:
                break
        return best[1] if best and best[0] < 1e-3 * scale else None

    def _tried(
        self, place: Place, shares: Sequence[float]
    ) -> tuple[float, Attempt, tuple[int, float, np.ndarray]] | None:
        """The first share with an equilibrium, and what `nearest_zero` finds there; None if none.

        Newton's method may fail right at a critical state, and not a little beside it.
        """
        for share in shares:
            attempt = place(share)
            if attempt.converged and (found := self.nearest_zero(attempt.found)) is not None:
                return share, attempt, found
        return None

    def _describe(
        self,
        share: float,
        width: float,
        vector: np.ndarray,
        after: int,
        rates: Mapping[str, float],
        attempt: Attempt,
    ) -> Critical:
        problem = self.problem
        with problem.at(attempt.found):
            slope = load_derivative(self.solver.tangent, rates)
        total = problem.comm.allreduce(
            np.array([vector @ slope, vector @ vector, slope @ slope]), op=MPI.SUM
        )
        cosine = abs(total[0]) / np.sqrt(total[1] * total[2]) if total[2] > 0 else 0.0
        return Critical(
            share, width, self.as_values(vector), cosine < BIFURCATION_COSINE, after, attempt,
        )  # fmt: skip

    def as_values(self, vector: np.ndarray) -> np.ndarray:
        """A vector in the free unknowns laid out like a state's, largest displacement 1."""
        problem = self.problem
        largest = float(np.max(np.abs(vector[self.u]), initial=0.0))
        largest = problem.comm.allreduce(largest, op=MPI.MAX)
        compass = float(vector[self.u] @ self._compass[problem.free[self.u]])
        if problem.comm.allreduce(compass, op=MPI.SUM) < 0:
            largest = -largest
        rest = problem.state.with_values(np.zeros(problem.size))
        # The nodes of a rigid part are no linear functions of its rotation, which must be small.
        there, here = (
            problem.moved(rest, size * vector).values for size in (SMALL_MOTION / largest, 0.0)
        )
        return np.asarray((there - here) / SMALL_MOTION)
