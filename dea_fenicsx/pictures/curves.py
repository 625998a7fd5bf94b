"""Columns of history.csv against each other, and the labels of all pictures."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dea_fenicsx.results.reading import load_columns, read_history, read_summary
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.files import LONGEST_NAME, clean, file_name, listed, replace_file

Pair = tuple[np.ndarray, np.ndarray]
"""Abscissae and ordinates of a curve."""

# endings of column names: unit, exponents of ten it may be scaled by
_UNITS: dict[str, tuple[str, tuple[int, ...]]] = {
    "_V_per_m": ("V/m", (6,)),
    "_MV_per_m": ("MV/m", (0,)),
    "_N_m": ("N m", (-6, -3, 0, 3)),
    "_V": ("V", (0, 3)),
    "_m": ("m", (-9, -6, -3, 0)),
    "_m3": ("m³", (-9, 0)),
    "_m2": ("m²", (-6, 0)),
    "_C": ("C", (-12, -9, -6, -3, 0)),
    "_F": ("F", (-12, -9, -6, -3, 0)),
    "_rad_per_m": ("rad/m", (0,)),
    "_rad": ("rad", (0,)),
    "_N": ("N", (-6, -3, 0, 3)),
    "_Pa": ("Pa", (0, 3, 6, 9)),
    "_s": ("s", (0,)),
    "_GB": ("GB", (0,)),
}
_PREFIX = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
TIMES = ("step", "time", "time_s")
"""Columns over which a curve shows the whole run."""
_PERCENT = ("contraction", "strain")
_WORDS = {
    "max_field": "peak electric field",
    "field_strength": "electric field",
    "min_J": "smallest J",
    "cap": "capacitance",
}
_COLUMN = 85 / 25.4  # inch: one column of a journal
_SAVE: dict[str, dict] = {"png": {"dpi": 300}, "svg": {"metadata": {"Date": None}}}
STYLE = {
    "font.size": 8, "axes.linewidth": 0.6, "lines.linewidth": 1.0, "lines.markersize": 3.0,
    "xtick.direction": "in", "ytick.direction": "in", "xtick.top": True, "ytick.right": True,
    "xtick.major.width": 0.6, "ytick.major.width": 0.6, "legend.frameon": False,
    "svg.fonttype": "none", "svg.hashsalt": "dea_fenicsx",
}  # fmt: skip
"""Settings of matplotlib that all curves share."""


def axis_label(name: str, largest: float) -> tuple[str, float]:
    """Text of an axis for a column of history.csv, and what its numbers are divided by.

    Parameters
    ----------
    name
        Column or field name, ending in its unit.
    largest
        Largest absolute value; decides between m, mm and µm, and the like.

    Returns
    -------
    label, divisor
    """
    name = clean(name, LONGEST_NAME)
    ending = next((e for e in _UNITS if name.endswith(e)), "")
    base = name.removesuffix(ending)
    words = _WORDS.get(base, base.replace("_", " "))
    words = lettering(words[:1].upper() + words[1:])
    if not ending:
        if any(word in base for word in _PERCENT):
            return f"{words} (%)", 0.01
        return f"{words} (-)", 1.0
    unit, exponents = _UNITS[ending]
    power = 0 if 0 in exponents else exponents[0]
    if largest > 0 and math.isfinite(largest):
        fitting = [e for e in exponents if largest >= 10.0**e * 0.9995]
        power = max(fitting, default=exponents[0])
    if ending in ("_m2", "_m3"):
        return f"{words} ({'m' if power else ''}{unit})", 10.0**power
    return f"{words} ({_PREFIX[power]}{unit})", 10.0**power


def spoken(name: str, value: float) -> tuple[str, str]:
    """A column's name without its unit, and its value with a fitting one: ("voltage", "6 kV")."""
    text, divisor = axis_label(name, abs(value))
    unit = text.rsplit("(", 1)[1].rstrip(")")
    number = f"{value / divisor:.4g}"
    words = clean(bare(name), LONGEST_NAME).replace("_", " ")
    return words, number if unit == "-" else f"{number} {unit}"


