"""What can go wrong, each with its exit status.

Every message is one sentence: what is wrong, where, and what would be right.  Errors are raised on
all ranks together, so that no rank is left waiting; only rank 0 prints.
"""

from __future__ import annotations

import sys
import traceback
from types import TracebackType
from typing import Any


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


def install_hook() -> None:
    """Make an uncaught `DeaError` end the script with one sentence and its exit status.

    Under MPI rank 0 alone prints it.  Any other uncaught exception shows its traceback and then
    ends all ranks, since the others would wait for ever.
    """
    previous = sys.excepthook

    def hook(
        kind: type[BaseException], error: BaseException, trace: TracebackType | None
    ) -> None:
        mpi = sys.modules.get("mpi4py.MPI")
        running = mpi is not None and mpi.Is_initialized() and not mpi.Is_finalized()
        world = mpi.COMM_WORLD if running and mpi is not None else None
        if isinstance(error, DeaError):
            if world is None or world.rank == 0:
                print(f"Error: {error}", file=sys.stderr, flush=True)
            raise SystemExit(error.exit_status)
        if world is not None and world.size > 1 and issubclass(kind, Exception):
            traceback.print_exception(kind, error, trace)
            sys.stderr.flush()
            world.Abort(1)
            return  # some MPIs let the process run on for a moment
        previous(kind, error, trace)

    sys.excepthook = hook
