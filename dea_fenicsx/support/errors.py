"""The errors of the package, each with its exit status.

Every message is one sentence: what is wrong, where, and what would be right.  Errors are raised on
all ranks together, so that no rank is left waiting; only rank 0 prints.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from types import CodeType, TracebackType
from typing import Any, NamedTuple


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
    ramps
        Names of the ramps that moved; empty where a trace was lost, or a part was crushed, which
        is no limit point.
    """

    exit_status = 3
    reached: dict[str, float]
    failed: dict[str, float]
    ramps: tuple[str, ...] = ()


class StabilityLost(EquilibriumLost):
    """A ramp with ``at_loss="unstable"`` has come to states at which no device rests.

    The branch goes on, but its equilibria are not stable.
    """


class NotReached(PathError):
    """A trace used up its steps before the value at which it was to end."""

    exit_status = 6


class SolverError(PathError):
    """The numerical method failed.  This does not show an instability of the device."""

    exit_status = 4


class MachineError(PathError):
    """The machine failed, not the device: a full disk, a folder taken away, no compiler."""

    exit_status = 5


class Interrupted(PathError):
    """The user has interrupted the run; all completed steps are on disk."""

    exit_status = 130


GRACE_S = 3.0
"""Seconds that a failing rank waits to hear whether the other ranks fail with it."""

EXIT_GRACE_S = 10.0
"""Seconds that a rank which ends by ``sys.exit`` waits for the others, which may only be slower."""

_TAG = 31_999
_LEFT = 31_998
"""Tags of the notes of a rank that fails, and of one that ends its script without an error."""


def install_hook() -> None:
    """Make an uncaught error end all ranks, with one message.

    Called by the first collective calls of the package (`device`, `solve`, `design.optimise`),
    by `Parser` and by the commands; importing the package does not call it.  A second call changes
    nothing.

    A `DeaError` is told in one sentence and ends with its exit status; with ``--debug`` on the
    command line the traceback is shown instead.  Every other exception is passed on to the hook
    that was there before.  As a rule all ranks raise together, and the lowest one speaks.  A rank
    that fails alone waits for a moment, speaks, and ends the others, which would wait for it for
    ever.  The same holds for a rank that ends by ``sys.exit`` with an error.
    A rank that ends by ``sys.exit`` without an error is waited for by none and ends none; but the
    package's collective calls on the other ranks end with one sentence, see `agreement.complete`.

    Nothing is installed in an interactive interpreter or a notebook.  On a single rank a hook that
    the application has installed before stays in its place.
    """
    if _interactive() or getattr(sys.excepthook, "ends_all_ranks", False):
        return
    previous = sys.excepthook
    if _world() is None and previous is not sys.__excepthook__:
        return

    def hook(
        kind: type[BaseException], error: BaseException, trace: TracebackType | None
    ) -> None:
        world = _world()
        if world is None and not isinstance(error, DeaError | KeyboardInterrupt):
            previous(kind, error, trace)
            return
        status = getattr(error, "exit_status", 130 if isinstance(error, KeyboardInterrupt) else 1)
        if world is None:
            _tell(previous, kind, error, trace, "")
        else:
            end = _agree(world, GRACE_S, getattr(error, "failed_rank", None))
            if end.speaks:
                alone = f" on rank {world.rank} alone" if end.alone else ""
                alone = "" if getattr(error, "of_another", False) else alone
                _tell(previous, kind, error, trace, alone)
            if not end.together:
                _end_all(world, end.speaks, GRACE_S, status)
        _ended.append(status)
        raise SystemExit(status)

    hook.ends_all_ranks = True  # type: ignore[attr-defined]
    sys.excepthook = hook
    _watch_exit()


_ended: list[object] = []
"""Holds the exit status once this rank has agreed with the others about its end."""


def _interactive() -> bool:
    """Whether a person types into this process: an interpreter's prompt, IPython or a notebook."""
    if hasattr(sys, "ps1") or sys.flags.interactive or sys.flags.inspect:
        return True
    shell = getattr(sys.modules.get("IPython"), "get_ipython", None)
    return shell is not None and shell() is not None


def _watch_exit() -> None:
    """Make ``sys.exit`` with an error, on one rank alone, end all ranks with one message.

    Python calls no hook for `SystemExit`, and what is registered with `atexit` comes too late:
    petsc4py registers there a clean-up that waits for all ranks.  So Python's monitoring tells of
    each frame that an exception leaves; only the outermost one means that the process ends.  This
    costs nothing while no exception is under way.
    """
    monitoring = sys.monitoring
    free = [tool for tool in (4, 3) if monitoring.get_tool(tool) is None]
    if not free:
        return
    event = monitoring.events.PY_UNWIND
    monitoring.use_tool_id(free[0], "dea_fenicsx")
    monitoring.register_callback(free[0], event, _unwound)
    monitoring.set_events(free[0], event)


