"""A trial in a process of its own, with a time limit."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from dea_fenicsx.support.subprocesses import environment


@dataclass(frozen=True)
class Done:
    """An ended trial.

    Attributes
    ----------
    facts : what it told, by the first key of each line
    reason : why it ended early, in a few words
    errors : all that it wrote to standard error
    """

    facts: dict[str, dict[str, Any]]
    reason: str
    errors: str = ""


def start(what: str, seconds: float, before: Sequence[str] = ()) -> Done:
    """Run a probe to its end, or for some seconds.

    Parameters
    ----------
    what
        Name of the probe in `probe`.
    seconds
        Time limit, after which it is killed with all it has started.
    before
        Command that starts it, such as mpirun.
    """
    command = [*before, sys.executable, "-P", "-m", "dea_fenicsx.cli.probe", what]
    try:
        process = subprocess.Popen(
            command, env=environment(), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, text=True, errors="replace", start_new_session=True,
        )  # fmt: skip
    except OSError as error:
        return Done({}, f"{command[0]}: {error.strerror}")
    late = False
    try:
        out, errors = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        late = True
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        out, errors = process.communicate()
    facts = {}
    for line in out.splitlines():
        with suppress(json.JSONDecodeError):
            told = json.loads(line)
            if isinstance(told, dict) and told:
                facts[next(iter(told))] = told
    if late:
        return Done(facts, f"no answer within {seconds:g} s", errors)
    plain = re.sub(r"\x1b\[[0-9;]*m", "", errors)  # libraries write in colours
    said = [line.strip() for line in plain.splitlines() if line.strip(" -*=")]
    reason = said[-1][:200] if said else "no message"
    if process.returncode < 0:
        reason = f"ended by signal {signal.Signals(-process.returncode).name} ({reason})"
    return Done(facts, reason, errors)
