"""Tables whose rows are spread over the ranks, and which rank 0 reads in pieces.

A file is written by rank 0.  A large table would not fit there, so that rank 0 asks the others for
pieces of a bounded size while they serve it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
from mpi4py import MPI

PIECE = 8_000_000
"""Most bytes of a piece."""

MOST_WHOLE = 20_000
"""Rows up to which a table is gathered on rank 0 as it is."""

_QUESTION, _ANSWER = 7101, 7102

_known: WeakValueDictionary[tuple[int, int], Spread] = WeakValueDictionary()
_served: set[int] = set()
_next_number = 0


class Spread:
    """A table of which each rank holds a block of rows, in the order of the ranks.  Collective.

    Rank 0 reads it like an array, by `pieces` or by numbers of rows, while it is `serving`.

    Parameters
    ----------
    comm
        The communicator.
    block
        The rows of this rank, shape (n, ...).
    """

    def __init__(self, comm: MPI.Comm, block: np.ndarray) -> None:
        global _next_number
        self.comm = comm
        self.block = np.ascontiguousarray(block)
        counts = comm.allgather(len(block))
        self._ends = np.concatenate([[0], np.cumsum(counts)])
        self.dtype = self.block.dtype
        self.shape = (int(self._ends[-1]), *block.shape[1:])
        if comm.rank == 0:
            _next_number += 1
        self._number = int(comm.bcast(_next_number, root=0))
        _known[comm.py2f(), self._number] = self

    @property
    def nbytes(self) -> int:
        """Bytes of the whole table."""
        return int(np.prod(self.shape, dtype=np.int64)) * self.dtype.itemsize

    def __len__(self) -> int:
        return self.shape[0]

    def pieces(self) -> Iterator[np.ndarray]:
        """The rows from first to last, on rank 0 while it is served."""
        wide = int(np.prod(self.shape[1:], dtype=np.int64)) * self.dtype.itemsize
        most = max(1, PIECE // max(wide, 1))
        for rank in range(self.comm.size):
            count = int(self._ends[rank + 1] - self._ends[rank])
            for start in range(0, count, most):
                yield self._ask(rank, slice(start, min(start + most, count)))

    def __getitem__(self, rows: np.ndarray) -> np.ndarray:
        """Some rows by their numbers, which may have any shape, on rank 0 while it is served."""
        found = np.empty((*rows.shape, *self.shape[1:]), dtype=self.dtype)
        for rank in range(self.comm.size):
            here = (rows >= self._ends[rank]) & (rows < self._ends[rank + 1])
            if here.any():
                found[here] = self._ask(rank, rows[here] - self._ends[rank])
        return found

    def _ask(self, rank: int, rows: Any) -> np.ndarray:
        if rank == 0:
            return self.block[rows]
        if self.comm.py2f() not in _served:
            raise RuntimeError("A spread table was read while the other ranks serve nobody.")
        self.comm.send((self._number, rows), dest=rank, tag=_QUESTION)
        length = rows.stop - rows.start if isinstance(rows, slice) else len(rows)
        found = np.empty((length, *self.shape[1:]), dtype=self.dtype)
        self.comm.Recv(found, source=rank, tag=_ANSWER)
        return found


Table = np.ndarray | Spread
"""A table that rank 0 can read: an array, or one whose rows are spread over the ranks."""


def pieces(table: Table) -> Iterator[np.ndarray]:
    """The rows of a table from first to last; an array is one piece."""
    if isinstance(table, Spread):
        yield from table.pieces()
    else:
        yield table


def whole(table: Table) -> np.ndarray:
    """A table as one array on rank 0."""
    return np.concatenate(list(table.pieces())) if isinstance(table, Spread) else table


def collected(comm: MPI.Comm, block: np.ndarray, large: bool) -> Any:
    """The blocks of all ranks as a table.  Collective.

    Parameters
    ----------
    comm
        The communicator.
    block
        The rows of this rank.
    large
        Whether the table stays spread.  All ranks have it then; otherwise it is an array on rank
        0, and None on all others.
    """
    if large:
        return Spread(comm, block)
    if comm.size == 1:
        return block
    parts = comm.gather(block, root=0)
    return None if parts is None else np.concatenate(parts)


def dealt(comm: MPI.Comm, table: Table | None) -> np.ndarray:
    """This rank's block of a table, one of equal blocks in the order of the ranks.  Collective.

    Parameters
    ----------
    comm
        The communicator.
    table
        An array on rank 0, which counts there alone; or a spread one of as many ranks, by the same
        blocks.
    """
    if comm.bcast(isinstance(table, Spread), root=0):
        assert isinstance(table, Spread)
        return table.block
    shape = comm.bcast(None if table is None else (table.shape, table.dtype.char), root=0)
    (count, *wide), kind = shape
    ends = count * np.arange(comm.size + 1) // comm.size
    if comm.rank == 0:
        assert isinstance(table, np.ndarray)
        for rank in range(1, comm.size):
            comm.Send(np.ascontiguousarray(table[ends[rank] : ends[rank + 1]]), dest=rank)
        return table[: ends[1]]
    block = np.empty((ends[comm.rank + 1] - ends[comm.rank], *wide), dtype=kind)
    comm.Recv(block, source=0)
    return block


def serving(comm: MPI.Comm, action: Callable[[], Any]) -> Any:
    """Run an action on rank 0, while all others give it the pieces for which it asks.  Collective.

    Returns
    -------
    What the action returns, on rank 0; None on all others.  An error is raised on rank 0 alone.
    """
    if comm.size == 1:
        return action()
    place = comm.py2f()
    if comm.rank == 0:
        outer = place in _served
        _served.add(place)
        try:
            return action()
        finally:
            if not outer:
                _served.discard(place)
                for rank in range(1, comm.size):
                    comm.send(None, dest=rank, tag=_QUESTION)
    while (asked := comm.recv(source=0, tag=_QUESTION)) is not None:
        number, rows = asked
        comm.Send(_known[place, number].block[rows], dest=0, tag=_ANSWER)
    return None
