"""Checks that an object's values have the types that its class declares: numbers, names, tuples.

A dataclass's annotations are the declaration.  What a value may be within its type (positive, known
to the mesh) is checked where it matters.
"""

from __future__ import annotations

import inspect
import numbers
import types
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from reprlib import Repr
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

from dea_fenicsx.support.errors import InputError

_short = Repr()
_short.maxstring = _short.maxlong = _short.maxother = 40


def shown(value: Any) -> str:
    """A value for a message: on one line and not too long."""
    return " ".join(_short.repr(value).split())


def raised(error: BaseException) -> str:
    """An error that a function of the user's has raised, for a message: on one line."""
    words = " ".join(str(error).split())
    return f"{type(error).__name__}: {words[:119]}" if words else type(error).__name__


def check_declared(item: Any) -> None:
    """Raise InputError unless each field of a dataclass holds what is declared, deeply.

    What is no dataclass, a class whose annotations cannot be read, and a field with the metadata
    ``checked=False`` are left alone.
    """
    if not is_dataclass(item) or isinstance(item, type):
        return
    hints = _hints(type(item))
    for field in fields(item):
        if not field.init or not field.metadata.get("checked", True):
            continue
        value = getattr(item, field.name)
        hint = hints.get(field.name, Any)
        if not _fits(value, hint):
            raise InputError(
                f"{type(item).__name__}: {field.name} is {shown(value)}, but must be "
                f"{_words(hint)}."
            )
        inside = value.values() if isinstance(value, Mapping) else value
        for part in inside if isinstance(inside, list | tuple | type({}.values())) else (value,):
            check_declared(part)


@cache
def _hints(kind: type) -> dict[str, Any]:
    try:
        return get_type_hints(kind)
    except Exception:  # a class of the user's may be annotated with anything
        return {}


