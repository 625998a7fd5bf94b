"""A kept factor that is split into blocks.

`SplitFactor` is for large problems in space.  The tangent's blocks are

        | A   B^T  G^T |          u, displacement
    T = | B   -C    0  |          p, pressure, discontinuous
        | G    0   -K  |          phi, potential

In incompressible regions C = 0.  There the preconditioner uses the compressibility M/(k mu), with
k = BULK_OVER_SHEAR_MODULUS, so that p can be eliminated cell by cell.  Then it solves for phi and u
in turn, each with a factor of its own: S = A + B^T C^-1 B for u, K for phi.  This neglects the
coupling G^T K^-1 G in S and the share 1/k of the pressure.  GMRES on the true tangent corrects both
in a few iterations.  The factor of S has a third of the entries of the whole factor and needs no
pivoting.  It can also be compressed: its blocks far from the diagonal have low rank (Amestoy et
al., ACM Trans. Math. Softw. 45 (2019) 2), and if PETSc can, it is kept in single precision.
Internal fields belong to the block of u.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
import ufl

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.kernels import measure
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.solvers.factors import Mumps, ordering
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import PETSc, dolfinx
from dea_fenicsx.support.free_memory import give_memory_back
from dea_fenicsx.support.later import Later
from dea_fenicsx.support.petsc_objects import PetscObjects

sparse = Later("scipy.sparse")

BULK_OVER_SHEAR_MODULUS = 50.0
"""Bulk modulus of incompressible regions in the preconditioner, in units of the shear modulus.

A much larger one needs more digits than single precision has.  See "Measured constants" in
docs/developers/solver.md.
"""

PRECISE_BULK_OVER_SHEAR_MODULUS = 1e5
"""The same for a precise factor in double precision, with which the pressure errs by 1e-5.

Then a solve to eleven digits takes two Krylov iterations, as with a factor of the whole tangent.
"""

LOW_RANK_TOLERANCE = 1e-7
"""Error of the low-rank blocks of a split factor, relative to the norm of the matrix.

On two ranks a larger error costs many Krylov iterations.  See "Measured constants" in
docs/developers/solver.md.
"""

LOW_RANK_FROM_UNKNOWNS = 60_000
"""Number of displacement unknowns from which low-rank blocks are used.

