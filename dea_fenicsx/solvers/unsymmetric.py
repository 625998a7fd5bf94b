"""Linear systems that are not symmetric, by a factor L U of MUMPS."""

from __future__ import annotations

from typing import Any

from dea_fenicsx.solvers.factors import AMF, WORKSPACE_ERRORS, WORKSPACE_MARGINS_PERCENT
from dea_fenicsx.support.compat import PETSc

LARGE_DIAGONAL = 5
"""How MUMPS permutes columns first (its control ICNTL(6)): so that the diagonal becomes large.

Otherwise the zero diagonal of the constraints delays most pivots, and the factor gets four times
the entries.  MUMPS does so on one rank only.
"""


def by_lu(matrix: Any, method: str = "preonly") -> Any:
    """A PETSc solver with the factor of a matrix, which the caller destroys.  Collective.

    MUMPS estimates its workspace before it knows the pivots.  Where many pivots come later than it
    thought, as with the zero diagonal of constraints, it fails, and gets more.

    Parameters
    ----------
    matrix
        The matrix.
    method
        PETSc's name of the method of Krylov that the factor preconditions; the default takes the
        factor as it is.
    """
    for margin in WORKSPACE_MARGINS_PERCENT:
        ksp = PETSc.KSP().create(matrix.getComm())
        ksp.setOperators(matrix)
        ksp.setType(method)
        pc = ksp.getPC()
        pc.setType("lu")
        pc.setFactorSolverType("mumps")
        pc.setFactorSetUpSolverType()
        factor = pc.getFactorMatrix()
        for number, value in {14: margin, 6: LARGE_DIAGONAL, 7: AMF}.items():
            factor.setMumpsIcntl(number, value)
        try:
            ksp.setUp()
            fails = pc.getFailedReason() != 0
        except PETSc.Error:
            fails = True
        if not fails or factor.getMumpsInfog(1) not in WORKSPACE_ERRORS:
            break
        if margin != WORKSPACE_MARGINS_PERCENT[-1]:
            ksp.destroy()
    return ksp