def _unwound(code: CodeType, offset: int, error: BaseException) -> None:
    """Called by Python when an exception has left a frame."""
    if not isinstance(error, SystemExit) or sys._getframe(1).f_back is not None or _ended:
        return
    world = _world()
    given = error.code
    if world is None or threading.current_thread() is not threading.main_thread():
        return
    _ended.append(given)
    if given is None or (isinstance(given, int) and given == 0):
        _agree(world, GRACE_S, tag=_LEFT)  # MPI's own end waits for slower ranks
        return
    end = _agree(world, EXIT_GRACE_S)
    if end.together:
        return
    # the system keeps eight bits of a status, and an error must not look like a success
    status = (given & 0xFF) or 1 if isinstance(given, int) else 1
    error.code = status
    if end.speaks:
        if not isinstance(given, int):
            print(given, file=sys.stderr)  # Python itself would print it too late
        print(f"Error on rank {world.rank} alone: the script has ended by sys.exit; all ranks "
              "are ended.", file=sys.stderr, flush=True)  # fmt: skip
    _end_all(world, end.speaks, EXIT_GRACE_S, status)


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
        # A name from a file may contain control sequences of the terminal.
        told = "".join(c if c.isprintable() else " " for c in str(error))
        print(f"Error{alone}: {told}", file=sys.stderr)
    sys.stderr.flush()


def _end_all(world: Any, speaks: bool, seconds: float, status: int) -> None:
    """End all ranks from one that fails and has waited some seconds for the others."""
    with suppress(OSError, ValueError):
        sys.stdout.flush()
    # the speaker ends this rank too; and its launcher must pass on what it has said
    time.sleep(0.5 if speaks else seconds + 0.5)
    world.Abort(status)


def _world() -> Any:
    """All ranks, if there are several and MPI is running."""
    mpi = sys.modules.get("mpi4py.MPI")
    if mpi is None or not mpi.Is_initialized() or mpi.Is_finalized():
        return None
    return mpi.COMM_WORLD if mpi.COMM_WORLD.size > 1 else None


class _End(NamedTuple):
    """How the ranks end: whether this rank speaks, whether all fail, whether one is to blame."""

    speaks: bool
    together: bool
    alone: bool


def rank_that_left(comm: Any) -> int | None:
    """The rank of the job that has ended its script without an error, if it is one of `comm`.

    Each such rank has sent a note to all others.  The note is not taken out of the queue: this rank
    may still end its script, too.  Nothing here is collective.
    """
    mpi = sys.modules["mpi4py.MPI"]
    world = mpi.COMM_WORLD
    for rank in range(world.size):
        if rank != world.rank and world.iprobe(source=rank, tag=_LEFT):
            group, everyone = comm.Get_group(), world.Get_group()
            (here,) = mpi.Group.Translate_ranks(everyone, [rank], group)
            group.Free()
            everyone.Free()
            if here != mpi.UNDEFINED:
                return rank
    return None


def _agree(
    world: Any, seconds: float, source: int | None = None, tag: int = _TAG
) -> _End:
    """Find out whether the other ranks fail, too, and which of them speaks.

    Each rank that fails tells all others so, and listens for some seconds; a rank that goes on
    working says nothing.  The lowest rank speaks, unless the ranks have failed because of what one
    of them met: then it is that one, whose number each rank gives as `source`.
    """
    mpi = sys.modules["mpi4py.MPI"]
    others = [rank for rank in range(world.size) if rank != world.rank]
    mine = world.rank if source is None else source
    sent = [world.isend(mine, dest=rank, tag=tag) for rank in others]
    failed = {world.rank: mine}
    status = mpi.Status()
    end = time.monotonic() + seconds
    while len(failed) < world.size and time.monotonic() < end:
        if world.iprobe(tag=tag, status=status):
            told = world.recv(source=status.Get_source(), tag=tag)
            failed[status.Get_source()] = told
        else:
            time.sleep(0.01)
    together = len(failed) == world.size
    if together:
        mpi.Request.waitall(sent)
    speaker = min(failed.values())
    alone = not together or any(told != rank for rank, told in failed.items())
    return _End(world.rank == (speaker if speaker in failed else min(failed)), together, alone)
