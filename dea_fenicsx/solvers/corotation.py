"""A kept factor that is rotated with the material.

A factor of the tangent in one state is the preconditioner in later states.  If the material has
rotated by R since then, the old factor mistakes bending for axial stretching, which in a slender
part is a hundred times stiffer.  A rotation of a few degrees already makes the factor useless.  But
in an isotropic material a rotation of all the material only rotates the tangent, K = R K_old R^T
(objectivity; this is exact under dead loads).  So we rotate the forces back at each node, apply the
old factor, and rotate the displacements forward.  R is the rotation of F at the node.  Pressure and
potential are scalars and are not rotated.

Only the preconditioner is changed.  The equations and their solution stay the same.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import basix
import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import PETSc, dolfinx
from dea_fenicsx.support.petsc_objects import PetscObjects

SMALLEST_TURN = 2e-3
"""Rotations that change each entry of R by less than this (about an angle in rad) are neglected."""


Array = Callable[[np.ndarray], np.ndarray]
"""Gives an array for an array."""


class Factor(Protocol):
    """A preconditioner: it reads x and writes y, both PETSc vectors of the free unknowns.

    `on_arrays` does the same for arrays on one rank; None where the vectors are needed.
    """

    @property
    def on_arrays(self) -> Array | None: ...
    def apply(self, _: Any, x: Any, y: Any) -> None: ...
    def apply_transposed(self, _: Any, x: Any, y: Any) -> None: ...


class Corotation:
    """Rotation of the material at the nodes, since the last factorisation.

    Only nodes whose displacement is free in every direction are rotated.

    Parameters
    ----------
    problem
        The problem.

    Attributes
    ----------
    factor
        The preconditioner in the state of the last factorisation, or None.
    weights
        What the rows of the operator are multiplied by, as of `Tangent`.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.weights: np.ndarray | None = None
        self.factor: Factor | None = None
        parts = problem.displacement
        self._dim = problem.mesh.topology.dim
        self._turn: np.ndarray | None = None
        self._petsc = PetscObjects(problem.comm)
        self._back: Any = None
        # A helical cell has three displacement components in a mesh of two dimensions.
        self._possible = len(parts) == self._dim
        if not self._possible:
            return
        space = parts[0].space
        u = problem.space.symbolic(Role.MOTION, problem.w)
        cell = getattr(basix.CellType, problem.mesh.topology.cell_name())
        middle = basix.geometry(cell).mean(axis=0, keepdims=True)
        self._gradient = compat.expression(ufl.grad(u), middle)
        self._cells = np.arange(problem.scene.device.owned_cells(), dtype=np.int32)
        row = np.full(problem.size, -1)
        row[problem.free] = np.arange(len(problem.free))
        rows = np.stack([row[part.dofs] for part in parts], axis=1)
        self._nodes = np.flatnonzero(np.all(rows >= 0, axis=1))
        self._rows = rows[self._nodes]
        around = space.dofmap.list[: len(self._cells)]
        self._sum = self._petsc.keep("sum", incidence(around, len(parts[0].dofs)))
        ends = self._sum.createVecs()
        self._of_cells, self._of_nodes = (
            self._petsc.keep(name, v) for name, v in zip(("cells", "nodes"), ends, strict=True)
        )
        self._shared = dolfinx.fem.Function(space)

    def start(self, factor: Factor | None) -> None:
        """Take the factor of the tangent at the present state, or None.  Collective."""
        self.factor = factor
        self._turn = None
        if self._possible:
            self._at_factor = self._rotations()

    def update(self) -> None:
        """Turn the factor to the present state.  Collective."""
        if not self._possible:
            return
        turn, most = self._between(self._at_factor, self._rotations())
        enough = self.problem.comm.allreduce(most, op=MPI.MAX) > SMALLEST_TURN
        self._turn = turn if enough else None

    def apply(self, context: Any, x: Any, y: Any) -> None:
        """Apply the preconditioner; PETSc calls this."""
        assert self.factor
        if self.weights is None:
            self._turned(self.factor.apply, x, y)
            return
        plain = x.duplicate()
        plain.array[:] = x.array_r / self.weights
        self._turned(self.factor.apply, plain, y)
        plain.destroy()

    def on_arrays(self, x: Any, y: Any) -> Array:
        """What `apply` does, for arrays on one rank; `x` and `y` are vectors that it may use."""
        solve, weights = self._solve_on_arrays(x, y), self.weights

        def precondition(values: np.ndarray) -> np.ndarray:
            if weights is not None:
                values = values / weights
            if self._turn is None:
                return solve(values)
            turned = values.copy()
            turned[self._rows] = self._rotated(values[self._rows], backwards=True)
            found = solve(turned)
            found[self._rows] = self._rotated(found[self._rows])
            return found

        return precondition

    def _solve_on_arrays(self, x: Any, y: Any) -> Array:
        """What solves with the factor itself for an array."""
        factor = self.factor
        assert factor
        if (solve := factor.on_arrays) is not None:
            return solve

        def solve_vector(values: np.ndarray) -> np.ndarray:
            x.array[:] = values
            factor.apply(None, x, y)
            return np.array(y.array_r)

        return solve_vector

    def applyTranspose(self, _: Any, x: Any, y: Any) -> None:
        """What PETSc calls to precondition the transpose of the tangent."""
        assert self.factor
        self._turned(self.factor.apply_transposed, x, y)

    def _turned(self, action: Callable[[Any, Any, Any], None], x: Any, y: Any) -> None:
        """The action of a factor, turned by the rotation since it was made."""
        if self._turn is None:
            action(None, x, y)
            return
        if self._back is None:
            self._back = self._petsc.keep("back", x.duplicate())
        values = self._back.array
        values[:] = x.array_r
        values[self._rows] = self._rotated(values[self._rows], backwards=True)
        action(None, self._back, y)
        out = y.array
        out[self._rows] = self._rotated(out[self._rows])

    def _between(self, before: np.ndarray, now: np.ndarray) -> tuple[np.ndarray, float]:
        """The rotation from one to the other at each node, and the most that changes in a matrix.

        In the plane a rotation is a complex number of size 1.
        """
        if self._dim == 2:
            turn = now * before.conj()
            parts = np.abs((turn - 1.0).view(float))
            return turn, float(np.max(parts, initial=0.0))
        turn = np.matmul(now, np.swapaxes(before, 1, 2))
        return turn, float(np.max(np.abs(turn - np.eye(self._dim)), initial=0.0))

    def _rotated(self, values: np.ndarray, backwards: bool = False) -> np.ndarray:
        """Vectors at the nodes, shape (nodes, dim), turned by the present rotation, or back."""
        assert self._turn is not None
        if self._dim == 2:
            turn = self._turn.conj() if backwards else self._turn
            return (values.view(complex)[:, 0] * turn).view(float).reshape(-1, 2)
        return np.einsum("nji,nj->ni" if backwards else "nij,nj->ni", self._turn, values)

    def _rotations(self) -> np.ndarray:
        """R of the cells' mean F around each node, shape (nodes, dim, dim).  Collective.

        In the plane it is cos + i sin, shape (nodes,).
        """
        dim = self._dim
        F = self._gradient(self.problem.mesh, self._cells).reshape(-1, dim, dim) + np.eye(dim)
        # in the plane the first column, cos and sin
        turns = polar(F).reshape(-1, dim * dim)[:, :: 2 if dim == 2 else 1]
        sums = np.empty((self._sum.size[0], turns.shape[1]))
        for k in range(turns.shape[1]):
            self._of_cells.array[:] = turns[:, k]
            self._sum.mult(self._of_cells, self._of_nodes)
            sums[:, k] = self._of_nodes.array_r
        if self.problem.comm.size > 1:
            for column in sums.T:
                self._shared.x.array[:] = column
                self._shared.x.scatter_reverse(dolfinx.la.InsertMode.add)
                column[:] = self._shared.x.array
        if dim == 2:
            return _unit(sums[self._nodes])
        found = polar(sums[self._nodes].reshape(-1, dim, dim))
        # The mean F of cells that are folded against one another may have no rotation.
        found[~np.isfinite(found).all(axis=(1, 2))] = np.eye(dim)
        return found


