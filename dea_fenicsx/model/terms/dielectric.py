"""The electric energy of a dielectric."""

from __future__ import annotations

from typing import Any

import ufl

from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.model.terms.base import EnergyTerm


class DielectricEnergy(EnergyTerm):
    """- J u(F, F^-T E) with the co-energy u of the dielectric, eps e.e/2 of an ideal one.

    E = - Grad phi is the nominal field, and e = F^-T E the true one.
    """

    name = "dielectric"
    fields = ("phi",)
    stored_as = "electric"
    stored_sign = -1  # at given voltages the term is minus the energy of the field

    def density(self, at: MaterialPoint) -> Any:
        return -at.electric.energy

    def stored(self, at: MaterialPoint) -> Any:
        """The energy of the field, E . D - J u."""
        if at.electric.law.is_linear:
            return at.electric.energy
        return ufl.dot(at.nominal_field, at.displacement_field) - at.electric.energy
