"""Quantities with units, as of pint, are taken wherever a number with a unit is.

    dea.Electrode("top", volts=3 * ureg.kilovolt)

Everything inside is plain SI numbers: the decorator `in_si` turns quantities into them while an
object is made, and refuses those of another dimension.  A quantity is known by its attributes;
pint is never imported.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import plain, settle

DIMENSIONS = {
    "": "a pure number",
    "V": "a voltage in V",
    "C": "a charge in C",
    "C/m**2": "a charge per area in C/m^2",
    "m": "a length in m",
    "rad": "an angle in rad",
    "rad/m": "a twist in rad/m",
    "N": "a force in N",
    "N*m": "a torque in N m",
    "N/m": "a stiffness in N/m",
    "Pa": "a pressure or stress in Pa",
    "Pa*m**3": "an amount of gas in Pa m^3",
    "m**3": "a volume in m^3",
    "V/m": "an electric field in V/m",
    "s": "a time in s",
    "Hz": "a frequency in Hz",
    "1/s": "a rate in 1/s",
    "m/s": "a velocity in m/s",
    "A": "a current in A",
    "ohm": "a resistance in ohm",
    "S/m": "a conductivity in S/m",
    "kg": "a mass in kg",
    "kg*m**2": "a moment of inertia in kg m^2",
    "kg/m**3": "a density in kg/m^3",
    "m/s**2": "an acceleration in m/s^2",
    "N/m**3": "a force per volume in N/m^3",
    "rad/s": "a speed in rad/s",
    "Pa*s": "a viscosity in Pa s",
    "1/Pa**2": "a number in 1/Pa^2",
    "K": "a temperature in K",
    "1/K": "a number in 1/K",
    "J/mol": "an energy per mole in J/mol",
    "J/K/m**3": "a heat capacity in J/(K m^3)",
}
"""What can be expected: the SI unit (as pint writes it, empty for none), and in words."""

INCH = 0.0254
"""In m, exact."""
POUND_FORCE = 4.4482216152605
"""In N, exact."""


def _is_quantity(value: Any) -> bool:
    return hasattr(value, "magnitude") and hasattr(value, "units")


def si(value: Any, unit: str, what: str) -> Any:
    """A quantity as a plain number in an SI unit; numbers of numpy's as Python's own.

    What is neither is returned as it is.

    Parameters
    ----------
    value
        A number, a quantity with ``magnitude`` and ``units``, or a list or tuple of either.  A
        quantity that holds an array becomes a tuple.
    unit
        One of `DIMENSIONS`.
    what
        What it is, for the message.

    Raises
    ------
    InputError
        If a quantity has another dimension.
    """
    if isinstance(value, list | tuple) and any(_is_quantity(v) for v in value):
        return tuple(si(v, unit, what) for v in value)
    if not _is_quantity(value):
        # an array stays one: test data are arrays
        return value if getattr(value, "ndim", 0) else plain(value)
    try:
        number = value.to(unit or "dimensionless").magnitude
    except Exception as error:  # each library of units has its own
        told = " ".join(str(value).split())
        raise InputError(f"{what} is {told}, but must be {DIMENSIONS[unit]}.") from error
    if getattr(number, "ndim", 0):
        return tuple(number.tolist())
    return float(number)


def in_si[T](**units: str) -> Callable[[type[T]], type[T]]:
    """Class decorator, below ``@dataclass``: the named fields may be given as quantities.

    They are turned into SI numbers before the class's own ``__post_init__`` sees them.

    Parameters
    ----------
    **units
        Field name to SI unit, one of `DIMENSIONS`.
    """
    unknown = set(units.values()) - set(DIMENSIONS)
    if unknown:
        raise ValueError(f"{sorted(unknown)} are no keys of DIMENSIONS; add them there.")

    def decorate(cls: type[T]) -> type[T]:
        own = getattr(cls, "__post_init__", None)

        def __post_init__(self: T) -> None:
            for name, unit in units.items():
                value = getattr(self, name)
                number = si(value, unit, f"{type(self).__name__}: {name}")
                if number is not value:
                    object.__setattr__(self, name, number)
            settle(self)
            if own is not None:
                own(self)

        cls.__post_init__ = __post_init__  # type: ignore[attr-defined]
        return cls

    return decorate
