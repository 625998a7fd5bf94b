"""Flat meshes around an axis, of which any part can be made alone: rings, and a full disk."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ._lattice import FlatLattice
from ._structured import Floats, Ints, lattice_points, nodes_of_cells

CORE = 0.45  # half diagonal of the core square over the radius of the circle around it
BULGE = 0.4  # 0: straight core sides, 1: a round core, whose corners are flat


def rings(radii: Floats, directions: Floats, around: int, order: int) -> FlatLattice:
    """Quadrilaterals along the radius and around.

    Parameters
    ----------
    radii
        Of the nodes in metres.
    directions
        Unit vectors to the nodes around, shape (n, 2); after the last one comes the first one
        where the cells go once around.
    around
        Number of cells around.
    order
        Degree of the geometry.
    """
    count = len(directions)

    def cells(cell: Sequence[Ints]) -> Ints:
        r, a = nodes_of_cells(cell, order)
        return r * count + a % count

    def places(number: Ints) -> Floats:
        r, a = np.divmod(number, count)
        return radii[r][:, None] * directions[a]

    return FlatLattice(((len(radii) - 1) // order, around), len(radii) * count, cells, places)


def circle(count: int, start: float = 0.0) -> Floats:
    """Unit vectors at equal angles once around, shape (count, 2), from an angle in rad."""
    angle = 2 * math.pi * np.arange(count) / count + start
    return np.column_stack([np.cos(angle), np.sin(angle)])


def o_grid(ends: Floats, spokes: int, edge: float, angular: int, order: int) -> FlatLattice:
    """A full disk: a square core with bulging sides, and rings around it.

    A cell has one index.  Those of the core come first; ring ``r`` begins ``r * angular`` cells
    behind them.  In a ring the first direction is the radius, the second one the angle.

    Parameters
    ----------
    ends
        Ends of the rings: up to ``spokes`` rings fractions of the way from the core to the edge,
        then distances in metres, in excess of 1, from the edge.
    spokes
        Number of rings between the core and the edge.
    edge
        Radius in metres up to which the rings become round.
    angular
        Cells around, a multiple of 4.
    order
        Degree of the geometry.
    """
    n, around = angular // 4, order * angular
    m, levels = order * n, lattice_points(ends, order)
    line, directions = np.linspace(-1.0, 1.0, m + 1), circle(around, -math.pi / 4)
    offset = (m + 1) ** 2
    # The perimeter of the core, anticlockwise from the lower right corner, is the first circle.
    k, full, none = np.arange(m), np.full(m, m), np.zeros(m, dtype=np.int64)
    walk_i, walk_j = np.concatenate([full, m - k, none, k]), np.concatenate([k, full, m - k, none])

    def cells(cell: Sequence[Ints]) -> Ints:
        number, inside = cell[0], cell[0] < n * n
        found = np.empty((len(number), order + 1, order + 1), dtype=np.int64)
        i, j = nodes_of_cells(np.divmod(number[inside], n), order)
        found[inside] = i * (m + 1) + j
        r, a = nodes_of_cells(np.divmod(number[~inside] - n * n, angular), order)
        a %= around
        on_core = walk_i[a] * (m + 1) + walk_j[a]
        found[~inside] = np.where(r == 0, on_core, offset + (r - 1) * around + a)
        return found

    def places(number: Ints) -> Floats:
        inside = number < offset
        found = np.empty((len(number), 2))
        i, j = np.divmod(number[inside], m + 1)
        found[inside] = _core(line[i], line[j], edge)
        r, a = np.divmod(number[~inside] - offset, around)
        level, direction = levels[r + 1][:, None], directions[a]
        start = _core(line[walk_i[a]], line[walk_j[a]], edge)
        spoke = (1 - level) * start + level * (edge * direction)
        beyond = (r + 1 > order * spokes)[:, None]
        found[~inside] = np.where(beyond, (edge + level - 1.0) * direction, spoke)
        return found

    count, nodes = n * n + (len(ends) - 1) * angular, offset + (len(levels) - 1) * around
    return FlatLattice((count,), nodes, cells, places)


def _core(u: Floats, v: Floats, edge: float) -> Floats:
    """Points of the core, shape (n, 2) in metres, by their places in the square [-1, 1]^2."""
    square = np.column_stack([u, v]) * math.sqrt(0.5)
    disk = np.column_stack([u * np.sqrt(1 - v**2 / 2), v * np.sqrt(1 - u**2 / 2)])
    return np.asarray(CORE * edge * ((1 - BULGE) * square + BULGE * disk))
