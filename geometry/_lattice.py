"""Structured meshes of which each of several ranks can make its part alone.

The cells lie in a block of logical directions.  Each group is a list of boxes in that block, so
that the cells of a part, their nodes and their groups follow from a range of numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ._quality import least_and_aspect
from ._structured import Floats, Ints, StructuredMesh, lattice_points, nodes_of_cells

CELLS_AT_ONCE = 100
"""Cells whose shape is looked at together."""


@dataclass(frozen=True)
class GroupBox:
    """Cells of a group between bounds, or those sides of them that are facets of it.

    Attributes
    ----------
    name
        Of the group.
    cells
        For each logical direction the indices of the cells.
    side
        Of facets the direction across them in the cells, and 0 or 1 for their lower or upper end.
    """

    name: str
    cells: tuple[range, ...]
    side: tuple[int, int] | None = None

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of cells along each direction."""
        return tuple(len(r) for r in self.cells)

    def holds(self, cell: Sequence[Ints]) -> np.ndarray:
        """Which of the cells with some logical indices lie in the box."""
        return np.all(
            [(c >= r.start) & (c < r.stop) for c, r in zip(cell, self.cells, strict=True)], axis=0
        )


def within(cells: tuple[range, ...], axis: int, indices: range) -> tuple[range, ...]:
    """Some of the cells of a box, by their indices along one of its directions."""
    return (*cells[:axis], indices, *cells[axis + 1 :])


def side_boxes(cells: tuple[range, ...], axis: int, low: str, high: str) -> list[GroupBox]:
    """The facets at both ends of a box along one of its directions, with their names."""
    return [
        GroupBox(low, within(cells, axis, cells[axis][:1]), (axis, 0)),
        GroupBox(high, within(cells, axis, cells[axis][-1:]), (axis, 1)),
    ]


def name_boxes(mesh: StructuredMesh, cell: Sequence[Ints], boxes: Sequence[GroupBox]) -> None:
    """Name the groups of a mesh by the logical indices of its cells."""
    for box in boxes:
        if box.side is None:
            mesh.add_region(box.name, box.holds(cell))
        else:
            mesh.add_facets(box.name, box.holds(cell), *box.side)


@dataclass(frozen=True)
class Lattice:
    """All that is needed to make any part of a structured mesh.

    Attributes
    ----------
    counts
        Cells along each logical direction.
    order
        Degree of the geometry.
    nodes
        Number of nodes; each belongs to a cell.
    cells
        The numbers of the nodes, shape (K, q, q[, q]), of K cells with some logical indices.
    places
        The positions in metres, shape (K, 3), of K nodes with some numbers.
    boxes
        The groups in their order.  Each cell is in exactly one box without a side.
    """

    counts: tuple[int, ...]
    order: int
    nodes: int
    cells: Callable[[Sequence[Ints]], Ints]
    places: Callable[[Ints], Floats]
    boxes: Sequence[GroupBox]

    def mesh(self) -> StructuredMesh:
        """The whole mesh, its cells in the order of their indices, the last direction fastest."""
        cell = [i.ravel() for i in np.indices(self.counts, dtype=np.int64)]
        mesh = StructuredMesh(self.places(np.arange(self.nodes)), self.cells(cell))
        name_boxes(mesh, cell, self.boxes)
        return mesh

    def part(self, part: int, parts: int) -> StructuredMesh:
        """What one of several ranks makes: an equal part of the cells and of the nodes.

        The cells are in the order of the regions, as gmsh has them.
        """
        cell = self._cells_of(part, parts)
        points = self.places(np.arange(*_bounds(self.nodes, part, parts)))
        mesh = StructuredMesh(points, self.cells(cell))
        name_boxes(mesh, cell, self.boxes)
        return mesh

    def groups(self) -> dict[str, int]:
        """Names of all groups, each with its dimension, the regions first."""
        dim = len(np.shape(self.cells([np.zeros(1, dtype=np.int64)] * len(self.counts)))) - 1
        boxes = [box for box in self.boxes if all(box.shape)]
        regions = dict.fromkeys((box.name for box in boxes if box.side is None), dim)
        return regions | dict.fromkeys((box.name for box in boxes if box.side), dim - 1)

    def shape(self, part: int, parts: int) -> tuple[float, float]:
        """Least scaled Jacobian and largest aspect of the cells of a part; (inf, 0) of no cell."""
        cell = self._cells_of(part, parts)
        found = [(np.inf, 0.0)]
        for first in range(0, len(cell[0]), CELLS_AT_ONCE):
            cells = self.cells([c[first : first + CELLS_AT_ONCE] for c in cell])
            places = self.places(cells.ravel())
            found.append(least_and_aspect(places.reshape(*cells.shape, 3)))
        return min(least for least, _ in found), max(aspect for _, aspect in found)

    def _cells_of(self, part: int, parts: int) -> list[Ints]:
        """Logical indices of the cells of a part, in the order of the regions."""
        regions = [box for box in self.boxes if box.side is None]
        names = list(dict.fromkeys(box.name for box in regions))
        first, last = _bounds(int(np.prod(self.counts)), part, parts)
        start = 0
        found: list[list[Ints]] = [[np.empty(0, dtype=np.int64)] for _ in self.counts]
        for box in sorted(regions, key=lambda box: names.index(box.name)):
            count = int(np.prod(box.shape))
            here = np.arange(max(first - start, 0), min(last - start, count))
            for one, index, cells in zip(
                found, np.unravel_index(here, box.shape), box.cells, strict=True
            ):
                one.append(cells.start + index)
            start += count
        return [np.concatenate(one) for one in found]


