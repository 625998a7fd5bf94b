"""Types of cells: their names in gmsh, DOLFINx, XDMF and VTK, and the orders of their nodes."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

POINT, LINE, TRIANGLE, QUAD, TET, HEX, PRISM, PYRAMID = (
    "point", "line", "triangle", "quadrilateral", "tetrahedron", "hexahedron", "prism", "pyramid",
)  # fmt: skip
"""Shapes of cells, by DOLFINx's names."""

INTERVAL = "interval"
"""DOLFINx's name of a line that is a cell: a piece of the meridian of a membrane."""

CORNERS = {
    POINT: (0, 1), INTERVAL: (1, 2), LINE: (1, 2), TRIANGLE: (2, 3), QUAD: (2, 4), TET: (3, 4),
    HEX: (3, 8), PRISM: (3, 6), PYRAMID: (3, 5),
}  # fmt: skip
"""Dimension and number of corners of each shape."""

SHAPES = {pair: shape for shape, pair in CORNERS.items() if shape != POINT}
"""Shape of a cell by its dimension and number of corners."""

SIMPLICES = (TRIANGLE, TET)
"""Shapes whose linear map from the reference cell has a constant gradient.

On these a discontinuous linear pressure is not stable.
"""


@dataclass(frozen=True)
class WrittenCell:
    """A cell of first or second order in which results are written.

    Attributes
    ----------
    xdmf : XDMF's name
    vtk : VTK's number
    flat : whether it lies in a plane
    vtk_order : VTK's order of the nodes, in terms of basix's
    """

    xdmf: str
    vtk: int
    flat: bool
    vtk_order: tuple[int, ...]

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return len(self.vtk_order)


QUADRATIC = {
    TRIANGLE: WrittenCell("Triangle_6", 22, True, (0, 1, 2, 5, 3, 4)),
    QUAD: WrittenCell("Quadrilateral_9", 28, True, (0, 1, 3, 2, 4, 6, 7, 5, 8)),
    TET: WrittenCell("Tetrahedron_10", 24, False, (0, 1, 2, 3, 9, 6, 8, 7, 5, 4)),
    HEX: WrittenCell("Hexahedron_27", 29, False, (
        0, 1, 3, 2, 4, 5, 7, 6, 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 15, 14, 22, 23, 21, 24, 20,
        25, 26,
    )),
}  # fmt: skip
"""The cell of second order of each shape that a device may have."""

LINEAR = {
    TRIANGLE: WrittenCell("Triangle", 5, True, (0, 1, 2)),
    QUAD: WrittenCell("Quadrilateral", 9, True, (0, 1, 3, 2)),
    TET: WrittenCell("Tetrahedron", 10, False, (0, 1, 2, 3)),
    HEX: WrittenCell("Hexahedron", 12, False, (0, 1, 3, 2, 4, 5, 7, 6)),
}
"""The same of first order."""

_LINES = {
    1: WrittenCell("Polyline", 3, True, (0, 1)), 2: WrittenCell("Edge_3", 21, True, (0, 1, 2))
}  # fmt: skip
BY_DEGREE = {
    1: {LINE: _LINES[1], INTERVAL: _LINES[1], **LINEAR},
    2: {LINE: _LINES[2], INTERVAL: _LINES[2], **QUADRATIC},
}
"""Both by their degree, with the lines that bound a device in the plane or are a membrane."""

LINES = tuple(cells[LINE].xdmf for cells in BY_DEGREE.values())
"""XDMF's names of lines."""

BY_XDMF = {cell.xdmf: cell for cells in BY_DEGREE.values() for cell in cells.values()}
"""All of them by XDMF's names."""


@dataclass(frozen=True)
class GmshCell:
    """One of gmsh's types of cells.

    Attributes
    ----------
    shape : its shape
    order : polynomial order of its edges
    nodes : number of nodes
    complete : whether it has all nodes of a Lagrange cell of that order, those inside included
    """

    shape: str
    order: int
    nodes: int
    complete: bool

    @property
    def dim(self) -> int:
        """Dimension."""
        return CORNERS[self.shape][0]


def lagrange_nodes(shape: str, order: int) -> int:
    """Number of nodes of the Lagrange cell of a shape and an order n."""
    n = order
    return {
        POINT: 1,
        LINE: n + 1,
        TRIANGLE: comb(n + 2, 2),
        QUAD: (n + 1) ** 2,
        TET: comb(n + 3, 3),
        HEX: (n + 1) ** 3,
        PRISM: (n + 1) * comb(n + 2, 2),
        PYRAMID: (n + 1) * (n + 2) * (2 * n + 3) // 6,
    }[shape]


_COMPLETE = {  # gmsh's numbers, from first order on
    LINE: (1, 8, 26, 27, 28), TRIANGLE: (2, 9, 21, 23, 25), QUAD: (3, 10, 36, 37, 38),
    TET: (4, 11, 29, 30, 31), HEX: (5, 12, 92, 93, 94), PRISM: (6, 13), PYRAMID: (7, 14, 118, 119),
}  # fmt: skip
_INCOMPLETE = {  # gmsh's number: shape, order and number of nodes
    16: (QUAD, 2, 8), 17: (HEX, 2, 20), 18: (PRISM, 2, 15), 19: (PYRAMID, 2, 13),
    20: (TRIANGLE, 3, 9), 22: (TRIANGLE, 4, 12), 24: (TRIANGLE, 5, 15),
    39: (QUAD, 3, 12), 40: (QUAD, 4, 16), 41: (QUAD, 5, 20),
    99: (HEX, 3, 32), 100: (HEX, 4, 44), 125: (PYRAMID, 3, 21),
}  # fmt: skip

GMSH = {
    15: GmshCell(POINT, 0, 1, True),
    **{
        number: GmshCell(shape, order, lagrange_nodes(shape, order), True)
        for shape, numbers in _COMPLETE.items()
        for order, number in enumerate(numbers, 1)
    },
    **{number: GmshCell(*facts, False) for number, facts in _INCOMPLETE.items()},
}
"""gmsh's types of cells by their numbers, for the orders that meshes have."""


def gmsh_number(shape: str, order: int) -> int:
    """gmsh's number of the complete cell of a shape and an order."""
    return _COMPLETE[shape][order - 1]
