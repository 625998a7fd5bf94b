"""Branches of equilibria in one picture, from the results folders of their runs alone."""

from __future__ import annotations

import os
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.pictures.curves import STYLE, axis_label, file_stem, lettering, read_numbers, saved
from dea_fenicsx.results.reading import json_object, read_history, read_summary
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import is_number


def diagram(
    folder: str | os.PathLike, x: str, y: str, names: Sequence[str] | None = None
) -> list[Path]:
    """Draw the branches in a folder: stable parts solid, unstable ones dashed, events marked.

    Parameters
    ----------
    folder
        What `branches` wrote.
    x, y
        Columns of the histories.
    names
        The branches; None takes those that ``diagram.json`` names.

    Returns
    -------
    list of Path
        PNG and SVG, in this folder.

    Raises
    ------
    InputError
        If there are no branches or no such columns, or matplotlib is missing.
    """
    try:
        import matplotlib
        from matplotlib.figure import Figure
    except ImportError as error:
        raise InputError("Diagrams need matplotlib; pip install matplotlib.") from error

    place = Path(folder)
    runs = _runs(place, names)
    if not runs:
        raise InputError(f"There are no branches in {place}; give the folder of a diagram.")
    values = [(read_numbers(run, x), read_numbers(run, y)) for run in runs]
    largest = [
        max(float(np.nanmax(np.abs(pair[i]), initial=0.0)) for pair in values) for i in (0, 1)
    ]
    (x_text, x_unit), (y_text, y_unit) = (
        axis_label(name, size) for name, size in zip((x, y), largest, strict=True)
    )
    # the usual ten colours, and twenty where there are more branches
    colors = matplotlib.colormaps["tab10" if len(runs) <= 10 else "tab20"].colors
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(4.2, 3.15), layout="constrained")
        axes = figure.subplots()
        spots: dict[str, list[tuple[float, float]]] = {}
        for k, (run, (a, b)) in enumerate(zip(runs, values, strict=True)):
            _draw(axes, run, a / x_unit, b / y_unit, colors[k % len(colors)], spots)
        for k, (event, places) in enumerate(spots.items()):
            axes.plot(*np.transpose(places), "XP*dhv"[k % 6], color="k", markersize=4, zorder=3,
                      label=lettering(event))  # fmt: skip
        axes.set_xlabel(x_text)
        axes.set_ylabel(y_text)
        axes.legend()
        return saved(figure, place / file_stem(y, x), ("png", "svg"))


def _runs(place: Path, names: Sequence[str] | None = None) -> list[Path]:
    """The folders of the branches, in their order.

    They are those that are given or that ``diagram.json`` names: others may stand there from an
    earlier diagram.  All are taken where the file is missing.
    """
    found = {p.parent.name: p.parent for p in place.glob("*/history.csv")}
    if names is not None:
        return [found[name] for name in names if name in found]
    file = place / "diagram.json"
    branches = json_object(file).get("branches") if file.exists() else None
    if isinstance(branches, list):
        told = [b.get("name") for b in branches if isinstance(b, dict)]
        return [found[name] for name in told if isinstance(name, str) and name in found]
    return [found[name] for name in sorted(found, key=lambda n: (n != "first", len(n), n))]


def _draw(
    axes: Any, run: Path, a: np.ndarray, b: np.ndarray, color: Any,
    spots: dict[str, list[tuple[float, float]]],
) -> None:
    """Draw one branch from where it begins, and collect the places of its events."""
    summary, history = read_summary(run), read_history(run)
    first = _row(summary.get("branch_begins_at_step"), len(a))
    ends, unstable = [first], []
    for part in _parts(summary):
        ends.append(max(ends[-1], _row(part.get("to_step"), len(a))))
        unstable.append(bool(part.get("negative_modes")))
    if not unstable:  # nothing is known
        ends, unstable = [first, len(a) - 1], [False]
    ends[-1] = len(a) - 1
    label: str | None = lettering(run.name)
    for (low, high), dashed in zip(pairwise(ends), unstable, strict=True):
        rows = slice(low, high + 1)
        axes.plot(a[rows], b[rows], "--" if dashed else "-", color=color, label=label)
        label = None
    events = history.get("event", np.array([]))
    for k, event in enumerate(events):
        if k >= first and events.dtype.kind != "f" and event not in ("", "landed"):
            spots.setdefault(str(event), []).append((a[k], b[k]))


def _parts(summary: dict[str, Any]) -> list[dict[str, Any]]:
    """The parts of a branch, as far as the summary holds what it should."""
    parts = summary.get("stability_intervals")
    return [p for p in parts if isinstance(p, dict)] if isinstance(parts, list) else []


def _row(value: Any, rows: int) -> int:
    """A row of a history that a file names, or the first one."""
    return min(max(int(value), 0), rows - 1) if is_number(value) and abs(value) < 1e9 else 0
