"""Breakdown of dielectrics as a matter of chance: electrode area, thickness and time held."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from dea_fenicsx.materials.electric import Breakdown
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import is_finite, is_positive


@dataclass(frozen=True)
@in_si(
    field="V/m", exponent="", modulus="", probability="", area_ratio="", thickness_ratio="",
    thickness_exponent="", time_ratio="", time_exponent="",
)  # fmt: skip
class WeibullBreakdown(Breakdown):
    """A breakdown field of a film of given area, thickness and time, at a given probability.

    A film breaks down with the probability P = 1 - exp[-A/A_0 (E/E_0)^m], where

        E_0 = field lam^exponent (H/H_0)^-thickness_exponent (t/t_0)^-time_exponent,

    so that `field` is that at which 63 % of the films of the reference break down.  As a law of a
    dielectric it gives the field E at which P is `probability`.

    Parameters
    ----------
    field, exponent
        Scale of the field of the reference in V/m, and exponent of the stretch; see `Breakdown`.
    modulus
        Weibull modulus m.
    probability
        Probability of breakdown at which the field counts as reached.
    area_ratio, thickness_ratio, time_ratio
        Electrode area A, undeformed thickness H and time t at the voltage over those of the tests
        from which the constants are.
    thickness_exponent, time_exponent
        How the field falls with thickness and time.

    References
    ----------
    W. Weibull, J. Appl. Mech. 18 (1951) 293.
    """

    modulus: float = 10.0
    probability: float = 1 - math.exp(-1)
    area_ratio: float = 1.0
    thickness_ratio: float = 1.0
    thickness_exponent: float = 0.0
    time_ratio: float = 1.0
    time_exponent: float = 0.0

    def scale(self, stretch: Any) -> Any:
        """E_0 in V/m at a stretch, of the reference area."""
        sizes = self.thickness_ratio**-self.thickness_exponent
        return self.field * stretch**self.exponent * sizes * self.time_ratio**-self.time_exponent

    def at(self, stretch: Any) -> Any:
        """Field in V/m at which a film breaks down with the given probability."""
        part = -math.log1p(-self.probability) / self.area_ratio
        return self.scale(stretch) * part ** (1 / self.modulus)

    def probability_at(self, field: Any, stretch: Any = 1.0) -> Any:
        """Probability of breakdown at a true field in V/m and a stretch."""
        ratio = np.asarray(field) / self.scale(stretch)
        return -np.expm1(-self.area_ratio * ratio**self.modulus)

    def faults(self) -> list[str]:
        found = super().faults()
        for name in ("modulus", "area_ratio", "thickness_ratio", "time_ratio"):
            if not is_positive(value := getattr(self, name)):
                found.append(f"{name} is {shown(value)}, but must be a finite number > 0")
        for name in ("thickness_exponent", "time_exponent"):
            if not is_finite(value := getattr(self, name)):
                found.append(f"{name} is {shown(value)}, but must be a finite number")
        if not is_finite(self.probability) or not 0 < self.probability < 1:
            found.append(f"probability is {shown(self.probability)}, but must be between 0 and 1")
        return found
