"""Softening of a rubber by its largest strain so far, the Mullins effect."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from dea_fenicsx.materials.base import Elastic, Strain, not_positive, stress_size
from dea_fenicsx.materials.wrapped import Wrapped
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import is_finite


@dataclass(frozen=True)
@in_si(r="", m="Pa", beta="")
class OgdenRoxburgh:
    """Pseudo-elastic softening: below its largest energy W_max so far a rubber has the stress

        eta dW/dF,    eta = 1 - erf[(W_max - W)/(m + beta W_max)]/r,

    with the energy W of the undamaged rubber.  On the way to a new largest energy eta is 1.  The
    energy that is lost for good by reaching W_max is, with G(x) = x erf x + exp(-x^2)/sqrt(pi) and
    s = m + beta W_max,

        s/r [G(W_max/s) - G(0)] per undeformed volume,

    which grows with W_max.  Nothing here depends on the rate.

    Parameters
    ----------
    r
        > 1; the largest loss of stiffness is 1/r.
    m
        In Pa, > 0: below energies of this size there is little softening.
    beta
        >= 0.

    References
    ----------
    R. W. Ogden, D. G. Roxburgh, Proc. R. Soc. Lond. A 455 (1999) 2861 (with beta = 0).
    """

    r: float
    m: float
    beta: float = 0.0

    def energy(self, s: Strain, energy: Any, peak: Any) -> Any:
        """The energy whose slope is the stress of a rubber that has been at a largest energy."""
        size = self.m + self.beta * peak
        below = s.positive(peak - energy) / size
        return energy - size / self.r * (s.erf_integral(peak / size) - s.erf_integral(below))

    def softness(self, peak: float) -> float:
        """eta in the undeformed state."""
        return 1 - math.erf(peak / (self.m + self.beta * peak)) / self.r

    def lost(self, s: Strain, peak: Any) -> Any:
        """Energy that has been lost for good, per undeformed volume in Pa."""
        size = self.m + self.beta * peak
        return size / self.r * (s.erf_integral(peak / size) - 1 / math.sqrt(math.pi))

    def faults(self) -> list[str]:
        """What is unphysical about the constants, as a list of clauses."""
        found = not_positive(self, "m")
        if not is_finite(self.r) or not self.r > 1:
            found.append(f"r of OgdenRoxburgh is {shown(self.r)}, but must be a finite number > 1")
        if not is_finite(self.beta) or self.beta < 0:
            found.append(f"beta of OgdenRoxburgh is {shown(self.beta)}, but must be >= 0")
        return found


@dataclass(frozen=True)
@in_si(peak="Pa")
class Softened(Wrapped):
    """A rubber that has been at a largest energy, as a law without a memory of its own.

    Below that energy it has the softened stress, and beyond it that of the undamaged rubber.

    Parameters
    ----------
    model
        The undamaged rubber.
    law
        Its softening.
    peak
        Largest energy so far in Pa, >= 0.
    """

    model: Elastic
    law: OgdenRoxburgh
    peak: float

    def energy(self, s: Strain) -> Any:
        return self.law.energy(s, self.model.energy(s), self.peak)

    def shear_modulus(self) -> float:
        return self.law.softness(self.peak) * self.model.shear_modulus()

    def initial_bulk_modulus(self) -> float:
        """That of a foam."""
        bulk = self.model.initial_bulk_modulus()  # type: ignore[attr-defined]
        return self.law.softness(self.peak) * bulk  # type: ignore[no-any-return]

    def spherical_slope(self) -> float:
        return self.law.softness(self.peak) * self.model.spherical_slope()

    def stress_size(self, s: Strain, lnJ: Any) -> Any:
        """See `Elastic`."""
        return stress_size(self.model, s, lnJ)

    def faults(self) -> list[str]:
        found = [*self.model.faults(), *self.law.faults()]
        if not is_finite(self.peak) or self.peak < 0:
            found.append(f"peak is {shown(self.peak)}, but must be a finite energy >= 0 in Pa")
        return found
