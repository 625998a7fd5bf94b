"""The table of a study, and its picture."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dea_fenicsx.pictures.curves import STYLE, axis_label, write_whole
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.files import replace_file

MOST_LINES = 12
"""Most curves in a picture; further ones are left out of it, and not of the table."""


def write_table(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows as CSV, with all columns that any row has."""
    names = list(dict.fromkeys(name for row in rows for name in row))

    def write(target: Path) -> None:
        with target.open("w", newline="", encoding="utf-8") as f:
            writer = csv.DictWriter(f, names, restval="")
            writer.writeheader()
            writer.writerows(rows)

    replace_file(path, write)


def write_parquet(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows as Parquet, with all columns that any row has.

    A column of numbers and texts becomes one of texts.

    Raises
    ------
    InputError
        If pyarrow is not installed.
    """
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise InputError(
            "The table as Parquet needs pyarrow; install it with pip install pyarrow, or read "
            "table.csv."
        ) from error
    names = list(dict.fromkeys(name for row in rows for name in row))
    table = pyarrow.table({name: _alike([row.get(name) for row in rows]) for name in names})
    replace_file(path, lambda target: parquet.write_table(table, target))


def _alike(values: list[Any]) -> list[Any]:
    """Values of a column, as texts if some of them are texts."""
    if not any(isinstance(value, str) for value in values):
        return values
    return [None if value is None else str(value) for value in values]


def draw(
    path: Path, rows: Sequence[Mapping[str, Any]], names: Sequence[str], columns: Sequence[str]
) -> None:
    """Draw each column over the first parameter that is a number; a curve for each set of others.

    Nothing is drawn if there is no such parameter or no column.
    """
    across = [n for n in names if all(_is_number(row[n]) for row in rows)]
    if not across or not columns:
        return
    import matplotlib
    from matplotlib.figure import Figure

    x, others = across[0], [name for name in names if name != across[0]]
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(5.0, 2.6 * len(columns)), layout="constrained")
        for axes, column in zip(figure.subplots(len(columns), squeeze=False)[:, 0], columns,
                                strict=True):  # fmt: skip
            _draw_column(axes, rows, x, others, column)
        write_whole(path, lambda p: figure.savefig(p, format="png", dpi=200))


def _draw_column(
    axes: Any, rows: Sequence[Mapping[str, Any]], x: str, others: Sequence[str], column: str
) -> None:
    """Draw a column of completed runs; a cross is the last state of a run that was not completed.

    That state belongs to another load.
    """
    curves: dict[str, list[tuple[float, float]]] = {}
    failed = []
    for row in rows:
        if not _is_number(row.get(column)):
            continue
        if not str(row.get("status", "")).startswith("completed"):
            failed.append((row[x], row[column]))
            continue
        label = ", ".join(f"{n} = {_short(row[n])}" for n in others)
        curves.setdefault(label, []).append((row[x], row[column]))
    drawn = [*list(curves.values())[:MOST_LINES], failed]
    text, unit = axis_label(column, max((abs(y) for part in drawn for _, y in part), default=0.0))

    def scaled(part: Sequence[tuple[float, float]]) -> list[tuple[float, ...]]:
        return list(zip(*((at, value / unit) for at, value in part), strict=True))

    for label, found in list(curves.items())[:MOST_LINES]:
        axes.plot(*scaled(sorted(found)), "o-", ms=3, label=label or None)
    if failed:
        axes.plot(*scaled(failed), "kx", ms=5, label="not completed")
    axes.set_xlabel(x.replace("_", " "))
    axes.set_ylabel(text)
    if failed or (others and curves):
        axes.legend(fontsize=6.5)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _short(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
