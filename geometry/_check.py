"""Checks of parameters that every device family shares."""

from __future__ import annotations

from numbers import Integral
from typing import Any

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import is_number, shown
from dea_fenicsx.support.validation import is_finite, is_whole

MOST_METRES = 1e6
"""Lengths in m beyond which no device lies; squares of larger ones may overflow."""

MOST_CELLS_IN_LINE = 100_000
"""Cells along one direction beyond which a count is a slip of the pen."""


def length(owner: str, name: str, value: Any, *, zero: bool = False) -> float:
    """A finite positive length in metres (``zero``: not negative)."""
    good = is_number(value) and is_finite(value)
    if good and value > MOST_METRES:
        raise InputError(
            f"{owner}: {name} is {shown(value)} m; it must be at most {MOST_METRES:g} m."
        )
    if not good or value < 0 or (value == 0 and not zero):
        kind = "zero or a positive length" if zero else "a positive length"
        raise InputError(f"{owner}: {name} is {shown(value)}; it must be {kind} in metres.")
    return float(value)


def number(owner: str, name: str, value: Any) -> float:
    """Any finite number."""
    if not is_number(value) or not is_finite(value):
        raise InputError(f"{owner}: {name} is {shown(value)}; it must be a finite number.")
    return float(value)


def count(owner: str, name: str, value: Any, least: int = 1) -> int:
    """A whole number of at least ``least``."""
    if isinstance(value, Integral) and int(value) > MOST_CELLS_IN_LINE:
        raise InputError(
            f"{owner}: {name} is {shown(value)}; it must be at most {MOST_CELLS_IN_LINE}."
        )
    if not is_whole(value, least):
        raise InputError(
            f"{owner}: {name} is {shown(value)}; it must be a whole number of at least {least}."
        )
    return int(value)


def ratio(owner: str, name: str, value: Any) -> float:
    """A finite positive grading ratio."""
    good = is_number(value) and is_finite(value)
    if not good or value <= 0:
        raise InputError(
            f"{owner}: {name} is {shown(value)}; it must be a positive ratio, largest over "
            "smallest cell."
        )
    return float(value)


class HigherOrder(int):
    """A degree of the cells' geometry that gmsh files do not have, for meshes made here."""


def order(owner: str, value: Any) -> int:
    """Degree of the cells' geometry."""
    if isinstance(value, HigherOrder):
        return int(value)
    if not isinstance(value, Integral) or isinstance(value, bool) or value not in (1, 2):
        raise InputError(
            f"{owner}: order is {shown(value)}; it must be 1 (straight) or 2 (curved)."
        )
    return int(value)


def group_name(owner: str, name: str, value: Any) -> str:
    """A name that a .msh file can carry."""
    if (
        not isinstance(value, str)
        or not value.isprintable()
        or '"' in value
        or not value
        or value != value.strip()
        or len(value) > 100
    ):
        raise InputError(
            f"{owner}: {name} is {shown(value)}; it must be a plain word of 1 to 100 characters "
            "without quotes."
        )
    return value
