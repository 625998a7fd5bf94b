"""Viscous branches of a material: springs in series with dashpots, beside its elastic energy."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dea_fenicsx.materials.base import Elastic, is_compressible, is_isotropic
from dea_fenicsx.materials.flow_laws import FlowLaw
from dea_fenicsx.materials.thermal import Scaled
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import is_number, shown
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
    changes_by_points: ClassVar[bool] = False

    def scaled(self, stiffer: float, slower: float) -> Maxwell:
        """The same with the modulus and the relaxation time times two factors."""
        return Maxwell(stiffer * self.mu, slower * self.tau)

    def faults(self) -> list[str]:
        """What is unphysical about the constants, each as 'tau is -5, but must be > 0'."""
        found = []
        if not is_positive(self.mu):
            found.append(f"mu of a viscous branch is {self.mu!r}, but must be a finite number > 0")
        return found + _faults_of_time(self.tau)


@dataclass(frozen=True)
@in_si(tau="s")
class ViscousBranch:
    """A viscous branch with any elastic model as its spring, and a dashpot.

    The branch keeps a viscous strain C_v, a symmetric tensor with det C_v = 1 and C_v = 1 at first.
    The spring's energy W is that of the elastic stretches, whose squares are the eigenvalues of
    Cbar C_v^-1, with the volume-preserving part Cbar of the right Cauchy-Green tensor.  With the
    isotropic tensor function S(Cbar C_v^-1), whose eigenvalues dW/d(ln stretch) are the principal
    Kirchhoff stresses, C_v follows

        dC_v/dt = 1/eta (dev S) C_v,    dissipation = |dev S|^2 / (2 eta) >= 0

    per undeformed volume and time.  With a neo-Hookean spring and eta = mu tau it is a `Maxwell`
    branch, which is solved faster.

    Parameters
    ----------
    spring
        An elastic model such as ``Gent(mu, Jm)``.
    tau
        Relaxation time in s, > 0: the viscosity is eta = mu tau with the spring's initial shear
        modulus mu.  Infinity gives a spring that never relaxes.
    flow
        In place of `tau` a law for eta, such as `KumarLopezPamies`.  The tangent of a body is then
        not symmetric, so that negative eigenvalues are not counted.

    References
    ----------
    Kumar and Lopez-Pamies, Comptes Rendus Mecanique 344 (2016) 102.
    """

    spring: Elastic
    tau: float | None = None
    flow: FlowLaw | None = None
    changes_by_points: ClassVar[bool] = True

    @property
    def mu(self) -> float:
        """Initial shear modulus of the spring in Pa."""
        return self.spring.shear_modulus()

    @property
    def is_variational(self) -> bool:
        """Whether each step of time has an energy, so that the tangent is symmetric."""
        return self.flow is None

    def rate(self, I1: Any, J2: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """mu/eta in 1/s, one over a relaxation time, and its derivatives; see `FlowLaw`."""
        I1, J2 = np.asarray(I1, dtype=float), np.asarray(J2, dtype=float)
        if self.flow is None:
            return np.full_like(I1, 1 / (self.tau or math.inf)), 0 * I1, 0 * I1
        eta, by_strain, by_stress = self.flow.viscosity(I1, J2)
        rate = self.mu / eta
        return rate, -rate / eta * by_strain, -rate / eta * by_stress

    def scaled(self, stiffer: float, slower: float) -> ViscousBranch:
        """The same with the spring's energy and the relaxation time times two factors."""
        if self.tau is None:
            raise InputError(
                "A viscous branch with a flow law does not change with temperature; give it a "
                "relaxation time tau."
            )
        return ViscousBranch(Scaled(stiffer, self.spring), slower * self.tau)

    def relaxation_times(self) -> tuple[float, float]:
        """The shortest and the longest relaxation time of small strains in s."""
        if self.flow is None:
            tau = self.tau or math.inf
            return tau, tau
        low, high = self.flow.extremes()
        return low / self.mu, high / self.mu

    def faults(self) -> list[str]:
        """What is unphysical about the constants, each as 'tau is -5, but must be > 0'."""
        if not isinstance(self.spring, Elastic):
            return [
                f"the spring of a viscous branch is {shown(self.spring)}, but must be an elastic "
                "model such as Gent(mu, Jm)"
            ]
        found = [
            f"the spring of a viscous branch, {type(self.spring).__name__}: {fault}"
            for fault in self.spring.faults()
        ]
        if not found and not is_positive(self.mu):
            found.append(
                f"the initial shear modulus of a viscous branch's spring is {self.mu!r} Pa, but "
                "must be > 0"
            )
        if not is_isotropic(self.spring) or is_compressible(self.spring):
            found.append(
                "the spring of a viscous branch has fibres or is a foam, but must be an isotropic "
                "incompressible rubber"
            )
        if (self.tau is None) == (self.flow is None):
            given = "neither tau nor flow" if self.tau is None else "both tau and flow"
            return [*found, f"a viscous branch is given {given}, but needs one of them"]
        if self.flow is None:
            return found + _faults_of_time(self.tau)
        if not isinstance(self.flow, FlowLaw):
            return [
                *found, f"the flow law of a viscous branch is {shown(self.flow)}, but must be one "
                "such as KumarLopezPamies(eta_0, eta_inf)"
            ]  # fmt: skip
        name = type(self.flow).__name__
        return found + [
            f"the flow law of a viscous branch, {name}: {fault}" for fault in self.flow.faults()
        ]


Branch = Maxwell | ViscousBranch
"""What a material may hold in `viscous`."""


def _faults_of_time(tau: Any) -> list[str]:
    """What is wrong with a relaxation time."""
    if is_number(tau) and (tau > 0 or tau == math.inf):
        return []
    return [f"tau of a viscous branch is {tau!r}, but must be a number > 0, in s"]


def closed_branches(material: Any, what: str) -> list[Maxwell]:
    """The branches of a material, which must be `Maxwell` ones.

    Raises
    ------
    InputError
        If one is not; `what` is the subject of the message.
    """
    for branch in material.viscous:
        if not isinstance(branch, Maxwell):
            raise InputError(
                f"{what} takes Maxwell branches alone, but the material has {shown(branch)}; take "
                "exact.march for it."
            )
    return list(material.viscous)
