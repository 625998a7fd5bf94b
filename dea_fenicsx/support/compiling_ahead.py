"""Several forms that are not in the cache, compiled side by side on the cores that are there.

FFCx writes and compiles one form at a time, and the tangent of a new kind of scene alone may take
ten seconds.  So each form is given to a process of its own, a copy of this one, which leaves what
it has compiled in the cache.  Then all forms are found there, in the usual way.

A copy of a process may harm memory that a network card writes to.  So this is done only where the
program runs on one rank, which has no such memory.
"""

from __future__ import annotations

import os
import signal
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

from mpi4py import MPI

from dea_fenicsx.support import form_cache

LONGEST_COMPILATION_S = 600.0
"""Seconds that one form may take; a copy that takes longer is ended, and its form compiled here."""


class _Found(Exception):
    """What FFCx looks for in the cache, raised instead of looking: it goes no further."""

    def __init__(self, folder: Path, name: str) -> None:
        super().__init__(name)
        self.folder, self.name = folder, name

    @property
    def is_there(self) -> bool:
        ready = (self.folder / f"{self.name}{form_cache.READY}").exists()
        return ready and not form_cache.damaged(self.folder, self.name)


def compile_ahead(
    jit: Any, make: Callable[[Any], Any], first: Any, others: Callable[[], Sequence[Any]]
) -> None:
    """Compile forms that are not in the cache, each in a process of its own.

    Nothing is done if the first form is there, for then the others are as a rule, or on several
    ranks, or on one core.  What cannot be compiled is left to be compiled again, which tells why.

    Parameters
    ----------
    jit
        FFCx's module for compiling, within `form_cache.compiling`.
    make
        Compiles a form.
    first
        One of the forms.
    others
        Gives the others; those that take longest come first.
    """
    count = cores()
    if MPI.COMM_WORLD.size > 1 or count == 1 or not hasattr(os, "fork"):
        return
    if (sought := _sought(jit, make, first)).is_there or _waits(sought):
        return
    missing = {}
    for form in (*others(), first):
        found = _sought(jit, make, form)
        if not found.is_there and not _waits(found):
            missing[found.name] = found, form
    if len(missing) < 2:
        return
    form_cache.on_compiling()
    import ffcx.compiler  # noqa: F401  (once, and not in each process)

    _side_by_side(list(missing.values()), make, count)


def cores() -> int:
    """Number of cores that this process may use."""
    allowed = getattr(os, "sched_getaffinity", None)
    return len(allowed(0)) if allowed else os.cpu_count() or 1


def _sought(jit: Any, make: Callable[[Any], Any], form: Any) -> _Found:
    """The name of a form in the cache, and the folder."""
    get = jit.get_cached_module

    def tell(name: str, _: Any, folder: Any, __: int) -> NoReturn:
        raise _Found(Path(folder), name)

    jit.get_cached_module = tell
    try:
        make(form)
    except _Found as found:
        return found.with_traceback(None)  # else it would keep all that calls this alive
    finally:
        jit.get_cached_module = get
    raise AssertionError("FFCx did not look into the cache")


def _waits(found: _Found) -> bool:
    """Whether another program is compiling a form now."""
    return (found.folder / f"{found.name}.c").exists() and not (
        found.folder / f"{found.name}{form_cache.READY}"
    ).exists()


def _side_by_side(
    missing: list[tuple[_Found, Any]], make: Callable[[Any], Any], count: int
) -> None:
    """Compile forms in `count` processes at a time."""
    running: dict[int, tuple[_Found, float]] = {}
    try:
        for found, form in missing:
            if len(running) == count:
                _await_one(running)
            with suppress(OSError):  # no room for another process: it is compiled later
                running[_started(make, form)] = found, time.monotonic()
        while running:
            _await_one(running)
    finally:
        for process, (found, _) in running.items():  # only after an interruption
            os.kill(process, signal.SIGKILL)
            os.waitpid(process, 0)
            _clean(found)


def _started(make: Callable[[Any], Any], form: Any) -> int:
    """The number of a new process that compiles a form."""
    with warnings.catch_warnings():
        # Python warns of other threads; the copy runs Python and the compiler alone.
        warnings.simplefilter("ignore", DeprecationWarning)
        process = os.fork()
    if process:
        return process
    status = 1
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, 1)
        os.dup2(nothing, 2)
        make(form)
        status = 0
    finally:
        os._exit(status)  # nothing of this process is ended: neither MPI nor open files


def _await_one(running: dict[int, tuple[_Found, float]]) -> None:
    """Wait until one of some processes has ended."""
    while True:
        for process, (found, begin) in list(running.items()):
            if time.monotonic() - begin > LONGEST_COMPILATION_S:
                os.kill(process, signal.SIGKILL)
            ended, status = os.waitpid(process, os.WNOHANG)
            if ended:
                del running[process]
                if status:
                    _clean(found)
                return
        time.sleep(0.01)


def _clean(found: _Found) -> None:
    """Remove what a process that failed has left, lest this one wait for it."""
    if not found.is_there:
        for file in found.folder.glob(f"{found.name}.*"):
            file.unlink(missing_ok=True)
