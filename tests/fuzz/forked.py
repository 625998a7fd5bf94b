"""Trials in forked processes, several at a time, which may die, hang or eat memory in any of them.

A process makes many trials one after another and tells of each as it begins and as it ends.  So the
parent knows which trial a process was at when it died or went silent; that trial is at fault, and
another process goes on with the next one.  Each trial has limits of its own, and must leave its
process as it was.
"""

from __future__ import annotations

import contextlib
import os
import resource
import select
import shutil
import signal
import sys
import tempfile
import threading
import time
import traceback
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

SECONDS = 20.0
ROOM = 3 << 30
"""Bytes of address space that a trial may take beside what its process has already."""

FILE = 200 << 20
"""Bytes of the largest file that a trial may write."""

ESCAPED = Path("/tmp/escaped")
"""A file that some damage names, and that no trial may make."""

KEEPER = "tmp"
"""Name of the folder for temporary files, in the scratch folder of a process."""


class Fault(Exception):
    """Something that must not happen in a trial."""


@dataclass(frozen=True)
class Ended:
    """How a trial has ended: ``fault``, or what the trial returned; and why it is a fault."""

    number: int
    outcome: str
    why: str


def all_of(
    trial: Callable[[int, Path], str], numbers: list[int], place: Path, jobs: int, size: int
) -> Iterator[Ended]:
    """Make all trials, and tell how each has ended.

    Parameters
    ----------
    trial
        Makes the trial of a number in an empty folder, which it leaves empty; returns its outcome.
    numbers
        Of the trials.
    place
        Folder in which each process gets a folder.
    jobs
        Processes at a time.
    size
        Most trials of a process.
    """
    left, begun = deque(numbers), 0
    workers: dict[int, _Worker] = {}
    try:
        while left or workers:
            while left and len(workers) < jobs:
                some = [left.popleft() for _ in range(min(size, len(left)))]
                begun += 1
                worker = _Worker(trial, some, place / f"{begun}")
                workers[worker.hear] = worker
            wait = min(worker.end for worker in workers.values()) - time.monotonic()
            for descriptor in select.select(list(workers), [], [], max(wait, 0))[0]:
                yield from workers[descriptor].heard()
            now = time.monotonic()
            for worker in [w for w in workers.values() if w.silent or w.end <= now]:
                del workers[worker.hear]
                yield from worker.closed()
                left.extendleft(reversed(worker.left))
    finally:  # an interruption leaves no process behind
        for worker in workers.values():
            worker.kill()
            os.waitpid(worker.process, 0)


class _Worker:
    """A forked process, as its parent sees it.

    Attributes
    ----------
    hear : descriptor of the pipe from the process
    left : numbers of the trials that have not ended
    end : time of the monotonic clock at which the process is late
    silent : whether it has closed the pipe
    """

    def __init__(self, trial: Callable[[int, Path], str], numbers: list[int], scratch: Path):
        self.left, self.scratch = list(numbers), scratch
        self.at: int | None = None
        self.last: int | None = None
        self.text, self.silent = b"", False
        scratch.mkdir()
        self.hear, tell = os.pipe()
        with warnings.catch_warnings():
            # the threads of MPI and of numpy sleep, and the new process uses neither
            warnings.simplefilter("ignore", DeprecationWarning)
            self.process = os.fork()
        if self.process == 0:
            try:
                os.close(self.hear)
                os.setsid()
                _work(trial, numbers, scratch, tell)
            finally:
                os._exit(1)
        os.close(tell)
        self.end = time.monotonic() + SECONDS

    def heard(self) -> Iterator[Ended]:
        """Read what the process tells; yields the trials that have ended."""
        piece = os.read(self.hear, 65536)
        self.silent = not piece
        *lines, self.text = (self.text + piece).split(b"\n")
        for line in lines:
            number, outcome, why = line.decode("utf-8", "replace").split("\t", 2)
            self.end = time.monotonic() + SECONDS
            self.at = self.last = int(number)
            if outcome != "begins":
                self.at = None
                self.left.remove(self.last)
                yield Ended(self.last, outcome, why)

    def kill(self) -> None:
        """End the process and all that it has started."""
        for end in (os.killpg, os.kill):  # at its very beginning it has no group of its own yet
            with contextlib.suppress(ProcessLookupError):
                end(self.process, signal.SIGKILL)

    def closed(self) -> Iterator[Ended]:
        """Wait for the process, which is late or has closed the pipe; yields the trial at fault."""
        late = not self.silent
        if late:
            self.kill()
        os.close(self.hear)
        _, status = os.waitpid(self.process, 0)
        shutil.rmtree(self.scratch, ignore_errors=True)
        code = os.waitstatus_to_exitcode(status)
        why = f"no end within {SECONDS:g} s" if late else f"the process ends with status {code}"
        if self.at is not None:
            self.left.remove(self.at)
            yield Ended(self.at, "fault", why)
        elif self.last is not None and (code or self.left):
            yield Ended(self.last, "fault", f"{why} after this trial")
        elif self.left:
            number = self.left.pop(0)
            yield Ended(number, "fault", f"{why} before it begins this trial")


