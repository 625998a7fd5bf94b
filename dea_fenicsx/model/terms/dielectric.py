"""The electric energy of an ideal dielectric."""

from __future__ import annotations

from typing import Any

import ufl

from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.model.terms.base import EnergyTerm


class Dielectric(EnergyTerm):
    """- 1/2 eps J |F^-T E|^2, where E = - Grad phi; the true field is F^-T E."""

    name = "dielectric"
    fields = ("phi",)
    stored_as = "electric"
    stored_sign = -1  # at given voltages the term is minus the energy of the field

    def density(self, at: MaterialPoint) -> Any:
        pulled, eps = at.cofactor_field, at.kernel.eps
        assert eps is not None
        return -(eps / 2 * ufl.dot(pulled, pulled) / at.J)
