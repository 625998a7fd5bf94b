"""Linear solves with the tangent: GMRES on the true tangent, preconditioned by a kept factor.

A factorisation L D L^T by MUMPS costs far more than an assembly or a triangular solve.  So it is
kept, across Newton iterations and load steps, as the preconditioner of GMRES on the true tangent,
turned with the material, and renewed only when the Krylov iterations grow.
"""

from __future__ import annotations

import time
import weakref
from collections.abc import Callable
from typing import Any

import numpy as np

from dea_fenicsx.model.problem import Problem
from dea_fenicsx.solvers.corotation import Corotation, TurnedPreconditioner
from dea_fenicsx.solvers.factors import WholeFactor
from dea_fenicsx.solvers.multigrid import Multigrid
from dea_fenicsx.solvers.options import NewtonOptions
from dea_fenicsx.solvers.outcome import Counters, NegativePivots, Outcome
from dea_fenicsx.solvers.refinement import Solution, solve_to
from dea_fenicsx.solvers.small_krylov import fgmres
from dea_fenicsx.solvers.split_factor import SPLIT_ROLES, SplitFactor
from dea_fenicsx.solvers.tangent import SCALAR_MASS, Tangent
from dea_fenicsx.support.compat import PETSc
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.petsc_objects import PetscObjects

UNKNOWNS_FOR_CHEAP_FACTOR = 20_000
"""From this number of unknowns on, ``factor="auto"`` keeps a split or single-precision factor."""

MOST_UNKNOWNS_COUNTED = {1: 20_000, 2: 20_000, 3: 5_000}
"""Largest number of unknowns for a count of negative eigenvalues at each step, by dimension.

The count needs a factor of the tangent at the accepted state.  The next step then uses this factor
as its preconditioner.
"""

MOST_UNKNOWNS_IN_PYTHON = 20_000
"""Unknowns up to which GMRES runs in Python on one rank: calls back from PETSc cost more there."""

MOST_UNKNOWNS_LENT = 200_000
"""Unknowns up to which a factor stays in memory after a run, to be used for derivatives."""

ASSEMBLY_IN_KRYLOV = {1: 15, 2: 15, 3: 30}
"""Cost of assembling the tangent, in Krylov iterations of a small problem, by dimension."""

LIGHT_ASSEMBLY_IN_KRYLOV = {1: 6, 2: 6, 3: 30}
"""The same where a plain factor makes each Krylov iteration cheap."""

MULTIGRID_PATIENCE = 2
"""Multigrid may take this many times the Krylov iterations of a factor, before it is renewed."""

MOST_UNKNOWNS_RESCUED = 60_000
"""Largest number of unknowns for which the whole tangent is factorised if multigrid fails."""

KRYLOV_PER_DIGIT_FRESH = 1.0
"""Krylov iterations per decimal digit that we accept even from a fresh factorisation."""


type Kept = WholeFactor | SplitFactor | Multigrid
"""What is kept from solve to solve."""


def silent(stage: str) -> None:
    """The default of `LinearSolver.notify`: it does nothing."""


