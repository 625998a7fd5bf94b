"""Rows of the table, where they come from, and how they are written."""

from __future__ import annotations

import csv
import pkgutil
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module, resources
from pathlib import Path
from types import ModuleType
from typing import Any

from dea_fenicsx.support.errors import InputError

REPRODUCED = "reproduced"
ASSUMED = "reproduced with a named assumption"
WRONG = "thesis wrong"
MISSING = "not reproducible"
COMPUTED = "computed"
STATUSES = (REPRODUCED, ASSUMED, WRONG, MISSING, COMPUTED)
"""What a row may say; `COMPUTED` marks a number that the thesis does not print."""

COLUMNS = ("system", "name", "printed", "ours", "unit", "status", "note")


@dataclass(frozen=True)
class Row:
    """One published number, or one that the thesis should have printed.

    Attributes
    ----------
    system, name : what it is
    printed : as in the thesis, empty where it prints none
    ours : this package's value, empty where it has none
    unit : SI unit, "-" for none
    status : one of `STATUSES`
    note : the assumption, why the thesis is wrong, or what is missing
    """

    system: str
    name: str
    printed: Any
    ours: Any
    unit: str
    status: str
    note: str = ""

    def cells(self) -> list[str]:
        return [_text(getattr(self, c)) for c in COLUMNS]


def _text(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, str):
        return value
    if isinstance(value, Sequence):
        return "; ".join(_text(v) for v in value)
    return f"{value:.7g}"


@cache
def printed_numbers() -> dict[tuple[str, str], dict[str, Any]]:
    """What the thesis prints: (system, name) to a dictionary of printed, unit and where."""
    text = resources.files("dea_fenicsx.thesis").joinpath("printed.toml").read_text("utf-8")
    return {
        (system, name): entry
        for system, entries in tomllib.loads(text).items()
        for name, entry in entries.items()
    }


def answer(system: str, name: str, ours: Any, status: str, note: str = "") -> Row:
    """The row that answers a printed number."""
    if status not in STATUSES:
        raise InputError(f"The status {status!r} of {system}.{name} is none of {STATUSES}.")
    entry = printed_numbers()[(system, name)]
    return Row(system, name, entry["printed"], ours, entry["unit"], status, note)


def computed(system: str, name: str, ours: Any, unit: str, note: str = "") -> Row:
    """A row for a number that the thesis does not print."""
    return Row(system, name, None, ours, unit, COMPUTED, note)


def modules() -> list[ModuleType]:
    """The files of `dea_fenicsx.thesis.systems`, in the order of their names."""
    package = import_module("dea_fenicsx.thesis.systems")
    found = sorted(m.name for m in pkgutil.iter_modules(package.__path__))
    return [import_module(f"{package.__name__}.{n}") for n in found if not n.startswith("_")]


def collect() -> list[Row]:
    """All rows of all systems."""
    return [row for module in modules() for row in module.rows()]


def write_csv(rows: Sequence[Row], path: Path) -> None:
    """Write the table as CSV, one line a row."""
    with path.open("w", newline="", encoding="utf-8") as f:
        writer = csv.writer(f)
        writer.writerow(COLUMNS)
        writer.writerows(row.cells() for row in rows)


def write_markdown(rows: Sequence[Row], path: Path) -> None:
    """Write the table as Markdown, a section for each system, with a count of each status."""
    lines = ["# The numbers of the thesis", ""]
    counts = {s: sum(row.status == s for row in rows) for s in STATUSES}
    lines += [", ".join(f"{n} {s}" for s, n in counts.items() if n) + ".", ""]
    for system in dict.fromkeys(row.system for row in rows):
        lines += [f"## {system}", "", "| " + " | ".join(COLUMNS[1:]) + " |"]
        lines.append("|" + "---|" * len(COLUMNS[1:]))
        for row in rows:
            if row.system == system:
                cells = [c.replace("|", "\\|") for c in row.cells()[1:]]
                lines.append("| " + " | ".join(cells) + " |")
        lines.append("")
    path.write_text("\n".join(lines), encoding="utf-8")
