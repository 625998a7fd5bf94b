"""The augmentation, a stiffness against change of volume that vanishes in the exact state."""

from __future__ import annotations

from typing import Any

import ufl

from dea_fenicsx.materials import Elastic
from dea_fenicsx.model.kernels import Kernel
from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.model.terms.base import EnergyTerm
from dea_fenicsx.scene.kinematics import StrainOf


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
        stress = _stress_of_strain(at.kernel.elastic, at.strain, at.J)
        stiffness = at.per_stress * at.constant(self.factor) * stress
        return stiffness / 2 * (at.J - 1) ** 2


def _stress_of_strain(elastic: Elastic, strain: StrainOf, J: Any) -> Any:
    """A stress s >= 0 that grows with the stress of the material, for the augmentation.

    It is 0 at rest and nowhere negative, and grows without limit towards J = 0.  A model may bring
    its own, `stress_size`; for any other it is mu (I1 - 3 - 2 ln J) over the chain margin, with the
    initial shear modulus mu, which is positive however the constants are written.
    """
    if hasattr(elastic, "stress_size"):
        return elastic.stress_size(strain, ufl.ln(J))
    stress = elastic.shear_modulus() * (strain.I1 - 3 - 2 * ufl.ln(J))
    margin = elastic.chain_margin(strain)
    return stress if margin is None else stress / margin
