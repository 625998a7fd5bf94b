"""The command line ``python -m dea_fenicsx.pictures``."""

from __future__ import annotations

import argparse
import resource
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from dea_fenicsx.pictures.curves import axis_label, curve, lettering, spoken, write_whole
from dea_fenicsx.pictures.drawing import NO_MATPLOTLIB, animated, deformed
from dea_fenicsx.results.axes import FIXED, axes_told
from dea_fenicsx.results.history import field_times
from dea_fenicsx.results.reading import (
    load_columns,
    moved_ramps,
    read_history,
    read_summary,
)
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.files import clean


def title_of(folder: Path, warp: float, time: float) -> str:
    """Load and step of a picture, from the row of the history that belongs to its time."""
    parts = []
    with suppress(InputError, KeyError, IndexError, TypeError, ValueError, OverflowError):
        history = read_history(folder)
        row = int(np.argmin(np.abs(np.array(field_times(history)) - time)))
        with suppress(InputError):
            for name in _ramps(folder, history):
                if (key := f"{name}_V") in history:
                    parts.append(" ".join(spoken(key, float(history[key][row]))))
                elif (key := f"{name}_factor") in history:
                    parts.append(f"{clean(name, 60).replace('_', ' ')} × {history[key][row]:.4g}")
        if "time_s" in history:
            parts.append(f"{history['time_s'][row]:.4g} s")
        parts.append(f"step {int(history['step'][row])}")
    parts.append(f"displacements × {warp:g}, undeformed in red" if warp else "undeformed shape")
    return lettering(", ".join(parts))


def _ramps(folder: Path, history: Mapping[str, np.ndarray]) -> list[str]:
    """Names of the ramps that a run moves, in order.

    Where its summary does not name them, they are those whose columns change.
    """
    named = list(dict.fromkeys(moved_ramps(read_summary(folder))))
    if named:
        return named
    columns = [name for name in load_columns(history, {}) if np.ptp(history[name]) > 0]
    return [name.removesuffix("_V").removesuffix("_factor") for name in columns]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m dea_fenicsx.pictures", description="Pictures of runs."
    )
    commands = parser.add_subparsers(dest="command", required=True)
    render = commands.add_parser("render", help="the deformed device, coloured by a field")
    render.add_argument("--step", type=int, default=-1, help="step on disk; -1 is the last")
    movie = commands.add_parser("movie", help="all steps as a film")
    for drawn, what in ((render, "the PNG file"), (movie, "the .gif or .mp4 file")):
        drawn.add_argument("folder", type=Path, help="a run's folder")
        drawn.add_argument("--field", default="field_strength_V_per_m", help="name of a field")
        drawn.add_argument("--warp", type=float, default=1.0, help="scale of the displacement (-)")
        drawn.add_argument("--out", type=Path, required=drawn is movie, help=what)
        drawn.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    plot = commands.add_parser("curve", help="columns of history.csv against each other")
    plot.add_argument("folders", nargs="+", type=Path, help="folders of runs")
    plot.add_argument("--x", default="voltage_V", help="column of the abscissa")
    plot.add_argument("--y", default="contraction", help="column of the ordinate")
    plot.add_argument("--labels", nargs="+", help="a name for each run")
    plot.add_argument("--out", type=Path, help="the picture, without its ending")
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``python -m dea_fenicsx.pictures``; returns the exit status."""
    given = _parser().parse_args(arguments)
    if given.command == "curve":
        for path in curve(given.folders, given.x, given.y, given.out, given.labels):
            print(path)
        return 0
    if not given.here:

        def say(reason: str) -> None:
            print(reason, file=sys.stderr)

        if given.command == "movie":
            made = animated(given.folder, given.out, given.field, given.warp, say)
        else:
            made = deformed(given.folder, given.field, given.step, given.warp, given.out, say)
        if made:
            print(made)
        return 0 if made else 1
    if find_spec("matplotlib") is None:
        print("matplotlib is not installed; pip install matplotlib.", file=sys.stderr)
        return NO_MATPLOTLIB
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

    def title(time: float) -> str:
        return title_of(given.folder, given.warp, time)

    axes = FIXED
    with suppress(InputError):
        axes = axes_told(read_summary(given.folder))

    def draw(file: Path) -> None:
        if given.command == "movie":
            from dea_fenicsx.pictures.fields import Words
            from dea_fenicsx.pictures.movie import film

            kind = given.out.suffix
            film(given.folder, given.field, given.warp, file, kind, Words(title, axis_label, axes))
        else:
            from dea_fenicsx.pictures.fields import Words, render

            words = Words(title, axis_label, axes)
            render(given.folder, given.field, given.step, given.warp, file, words)

    write_whole(given.out, draw)
    return 0
