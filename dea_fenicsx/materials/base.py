"""The interface of a material model: an energy of a strain, and a few properties."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

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

    @property
    def J(self) -> Any:
        """det F"""
        ...

    def exp(self, x: Any) -> Any:
        """Exponential function."""
        ...

    def positive(self, x: Any) -> Any:
        """x where it is positive, else 0."""
        ...

    def erf_integral(self, x: Any) -> Any:
        """x erf x + exp(-x^2)/sqrt(pi), whose slope is the error function."""
        ...

    def I4(self, direction: Any) -> Any:
        """a . C a, the square of the stretch along a `Direction` with the unit vector a."""
        ...

    def I5(self, direction: Any) -> Any:
        """a . C^2 a"""
        ...


@runtime_checkable
class Elastic(Protocol):
    """An incompressible hyperelastic energy W in J/m^3, zero in the undeformed state.

    A model whose constants are models themselves, such as `Reinforced`, holds them in its fields.

    A model of a foam has the class attribute ``compressible = True`` and a method
    ``initial_bulk_modulus()`` in Pa.  Its energy is of F itself, not of the volume-preserving part,
    and its `spherical_slope` is 0.

    A model of fibres has the class attribute ``isotropic = False``.

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


def is_compressible(elastic: Any) -> bool:
    """Whether an energy is one of F itself, so that it states how the volume changes."""
    return bool(getattr(elastic, "compressible", False))


def is_isotropic(elastic: Any) -> bool:
    """Whether an energy has no directions of its own."""
    return bool(getattr(elastic, "isotropic", True))


def stress_size(elastic: Elastic, s: Strain, lnJ: Any) -> Any:
    """A stress in Pa that grows with that of a model, never negative; see `Elastic`."""
    if hasattr(elastic, "stress_size"):
        return elastic.stress_size(s, lnJ)
    stress = elastic.shear_modulus() * (s.I1 - 3 - 2 * lnJ)
    margin = elastic.chain_margin(s)
    return stress if margin is None else stress / margin


def _is_part(value: Any) -> bool:
    """Whether the value of a field is a model, or several."""
    if isinstance(value, tuple):
        return bool(value) and all(map(is_dataclass, value))
    return is_dataclass(value)


def parts(model: Any) -> list[str]:
    """Names of the fields of a model that hold models, or tuples of models."""
    return [f.name for f in fields(model) if _is_part(getattr(model, f.name))]


def constants(model: Any) -> list[str]:
    """Names of a model's constants: of its fields that are no choice of a form, which is text.

    Fields that hold models are not among them; see `parts`.
    """
    inner = parts(model)
    return [
        f.name for f in fields(model)
        if f.name not in inner and not isinstance(getattr(model, f.name), str)
    ]  # fmt: skip


def choices(model: Any) -> tuple[str, ...]:
    """The choices of a model's form, which decide about its energy like another model's name."""
    values = (getattr(model, f.name) for f in fields(model))
    return tuple(value for value in values if isinstance(value, str))


def shape(model: Any) -> tuple[Any, ...]:
    """What shapes the form of an energy: numbers of constants, choices, and models inside."""
    sizes = tuple(np.size(getattr(model, name)) for name in constants(model))
    inner: list[Any] = []
    for name in parts(model):
        value = getattr(model, name)
        several = value if isinstance(value, tuple) else (value,)
        inner.append((name, *((type(one), shape(one)) for one in several)))
    return (*sizes, *choices(model), *inner)


def not_positive(model: Any, *names: str) -> list[str]:
    """A complaint about each named constant that is no finite number > 0."""
    return [
        f"{name} is {getattr(model, name)!r}, but must be a finite number > 0"
        for name in names
        if not is_positive(getattr(model, name))
    ]


def not_finite(model: Any, *names: str) -> list[str]:
    """A complaint about each named constant that is no finite number."""
    return [
        f"{name} is {getattr(model, name)!r}, but must be a finite number"
        for name in names
        if not is_finite(getattr(model, name))
    ]
