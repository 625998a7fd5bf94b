"""A few eigenpairs of the tangent nearest to zero: K v = m M v.

M is a mass on the displacements: the identity, or a matrix that is given.  Pressure and potential
have none, so K v = m M v holds their equations without inertia.  SLEPc searches in the
displacements alone,

    S M v = v / m,   S = the block of K^-1 in the displacements,

for the 1/m that are largest; each product is one linear solve on the kept factor.  In exact
arithmetic one Krylov sequence finds one vector of a multiple eigenvalue only.  So the search is
repeated in the complement of what was found, until nothing nearer turns up there.  What is found is
then made better by the method of Rayleigh and Ritz, which separates eigenvalues that are close.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.solvers.linear import LinearSolver
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import PETSc
from dea_fenicsx.support.errors import InputError, SolverError
from dea_fenicsx.support.later import Later
from dea_fenicsx.support.validation import is_whole

linalg = Later("scipy.linalg")

EIGEN_SOLVE_TOLERANCE = 1e-11
"""Relative tolerance of each linear solve."""

PAIR_TOLERANCE = 1e-10
"""Relative tolerance of SLEPc's eigenvalues; Rayleigh and Ritz square the error."""

ROUGH_TOLERANCE = 1e-3
"""The same in a search that only looks whether something has been missed.

The error of an eigenvalue is the square of this, so that it tells where the next one lies.
"""

NO_PAIR = 1e-3
"""Residual of K v = m M v, relative to m M v, above which a vector is no eigenvector.

Vectors that the constraints exclude have 1/m = 0, which rounding turns into some large m.
"""

LEAST_COSINE_OF_ITERATES = 0.9
"""Least cosine between an eigenvector and its inverse iterate; below it, it is no eigenvector."""

LEAST_INDEPENDENCE = 1e-10
"""Unit vectors are linearly independent if the matrix of their products has no smaller
eigenvalue.
"""

REPLACING_SHARE = 1e-6
"""A found eigenvalue replaces the farthest one only if it is nearer by this share."""

MOST_SEARCHES = 8
"""Largest number of searches, so that an eigenvalue of this multiplicity is found completely."""


@dataclass(frozen=True)
class Eigenpair:
    """An eigenpair K v = m M v.

    Attributes
    ----------
    value
        The eigenvalue m; the tangent is dimensionless.
    vector
        The eigenvector v in the free unknowns (owned); v . M v = 1.
    residual
        2-norm of K v - m M v over that of M v: an error of m, roughly.
    """

    value: float
    vector: np.ndarray
    residual: float


def eigenpairs(
    solver: LinearSolver, count: int, mass: Any = None, carried: np.ndarray | None = None
) -> list[Eigenpair]:
    """Eigenpairs of the tangent at the problem's present state, the nearest to zero first.

    Collective.

    Parameters
    ----------
    solver
        The solver; it makes a new factor at the present state and keeps it.
    count
        How many are wanted.
    mass
        PETSc matrix in the free unknowns, symmetric, positive definite in those of motion whose
        diagonal is not 0, and 0 elsewhere; None is the identity in those of motion.
    carried
        With a mass: rows U in the free unknowns (owned), shape (n, k), for M - U U^T in place of M.
        It must be positive semi-definite.

    Returns
    -------
    list of Eigenpair
        Fewer than `count` where there are fewer.

    Raises
    ------
    InputError
        If `count` is no whole number of at least 1, or the tangent is not symmetric.
    SolverError
        If the tangent cannot be factorised or solved with.
    """
    if not is_whole(count, 1):
        raise InputError(f"{count!r} eigenpairs are wanted; it must be a whole number, at least 1.")
    if wrong := _unsymmetric(solver.problem):
        raise InputError(
            f"Eigenpairs are found for a symmetric tangent, but that of {', '.join(wrong)} is not "
            "symmetric."
        )
    return _Search(solver, mass, carried).nearest(int(count))


def _unsymmetric(problem: Problem) -> list[str]:
    """Names of what makes the tangent at the present state unsymmetric."""
    at_once = all(history.span == 0 for history in problem.histories.values())
    return problem.forms.unsymmetric_at_once if at_once else problem.forms.unsymmetric


class _Inverse:
    """What PETSc calls to apply S; an error is kept, because PETSc would lose its kind."""

    def __init__(self, solver: LinearSolver, motion: np.ndarray) -> None:
        self.solver, self.motion, self.failed = solver, motion, False

    def full(self, forces: np.ndarray) -> np.ndarray:
        """Response of all free unknowns to forces on those of motion (owned).  Collective."""
        load = np.zeros(len(self.solver.problem.free))
        load[self.motion] = forces
        found = self.solver.linear_solve(load, EIGEN_SOLVE_TOLERANCE)
        if found is None:
            self.failed = True
            return np.zeros_like(load)
        return found

    def apply(self, _: Any, x: Any, y: Any) -> None:
        y.array[:] = self.full(x.array_r.copy())[self.motion]


