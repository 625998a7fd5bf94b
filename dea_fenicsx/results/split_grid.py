"""The grid of a device with nodes of its own on each side of regions and of named surfaces.

Stress and electric field jump there.  Values at these nodes can be averages over cells without
smearing the jump, and take far less room than nodes of its own for each cell.

Each rank has a block of the cells in the order of the mesh file, and the nodes that appear first
there.  What two cells know of a face or of a node meets at a rank that its number names.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI

from dea_fenicsx.results.file_order import by_first_appearance
from dea_fenicsx.results.grids import Grid, facet_nodes
from dea_fenicsx.results.spread import Table
from dea_fenicsx.support.cell_types import CORNERS
from dea_fenicsx.support.exchange import Exchange
from dea_fenicsx.support.later import Later

csgraph = Later("scipy.sparse.csgraph")
sparse = Later("scipy.sparse")

MOST_NODES = 500_000
"""Nodes beyond which no fields at nodes are written: a step would take more than 40 MB of disk."""

JUMP = -1
"""What stands for the number of a face at which the grid is split."""


@dataclass(frozen=True)
class SplitGrid:
    """A split grid, for its file.

    Attributes
    ----------
    grid : the grid, with the cells of the device's grid in their order
    origin : table (nodes,), number of each node in the device's grid
    """

    grid: Grid
    origin: Table


class Block(NamedTuple):
    """What a rank has of the device's grid.

    Attributes
    ----------
    comm : the communicator
    kind, degree : of the cells
    table : nodes of the cells in this rank's block in basix's order, shape (cells, nodes)
    start : number of the first cell
    regions : tag of each cell's region, shape (cells,)
    nodes : how many nodes are this rank's; those of all ranks follow one another
    """

    comm: MPI.Comm
    kind: str
    degree: int
    table: np.ndarray
    start: int
    regions: np.ndarray
    nodes: int


class SplitNodes:
    """The nodes of the split grid in each rank's block.  Collective.

    Parameters
    ----------
    block
        The cells and nodes of the device's grid.
    numbers
        A number for the node of each corner of the cells in the split grid, in the shape of
        `block.table`.

    Attributes
    ----------
    split : whether any node has become several
    table : nodes of the cells in the split grid, in basix's order
    cells : number in the block of the first cell of each of this rank's nodes, shape (n,)
    origin : number of each of this rank's nodes in the device's grid, shape (n,)
    """

    def __init__(self, block: Block, numbers: np.ndarray) -> None:
        comm = block.comm
        self.table, first = by_first_appearance(comm, numbers, block.start)
        self.cells = first // numbers.shape[1]
        self.origin = block.table.ravel()[first]
        self._count = len(first)
        ends, sources = _ends(comm, self._count), _ends(comm, block.nodes)
        self.split = bool(ends[-1] != sources[-1])
        flat, begin = self.table.ravel(), ends[comm.rank]
        self._mine = (flat >= begin) & (flat < ends[comm.rank + 1])
        away = flat[~self._mine]
        self._others = Exchange(comm, np.searchsorted(ends, away, "right") - 1)
        self._nodes = np.concatenate([flat[self._mine], self._others.forward(away)]) - begin
        self._sizes = np.bincount(self._nodes, minlength=self._count)
        self._source = Exchange(comm, np.searchsorted(sources, self.origin, "right") - 1)
        self._rows = self._source.forward(self.origin) - sources[comm.rank]

    def taken(self, field: np.ndarray) -> np.ndarray:
        """Values at this rank's nodes, from those of its block of the device's grid."""
        return self._source.answer(field[self._rows])

    def averages(self, inner: np.ndarray, to_nodes: np.ndarray) -> np.ndarray:
        """Values at this rank's nodes: means over the cells that have the node.  Collective.

        The terms are added in the order of the cells, so that sums do not depend on the ranks.

        Parameters
        ----------
        inner
            Values at the inner points of each cell of the block, shape (cells, points, numbers).
        to_nodes
            Matrix from them to the nodes of a cell, in basix's order, shape (nodes, points).

        Returns
        -------
        ndarray of shape (n, numbers)
        """
        found = np.empty((self._count, inner.shape[2]))
        for k in range(inner.shape[2]):
            values = (inner[:, :, k] @ to_nodes.T).ravel()
            away = self._others.forward(values[~self._mine])
            terms = np.concatenate([values[self._mine], away])
            found[:, k] = np.bincount(self._nodes, terms, minlength=self._count)
        found /= self._sizes[:, None]
        return found


def split(block: Block, cut: np.ndarray) -> SplitNodes:
    """Split the nodes of a grid at the faces between its regions and at some more.  Collective.

    Parameters
    ----------
    block
        The cells and nodes of the grid.
    cut
        Whether the grid is split at each facet of the cells too, shape (cells, facets).  It is
        enough if one of the two cells at a facet says so.
    """
    comm, table = block.comm, block.table
    shape, closure = facet_nodes(block.kind, block.degree)
    faces = _faces(block, closure[:, : CORNERS[shape][1]], cut)
    at, numbers = np.unique(table.ravel(), return_inverse=True)
    jumps = np.zeros(len(at), dtype=bool)
    local = numbers.reshape(table.shape)
    jumps[local[:, closure][faces == JUMP]] = True
    suspect = _said_anywhere(comm, at, jumps)[local]
    found = table
    if comm.allreduce(bool(suspect.any()), op=MPI.LOR):
        count = _ends(comm, block.nodes)[-1]
        found = table.copy()
        found[suspect] = count + _parts(block, closure, faces, suspect)
    return SplitNodes(block, found)


def _ends(comm: MPI.Comm, count: int) -> np.ndarray:
    """Where the numbers of each rank begin, and behind them the sum of all.  Collective."""
    return np.concatenate([[0], np.cumsum(comm.allgather(count), dtype=np.int64)])


def _faces(block: Block, corners: np.ndarray, cut: np.ndarray) -> np.ndarray:
    """A number of each facet that its two cells have in common, and `JUMP` at a jump.  Collective.

    Parameters
    ----------
    block, cut
        As in `split`.
    corners
        Corners of a cell on each of its facets, shape (facets, corners).

    Returns
    -------
    ndarray of shape (cells, facets)
    """
    size = len(corners)
    faces = np.sort(block.table[:, corners], axis=2).reshape(-1, corners.shape[1])
    places = np.arange(len(faces)) + block.start * size
    told = np.column_stack([places, np.repeat(block.regions, size), cut.ravel()])
    asked = Exchange(block.comm, faces[:, 0] % block.comm.size)
    there, (place, region, chosen) = asked.forward(faces), asked.forward(told).T
    order = np.lexsort(there.T[::-1])
    twins = (there[order[1:]] == there[order[:-1]]).all(axis=1)
    first, second = order[:-1][twins], order[1:][twins]
    jumps = (region[first] != region[second]) | ((chosen[first] | chosen[second]) != 0)
    common = np.where(jumps, JUMP, np.minimum(place[first], place[second]))
    found = place.copy()
    found[first] = found[second] = common
    return asked.answer(found).reshape(cut.shape)


def _said_anywhere(comm: MPI.Comm, numbers: np.ndarray, said: np.ndarray) -> np.ndarray:
    """Whether any rank says something of each of some numbers, each once on a rank.  Collective."""
    asked = Exchange(comm, numbers % comm.size)
    _, at = np.unique(asked.forward(numbers), return_inverse=True)
    found = np.zeros(at.max(initial=-1) + 1, dtype=bool)
    found[at[asked.forward(said)]] = True
    return asked.answer(found[at])


def _parts(
    block: Block, closure: np.ndarray, faces: np.ndarray, suspect: np.ndarray
) -> np.ndarray:
    """A number for each suspect corner of cells, the same in all that are one node.  Collective.

    Corners of cells at the same place are one node where faces without a jump join the cells.

    Parameters
    ----------
    block
        The cells and nodes of the grid.
    closure
        Nodes of a cell on each of its facets, shape (facets, nodes).
    faces
        What `_faces` gave.
    suspect
        Which corners have a node at a jump, in the shape of `block.table`.

    Returns
    -------
    ndarray of shape (n,)
        Of each suspect corner the lowest one in the flat tables of all ranks that is one with it.
    """
    comm, nodes = block.comm, block.table
    places = np.arange(nodes.size).reshape(nodes.shape) + block.start * nodes.shape[1]
    corners = Exchange(comm, nodes[suspect] % comm.size)
    place = corners.forward(places[suspect])
    joined = suspect[:, closure] & (faces != JUMP)[:, :, None]
    node = nodes[:, closure][joined]
    face = np.broadcast_to(faces[:, :, None], joined.shape)[joined]
    links = Exchange(comm, node % comm.size)
    ends = links.forward(np.column_stack([places[:, closure][joined], node, face]))
    return corners.answer(_lowest(place, ends))


def _lowest(place: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """The lowest number among those that are linked.

    Parameters
    ----------
    place
        Numbers, each once, shape (n,).
    ends
        Rows of a number and two more; numbers whose other two are the same are linked.
    """
    if len(place) == 0:
        return place
    order = np.argsort(place)
    _, knot = np.unique(ends[:, 1:], axis=0, return_inverse=True)
    end = order[np.searchsorted(place, ends[:, 0], sorter=order)]
    size = len(place) + len(ends)
    graph = sparse.coo_array(
        (np.ones(len(ends), dtype=bool), (end, len(place) + knot.ravel())), shape=(size, size)
    )
    _, part = csgraph.connected_components(graph, directed=False)
    found: Any = np.full(size, np.iinfo(np.int64).max)
    np.minimum.at(found, part[: len(place)], place)
    return np.asarray(found[part[: len(place)]])


def count_is_small(nodes: int) -> bool:
    """Whether a grid of so many nodes gets fields at its nodes."""
    return nodes <= MOST_NODES
