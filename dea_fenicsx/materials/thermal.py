"""How the constants of a material change with temperature, in K throughout.

Each law is a factor on a constant, 1 at the reference temperature at which the constants of the
material hold.  Laws are plain arithmetic, so that finite elements take them at each point, and the
theory of films with numbers.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from dea_fenicsx.materials.base import Elastic, Strain, stress_size
from dea_fenicsx.materials.wrapped import Wrapped
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.later import Later
from dea_fenicsx.support.type_checks import is_number, shown
from dea_fenicsx.support.units import in_si, si
from dea_fenicsx.support.validation import is_finite, is_positive, positive

integrate = Later("scipy.integrate")
interpolate = Later("scipy.interpolate")

GAS_CONSTANT = 8.31446261815324
"""In J/(mol K), exact."""


class Numbers:
    """Functions that a law needs, for numbers and arrays; `model.heat` has them for UFL."""

    exp = staticmethod(np.exp)

    @staticmethod
    def choose(x: Any, edge: float, below: Any, above: Any) -> Any:
        """`below` where x < edge, else `above`."""
        return np.where(np.asarray(x) < edge, below, above)


class ThermalLaw(ABC):
    """A factor on a constant as a function of temperature; 1 at the reference."""

    @abstractmethod
    def factor(self, kelvin: Any, reference: Any, functions: Any = Numbers) -> Any:
        """The factor at a temperature in K."""

    def domain(self, reference: float) -> tuple[float, float]:
        """The temperatures in K between which the law is known."""
        return 0.0, math.inf

    def faults(self) -> list[str]:
        """What is unphysical about the constants, as a list of clauses."""
        return []


@dataclass(frozen=True)
class Entropic(ThermalLaw):
    """T/T_ref: the modulus of an ideal rubber, whose elasticity is entropy alone."""

    def factor(self, kelvin: Any, reference: Any, functions: Any = Numbers) -> Any:
        return kelvin / reference


@dataclass(frozen=True)
@in_si(per_kelvin="1/K")
class LinearChange(ThermalLaw):
    """1 + a (T - T_ref), with a in 1/K."""

    per_kelvin: float

    def factor(self, kelvin: Any, reference: Any, functions: Any = Numbers) -> Any:
        return 1 + self.per_kelvin * (kelvin - reference)

    def faults(self) -> list[str]:
        ok = is_finite(self.per_kelvin)
        return [] if ok else [f"per_kelvin is {shown(self.per_kelvin)}, but must be finite"]


@dataclass(frozen=True)
class TabulatedChange(ThermalLaw):
    """Through measured points, by monotone cubic interpolation, over its value at the reference.

    Parameters
    ----------
    kelvin
        Temperatures in K, which rise.
    values
        A constant at each of them, in any unit, > 0.

    References
    ----------
    F. N. Fritsch, J. Butland, SIAM J. Sci. Stat. Comput. 5 (1984) 300.
    """

    kelvin: Sequence[float]
    values: Sequence[float]

    def __post_init__(self) -> None:
        for name, unit in (("kelvin", "K"), ("values", "")):
            value = si(getattr(self, name), unit, f"TabulatedChange: {name}")
            if not isinstance(value, str) and np.iterable(value):
                object.__setattr__(self, name, tuple(value))

    @cached_property
    def _curve(self) -> Any:
        return interpolate.PchipInterpolator(np.array(self.kelvin), np.array(self.values))

    def factor(self, kelvin: Any, reference: Any, functions: Any = Numbers) -> Any:
        starts, last = self._curve.x, len(self.kelvin) - 2

        def piece(k: int) -> Any:
            value: Any = 0.0
            for c in self._curve.c[:, k]:
                value = value * (kelvin - float(starts[k])) + float(c)
            return value

        found = piece(last)
        for k in range(last - 1, -1, -1):
            found = functions.choose(kelvin, float(starts[k + 1]), piece(k), found)
        return found / float(self._curve(reference))

    def domain(self, reference: float) -> tuple[float, float]:
        return self.kelvin[0], self.kelvin[-1]

    def faults(self) -> list[str]:
        x, f = self.kelvin, self.values
        for name, values in (("kelvin", x), ("values", f)):
            if not isinstance(values, tuple) or not all(is_finite(v) for v in values):
                return [f"{name} is {shown(values)}, but must be a list of numbers"]
        if len(x) != len(f) or not 2 <= len(x) <= 50:
            return [f"kelvin has {len(x)} and values {len(f)} numbers, but must have as many of "
                    "both, from 2 to 50"]  # fmt: skip
        if any(not b > a for a, b in pairwise(x)) or not all(v > 0 for v in f):
            return ["kelvin must rise from each number to the next, and values must be > 0"]
        return []


@dataclass(frozen=True)
@in_si(C1="", C2="K")
class WLF(ThermalLaw):
    """log10 a = -C1 (T - T_ref)/(C2 + T - T_ref): how relaxation times change.

    Parameters
    ----------
    C1
        A pure number, > 0.
    C2
        In K, > 0.  The law ends at T_ref - C2.

    References
    ----------
    M. L. Williams, R. F. Landel, J. D. Ferry, J. Am. Chem. Soc. 77 (1955) 3701.
    """

    C1: float
    C2: float

    def factor(self, kelvin: Any, reference: Any, functions: Any = Numbers) -> Any:
        above = kelvin - reference
        return functions.exp(-math.log(10) * self.C1 * above / (self.C2 + above))

    def domain(self, reference: float) -> tuple[float, float]:
        return math.nextafter(reference - self.C2, math.inf), math.inf

    def faults(self) -> list[str]:
        return [
            f"{name} of WLF is {shown(value)}, but must be a finite number > 0"
            for name, value in (("C1", self.C1), ("C2", self.C2)) if not is_positive(value)
        ]  # fmt: skip


@dataclass(frozen=True)
@in_si(joule_per_mole="J/mol")
class Arrhenius(ThermalLaw):
    """ln a = E/R (1/T - 1/T_ref): how relaxation times change, with E in J/mol."""

    joule_per_mole: float

    def factor(self, kelvin: Any, reference: Any, functions: Any = Numbers) -> Any:
        return functions.exp(self.joule_per_mole / GAS_CONSTANT * (1 / kelvin - 1 / reference))

    def faults(self) -> list[str]:
        ok = is_finite(self.joule_per_mole) and self.joule_per_mole >= 0
        return [] if ok else [
            f"joule_per_mole of Arrhenius is {shown(self.joule_per_mole)}, but must be a finite "
            "number >= 0"
        ]  # fmt: skip


@dataclass(frozen=True)
@in_si(reference="K", low="K", high="K", expansion="1/K", heat_capacity="J/K/m**3")
class Thermal:
    """How a material changes with temperature.

    The elastic energy of the equilibrium and those of viscous branches get the factor `modulus`;
    the energy of the dielectric the factor `permittivity`; relaxation times of viscous branches the
    factor `shift`.  A bulk modulus stays as it is.  A material without load has the stretch
    1 + expansion (T - reference) in all directions.  Energies count per volume of this unloaded
    state, so that true stresses are those of the strain beyond it.

    Parameters
    ----------
    reference
        Temperature in K at which the constants of the material hold.
    low, high
        Range in K in which the laws hold.  A temperature outside is refused.
    modulus, permittivity
        Laws such as `Entropic`, `LinearChange` or `TabulatedChange`; None for no change.
    shift
        A law such as `WLF` or `Arrhenius`, or None.
    expansion
        Linear thermal expansion in 1/K.
    heat_capacity
        In J/(K m^3) of the undeformed material; `adiabatic_rise` needs it.
    """

    reference: float
    low: float
    high: float
    modulus: ThermalLaw | None = None
    permittivity: ThermalLaw | None = None
    shift: ThermalLaw | None = None
    expansion: float = 0.0
    heat_capacity: float | None = None

    def modulus_factor(self, kelvin: Any, functions: Any = Numbers) -> Any:
        return self._factor(self.modulus, kelvin, functions)

    def permittivity_factor(self, kelvin: Any, functions: Any = Numbers) -> Any:
        return self._factor(self.permittivity, kelvin, functions)

    def time_factor(self, kelvin: Any, functions: Any = Numbers) -> Any:
        return self._factor(self.shift, kelvin, functions)

    def _factor(self, law: ThermalLaw | None, kelvin: Any, functions: Any) -> Any:
        return 1.0 if law is None else law.factor(kelvin, self.reference, functions)

    def stretch(self, kelvin: Any) -> Any:
        """Stretch in all directions of the material without load."""
        return 1 + self.expansion * (kelvin - self.reference)

    def adiabatic_rise(self, seconds: Any, watts: Any, cubic_metres: float) -> np.ndarray:
        """By how many K a region would be warmer at each time if its heat stayed in it.

        Parameters
        ----------
        seconds, watts
            Times, and the power that turns into heat there, such as the column of `Dissipation` in
            a history; it is taken as linear in between.
        cubic_metres
            Undeformed volume of the region.

        Raises
        ------
        InputError
            If no heat capacity is given.
        """
        if self.heat_capacity is None:
            raise InputError("Thermal has no heat_capacity for a rise; give it in J/(K m^3).")
        positive(cubic_metres, "The volume", "a number > 0 in m^3")
        heat = integrate.cumulative_trapezoid(watts, seconds, initial=0.0)
        return np.asarray(heat / (self.heat_capacity * cubic_metres))

    def check(self, kelvin: Any, what: str) -> None:
        """Raise InputError if a temperature, or one of several, lies outside of the range."""
        for value in np.ravel(kelvin):
            if not is_number(value) or not self.low <= value <= self.high:
                raise InputError(
                    f"{what} is {shown(float(value) if is_number(value) else value)} K, but the "
                    f"data of the material reach from {self.low:g} to {self.high:g} K."
                )

    def faults(self) -> list[str]:
        """What is unphysical about it, as a list of clauses."""
        numbers = self.low, self.reference, self.high
        if not all(map(is_finite, numbers)) or not 0 < numbers[0] <= numbers[1] <= numbers[2]:
            return [
                f"Thermal has low, reference and high {', '.join(map(shown, numbers))} K, but "
                "needs 0 < low <= reference <= high"
            ]
        for name in ("modulus", "permittivity", "shift"):
            law = getattr(self, name)
            if law is not None and not isinstance(law, ThermalLaw):
                return [f"{name} of Thermal is {shown(law)}, but must be a law such as "
                        "LinearChange(per_kelvin), or None"]  # fmt: skip
            if law is not None and (found := law.faults()):
                return [f"{name} of Thermal: {found[0]}"]
            if law is not None and (found := self._faults_in_range(name, law)):
                return found
        if not is_finite(self.expansion) or not min(map(self.stretch, (self.low, self.high))) > 0:
            return [f"expansion is {shown(self.expansion)}, but must be a finite number in 1/K "
                    "with a stretch > 0 from low to high"]  # fmt: skip
        if self.heat_capacity is not None and not is_positive(self.heat_capacity):
            return [f"heat_capacity is {shown(self.heat_capacity)}, but must be a number > 0 in "
                    "J/(K m^3), or None"]  # fmt: skip
        return []

    def _faults_in_range(self, name: str, law: ThermalLaw) -> list[str]:
        """What is wrong with a law somewhere from low to high."""
        first, last = law.domain(self.reference)
        if not first <= self.low <= self.high <= last:
            return [f"{name} of Thermal is known from {first:g} to {last:g} K, but low is "
                    f"{self.low:g} and high {self.high:g} K"]  # fmt: skip
        with np.errstate(all="ignore"):
            found = law.factor(np.linspace(self.low, self.high, 101), self.reference)
        if np.all(np.isfinite(found)) and np.all(np.asarray(found) > 0):
            return []
        return [f"{name} of Thermal gives a factor that is not > 0 somewhere from {self.low:g} to "
                f"{self.high:g} K"]  # fmt: skip


@dataclass(frozen=True)
class Scaled(Wrapped):
    """An elastic model times a factor: that of another one at its temperature.

    Parameters
    ----------
    factor
        The factor, > 0.
    model
        The model.
    """

    factor: float
    model: Elastic

    def energy(self, s: Strain) -> Any:
        return self.factor * self.model.energy(s)

    def shear_modulus(self) -> float:
        return self.factor * self.model.shear_modulus()

    def initial_bulk_modulus(self) -> float:
        """That of a foam."""
        return self.factor * self.model.initial_bulk_modulus()  # type: ignore[attr-defined]

    def spherical_slope(self) -> float:
        return self.factor * self.model.spherical_slope()

    def stress_size(self, s: Strain, lnJ: Any) -> Any:
        """See `Elastic`."""
        return self.factor * stress_size(self.model, s, lnJ)

    def faults(self) -> list[str]:
        ok = is_positive(self.factor)
        return list(self.model.faults()) if ok else [
            f"factor is {shown(self.factor)}, but must be a finite number > 0"
        ]  # fmt: skip
