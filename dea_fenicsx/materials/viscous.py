"""Viscous branches of a material: springs in series with dashpots, beside its elastic energy."""

from __future__ import annotations

import math
from dataclasses import dataclass

from dea_fenicsx.support.type_checks import is_number
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import is_positive


@dataclass(frozen=True)
@in_si(mu="Pa", tau="s")
class Maxwell:
    """A Maxwell branch: a neo-Hookean spring in series with a dashpot.

    The branch keeps a viscous strain C_v, a symmetric tensor with det C_v = 1, which follows the
    volume-preserving part Cbar of the right Cauchy-Green tensor:

        W = mu/2 [tr(Cbar C_v^-1) - 3],    dC_v/dt = [Cbar - tr(Cbar C_v^-1)/3 C_v] / tau

    with C_v = 1 at first.  Its dissipation per volume and time is
    mu/(2 tau) times the square of the deviator of C_v^-1/2 Cbar C_v^-1/2, which is never negative.

    Parameters
    ----------
    mu
        Shear modulus of the spring in Pa, > 0.
    tau
        Relaxation time in s, > 0: the viscosity over the modulus.  Infinity gives a spring that
        never relaxes.

    References
    ----------
    Shutov, Landgraf and Ihlemann, Comput. Methods Appl. Mech. Engrg. 265 (2013) 213.
    """

    mu: float
    tau: float

    def faults(self) -> list[str]:
        """What is unphysical about the constants, each as 'tau is -5, but must be > 0'."""
        found = []
        if not is_positive(self.mu):
            found.append(f"mu of a viscous branch is {self.mu!r}, but must be a finite number > 0")
        if not (is_number(self.tau) and (self.tau > 0 or self.tau == math.inf)):
            found.append(
                f"tau of a viscous branch is {self.tau!r}, but must be a number > 0, in s"
            )
        return found