def _bounds(total: int, part: int, parts: int) -> tuple[int, int]:
    """First number of one of several equal parts, and the first one behind it."""
    return total * part // parts, total * (part + 1) // parts


def between(ends: Sequence[Floats], order: int, boxes: Sequence[GroupBox]) -> Lattice:
    """The cells between cell ends along x, y (and z), in metres, with groups."""
    lines = [lattice_points(e, order) for e in ends]
    shape = tuple(len(line) for line in lines)

    def cells(cell: Sequence[Ints]) -> Ints:
        return np.ravel_multi_index(nodes_of_cells(cell, order), shape)

    def places(number: Ints) -> Floats:
        points = np.zeros((len(number), 3))
        for axis, index in enumerate(np.unravel_index(number, shape)):
            points[:, axis] = lines[axis][index]
        return points

    counts = tuple(len(e) - 1 for e in ends)
    return Lattice(counts, order, int(np.prod(shape)), cells, places, boxes)


@dataclass(frozen=True)
class FlatLattice:
    """A flat mesh of quadrilaterals, to be swept along z.

    Attributes
    ----------
    counts
        Cells along each logical direction.
    nodes
        Number of nodes.
    cells
        The numbers of the nodes, shape (K, q, q), of K cells with some logical indices.
    places
        The positions in metres, shape (K, 2), of K nodes with some numbers.
    """

    counts: tuple[int, ...]
    nodes: int
    cells: Callable[[Sequence[Ints]], Ints]
    places: Callable[[Ints], Floats]

    def flat(self) -> FlatLattice:
        """The same with one index for each cell: its place in the order of its indices."""

        def cells(cell: Sequence[Ints]) -> Ints:
            return self.cells(np.unravel_index(cell[0], self.counts))

        return FlatLattice((int(np.prod(self.counts)),), self.nodes, cells, self.places)

    def unswept(self, order: int, boxes: Sequence[GroupBox]) -> Lattice:
        """The quadrilaterals themselves, with groups."""

        def places(number: Ints) -> Floats:
            return np.column_stack([self.places(number), np.zeros(len(number))])

        return Lattice(self.counts, order, self.nodes, self.cells, places, boxes)

    def swept(self, ends: Floats, order: int, boxes: Sequence[GroupBox]) -> Lattice:
        """Hexahedra between cell ends along z in metres, with groups.

        The index along z is the last of a cell's, and the direction along z is the third in each.
        Node ``i`` of the plane at level ``k`` has the number ``i * (order * layers + 1) + k``.
        """
        heights = lattice_points(ends, order)
        levels = len(heights)

        def cells(cell: Sequence[Ints]) -> Ints:
            k = order * cell[-1][:, None] + np.arange(order + 1)
            return self.cells(cell[:-1])[..., None] * levels + k[:, None, None, :]

        def places(number: Ints) -> Floats:
            base, level = np.divmod(number, levels)
            return np.column_stack([self.places(base), heights[level]])

        counts = (*self.counts, len(ends) - 1)
        return Lattice(counts, order, self.nodes * levels, cells, places, boxes)
