"""The grid of a device with nodes of its own on each side of regions and of named surfaces.

Stress and electric field jump there.  Values at these nodes can be averages over cells without
smearing the jump, and take far less room than nodes of its own for each cell.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dea_fenicsx.results.grids import Grid, facet_nodes
from dea_fenicsx.support.cell_types import BY_DEGREE
from dea_fenicsx.support.later import Later

csgraph = Later("scipy.sparse.csgraph")
sparse = Later("scipy.sparse")

MOST_NODES = 500_000
"""Nodes beyond which no fields at nodes are written: a step would take more than 40 MB."""


@dataclass(frozen=True)
class SplitGrid:
    """A split grid, on rank 0.

    Attributes
    ----------
    grid : the grid, with the cells of the device's grid in their order
    origin : ndarray (nodes,), number of each node in the device's grid
    table : ndarray (cells, nodes of a cell), nodes of each cell in basix's order
    """

    grid: Grid
    origin: np.ndarray
    table: np.ndarray

    def averages(self, inner: Iterable[np.ndarray], to_nodes: np.ndarray) -> np.ndarray:
        """Values at the nodes: means over the cells that have the node.

        Parameters
        ----------
        inner
            Values at the inner points of each cell, shape (cells, points, numbers), in pieces.
        to_nodes
            Matrix from them to the nodes of a cell, in basix's order, shape (nodes, points).

        Returns
        -------
        ndarray of shape (nodes of the grid, numbers)
        """
        size, start = len(self.origin), 0
        total: Any = 0.0
        for part in inner:
            where = self.table[start : start + len(part)].ravel()
            start += len(part)
            total = total + np.column_stack([
                np.bincount(where, (part[:, :, k] @ to_nodes.T).ravel(), minlength=size)
                for k in range(part.shape[2])
            ])  # fmt: skip
        return np.asarray(total / np.bincount(self.table.ravel(), minlength=size)[:, None])


def split(grid: Grid, table: np.ndarray, surfaces: Sequence[np.ndarray]) -> SplitGrid:
    """Split a grid at the faces between its regions and at some surfaces.

    Parameters
    ----------
    grid
        The device's grid.
    table
        Its nodes in each cell, in basix's order, shape (cells, nodes of a cell).
    surfaces
        Of each surface the nodes of its facets, in any order, shape (facets, nodes of a facet).
    """
    _, closure = facet_nodes(grid.kind, grid.degree)
    faces = np.sort(table[:, closure], axis=2).reshape(-1, closure.shape[1])
    order, twins = _twins(faces)
    first, second = order[:-1][twins], order[1:][twins]
    of_cell = np.repeat(np.arange(len(table)), len(closure))
    tags = grid.regions[of_cell]
    jumps = (tags[first] != tags[second]) | _among(faces[first], surfaces)
    corners = table.ravel()
    suspect = np.zeros(len(grid.points), dtype=bool)
    suspect[faces[first[jumps]].ravel()] = True
    chosen = np.flatnonzero(suspect[corners])
    if len(chosen) == 0:
        return SplitGrid(grid, np.arange(len(grid.points)), table)
    # The corners of cells at such a node are one node where faces without a jump join the cells.
    links = (first[~jumps], second[~jumps])
    ends = [_corners_of(side, table, closure) for side in links]
    kept = suspect[corners[ends[0]]]
    place = np.full(len(corners), -1)
    place[chosen] = np.arange(len(chosen))
    pair = place[ends[0][kept]], place[ends[1][kept]]
    graph = sparse.coo_array((np.ones(len(pair[0]), dtype=bool), pair), shape=(len(chosen),) * 2)
    _, part = csgraph.connected_components(graph, directed=False)
    numbers = corners.copy()
    numbers[chosen] = len(grid.points) + part
    return _numbered(grid, table, numbers.reshape(table.shape))


def _twins(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """An order of faces in which equal ones follow one another, and where the next one is equal."""
    order = np.lexsort(faces.T[::-1])
    ordered = faces[order]
    return order, (ordered[1:] == ordered[:-1]).all(axis=1)


def _among(faces: np.ndarray, surfaces: Sequence[np.ndarray]) -> np.ndarray:
    """Whether each face, its nodes in order, belongs to one of some surfaces."""
    if not surfaces or len(faces) == 0:
        return np.zeros(len(faces), dtype=bool)
    wanted = np.unique(np.sort(np.vstack(surfaces), axis=1), axis=0)
    order, twins = _twins(np.vstack([wanted, faces]))
    # each face is there once, and a wanted one comes before it, because the order is stable
    found = order[1:][twins] - len(wanted)
    among = np.zeros(len(faces), dtype=bool)
    among[found] = True
    return among


def _corners_of(
    rows: np.ndarray, table: np.ndarray, closure: np.ndarray
) -> np.ndarray:
    """Places in the flat table of nodes of all nodes of some faces, by ascending nodes."""
    cell, facet = np.divmod(rows, len(closure))
    local = closure[facet]
    order = np.argsort(table[cell[:, None], local], axis=1)
    return (cell[:, None] * table.shape[1] + np.take_along_axis(local, order, axis=1)).ravel()


def _numbered(grid: Grid, table: np.ndarray, numbers: np.ndarray) -> SplitGrid:
    """The grid whose nodes have been given other numbers, counted by their first appearance."""
    _, first, inverse = np.unique(numbers.ravel(), return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    own = rank[inverse].reshape(table.shape)
    origin = table.ravel()[first[order]]
    vtk_order = BY_DEGREE[grid.degree][grid.kind].vtk_order
    made = Grid(
        grid.points[origin], own[:, vtk_order], grid.kind, grid.regions, grid.degree, grid.names,
        grid.axes,
    )  # fmt: skip
    return SplitGrid(made, origin, own)


def count_is_small(nodes: int) -> bool:
    """Whether a grid of so many nodes gets fields at its nodes."""
    return nodes <= MOST_NODES
