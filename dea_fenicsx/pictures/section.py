"""A device in space cut by a plane: triangles within its cells, and lines on their borders."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from dea_fenicsx.pictures.faces import Faces
from dea_fenicsx.pictures.pieces import triangles_of
from dea_fenicsx.pictures.stored import Stored

MANY_CELLS = 15_000
"""Cells on the plane beyond which they are cut by their corners alone."""

OFF_MIDDLE = 2.0137e-3
"""How far the plane lies off the middle, where faces of cells are likely to lie."""

_HEX = ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6))
_HEX_27 = ((0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2),
           (1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2),
           (0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1), (0, 1, 1), (2, 1, 1), (1, 0, 1), (1, 2, 1),
           (1, 1, 0), (1, 1, 2), (1, 1, 1))  # fmt: skip
_TET_10 = ((0, 4, 6, 7), (4, 1, 5, 8), (6, 5, 2, 9), (7, 8, 9, 3),
           (4, 9, 5, 6), (4, 9, 6, 7), (4, 9, 7, 8), (4, 9, 8, 5))  # fmt: skip


def _hex_27() -> tuple[tuple[int, ...], ...]:
    """The eight small hexahedra of one of second order, each as tetrahedra."""
    number: dict[tuple[int, ...], int] = {place: k for k, place in enumerate(_HEX_27)}
    found = []
    for start in product((0, 1), repeat=3):
        corners = [number[tuple(a + b // 2 for a, b in zip(start, end, strict=True))]
                   for end in _HEX_27[:8]]  # fmt: skip
        found += [tuple(corners[k] for k in tet) for tet in _HEX]
    return tuple(found)


TETRAHEDRA = {29: _hex_27(), 12: _HEX, 24: _TET_10, 10: ((0, 1, 2, 3),)}
"""Of each of VTK's cells in space: tetrahedra between its nodes."""

BY_CORNERS = {29: 12, 24: 10}
"""Cells of first order in place of those of second order."""


@dataclass(frozen=True)
class Section:
    """Triangles and lines in a plane.

    Attributes
    ----------
    points, moves : ndarray (n, 3, 3), corners of each triangle, undeformed, and displacements
    values : ndarray (n, 3) of values at the corners, or (n,) of the cells
    lines, line_moves : ndarray (k, 2, 3), both ends of each line, undeformed, and displacements
    at : place of the plane along y, m
    """

    points: np.ndarray
    moves: np.ndarray
    values: np.ndarray
    lines: np.ndarray
    line_moves: np.ndarray
    at: float


def section_of(stored: Stored, faces: Faces, values: np.ndarray, nodal: bool) -> Section | None:
    """The undeformed device cut by the plane y = middle, or one side if it has a hole there.

    None if no cell lies on the plane.

    Parameters
    ----------
    stored, faces
        The device and its faces.
    values, nodal
        Values of a field, and whether there is one for each node or for each cell.
    """
    low, high = faces.points.min(axis=0), faces.points.max(axis=0)
    middle = (low + high) / 2
    plane = middle[1] + OFF_MIDDLE * (high[1] - low[1])
    table, cells = _on_plane(stored, plane)
    if not len(cells):
        return None
    kind = stored.cell.vtk
    kind = BY_CORNERS.get(kind, kind) if len(cells) > MANY_CELLS else kind
    kept = np.zeros(stored.size, dtype=bool)
    kept[table] = True
    numbers = np.cumsum(kept) - 1
    points, moves = stored.points(kept), stored.displacements(kept)
    tets = numbers[table][:, np.array(TETRAHEDRA[kind])].reshape(-1, 4)
    of_cell = np.repeat(cells, len(TETRAHEDRA[kind]))
    ends, share, of_cell = cut(tets, of_cell, points[:, 1] - plane)

    if not len(of_cell):
        return None

    def between(at_nodes: np.ndarray) -> np.ndarray:
        first, second = at_nodes[ends[..., 0]], at_nodes[ends[..., 1]]
        part = share if at_nodes.ndim == 1 else share[..., None]
        return np.asarray(first + part * (second - first))

    shown = between(values[kept]) if nodal else values[of_cell]
    lines, line_moves = _borders(faces, plane)
    found = Section(between(points), between(moves), shown, lines, line_moves, float(middle[1]))
    return _one_side(found, middle[0], high[0] - low[0])


