"""Compressible foams and rubbers, whose energy states how the volume changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from dea_fenicsx.materials.base import Strain, not_positive
from dea_fenicsx.support.units import in_si, si
from dea_fenicsx.support.validation import is_finite


@dataclass(frozen=True)
@in_si(mu="Pa", alpha="", beta="")
class OgdenHill:
    """A foam, W = sum 2 mu_k/alpha_k^2 [sum lam_i^alpha_k - 3 + (J^(-alpha_k beta_k) - 1)/beta_k].

    The constants are those of Abaqus's hyperfoam: the initial shear modulus is sum mu_k, the bulk
    modulus sum 2 mu_k (1/3 + beta_k), and beta = nu/(1 - 2 nu) with Poisson's ratio nu.

    Parameters
    ----------
    mu
        Moduli in Pa, one for each term.
    alpha
        Exponents, not 0.
    beta
        Compressibilities, > -1/3 and not 0.

    References
    ----------
    Hill, Adv. Appl. Mech. 18 (1978) 1; Ogden, Non-Linear Elastic Deformations, 1984; Storakers, J.
    Mech. Phys. Solids 34 (1986) 125.
    """

    mu: tuple[float, ...]
    alpha: tuple[float, ...]
    beta: tuple[float, ...]
    compressible = True

    @classmethod
    def from_poisson(cls, mu: Sequence[float], alpha: Sequence[float], nu: float) -> OgdenHill:
        """The same Poisson's ratio, between -1 and 0.5 and not 0, in all terms."""
        m, a = tuple(si(list(mu), "Pa", "OgdenHill: mu")), tuple(alpha)
        return cls(m, a, (nu / (1 - 2 * nu),) * len(m))

    @property
    def _terms(self) -> Any:
        return zip(self.mu, self.alpha, self.beta, strict=True)

    def energy(self, s: Strain) -> Any:
        return sum(
            2 * m / a / a * (s.power_sum(a) - 3 + (s.J ** (-a * b) - 1) / b)
            for m, a, b in self._terms
        )

    def shear_modulus(self) -> float:
        return sum(self.mu)

    def initial_bulk_modulus(self) -> float:
        """Bulk modulus of small strain in Pa."""
        return sum(2 * m * (1 / 3 + b) for m, _, b in self._terms)

    def spherical_slope(self) -> float:
        return 0.0

    def chain_margin(self, s: Strain) -> None:
        return None

    def faults(self) -> list[str]:
        several = (self.mu, self.alpha, self.beta)
        if not all(isinstance(x, tuple) and len(x) == len(several[0]) > 0 for x in several):
            return ["mu, alpha and beta must be tuples with one number for each term"]
        if not all(is_finite(x) for values in several for x in values):
            return [f"{self} holds what is no finite number"]
        if 0 in self.alpha or 0 in self.beta or min(self.beta) <= -1 / 3:
            return [
                f"alpha is {self.alpha} and beta {self.beta}, but no alpha may be 0, and each beta "
                "must be > -1/3 and not 0"
            ]
        moduli = self.shear_modulus(), self.initial_bulk_modulus()
        if not min(moduli) > 0:
            return [
                f"the initial shear modulus is {moduli[0]:g} and the bulk modulus {moduli[1]:g} "
                "Pa, but both must be > 0"
            ]
        return []


@dataclass(frozen=True)
@in_si(mu="Pa")
class BlatzKo:
    """The Blatz-Ko foamed polyurethane rubber, W = mu/2 (I2/J^2 + 2 J - 5).

    I2/J^2 is the sum of lam_i^-2.  Poisson's ratio is 1/4, and the bulk modulus 5/3 mu.

    Parameters
    ----------
    mu
        Initial shear modulus in Pa.

    References
    ----------
    Blatz and Ko, Trans. Soc. Rheol. 6 (1962) 223.
    """

    mu: float
    compressible = True

    def energy(self, s: Strain) -> Any:
        J = s.J
        return self.mu / 2 * (s.I2 / (J * J) + 2 * J - 5)

    def shear_modulus(self) -> float:
        return self.mu

    def initial_bulk_modulus(self) -> float:
        """Bulk modulus of small strain in Pa."""
        return 5 / 3 * self.mu

    def spherical_slope(self) -> float:
        return 0.0

    def chain_margin(self, s: Strain) -> None:
        return None

    def faults(self) -> list[str]:
        return not_positive(self, "mu")