def _unit(sums: np.ndarray) -> np.ndarray:
    """Sums of rotations in the plane, each (cos, sin), as rotations cos + i sin."""
    turns = np.ascontiguousarray(sums).view(complex)[:, 0]
    sizes = np.abs(turns)
    if len(sizes) and sizes.min() > 0 and sizes.max() < np.inf:  # so there is no NaN, either
        return turns / sizes
    # The mean F of cells that are folded against one another may have no rotation.
    defined = np.isfinite(sizes) & (sizes > 0)
    return np.where(defined, turns, 1.0) / np.where(defined, sizes, 1.0)


def incidence(nodes: np.ndarray, size: int) -> Any:
    """PETSc matrix of this rank alone that adds values of cells up at their nodes.

    Parameters
    ----------
    nodes
        Nodes of each cell, shape (cells, nodes of a cell).
    size
        Number of all nodes.
    """
    order = np.argsort(nodes, axis=None, kind="stable")
    columns = (order // nodes.shape[1]).astype(np.int32)
    offsets: np.ndarray = np.zeros(size + 1, dtype=np.int32)
    np.cumsum(np.bincount(nodes.ravel(), minlength=size), out=offsets[1:])
    made = PETSc.Mat().createAIJ(
        (size, len(nodes)), csr=(offsets, columns, np.ones(nodes.size)), comm=MPI.COMM_SELF
    )
    made.assemble()
    return made


def polar(F: np.ndarray) -> np.ndarray:
    """Rotation R of F = R U, shape (n, d, d), det F > 0; NaN where det F = 0.

    In the plane R = (F + cof F) / sqrt(det(F + cof F)); in space by Newton's method on R^T R = 1,
    R <- (R s + R^-T / s) / 2 with s = |det R|^(-1/d) (Higham, SIAM J. Sci. Stat. Comput. 7 (1986)
    1160, scaled by the determinant).
    """
    if F.shape[1] == 2:
        return _in_the_plane(F)
    R = F
    for _ in range(30):
        cofactor = R[:, _NEXT, _NEXT.T] * R[:, _LAST, _LAST.T]
        cofactor -= R[:, _NEXT, _LAST.T] * R[:, _LAST, _NEXT.T]
        size = np.einsum("nj,nj->n", R[:, 0], cofactor[:, 0])
        size = np.where(size == 0, np.nan, size)  # a trial state may have det F = 0
        scale = np.cbrt(np.abs(size))[:, None, None]
        new = (R / scale + cofactor * (scale / size[:, None, None])) / 2
        change = np.max(np.abs(new - R), initial=0.0)
        R = new
        if change < 1e-6:  # Newton's method is quadratic: the error is about 1e-12.
            break
    return R


_NEXT, _LAST = np.array([[1], [2], [0]]), np.array([[2], [0], [1]])
"""Of each row of a 3 x 3 matrix the next one and the one after it, cyclically."""


def _in_the_plane(F: np.ndarray) -> np.ndarray:
    """The same for 2 x 2; where det F < 0, the nearest matrix that mirrors."""
    a, b, c, d = F[:, 0, 0], F[:, 0, 1], F[:, 1, 0], F[:, 1, 1]
    determinant = a * d - b * c
    if len(F) and determinant.min() > 0:
        cosine, sine = a + d, c - b
        length = np.hypot(cosine, sine)
        R = np.empty_like(F)
        R[:, 0, 0] = R[:, 1, 1] = cosine / length
        R[:, 1, 0] = sine / length
        R[:, 0, 1] = -R[:, 1, 0]
        return R
    sign = np.sign(determinant)
    cosine, sine = a + sign * d, c - sign * b
    length = np.where(sign == 0, np.nan, np.hypot(cosine, sine))  # a trial state may have det F = 0
    R = np.empty_like(F)
    R[:, 0, 0], R[:, 1, 0] = cosine / length, sine / length
    R[:, 0, 1], R[:, 1, 1] = -sign * R[:, 1, 0], sign * R[:, 0, 0]
    return R


@dataclass
class TurnedPreconditioner:
    """The preconditioner that PETSc calls.

    It only holds a weak reference to the corotation, as the product with the tangent does to the
    tangent.
    """

    corotation: weakref.ref[Corotation]

    def apply(self, context: Any, x: Any, y: Any) -> None:
        corotation = self.corotation()
        assert corotation
        corotation.apply(context, x, y)

    def applyTranspose(self, context: Any, x: Any, y: Any) -> None:
        corotation = self.corotation()
        assert corotation
        corotation.applyTranspose(context, x, y)