def curve(
    folders: str | os.PathLike | Sequence[str | os.PathLike],
    x: str,
    y: str,
    path: str | os.PathLike | None = None,
    labels: Sequence[str] | None = None,
    markers: Sequence[str] | str = "os^Dv",
    lines: Mapping[str, tuple[ArrayLike, ArrayLike]] | None = None,
    formats: Sequence[str] = ("png", "svg"),
) -> list[Path]:
    """Draw one column of the history against another, for one run or several.

    Events of the path (a maximum, a bifurcation, a way to fail) are marked by name.  A curve over
    a load, or of one, begins where that load first moves: what comes before, such as a
    pre-stretch at 0 V, would be a line along the axis.

    Parameters
    ----------
    folders
        A run's folder, or several.
    x, y
        Columns of history.csv.
    path
        The picture, without its ending; by default ``Y_X`` (less the units) beside the first
        history.csv.
    labels
        Names of the runs for the legend; by default their folders' names if there are several.
    markers
        A matplotlib marker for each run, in turn.
    lines
        Curves to compare with, as thin lines: label to abscissae and ordinates, in the columns'
        (SI) units.
    formats
        ``"png"`` (300 dpi), ``"svg"``, or both.

    Returns
    -------
    list of Path
        A file for each format.

    Raises
    ------
    InputError
        If a folder or column is not there, or a column holds no numbers.
    """
    try:
        import matplotlib
        from matplotlib.figure import Figure
    except ImportError as error:
        raise InputError("Curves need matplotlib; pip install matplotlib.") from error

    places, names = _named(folders, labels)
    for kind in formats:
        if kind not in _SAVE:
            raise InputError(f"A curve is drawn as png or svg, not as {kind!r}.")
    starts = [first_shown(p, (x, y)) for p in places]
    runs = [
        (read_numbers(p, x)[k:], read_numbers(p, y)[k:])
        for p, k in zip(places, starts, strict=True)
    ]
    others = {
        label: (np.asarray(a, float), np.asarray(b, float))
        for label, (a, b) in (lines or {}).items()
    }
    (x_text, x_unit), (y_text, y_unit) = (
        axis_label(name, _largest(pair[i] for pair in [*runs, *others.values()]))
        for i, name in enumerate((x, y))
    )

    def scaled(pairs: Iterable[Pair]) -> list[Pair]:
        return [(a / x_unit, b / y_unit) for a, b in pairs]

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(_COLUMN, 0.75 * _COLUMN), layout="constrained")
        axes = figure.subplots()
        for k, ((a, b), label) in enumerate(zip(scaled(runs), names, strict=True)):
            mark = markers[k % len(markers)] if markers else None
            axes.plot(a, b, marker=mark, markerfacecolor="white", label=label)
        marked = _mark_events(
            axes, scaled(runs), [_events(p, k) for p, k in zip(places, starts, strict=True)]
        )
        dashes = ["--", ":", "-."] * 9
        for (a, b), label, dash in zip(scaled(others.values()), others, dashes, strict=False):
            axes.plot(a, b, dash, color="0.2", linewidth=0.8, label=label)
        axes.set_xlabel(x_text)
        axes.set_ylabel(y_text)
        if any(names) or others or marked:
            axes.legend()
        stem = Path(path) if path is not None else places[0] / file_stem(y, x)
        return saved(figure, stem, formats)


def _named(
    folders: str | os.PathLike | Sequence[str | os.PathLike], labels: Sequence[str] | None
) -> tuple[list[Path], Sequence[str]]:
    """The folders of the runs, and a name for the legend for each."""
    if isinstance(folders, str | os.PathLike):
        folders = [folders]
    places = [Path(f) for f in folders]
    if not places:
        raise InputError("No folder of a run was given; give at least one.")
    if labels is None:
        labels = [lettering(p.resolve().name) for p in places] if len(places) > 1 else [""]
    if len(labels) != len(places):
        raise InputError(f"There are {len(places)} runs but {len(labels)} labels; give one each.")
    return places, labels


