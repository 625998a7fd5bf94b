"""The preconditioner of the linear solves: a kept factor of the whole tangent.

`WholeFactor` is L D L^T of the whole tangent, or L U if the tangent is not symmetric.  It is exact
for the state in which it was made, and the signs of the pivots of L D L^T give the inertia of the
tangent.  In single precision it needs half the memory and is as good a preconditioner, but the
signs of its pivots cannot be trusted.  For large problems in space see `split_factor`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dea_fenicsx.model.problem import Problem
from dea_fenicsx.solvers.tangent import MOST_UNKNOWNS_KEPT
from dea_fenicsx.solvers.unpivoted import Unpivoted, is_possible
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import PETSc
from dea_fenicsx.support.petsc_objects import PetscObjects

WORKSPACE_MARGINS_PERCENT = (60, 200, 600)
"""Extra workspace for MUMPS in percent.  If one is too small for it, the next is tried."""

WORKSPACE_ERRORS = (-8, -9, -14, -15, -17, -20)
"""Error codes of MUMPS for a workspace or a buffer that is too small."""

AMF, PORD = 2, 4
"""Numbers by which MUMPS knows two methods to order the unknowns (its control ICNTL(7))."""

PORD_FROM_UNKNOWNS = {2: 100_000, 3: 5_000}
"""Number of unknowns, by dimension, from which PORD orders a matrix.  Smaller ones use AMF.

PORD must not be used for very small matrices: if all unknowns are equivalent, as in a single cell,
it aborts the process.  The measured times are in docs/developers/solver.md, "Measured constants".
"""

FLOPS_PER_ENTRY_READ = 32
"""Operations of a factorisation that take as long as reading one entry of the factor.

A factorisation is limited by computing (20 operations per ns), a Krylov iteration by memory
(16 bytes per entry, read in 1.6 ns).
"""


@dataclass
class Mumps:
    """A factorisation by MUMPS: L D L^T, or L U of a matrix that is not symmetric.

    Parameters
    ----------
    matrix
        The matrix; `make` uses it up unless it is kept.
    icntl, cntl
        MUMPS's own controls, by number.
    single
        Whether to keep the factor in single precision, if this PETSc can.
    keep
        Whether the matrix is kept.  The caller may then fill in other values, and the next `make`
        skips the symbolic analysis.
    symmetric
        Whether the matrix is symmetric.
    """

    matrix: Any
    icntl: dict[int, int]
    cntl: dict[int, float]
    single: bool = False
    keep: bool = False
    symmetric: bool = True
    pc: Any = None

    def make(self) -> bool:
        """Factorise; False if MUMPS fails even with the largest workspace."""
        info = self._fill() if self.pc else WORKSPACE_ERRORS[0]
        if info in WORKSPACE_ERRORS:
            self.matrix.setOption(PETSc.Mat.Option.SYMMETRIC, self.symmetric)
            for margin in WORKSPACE_MARGINS_PERCENT:
                self.release()
                self._set_up(margin)
                info = self._fill()
                if info not in WORKSPACE_ERRORS:
                    break
        if info != 0:
            self.release()
        else:
            self.pc.setReusePreconditioner(True)  # whatever becomes of the matrix
        if info == 0 and not self.keep:
            # PETSc would keep the matrix in memory, although only its factor is still needed.
            nothing = PETSc.Mat().createAIJ(
                self.matrix.getSizes(), nnz=0, comm=self.matrix.getComm()
            )
            nothing.assemble()
            self.pc.setOperators(nothing)
            nothing.destroy()
        if not self.keep:
            self.matrix.destroy()
        return info == 0

    def _set_up(self, margin: int) -> None:
        self.pc = pc = PETSc.PC().create(self.matrix.getComm())
        pc.setOperators(self.matrix)
        pc.setType("cholesky" if self.symmetric else "lu")
        pc.setFactorSolverType("mumps")
        compat.set_precision(pc, self.single)
        pc.setFactorSetUpSolverType()
        factor = pc.getFactorMatrix()
        for number, value in ({14: margin} | self.icntl).items():
            factor.setMumpsIcntl(number, value)
        for number, real in self.cntl.items():
            factor.setMumpsCntl(number, real)

    def _fill(self) -> int:
        """Factorise the matrix as it is: MUMPS's error code, or 0."""
        self.pc.setReusePreconditioner(False)
        factor = self.pc.getFactorMatrix()
        try:
            self.pc.setUp()
        except PETSc.Error:
            return factor.getMumpsInfog(1) or -1
        return min(factor.getMumpsInfog(1), 0)

    @property
    def negative(self) -> int:
        """Number of negative pivots of L D L^T."""
        return self.pc.getFactorMatrix().getMumpsInfog(12)

    @property
    def worth(self) -> float:
        """Krylov iterations that take as long as this factorisation did, by the counts of both."""
        factor = self.pc.getFactorMatrix()
        entries = factor.getMumpsInfog(9)
        # MUMPS gives large numbers as minus their value in millions.
        entries = -1e6 * entries if entries < 0 else entries
        return factor.getMumpsRinfog(3) / (FLOPS_PER_ENTRY_READ * max(entries, 1.0))

    def release(self) -> None:
        """Delete the factor.  The matrix stays."""
        if self.pc is not None:
            self.pc.destroy()
            self.pc = None

    destroy = release


