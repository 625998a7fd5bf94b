"""Agreement of all ranks: calls that may fail on one of them, and input that must be equal.

A collective call waits for every rank.  So an error that one rank meets alone, or a script that
gives each rank another input, would leave the ranks waiting for each other for ever.  The functions
here make such a difference an error on all ranks.
"""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import PurePath
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.support import errors
from dea_fenicsx.support.errors import DeaError, InputError, SolverError

RANK_TOLERANCE = 1e-6
"""Largest relative difference of an observable between two ranks that may be a rounding error."""


class OtherRankFailed(DeaError):
    """Another rank has met an error in a call that all ranks make together.

    Attributes
    ----------
    failed_rank
        Number of that rank among all ranks of the job; it tells its own error.
    """

    failed_rank: int


class RankLeft(DeaError):
    """Another rank has ended its script without an error, so a collective call cannot end."""

    of_another = True
    """The cause lies on another rank, whichever rank tells of it."""


def complete(comm: MPI.Comm, request: MPI.Request) -> None:
    """Wait until all ranks have joined a collective call that was begun.

    If a rank has ended its script after its part of the call, the call completes within moments.
    So a call that does not complete within `errors.GRACE_S` after a rank has ended never will.

    Parameters
    ----------
    comm
        The ranks of the call.
    request
        The call.

    Raises
    ------
    RankLeft
        If one of the ranks has ended its script without an error and did not join the call.
    """
    begun = time.monotonic()
    while not request.Test():
        rank = errors.rank_that_left(comm)
        if rank is not None and not _arrives(request, errors.GRACE_S):
            raise RankLeft(f"Rank {rank} has ended its script, so the others cannot go on.")
        if time.monotonic() > begun + 1e-3:
            time.sleep(1e-3)


def before_petsc() -> None:
    """Raise `RankLeft` if a rank has ended, before PETSc starts and waits for all ranks.

    Collective over all ranks of the job, as the start of PETSc is; where that has been, nothing is
    done.
    """
    if "petsc4py.PETSc" not in sys.modules and MPI.COMM_WORLD.size > 1:
        complete(MPI.COMM_WORLD, MPI.COMM_WORLD.Ibarrier())


def together[T](comm: MPI.Comm, action: Callable[[], T], what: str) -> T:
    """Run an action on every rank; if it fails on any of them, raise on all.  Collective.

    Parameters
    ----------
    comm
        The ranks.
    action
        What each rank does.
    what
        What the action is, for the message on the ranks that have not failed.

    Raises
    ------
    Exception
        On a rank whose action has failed: its own error.  On the other ranks: the same kind of
        `DeaError` if it is one, else `OtherRankFailed`.
    """
    fault: Exception | None = None
    raised: DeaError | None = None
    result: Any = None
    try:
        result = action()
    except Exception as error:
        fault = error
    try:
        if comm.size > 1:
            failed = np.zeros(comm.size, dtype=np.int32)
            request = comm.Iallgather(np.array([fault is not None], dtype=np.int32), failed)
            if fault is not None and not _arrives(request, errors.GRACE_S):
                raise fault  # the others wait in another collective call: they have to be ended
            complete(comm, request)
            if failed.any():
                raised = _from_rank(comm, int(np.flatnonzero(failed)[0]), fault, what)
                raise fault or raised
        if fault is not None:
            raise fault
        return result
    finally:
        fault = raised = None  # its traceback holds these variables: a cycle of references


def _arrives(request: MPI.Request, seconds: float) -> bool:
    """Whether a collective call that was begun is joined by all ranks within some seconds."""
    end = time.monotonic() + seconds
    while not request.Test():
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


def _from_rank(comm: MPI.Comm, first: int, fault: Exception | None, what: str) -> DeaError:
    """The error of ranks that have none themselves, for the first one that has.  Collective."""
    told = None
    if comm.rank == first:
        kind = type(fault) if isinstance(fault, DeaError) else OtherRankFailed
        world = MPI.COMM_WORLD.rank
        text = str(fault) if isinstance(fault, DeaError) else (
            f"{what} failed on rank {world} ({type(fault).__name__}: {fault})."
        )
        told = kind, text, world
    kind, text, world = comm.bcast(told, root=first)
    error = kind(text)
    error.failed_rank = world
    return error


def bind_alike(problem: Any, name: str, observable: Any) -> Callable[[], float]:
    """Bind an observable to a problem; one of the user's own is made to be the same on all ranks.

    Collective, and so is what it returns.  The package's own observables are so by themselves.
    """
    if type(observable).__module__.startswith("dea_fenicsx."):
        return observable.bind(problem)
    what = f"What is recorded as {name!r}"
    measure = together(problem.comm, lambda: observable.bind(problem), what)
    return measured_alike(problem.comm, name, measure)


