"""Checks of single inputs that several modules share: names and numbers."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping
from typing import Any

from dea_fenicsx.support.errors import InputError


def known(name: str, names: Iterable[str], what: str) -> None:
    """Raise InputError unless `name` is one of `names`, with the nearest as a suggestion."""
    names = list(names)
    if name in names:
        return
    near = difflib.get_close_matches(name, names, n=1)
    hint = f"did you mean {near[0]!r}?" if near else ""
    listing = ", ".join(sorted(names)) or "none"
    raise InputError(f"There is no {what} named {name!r}; {hint} the mesh has: {listing}.")


def finite(value: object, what: str) -> None:
    """Raise InputError unless `value` is a finite real number."""
    try:
        ok = math.isfinite(value)  # type: ignore[arg-type]
    except TypeError:
        ok = False
    if not ok:
        raise InputError(f"{what} is {value!r}, but must be a finite number.")


def keywords(
    function: str, given: Mapping[str, Any], kind: type, defaults: Mapping[str, Any]
) -> dict[str, Any]:
    """The keywords that a function takes as a typed dictionary, with those left out filled in.

    Parameters
    ----------
    function
        The name of the function, for the message.
    given
        What the caller has given.
    kind
        The TypedDict that declares the keywords.
    defaults
        Values of those that may be left out.

    Raises
    ------
    InputError
        For a keyword that is not declared, with the nearest as a suggestion, and for one that is
        missing.
    """
    names = list(kind.__annotations__)
    for name in given:
        if name not in names:
            near = difflib.get_close_matches(name, names, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"it takes {', '.join(names)}, too."
            raise InputError(f"{function} takes no keyword {name!r}; {hint}")
    found = {**defaults, **given}
    for name in kind.__required_keys__:  # type: ignore[attr-defined]
        if name not in found:
            raise InputError(f"{function} needs {name}=, which is missing.")
    return found
