"""Structured quadrilaterals and hexahedra with named parts, as plain arrays.

A cell is an array of node numbers on a tensor lattice, shape (q, q) or (q, q, q) with
q = order + 1, axis by axis in logical directions that form a right-handed frame.  gmsh's own
numbering inside a cell comes in only in ``_gmsh``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass
class StructuredMesh:
    """Nodes, cells and named parts.

    Attributes
    ----------
    points : ndarray, shape (N, 3)
        Node positions in metres.
    cells : ndarray of int, shape (M, q[, q[, q]])
        Node numbers, lattice order.
    regions : dict
        Name to cell numbers; every cell is in exactly one.
    facets : dict
        Name to facets, each an array (K[, q[, q]]) of node numbers, outward seen from the cell that
        it was taken from.
    """

    points: Floats
    cells: Ints
    regions: dict[str, Ints] = field(default_factory=dict)
    facets: dict[str, Ints] = field(default_factory=dict)

    @property
    def dimension(self) -> int:
        """1 for lines, 2 for quadrilaterals, 3 for hexahedra."""
        return self.cells.ndim - 1

    @property
    def order(self) -> int:
        """Degree of the geometry."""
        return int(self.cells.shape[1]) - 1

    def add_region(self, name: str, cells: ArrayLike) -> None:
        """Give ``cells`` (numbers or mask) to region ``name``; repeated names add up."""
        self.regions[name] = _joined(self.regions.get(name), _numbers(cells))

    def add_facets(self, name: str, cells: ArrayLike, axis: int, end: int) -> None:
        """Add to group ``name`` one side of ``cells`` (numbers or mask).

        ``axis`` is the logical direction across the side, ``end`` 0 or 1 its lower or upper end.
        Nothing is added, and no group made, where ``cells`` is empty.
        """
        chosen = _numbers(cells)
        if chosen.size == 0:
            return
        sides = np.take(self.cells[chosen], -1 if end else 0, axis=axis + 1)
        # turn it round, so that the normal points out of the cell; a point has no sides
        if sides.ndim > 1 and (axis == 1) != (end == 0):
            sides = sides[:, ::-1] if sides.ndim == 2 else np.swapaxes(sides, 1, 2)
        self.facets[name] = _joined(self.facets.get(name), sides)

    def corners(self, lattice: Ints) -> Ints:
        """Corner nodes of cells or facets, shape (K, 2^d)."""
        for axis in range(1, lattice.ndim):
            lattice = np.take(lattice, [0, -1], axis=axis)
        return lattice.reshape(len(lattice), -1)

    def check(self) -> None:
        """Refuse a mesh whose regions overlap or leave a gap, or whose facet groups overlap."""
        seen = np.zeros(len(self.cells), dtype=int)
        for cells in self.regions.values():
            np.add.at(seen, cells, 1)
        if np.any(seen != 1):
            raise AssertionError(f"{np.count_nonzero(seen != 1)} cells are not in one region")
        if not self.facets:
            return
        keys = np.sort(np.concatenate([self.corners(f) for f in self.facets.values()]), axis=1)
        if len(np.unique(keys, axis=0)) != len(keys):
            raise AssertionError("a facet is in two groups")


def _numbers(cells: ArrayLike) -> Ints:
    chosen = np.asarray(cells)
    return np.flatnonzero(chosen) if chosen.dtype == bool else chosen.astype(np.int64)


def _joined(old: Ints | None, new: Ints) -> Ints:
    return new if old is None else np.concatenate([old, new])


def lattice_points(ends: ArrayLike, order: int) -> Floats:
    """Node positions along one direction: cell ends, and equal steps between them."""
    ends = np.asarray(ends, dtype=float)
    points = np.empty(order * (len(ends) - 1) + 1)
    points[::order] = ends
    for k in range(1, order):
        points[k::order] = ((order - k) * ends[:-1] + k * ends[1:]) / order
    return points


def joined_ends(*pieces: ArrayLike) -> Floats:
    """Cell ends of adjoining intervals as one increasing sequence."""
    parts = [np.asarray(p, dtype=float) for p in pieces]
    return np.concatenate([parts[0], *[p[1:] for p in parts[1:]]])


def block(counts: tuple[int, ...], order: int) -> tuple[tuple[Ints, ...], tuple[Ints, ...]]:
    """Cells of a logically structured block.

    Returns
    -------
    cell : tuple of ndarray, each (M,)
        Logical indices of every cell, last direction fastest.
    node : tuple of ndarray, each (M, q, q[, q])
        Logical indices of every cell's nodes, from 0 to order * count in each direction.
    """
    cell = tuple(i.ravel() for i in np.indices(counts, dtype=np.int64))
    return cell, nodes_of_cells(cell, order)


def nodes_of_cells(cell: Sequence[Ints], order: int) -> tuple[Ints, ...]:
    """Logical indices of the nodes, each of shape (M, q, q[, q]), of cells with some indices."""
    dim = len(cell)
    local = np.indices((order + 1,) * dim, dtype=np.int64)
    spread = (slice(None),) + (None,) * dim
    return tuple(order * cell[d][spread] + local[d] for d in range(dim))


def lattice(
    ends: Sequence[Floats], order: int, keep: Callable[..., NDArray[np.bool_]] | None = None
) -> tuple[StructuredMesh, tuple[Ints, ...]]:
    """Cells between the cell ends along each axis, without groups.

    Parameters
    ----------
    ends
        Cell ends along x, y (and z).
    order
        Degree of the geometry.
    keep
        Says, given the logical indices of all cells, which are there; all by default.

    Returns
    -------
    mesh : StructuredMesh
    cell : tuple of ndarray
        Logical indices of every cell.
    """
    lines = [lattice_points(e, order) for e in ends]
    cell, node = block(tuple(len(e) - 1 for e in ends), order)
    if keep is not None:
        there = keep(*cell)
        cell, node = tuple(c[there] for c in cell), tuple(n[there] for n in node)
    shape = tuple(len(line) for line in lines)
    cells, used = compact(np.ravel_multi_index(node, shape))
    points = np.zeros((len(used), 3))
    for axis, index in enumerate(np.unravel_index(used, shape)):
        points[:, axis] = lines[axis][index]
    return StructuredMesh(points, cells), cell


def sweep(plane: Ints, layers: int, order: int) -> tuple[Ints, Ints, Ints]:
    """Hexahedra from quadrilaterals ``plane``, shape (m, q, q), through ``layers`` cells.

    Returns
    -------
    cells : ndarray, shape (m * layers, q, q, q)
        Node ``i`` of the plane at level ``k`` has the number ``i * (order * layers + 1) + k``.
    base, level : ndarray, shape (m * layers,)
        Plane cell and layer of every hexahedron.
    """
    levels = order * layers + 1
    k = order * np.arange(layers)[:, None] + np.arange(order + 1)
    cells = plane[:, None, :, :, None] * levels + k[None, :, None, None, :]
    base, level = (i.ravel() for i in np.indices((len(plane), layers), dtype=np.int64))
    q = order + 1
    return cells.reshape(-1, q, q, q), base, level


def compact(keys: Ints) -> tuple[Ints, Ints]:
    """Number the nodes that occur in ``keys`` from 0 without gaps.

    Returns
    -------
    cells : ndarray, shape of ``keys``
        The new numbers.
    used : ndarray, shape (N,)
        The key of every node, increasing.
    """
    present = np.zeros(int(keys.max()) + 1, dtype=bool)
    present[keys] = True
    used = np.flatnonzero(present)
    number = np.cumsum(present) - 1
    return number[keys], used