def measured_alike(
    comm: MPI.Comm, name: str, measure: Callable[[], float]
) -> Callable[[], float]:
    """A user's measurement, made so that all ranks get the same value or the same error.

    What is measured decides where a trace ends and whether a step is accepted, so the ranks must
    not differ in it.  Where they differ by rounding, the value of rank 0 counts.

    Returns
    -------
    callable
        Collective.  It raises `SolverError` on all ranks where the values differ or are no numbers,
        and what `together` raises where the measurement fails.
    """

    def value() -> float:
        mine = together(comm, measure, f"What is recorded as {name!r}")
        number = _number(mine)
        numbers = comm.allgather(number)
        faulty = [rank for rank, one in enumerate(numbers) if one is None]
        if faulty:
            given = comm.bcast(_told(mine), root=faulty[0])
            where = f" on rank {faulty[0]}" if comm.size > 1 else ""
            raise SolverError(
                f"What is recorded as {name!r} is {given}{where}, but must be a number."
            )
        first = numbers[0]
        for rank, other in enumerate(numbers):
            if not _equal(first, other):
                raise SolverError(
                    f"What is recorded as {name!r} is {first:.6g} on rank 0, but {other:.6g} on "
                    f"rank {rank}; a value must be the same on all ranks, so combine what they "
                    "measure with comm.allreduce, or send that of one rank with comm.bcast."
                )
        return first

    return value


def _number(value: Any) -> float | None:
    """A value as a number, or None if it is none; an array with a single entry is one."""
    if isinstance(value, str | bytes) or np.size(value) != 1 or np.ma.is_masked(value):
        return None
    try:
        return float(np.asarray(value).item())
    except (TypeError, ValueError, OverflowError):  # the last one: a whole number above 1e308
        return None


def _told(value: Any) -> str:
    """A value for a message, not too long; its type where it cannot be printed."""
    try:
        return repr(value)[:60]
    except Exception:  # Python does not print whole numbers of thousands of digits
        return f"of type {type(value).__name__}"


def _equal(a: float, b: float) -> bool:
    """Whether two values are the same but for rounding; two that are not numbers are."""
    if np.isfinite(a) and np.isfinite(b):
        return abs(a - b) <= RANK_TOLERANCE * max(abs(a), abs(b))
    return a == b or bool(np.isnan(a) and np.isnan(b))


def check_same(comm: MPI.Comm, facts: Mapping[str, Any]) -> None:
    """Raise InputError on all ranks unless all have been given the same input.  Collective.

    Parameters
    ----------
    comm
        The ranks.
    facts
        Input by its name, as it shall be called in the message.  Numbers are compared to the last
        bit, since ranks that differ in one may take different ways.  Mappings are compared in their
        order, in which collective calls follow one another.  Of an object that is no dataclass only
        the type counts.

    Raises
    ------
    InputError
        Naming the input and the ranks that differ.
    RankLeft
        If a rank has ended its script without an error.
    """
    if comm.size == 1:
        return
    complete(comm, comm.Ibarrier())
    mine = {name: _in_words(value) for name, value in facts.items()}
    everyone = comm.allgather(mine)
    for name in everyone[0]:
        for rank, theirs in enumerate(everyone):
            if theirs[name] != everyone[0][name]:
                a, b = _difference(everyone[0][name], theirs[name])
                raise InputError(
                    f"The ranks of this run have been given different input: {name} has {a} on "
                    f"rank 0, but {b} on rank {rank}; give all ranks the same, in the same order "
                    "(a set has another order on each of them)."
                )


def _in_words(value: Any) -> str:
    """Input as text that is the same on all ranks where the input is."""
    if is_dataclass(value) and not isinstance(value, type):
        inner = ", ".join(f"{f.name}={_in_words(getattr(value, f.name))}" for f in fields(value))
        return f"{type(value).__name__}({inner})"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k!r}: {_in_words(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_in_words, value)) + "]"
    if isinstance(value, np.ndarray):
        return _in_words(value.tolist())
    plain = str | bytes | bool | int | float | np.generic | PurePath
    if value is None or isinstance(value, plain):
        return repr(value)
    return type(value).__name__


def _difference(a: str, b: str) -> tuple[str, str]:
    """The first part between commas or brackets in which two texts differ."""
    first = next((k for k, (x, y) in enumerate(zip(a, b, strict=False)) if x != y),
                 min(len(a), len(b)))  # fmt: skip
    start = max(a.rfind(sign, 0, first) for sign in "([{ ") + 1
    parts = [re.match(r"[^,()\[\]{}]*", text[start:]) for text in (a, b)]
    shown = [part[0][:60] if part else "" for part in parts]
    return shown[0] or "nothing", shown[1] or "nothing"
