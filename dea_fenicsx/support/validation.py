"""Checks of single inputs that several modules share: names and numbers."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Sequence

from dea_fenicsx.support.errors import InputError


def known(name: str, names: Iterable[str], what: str, owner: str = "the mesh") -> None:
    """Raise InputError unless `name` is one of an owner's `names`; the nearest is suggested."""
    names = list(names)
    if name in names:
        return
    near = difflib.get_close_matches(name, names, n=1)
    hint = f"did you mean {near[0]!r}?" if near else ""
    listing = ", ".join(sorted(names)) or "none"
    raise InputError(f"There is no {what} named {name!r}; {hint} {owner} has: {listing}.")


def one_of(value: object, choices: Sequence[object], what: str) -> None:
    """Raise InputError unless `value` is one of a few choices."""
    if value not in choices:
        raise InputError(f"{what} is {value!r}, but must be one of {', '.join(map(str, choices))}.")


def finite(value: object, what: str) -> None:
    """Raise InputError unless `value` is a finite real number."""
    try:
        ok = math.isfinite(value)  # type: ignore[arg-type]
    except TypeError:
        ok = False
    if not ok:
        raise InputError(f"{what} is {value!r}, but must be a finite number.")