def is_number(value: Any) -> bool:
    """Whether a value can stand for a real number: neither text nor a truth value."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, bool | np.bool_) or not isinstance(value, numbers.Real):
        return False
    try:
        float(value)
    except (OverflowError, TypeError, ValueError):
        return False
    return True


def plain(value: Any) -> Any:
    """A number of numpy's, a fraction or an array as Python's own numbers, deeply in tuples.

    Whole numbers become ``int``, truth values ``bool`` and other real numbers ``float``; an array
    of one dimension or a range becomes a tuple.  A list stays a list.  All else, what is no number
    and numbers too large for a float too, is returned as it is.
    """
    if isinstance(value, np.ndarray):
        if value.dtype.kind not in "biufUO" or value.ndim > 1:
            return value
        if value.ndim:
            return tuple(plain(v) for v in value)
        inner = value[()]  # numpy's masked constant holds itself
        return value if isinstance(inner, np.ndarray) else plain(inner)
    if isinstance(value, np.generic):
        if isinstance(value, np.bool_):
            return bool(value)
        if isinstance(value, np.integer):
            return int(value)
        if isinstance(value, np.floating):
            return float(value)
        return str(value) if isinstance(value, np.str_) else value
    if isinstance(value, range):
        return tuple(value)
    if type(value) in (list, tuple):
        found = [plain(v) for v in value]
        same = all(a is b for a, b in zip(found, value, strict=True))
        return value if same else type(value)(found)
    if isinstance(value, numbers.Real) and not isinstance(value, int | float) and is_number(value):
        whole = isinstance(value, numbers.Integral)
        return int(value) if whole else float(value)  # type: ignore[call-overload]
    return value


def settle(item: Any) -> None:
    """Let the fields of a dataclass hold Python's own numbers, see `plain`.

    An array or a list becomes a tuple where a tuple is declared; elsewhere it stays.
    """
    kind: Any = type(item)
    hints = _hints(kind)
    for name in item.__dataclass_fields__:
        value = getattr(item, name, None)
        due = _is_tuple(hints.get(name))
        if isinstance(value, np.ndarray) and value.ndim and not due:
            continue
        found = plain(value)
        if type(found) is list and due:
            found = tuple(found)
        if found is not value:
            object.__setattr__(item, name, found)


def _is_tuple(hint: Any) -> bool:
    origin = get_origin(hint)
    if origin in (Union, types.UnionType):
        return any(_is_tuple(one) for one in get_args(hint))
    return origin is tuple or origin is Sequence


def plain_numbers[T](cls: type[T]) -> type[T]:
    """Class decorator, below ``@dataclass``: numbers of any kind are turned into Python's own.

    ``steps=np.int64(5)``, ``at=np.linspace(0, 1, 5)`` and ``to=Fraction(1, 2)`` are taken so.
    """
    own = getattr(cls, "__post_init__", None)

    def __post_init__(self: T) -> None:
        settle(self)
        if own is not None:
            own(self)

    cls.__post_init__ = __post_init__  # type: ignore[attr-defined]
    return cls


def _fits(value: Any, hint: Any) -> bool:
    """Whether a value is what an annotation says."""
    origin, inner = get_origin(hint), get_args(hint)
    if hint is Any:
        return True
    if origin in (Union, types.UnionType):
        return any(_fits(value, one) for one in inner)
    if origin is Literal:  # whether it is one of them is told by the class that declares it
        return any(_fits(value, type(one)) for one in inner)
    if hint is None or hint is type(None):
        return value is None
    if hint is float:
        return is_number(value)
    if hint is int:
        return isinstance(value, numbers.Integral) and is_number(value)
    if hint is bool:
        return isinstance(value, bool | np.bool_)
    if origin is tuple or origin is Sequence:
        if not isinstance(value, list | tuple) and not (
            isinstance(value, np.ndarray) and value.ndim == 1
        ):
            return False
        if origin is Sequence or (len(inner) == 2 and inner[1] is Ellipsis):
            return all(_fits(one, inner[0]) for one in value)
        return len(value) == len(inner) and all(map(_fits, value, inner))
    if origin is not None and issubclass(origin, Mapping):
        return isinstance(value, Mapping) and all(_fits(key, inner[0]) for key in value)
    if not isinstance(hint, type):
        return True
    try:
        return isinstance(value, hint)
    except TypeError:  # a protocol that cannot be asked
        return True


def _kinds(base: type[Any]) -> Iterator[type[Any]]:
    """The classes that can be made below an abstract one, in the order of their definition."""
    for kind in base.__subclasses__():
        if not inspect.isabstract(kind):
            yield kind
        yield from _kinds(kind)


def _words(hint: Any) -> str:
    """An annotation in words."""
    origin, inner = get_origin(hint), get_args(hint)
    plain = {float: "a number", int: "a whole number", bool: "True or False", str: "a name",
             type(None): "None", None: "None"}  # fmt: skip
    if hint in plain:
        return plain[hint]
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(_words(one) for one in inner))
    if origin is Literal:
        return " or ".join(dict.fromkeys(_words(type(one)) for one in inner))
    if isinstance(hint, type) and inspect.isabstract(hint):
        return " or ".join(dict.fromkeys(_words(one) for one in _kinds(hint))) or hint.__name__
    if origin is tuple or origin is Sequence:
        many = origin is Sequence or (len(inner) == 2 and inner[1] is Ellipsis)
        kinds = list(dict.fromkeys(_words(one) for one in (inner[:1] if many else inner)))
        count = "" if many else f"{len(inner)} "
        if len(kinds) == 1 and " or " not in kinds[0]:
            return f"a tuple of {count}{kinds[0].removeprefix('a ').removeprefix('an ')}s"
        return f"a tuple of {count}({' and '.join(kinds)})"
    if origin is not None and issubclass(origin, Mapping):
        return f"a dictionary by {_words(inner[0]).removeprefix('a ')}"
    name = getattr(hint, "__name__", str(hint))
    return f"{'an' if name[0] in 'AEIO' else 'a'} {name}"
