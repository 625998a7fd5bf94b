"""What can go wrong, each with its exit status.

Every message is one sentence: what is wrong, where, and what would be right.  Errors are raised on
all ranks together, so that no rank is left waiting; only rank 0 prints.
"""

from __future__ import annotations

import atexit
import sys
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any, NoReturn


class DeaError(Exception):
    """Base of all errors that are meant for the user."""

    exit_status = 1


class InputError(DeaError, ValueError):
    """The user's input cannot be used; nothing was computed and nothing on disk was touched."""

    exit_status = 2


class PathError(DeaError):
    """The path could not be followed to its end.

    Attributes
    ----------
    run
        The run up to its last accepted step.
    """

    run: Any = None


class EquilibriumLost(PathError):
    """No equilibrium was found beyond a load: pull-in, as a rule.

    All steps up to the last converged one are on disk.

    Attributes
    ----------
    reached, failed
        Ramp factors of the last accepted state and of the last trial: the critical load lies
        between them.
    """

    exit_status = 3
    reached: dict[str, float]
    failed: dict[str, float]


class SolverError(PathError):
    """The numerics failed in a way that says nothing about the device."""

    exit_status = 4


class MachineError(PathError):
    """The machine failed, not the device: a full disk, a folder taken away, no compiler."""

    exit_status = 5


class Interrupted(PathError):
    """The user has interrupted the run; all completed steps are on disk."""

    exit_status = 130


GRACE_S = 3.0
"""How long a rank that fails waits to hear whether the others fail with it."""

EXIT_GRACE_S = 10.0
"""The same for one that calls ``sys.exit``, which may be caught: then the others only are slow."""

_TAG = 31_999


def install_hook() -> None:
    """Make an uncaught error end all ranks, with one message.

    A `DeaError` is told in one sentence and ends with its exit status; with ``--debug`` on the
    command line, and for any other exception, the traceback is shown.  As a rule all ranks raise
    together, and the lowest one speaks.  A rank that fails alone waits for a moment, speaks, and
    ends the others, which would wait for it for ever.
    """
    _watch_exit()
    previous = sys.excepthook

    def hook(
        kind: type[BaseException], error: BaseException, trace: TracebackType | None
    ) -> None:
        world = _world()
        speaks, together = (True, True) if world is None else _agree(world, GRACE_S)
        status = getattr(error, "exit_status", 130 if isinstance(error, KeyboardInterrupt) else 1)
        if speaks:
            alone = "" if world is None or together else f" on rank {world.rank} alone"
            _tell(previous, kind, error, trace, alone)
        if world is not None and not together:
            _end_all(world, speaks, GRACE_S, status)
        raise SystemExit(status)

    sys.excepthook = hook


def _watch_exit() -> None:
    """Make ``sys.exit`` with an error, on one rank alone, end all ranks with one message.

    No hook of Python's is called for it, so the call itself is noted.
    """
    leave = sys.exit
    if getattr(leave, "noted", False):
        return
    noted: list[object] = []

    def exit_noted(status: Any = None, /) -> NoReturn:
        noted[:] = [status]
        leave(status)

    exit_noted.noted = True  # type: ignore[attr-defined]
    sys.exit = exit_noted

    def last() -> None:
        world = _world()
        status = noted[0] if noted else None
        if not status or world is None:
            return
        speaks, together = _agree(world, EXIT_GRACE_S)
        if together:
            return
        if speaks:
            print(f"Error on rank {world.rank} alone: the script has ended by sys.exit; all ranks "
                  "are ended.", file=sys.stderr, flush=True)  # fmt: skip
        _end_all(world, speaks, EXIT_GRACE_S, status if isinstance(status, int) else 1)

    atexit.register(last)


def _tell(
    previous: Callable[..., Any],
    kind: type[BaseException],
    error: BaseException,
    trace: TracebackType | None,
    alone: str,
) -> None:
    """Print what happened: a sentence, or a traceback."""
    debug = "--debug" in sys.argv
    if debug or not isinstance(error, DeaError | KeyboardInterrupt):
        previous(kind, error, trace)
        if alone:
            print(f"Error{alone}: all ranks are ended.", file=sys.stderr)
    elif isinstance(error, KeyboardInterrupt):
        print("Interrupted.", file=sys.stderr)
    else:
        # a name from a file must not tell the terminal what to do
        told = "".join(c if c.isprintable() else " " for c in str(error))
        print(f"Error{alone}: {told}", file=sys.stderr)
    sys.stderr.flush()


def _end_all(world: Any, speaks: bool, seconds: float, status: int) -> None:
    """End all ranks from one that fails and has waited some seconds for the others."""
    # the speaker ends this rank too; and its launcher must pass on what it has said
    time.sleep(0.5 if speaks else seconds + 0.5)
    world.Abort(status)


def _world() -> Any:
    """All ranks, if there are several and MPI is running."""
    mpi = sys.modules.get("mpi4py.MPI")
    if mpi is None or not mpi.Is_initialized() or mpi.Is_finalized():
        return None
    return mpi.COMM_WORLD if mpi.COMM_WORLD.size > 1 else None


def _agree(world: Any, seconds: float) -> tuple[bool, bool]:
    """Whether this rank is to speak, and whether all ranks have failed.

    Each rank that fails tells all others so, and listens for some seconds; a rank that goes on
    working says nothing.
    """
    mpi = sys.modules["mpi4py.MPI"]
    others = [rank for rank in range(world.size) if rank != world.rank]
    sent = [world.isend(None, dest=rank, tag=_TAG) for rank in others]
    failed = {world.rank}
    status = mpi.Status()
    end = time.monotonic() + seconds
    while len(failed) < world.size and time.monotonic() < end:
        if world.iprobe(tag=_TAG, status=status):
            world.recv(source=status.Get_source(), tag=_TAG)
            failed.add(status.Get_source())
        else:
            time.sleep(0.01)
    together = len(failed) == world.size
    if together:
        mpi.Request.waitall(sent)
    return world.rank == min(failed), together
