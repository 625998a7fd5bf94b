"""Alexander's energy of neoprene: stiffening by I1, and a logarithm of I2."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dea_fenicsx.materials.base import Strain, not_finite, not_positive
from dea_fenicsx.support.units import in_si

LEGENDRE_NODES, LEGENDRE_WEIGHTS = (
    tuple(map(float, x)) for x in np.polynomial.legendre.leggauss(16)
)
"""Gauss's rule for the integral; its error is below 1e-12 of it as long as k (I1 - 3)^2 < 10."""


@dataclass(frozen=True)
@in_si(C1="Pa", C2="Pa", C3="Pa", k="", gamma="")
class Alexander:
    """W = C1 int_0^x exp(k t^2) dt + C2 ln(1 + (I2 - 3)/gamma) + C3 (I2 - 3), x = I1 - 3.

    The constants in Pa contain the factor mu/2 of the source.

    Parameters
    ----------
    C1, C2, C3
        In Pa, the first one > 0.
    k
        Pure number, >= 0.
    gamma
        Pure number, > 0.

    References
    ----------
    H. Alexander, Int. J. Eng. Sci. 6 (1968) 549.
    """

    C1: float
    C2: float
    C3: float
    k: float
    gamma: float

    def energy(self, s: Strain) -> Any:
        x = s.I1 - 3
        mean: Any = 0
        for node, weight in zip(LEGENDRE_NODES, LEGENDRE_WEIGHTS, strict=True):
            share = (1 + node) / 2
            mean = mean + weight / 2 * s.exp(self.k * share**2 * x * x)
        second = s.I2 - 3
        return self.C1 * x * mean + self.C2 * s.ln(1 + second / self.gamma) + self.C3 * second

    def shear_modulus(self) -> float:
        return 2 * (self.C1 + self.C2 / self.gamma + self.C3)

    def spherical_slope(self) -> float:
        return 2 * self.C1 + 4 * (self.C2 / self.gamma + self.C3)

    def chain_margin(self, s: Strain) -> None:
        return None

    def faults(self) -> list[str]:
        found = [*not_positive(self, "C1", "gamma"), *not_finite(self, "C2", "C3", "k")]
        if not found and self.k < 0:
            found.append(f"k is {self.k!r}, but must be >= 0")
        return found