For fewer unknowns the compression takes a third more time than it saves.
"""

U, P, PHI = BLOCKS = (Role.MOTION, Role.MULTIPLIER, Role.POTENTIAL)
"""The blocks of the tangent."""

SPLIT_ROLES = frozenset({*BLOCKS, Role.INTERNAL})
"""Roles of the fields that a split factor can take."""


class SplitFactor:
    """Factors of the displacement's and the potential's block, with the pressure condensed.

    Parameters
    ----------
    problem
        A problem with discontinuous pressure.
    precise
        Whether a factor in double precision and a nearly exact pressure are worth twice the memory,
        because very many solves follow.
    """

    needs_matrix: ClassVar[bool] = True
    """Whether `make` takes the tangent as an assembled matrix."""

    on_arrays = None  # it works on vectors of PETSc

    def __init__(self, problem: Problem, precise: bool = False) -> None:
        self.problem, self.precise = problem, precise
        self._factors: dict[Role, Mumps] = {}
        self._blocks: dict[str, Any] = {}
        self._offset = problem.comm.exscan(len(problem.free)) or 0
        self._on = {role: problem.roles.free(role) for role in BLOCKS if problem.space.of(role)}
        inner = problem.roles.free(Role.INTERNAL)
        self._on[U] = np.sort(np.concatenate([self._on[U], inner]).astype(np.int64))
        self._negative_in = {
            role: _negative_unknowns(problem, role) for role in (U, PHI, Role.INTERNAL)
        }
        self._petsc = PetscObjects(problem.comm)
        self._rows = {
            role: self._petsc.keep(f"rows of {role}", self._index_set(on))
            for role, on in self._on.items()
        }
        self._vectors: dict[Role, tuple[Any, Any]] = {}
        bulk = PRECISE_BULK_OVER_SHEAR_MODULUS if precise else BULK_OVER_SHEAR_MODULUS
        self._cells, self._softness = _pressure_cells(problem, bulk)

    def make(self, tangent: Any) -> bool:
        """Factorise the blocks of an assembled tangent and use it up; False if MUMPS fails.

        Collective.
        """
        self.release()
        blocks = self._blocks
        blocks["1/C"] = self._inverse_of_compressibility(tangent)
        blocks["B"] = self._block(tangent, P, U)
        from_p = self._block(tangent, U, P)
        stiffness = _condensed(self._block(tangent, U, U), from_p, blocks["1/C"], blocks["B"])
        from_p.destroy()
        dropped = 0.0 if self.precise else LOW_RANK_TOLERANCE
        self._factors[U] = _definite(stiffness, dropped, single=not self.precise)
        if PHI in self._rows:
            blocks["G"] = self._block(tangent, PHI, U)
            self._factors[PHI] = Mumps(self._block(tangent, PHI, PHI), {}, {})
        for name, factor in self._factors.items():
            self._vectors[name] = factor.matrix.createVecs()
        self._vectors[P] = blocks["1/C"].createVecs()
        tangent.destroy()  # The factors need the memory.
        give_memory_back()
        for number, thing in enumerate(self._made()):
            self._petsc.keep(f"part {number}", thing)
        return all([factor.make() for factor in self._factors.values()])

    @property
    def proves_stable(self) -> bool:
        """Whether the factor that was made proves that the state is stable; see `excess`."""
        if not self.precise:  # the pivots of single precision may have wrong signs
            return False
        expected = self._negative_in[U] + self._negative_in[Role.INTERNAL]
        return self._factors[U].negative == expected

    def excess(self, assemble: Callable[[], Any]) -> int | None:
        """Negative eigenvalues beyond those of a stable state, for a compressible material.

        None if MUMPS fails.  `assemble` gives the tangent as a matrix, which is destroyed before
        its block is factorised; so it is asked again for another block, which is rarely needed.

        If the compressible device is stable, the incompressible one is stable as well, because
        incompressibility only prevents motions.  So the result 0 proves stability, and any other
        number proves nothing.

        By Sylvester's law each condensed p has one negative eigenvalue.  Of the other unknowns we
        first factorise the block of u alone, with phi kept fixed, which costs half.  A potential
        that follows the motion adds the positive term G^T K^-1 G to this block, so it only makes
        the device stiffer.  If the block of u has negative eigenvalues, we factorise u and phi
        together.
        """
        found: int | None = None
        for names in ((U,), (U, PHI)):
            if not set(names) <= set(self._rows):
                break
            found = self._negative(assemble(), names)
            if found == 0:
                break
        return found

    def _negative(self, tangent: Any, names: tuple[Role, ...]) -> int | None:
        """Negative eigenvalues of some blocks with p condensed, without those of the phi block."""
        rows = self._index_set(np.sort(np.concatenate([self._on[name] for name in names])))
        from_p = tangent.createSubMatrix(rows, self._rows[P])
        to_p = tangent.createSubMatrix(self._rows[P], rows)
        inverse = self._inverse_of_compressibility(tangent)
        block = tangent.createSubMatrix(rows, rows)
        tangent.destroy()
        matrix = _condensed(block, from_p, inverse, to_p)
        for thing in (rows, from_p, to_p, inverse):
            thing.destroy()
        give_memory_back()
        # A body that is held at single points has eigenvalues far smaller than those of its cells.
        # The low-rank blocks must be exact enough to keep their signs.
        factor = _definite(matrix, 0.1 * LOW_RANK_TOLERANCE, single=False, counted=True)
        made = factor.make()
        expected = sum(self._negative_in[role] for role in (*names, Role.INTERNAL))
        found = factor.negative - expected if made else None
        factor.release()
        return found

    @property
    def worth(self) -> float:
        """Krylov iterations that take as long as a factorisation."""
        return self._factors[U].worth

    def _index_set(self, on: np.ndarray) -> Any:
        return PETSc.IS().createGeneral(
            (self._offset + on).astype(np.int32), comm=self.problem.comm
        )

    def _block(self, tangent: Any, row: Role, column: Role) -> Any:
        return tangent.createSubMatrix(self._rows[row], self._rows[column])

    def _inverse_of_compressibility(self, tangent: Any) -> Any:
        """1/C, block-diagonal over the cells, from the tangent's block -C."""
        pp = self._block(tangent, P, P)
        first, last = pp.getOwnershipRange()
        offsets, columns, values = pp.getValuesCSR()
        own = sparse.csr_matrix((values, columns - first, offsets), shape=2 * (last - first,))
        n = self._cells.shape[1]
        row, column = _entries(self._cells)
        inverse = np.linalg.inv(self._softness - _blocks(own, self._cells))
        order = np.lexsort((column, row))
        starts = n * np.arange(last - first + 1)
        entries = (column[order] + first, inverse.ravel()[order])
        made = PETSc.Mat().createAIJ(
            pp.sizes, comm=pp.getComm(),
            csr=(starts.astype(np.int32), entries[0].astype(np.int32), entries[1]),
        )  # fmt: skip
        pp.destroy()
        return made

    def apply(self, _: Any, x: Any, y: Any) -> None:
        """What PETSc calls to precondition: potential, displacement, potential again, pressure."""
        on, blocks = self._on, self._blocks
        b, out = x.array_r, y.array
        (u, ru), (p, rp) = self._vectors[U], self._vectors[P]
        rp.array[:] = b[on[P]]
        blocks["1/C"].mult(rp, p)
        blocks["B"].multTranspose(p, ru)
        ru.array[:] += b[on[U]]
        if PHI in on:
            phi, rphi = self._vectors[PHI]
            rphi.array[:] = b[on[PHI]]
            self._factors[PHI].pc.apply(rphi, phi)
            blocks["G"].multTranspose(phi, u)
            ru.axpy(-1.0, u)
        self._factors[U].pc.apply(ru, u)
        out[on[U]] = u.array_r
        blocks["B"].mult(u, p)
        p.axpy(-1.0, rp)
        blocks["1/C"].mult(p, rp)
        out[on[P]] = rp.array_r
        if PHI in on:
            blocks["G"].mult(u, phi)
            rphi.axpy(-1.0, phi)
            self._factors[PHI].pc.apply(rphi, phi)
            out[on[PHI]] = phi.array_r

    def apply_transposed(self, context: Any, x: Any, y: Any) -> None:
        """The same, for it is made only of symmetric tangents."""
        self.apply(context, x, y)

    def make_room(self) -> None:
        """Delete the factors before the matrix of the next ones is assembled."""
        self.release()
        give_memory_back()

    def release(self) -> None:
        for thing in self._made():
            thing.destroy()
        self._factors, self._blocks, self._vectors = {}, {}, {}


    def _made(self) -> list[Any]:
        """The factors, and the matrices and vectors that they are applied with."""
        vectors = [vector for pair in self._vectors.values() for vector in pair]
        return [*self._factors.values(), *vectors, *self._blocks.values()]


