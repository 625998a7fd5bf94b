"""Kilian's energy: a network as a van der Waals gas."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from dea_fenicsx.materials.base import Strain, not_positive
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import is_finite

ROOT_OFFSET = 1e-6
"""What is added to I - 3 under roots, so that their derivatives are finite in the undeformed state.

A smaller one would cost digits there, since second derivatives of the two terms with z cancel.  The
stress differs from that of the formula by less than 1e-6 of it where a stretch is beyond 1.2.
"""


@dataclass(frozen=True)
@in_si(mu="Pa", lam_m="", a="", beta="")
class VanDerWaals:
    """W = mu {-(lam_m^2 - 3)[ln(1 - z) + z] - 2/3 a [(I - 3)/2]^(3/2)}.

    z^2 = (I - 3)/(lam_m^2 - 3),  I = (1 - beta) I1 + beta I2.

    Parameters
    ----------
    mu
        Initial shear modulus in Pa.
    lam_m
        Locking stretch: the chains are taut where I = lam_m^2, > sqrt(3).
    a
        Interaction of the chains, >= 0.
    beta
        Share of the second invariant, from 0 to 1.

    References
    ----------
    H.-G. Kilian, Polymer 22 (1981) 209; in this form H.-G. Kilian, H. F. Enderle, K. Unseld,
    Colloid Polym. Sci. 264 (1986) 866.
    """

    mu: float
    lam_m: float
    a: float
    beta: float = 0.0

    def energy(self, s: Strain) -> Any:
        x, span = self._x(s), self.lam_m * self.lam_m - 3
        z = (x + ROOT_OFFSET) ** 0.5 / span**0.5
        z_0 = ROOT_OFFSET**0.5 / span**0.5
        chains = -1 * span * (s.ln((1 - z) / (1 - z_0)) + z - z_0)
        between = ((x + ROOT_OFFSET) / 2) ** 1.5 - (ROOT_OFFSET / 2) ** 1.5
        return self.mu * (chains - 2 / 3 * self.a * between)

    def _x(self, s: Strain) -> Any:
        return (1 - self.beta) * (s.I1 - 3) + self.beta * (s.I2 - 3)

    def _slope(self) -> float:
        """2 dW/dI at rest, in which `ROOT_OFFSET` shows; it is mu within 1e-3."""
        z_0 = (ROOT_OFFSET / (self.lam_m * self.lam_m - 3)) ** 0.5
        return self.mu * (1 / (1 - z_0) - self.a * (ROOT_OFFSET / 2) ** 0.5)

    def shear_modulus(self) -> float:
        return self._slope()

    def spherical_slope(self) -> float:
        return self._slope() * (1 + self.beta)

    def chain_margin(self, s: Strain) -> Any:
        return 1 - self._x(s) / (self.lam_m * self.lam_m - 3)

    def faults(self) -> list[str]:
        found = not_positive(self, "mu")
        if not is_finite(self.lam_m) or not self.lam_m > 3**0.5:
            found.append(f"lam_m is {shown(self.lam_m)}, but must be a finite number > sqrt(3)")
        if not is_finite(self.a) or self.a < 0:
            found.append(f"a is {shown(self.a)}, but must be a finite number >= 0")
        if not is_finite(self.beta) or not 0 <= self.beta <= 1:
            found.append(f"beta is {shown(self.beta)}, but must lie between 0 and 1")
        return found
