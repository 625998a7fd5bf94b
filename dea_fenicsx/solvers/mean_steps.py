"""Newton's method for the end of a step whose forces are means over the step, see `mean_forces`.

The rows of the displacement hold the mean forces and the inertia, all other rows what must hold at
the end.  The tangent is not symmetric, so that it is factorised as such, in each iteration.

The nodes of a rigid part move from u_0 = g(q_0) to u_1 = g(q_1).  A step turns their arms y by

    y_1 - y_0 = w x (y_0 + y_1)/2,    |w| = 2 tan(angle/2),

and so the row of a rotation holds the moments of all forces, inertia included, about the mean arms.
Then they do the work of the step, and have no moment of their own.  The mean of dg/dq at both ends
has these arms.  Source: O. Gonzalez, Comput. Methods Appl. Mech. Engrg. 174 (1999) 445.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.mean_forces import MeanForces
from dea_fenicsx.model.state import State
from dea_fenicsx.solvers.consistent import START_COMPRESSIBILITY
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.outcome import Attempt, Outcome, fault_of
from dea_fenicsx.solvers.unsymmetric import by_lu
from dea_fenicsx.support.compat import PETSc

MEAN_STEP_TOLERANCE = 1e-12
"""Scaled residual at which a step ends."""

RESIDUAL_OF_ROUNDING = 1e-10
"""Scaled residual that rounding may leave, where a further iteration does not halve it."""

MOST_ITERATIONS_OF_MEAN_STEP = 15
"""Newton iterations of one step."""


class MeanSteps:
    """Finds the ends of steps with mean forces.

    Parameters
    ----------
    solver
        The solver of the problem.
    """

    def __init__(self, solver: NewtonSolver) -> None:
        self.solver, self.problem = solver, solver.problem
        self.mean = MeanForces(solver.problem)

    def solve(self, base: State, guess: State) -> Attempt:
        """The end of a step from a state, whose inertia `guess` has.  Collective."""
        problem = self.problem
        self.mean.begin(base)
        if problem.rigid:
            with problem.at(base):
                problem.earlier = problem.expansion.copy(), base.factors
        try:
            with problem.at(problem.imposed(guess)):
                return self._iterate()
        finally:
            if problem.earlier is not None:
                problem.earlier[0].destroy()
                problem.earlier = None

    def _iterate(self) -> Attempt:
        """Newton's method from the present state of the problem."""
        problem, before = self.problem, np.inf
        for iteration in range(MOST_ITERATIONS_OF_MEAN_STEP + 1):
            fault = fault_of(problem.probe())
            if fault is not Outcome.CONVERGED:
                return Attempt(fault, iteration, np.inf)
            residual = self._residual()
            size = self.solver.residual_of(residual)
            stays = size <= RESIDUAL_OF_ROUNDING and size > before / 2
            if size <= MEAN_STEP_TOLERANCE or stays:
                return Attempt(Outcome.CONVERGED, iteration, size, problem.state)
            if not np.isfinite(size):
                return Attempt(Outcome.DIVERGED, iteration, size)
            before = size
            if iteration < MOST_ITERATIONS_OF_MEAN_STEP:
                here = problem.state
                problem.show(problem.moved(here, self._change(residual)))
                self.solver.counters.newton += 1
        return Attempt(Outcome.SLOW, MOST_ITERATIONS_OF_MEAN_STEP, before)

    def _residual(self) -> np.ndarray:
        """The residual at all owned degrees of freedom.  Collective."""
        problem, rows = self.problem, self.mean.rows
        found = problem.residual()
        values = problem.w.x.array[: problem.owned]
        forces = self.mean.forces() + problem.massive().forces(values)
        found[rows] = forces[rows]
        return found

    def _change(self, residual: np.ndarray) -> np.ndarray:
        """Newton's step of the free unknowns (owned).  Collective."""
        matrix = self._matrix()
        ksp = by_lu(matrix, self.problem.roles.free(Role.MULTIPLIER))
        x, b = matrix.createVecs()
        b.array[:] = -self.problem.unbalanced(residual)
        ksp.solve(b, x)
        found = x.array_r.copy()
        for thing in (ksp, x, b, matrix):
            thing.destroy()
        self.solver.counters.factorisations += 1
        return found

    def _matrix(self) -> Any:
        """The tangent in the free unknowns, which the caller destroys.  Collective."""
        problem, mass = self.problem, self.problem.massive()
        kept = self.solver.tangent.matrix(START_COMPRESSIBILITY)
        self.solver.forget_factor()
        found = kept.copy()
        whole = self.mean.slope()
        whole.axpy(mass.stiffness, mass.matrix, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        slope = self._reduced(whole)
        moving = found.createVecLeft()
        moving.array[:] = 0.0
        moving.array[problem.roles.free(Role.MOTION)] = 1.0
        if problem.rigid:
            moving.array[mass.moving(problem.free, problem.expansion)] = 1.0
        slope.diagonalScale(L=moving)
        moving.array[:] = 1.0 - moving.array_r
        found.diagonalScale(L=moving)
        found.axpy(1.0, slope, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        for thing in (whole, slope, moving):
            thing.destroy()
        return found

    def _reduced(self, whole: Any) -> Any:
        """A matrix in all owned unknowns in the free ones, which the caller destroys."""
        problem = self.problem
        if problem.rigid:
            return self._by_mean_arms(whole)
        if problem.expansion is not None:
            return whole.ptap(problem.expansion)
        rows = PETSc.IS().createGeneral(
            (problem.free + problem.space.rows.start).astype(PETSc.IntType), comm=problem.comm
        )
        found = whole.createSubMatrix(rows, rows)
        rows.destroy()
        return found

    def _by_mean_arms(self, whole: Any) -> Any:
        """(P_0 + P_1)^T A P_1/2 with P = dg/dq, and half of what P_1 adds by its own change."""
        problem = self.problem
        assert problem.earlier is not None
        mean = problem.earlier[0].copy()
        mean.axpy(1.0, problem.expansion, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        mean.scale(0.5)
        ahead = whole.matMult(problem.expansion)
        found = mean.transposeMatMult(ahead)
        for thing in (mean, ahead):
            thing.destroy()
        bend = problem.rigid.stiffness(self._residual(), problem.w.x.array)
        problem.rigid.enter(found, bend / 2)
        return found
