"""What a search is about: its variables with their ranges, its objectives and its constraints."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import did_you_mean

Range = tuple[float, float]
Limit = tuple[float | None, float | None]


def ranges(given: Mapping[str, Any]) -> tuple[dict[str, Range], dict[str, float]]:
    """Ranges of what is searched, and values of what is fixed (a number, or lower = upper).

    Raises
    ------
    InputError
        For a lower bound above the upper one, and for what is no pair of finite numbers.
    """
    free: dict[str, Range] = {}
    fixed: dict[str, float] = {}
    for name, value in given.items():
        if isinstance(value, int | float | np.number) and not isinstance(value, bool):
            low = high = float(value)
        else:
            try:
                low, high = (float(v) for v in value)
            except (TypeError, ValueError) as error:
                raise InputError(
                    f"The range of {name!r} is {value!r}, but must be a number or a pair (lower, "
                    "upper)."
                ) from error
        if not (math.isfinite(low) and math.isfinite(high)):
            raise InputError(f"The range of {name!r} is {value!r}, but must be finite.")
        if low > high:
            raise InputError(
                f"The range of {name!r} has its lower bound {low:g} above its upper bound "
                f"{high:g}; exchange them."
            )
        if low == high:
            fixed[name] = low
        else:
            free[name] = (low, high)
    if not free:
        raise InputError("All variables are fixed; give at least one a range (lower, upper).")
    return free, fixed


def goals(given: Mapping[str, str]) -> dict[str, str]:
    """Objectives with their directions, checked."""
    if not given:
        raise InputError('There is no objective; name at least one, as {"stroke": "max"}.')
    for name, kind in given.items():
        if kind not in ("min", "max"):
            raise InputError(
                f'The objective {name!r} is to be {kind!r}, but must be "min" or "max".'
            )
    return dict(given)


def limits(given: Mapping[str, Any]) -> dict[str, Limit]:
    """Constraints as (lower, upper) on quantities by name, None for an open end, checked."""
    found: dict[str, Limit] = {}
    for name, value in given.items():
        try:
            low, high = (None if v is None else float(v) for v in value)
        except (TypeError, ValueError) as error:
            raise InputError(
                f"The constraint on {name!r} is {value!r}, but must be a pair (lower, upper) with "
                "None for an open end."
            ) from error
        if (low is None and high is None) or any(v is not None and math.isnan(v)
                                                 for v in (low, high)):  # fmt: skip
            raise InputError(f"The constraint on {name!r} bounds nothing; give a number.")
        if low is not None and high is not None and low > high:
            raise InputError(
                f"The constraint on {name!r} has its lower bound {low:g} above its upper bound "
                f"{high:g}, so nothing satisfies it."
            )
        found[name] = (low, high)
    return found


def violations(
    bounds: Mapping[str, Limit], columns: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """How far each design misses each constraint, relative to the bound; 0 or less where it holds.

    One entry for each bound, named as a reader would write it: ``"height <= 0.01"``.
    """
    found = {}
    for name, (low, high) in bounds.items():
        q = columns[name]
        for bound, sign, word in ((low, -1, ">="), (high, 1, "<=")):
            if bound is not None:
                found[f"{name} {word} {bound:g}"] = sign * (q - bound) / max(abs(bound), 1e-300)
    return found


def signs(objectives: Mapping[str, str]) -> list[int]:
    """+1 for what is to be small, -1 for what is to be large."""
    return [1 if kind == "min" else -1 for kind in objectives.values()]


def one_of(name: str, names: Iterable[str], what: str) -> str:
    """`name` if it is one of `names`; else InputError with the nearest as a suggestion."""
    names = list(names)
    if name in names:
        return name
    hint = f"{did_you_mean(name, names)} ".lstrip()
    raise InputError(f"There is no {what} {name!r}; {hint}there are: {', '.join(names)}.")


def check_resumable(resume: bool, out: Any) -> None:
    """Raise InputError for a search that is to be resumed without the folder of its designs."""
    if resume and out is None:
        raise InputError("A search can be resumed from a folder only; give out=.")