@dataclass
class _Lightened:
    """The matrix M - U U^T, which PETSc multiplies with."""

    mass: Any
    rows: np.ndarray
    comm: MPI.Comm

    def mult(self, _: Any, x: Any, y: Any) -> None:
        self.mass.mult(x, y)
        shares = self.comm.allreduce(self.rows.T @ x.array_r, op=MPI.SUM)
        y.array[:] -= self.rows @ shares


class _NoProduct:
    """Stands for S^-1, which is never needed where SLEPc inverts around 0.

    SLEPc multiplies it with vectors that are known only to see whether they are null vectors.  They
    are none, since S exists, and a product that is the vector itself says so.
    """

    def mult(self, _: Any, x: Any, y: Any) -> None:
        x.copy(y)


def ritz_values(stiffness: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues of S y = m W y in ascending order, and the columns y with y . W y = 1.

    W holds the products of unit vectors.  Where some depend on the others, W is singular but for
    rounding, and there are fewer eigenvalues than vectors.
    """
    sizes, basis = linalg.eigh(weights)
    independent = sizes > LEAST_INDEPENDENCE
    basis = basis[:, independent] / np.sqrt(sizes[independent])
    values, turn = linalg.eigh(basis.T @ stiffness @ basis)
    return values, basis @ turn


class _Search:
    """The search for the eigenpairs of one tangent.

    Parameters
    ----------
    solver, mass, carried
        As of `eigenpairs`.
    """

    def __init__(
        self, solver: LinearSolver, mass: Any, carried: np.ndarray | None = None
    ) -> None:
        self.solver, self.problem = solver, solver.problem
        self.motion = self.problem.roles.free(Role.MOTION)
        if mass is not None:  # a global unknown may have none
            diagonal = mass.getDiagonal()
            self.motion = self.motion[diagonal.array_r[self.motion] > 0]
            diagonal.destroy()
        self.inverse = _Inverse(solver, self.motion)
        self.comm = self.problem.comm
        self.size = self.comm.allreduce(len(self.motion), op=MPI.SUM)
        n = (len(self.motion), None)
        self.matrix = PETSc.Mat().createPython((n, n), context=_NoProduct(), comm=self.comm)
        self.matrix.setUp()
        self.mass: Any = None
        self._made = [self.matrix]
        if mass is not None:
            first = self.comm.exscan(len(self.problem.free)) or 0
            rows = PETSc.IS().createGeneral(
                (first + self.motion).astype(PETSc.IntType), comm=self.comm
            )
            self.mass = mass.createSubMatrix(rows, rows)
            rows.destroy()
            self._made.append(self.mass)
        if carried is not None:
            light = _Lightened(self.mass, carried[self.motion], self.comm)
            self.mass = PETSc.Mat().createPython((n, n), context=light, comm=self.comm)
            self.mass.setUp()
            self._made.append(self.mass)

    def nearest(self, count: int) -> list[Eigenpair]:
        """The eigenpairs nearest to zero, at most `count`."""
        self.solver.forget_factor()
        count = min(count, self.size)
        found: list[np.ndarray] = []
        pairs: list[Eigenpair] = []
        for _ in range(MOST_SEARCHES):
            if len(pairs) >= count and self._is_alone(pairs[:count], found):
                break
            new = self._search(1 if found else count, found)
            before = pairs
            found += new
            pairs = self._ritz(found)
            if len(pairs) == len(before) or self.size - len(found) < 2:
                break  # only motions that the constraints exclude are left
            if len(before) >= count and _is_complete(before, pairs, count):
                break
        for thing in reversed(self._made):
            thing.destroy()
        return pairs[:count]

    def _is_alone(self, pairs: list[Eigenpair], found: Sequence[np.ndarray]) -> bool:
        """Whether a rough search sees at once that no other eigenvalue is near those found."""
        if self.size - len(found) < 2:
            return False
        others = self._search(1, found, ROUGH_TOLERANCE)
        if not others:
            return False
        next_one = self._ritz(others)
        farthest = max(abs(pair.value) for pair in pairs)
        return bool(next_one) and abs(next_one[0].value) > (1 + ROUGH_TOLERANCE) * farthest

    def _search(
        self, wanted: int, known: Sequence[np.ndarray], tolerance: float = PAIR_TOLERANCE
    ) -> list[np.ndarray]:
        """Vectors of motion by one search of SLEPc's, in the complement of those known."""
        SLEPc = compat.slepc()
        eps = SLEPc.EPS().create(self.comm)
        eps.setOptionsPrefix("dea_eigenpairs_")
        eps.setOperators(self.matrix, self.mass)
        kind = SLEPc.EPS.ProblemType
        eps.setProblemType(kind.HEP if self.mass is None else kind.GHEP)
        eps.setType(SLEPc.EPS.Type.KRYLOVSCHUR)
        eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
        eps.setTarget(0.0)
        room = self.size - len(known)
        eps.setDimensions(wanted, min(room, max(2 * wanted, wanted + 15)))
        eps.setTolerances(tolerance, 200)
        if known:
            eps.setDeflationSpace([self._vector(v) for v in known])
        start = self._vector(self._start(len(known)))
        eps.setInitialSpace([start])
        self._invert(eps.getST())
        try:
            eps.solve()
        except (PETSc.Error, SystemError):  # PETSc raises either, as the error passes through C
            if not self.inverse.failed:
                raise
        if self.inverse.failed:
            raise SolverError(f"Eigenvalues cannot be found: {self.solver.trouble.value}.")
        vector = start.duplicate()
        found = []
        for k in range(min(eps.getConverged(), wanted)):
            eps.getEigenvector(k, vector)
            found.append(vector.array_r.copy())
        for thing in (vector, start, eps):
            thing.destroy()
        return found

    def _invert(self, st: Any) -> None:
        """Let SLEPc invert around 0 by the solver's own linear solves."""
        SLEPc = compat.slepc()
        st.setType(SLEPc.ST.Type.SINVERT)
        st.setShift(0.0)
        st.setMatMode(SLEPc.ST.MatMode.SHELL)
        ksp = st.getKSP()
        ksp.setType("preonly")
        ksp.getPC().setType("python")
        ksp.getPC().setPythonContext(self.inverse)

    def _start(self, seed: int) -> np.ndarray:
        """A pseudo-random vector, so that no symmetry of the device is orthogonal to it."""
        rng = np.random.default_rng([self.comm.rank + 1, seed])
        return rng.standard_normal(len(self.motion))

    def _vector(self, values: np.ndarray) -> Any:
        """A PETSc vector of the unknowns of motion."""
        vector = self.matrix.createVecRight()
        vector.array[:] = values
        return vector

    def _weighed(self, values: np.ndarray) -> np.ndarray:
        """M times a vector of the unknowns of motion (owned)."""
        if self.mass is None:
            return values
        x = self._vector(values)
        y = x.duplicate()
        self.mass.mult(x, y)
        product = y.array_r.copy()
        x.destroy()
        y.destroy()
        return product

    def _ritz(self, found: Sequence[np.ndarray]) -> list[Eigenpair]:
        """The eigenpairs in the space of some vectors, after one more inverse iteration."""
        if not found:
            return []
        V, MV = self._improved(found)
        if not V.shape[1]:
            return []
        KV = np.stack([self.solver.tangent.times(v) for v in V.T], axis=1)
        stiffness, weights = self._sum(V.T @ KV), self._sum(V[self.motion].T @ MV)
        values, turn = ritz_values((stiffness + stiffness.T) / 2, (weights + weights.T) / 2)
        V, KV, MV = V @ turn, KV @ turn, MV @ turn
        rest = KV.copy()
        rest[self.motion] -= MV * values
        sizes = np.sqrt(self._sum(np.stack([np.sum(rest**2, axis=0), np.sum(MV**2, axis=0)])))
        pairs = [
            Eigenpair(float(m), v, float(r / w))
            for m, v, r, w in zip(values, V.T, *sizes, strict=True)
        ]
        pairs.sort(key=lambda pair: abs(pair.value))
        while pairs and not pairs[-1].residual <= NO_PAIR * abs(pairs[-1].value):
            pairs.pop()
        return pairs

    def _improved(self, found: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Vectors of motion after one more inverse iteration, and M times the motion in each.

        The iteration turns a motion that the constraints exclude into rounding; such ones go.
        """
        vectors, weighed = [], []
        for motion in found:
            force = self._weighed(motion)
            vector = self.inverse.full(force)
            if self.inverse.failed:
                raise SolverError(f"Eigenvalues cannot be found: {self.solver.trouble.value}.")
            back = self._weighed(vector[self.motion])
            squares = self._sum(
                np.array([motion @ force, vector[self.motion] @ force, vector[self.motion] @ back])
            )
            if abs(squares[1]) > LEAST_COSINE_OF_ITERATES * np.sqrt(squares[0] * squares[2]):
                vectors.append(vector / np.sqrt(squares[2]))
                weighed.append(back / np.sqrt(squares[2]))
        if not vectors:
            return np.empty((len(self.problem.free), 0)), np.empty((len(self.motion), 0))
        return np.stack(vectors, axis=1), np.stack(weighed, axis=1)

    def _sum(self, values: np.ndarray) -> np.ndarray:
        return np.asarray(self.comm.allreduce(np.ascontiguousarray(values), op=MPI.SUM))


def _is_complete(before: list[Eigenpair], after: list[Eigenpair], count: int) -> bool:
    """Whether a further search has found nothing nearer than the farthest one before it."""
    farthest = abs(before[count - 1].value)
    return abs(after[count - 1].value) >= (1 - REPLACING_SHARE) * farthest