def _on_plane(stored: Stored, plane: float) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and numbers of the cells on a plane."""
    y = stored.height(1)
    tables, cells = [np.empty((0, stored.cell.nodes), np.int64)], [np.empty(0, np.int64)]
    for begin, table in stored.tables():
        at = y[table]
        rows = np.flatnonzero((at.min(axis=1) < plane) & (at.max(axis=1) > plane))
        tables.append(table[rows])
        cells.append(begin + rows)
    return np.vstack(tables), np.concatenate(cells)


def cut(
    tets: np.ndarray, cells: np.ndarray, over: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangles in which tetrahedra meet a plane.

    Returns
    -------
    ends, share, cells
        The two nodes between which each corner lies, shape (n, 3, 2), how far from the first one,
        shape (n, 3), and the cell of each triangle.
    """
    above = over[tets] > 0
    mixed = np.flatnonzero(above.any(axis=1) & ~above.all(axis=1))
    tets, above, cells = tets[mixed], above[mixed], cells[mixed]
    parts, of_cell = [np.empty((0, 3, 2), np.int64)], [np.empty(0, np.int64)]

    def add(rows: np.ndarray, pairs: tuple[tuple[int, int], ...]) -> None:
        parts.append(np.stack([tets[rows][:, pair] for pair in pairs], axis=1))
        of_cell.append(cells[rows])

    for k in range(4):
        others = [j for j in range(4) if j != k]
        rows = np.flatnonzero((above[:, others] != above[:, [k]]).all(axis=1))
        add(rows, tuple((k, j) for j in others))
    for (a, b), (c, d) in (((0, 1), (2, 3)), ((0, 2), (1, 3)), ((0, 3), (1, 2))):
        rows = np.flatnonzero(
            (above[:, a] == above[:, b]) & (above[:, c] == above[:, d])
            & (above[:, a] != above[:, c])
        )  # fmt: skip
        add(rows, ((a, c), (a, d), (b, d)))
        add(rows, ((a, c), (b, d), (b, c)))
    ends = np.concatenate(parts)
    return ends, _share(over, ends), np.concatenate(of_cell)


def _share(over: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """How far from the first of two nodes a plane lies between them."""
    first, second = over[ends[..., 0]], over[ends[..., 1]]
    return np.asarray(first / (first - second))


def _borders(faces: Faces, plane: float) -> tuple[np.ndarray, np.ndarray]:
    """Lines in which the outer faces, and those between regions, meet a plane."""
    y = faces.points[:, 1][faces.nodes]
    rows = np.flatnonzero((y.min(axis=1) < plane) & (y.max(axis=1) > plane))
    fine = triangles_of(faces, rows)
    points, moves = fine.at(faces.points), fine.at(faces.moves)
    over = points[:, 1] - plane
    above = over[fine.corners] > 0
    parts = [np.empty((0, 2, 2), np.int64)]
    for k in range(3):
        a, b = (k + 1) % 3, (k + 2) % 3
        mine = (above[:, a] == above[:, b]) & (above[:, a] != above[:, k])
        some = fine.corners[mine]
        parts.append(np.stack([some[:, [k, a]], some[:, [k, b]]], axis=1))
    ends = np.concatenate(parts)
    share = _share(over, ends)[..., None]

    def between(values: np.ndarray) -> np.ndarray:
        first, second = values[ends[..., 0]], values[ends[..., 1]]
        return np.asarray(first + share * (second - first))

    return between(points), between(moves)


def _one_side(section: Section, middle: float, width: float) -> Section:
    """The side x < 0 if the section has a hole in the middle, else all of it.

    At x > 0 lie the ends of a helical device, where nothing is typical.
    """
    x = section.points[..., 0] - middle
    left = x.max(axis=1) < -0.01 * width
    if not left.any() or not (left | (x.min(axis=1) > 0)).all():
        return section
    mine = section.lines[..., 0].max(axis=1) < middle
    return replace(
        section, points=section.points[left], moves=section.moves[left],
        values=section.values[left], lines=section.lines[mine],
        line_moves=section.line_moves[mine],
    )  # fmt: skip
