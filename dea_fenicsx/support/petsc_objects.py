"""PETSc objects that live as long as their owner, and are destroyed on all ranks together.

To destroy a PETSc object is collective, but Python lets go of an object on each rank at a time of
its own.  So petsc4py destroys nothing that several ranks share when Python lets go of it.  It only
notes it, and so the object would stay until the program ends, with its memory and its communicators
(of which MPICH has 2048).  Therefore each owner of PETSc objects keeps them in a `PetscObjects`.
When the owner is gone, its objects wait until it is gone on all ranks.  They are then destroyed at
the next collective place, which is where other objects find an owner.
"""

from __future__ import annotations

import weakref
from typing import Any, Protocol

from mpi4py import MPI


class Destructible(Protocol):
    """What can be destroyed, and does nothing if this has been done before."""

    def destroy(self) -> Any: ...


type _Key = tuple[tuple[int, ...], int]
"""The ranks of an owner in the world, and its number, which is the same on all of them."""

_next_number = 0
_waiting: dict[_Key, dict[str, Destructible]] = {}


class PetscObjects:
    """The PETSc objects of one owner by name.  Collective.

    None of them may refer to the owner, which would otherwise never be gone.

    Parameters
    ----------
    comm
        The ranks that share the objects.
    """

    def __init__(self, comm: MPI.Comm) -> None:
        self._objects: dict[str, Destructible] = {}
        if comm.size == 1:
            return  # petsc4py destroys what is on one rank alone at once
        key = _agreed(comm)
        done = weakref.finalize(self, _waiting.__setitem__, key, self._objects)
        done.atexit = False

    def keep[T: Destructible](self, name: str, thing: T) -> T:
        """Keep an object, and return it.  Whoever replaces an object destroys the earlier one."""
        self._objects[name] = thing
        return thing


def _agreed(comm: MPI.Comm) -> _Key:
    """A new key, the same on all ranks; destroys what is gone on all ranks on the way."""
    global _next_number
    everyone = comm.allgather((MPI.COMM_WORLD.rank, _next_number, list(_waiting)))
    ranks = tuple(rank for rank, _, _ in everyone)
    number = max(number for _, number, _ in everyone)
    _next_number = number + 1
    reports: dict[_Key, int] = {}
    for _, _, keys in everyone:
        for key in keys:
            reports[key] = reports.get(key, 0) + 1
    for key in sorted(key for key, count in reports.items() if count == len(key[0])):
        for thing in _waiting.pop(key).values():
            thing.destroy()
    return ranks, number
