"""Polynomial energies in the invariants: neo-Hookean, Mooney-Rivlin, Yeoh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from dea_fenicsx.materials.base import Strain, not_finite, not_positive
from dea_fenicsx.support.units import in_si


@dataclass(frozen=True)
@in_si(mu="Pa")
class NeoHookean:
    """Neo-Hookean rubber, W = mu/2 (I1 - 3).

    Parameters
    ----------
    mu
        Shear modulus in Pa.

    References
    ----------
    Treloar, The Physics of Rubber Elasticity, 1975.
    """

    mu: float

    def energy(self, s: Strain) -> Any:
        return self.mu / 2 * (s.I1 - 3)

    def shear_modulus(self) -> float:
        return self.mu

    def spherical_slope(self) -> float:
        return self.mu

    def chain_margin(self, s: Strain) -> None:
        return None

    def width_margin(self, ahead: Any, pull: Any) -> Any:
        """1 - eps E^2 a^2/mu: positive where a wrinkled film under voltage has a natural width.

        Parameters
        ----------
        ahead
            Square of the stretch a along the tension.
        pull
            eps E^2 with the nominal field E, in Pa.
        """
        return 1 - pull * ahead / self.mu

    def faults(self) -> list[str]:
        return not_positive(self, "mu")


@dataclass(frozen=True)
@in_si(C10="Pa", C01="Pa")
class MooneyRivlin:
    """Mooney-Rivlin rubber, W = C10 (I1 - 3) + C01 (I2 - 3).

    Parameters
    ----------
    C10, C01
        Constants in Pa; the initial shear modulus 2 (C10 + C01) must be positive.

    References
    ----------
    Rivlin, Phil. Trans. R. Soc. A 241 (1948) 379.
    """

    C10: float
    C01: float

    def energy(self, s: Strain) -> Any:
        return self.C10 * (s.I1 - 3) + self.C01 * (s.I2 - 3)

    def shear_modulus(self) -> float:
        return 2 * (self.C10 + self.C01)

    def spherical_slope(self) -> float:
        return 2 * self.C10 + 4 * self.C01

    def stress_size(self, s: Strain, lnJ: Any) -> Any:
        """A stress in Pa, never negative, that grows with the strain; see `Elastic`.

        2 |C10| (I1 - 3 - 2 ln J) + 2 |C01| (I2 - 3 - 4 ln J): I1 >= 3 J^(2/3) and I2 >= 3 J^(4/3).
        """
        first, second = s.I1 - 3 - 2 * lnJ, s.I2 - 3 - 4 * lnJ
        return 2 * abs(self.C10) * first + 2 * abs(self.C01) * second

    def chain_margin(self, s: Strain) -> None:
        return None

    def faults(self) -> list[str]:
        found = not_finite(self, "C10", "C01")
        if not found and not self.shear_modulus() > 0:
            found = [
                f"C10 + C01 is {self.C10 + self.C01:g} Pa, but must be > 0: it is half the initial "
                "shear modulus"
            ]
        return found


@dataclass(frozen=True)
@in_si(C10="Pa", C20="Pa", C30="Pa")
class Yeoh:
    """Yeoh rubber, W = C10 (I1 - 3) + C20 (I1 - 3)^2 + C30 (I1 - 3)^3.

    Parameters
    ----------
    C10
        Half the initial shear modulus in Pa.
    C20, C30
        Constants in Pa; C20 is usually negative (softening), C30 positive (stiffening).

    References
    ----------
    Yeoh, Rubber Chem. Technol. 66 (1993) 754.
    """

    C10: float
    C20: float
    C30: float

    def energy(self, s: Strain) -> Any:
        x = s.I1 - 3
        return x * (self.C10 + x * (self.C20 + x * self.C30))

    def shear_modulus(self) -> float:
        return 2 * self.C10

    def spherical_slope(self) -> float:
        return 2 * self.C10

    def chain_margin(self, s: Strain) -> None:
        return None

    def faults(self) -> list[str]:
        return not_positive(self, "C10") + not_finite(self, "C20", "C30")
