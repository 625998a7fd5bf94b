"""Energies of chains with a finite length: Gent, Arruda-Boyce."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from dea_fenicsx.materials.base import Strain, not_positive
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import is_finite


@dataclass(frozen=True)
@in_si(mu="Pa", Jm="")
class Gent:
    """Gent rubber, W = -mu Jm/2 ln[1 - (I1 - 3)/Jm]: stiffens without bound as I1 - 3 nears Jm.

    Parameters
    ----------
    mu
        Initial shear modulus in Pa.
    Jm
        Value of I1 - 3 at which the chains lock up.

    References
    ----------
    Gent, A new constitutive relation for rubber, Rubber Chem. Technol. 69 (1996) 59.
    """

    mu: float
    Jm: float

    def energy(self, s: Strain) -> Any:
        return -self.mu * self.Jm / 2 * s.ln(self.chain_margin(s))

    def shear_modulus(self) -> float:
        return self.mu

    def spherical_slope(self) -> float:
        return self.mu

    def chain_margin(self, s: Strain) -> Any:
        return 1 - (s.I1 - 3) / self.Jm

    def faults(self) -> list[str]:
        return not_positive(self, "mu", "Jm")


# Series of the inverse Langevin function: W = mu sum a_i/N^(i-1) (I1^i - 3^i), N = lam_m^2
_SERIES = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)


@dataclass(frozen=True)
@in_si(mu="Pa", lam_m="")
class ArrudaBoyce:
    """Eight-chain rubber, W = mu lam_m^2 times the integral of the inverse Langevin function.

    There are two approximations of that function of z = lam/lam_m, lam = sqrt(I1/3):

    - ``"series"``: five terms of its series, W = mu sum_i a_i / lam_m^(2i-2) (I1^i - 3^i) with
      a = 1/2, 1/20, 11/1050, 19/7000, 519/673750.  This is the form that finite-element codes use;
      it stiffens near the locking stretch, but does not end there.
    - ``"pade"``: Cohen's rational function z (3 - z^2)/(1 - z^2), so that
      W = mu lam_m^2 [z^2/2 - ln(1 - z^2)] less its value at rest.  It ends at the locking stretch.

    Parameters
    ----------
    mu
        Rubbery modulus n k T in Pa; the initial shear modulus is slightly larger.
    lam_m
        Locking stretch of a chain, > 1: the chains are taut where I1 = 3 lam_m^2.
    form
        ``"series"`` or ``"pade"``.

    References
    ----------
    Arruda and Boyce, J. Mech. Phys. Solids 41 (1993) 389; Cohen, Rheol. Acta 30 (1991) 270.
    """

    mu: float
    lam_m: float
    form: str = "series"

    def energy(self, s: Strain) -> Any:
        x, links = s.I1, self.lam_m * self.lam_m
        if self.form == "pade":
            margin: Any = self.chain_margin(s)
            return self.mu * ((x - 3) / 6 - links * s.ln(margin / (1 - 1 / links)))
        # Horner's scheme; the constant makes W zero in the undeformed state
        total: Any = 0
        zero: Any = 0
        for a in reversed(_SERIES):
            total = x * (a + total / links)
            zero = 3 * (a + zero / links)
        return self.mu * (total - zero)

    def shear_modulus(self) -> float:
        links = self.lam_m * self.lam_m
        if self.form == "pade":
            return self.mu * (3 - 1 / links) / (3 * (1 - 1 / links))
        slope: Any = 0
        for i, a in reversed(list(enumerate(_SERIES, start=1))):
            slope = i * a + 3 * slope / links
        return 2 * self.mu * slope

    def spherical_slope(self) -> float:
        return self.shear_modulus()

    def chain_margin(self, s: Strain) -> Any | None:
        if self.form == "pade":
            return 1 - s.I1 / (3 * self.lam_m * self.lam_m)
        return None

    def faults(self) -> list[str]:
        found = not_positive(self, "mu")
        if not is_finite(self.lam_m) or not self.lam_m > 1:
            found.append(f"lam_m is {self.lam_m!r}, but a locking stretch is a finite number > 1")
        if self.form not in ("series", "pade"):
            found.append(f'form is {self.form!r}, but must be "series" or "pade"')
        return found
