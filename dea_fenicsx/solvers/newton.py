"""One nonlinear solve at one load: Newton on the true tangent, preconditioned by a kept factor.

A factorisation L D L^T by MUMPS costs far more than an assembly or a triangular solve.  So it is
kept, across Newton iterations and load steps, as the preconditioner of GMRES on the true tangent,
turned with the material, and renewed only when the Krylov iterations grow.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.problem import Probe, Problem
from dea_fenicsx.solvers.corotation import Corotation
from dea_fenicsx.solvers.factors import SplitFactor, WholeFactor
from dea_fenicsx.solvers.residual_norms import References
from dea_fenicsx.solvers.tangent import MASS, Tangent
from dea_fenicsx.support.compat import PETSc
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import check_declared, plain_numbers

FACTORS = ("auto", "whole", "single", "split")


LINEARISING = "linearising"
"""The stage with which each Newton iteration begins."""


def silent(stage: str) -> None:
    """What `NewtonSolver.notify` does unless told otherwise: nothing."""


@dataclass(frozen=True)
@plain_numbers
class NewtonOptions:
    """Settings of the nonlinear solver.

    Attributes
    ----------
    tolerance
        Each field's residual, relative to its own reference (see `References`).
    max_iterations
        Newton iterations before a step counts as failed.
    krylov_limit
        Krylov iterations in one linear solve after which the factor is renewed.
    keep_factor
        False factorises at every Newton iteration (plain Newton).
    factor
        What is factorised: the ``"whole"`` tangent, the same in ``"single"`` precision, or its
        displacement and its potential ``"split"``, with the pressure condensed; see `factors`.
        ``"auto"`` splits large problems in space if it can, and takes single precision for other
        large ones.
    """

    tolerance: float = 1e-10
    max_iterations: int = 15
    krylov_limit: int = 30
    keep_factor: bool = True
    factor: str = "auto"

    def check(self) -> None:
        """Raise InputError for settings with which no step could converge."""
        check_declared(self)
        if not 1e-14 <= self.tolerance <= 1e-3:
            raise InputError(
                f"Newton's tolerance is {self.tolerance!r}, but must lie between 1e-14, what "
                "rounding allows, and 1e-3."
            )
        if self.factor not in FACTORS:
            raise InputError(
                f"Newton's factor is {self.factor!r}, but must be one of {', '.join(FACTORS)}."
            )
        for name, least in (("max_iterations", 4), ("krylov_limit", 5)):
            value = getattr(self, name)
            if not isinstance(value, int | np.integer) or value < least:
                raise InputError(
                    f"Newton's {name} is {value!r}, but must be a whole number of at least {least}."
                )


LARGE = 20_000
"""Unknowns above which the kept factor is a cheaper one than the whole, unless told otherwise."""

CHEAP_COUNT = {2: 20_000, 3: 5_000}
"""Unknowns up to which negative eigenvalues are counted at each step, by dimension.

The count needs a factor of the tangent at the accepted state, which then serves the next step, too.
"""

ASSEMBLY = {2: 15, 3: 30}
"""Krylov iterations as long as assembling the tangent of a small problem, by dimension."""

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

BEST = 1.0
"""Krylov iterations for a digit that a factor of no age may need."""

STAGNANT = 1e3
"""How far above the tolerance a residual may come to rest and still count as rounding."""

AT_REST = 1e-6
"""Largest displacement of an increment, as a share of the device's size, that is none."""


@dataclass
class Counters:
    """Work done since the start of the run."""

    newton: int = 0
    krylov: int = 0
    factorisations: int = 0
    assembly_s: float = 0.0
    factor_s: float = 0.0
    krylov_s: float = 0.0


REASONS = {
    "diverged": "Newton's residual grew",
    "slow": "Newton did not converge within its iterations",
    "det F <= 0": "every trial state turned a cell inside out",
    "locked chain": "every trial state lay past a chain's lock-up",
    "factorisation": "MUMPS could not factorise the tangent",
    "stagnation": "GMRES did not converge even on a new factor",
    "rounding": "the residual came to rest a little above the tolerance",
    "jumped": "the state found lies on another branch",
}
"""Why a solve may fail."""