class LinearSolver:
    """Solves linear systems with the tangent of a problem at its present state.

    Parameters
    ----------
    problem
        What is to be solved.
    options
        Tolerances and limits.

    Attributes
    ----------
    tangent
        The tangent.
    inertia
        Negative eigenvalues of the tangent that was factorised last.
    counters
        Work done since the start of the run.
    trouble
        Why the last linear solve failed; `Outcome.CONVERGED` while none has failed.
    notify
        Called on all ranks before each long stage, with its name; what it raises ends the solve.
    """

    def __init__(self, problem: Problem, options: NewtonOptions | None = None) -> None:
        self.problem = problem
        self.options = options or NewtonOptions()
        self.tangent = Tangent(problem)
        self._whole = WholeFactor(problem)
        self._corotation = Corotation(problem)
        self._petsc = PetscObjects(problem.comm)
        self._multigrid: Multigrid | None = None
        self._patience = self.options.krylov_limit
        self._ksp = self._petsc.keep("ksp", self._gmres())
        self._directly = problem.comm.size == 1 and problem.unknowns <= MOST_UNKNOWNS_IN_PYTHON
        self._small: Any = self.tangent.operator.createVecs() if self._directly else None
        self._begin()
        if self.options.factor == "multigrid":
            self.take_multigrid()

    def renew(self) -> None:
        """Begin anew with other constants of the problem; matrices and analyses are kept."""
        self.tangent.renew()
        self._corotation.factor = None
        self._begin()

    def _begin(self) -> None:
        """What holds before the first solve.  A split factor depends on the moduli."""
        self.counters = Counters()
        self.inertia = NegativePivots()
        self.trouble = Outcome.CONVERGED
        self.notify: Callable[[str], None] = silent
        precise = self.options.factor == "precise"
        splits = not self._multigrid and self._splits()
        self._split = SplitFactor(self.problem, precise) if splits else None
        self._preferred: Kept = self._multigrid or self._split or self._whole_or_single()
        self._factor: Kept = self._preferred
        self._stale, self._wasted, self._best_rate = True, 0.0, np.inf

    def take_multigrid(self) -> None:
        """Solve with multigrid from now on; InputError if it cannot take the problem."""
        self._multigrid = self._preferred = self._factor = Multigrid(
            self.problem, self.tangent.times
        )
        self._split, self._patience = None, self.options.krylov_limit * MULTIGRID_PATIENCE

    @property
    def counts_cheaply(self) -> bool:
        """Whether a count of negative eigenvalues at each step costs little.

        It does if the factor that gives the count is also the preconditioner of the next step.
        """
        problem = self.problem
        small = problem.unknowns <= MOST_UNKNOWNS_COUNTED[problem.mesh.topology.dim]
        return small and self._preferred is self._whole and problem.forms.is_symmetric

    @property
    def factor_kind(self) -> str:
        """What is kept as the preconditioner, by its name in `NewtonOptions`."""
        if self._multigrid:
            return "multigrid"
        if self._preferred is self._whole:
            return "whole"
        return "split" if self._preferred is self._split else "single"

    def _splits(self) -> bool:
        """Whether the kept factor is a split one."""
        problem, choice = self.problem, self.options.factor
        discontinuous = problem.pressure_kind == "discontinuous"
        symmetric = problem.forms.is_symmetric
        no_air = all(k.air is None and not k.is_membrane for k in problem.kernels)
        possible = discontinuous and symmetric and no_air and problem.roles.has <= SPLIT_ROLES
        if choice == "split" and not possible:
            why = (
                "a discontinuous pressure, but it is continuous here" if not discontinuous
                else "a symmetric tangent, but it is not symmetric here" if not symmetric
                else "a device without air or membranes" if not no_air
                else "displacement, pressure, potential and internal fields, but there are others"
            )
            raise InputError(
                f'NewtonOptions(factor="split") needs {why}; take factor="whole".'
            )
        large = problem.scene.kinematics.dim == 3 and problem.unknowns >= UNKNOWNS_FOR_CHEAP_FACTOR
        return choice == "split" or (choice in ("auto", "precise") and possible and large)

    def _whole_or_single(self) -> WholeFactor:
        choice = self.options.factor
        large = choice == "auto" and self.problem.unknowns >= UNKNOWNS_FOR_CHEAP_FACTOR
        return WholeFactor(self.problem, True) if choice == "single" or large else self._whole

    def linear_solve(
        self, rhs: np.ndarray, rtol: float, patient: bool = False, transposed: bool = False
    ) -> np.ndarray | None:
        """Solve for the increment.  If GMRES fails with the old factor, make a new one first.

        With `transposed` the transpose of the tangent is solved with.
        """
        fresh = False
        stale = self._stale and not (patient and self._corotation.factor)
        if stale or not self.options.keep_factor:
            if not self._factorise(self._preferred):
                return None
            fresh = True
        for _ in range(3):
            solution, iterations = self._krylov(rhs, rtol, transposed)
            if solution is not None:
                self._judge_factor(iterations, rtol)
                return solution
            if fresh and self._factor is self._whole:
                break
            if fresh and self._multigrid and self.problem.unknowns > MOST_UNKNOWNS_RESCUED:
                break
            if fresh:
                # A split factor neglects part of the coupling between the fields, and a factor in
                # single precision is useless near a singular tangent.  If GMRES fails with such a
                # factor although it is new, the whole tangent is factorised in double precision.
                self._preferred = self._whole
            if not self._factorise(self._preferred):
                return None
            fresh = True
        self.trouble = Outcome.STAGNATION
        return None

    def _judge_factor(self, iterations: int, rtol: float) -> None:
        """Decide whether the factor is to be renewed before the next solve.

        We add up the Krylov iterations that the factor needs beyond its best rate (iterations per
        decimal digit).  The factor is renewed when this sum exceeds the cost of a new one.  The
        best rate is at least `KRYLOV_PER_DIGIT_FRESH`, because a right-hand side may by chance be
        easy to solve for.
        """
        digits = -np.log10(rtol)
        light = self._factor is self._whole and self._whole.is_light
        best = 1 / digits if light else KRYLOV_PER_DIGIT_FRESH
        rate = max(iterations / digits, best)
        self._best_rate = min(self._best_rate, rate)
        self._wasted += (rate - self._best_rate) * digits
        assembly = LIGHT_ASSEMBLY_IN_KRYLOV if light else ASSEMBLY_IN_KRYLOV
        cost = assembly[self.problem.mesh.topology.dim] + self._factor.worth
        self._stale = iterations > self._patience or self._wasted > cost

    def _factorise(self, factor: Kept, counting: bool = False) -> bool:
        """Make a new factor of the tangent; False if MUMPS fails however much room it gets."""
        self._factor.make_room()
        self._corotation.factor = None
        matrix = self._assemble(counting) if factor.needs_matrix else None
        self.notify("factorising")
        start = time.perf_counter()
        self.counters.factorisations += 1
        self._factor = factor
        ok = factor.make(matrix)
        self._corotation.start(factor if ok else None)
        if not ok:
            self.trouble = Outcome.FACTORISATION
        elif factor is self._whole:
            self.inertia = self._counted(self._whole.excess)
        elif factor is self._split and self._split.precise:
            self.inertia = self._counted(0) if self._split.proves_stable else NegativePivots()
        elif factor is self._multigrid:
            self.inertia = NegativePivots()
        self._stale, self._wasted, self._best_rate = not ok, 0.0, np.inf
        self.counters.factor_s += time.perf_counter() - start
        return ok

    def _counted(self, excess: int | None, settled: bool = False) -> NegativePivots:
        """A count of negative eigenvalues beyond those of a stable state, at the present one."""
        return NegativePivots(excess, self.problem.factors, settled, time=self.problem.time)

    def _assemble(self, counting: bool) -> Any:
        """The tangent as a matrix, which the caller destroys."""
        self.notify("assembling")
        start = time.perf_counter()
        matrix = self.tangent.matrix(SCALAR_MASS, counting)
        self.counters.assembly_s += time.perf_counter() - start
        return matrix

    def refresh_inertia(self, last: bool = False) -> None:
        """Factorise the tangent at the problem's present state, to know its inertia.

        A tangent that is not symmetric has none, and multigrid counts none.  If the kept factor is
        a split one, we first try a cheaper count, which may prove that the state is stable.

        Parameters
        ----------
        last
            True if no solve follows: then a large kept factor is deleted first to save memory.
        """
        if not self.problem.forms.is_symmetric or self._multigrid:
            self.inertia = NegativePivots()
            return
        if last and self.problem.unknowns > MOST_UNKNOWNS_LENT:
            self._factor.make_room()
            self._corotation.factor = None
            self._stale = True
        if self._split and self._proves_stable(self._split):
            self.inertia = self._counted(0, settled=True)
        elif self._factorise(self._whole, counting=True):
            self.inertia.settled = True
        else:
            self.inertia = NegativePivots()

    def _proves_stable(self, split: SplitFactor) -> bool:
        def assemble() -> Any:
            matrix = self._assemble(counting=True)
            self.notify("counting negative eigenvalues")
            return matrix

        start, assembling = time.perf_counter(), self.counters.assembly_s
        found = split.excess(assemble)
        self.counters.factorisations += 1
        assembling = self.counters.assembly_s - assembling
        self.counters.factor_s += time.perf_counter() - start - assembling
        return found == 0

    def solve_transposed(self, rhs: np.ndarray, rtol: float = 1e-10) -> Solution | None:
        """Solve with the transpose of the tangent at the problem's present state.  Collective.

        Parameters
        ----------
        rhs
            Right-hand side in the free unknowns (owned).
        rtol
            Wanted size of the residual, relative to the right-hand side.

        Returns
        -------
        Solution or None
            What was found, with the residual that it has; None if nothing was.
        """
        tangent = self.tangent
        transposed = not tangent.is_symmetric

        def solve(rest: np.ndarray, share: float) -> np.ndarray | None:
            return self.linear_solve(rest, share, transposed=transposed)

        return solve_to(rhs, rtol, solve, tangent.times_transposed, self.problem.comm)

    def forget_factor(self) -> None:
        """Make a new factor at the next solve, because the kept one belongs to a distant state."""
        self._stale = True

    def _krylov(
        self, rhs: np.ndarray, rtol: float, transposed: bool = False
    ) -> tuple[np.ndarray | None, int]:
        """GMRES on the tangent with the kept factor; None if it does not converge."""
        self.notify("solving")
        start = time.perf_counter()
        self._corotation.update()
        if self._directly and not transposed:
            found = self._small_krylov(rhs, rtol)
            self.counters.krylov += found[1]
            self.counters.krylov_s += time.perf_counter() - start
            return found
        ksp = self._ksp
        ksp.setTolerances(rtol=rtol, atol=0.0, max_it=2 * self._patience)
        x, b = self.tangent.operator.createVecs()
        weights = self.tangent.weights
        if transposed:
            self.tangent.weights = None
        self._corotation.weights = self.tangent.weights
        b.array[:] = rhs if self.tangent.weights is None else self.tangent.weights * rhs
        (ksp.solveTranspose if transposed else ksp.solve)(b, x)
        iterations = ksp.getIterationNumber()
        self.tangent.weights = weights
        self.counters.krylov += iterations
        solution = x.array_r.copy() if ksp.getConvergedReason() > 0 else None
        x.destroy()
        b.destroy()
        self.counters.krylov_s += time.perf_counter() - start
        return solution, iterations

    def _small_krylov(self, rhs: np.ndarray, rtol: float) -> tuple[np.ndarray | None, int]:
        """The same in Python alone, on one rank."""
        weights, corotation = self.tangent.weights, self._corotation
        corotation.weights = weights
        b, x = self._small

        def precondition(values: np.ndarray) -> np.ndarray:
            b.array[:] = values
            corotation.apply(None, b, x)
            return x.array_r

        def product(values: np.ndarray) -> np.ndarray:
            found = self.tangent.times(values)
            return found if weights is None else weights * found

        weighted = rhs if weights is None else weights * rhs
        return fgmres(product, precondition, weighted, rtol, 2 * self._patience)

    def _gmres(self) -> Any:
        """GMRES, preconditioned from the right by the kept factor, rotated with the material."""
        ksp = PETSc.KSP().create(self.problem.comm)
        ksp.setOptionsPrefix("dea_")
        ksp.setType("fgmres")
        ksp.setPCSide(PETSc.PC.Side.RIGHT)
        ksp.setGMRESRestart(2 * self.options.krylov_limit)
        ksp.setOperators(self.tangent.operator)
        ksp.getPC().setType("python")
        ksp.getPC().setPythonContext(TurnedPreconditioner(weakref.ref(self._corotation)))
        ksp.setErrorIfNotConverged(False)
        ksp.setFromOptions()
        return ksp
