"""Compare two runs, column by column, and their settings."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.results.reading import read_history, read_summary
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.files import clean, listed

HELP = "two runs, column by column"

# what a run costs, how well it converged, and where of several equal maxima one was found
NOT_JUDGED = {
    "step", "newton_iterations", "krylov_iterations", "factorisations", "retries", "wall_s",
    "residual", "volume_error", "inertia_is_of_this_step",
    "max_field_x_m", "max_field_y_m", "max_field_z_m",
}  # fmt: skip


def add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("a", type=Path, metavar="A", help="results folder")
    parser.add_argument("b", type=Path, metavar="B", help="results folder")
    parser.add_argument("--rtol", type=float, default=1e-6, metavar="-",
                        help="largest difference allowed, relative to the column's largest "
                        "value (default %(default)g)")  # fmt: skip


@dataclass(frozen=True)
class ComparedColumn:
    """One column of two histories.

    Attributes
    ----------
    name : the column
    last : last values of A and B
    difference : largest difference over the common steps, relative to the column's largest value
    time : path parameter where it is found
    judged : whether it counts for the exit status
    """

    name: str
    last: tuple[Any, Any]
    difference: float
    time: float
    judged: bool


def columns(a: dict[str, np.ndarray], b: dict[str, np.ndarray]) -> tuple[list[ComparedColumn], int]:
    """Compare the columns that two histories share, at the times that they share.

    Returns
    -------
    columns, number of common times
    """
    times = a["time"]
    rows = [(i, j) for i, t in enumerate(times) for j in _near(b["time"], t)]
    if not rows:
        raise InputError("The two runs have no step at the same time of the path in common.")
    i, j = np.array(rows).T
    found = []
    for name in a:
        if name not in b or name == "time":
            continue
        one, other = a[name][i], b[name][j]
        last = (a[name][-1], b[name][-1])
        if one.dtype.kind != "f" or other.dtype.kind != "f":
            unequal = one.astype(str) != other.astype(str)
            gap = np.where(unequal, np.inf, 0.0)
        else:
            if np.isnan(a[name]).all() and np.isnan(b[name]).all():
                continue  # an empty column
            size = float(np.nanmax(np.abs([one, other]), initial=0.0))
            with np.errstate(invalid="ignore"):
                gap = np.abs(one - other) / (size or 1.0)
            gap = np.where((one == other) | (np.isnan(one) & np.isnan(other)), 0.0, gap)
            gap = np.where(np.isnan(gap), np.inf, gap)  # a number against none
        worst = int(np.argmax(gap))
        size, time = float(gap[worst]), float(times[i][worst])
        found.append(ComparedColumn(name, last, size, time, name not in NOT_JUDGED))
    return found, len(rows)


def _near(times: np.ndarray, t: float) -> list[int]:
    return np.flatnonzero(np.abs(times - t) < 1e-9 * max(1.0, abs(t)))[:1].tolist()


def flat(thing: Any, name: str = "") -> dict[str, Any]:
    """Nested settings as one dictionary, with dotted names."""
    if isinstance(thing, dict):
        pairs = [(str(k), v) for k, v in thing.items()]
    elif isinstance(thing, list) and any(isinstance(v, dict | list) for v in thing):
        pairs = [(str(k), v) for k, v in enumerate(thing)]
    else:
        return {name: thing}
    found: dict[str, Any] = {}
    for key, value in pairs:
        found |= flat(value, f"{name}.{key}" if name else key)
    return found


def settings(a: dict[str, Any], b: dict[str, Any]) -> list[tuple[str, Any, Any]]:
    """Settings and versions in which two summaries differ: name, value in A, value in B."""
    none = "(none)"
    kept = ("settings", "versions", "ranks")
    one, other = (flat({key: s.get(key) for key in kept}) for s in (a, b))
    return [
        (name, one.get(name, none), other.get(name, none))
        for name in dict.fromkeys([*one, *other])
        if one.get(name, none) != other.get(name, none) and name != "settings.script.out"
    ]


def run(options: argparse.Namespace) -> int:
    if not (math.isfinite(options.rtol) and options.rtol >= 0):
        raise InputError(f"--rtol is {options.rtol}, but must be a finite number >= 0.")
    histories = [read_history(folder) for folder in (options.a, options.b)]
    for folder, history in zip((options.a, options.b), histories, strict=True):
        if "time" not in history or history["time"].dtype.kind != "f":
            raise InputError(f"The history in {folder} has no steps with a time; is it a run?")
    summaries = [read_summary(folder) for folder in (options.a, options.b)]
    found, common = columns(*histories)
    states = [_status(*pair) for pair in zip(summaries, histories, strict=True)]
    for letter, folder, state in zip("AB", (options.a, options.b), states, strict=True):
        print(f"{letter}  {clean(folder, 1000)}: {state}")
    print(f"{common} steps at the same time of the path\n")
    width = max((len(clean(c.name, 80)) for c in found), default=6)
    print(f"{'column':{width}}  {'A, last':>15}  {'B, last':>15}  {'largest diff.':>13}  at time")
    for c in found:
        where = f"{c.time:.6g}" if c.difference else ""
        mark = "" if c.judged else "(not judged)"
        print(f"{clean(c.name, 80):{width}}  {_text(c.last[0]):>15}  {_text(c.last[1]):>15}  "
              f"{c.difference:13.2e}  {where:8}{mark}".rstrip())  # fmt: skip
    for label, mine, other in (("A", *histories), ("B", *histories[::-1])):
        alone = [name for name in mine if name not in other]
        if alone:
            print(f"only in {label}: {listed(alone)}")
    for name, x, y in settings(*summaries):
        print(f"{clean(name, 100)}: {clean(x, 100)} in A, {clean(y, 100)} in B")
    why = _unlike(summaries, histories, common)
    worst = max((c for c in found if c.judged), key=lambda c: c.difference, default=None)
    if worst is not None and worst.difference > options.rtol:
        why.append(f"{clean(worst.name, 80)} differs by {worst.difference:.3g} at time "
                   f"{worst.time:.6g}, more than {options.rtol:g}")  # fmt: skip
    if not why:
        print(f"\nthe same within {options.rtol:g}")
        return 0
    print(f"\nnot the same: {'; '.join(why)}")
    return 1


def _unlike(
    summaries: list[dict[str, Any]], histories: Sequence[dict[str, np.ndarray]], common: int
) -> list[str]:
    """In what two runs differ besides their values: how and where they ended, steps, columns.

    One of them may have more steps than the other, as long as it has those of the other, too.
    """
    (a, b), (one, other) = histories, summaries
    found = []
    if "status" in one and "status" in other and one["status"] != other["status"]:
        found.append(f"A is {_ended(one)}, but B is {_ended(other)}")
    last = (float(a["time"][-1]), float(b["time"][-1]))
    steps = (len(a["time"]), len(b["time"]))
    if not _near(np.array(last[:1]), last[1]):
        found.append(f"A ends at time {last[0]:.6g} after {steps[0]} steps, but B at {last[1]:.6g} "
                     f"after {steps[1]}")  # fmt: skip
    elif common < min(steps):
        found.append(f"A has {steps[0]} steps and B has {steps[1]}, of which only {common} are at "
                     "the same time of the path")  # fmt: skip
    for label, mine, theirs in (("A", a, b), ("B", b, a)):
        lacking = [name for name in mine if name not in theirs and name not in NOT_JUDGED]
        if lacking:
            found.append(f"only {label} has {listed(lacking, 5)}")
    return found


def _ended(summary: dict[str, Any]) -> str:
    return clean(summary.get("status", "without a status"), 60)


def _text(value: Any) -> str:
    return f"{value:.9g}" if isinstance(value, float | np.floating) else clean(value, 40)


def _status(summary: dict[str, Any], history: dict[str, np.ndarray]) -> str:
    return f"{_ended(summary)}, {len(history['time'])} steps"
