"""A device family whose cells are halved in chosen sheets, so that its mesh is graded.

A sheet is what one division of a structured mesh adds: all cells that follow one another across
opposite sides.  To halve some cells in one direction is to halve their whole sheet, and no node
hangs.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ._structured import Floats, Ints, StructuredMesh
from .base import Geometry
from .quartic import lagrange, of_order, quartic


def sheets(mesh: StructuredMesh) -> Ints:
    """Number of the sheet in which a cell is divided along an axis, shape (cells, dimension)."""
    edges, owners = [], []
    for axis in range(mesh.dimension):
        found = _edges(mesh.cells, axis)
        edges.append(found.reshape(-1, 2))
        owners.append(np.repeat(np.arange(len(found)) * mesh.dimension + axis, found.shape[1]))
    unique, which = np.unique(np.concatenate(edges), axis=0, return_inverse=True)
    return _joined(np.concatenate(owners), which.ravel(), len(mesh.cells) * mesh.dimension,
                   len(unique)).reshape(-1, mesh.dimension)  # fmt: skip


def bisected(mesh: StructuredMesh, chosen: Ints) -> StructuredMesh:
    """The mesh with the cells of some sheets halved; curved cells keep their shape.

    Parameters
    ----------
    mesh
        The mesh.
    chosen
        Numbers of sheets, as in `sheets`.
    """
    of, halves = sheets(mesh), _Halves(mesh.points)
    cells, parents, facets = mesh.cells, np.arange(len(mesh.cells)), dict(mesh.facets)
    # One sheet at a time: where two cross, all cells then find the same new nodes.
    for sheet in np.intersect1d(chosen, of).tolist():
        edges = [_edges(mesh.cells[of[:, k] == sheet], k) for k in range(mesh.dimension)]
        for axis in range(mesh.dimension):
            cells, kept = halves.split(cells, axis, of[parents, axis] == sheet)
            parents = parents[kept]
        known = np.unique(np.concatenate(edges).reshape(-1, 2), axis=0)
        for name, faces in facets.items():
            for axis in range(faces.ndim - 1):
                faces, _ = halves.split(faces, axis, _has(_edges(faces, axis), known))
            facets[name] = faces
    order = np.argsort(parents, kind="stable")
    cells, parents = cells[order], parents[order]
    regions = {n: np.flatnonzero(np.isin(parents, of)) for n, of in mesh.regions.items()}
    return StructuredMesh(halves.points, cells, regions, facets)


@dataclass(frozen=True, eq=False)
class Bisected(Geometry):
    """A device family with sheets of its mesh halved, again and again.

    Parameters
    ----------
    base
        The family.
    levels
        For each time that sheets were halved their numbers, as in `sheets` of the mesh before.
    """

    base: Geometry
    levels: tuple[tuple[int, ...], ...] = ()

    @property
    def dimension(self) -> int:
        """Of space, as of the family."""
        return self.base.dimension

    @cached_property
    def fine(self) -> StructuredMesh:
        """The mesh with cells of fourth order, which are halved along their own shape."""
        mesh = quartic(self.base)
        for chosen in self.levels:
            mesh = bisected(mesh, np.array(chosen, dtype=np.int64))
        return mesh

    @cached_property
    def _mesh(self) -> StructuredMesh:
        return of_order(self.fine, self.base.mesh().order)

    def mesh(self) -> StructuredMesh:
        """Nodes, cells and named parts as plain arrays."""
        return self._mesh

    def measures(self) -> dict[str, float]:
        """Exact measure of every group, as of the family."""
        return self.base.measures()

    def refine(self, factor: int) -> Geometry:
        """The family with all divisions multiplied by ``factor``, and nothing halved."""
        return self.base.refine(factor)

    def halved(self, chosen: Ints) -> Bisected:
        """The same with further sheets halved."""
        numbers = tuple(int(k) for k in chosen)
        return Bisected(self.base, (*self.levels, numbers))


class _Halves:
    """The new nodes between neighbouring nodes of lines that are halved.

    Attributes
    ----------
    points : positions of all nodes, new ones included
    """

    def __init__(self, points: Floats) -> None:
        self.points = points
        self._new: dict[tuple[int, int], int] = {}

    def split(self, blocks: Ints, axis: int, marked: np.ndarray) -> tuple[Ints, Ints]:
        """Halve marked blocks of nodes along an axis; also the block from which each one is."""
        lines = np.moveaxis(blocks[marked], axis + 1, -1)
        shape, q = lines.shape, lines.shape[-1]
        lines = lines.reshape(-1, q)
        longer = np.empty((len(lines), 2 * q - 1), dtype=lines.dtype)
        longer[:, ::2] = lines
        for k in range(q - 1):
            longer[:, 2 * k + 1] = self._between(lines, k)
        longer = longer.reshape(*shape[:-1], 2 * q - 1)
        halves = [np.moveaxis(h, -1, axis + 1) for h in (longer[..., :q], longer[..., q - 1 :])]
        left, parents = np.flatnonzero(~marked), np.flatnonzero(marked)
        return np.concatenate([blocks[~marked], *halves]), np.concatenate([left, parents, parents])

    def _between(self, lines: Ints, k: int) -> Ints:
        """Numbers of the nodes in the middle between the nodes k and k + 1 of lines."""
        pairs, first, which = np.unique(
            np.sort(lines[:, k : k + 2], axis=1), axis=0, return_index=True, return_inverse=True
        )
        order = lines.shape[1] - 1
        weights = lagrange(order, np.array([(k + 0.5) / order]))[0]
        places = np.einsum("q,nqx->nx", weights, self.points[lines[first]])
        found = np.empty(len(pairs), dtype=np.int64)
        fresh: list[int] = []
        for j, (a, b) in enumerate(pairs.tolist()):
            if (a, b) not in self._new:
                self._new[a, b] = len(self.points) + len(fresh)
                fresh.append(j)
            found[j] = self._new[a, b]
        self.points = np.concatenate([self.points, places[fresh]])
        return found[which.ravel()]


def _has(edges: Ints, known: Ints) -> np.ndarray:
    """Of each block whether one of its edges is known, shape (blocks,).

    One that was halved before along another axis has one of its old edges left.
    """
    base = int(max(edges.max(initial=0), known.max(initial=0))) + 1
    numbers = known[:, 0] * base + known[:, 1]
    found: np.ndarray = np.isin(edges[..., 0] * base + edges[..., 1], numbers).any(axis=1)
    return found


def _edges(blocks: Ints, axis: int) -> Ints:
    """The corners of the edges of blocks of nodes along an axis, sorted, shape (blocks, n, 2)."""
    ends = np.moveaxis(blocks, axis + 1, -1)[..., [0, -1]]
    for other in range(1, ends.ndim - 1):
        ends = np.take(ends, [0, -1], axis=other)
    return np.sort(ends.reshape(len(blocks), 2 ** (blocks.ndim - 2), 2), axis=-1)


def _joined(owners: Ints, edges: Ints, size: int, count: int) -> Ints:
    """Numbers of the groups of owners that share edges, counted without gaps."""
    label = np.arange(size)
    while True:
        least = np.full(count, size)
        np.minimum.at(least, edges, label[owners])
        lower = label.copy()
        np.minimum.at(lower, owners, least[edges])
        lower = lower[lower]
        if np.array_equal(lower, label):
            return np.unique(label, return_inverse=True)[1].ravel()
        label = lower
