"""Ogden's energy in the principal stretches, in the one convention that is stored here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dea_fenicsx.materials.base import Strain
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import in_si, si
from dea_fenicsx.support.validation import is_finite


@dataclass(frozen=True)
@in_si(mu="Pa", alpha="")
class Ogden:
    """Ogden rubber, W = sum_k mu_k/alpha_k (lam1^alpha_k + lam2^alpha_k + lam3^alpha_k - 3).

    The constants stored are those of Ogden's paper and of the thesis's eq 76.  The initial shear
    modulus is sum mu_k alpha_k / 2.  Abaqus and others print W = sum 2 mu_k/alpha_k^2 (...), with
    the initial shear modulus sum mu_k; take such constants through `from_abaqus`.

    Parameters
    ----------
    mu
        Moduli mu_k in Pa, one for each term, in the convention above.
    alpha
        Exponents alpha_k, not zero.

    References
    ----------
    Ogden, Proc. R. Soc. Lond. A 326 (1972) 565.
    """

    mu: tuple[float, ...]
    alpha: tuple[float, ...]

    @classmethod
    def from_eq76(cls, mu: float | Sequence[float], alpha: float | Sequence[float]) -> Ogden:
        """Constants of W = sum mu/alpha (lam1^alpha + lam2^alpha + lam3^alpha - 3)."""
        return cls(*_terms(mu, alpha))

    @classmethod
    def from_abaqus(cls, mu: float | Sequence[float], alpha: float | Sequence[float]) -> Ogden:
        """Constants of W = sum 2 mu/alpha^2 (lam1^alpha + lam2^alpha + lam3^alpha - 3)."""
        m, a = _terms(mu, alpha)
        if any(x == 0 for x in a):
            raise InputError("An exponent alpha of the Ogden model is 0, but must not be.")
        return cls(tuple(2 * x / y for x, y in zip(m, a, strict=True)), a)

    def to_abaqus(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """The moduli and exponents in Abaqus's convention."""
        return tuple(m * a / 2 for m, a in zip(self.mu, self.alpha, strict=True)), self.alpha

    def energy(self, s: Strain) -> Any:
        return sum(
            m / a * (s.power_sum(a) - 3) for m, a in zip(self.mu, self.alpha, strict=True)
        )

    def shear_modulus(self) -> float:
        return sum(m * a / 2 for m, a in zip(self.mu, self.alpha, strict=True))

    def spherical_slope(self) -> float:
        return sum(self.mu)

    def stress_size(self, s: Strain, lnJ: Any) -> Any:
        """A stress in Pa, never negative, that grows with the strain; see `Elastic`.

        sum |mu_k| (lam1^alpha_k + lam2^alpha_k + lam3^alpha_k - 3 - alpha_k ln J).  Each term is
        >= 0, since e^x >= 1 + x.  I1 would not do: the stress of a negative exponent grows as a
        power of the smallest stretch.
        """
        return sum(
            abs(m) * (s.power_sum(a) - 3 - a * lnJ)
            for m, a in zip(self.mu, self.alpha, strict=True)
        )

    def chain_margin(self, s: Strain) -> None:
        return None

    def faults(self) -> list[str]:
        if not isinstance(self.mu, tuple) or not isinstance(self.alpha, tuple):
            return ["mu and alpha must be tuples with one number for each term"]
        if not self.mu or len(self.mu) != len(self.alpha):
            return [
                f"there are {len(self.mu)} moduli and {len(self.alpha)} exponents, but each term "
                "needs one of both"
            ]
        found = [
            f"{name} holds {x!r}, but must hold finite numbers{other}"
            for name, values, other in (("mu", self.mu, ""), ("alpha", self.alpha, " other than 0"))
            for x in values
            if not is_finite(x) or (other and x == 0)
        ]
        if not found and not self.shear_modulus() > 0:
            found = [
                f"the initial shear modulus sum mu alpha/2 is {self.shear_modulus():g} Pa, but "
                "must be > 0"
            ]
        return found


def _terms(mu: Any, alpha: Any) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Scalars or sequences as two tuples of equal length."""
    m = tuple(float(x) for x in np.atleast_1d(si(mu, "Pa", "Ogden: mu")))
    a = tuple(float(x) for x in np.atleast_1d(si(alpha, "", "Ogden: alpha")))
    if len(m) != len(a):
        raise InputError(
            f"The Ogden model is given {len(m)} moduli and {len(a)} exponents, but each term needs "
            "one of both."
        )
    return m, a
