"""Rows of tables by the order of the mesh file: each rank holds one block of them.

The partition of a mesh depends on the number of ranks; what is written must not.  So values of
cells go to the rank that holds the block of the cell's number, and the nodes of a grid are numbered
by their first appearance in these blocks.  No rank holds more than its own block.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI


class Exchange:
    """Sends one row of values to a rank for each of some requests, and answers back.  Collective.

    Parameters
    ----------
    comm
        The communicator.
    owner
        The rank to which each request goes, shape (n,).
    """

    def __init__(self, comm: MPI.Comm, owner: np.ndarray) -> None:
        self.comm = comm
        self._order = np.argsort(owner, kind="stable")
        self._given = np.bincount(owner, minlength=comm.size).astype(np.int64)
        self._taken = np.empty_like(self._given)
        comm.Alltoall(self._given, self._taken)

    def forward(self, values: np.ndarray) -> np.ndarray:
        """The rows that came for this rank, sorted by the rank that sent them."""
        return self._moved(values[self._order], self._given, self._taken)

    def answer(self, values: np.ndarray) -> np.ndarray:
        """What the owners say to each request, by rows as `forward` gave them to the owners."""
        found = self._moved(values, self._taken, self._given)
        back = np.empty_like(found)
        back[self._order] = found
        return back

    def _moved(self, values: np.ndarray, given: np.ndarray, taken: np.ndarray) -> np.ndarray:
        values = np.ascontiguousarray(values)
        out = np.empty((int(taken.sum()), *values.shape[1:]), dtype=values.dtype)
        wide = int(np.prod(values.shape[1:], dtype=np.int64))
        sides = [
            (counts * wide, np.concatenate([[0], np.cumsum(counts * wide)[:-1]]))
            for counts in (given, taken)
        ]
        self.comm.Alltoallv([values, sides[0]], [out, sides[1]])
        return out


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
            every = np.sort(np.concatenate(comm.allgather(original)))
            original = np.searchsorted(every, original)
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
