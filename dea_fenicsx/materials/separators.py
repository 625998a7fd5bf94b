"""The separator of columns and the decimal sign of a text file of numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

SEPARATORS = (None, ";", "\t", "|", ",")
"""Separators that are tried, in this order; None stands for blanks."""


def parsed(
    lines: Sequence[str],
    delimiter: str | None,
    decimal: str,
    read: Callable[[list[str]], Any],
) -> list[Any]:
    """Rows of a table of numbers; lines from which no row can be read are passed over.

    Parameters
    ----------
    lines
        The lines of the file.
    delimiter, decimal
        The separator of columns (None for blanks) and the decimal sign that are tried first.  Where
        they give no row, others are tried, and those that give most rows are taken.
    read
        Makes a row of the cells of a line, in which the decimal sign is a point.  It raises
        ValueError or IndexError where there is none.
    """
    rows = _rows(lines, delimiter, decimal, read)
    if rows:
        return rows
    # A comma between numbers is a separator only where no other sign can be one: in "1,5;2,3" and
    # in "1,5 2,3" it is the decimal sign.
    trials = [(sign, point) for sign in SEPARATORS[:-1] for point in (decimal, ".", ",")]
    for some in (trials, [(",", ".")]):
        best = max((_rows(lines, *trial, read) for trial in some), key=len)
        if best:
            return best
    return []


def _rows(
    lines: Sequence[str], delimiter: str | None, decimal: str, read: Callable[[list[str]], Any]
) -> list[Any]:
    found = []
    for line in lines:
        cells = [cell.strip().strip('"').replace(decimal, ".") for cell in line.split(delimiter)]
        try:
            found.append(read(cells))
        except (ValueError, IndexError):
            continue
    return found
