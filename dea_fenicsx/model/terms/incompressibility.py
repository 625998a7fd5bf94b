"""The energy of the pressure, which constrains the volume or gives the bulk modulus."""

from __future__ import annotations

from typing import Any

from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.model.terms.base import EnergyTerm


class Volume(EnergyTerm):
    """p (J - 1), and - p^2 / (2 kappa) in a region with a bulk modulus kappa.

    J is without the thermal expansion.
    """

    name = "volume"
    fields = ("p",)
    stored_as = "elastic"

    def density(self, at: MaterialPoint) -> Any:
        energy, kappa = at.p * (at.elastic_J - 1), at.kernel.kappa
        found = energy if kappa is None else energy - at.p**2 / (2 * kappa)
        return at.swelling * found
