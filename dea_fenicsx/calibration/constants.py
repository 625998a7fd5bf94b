"""The constants of materials by their names, to be read and set.

The names are those of `Problem.parameters` without the region: ``"elastic.mu"``,
``"elastic.alpha[1]"``, ``"viscous[0].tau"``, ``"electric.eps_r"``.  Of several materials each name
begins with that of its material: ``"active.elastic.mu"``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

from dea_fenicsx.support.type_checks import is_number


def constants_of(template: Any) -> dict[str, float]:
    """All numbers of a material, or of several by their names, with the names of the numbers."""
    if isinstance(template, Mapping):
        return {
            name: value
            for key, material in template.items()
            for name, value in _numbers(material, str(key))
        }
    return dict(_numbers(template, ""))


def with_constants(template: Any, values: Mapping[str, float]) -> Any:
    """A material, or several, with other values of some constants; other names are passed over."""
    if isinstance(template, Mapping):
        return {key: _changed(one, str(key), values) for key, one in template.items()}
    return _changed(template, "", values)


def _numbers(owner: Any, name: str) -> Iterator[tuple[str, float]]:
    if is_number(owner):
        yield name, float(owner)
    for part, value in _parts(owner, name):
        yield from _numbers(value, part)


def _parts(owner: Any, name: str) -> list[tuple[str, Any]]:
    """What a dataclass or a tuple holds, each part with its name."""
    if isinstance(owner, tuple):
        return [(f"{name}[{k}]", value) for k, value in enumerate(owner)]
    if not is_dataclass(owner):
        return []
    dot = f"{name}." if name else ""
    return [(f"{dot}{f.name}", getattr(owner, f.name)) for f in fields(owner) if f.init]


def _changed(owner: Any, name: str, values: Mapping[str, float]) -> Any:
    if is_number(owner):
        return values.get(name, owner)
    parts = [(_changed(value, part, values), value) for part, value in _parts(owner, name)]
    if all(new is old for new, old in parts):
        return owner
    if isinstance(owner, tuple):
        return tuple(new for new, _ in parts)
    names = [f.name for f in fields(owner) if f.init]
    changes = {n: new for n, (new, old) in zip(names, parts, strict=True) if new is not old}
    return replace(owner, **changes)