def _largest(columns: Iterable[np.ndarray]) -> float:
    """Largest absolute value of some columns, NaN left out; 0 where there is none."""
    return max((float(np.nanmax(np.abs(c), initial=0.0)) for c in columns), default=0.0)


def _mark_events(
    axes: Any, runs: Sequence[Pair], events: Sequence[Sequence[tuple[str, int]]]
) -> list[str]:
    """Mark the events of all runs, those of one name alike; returns the names."""
    names = list(dict.fromkeys(name for rows in events for name, _ in rows))
    for k, name in enumerate(names):
        spots = [
            (a[i], b[i])
            for (a, b), rows in zip(runs, events, strict=True)
            for found, i in rows if found == name
        ]  # fmt: skip
        axes.plot(*np.transpose(spots), "XP*dhv"[k % 6], color=f"C{k % 8 + 1}", markersize=6,
                  zorder=3, label=lettering(name))  # fmt: skip
    return names


def saved(figure: Any, stem: Path, formats: Sequence[str]) -> list[Path]:
    """Write a figure in some formats."""
    stem = stem.with_suffix("") if stem.suffix in (".png", ".svg") else stem
    paths = []
    for kind in formats:
        save = partial(figure.savefig, format=kind, **_SAVE[kind])
        paths.append(write_whole(stem.with_name(f"{stem.name}.{kind}"), save))
    return paths


def read_numbers(folder: Path, name: str) -> np.ndarray:
    columns = read_history(folder)
    if name not in columns:
        raise InputError(
            f"The history in {folder} has no column {clean(name, 60)!r}; it has: {listed(columns)}."
        )
    if columns[name].dtype.kind != "f":
        raise InputError(
            f"Column {clean(name, 60)!r} of the history in {folder} does not hold numbers."
        )
    return columns[name]


def first_shown(folder: Path, names: Sequence[str]) -> int:
    """The row of a history with which a curve of some columns begins.

    It is the last row before the first load or voltage among the columns leaves 0.  A curve over
    time or steps begins with the first row, and so does one without loads, or whose loads stay 0.
    """
    history = read_history(folder)
    summary: dict[str, Any] = {}
    with suppress(InputError):
        summary = read_summary(folder)
    loads = set(load_columns(history, summary))
    if set(names) & set(TIMES):
        return 0
    found = []
    for name in names:
        driven = name in loads or name.endswith("_V")
        values = history.get(name)
        if driven and values is not None and values.dtype.kind == "f" and values[:1] == 0:
            moved = np.flatnonzero(values)
            if len(moved):
                found.append(int(moved[0]) - 1)
    return min(found, default=0)


def _events(folder: Path, first: int = 0) -> list[tuple[str, int]]:
    """Events of a run from a row on with their rows.

    Requested landings, and the steps of a motion on its way, are left out.
    """
    column = read_history(folder).get("event")
    if column is None or column.dtype.kind == "f":
        return []
    return [(str(e), i) for i, e in enumerate(column[first:]) if e not in ("", "landed", "motion")]


def bare(name: str) -> str:
    """A column's name without its unit."""
    return name.removesuffix(next((e for e in _UNITS if name.endswith(e)), ""))


def file_stem(*names: str) -> str:
    """Name of a picture's file, without its ending, made of names of columns less their units."""
    return "_".join(file_name(bare(name)) for name in names)


def lettering(text: str) -> str:
    """A text from a file for a picture: matplotlib takes what stands between $ for mathematics."""
    return clean(text).replace("\\", "/").replace("$", r"\$")


def write_whole(path: Path, write: Callable[[Path], object]) -> Path:
    """Write a picture by `replace_file`, in a folder that is made for it.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, write, empty=False)  # what draws may end the process
    except OSError as error:
        raise InputError(f"The picture {path} cannot be written ({error.strerror}).") from error
    return path
