"""A factor of a small tangent without pivoting, by PETSc itself.

MUMPS is made for large matrices.  For some hundred unknowns most of its time goes into its own
management: a solve takes four times as long as that of PETSc's plain factor, and a factorisation
three times.  But this one does not exchange rows while it factorises, so the order of the unknowns
has to keep the pivots away from 0.

The blocks of displacement and potential have none near 0, on a path that is stable or nearly so.
A pressure has, unless displacements of its cell have been eliminated before: then its pivot is that
of B A^-1 B^T.  So a fill-reducing order is changed, and each pressure moves behind the last
displacement that it is coupled to.  As nothing else guards the factor, a solve with it is compared
with the matrix each time.  If they differ, the caller takes MUMPS.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.support.compat import PETSc

MOST_UNKNOWNS_UNPIVOTED = {1: 6000, 2: 6000, 3: 600}
"""Unknowns up to which this factor is faster, by dimension; see "Measured constants"."""

ROLES = frozenset({Role.MOTION, Role.MULTIPLIER, Role.POTENTIAL})
"""Roles of the fields whose pivots are known to stay away from 0."""

LARGEST_ERROR_OF_SOLVE = 1e-3
"""Largest error of a solve, relative to a random right-hand side, times the root of its length.

The error of a solve is that of the factor over the smallest eigenvalue.  So below 1 the factor has
the inertia of its matrix.
"""


def is_possible(problem: Problem) -> bool:
    """Whether a problem's tangent is worth such a factor."""
    if problem.comm.size > 1 or problem.conditions.expansion is not None:
        return False
    small = problem.unknowns <= MOST_UNKNOWNS_UNPIVOTED[problem.mesh.topology.dim]
    plain = all(k.air is None and not k.is_membrane for k in problem.kernels)
    return small and plain and problem.forms.is_symmetric and problem.roles.has <= ROLES


class Unpivoted:
    """L D L^T of an assembled matrix that keeps its pattern.

    Parameters
    ----------
    problem
        The problem whose tangent it is.
    matrix
        The assembled matrix; it is not changed.

    Attributes
    ----------
    negative
        Number of negative pivots.
    """

    symmetric = True

    def __init__(self, problem: Problem, matrix: Any) -> None:
        self.matrix, self.negative = matrix, 0
        offsets, columns, _ = matrix.getValuesCSR()
        n = len(offsets) - 1
        self._order = _behind(_fill_reducing(matrix), offsets, columns, problem)
        place = np.empty(n, dtype=np.int32)
        place[self._order] = np.arange(n)
        rows, columns = place[np.repeat(np.arange(n), np.diff(offsets))], place[columns]
        upper = np.flatnonzero(rows <= columns)
        sort = upper[np.lexsort((columns[upper], rows[upper]))]
        starts = np.zeros(n + 1, dtype=np.int32)
        np.cumsum(np.bincount(rows[sort], minlength=n), out=starts[1:])
        self._taken, self._values = sort, np.zeros(len(sort))
        self._csr = starts, columns[sort].astype(np.int32), self._values  # PETSc reads this memory
        self._upper = PETSc.Mat().createAIJWithArrays((n, n), self._csr, comm=PETSc.COMM_SELF)
        self._upper.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self._x, self._b = self._upper.createVecs()
        self._probe = np.random.default_rng(1).standard_normal(n)
        self._pc: Any = None

    def make(self) -> bool:
        """Factorise the matrix with its present values; False if the factor is not exact enough."""
        values = self.matrix.getValuesCSR()[2]
        self._values[:] = values[self._taken]
        self._upper.stateIncrease()
        try:
            if self._pc is None:
                self._pc = PETSc.PC().create(PETSc.COMM_SELF)
                self._pc.setOperators(self._upper)
                self._pc.setType("cholesky")
                self._pc.setFactorSolverType("petsc")
                self._pc.setFactorOrdering("natural")
            else:
                self._pc.setReusePreconditioner(False)
            self._pc.setUp()
            self.negative = self._pc.getFactorMatrix().getInertia()[0]
        except PETSc.Error:
            return False
        self._pc.setReusePreconditioner(True)
        return self._error() < LARGEST_ERROR_OF_SOLVE

    def _error(self) -> float:
        """Error of a solve, as `LARGEST_ERROR_OF_SOLVE` counts it."""
        x = self.solved(self._probe)
        product = self._x
        self._b.array[:] = x[self._order]
        self._upper.mult(self._b, product)
        found = product.array_r.copy()
        self._upper.multTranspose(self._b, product)
        found += product.array_r - self._diagonal() * self._b.array_r
        rest = np.linalg.norm(found - self._probe[self._order]) / np.linalg.norm(self._probe)
        return float(rest * np.sqrt(len(x)))

    def _diagonal(self) -> np.ndarray:
        return self._values[self._csr[0][:-1]]

    def solved(self, b: np.ndarray) -> np.ndarray:
        """The solution for a right-hand side, both in the order of the matrix."""
        self._b.array[:] = b[self._order]
        self._pc.apply(self._b, self._x)
        found = np.empty_like(b)
        found[self._order] = self._x.array_r
        return found

    def apply(self, x: Any, y: Any) -> None:
        """Solve with the factor: reads x and writes y, PETSc vectors."""
        y.array[:] = self.solved(x.array_r)

    applyTranspose = apply

    @property
    def worth(self) -> float:
        """Krylov iterations that take as long as a factorisation."""
        return FACTORISATION_IN_KRYLOV

    @property
    def pc(self) -> Unpivoted:
        """What solves."""
        return self

    def release(self) -> None:
        """Delete the factor.  The matrix stays."""
        if self._pc is not None:
            self._pc.destroy()
            self._pc = None

    destroy = release


FACTORISATION_IN_KRYLOV = 1.5
"""Cost of a factorisation, in Krylov iterations."""


def _fill_reducing(matrix: Any) -> np.ndarray:
    """An order of the unknowns with little fill: the number of each in the order."""
    row, column = matrix.getOrdering("qmd")
    order = np.array(row.getIndices())
    row.destroy()
    column.destroy()
    return order


def _behind(
    order: np.ndarray, offsets: np.ndarray, columns: np.ndarray, problem: Problem
) -> np.ndarray:
    """An order in which each pressure stands behind the last displacement it is coupled to."""
    n = len(order)
    place = np.empty(n)
    place[order] = np.arange(n)
    moves = np.zeros(n, dtype=bool)
    moves[problem.roles.free(Role.MOTION)] = True
    of_motion = np.where(moves[columns], place[columns], -1.0)
    last = np.maximum.reduceat(of_motion, offsets[:-1])
    pressures = problem.roles.free(Role.MULTIPLIER)
    place[pressures] = np.maximum(place[pressures], last[pressures] + 0.5)
    return np.argsort(place, kind="stable").astype(np.int32)