# ------------------------------------------------------------------------- in the forked process


def _work(
    trial: Callable[[int, Path], str], numbers: list[int], scratch: Path, tell: int
) -> None:
    """Make some trials, and tell the parent of each as it begins and ends.  Ends the process."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (FILE, FILE))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    null = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        os.dup2(null, descriptor)
    tempfile.tempdir = os.environ["TMPDIR"] = str(scratch / KEEPER)
    for number in numbers:
        _empty(scratch)
        os.write(tell, f"{number}\tbegins\t\n".encode())
        try:
            outcome, why = _watched(trial, number, scratch), ""
        except Fault as error:
            outcome, why = "fault", str(error)
        except BaseException as error:
            where = traceback.extract_tb(error.__traceback__)[-1]
            outcome = "fault"
            why = f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})"
        why = " ".join(why.split())[:400]
        os.write(tell, f"{number}\t{outcome}\t{why}\n".encode("utf-8", "replace"))
    os._exit(0)


def _empty(scratch: Path) -> None:
    """Make this the working directory, with nothing in it but a folder for temporary files."""
    os.chdir(scratch)
    if os.listdir(scratch) != [KEEPER] or os.listdir(KEEPER):
        for path in list(scratch.iterdir()):
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()
        (scratch / KEEPER).mkdir()


def _watched(trial: Callable[[int, Path], str], number: int, scratch: Path) -> str:
    """The outcome of a trial that keeps to its room, and leaves nothing behind.

    Raises
    ------
    Fault
        If it does leave something, on disk or in the process.
    """
    escaped = ESCAPED.exists()
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    resource.setrlimit(resource.RLIMIT_AS, (size + ROOM, hard))
    before = _state()
    outcome = trial(number, scratch)
    after = _state()
    changed = [name for name, value in before.items() if after[name] != value]
    if changed:
        raise Fault(f"it leaves another {changed[0]}: {_difference(before, after, changed[0])}")
    files = [*scratch.iterdir(), *(scratch / KEEPER).iterdir()]
    found = sorted(path.name for path in files if path != scratch / KEEPER)
    if found:
        raise Fault(f"it leaves {found} behind")
    if ESCAPED.exists() and not escaped:
        raise Fault(f"it makes {ESCAPED}")
    return outcome


def _difference(before: Mapping[str, Any], after: Mapping[str, Any], name: str) -> str:
    """A part of the state before and after, without the items that are in both."""
    was, now = before[name], after[name]
    if isinstance(was, list):
        was, now = [x for x in was if x not in now], [x for x in now if x not in was]
    elif isinstance(was, dict):
        was, now = dict(was.items() - now.items()), dict(now.items() - was.items())
    return f"{str(now)[:150]} instead of {str(was)[:150]}"


def _state() -> dict[str, Any]:
    """What a trial must leave as it was in its process."""
    mask = os.umask(0)
    os.umask(mask)
    gmsh = sys.modules.get("gmsh")
    watched = (signal.SIGINT, signal.SIGTERM, signal.SIGALRM, signal.SIGCHLD)
    return {
        "environment": dict(os.environ),
        "mask of new files": mask,
        "handler of signals": [signal.getsignal(number) for number in watched],
        "limit": [resource.getrlimit(kind) for kind in (resource.RLIMIT_AS, resource.RLIMIT_CPU)],
        "thread": sorted(thread.name for thread in threading.enumerate()),
        "open file": _open_files(),
        "standard stream": [sys.stdin, sys.stdout, sys.stderr],
        "state of gmsh": bool(gmsh and gmsh.isInitialized()),
        "process": _children(),
    }


def _open_files() -> list[str]:
    """What the descriptors of this process are open on, but for fonts: matplotlib keeps them."""
    found = []
    for name in os.listdir("/proc/self/fd"):
        with contextlib.suppress(FileNotFoundError):  # that of the listing itself is closed
            found.append(os.readlink(f"/proc/self/fd/{name}"))
    return sorted(name for name in found if not name.endswith(".ttf"))


def _children() -> str:
    """Numbers of this process's own processes that still run, or have not been waited for."""
    file = Path(f"/proc/self/task/{os.getpid()}/children")
    return file.read_text() if file.exists() else ""
