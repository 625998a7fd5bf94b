"""Rows of numbers that go to the ranks that are asked for them, and answers that come back."""

from __future__ import annotations

from typing import Any

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


def ghosts_at_owners(imap: Any, comm: MPI.Comm, ghosts: np.ndarray, values: np.ndarray) -> Any:
    """What other ranks say of entities that this rank owns and they have as ghosts.  Collective.

    Parameters
    ----------
    imap, comm
        The index map of the entities, and its communicator.
    ghosts
        Which of the ghosts of this rank are spoken of, counted from 0, shape (n,).
    values
        One row for each of them, shape (n, ...).

    Returns
    -------
    local numbers of owned entities, shape (m,), and a row for each; from rank to rank
    """
    owners = np.asarray(imap.owners)[ghosts]
    exchange = Exchange(comm, owners)
    numbers = np.asarray(imap.ghosts)[ghosts]
    return exchange.forward(numbers) - imap.local_range[0], exchange.forward(values)
