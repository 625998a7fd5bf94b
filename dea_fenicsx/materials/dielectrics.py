"""Dielectrics whose permittivity changes with stretch, each an energy of strain and field.

The strain enters by x = I1 - 3, where I1 = lam1^2 + lam2^2 + lam3^2.  Beyond the largest stretch of
a law x levels off within a tenth of its range, so that the permittivity and its slope stay
continuous and bounded.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from dea_fenicsx.materials.base import EPSILON_0
from dea_fenicsx.materials.electric import Breakdown, Dielectric, FieldPoint
from dea_fenicsx.support.later import Later
from dea_fenicsx.support.type_checks import is_number, shown
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import is_finite

interpolate = Later("scipy.interpolate")

LEVELLING_SHARE = 0.1
"""Share of the range of x within which it levels off beyond the largest stretch."""

CHECKED_STRAINS = 1001
"""Number of strains at which a permittivity is compared with that of vacuum."""


def equibiaxial(stretch: Any) -> Any:
    """x = I1 - 3 of an equi-biaxial stretch."""
    return 2 * stretch**2 + stretch**-4 - 3


class OverStretch(Dielectric):
    """Base of laws eps = eps_r eps_0 f(I1 - 3), u = eps e.e/2, that hold up to a stretch.

    A law gives its `factor` f, with f(0) = 1.
    """

    eps_r: float
    largest_stretch: float
    is_ideal: ClassVar[bool] = False
    depends_on_strain: ClassVar[bool] = True
    constants: ClassVar[dict[str, str]] = {"eps_r": "permittivity"}

    @abstractmethod
    def factor(self, s: Any, x: Any) -> Any:
        """f at x = I1 - 3, a number, a series or an expression."""

    def permittivity(self) -> float:
        return self.eps_r * EPSILON_0

    def form(self) -> Hashable:
        return (self.largest_stretch,)

    def coenergy(self, s: FieldPoint) -> Any:
        """eps e.e/2"""
        edge = float(equibiaxial(self.largest_stretch))
        width = LEVELLING_SHARE * edge
        x = s.I1 - 3
        beyond = s.at_least(x, edge) - edge
        level = edge + width * (1 - s.exp(-1 * beyond / width))
        return self.eps_r / 2 * self.factor(s, s.choose(x, edge, x, level)) * s.e2

    def faults(self) -> list[str]:
        if not is_finite(self.eps_r) or self.eps_r < 1:
            return [f"eps_r is {self.eps_r!r}, but a relative permittivity is a finite number >= 1"]
        if not is_finite(self.largest_stretch) or self.largest_stretch <= 1:
            return [f"largest_stretch is {shown(self.largest_stretch)}, but must be a number > 1"]
        law = self.breakdown_law()
        return self.constant_faults() or self._low() + ([] if law is None else law.faults())

    def constant_faults(self) -> list[str]:
        """What is wrong with the constants of the factor."""
        return []

    def _low(self) -> list[str]:
        end = (1 + LEVELLING_SHARE) * equibiaxial(self.largest_stretch)
        x = np.linspace(0, end, CHECKED_STRAINS)
        eps = self.eps_r * np.array([float(self.factor(None, value)) for value in x])
        if np.all(eps >= 1):
            return []
        k = int(np.argmax(eps < 1))
        return [
            f"the relative permittivity falls to {eps[k]:.3g} at I1 - 3 = {x[k]:.3g}, but must be "
            f"at least 1 up to the equi-biaxial stretch {self.largest_stretch:g} and a tenth of "
            "the range of I1 beyond; lessen the fall or largest_stretch"
        ]


@dataclass(frozen=True)
@in_si(eps_r="", slope="", largest_stretch="", breakdown="V/m")
class LinearPermittivity(OverStretch):
    """eps = eps_r eps_0 [1 + slope (I1 - 3)].

    Parameters
    ----------
    eps_r
        Relative permittivity of the undeformed dielectric.
    slope
        Relative change per I1; negative where the permittivity falls with stretch.
    largest_stretch
        Equi-biaxial stretch up to which the law holds.
    breakdown
        Breakdown field in V/m, or a law of it.
    """

    eps_r: float
    slope: float
    largest_stretch: float = 3.0
    breakdown: float | Breakdown | None = None
    constants: ClassVar[dict[str, str]] = {"eps_r": "permittivity", "slope": ""}

    def factor(self, s: Any, x: Any) -> Any:
        return 1 + self.slope * x

    def constant_faults(self) -> list[str]:
        ok = is_finite(self.slope)
        return [] if ok else [f"slope is {shown(self.slope)}, but must be finite"]


@dataclass(frozen=True)
@in_si(eps_r="", largest_stretch="", breakdown="V/m")
class PolynomialPermittivity(OverStretch):
    """eps = eps_r eps_0 [1 + c1 x + c2 x^2 + ...], x = I1 - 3; see `LinearPermittivity`.

    Parameters
    ----------
    coefficients
        c1, c2, ...
    """

    eps_r: float
    coefficients: tuple[float, ...]
    largest_stretch: float = 3.0
    breakdown: float | Breakdown | None = None

    def __post_init__(self) -> None:
        if isinstance(self.coefficients, list):
            object.__setattr__(self, "coefficients", tuple(self.coefficients))

    def form(self) -> Hashable:
        return self.largest_stretch, self.coefficients

    def factor(self, s: Any, x: Any) -> Any:
        value: Any = 0.0
        for c in reversed(self.coefficients):
            value = (value + c) * x
        return 1 + value

    def constant_faults(self) -> list[str]:
        c = self.coefficients
        ok = isinstance(c, tuple) and c and all(map(is_finite, c))
        return [] if ok else [f"coefficients is {shown(c)}, but must be a list of finite numbers"]


@dataclass(frozen=True)
@in_si(breakdown="V/m")
class TabulatedPermittivity(OverStretch):
    """Relative permittivity through measured points, by monotone cubic interpolation in I1.

    Between two points the permittivity is monotone, and its slope is continuous.

    Parameters
    ----------
    stretches
        Equi-biaxial stretches, which rise from 1.
    eps_r_at
        Relative permittivity at each of them.
    breakdown
        Breakdown field in V/m, or a law of it.

    References
    ----------
    F. N. Fritsch, J. Butland, SIAM J. Sci. Stat. Comput. 5 (1984) 300.
    """

    stretches: Sequence[float]
    eps_r_at: Sequence[float]
    breakdown: float | Breakdown | None = None
    constants: ClassVar[dict[str, str]] = {}

    def __post_init__(self) -> None:
        for name in ("stretches", "eps_r_at"):
            value = getattr(self, name)
            if not isinstance(value, str) and np.iterable(value):
                object.__setattr__(self, name, tuple(value))

    @property
    def eps_r(self) -> float:  # type: ignore[override]
        """That of the undeformed dielectric."""
        return self.eps_r_at[0]

    @property
    def largest_stretch(self) -> float:  # type: ignore[override]
        """The last of the stretches."""
        return self.stretches[-1]

    def form(self) -> Hashable:
        return self.stretches, self.eps_r_at

    @cached_property
    def _pieces(self) -> tuple[np.ndarray, np.ndarray]:
        x = equibiaxial(np.array(self.stretches, dtype=float))
        curve = interpolate.PchipInterpolator(x, np.array(self.eps_r_at) / self.eps_r_at[0])
        end = [0.0, 0.0, float(curve.derivative()(x[-1])), float(curve(x[-1]))]
        return x, np.array([*curve.c.T, end])

    def factor(self, s: Any, x: Any) -> Any:
        starts, pieces = self._pieces

        def polynomial(k: int) -> Any:
            value: Any = 0.0
            for c in pieces[k]:
                value = value * (x - float(starts[k])) + float(c)
            return value

        if s is None:
            return polynomial(max(int(np.searchsorted(starts, x, "right")) - 1, 0))
        found = polynomial(len(starts) - 1)
        for k in range(len(starts) - 2, -1, -1):
            found = s.choose(x, float(starts[k + 1]), polynomial(k), found)
        return found

    def times(self, factor: float) -> TabulatedPermittivity:
        """A copy with all permittivities larger by a factor."""
        return replace(self, eps_r_at=tuple(factor * eps for eps in self.eps_r_at))

    def coenergy(self, s: FieldPoint) -> Any:
        """eps e.e/2"""
        return s.vacuum * super().coenergy(s)

    def faults(self) -> list[str]:
        x, f = self.stretches, self.eps_r_at
        for name, values in (("stretches", x), ("eps_r_at", f)):
            if not isinstance(values, tuple) or not all(is_number(v) for v in values):
                return [f"{name} is {shown(values)}, but must be a list of numbers"]
        if len(x) != len(f) or not 2 <= len(x) <= 50:
            return [f"stretches has {len(x)} and eps_r_at {len(f)} numbers, but must have as many "
                    "of both, from 2 to 50"]  # fmt: skip
        if x[0] != 1 or any(not b > a for a, b in pairwise(x)):
            return ["stretches must rise from 1, the undeformed dielectric, from each to the next"]
        return super().faults()
