"""The grids on which fields are written: that of the device, and those of its surfaces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import basix
import numpy as np

from dea_fenicsx.results.axes import FIXED
from dea_fenicsx.support.cell_types import BY_DEGREE, CORNERS, POINT, SHAPES


@dataclass(frozen=True)
class Grid:
    """A grid of cells of first or second degree, on rank 0.

    The tables of a large one may be spread over the ranks (`dea_fenicsx.results.spread`).

    Attributes
    ----------
    points : ndarray (nodes, 3), undeformed, m
    cells : ndarray (cells, nodes of a cell), VTK order
    kind : DOLFINx's name of the cell, or "line"
    regions : ndarray (cells,), tag of each cell's region
    degree : degree of the cells, 1 or 2
    names : name of each region by its tag
    axes : names of the axes by which components of vectors and tensors are ordered
    """

    points: np.ndarray
    cells: np.ndarray
    kind: str
    regions: np.ndarray
    degree: int = 2
    names: Mapping[int, str] = field(default_factory=dict)
    axes: tuple[str, str, str] = FIXED


@dataclass(frozen=True, kw_only=True)
class SurfaceGrid(Grid):
    """The grid of a surface: its cells are facets of the device's grid.

    Attributes
    ----------
    nodes : ndarray (nodes,), number of each node in the device's grid
    parents : ndarray (cells,), number in the device's grid of the cell behind each facet
    """

    nodes: np.ndarray
    parents: np.ndarray


def surface_grid(grid: Grid, connectivity: np.ndarray, pairs: np.ndarray) -> SurfaceGrid:
    """The grid of some facets of a device's grid, each facet once.

    Parameters
    ----------
    grid
        The device's grid.
    connectivity
        Its nodes in each cell, in basix's order, shape (cells, nodes of a cell).
    pairs
        Number of a cell and number of the facet within it, shape (n, 2); both sides of a facet may
        be there.
    """
    facet, closure = facet_nodes(grid.kind, grid.degree)
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    table = np.take_along_axis(connectivity[pairs[:, 0]], closure[pairs[:, 1]], axis=1)
    _, first = np.unique(np.sort(table, axis=1), axis=0, return_index=True)
    kept = np.sort(first)
    table, parents = table[kept], pairs[kept, 0]
    # number the nodes by their first appearance
    numbers, first, inverse = np.unique(table.ravel(), return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    nodes = numbers[order]
    cells = rank[inverse].reshape(table.shape)
    vtk_order = BY_DEGREE[grid.degree][facet].vtk_order
    return SurfaceGrid(
        grid.points[nodes], cells[:, vtk_order], facet, grid.regions[parents], grid.degree,
        grid.names, grid.axes, nodes=nodes, parents=parents,
    )  # fmt: skip


def facet_nodes(kind: str, degree: int) -> tuple[str, np.ndarray]:
    """Shape of a cell's facets, and the cell's nodes on each, in the facet's own order.

    Returns
    -------
    shape, ndarray of shape (facets, nodes of a facet)
    """
    cell = getattr(basix.CellType, kind)
    corners = basix.geometry(cell)
    facets = basix.topology(cell)[-2]
    if len(facets[0]) == 1:  # the facets of a line are its ends, which are its first two nodes
        return POINT, np.array(facets)
    shape = SHAPES[CORNERS[kind][0] - 1, len(facets[0])]
    own = basix.CellType.interval if shape == "line" else getattr(basix.CellType, shape)
    nodes, places = _nodes(cell, degree), _nodes(own, degree)
    # the facet's linear shape functions take its own places into the cell
    weights = basix.create_element(basix.ElementFamily.P, own, 1).tabulate(0, places)[0, :, :, 0]
    found = []
    for facet in facets:
        x = weights @ corners[facet]
        found.append(np.linalg.norm(nodes[None, :] - x[:, None], axis=2).argmin(axis=1))
    return shape, np.array(found)


def _nodes(cell: basix.CellType, degree: int) -> np.ndarray:
    """Nodes of the Lagrange element of a cell in basix's order, shape (nodes, dimension)."""
    variant = basix.LagrangeVariant.gll_warped
    return np.asarray(basix.create_element(basix.ElementFamily.P, cell, degree, variant).points)


def quadratic_from_linear(kind: str) -> np.ndarray:
    """Matrix from vertex values to the values at the nodes of the quadratic cell."""
    cell = getattr(basix.CellType, kind)
    linear = basix.create_element(basix.ElementFamily.P, cell, 1)
    quadratic = basix.create_element(
        basix.ElementFamily.P, cell, 2, basix.LagrangeVariant.gll_warped
    )
    return np.asarray(linear.tabulate(0, quadratic.points)[0, :, :, 0])