@dataclass(frozen=True)
class Attempt:
    """How a nonlinear solve ended.

    Attributes
    ----------
    reason
        Empty if it converged; otherwise one of `REASONS`.
    iterations
        Newton iterations.
    residual
        Largest scaled residual of a field at the end.
    probe
        Extremes at the end, or None if it failed.
    """

    reason: str
    iterations: int
    residual: float
    probe: Probe | None = None

    @property
    def converged(self) -> bool:
        return not self.reason


@dataclass
class Inertia:
    """Negative pivots of the latest factor beyond those of a stable state.

    Zero on a stable path.  It belongs to the tangent that was factorised, at the ramp factors
    given; `None` before the first factorisation.  `settled` tells the tangent of an equilibrium,
    factorised on purpose, from that of one of Newton's iterates on the way to it.
    """

    excess: int | None = None
    factors: dict[str, float] = field(default_factory=dict)
    settled: bool = False


class NewtonSolver:
    """Solves a `Problem` for equilibrium at its current ramp factors.

    Parameters
    ----------
    problem
        What is to be solved.
    options
        Tolerances and limits.

    Attributes
    ----------
    notify
        Called on all ranks before each long stage, with its name; what it raises ends the solve.
    """

    def __init__(self, problem: Problem, options: NewtonOptions | None = None) -> None:
        self.problem = problem
        self.options = options or NewtonOptions()
        self.counters = Counters()
        self.inertia = Inertia()
        self.references = References(problem)
        self.trouble = ""
        self.notify: Callable[[str], None] = silent
        self.tangent = Tangent(problem)
        self._whole = WholeFactor(problem)
        self._split = SplitFactor(problem) if self._splits() else None
        self._preferred = self._split or self._whole_or_single()
        self._factor = self._preferred
        self._corotation = Corotation(problem)
        self._ksp = self._gmres()
        self._stale, self._wasted, self._best_rate = True, 0.0, np.inf

    @property
    def counts_cheaply(self) -> bool:
        """Whether negative eigenvalues can be counted at each step for little.

        The factor that tells them must be the one that serves the next step, too.
        """
        problem = self.problem
        small = problem.unknowns <= CHEAP_COUNT[problem.mesh.topology.dim]
        return small and self._preferred is self._whole

    def _splits(self) -> bool:
        """Whether the kept factor is a split one."""
        problem, choice = self.problem, self.options.factor
        possible = problem.pressure_kind == "discontinuous"
        if choice == "split" and not possible:
            raise InputError(
                'NewtonOptions(factor="split") needs a discontinuous pressure, but it is '
                'continuous here; take factor="whole".'
            )
        large = problem.scene.kinematics.dim == 3 and problem.unknowns >= LARGE
        return choice == "split" or (choice == "auto" and possible and large)

    def _whole_or_single(self) -> WholeFactor | SplitFactor:
        choice = self.options.factor
        large = choice == "auto" and self.problem.unknowns >= LARGE
        return WholeFactor(self.problem, True) if choice == "single" or large else self._whole

    # --------------------------------------------------------------- residuals

    def residual_of(self, residual: np.ndarray) -> float:
        """Largest scaled residual of a field (inf if it is not finite)."""
        norms = list(self.references.norms(residual).values())
        # Python's max would pass over a NaN that is not the first
        return max(norms) if np.all(np.isfinite(norms)) else np.inf

    # ------------------------------------------------------------------ solve

    def solve(self, lift: bool, tolerance: float | None = None, patient: bool = False) -> Attempt:
        """Find equilibrium at the problem's current ramp factors, from its current state.

        Parameters
        ----------
        lift
            True: the fixed values of the new factors are reached together with the first Newton
            step, linearised at the old state (a tangent predictor, safe for large prescribed
            motions).  False: they are already in the state.
        tolerance
            Instead of that of the options.
        patient
            Keep an old factor as long as it leads anywhere: for a state beside the path, from which
            no other is solved.
        """
        problem, options = self.problem, self.options
        tolerance = options.tolerance if tolerance is None else tolerance
        residual = problem.residual()
        change = None
        if lift:
            before = problem.get_state()
            change = problem.insert_fixed()
            after = problem.get_state()
            problem.set_state(before)
        norm = self.residual_of(residual)
        # with the loads lifted, the first residual is that of the old load and says nothing
        history = [] if lift else [norm]
        iteration, increment = 0, None
        while change is not None or norm > tolerance:
            if iteration == options.max_iterations and increment is not None:
                return Attempt(self._slowness(history, increment), iteration, norm)
            self.notify(LINEARISING)
            rhs = -problem.unbalanced(residual)
            if change is not None:
                rhs -= self.tangent.times_fixed(change)
            forcing = FORCING
            if change is None and norm * FORCING < tolerance / LAST:
                # the last iteration: well below the tolerance, and no further
                forcing = min(LAST * tolerance / norm, 0.1)
            increment = self.linear_solve(rhs, forcing, patient)
            if increment is None:
                return Attempt(self.trouble, iteration, norm)
            if change is not None:
                problem.set_state(after)
                change = None
            iteration += 1
            self.counters.newton += 1
            residual, norm, reason = self._advance(increment, history)
            if reason:
                return Attempt(reason, iteration, norm)
            history.append(norm)
            self.notify(f"Newton {iteration}: residual {norm:.1e}")
            if not np.isfinite(norm) or (iteration > 3 and norm > 1e4 * min(history[1:])):
                return Attempt("diverged", iteration, norm)
        probe = problem.probe()
        return Attempt(probe.fault, iteration, norm, probe)

    def _slowness(self, history: list[float], increment: np.ndarray) -> str:
        """Why Newton has not converged: rounding if all is at rest near the tolerance.

        At a load just beyond a limit point the residual comes to rest as well, but the state does
        not: there Newton's increments stay at about the root of the residual.
        """
        moved = float(np.max(np.abs(increment[self.problem.free_fields["u"]]), initial=0.0))
        at_rest = self.problem.comm.allreduce(moved, op=MPI.MAX) < AT_REST
        near = min(history) <= STAGNANT * self.options.tolerance
        return "rounding" if near and at_rest else "slow"

    def _advance(
        self, increment: np.ndarray, history: list[float]
    ) -> tuple[np.ndarray, float, str]:
        """Add an increment, cut back until the state is admissible and the residual acceptable.

        A trial with det F <= 0, past a chain's lock-up or with a wildly growing residual is
        refused; energies are never clamped, which would change the material.
        """
        problem = self.problem
        start = problem.get_state()
        size = 1.0
        limit = np.inf  # the first residual says little after a change of load
        if len(history) > 1:
            limit = 1e3 * max(history[-1], self.options.tolerance)
        reason = ""
        for _ in range(8):
            problem.set_state(start)
            problem.add_free(size * increment)
            reason = problem.probe().fault
            if not reason:
                residual = self._timed_residual()
                norm = self.residual_of(residual)
                if norm <= limit:
                    return residual, norm, ""
                reason = "diverged"
            size /= 2
        return np.empty(0), np.inf, reason

    # ----------------------------------------------------------- linear algebra

    def _timed_residual(self) -> np.ndarray:
        start = time.perf_counter()
        residual = self.problem.residual()
        self.counters.assembly_s += time.perf_counter() - start
        return residual

    def linear_solve(
        self, rhs: np.ndarray, rtol: float, patient: bool = False
    ) -> np.ndarray | None:
        """Solve for the increment; renew the factor where the old one no longer serves."""
        fresh = False
        stale = self._stale and not (patient and self._corotation.factor)
        if stale or not self.options.keep_factor:
            if not self._factorise(self._preferred):
                return None
            fresh = True
        for _ in range(3):
            solution, iterations = self._krylov(rhs, rtol)
            if solution is not None:
                self._judge_factor(iterations, rtol)
                return solution
            if fresh and self._factor is self._whole:
                break
            if fresh:
                # a split factor that fails when it is new has met more coupling than it can bear,
                # one in single precision a tangent too near to singular
                self._preferred = self._whole
            if not self._factorise(self._preferred):
                return None
            fresh = True
        self.trouble = "stagnation"
        return None

    def _judge_factor(self, iterations: int, rtol: float) -> None:
        """Renew the factor before the next solve once its age has cost as much as a new one.

        The cost of age: iterations beyond what the same number of digits took at its best.  Better
        than `BEST` does not count: a right-hand side may be easy by chance.
        """
        digits = -np.log10(rtol)
        rate = max(iterations / digits, BEST)
        self._best_rate = min(self._best_rate, rate)
        self._wasted += (rate - self._best_rate) * digits
        self._stale = (
            iterations > self.options.krylov_limit
            or self._wasted > ASSEMBLY[self.problem.mesh.topology.dim] + self._factor.worth
        )

    def _factorise(self, factor: WholeFactor | SplitFactor, counting: bool = False) -> bool:
        """Make a new factor of the tangent; False if MUMPS fails however much room it gets."""
        self._factor.make_room()
        self._corotation.factor = None
        matrix = self._assemble(counting)
        self.notify("factorising")
        start = time.perf_counter()
        self.counters.factorisations += 1
        self._factor = factor
        ok = factor.make(matrix)
        self._corotation.start(factor if ok else None)
        if not ok:
            self.trouble = "factorisation"
        elif factor is self._whole:
            self.inertia = Inertia(self._whole.excess, dict(self.problem.factors))
        self._stale, self._wasted, self._best_rate = not ok, 0.0, np.inf
        self.counters.factor_s += time.perf_counter() - start
        return ok

    def _assemble(self, counting: bool) -> Any:
        """The tangent as a matrix, which the caller destroys."""
        self.notify("assembling")
        start = time.perf_counter()
        matrix = self.tangent.matrix(MASS, counting)
        self.counters.assembly_s += time.perf_counter() - start
        return matrix

    def refresh_inertia(self, last: bool = False) -> None:
        """Factorise the tangent at the problem's present state, to know its inertia.

        Where the kept factor is a split one, a cheaper count may prove that the state is stable.

        Parameters
        ----------
        last
            The kept factor is not needed any more, and makes room.
        """
        if last:
            self._factor.make_room()
            self._corotation.factor = None
            self._stale = True
        if self._split and self._proves_stable(self._split):
            self.inertia = Inertia(0, dict(self.problem.factors), settled=True)
        elif self._factorise(self._whole, counting=True):
            self.inertia.settled = True
        else:
            self.inertia = Inertia()

    def _proves_stable(self, split: SplitFactor) -> bool:
        matrix = self._assemble(counting=True)
        self.notify("counting negative eigenvalues")
        start = time.perf_counter()
        found = split.excess(matrix)
        self.counters.factorisations += 1
        self.counters.factor_s += time.perf_counter() - start
        return found == 0

    def forget_factor(self) -> None:
        """Make a new factor at the next solve: the kept one belongs to a state far off."""
        self._stale = True

    def _krylov(self, rhs: np.ndarray, rtol: float) -> tuple[np.ndarray | None, int]:
        """GMRES on the tangent with the kept factor; None if it does not converge."""
        self.notify("solving")
        start = time.perf_counter()
        self._corotation.update()
        ksp = self._ksp
        ksp.setTolerances(rtol=rtol, atol=0.0, max_it=2 * self.options.krylov_limit)
        x, b = self.tangent.operator.createVecs()
        b.array[:] = rhs
        ksp.solve(b, x)
        iterations = ksp.getIterationNumber()
        self.counters.krylov += iterations
        solution = x.array_r.copy() if ksp.getConvergedReason() > 0 else None
        x.destroy()
        b.destroy()
        self.counters.krylov_s += time.perf_counter() - start
        return solution, iterations

    def _gmres(self) -> Any:
        """GMRES, preconditioned from the right by the kept factor as it has turned."""
        ksp = PETSc.KSP().create(self.problem.comm)
        ksp.setOptionsPrefix("dea_")
        ksp.setType("fgmres")
        ksp.setPCSide(PETSc.PC.Side.RIGHT)
        ksp.setGMRESRestart(2 * self.options.krylov_limit)
        ksp.setOperators(self.tangent.operator)
        ksp.getPC().setType("python")
        ksp.getPC().setPythonContext(self._corotation)
        ksp.setErrorIfNotConverged(False)
        ksp.setFromOptions()
        return ksp
