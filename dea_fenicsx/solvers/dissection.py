"""How large the factor of a tangent will be, and how many operations it takes, from the mesh alone.

The unknowns of a mesh are eliminated by nested dissection: a separator, which is what both halves
of the cells share, comes after all other unknowns of the two halves, and each half is cut again
[George 1973, SIAM Journal on Numerical Analysis 10, 345-363].  If a separator has s unknowns, and
if b unknowns of the separators before it bound the same cells, its elimination in L D L^T gives

    s (s + 1) / 2 + s b entries,    s^3 / 3 + s^2 b + s b^2 operations.

MUMPS orders the unknowns by other methods, and needs a little more of both, see `MORE_ENTRIES`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from dea_fenicsx.model.fields import Field, Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.support import compat
from dea_fenicsx.support.agreement import together
from dea_fenicsx.support.later import Later

csgraph = Later("scipy.sparse.csgraph")
sparse = Later("scipy.sparse")

CELLS_OF_LEAF = 2
"""Cells that are not cut any further."""

ENDS = 3
"""Number of ends of a mesh from which cells are counted."""

MORE_ENTRIES, MORE_OPERATIONS = 1.15, 1.2
"""Entries and operations of MUMPS over those of nested dissection, the means of eight devices."""

CELLS_WITH_ONE_HALF = 2_000
"""Pieces of at most this number of cells stand for their neighbours: only one half is cut on.

