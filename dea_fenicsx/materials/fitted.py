"""What a fit has found, and how it is printed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dea_fenicsx.materials.base import Elastic, choices, constants

CONSTANT_UNITS = {"mu": "Pa", "C10": "Pa", "C01": "Pa", "C20": "Pa", "C30": "Pa"}
"""Units of constants by their names; a constant that is not named here is a pure number."""

DIGITS = 4
"""Digits of a constant whose uncertainty says nothing of them."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model.

    Attributes
    ----------
    model
        The elastic model with the fitted constants.
    uncertainty
        Standard deviation of each constant, by name (a tuple for constants with several entries).
        Infinite where the data do not determine the constant, alone or beside another one.
    residual
        Root mean square of the stress residual over each curve's root mean square stress.
    r_squared
        Share of the stresses' variance that is explained.  With several curves the squares of each
        are divided by its mean square stress, as in the sum that is minimised.
    stable
        Whether the energy is stable in Drucker's sense over the data: every small change of stress
        does positive work on the strain it causes.
    """

    model: Elastic
    uncertainty: dict[str, Any]
    residual: dict[str, float]
    r_squared: float
    stable: bool

    def __str__(self) -> str:
        parts = ", ".join(f"{t} {100 * r:.1f} %" for t, r in self.residual.items())
        stability = "stable" if self.stable else "NOT stable (Drucker)"
        text = (
            f"{constants_told(self.model, self.uncertainty)}: residual {parts}; "
            f"R^2 {self.r_squared:.4f}; {stability} on the data"
        )
        loose = self.undetermined
        return text + (f"; the data do not determine {', '.join(loose)}" if loose else "")

    __repr__ = __str__

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of the constants whose standard deviation is larger than they are themselves."""
        return tuple(
            name for name, deviation in self.uncertainty.items()
            if np.any(np.asarray(deviation) > np.abs(getattr(self.model, name)))
        )  # fmt: skip


def constants_told(model: Any, uncertainty: Mapping[str, Any]) -> str:
    """A fitted model in words: "NeoHookean(mu = 42.3 ± 1.2 kPa)".

    Parameters
    ----------
    model
        The model.
    uncertainty
        Standard deviation of its constants, by name.
    """
    told = [
        f"{name} = {_told(getattr(model, name), uncertainty.get(name, math.nan), unit)}"
        for name, unit in ((name, CONSTANT_UNITS.get(name)) for name in constants(model))
    ]
    return f"{type(model).__name__}({', '.join([*told, *choices(model)])})"


def _told(value: Any, deviation: Any, unit: str | None) -> str:
    """A constant, or a tuple of them, with its standard deviation and its unit."""
    if isinstance(value, tuple):
        spread = deviation if isinstance(deviation, tuple) else (deviation,) * len(value)
        parts = [_told(v, d, unit) for v, d in zip(value, spread, strict=True)]
        return f"({', '.join(parts)})"
    size, name = _unit(float(value), unit)
    number = with_spread(float(value) / size, float(deviation) / size)
    return f"{number} {name}" if name else number


def _unit(value: float, unit: str | None) -> tuple[float, str]:
    """What a number is divided by, and the unit that it has then."""
    if not unit:
        return 1.0, ""
    for size, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if abs(value) >= size:
            return size, prefix + unit
    return 1.0, unit


def with_spread(value: float, deviation: float) -> str:
    """A number and its standard deviation, with the digits that mean something.

    The deviation has two digits and the number ends at the same place: "42.3 ± 1.2".
    """
    if not math.isfinite(value) or not deviation >= 0:
        return f"{value:.{DIGITS}g}"
    if math.isinf(deviation):
        return f"{value:.{DIGITS}g} ± inf"
    if deviation < 1e-9 * abs(value) or deviation == 0:
        return f"{value:.{2 * DIGITS}g} ± {deviation:.2g}"
    place = 1 - math.floor(math.log10(float(f"{deviation:.1e}")))
    if place > 2 * DIGITS or abs(value) >= 1e7:
        return f"{value:.{DIGITS}g} ± {deviation:.2g}"
    return f"{round(value, place):.{max(place, 0)}f} ± {round(deviation, place):.{max(place, 0)}f}"
