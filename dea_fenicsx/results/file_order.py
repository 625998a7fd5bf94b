"""Rows of tables by the order of the mesh file: each rank holds one block of them.

The partition of a mesh depends on the number of ranks; what is written must not.  So values of
cells go to the rank that holds the block of the cell's number, and the nodes of a grid are numbered
by their first appearance in these blocks.  No rank holds more than its own block.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from dea_fenicsx.support.exchange import Exchange


class FileOrder:
    """Moves values of cells into the order of the mesh file, and back.  Collective.

    Parameters
    ----------
    comm
        The communicator.
    original
        Number of each owned cell in the mesh file, shape (n,).

    Attributes
    ----------
    count : number of cells of all ranks
    start : number of the first cell of this rank's block
    places : number of each owned cell in the order, counted without gaps
    """

    def __init__(self, comm: MPI.Comm, original: np.ndarray) -> None:
        self.count = int(comm.allreduce(len(original), op=MPI.SUM))
        last = comm.allreduce(int(original.max(initial=-1)), op=MPI.MAX)
        if last != self.count - 1:  # a part of another mesh, which has kept its numbers there
            original = _without_gaps(comm, np.asarray(original, dtype=np.int64))
        self.places = np.asarray(original, dtype=np.int64)
        ends = self.count * np.arange(comm.size + 1) // comm.size
        self.start = int(ends[comm.rank])
        self._exchange = Exchange(comm, np.searchsorted(ends, self.places, "right") - 1)
        self._place = self._exchange.forward(self.places) - self.start

    def rows(self, values: np.ndarray) -> np.ndarray:
        """The rows of this rank's block, from those of the owned cells of all ranks."""
        found = self._exchange.forward(values)
        block = np.empty_like(found)
        block[self._place] = found
        return block

    def back(self, block: np.ndarray) -> np.ndarray:
        """The rows of the owned cells, from the blocks of all ranks."""
        return self._exchange.answer(block[self._place])


def _without_gaps(comm: MPI.Comm, numbers: np.ndarray) -> np.ndarray:
    """Numbers, each once on all ranks, counted from 0 in their order.  Collective."""
    low = comm.allreduce(int(numbers.min(initial=np.iinfo(np.int64).max)), op=MPI.MIN)
    high = comm.allreduce(int(numbers.max(initial=-1)), op=MPI.MAX)
    asked = Exchange(comm, (numbers - low) * comm.size // (high - low + 1))
    there = asked.forward(numbers)
    found = np.empty_like(there)
    found[np.argsort(there)] = (comm.exscan(len(there)) or 0) + np.arange(len(there))
    return asked.answer(found)


def by_first_appearance(
    comm: MPI.Comm, table: np.ndarray, start: int
) -> tuple[np.ndarray, np.ndarray]:
    """Number nodes by their first appearance in the blocks of all ranks.  Collective.

    Parameters
    ----------
    comm
        The communicator.
    table
        Numbers of the nodes of the cells in this rank's block, the same on all ranks, shape
        (cells, nodes of a cell).
    start
        Number of the block's first cell.

    Returns
    -------
    ndarray of the shape of `table`, ndarray of shape (n,)
        The new numbers; and where in the flat table each node stands whose first appearance is in
        this block, in the order of the new numbers.
    """
    known, first, inverse = np.unique(table.ravel(), return_index=True, return_inverse=True)
    asked = Exchange(comm, known % comm.size)
    there = asked.forward(known)
    number, at = np.unique(there, return_inverse=True)
    places = asked.forward(first + start * table.shape[1])
    lowest = np.full(len(number), np.iinfo(np.int64).max)
    np.minimum.at(lowest, at, places)
    mine = np.flatnonzero(asked.answer(lowest[at] == places))
    mine = mine[np.argsort(first[mine])]

    fresh = np.full(len(known), -1, dtype=np.int64)
    fresh[mine] = (comm.exscan(len(mine)) or 0) + np.arange(len(mine))
    found = np.full(len(number), -1, dtype=np.int64)
    np.maximum.at(found, at, asked.forward(fresh))
    numbers = asked.answer(found[at])
    return numbers[inverse].reshape(table.shape), first[mine]
