"""What a run found: a summary, curves and pictures from its results folder, without ParaView."""

from __future__ import annotations

import argparse
import sys
import textwrap
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.results.first_columns import load_column, ordinate, recorded
from dea_fenicsx.results.reading import field_names, load_columns, read_history, read_summary
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.files import LONGEST_PATH, clean, listed

HELP = "summary, curves and pictures of a run"

def add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("results", nargs="+", type=Path, metavar="RESULTS",
                        help="results folder; curves of several are laid over one another")
    parser.add_argument("--x", metavar="COLUMN", help="abscissa (default: the load)")
    parser.add_argument("--y", metavar="COLUMN", action="append",
                        help="ordinate, may be given several times (default: the first recorded)")
    parser.add_argument("--field", metavar="NAME", help="field to colour by (default: the "
                        "electric field, if there is one)")
    parser.add_argument("--step", type=int, metavar="N",
                        help="step to draw, -1 for the last (default)")
    parser.add_argument("--warp", type=float, default=1.0, metavar="-",
                        help="scale of the drawn displacement (default 1)")
    parser.add_argument("--format", choices=("png", "svg"), action="append",
                        help="format of the curves, may be given twice (default: both)")
    parser.add_argument("--out", type=Path, metavar="DIR",
                        help="where pictures go (default: the first results folder)")
    parser.add_argument("--animate", type=Path, metavar="FILE", help="a film, .gif or .mp4")
    parser.add_argument("--paraview", action="store_true",
                        help="write view.py, which opens the results in ParaView")
    parser.add_argument("--text", action="store_true", help="the summary only")  # fmt: skip


def run(options: argparse.Namespace) -> int:
    from dea_fenicsx import pictures
    from dea_fenicsx.pictures.curves import file_stem

    if not np.isfinite(options.warp):
        raise InputError(f"--warp is {options.warp}, but must be a finite number.")
    histories = [read_history(folder) for folder in options.results]
    for folder, history in zip(options.results, histories, strict=True):
        if not history:
            raise InputError(f"The history in {folder} has no steps yet.")
    for folder, history in zip(options.results, histories, strict=True):
        print(summary(folder, history))
    if options.text:
        return 0
    first = options.results[0]
    out = options.out or first
    curve_asked = bool(options.x or options.y or options.format)
    field_asked = options.field is not None or options.step is not None
    by_default = not (curve_asked or field_asked or options.animate or options.paraview)
    missed: list[str] = []
    if curve_asked or by_default:
        told = _summary_of(first)
        x = options.x or load_column(histories[0], told)
        formats = tuple(dict.fromkeys(options.format or ("png", "svg")))
        for y in options.y or [ordinate(histories[0], told)]:
            stem = out / file_stem(y, x)
            for path in pictures.curve(options.results, x, y, stem, formats=formats):
                _tell(path)
    has_fields = (first / "fields.xdmf").is_file()
    if field_asked or (by_default and has_fields):
        field = options.field or _field(first)
        step = -1 if options.step is None else options.step
        target = out / f"{file_stem(field)}.png"
        _tell(pictures.deformed(first, field, step, options.warp, target, missed.append))
    if options.animate:
        field = options.field or _field(first)
        _tell(pictures.animated(first, options.animate, field, options.warp, missed.append))
    if options.paraview:
        from dea_fenicsx.pictures.paraview import write

        _tell(write(first))
    for reason in missed:
        print(clean(reason), file=sys.stderr)
    # by default pictures are welcome where they can be made; what was asked for must be there
    return 1 if missed and not by_default else 0


def _tell(path: Path | None) -> None:
    if path is not None:
        print(clean(path, LONGEST_PATH))


def _summary_of(folder: Path) -> dict[str, Any]:
    """The summary, empty where there is none yet."""
    with suppress(InputError):
        return read_summary(folder)
    return {}


def _field(folder: Path) -> str:
    names = field_names(folder)
    return "field_strength_V_per_m" if "field_strength_V_per_m" in names else "displacement_m"


def summary(folder: Path, history: dict[str, np.ndarray]) -> str:
    """What a run found, in a few lines."""
    from dea_fenicsx.pictures import spoken

    told = _summary_of(folder)
    columns = load_columns(history, told)
    columns += [n for n in recorded(history) if n not in columns]
    columns += [n for n in ("max_field_V_per_m",) if n in history]
    # in a damaged file any of them may hold texts
    columns = [n for n in columns if history[n].dtype.kind == "f"]
    status = clean(told.get("status", "no summary.json"), 60)
    steps = len(next(iter(history.values()))) - 1
    start = told.get("start")
    begun = "its start" if isinstance(start, dict) else "the undeformed state"
    lines = [f"{clean(folder, LONGEST_PATH)}: {status}, {steps} steps after {begun}"]
    if isinstance(start, dict):
        where = start.get("folder") or "a run without a folder"
        step = start.get("step")
        told_step = f"step {step} of " if isinstance(step, int) else ""
        lines.append(f"  started from {told_step}{clean(where, LONGEST_PATH)}")
    if told.get("message"):
        lines.append(f"  {clean(told['message'], 1000)}")
    with suppress(KeyError, TypeError, ValueError, OverflowError):
        ranks = "1 rank" if told["ranks"] == 1 else f"{clean(told['ranks'], 20)} ranks"
        mesh = clean(told["settings"]["mesh"] or "device", LONGEST_PATH)
        lines.append(f"  {mesh}: {clean(told['unknowns'], 20)} unknowns, {ranks}, "
                     f"{told['wall_s']:.1f} s")  # fmt: skip
    for name in columns:
        words, value = spoken(name, float(history[name][-1]))
        lines.append(f"  {words:24} {value}")
    if "stable" in told:
        stable = told["stable"]
        verdict = {True: "yes", False: "no"}[stable] if isinstance(stable, bool) else "not tested"
        lines.append(f"  {'last state stable':24} {verdict}")
    lines.append(_listed("columns", history))
    with suppress(InputError):
        lines.append(_listed("fields", field_names(folder)))
    return "\n".join(lines)


def _listed(what: str, names: Iterable[str]) -> str:
    return textwrap.fill(f"{what}: {listed(names, 200)}", 96, initial_indent="  ",
                         subsequent_indent="    ", break_on_hyphens=False)  # fmt: skip
