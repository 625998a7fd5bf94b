"""The points of a study: a grid, a list, or a Latin hypercube."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import check_declared, shown
from dea_fenicsx.support.validation import finite, whole


@dataclass(frozen=True)
class LatinHypercube:
    """Points at random, of which each of the equal parts of a parameter's range has exactly one.

    Parameters
    ----------
    ranges
        For each parameter its smallest and its largest value.
    count
        Number of points.
    seed
        Points of the same seed are the same.
    """

    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    count: int = 10
    seed: int = 1


Over = Mapping[str, Sequence[Any]] | Sequence[Mapping[str, Any]] | LatinHypercube
"""A grid by the values of each parameter, a list of points, or a Latin hypercube."""


def points(over: Over) -> list[dict[str, Any]]:
    """The points of a study, each with the value of every parameter.

    Raises
    ------
    InputError
        If there is none, two are the same, a value is neither a number nor a text, or points have
        different parameters.
    """
    if isinstance(over, LatinHypercube):
        found = _hypercube(over)
    elif isinstance(over, Mapping):
        for name, values in over.items():
            if isinstance(values, str | bytes) or not hasattr(values, "__iter__"):
                raise InputError(
                    f"The study's values of {name!r} are {shown(values)}, but must be a list."
                )
        found = [
            dict(zip(over, values, strict=True)) for values in itertools.product(*over.values())
        ]
    elif isinstance(over, Sequence) and all(isinstance(point, Mapping) for point in over):
        found = [dict(point) for point in over]
    else:
        raise InputError(
            f"The study is over {shown(over)}, but must be over lists of values by the name of "
            "the parameter, a list of such points, or a LatinHypercube."
        )
    found = [{str(name): _plain(name, value) for name, value in p.items()} for p in found]
    if not found or not found[0]:
        raise InputError("The study has no points; give at least one value of each parameter.")
    for k, point in enumerate(found):
        if list(point) != list(found[0]):
            raise InputError(
                f"Point {k} of the study has the parameters {', '.join(point)}, but the first "
                f"has {', '.join(found[0])}; give each point the same ones in the same order."
            )
        if point in found[:k]:
            raise InputError(f"The point {_told(point)} is in the study twice; give it once.")
    return found


def _hypercube(over: LatinHypercube) -> list[dict[str, Any]]:
    check_declared(over)
    whole(over.count, "The count of a LatinHypercube", 1)
    whole(over.seed, "The seed of a LatinHypercube", 0)
    for name, (low, high) in over.ranges.items():
        finite(low, f"The lower end of the range of {name!r}")
        finite(high, f"The upper end of the range of {name!r}")
        if not low < high:
            raise InputError(f"The range of {name!r} is {low} to {high}; give the smaller first.")
    if not over.ranges:
        raise InputError("A LatinHypercube has no ranges; give at least one parameter.")
    from scipy.stats.qmc import LatinHypercube as Sampler

    shares = Sampler(len(over.ranges), rng=over.seed).random(over.count)
    return [
        {
            name: low + share * (high - low)
            for share, (name, (low, high)) in zip(row, over.ranges.items(), strict=True)
        }
        for row in shares
    ]


def _plain(name: object, value: Any) -> Any:
    """A value as JSON keeps it."""
    if hasattr(value, "item"):
        value = value.item()
    if isinstance(value, bool | str | int):
        return value
    finite(value, f"A value of the parameter {name!r}")
    return float(value)


def _told(point: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} = {value}" for name, value in point.items())
