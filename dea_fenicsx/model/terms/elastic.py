"""The elastic energy W(F) of a rubber."""

from __future__ import annotations

from typing import Any

import ufl

from dea_fenicsx.model.kernels import Kernel
from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.model.terms.base import EnergyTerm


class Elasticity(EnergyTerm):
    """W(F) - W'(1) ln J in incompressible regions, W(F) in foams, else W(J^(-1/3) F).

    The term with ln J makes the stress 0 in the undeformed state with p = 0.
    """

    name = "elastic"
    stored_as = "elastic"

    def lives_on(self, kernel: Kernel) -> bool:
        return kernel.air is None

    def density(self, at: MaterialPoint) -> Any:
        elastic = at.kernel.elastic
        energy = elastic.energy(at.strain)
        if at.kernel.is_incompressible:
            energy = energy - elastic.spherical_slope() * ufl.ln(at.elastic_J)
        return at.per_stress * at.heated.modulus * at.swelling * energy
