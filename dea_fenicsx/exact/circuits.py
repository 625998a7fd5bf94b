"""Charge of a film in closed form: leakage, charging through a resistor, a harvesting cycle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dea_fenicsx.exact.film_field import FilmField
from dea_fenicsx.exact.states import of_kept_volume
from dea_fenicsx.materials import Material
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import is_number, shown
from dea_fenicsx.support.units import si
from dea_fenicsx.support.validation import positive


def leaked_charge(charge: Any, seconds: Any, conductivity: float, permittivity: float) -> Any:
    """Charge of a disconnected film after some time, Q0 exp(-g t/eps), however it deforms.

    Parameters
    ----------
    charge
        Charge at the start, of any unit.
    seconds
        Times in s.
    conductivity
        g of the dielectric in S/m, constant.
    permittivity
        eps in F/m.
    """
    positive(permittivity, "The permittivity", "a number > 0 in F/m")
    return charge * np.exp(-conductivity * np.asarray(seconds, dtype=float) / permittivity)


def charging_voltage(source: float, seconds: Any, resistance: float, capacitance: float) -> Any:
    """Voltage in V of a film of constant capacitance that a source charges through a resistor.

    V (1 - exp(-t/(R C))), with the source's voltage V, R in ohm and C in F.
    """
    positive(resistance, "The resistance", "a number > 0 in ohm")
    positive(capacitance, "The capacitance", "a number > 0 in F")
    source = si(source, "V", "The source's voltage")
    t = np.asarray(seconds, dtype=float)
    return -source * np.expm1(-t / (resistance * capacitance))


@dataclass(frozen=True)
class Harvest:
    """One cycle of a generator between two equal-biaxial stretches; per undeformed volume.

    Attributes
    ----------
    energy : gained per cycle in J/m^3, if it is charged without loss
    energy_through_resistor : the same, if a source of constant voltage charges it by a resistor
    charge : C per undeformed m^2 that it carries from the high stretch to the low one
    nominal_fields : V/T in V/m after charging, and before discharging
    true_fields : true fields in V/m at the same two states
    """

    energy: float
    energy_through_resistor: float
    charge: float
    nominal_fields: tuple[float, float]
    true_fields: tuple[float, float]


def harvesting_cycle(material: Material, low: float, high: float, field: float) -> Harvest:
    """Energy of a cycle: charged at the high stretch, released, discharged at the low one.

    In between the film is disconnected and keeps its charge.  With the nominal field V/T at
    charging and one permittivity, energy = eps/2 (V/T)^2 high^4 [(high/low)^4 - 1]; a resistor
    takes away eps/2 (V/T)^2 high^4 of it.  Where the permittivity eps is a function of the
    stretch, (high/low)^4 eps(high)/eps(low) takes the place of (high/low)^4, and eps is that at the
    high stretch.  The energy does not depend on the elastic energy.

    Parameters
    ----------
    material
        An incompressible dielectric.
    low, high
        Equal-biaxial stretches, low < high.
    field
        Nominal field V/T at charging in V/m.
    """
    field = si(field, "V/m", "The field")
    low, high = si(low, "", "The low stretch"), si(high, "", "The high stretch")
    for name, value in (("low stretch", low), ("high stretch", high)):
        positive(value, f"The {name}")
    if not is_number(field):
        raise InputError(f"The field is {shown(field)}, but must be a number in V/m.")
    if not low < high:
        raise InputError(f"The low stretch {low:g} must be less than the high one, {high:g}.")
    of_kept_volume(material, "A harvesting cycle")
    electric = FilmField(material.dielectric_of("film's material"))
    e = np.log(np.array([[low, high], [low, high], [low**-2, high**-2]]))
    at_high = electric.maxwell(e[:, 1:], np.array([field * high**2]))
    charge = high**2 * float(electric.displacement(e[:, 1:], at_high)[0])
    displacement = charge * np.array([low, high]) ** -2.0
    true = electric.field_of(e, displacement)
    if not np.isfinite(true).all():
        raise InputError(
            f"At the low stretch {low:g}, the charge is more than the dielectric takes before it "
            "saturates; take a lower field or a higher low stretch."
        )
    stored = electric.stored(e, displacement * true)
    return Harvest(
        energy=float(stored[0] - stored[1]),
        energy_through_resistor=float(stored[0] - charge * field),
        charge=charge,
        nominal_fields=(field, float(true[0]) * low**-2),
        true_fields=(field * high**2, float(true[0])),
    )