class WholeFactor:
    """L D L^T of the whole tangent, which tells its inertia unless in single precision.

    It is L U where the tangent is not symmetric; its pivots tell nothing of the eigenvalues.

    Parameters
    ----------
    problem
        The problem.
    single
        Single precision, if this PETSc can.
    """

    needs_matrix: ClassVar[bool] = True
    """Whether `make` takes the tangent as an assembled matrix."""

    def __init__(self, problem: Problem, single: bool = False) -> None:
        self.problem = problem
        self.single = single
        self._keep = problem.unknowns <= MOST_UNKNOWNS_KEPT
        self._factor: Mumps | Unpivoted | None = None
        self._kinds: dict[type, Mumps | Unpivoted] = {}
        self._light = is_possible(problem) and not single
        self._scale: np.ndarray | None = None
        self._petsc = PetscObjects(problem.comm)

    def make(self, tangent: Any) -> bool:
        """Factorise an assembled tangent and use it up, unless `Tangent` keeps it.  Collective.

        False if MUMPS fails.
        """
        self._scale = self._scaling(tangent)
        if self._scale is not None:
            scale = tangent.createVecLeft()
            scale.array[:] = self._scale
            tangent.diagonalScale(scale, scale)
            scale.destroy()
        for kind in (Unpivoted, Mumps) if self._light else (Mumps,):
            self._factor = self._of_kind(kind, tangent)
            if self._factor.make():
                return True
        return False

    def _of_kind(self, kind: type, tangent: Any) -> Mumps | Unpivoted:
        """A factor that the tangent's pattern was analysed for, if it is there, else a new one."""
        found = self._kinds.get(kind)
        if found and found.matrix == tangent:
            return found
        if found:
            found.release()
        problem = self.problem
        if kind is Unpivoted:
            made: Mumps | Unpivoted = Unpivoted(problem, tangent)
        else:
            order = ordering(problem.unknowns, problem.scene.kinematics.dim)
            # 24: null pivots are detected, which makes the inertia right
            icntl = {24: 1, 7: order}
            symmetric = problem.forms.is_symmetric
            made = Mumps(tangent, icntl, {}, self.single, self._keep, symmetric)
            self._petsc.keep("factor", made)
        self._kinds[kind] = made
        return made

    @property
    def is_light(self) -> bool:
        """Whether the factor is one of a small matrix, which is soon made anew."""
        return isinstance(self._factor, Unpivoted)

    def _scaling(self, tangent: Any) -> np.ndarray | None:
        """Scale of each free unknown (owned) that makes the largest entries of rows comparable.

        Rows and columns are multiplied by it, which leaves the inertia as it is.  It is None unless
        there is a field whose forces may be many times those of the motion.
        """
        groups = self.problem.roles.by_reactions()
        if not groups:
            return None
        offsets, _, values = tangent.getValuesCSR()
        largest = np.ones(len(offsets) - 1)
        filled = np.flatnonzero(np.diff(offsets))
        largest[filled] = np.maximum.reduceat(np.abs(values), offsets[filled])
        scale = np.ones(len(largest))
        for rows in groups:
            sizes = largest[rows]
            scale[rows] = 1 / np.where((sizes > 0) & np.isfinite(sizes), sizes, 1.0)
        return scale

    @property
    def excess(self) -> int | None:
        """Negative pivots beyond those of a stable state; None of an L U."""
        assert self._factor
        if not self._factor.symmetric:
            return None
        return self._factor.negative - self.problem.roles.expected_negative_pivots

    @property
    def worth(self) -> float:
        """Krylov iterations that take as long as a factorisation."""
        assert self._factor
        return self._factor.worth

    @property
    def on_arrays(self) -> Callable[[np.ndarray], np.ndarray] | None:
        """What solves for an array on one rank, without vectors of PETSc; None if nothing does."""
        if isinstance(self._factor, Unpivoted) and self._scale is None:
            return self._factor.solved
        return None

    def apply(self, _: Any, x: Any, y: Any) -> None:
        """What PETSc calls to precondition."""
        assert self._factor
        self._scaled(self._factor.pc.apply, x, y)

    def apply_transposed(self, _: Any, x: Any, y: Any) -> None:
        """The same for the transpose of the tangent."""
        assert self._factor
        pc = self._factor.pc
        self._scaled(pc.apply if self._factor.symmetric else pc.applyTranspose, x, y)

    def _scaled(self, action: Callable[[Any, Any], None], x: Any, y: Any) -> None:
        """The action of the factor, whose rows and columns are scaled."""
        if self._scale is None:
            action(x, y)
            return
        scaled = x.duplicate()
        scaled.array[:] = self._scale * x.array_r
        action(scaled, y)
        scaled.destroy()
        y.array[:] *= self._scale

    def make_room(self) -> None:
        """Delete a large factor before the matrix of the next one is assembled."""
        if not self._keep:
            self.release()

    def release(self) -> None:
        for factor in self._kinds.values():
            factor.release()
        self._factor, self._kinds = None, {}


def ordering(unknowns: int, dim: int) -> int:
    """MUMPS's number of an ordering."""
    return PORD if unknowns >= PORD_FROM_UNKNOWNS[dim] else AMF
