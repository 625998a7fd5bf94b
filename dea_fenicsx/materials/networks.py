"""The energy of an entangled network: the extended tube."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from dea_fenicsx.materials.base import Strain, not_positive
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import is_finite


@dataclass(frozen=True)
@in_si(Gc="Pa", Ge="Pa", delta="", beta="")
class ExtendedTube:
    """Extended tube: cross-links Gc of finite length, and entanglements Ge.

    W = Gc/2 [(1 - delta^2)(I1 - 3)/m + ln m] + 2 Ge/beta^2 (sum lam_i^-beta - 3),
    m = 1 - delta^2 (I1 - 3).

    Parameters
    ----------
    Gc, Ge
        Moduli of the cross-links and of the entanglements in Pa.
    delta
        Inextensibility, 0 <= delta < 0.5.
    beta
        Release of the entanglements, > 0 and at most 1.

    References
    ----------
    Kaliske and Heinrich, Rubber Chem. Technol. 72 (1999) 602.
    """

    Gc: float
    Ge: float
    delta: float
    beta: float

    def energy(self, s: Strain) -> Any:
        d2, room = self.delta * self.delta, self.chain_margin(s)
        links = self.Gc / 2 * ((1 - d2) * (s.I1 - 3) / room + s.ln(room))
        return links + 2 * self.Ge / (self.beta * self.beta) * (s.power_sum(-self.beta) - 3)

    def shear_modulus(self) -> float:
        return self.Gc * (1 - 2 * self.delta * self.delta) + self.Ge

    def spherical_slope(self) -> float:
        return self.Gc * (1 - 2 * self.delta * self.delta) - 2 * self.Ge / self.beta

    def stress_size(self, s: Strain, lnJ: Any) -> Any:
        """Gc (I1 - 3 - 2 ln J)/m^2 + 2 Ge/beta (sum lam^-beta - 3 + beta ln J); see `Elastic`."""
        room = self.chain_margin(s)
        links = self.Gc * (s.I1 - 3 - 2 * lnJ) / (room * room)
        return links + 2 * self.Ge / self.beta * (s.power_sum(-self.beta) - 3 + self.beta * lnJ)

    def chain_margin(self, s: Strain) -> Any:
        return 1 - self.delta * self.delta * (s.I1 - 3)

    def faults(self) -> list[str]:
        found = not_positive(self, "Gc")
        for name, low, high in (("Ge", 0.0, math.inf), ("delta", 0.0, 0.5), ("beta", 0.0, 1.0)):
            value = getattr(self, name)
            if not is_finite(value) or not low <= value <= high:
                found.append(f"{name} is {shown(value)}, but must lie between {low:g} and {high:g}")
        if not found and (self.delta == 0.5 or self.beta == 0):
            found = [f"delta is {self.delta} and beta {self.beta}: delta must be < 0.5, beta > 0"]
        return found