It holds for meshes of at least `CELLS_OF_LARGE_MESH` cells.
"""

CELLS_OF_LARGE_MESH = 20_000
"""Number of cells from which small pieces of a mesh stand for their neighbours."""


@dataclass(frozen=True)
class FactorSize:
    """The size of a factor L D L^T.

    Attributes
    ----------
    unknowns
        Rows of the matrix.
    entries
        Entries of L.
    operations
        Floating-point operations of the factorisation.
    """

    unknowns: int
    entries: float
    operations: float


@dataclass(frozen=True)
class _Piece:
    """Some cells: the groups of unknowns on them, which of these bound it, and what it stands for.

    Attributes
    ----------
    cells : numbers of the cells
    groups : numbers of the groups of unknowns on them
    outer : for each group, whether it belongs to a separator before
    copies : number of pieces for which this one stands
    """

    cells: np.ndarray
    groups: np.ndarray
    outer: np.ndarray
    copies: float


class Dissection:
    """Nested dissection of the unknowns on the cells of a mesh.

    Parameters
    ----------
    cells
        Groups of unknowns of each cell, shape (cells, groups of a cell).
    sizes
        Number of unknowns of each group.
    places
        Midpoint of each cell, shape (cells, dimension).
    """

    def __init__(self, cells: np.ndarray, sizes: np.ndarray, places: np.ndarray) -> None:
        self.cells, self.sizes = cells, sizes
        self.places = np.column_stack([places, steps_from_ends(cells, len(sizes))])
        self._mark = np.zeros(len(sizes), dtype=bool)

    def size(self) -> FactorSize:
        """The size of the factor."""
        entries = operations = 0.0
        groups = np.unique(self.cells)
        stack = [_Piece(np.arange(len(self.cells)), groups, np.zeros(len(groups), bool), 1.0)]
        few = CELLS_WITH_ONE_HALF if len(self.cells) >= CELLS_OF_LARGE_MESH else 0
        while stack:
            piece = stack.pop()
            halves, separator = self._halves(piece)
            s = float(self.sizes[separator].sum())
            b = float(self.sizes[piece.groups[piece.outer]].sum())
            entries += piece.copies * (s * (s + 1) / 2 + s * b)
            operations += piece.copies * (s**3 / 3 + s * s * b + s * b * b)
            if halves and len(piece.cells) <= few:
                half = halves[0]
                copies = half.copies * len(piece.cells) / len(half.cells)
                halves = [_Piece(half.cells, half.groups, half.outer, copies)]
            stack.extend(halves)
        return FactorSize(
            int(self.sizes[groups].sum()), MORE_ENTRIES * entries, MORE_OPERATIONS * operations
        )

    def _halves(self, piece: _Piece) -> tuple[list[_Piece], np.ndarray]:
        """The two halves of a piece, and the groups that are eliminated after both.

        The cut is normal to the axis that gives the smallest separator.  A leaf has no halves, and
        all its own groups are eliminated at once.
        """
        best = None
        if len(piece.cells) > CELLS_OF_LEAF:
            for axis in range(self.places.shape[1]):
                x = self.places[piece.cells, axis]
                low = x <= np.median(x)
                if low.all():
                    low = x < np.median(x)
                if not low.any():
                    continue
                sides = [self._touched(piece, low), self._touched(piece, ~low)]
                shared = sides[0] & sides[1] & ~piece.outer
                larger = max(low.mean(), 1 - low.mean())
                cost = float(self.sizes[piece.groups[shared]].sum()) * larger
                if best is None or cost < best[0]:
                    best = cost, low, sides, shared
        if best is None:
            return [], piece.groups[~piece.outer]
        _, low, sides, shared = best
        outer = piece.outer | shared
        halves = [
            _Piece(piece.cells[mine], piece.groups[side], outer[side], piece.copies)
            for mine, side in zip((low, ~low), sides, strict=True)
        ]
        return halves, piece.groups[shared]

    def _touched(self, piece: _Piece, mine: np.ndarray) -> np.ndarray:
        """For each group of a piece, whether some of its cells have it."""
        self._mark[self.cells[piece.cells[mine]]] = True
        found = self._mark[piece.groups]
        self._mark[piece.groups] = False
        return np.asarray(found)


def steps_from_ends(cells: np.ndarray, groups: int) -> np.ndarray:
    """How many cells lie between each cell and some ends of the mesh, shape (cells, `ENDS`).

    Each end is the cell farthest from those before it.  Cuts at equal distances follow a device
    that is wound or bent, which planes do not.
    """
    rows = np.repeat(np.arange(len(cells)), cells.shape[1])
    table = sparse.csr_matrix((np.ones(cells.size), (rows, cells.ravel())), (len(cells), groups))
    neighbours = table @ table.T
    end, nearest, found = 0, np.full(len(cells), np.inf), []
    for k in range(ENDS + 1):
        steps = csgraph.shortest_path(neighbours, method="D", unweighted=True, indices=end)
        steps[np.isinf(steps)] = len(cells)  # parts that do not touch
        nearest = steps if k < 2 else np.minimum(nearest, steps)
        end = int(np.argmax(nearest))
        found.append(steps)
    return np.column_stack(found[1:])  # the first cell is no end


type _Parts = tuple[np.ndarray, np.ndarray, np.ndarray]
"""What `Dissection` takes."""


def dissection_of(problem: Problem, fields: Sequence[Field]) -> Dissection | None:
    """The dissection of the free unknowns of some fields: on rank 0, None elsewhere.  Collective.

    The few numbers for the whole device are left out: they bound all cells.
    """
    parts = _gathered(problem, fields)
    return Dissection(*parts) if parts else None


def size_of_factor(problem: Problem, fields: Sequence[Field]) -> FactorSize:
    """The size of the factor of the block of some fields in the tangent.  Collective."""
    parts = _gathered(problem, fields)

    def cut() -> FactorSize | None:
        return Dissection(*parts).size() if parts else None

    size = together(problem.comm, cut, "the count of a factor's entries")
    return cast(FactorSize, problem.comm.bcast(size, root=0))


def _gathered(problem: Problem, fields: Sequence[Field]) -> _Parts | None:
    """The cells of all ranks with their groups of unknowns: on rank 0, None elsewhere.

    The cells are in the order of their places, so that they are cut alike on any number of ranks.
    """
    mesh, tables, sizes = problem.mesh, [], []
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    free = np.zeros(problem.size)
    free[problem.free] = 1
    offset = 0
    for field in (one for one in fields if one.role is not Role.GLOBAL):
        parts = list(problem.space.parts[field.name].values())
        groups, mine = parts[0].space.dofmap.index_map, parts[0].space.dofmap.list[:owned]
        table = groups.local_to_global(mine.ravel()).reshape(mine.shape)
        tables.append(table + offset)
        sizes.append(sum(free[part.dofs[: groups.size_local]] for part in parts))
        offset += groups.size_global
    nodes = mesh.geometry.x[compat.geometry_dofmap(mesh)[:owned]]
    places = nodes.mean(axis=1)[:, : mesh.geometry.dim]
    every = problem.comm.gather((np.hstack(tables), sizes, places), root=0)
    if every is None:
        return None
    cells = np.vstack([part[0] for part in every])
    places = np.vstack([part[2] for part in every])
    order = np.lexsort(np.round(places / max(float(np.ptp(places)), 1e-300), 9).T)
    counts = [part[1][k] for k in range(len(sizes)) for part in every]
    return cells[order], np.concatenate(counts), places[order]