def _negative_unknowns(problem: Problem, role: Role) -> int:
    """Negative eigenvalues of a stable state's tangent that belong to a role's fields."""
    groups = problem.roles.groups.items()
    return sum(
        problem.roles.counts[name] for name, fields in groups
        if fields[0].role is role and fields[0].negative
    )  # fmt: skip


def _condensed(block: Any, from_p: Any, inverse: Any, to_p: Any) -> Any:
    """A block of the tangent with B^T C^-1 B added to it."""
    half = inverse.matMult(to_p)
    penalty = from_p.matMult(half)
    # A discontinuous p couples unknowns of one cell only, so the pattern of the block suffices.
    block.axpy(1.0, penalty, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
    half.destroy()
    penalty.destroy()
    return block


def _definite(matrix: Any, dropped: float, single: bool, counted: bool = False) -> Mumps:
    """A factorisation of the block of u with p condensed, with low-rank blocks if it is large.

    If its pivots are to be `counted` and nothing is to be solved, it keeps no entries.
    """
    size = matrix.getSize()[0]
    # ICNTL(31): the factor is thrown away while it is made
    icntl = {7: ordering(size, 3)} | ({31: 1} if counted else {})
    if size < LOW_RANK_FROM_UNKNOWNS or not dropped:
        return Mumps(matrix, icntl, {}, single)
    half = _upper_half(matrix)
    # ICNTL(35): low-rank blocks in factorisation and solve; ICNTL(36): blocks are compressed
    # before they are updated; ICNTL(37): contribution blocks are compressed as well
    return Mumps(half, icntl | {35: 2, 36: 1, 37: 1}, {7: dropped}, single)


def _upper_half(matrix: Any) -> Any:
    """The upper triangle of a symmetric matrix, which is used up: MUMPS needs no more of it."""
    matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    half = matrix.convert("sbaij", PETSc.Mat())
    matrix.destroy()
    give_memory_back()
    return half


def _pressure_cells(problem: Problem, bulk: float) -> tuple[np.ndarray, np.ndarray]:
    """The pressure rows of each owned cell, and the compressibility of the preconditioner there.

    The compressibility is the integral of p q/(bulk mu) over each cell of incompressible material,
    with a bulk modulus in units of the shear modulus mu, and 0 elsewhere.
    """
    scene, part = problem.scene, problem.pressure
    space = part.space
    soft = dolfinx.fem.Function(dolfinx.fem.functionspace(problem.mesh, ("DG", 0)))
    for name, material in problem.parameters.materials.items():
        if material.bulk_modulus is None:
            modulus = material.elastic.shear_modulus() / problem.scales.stress
            soft.x.array[scene.device.cells_of(name)] = 1 / (bulk * modulus)
    count = scene.device.owned_cells()
    dx = measure(scene.device, [np.arange(count)], scene.elements.quadrature_degree)
    weight = scene.kinematics.weight(ufl.SpatialCoordinate(problem.mesh))
    p, q = ufl.TrialFunction(space), ufl.TestFunction(space)
    mass = dolfinx.fem.assemble_matrix(compat.compile_form(soft * p * q * weight * dx(0)))
    dofs = space.dofmap.list[:count]
    rows = np.searchsorted(problem.free[problem.roles.free(P)], part.dofs[dofs])
    return rows, _blocks(mass.to_scipy(), dofs)


def _blocks(matrix: Any, rows: np.ndarray) -> np.ndarray:
    """Blocks of a sparse matrix on the diagonal, shape (blocks, rows, rows)."""
    count, n = rows.shape
    if not count:
        return np.empty((0, n, n))  # scipy's indexing with empty lists gives one entry
    return np.asarray(matrix[_entries(rows)]).reshape(count, n, n)


def _entries(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Row and column of each entry of blocks, whose rows are given; shape (blocks, rows)."""
    n = rows.shape[1]
    return np.repeat(rows, n, axis=1).ravel(), np.tile(rows, (1, n)).ravel()
