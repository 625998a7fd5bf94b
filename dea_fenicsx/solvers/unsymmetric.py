"""Linear systems that are not symmetric, by a factor L U of MUMPS and a method of Krylov.

A constraint, such as det F = 1, has no diagonal of its own:

    [A  C^T] [x]   [f]
    [C   0 ] [p] = [g]

With pivoting, most pivots of such a matrix have to wait until their neighbours are eliminated, and
the factor gets several times the entries.  So the factor belongs to a matrix with the diagonal
-share C diag(A)^-1 C^T at constraints.  If A is symmetric and positive definite, this matrix is
quasi-definite, and may be factorised in any order without pivoting (R. J. Vanderbei, SIAM J. Optim.
5 (1995) 100).  Two or three iterations of GMRES solve the system without that diagonal.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dea_fenicsx.solvers.factors import AMF, WORKSPACE_ERRORS, WORKSPACE_MARGINS_PERCENT
from dea_fenicsx.support.compat import PETSc

CONSTRAINT_DIAGONAL = 1e-8
"""Diagonal at a constraint in the matrix that is factorised, as a share of C diag(A)^-1 C^T.

From 1e-6 to 1e-10 the number of iterations changes by one at most."""

LEAST_PIVOT = 1e-12
"""Pivots are taken from the diagonal unless they are less than this share of their row."""

SYSTEM_TOLERANCE = 1e-13
"""Residual at which GMRES ends, as a share of the right-hand side."""

MOST_ITERATIONS_OF_GMRES = 6
"""Most iterations of GMRES.  It is the flexible one, whose residual is that of the system itself,
since without pivoting the factor solves less exactly."""


def by_lu(matrix: Any, constraints: np.ndarray | None = None) -> Any:
    """A PETSc solver with the factor of a matrix, which the caller destroys.  Collective.

    MUMPS estimates its workspace before it knows the pivots.  If it is too small, it gets more.

    Parameters
    ----------
    matrix
        The matrix.
    constraints
        Local numbers of the rows that are constraints, without a diagonal.  None if the matrix is
        factorised with pivoting, as it is, and the factor solves without GMRES.
    """
    factorised = matrix if constraints is None else with_diagonal(matrix, constraints)
    for margin in WORKSPACE_MARGINS_PERCENT:
        ksp = PETSc.KSP().create(matrix.getComm())
        ksp.setOperators(matrix, factorised)
        ksp.setType("preonly" if constraints is None else "fgmres")
        ksp.setTolerances(rtol=SYSTEM_TOLERANCE, atol=0.0, max_it=MOST_ITERATIONS_OF_GMRES)
        pc = ksp.getPC()
        pc.setType("lu")
        pc.setFactorSolverType("mumps")
        pc.setFactorSetUpSolverType()
        factor = pc.getFactorMatrix()
        for number, value in {14: margin, 6: 0, 7: AMF}.items():
            factor.setMumpsIcntl(number, value)
        if constraints is not None:
            factor.setMumpsCntl(1, LEAST_PIVOT)
        try:
            ksp.setUp()
            fails = pc.getFailedReason() != 0
        except PETSc.Error:
            fails = True
        if not fails or factor.getMumpsInfog(1) not in WORKSPACE_ERRORS:
            break
        if margin != WORKSPACE_MARGINS_PERCENT[-1]:
            ksp.destroy()
    if factorised is not matrix:
        factorised.destroy()
    return ksp


def with_diagonal(matrix: Any, constraints: np.ndarray) -> Any:
    """A copy of a matrix with a diagonal at constraints, which the caller destroys.  Collective."""
    offsets, columns, values = matrix.getValuesCSR()
    sizes, comm = matrix.getSizes(), matrix.getComm()
    squares = PETSc.Mat().createAIJ(sizes, csr=(offsets, columns, values**2), comm=comm)
    inverse, found = matrix.getDiagonal(), matrix.createVecLeft()
    diagonal = np.abs(inverse.array_r)
    diagonal[constraints] = 0.0
    inverse.array[:] = np.divide(1.0, diagonal, out=np.zeros_like(diagonal), where=diagonal > 0)
    squares.mult(inverse, found)
    added = np.zeros(len(diagonal))
    added[constraints] = -CONSTRAINT_DIAGONAL * found.array_r[constraints]
    found.array[:] = added
    extra = PETSc.Mat().createAIJ(sizes, nnz=1, comm=comm)
    extra.setDiagonal(found)
    extra.assemble()
    copy = matrix.copy()
    copy.axpy(1.0, extra, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    for thing in (squares, inverse, found, extra):
        thing.destroy()
    return copy
