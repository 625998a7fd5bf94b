"""Checks of single inputs that several modules share: names and numbers.

The questions (`nearest`, `is_finite`, `is_positive`, `is_whole`) serve every module; the checks
raise an InputError of one form, "What is value, but must be ...".
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from numbers import Integral
from typing import Any

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import plain, shown


def nearest(name: object, names: Iterable[str], cutoff: float = 0.6) -> str | None:
    """The one of `names` that is spelt most like `name`, or None if none is much alike."""
    near = difflib.get_close_matches(str(name), list(names), n=1, cutoff=cutoff)
    return near[0] if near else None


def did_you_mean(name: object, names: Iterable[str]) -> str:
    """``did you mean 'x'?`` for a name that is not known, or nothing."""
    near = nearest(name, names)
    return "" if near is None else f"did you mean {near!r}?"


def known(name: str, names: Iterable[str], what: str, owner: str = "the mesh") -> None:
    """Raise InputError unless `name` is one of an owner's `names`; the nearest is suggested."""
    names = list(names)
    if name not in names:
        listing = ", ".join(sorted(names)) or "none"
        hint = did_you_mean(name, names)
        raise InputError(
            f"There is no {what} named {name!r};{f' {hint}' if hint else ''} {owner} has: "
            f"{listing}."
        )


def is_finite(value: Any) -> bool:
    """Whether a value is a finite real number."""
    try:
        return math.isfinite(value)
    except (TypeError, ValueError, OverflowError):  # the last one: a whole number above 1e308
        return False


def is_positive(value: Any) -> bool:
    """Whether a value is a finite number > 0."""
    return is_finite(value) and bool(value > 0)


def is_whole(value: Any, least: int) -> bool:
    """Whether a value is a whole number of at least `least`.  True and False are no numbers."""
    return isinstance(value, Integral) and not isinstance(value, bool) and int(value) >= least


def finite(value: object, what: str) -> None:
    """Raise InputError unless `value` is a finite real number."""
    if not is_finite(value):
        raise _refused(value, what, "a finite number")


def positive(value: object, what: str, due: str = "a number > 0") -> None:
    """Raise InputError unless `value` is a finite number > 0; `due` says what it must be."""
    if not is_positive(value):
        raise _refused(value, what, due)


def whole(value: object, what: str, least: int) -> None:
    """Raise InputError unless `value` is a whole number of at least `least`."""
    if not is_whole(value, least):
        raise _refused(value, what, f"a whole number of at least {least}")


def one_of(value: object, choices: Sequence[str], what: str, due: str = "") -> None:
    """Raise InputError unless `value` is one of a few choices; `due` says them in other words."""
    if value not in choices:
        raise _refused(value, what, due or f"one of {', '.join(choices)}")


def _refused(value: object, what: str, due: str) -> InputError:
    return InputError(f"{what} is {shown(plain(value))}, but must be {due}.")


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
            hint = did_you_mean(name, names) or f"it takes {', '.join(names)}, too."
            raise InputError(f"{function} takes no keyword {name!r}; {hint}")
    found = {**defaults, **given}
    for name in kind.__required_keys__:  # type: ignore[attr-defined]
        if name not in found:
            raise InputError(f"{function} needs {name}=, which is missing.")
    return found
