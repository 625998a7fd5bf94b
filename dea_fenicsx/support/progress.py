"""Messages of a running run: one line that is renewed on a terminal, plain lines elsewhere.

Rank 0 speaks.  All plain lines also go into run.log in the results folder, however quiet the run.
"""

from __future__ import annotations

import os
import shutil
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from dea_fenicsx.support.files import append_line

_LAUNCHERS = ("hydra_pmi_proxy", "mpiexec", "mpirun", "prterun", "prted", "orterun", "orted")
_RENEW_S = 0.1

COMPILING = "compiling forms (once; kept in the cache)"

LONG_COUNT_S = 1.0
"""Least time in s of a count of negative eigenvalues that a step's line tells."""

verbose_by_default = False
"""Set by ``--verbose`` on a script's command line."""


class Progress:
    """Tells of a run's progress.

    Parameters
    ----------
    speaks
        Whether this is rank 0; the others are silent.
    quiet
        Print nothing; the log is written all the same.
    verbose
        Print each Newton iteration and each factorisation, too.
    """

    def __init__(self, speaks: bool, quiet: bool, verbose: bool | None = None) -> None:
        self.speaks, self.quiet = speaks, quiet
        self.verbose = verbose_by_default if verbose is None else verbose
        self.log: Path | None = None
        self.renews = speaks and not quiet and on_terminal()
        self._line, self._left, self._renewed, self._when = "", "", "", 0.0
        self._begun, self._share = time.monotonic(), 0.0
        self._compiles = False

    def begin(self, share: float) -> None:
        """The path begins, or is carried on from a share of it."""
        self._begun, self._share = time.monotonic(), share

    def left(self, share: float) -> str:
        """Share of the path behind, and the time that the rest may take: "25 %, 12 s left"."""
        text = f"{100 * share:.0f} %"
        if self._share < share < 1:
            spent = time.monotonic() - self._begun
            text += f", {_duration(spent * (1 - share) / (share - self._share))} left"
        return text

    def say(self, line: str) -> None:
        """Print a line that stays."""
        self._record(line)
        if self.speaks and not self.quiet:
            self._put(line + "\n")

    def compiling(self) -> None:
        """Tell once that forms are compiled, which takes a while and is needed once."""
        if self._compiles or not self.speaks or self.quiet:
            return
        self._compiles, self._when = True, 0.0
        if self.renews:
            self.stage(COMPILING)
        else:  # apart from the lines of the steps, which programs may read
            print(COMPILING, file=sys.stderr, flush=True)

    def step(self, line: str, share: float) -> None:
        """Tell of an accepted step: on a terminal it takes the place of the one before."""
        left = self.left(share)
        if not self.renews or self.verbose:
            self.say(f"{line}  {left}")
            return
        self._record(f"{line}  {left}")
        self._line, self._left, self._when = line, left, 0.0
        self.stage("")

    def stage(self, what: str) -> None:
        """Tell what the solver is about to do: "factorising", "Newton 3: residual 1e-7"."""
        if self.verbose and what.startswith(("Newton", "factorising", "compiling")):
            self.say(f"    {what}")
        elif self.renews and time.monotonic() - self._when > _RENEW_S:
            self._when = time.monotonic()
            # A line that is wider than the terminal is cut, so the important part comes first.
            line = "  ".join(part for part in (self._left, what, self._line) if part)
            self._renewed = line[: shutil.get_terminal_size().columns - 1]
            self._put("")

    def end(self, line: str) -> None:
        """The last line; the last step before it stays on the terminal."""
        self._renewed = ""
        if self.renews and self._line:
            self._put(self._line + "\n")
        self.say(line)

    def _put(self, lines: str) -> None:
        """Print lines, and below them the one that is renewed."""
        wipe = "\r\x1b[K" if self.renews else ""
        try:
            print(wipe + lines + self._renewed, end="", flush=True)
        except OSError:
            # the reader (head, less) has gone, or the disk is full: no reason to stop a run
            self.quiet, self.renews = True, False
            sys.stdout = open(os.devnull, "w")  # noqa: SIM115

    def _record(self, line: str) -> None:
        if self.speaks and self.log is not None:
            # a log that cannot be written is no reason to stop a run
            with suppress(OSError):
                append_line(self.log, f"{time.strftime('%Y-%m-%d %H:%M:%S')}  {line}")


def step_line(
    row: Mapping[str, Any],
    loads: Mapping[str, float],
    before: Mapping[str, float],
    seen: Sequence[str],
    seconds: float,
    counting: float = 0.0,
) -> str:
    """An accepted step in words: its loads and their change, some columns, the work it took.

    `counting` is the time in s that the count of negative eigenvalues took of it.
    """
    words = [f"step {row['step']:3d}"]
    for key, value in loads.items():
        unit = " V" if key.endswith("_V") else ""
        change = value - before.get(key, value)
        by = f" ({change:+.5g})" if change else ""
        words.append(f"{key.removesuffix('_V')} {value:.6g}{unit}{by}")
    words += [f"{name} {row[name]:.6g}" for name in seen]
    words += [f"Newton {row['newton_iterations']}", f"Krylov {row['krylov_iterations']}"]
    why = f" ({counting:.1f} s of it to count negative modes)" if counting > LONG_COUNT_S else ""
    words += [f"{seconds:.1f} s{why}", *([f"({row['event']})"] if row["event"] else [])]
    return "  ".join(words)


def _duration(seconds: float) -> str:
    """"12 s", "3 min", "2.5 h"."""
    if seconds < 99.5:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5970 else f"{seconds / 3600:.1f} h"


def on_terminal() -> bool:
    """Whether what is printed is seen on a terminal, also through mpirun.

    MPICH gives its ranks a pipe, Open MPI a terminal of its own, and both pass on what they print:
    so the output of the launcher decides, if there is one among this process's ancestors.
    """
    launcher, process = None, os.getpid()
    with suppress(OSError, ValueError, IndexError):
        while True:
            stat = Path(f"/proc/{process}/stat").read_text()
            process = int(stat.rpartition(")")[2].split()[1])
            name = Path(f"/proc/{process}/comm").read_text().strip()
            if not name.startswith(_LAUNCHERS):
                break
            launcher = process
    if launcher is None:
        return sys.stdout.isatty()
    with suppress(OSError):
        return os.readlink(f"/proc/{launcher}/fd/1").startswith(("/dev/pts/", "/dev/tty"))
    return False
