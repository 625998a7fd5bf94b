"""Flow laws of viscous branches: viscosities that depend on stress and viscous strain."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import is_finite, is_positive


class FlowLaw(ABC):
    """The viscosity of a viscous branch, a function of its viscous strain and of its stress.

    A law of your own is a frozen dataclass whose fields are its constants.
    """

    @abstractmethod
    def viscosity(
        self, I1: np.ndarray, J2: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Viscosity in Pa s, > 0, and its derivatives by both arguments.

        Parameters
        ----------
        I1
            Trace of the viscous strain C_v, at least 3.
        J2
            Half the square of the deviator of the branch's Kirchhoff stress, in Pa^2.
        """

    @abstractmethod
    def extremes(self) -> tuple[float, float]:
        """The smallest viscosity, and that of the material at rest, in Pa s."""

    @abstractmethod
    def faults(self) -> list[str]:
        """What is unphysical about the constants, each as 'eta_0 is -5, but must be > 0'."""


@dataclass(frozen=True)
@in_si(eta_0="Pa*s", eta_inf="Pa*s", K1="Pa*s", K2="1/Pa**2", beta1="", beta2="")
class KumarLopezPamies(FlowLaw):
    """A viscosity that falls with the stress and grows with the viscous strain.

        eta = eta_inf + [eta_0 - eta_inf + K1 (I1v^beta1 - 3^beta1)] / [1 + (K2 J2)^beta2]

    with I1v = tr C_v, and J2 half the square of the deviator of the branch's Kirchhoff stress.

    Parameters
    ----------
    eta_0
        Viscosity at rest in Pa s, > 0.
    eta_inf
        Viscosity under a very large stress in Pa s, between 0 and `eta_0`.
    K1, beta1
        How it grows with the viscous strain: K1 in Pa s, both >= 0.
    K2, beta2
        How it falls with the stress: K2 in 1/Pa^2, both >= 0.

    References
    ----------
    Kumar and Lopez-Pamies, On the two-potential constitutive modeling of rubber viscoelastic
    materials, Comptes Rendus Mecanique 344 (2016) 102.
    """

    eta_0: float
    eta_inf: float
    K1: float = 0.0
    K2: float = 0.0
    beta1: float = 1.0
    beta2: float = 1.0

    def viscosity(
        self, I1: np.ndarray, J2: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            grown = self.eta_0 - self.eta_inf + self.K1 * (I1**self.beta1 - 3.0**self.beta1)
            power = (self.K2 * J2) ** self.beta2
            thinned = 1 / (1 + power)
            by_strain = self.K1 * self.beta1 * I1 ** (self.beta1 - 1) * thinned
            # At rest this derivative may be infinite, but it is only used times the stress.
            slope = np.where(J2 > 0, self.beta2 * power / J2, 0.0)
            by_stress = -grown * slope * thinned**2
        return self.eta_inf + grown * thinned, by_strain, by_stress

    def extremes(self) -> tuple[float, float]:
        lowest = self.eta_inf if self.K2 > 0 and self.eta_inf > 0 else self.eta_0
        return lowest, self.eta_0

    def faults(self) -> list[str]:
        found = []
        if not is_positive(self.eta_0):
            found.append(f"eta_0 is {self.eta_0!r}, but must be a finite number > 0, in Pa s")
        for name in ("eta_inf", "K1", "K2", "beta1", "beta2"):
            value = getattr(self, name)
            if not (is_finite(value) and value >= 0):
                found.append(f"{name} is {value!r}, but must be a finite number >= 0")
        if not found and self.eta_inf > self.eta_0:
            found.append(
                f"eta_inf is {self.eta_inf:g} Pa s, but must be at most eta_0, {self.eta_0:g} Pa s"
            )
        return found
