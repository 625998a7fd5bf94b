"""What a membrane has beside the terms of a solid."""

from __future__ import annotations

from typing import Any

import ufl

from dea_fenicsx.model.kernels import Kernel
from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.model.terms.base import EnergyTerm


class ReferenceTension(EnergyTerm):
    """p (A - 1), with the area A of the film per undeformed area.

    p is 0 in every state, because the pressure of a membrane is eliminated.  So the term bears
    nothing; the forces of a tension p of the size of the modulus tell what residual is small.
    """

    name = "reference tension"
    stored_as = "elastic"

    def lives_on(self, kernel: Kernel) -> bool:
        return kernel.is_membrane

    def density(self, at: MaterialPoint) -> Any:
        through = ufl.dot(at.F, at.normal)
        return at.p * (1 / ufl.sqrt(ufl.dot(through, through)) - 1)

    def stored(self, at: MaterialPoint) -> None:
        """Nothing, since p is 0."""
