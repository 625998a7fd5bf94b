"""The interface of a material model: an energy of a strain, and a few properties."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, Protocol, runtime_checkable

from dea_fenicsx.support.validation import is_finite, is_positive

EPSILON_0 = 8.8541878128e-12
"""Permittivity of vacuum in F/m (CODATA 2018)."""


class Strain(Protocol):
    """The strain that an energy is given: invariants of the right Cauchy-Green tensor C = F^T F.

    There are two kinds: symbolic ones for finite elements (`kinematics.StrainOf`) and numeric ones
    in the principal stretches (`stretches.PrincipalStrain`).  An energy is plain arithmetic on
    them, so that it is written once and serves both.
    """

    @property
    def I1(self) -> Any:
        """tr C"""
        ...

    @property
    def I2(self) -> Any:
        """[(tr C)^2 - tr C^2] / 2"""
        ...

    def ln(self, x: Any) -> Any:
        """Natural logarithm in the arithmetic of this strain (symbolic or numeric)."""
        ...

    def power_sum(self, alpha: Any) -> Any:
        """Sum of powers of the principal stretches, lam1^alpha + lam2^alpha + lam3^alpha."""
        ...


@runtime_checkable
class Elastic(Protocol):
    """An incompressible hyperelastic energy W in J/m^3, zero in the undeformed state.

    A model may also have a method ``stress_size(s, lnJ)``: a stress in Pa that keeps in step with
    its own at any strain ``s``, is 0 in the undeformed state and negative for no F, with lnJ the
    logarithm of det F.  The augmentation is relative to it.  Without the method it is
    mu (I1 - 3 - 2 ln J) over the chain margin, with the initial shear modulus mu, which is the
    right size for energies of I1.
    """

    def energy(self, s: Strain) -> Any:
        """Energy density W in Pa."""
        ...

    def shear_modulus(self) -> float:
        """Initial shear modulus in Pa: the scale of all stresses."""
        ...

    def spherical_slope(self) -> float:
        """dW/dstretch_i at the undeformed state in Pa: 2 W_1 + 4 W_2.

        The pressure carries this stress, so that p = 0 in the undeformed state.
        """
        ...

    def chain_margin(self, s: Strain) -> Any | None:
        """Positive where the energy is defined, or None if it is defined everywhere."""
        ...

    def faults(self) -> list[str]:
        """What is unphysical about the constants, each as 'mu is -5, but must be > 0'."""
        ...


def constants(model: Any) -> list[str]:
    """Names of a model's constants: of its fields that are no choice of a form, which is text."""
    return [f.name for f in fields(model) if not isinstance(getattr(model, f.name), str)]


def choices(model: Any) -> tuple[str, ...]:
    """The choices of a model's form, which decide about its energy like another model's name."""
    values = (getattr(model, f.name) for f in fields(model))
    return tuple(value for value in values if isinstance(value, str))


def _positive(model: Any, *names: str) -> list[str]:
    """Complaints about constants that are not finite and positive."""
    return [
        f"{name} is {getattr(model, name)!r}, but must be a finite number > 0"
        for name in names
        if not is_positive(getattr(model, name))
    ]


def _finite(model: Any, *names: str) -> list[str]:
    """Complaints about constants that are not finite numbers."""
    return [
        f"{name} is {getattr(model, name)!r}, but must be a finite number"
        for name in names
        if not is_finite(getattr(model, name))
    ]
