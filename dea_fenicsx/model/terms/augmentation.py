"""The augmentation, a stiffness against change of volume that vanishes in the exact state."""

from __future__ import annotations

from typing import Any

import ufl

from dea_fenicsx.materials.base import stress_size
from dea_fenicsx.model.kernels import Kernel
from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.model.terms.base import EnergyTerm


class Augmentation(EnergyTerm):
    """gamma/2 s(F) (J - 1)^2 in incompressible regions, with a stress s of the material's size.

    It is zero where J = 1, and so takes nothing from the exact state; see `Discretisation`.

    Parameters
    ----------
    factor
        gamma.
    """

    name = "augmentation"
    stored_as = "elastic"

    def __init__(self, factor: float) -> None:
        self.factor = float(factor)

    def lives_on(self, kernel: Kernel) -> bool:
        return kernel.is_incompressible and not kernel.is_membrane

    def density(self, at: MaterialPoint) -> Any:
        # The factor is a constant of the form, so another value needs no compilation.
        stress = stress_size(at.kernel.elastic, at.strain, ufl.ln(at.elastic_J))
        stiffness = at.per_stress * at.constant(self.factor) * stress
        return stiffness / 2 * (at.elastic_J - 1) ** 2
