"""Viscous branches whose flow is solved at each quadrature point: their stress and moduli."""

from __future__ import annotations

from typing import Any

import ufl

from dea_fenicsx.model.kernels import Kernel
from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.model.terms.base import EnergyTerm, Variation
from dea_fenicsx.model.viscous_history import PAIRS


class Flowing(EnergyTerm):
    """The stress 2 dW/dC of the springs at the end of a step of time, as a coefficient.

    The viscous strains make each step's energy stationary, or follow from a law of their own.  In
    both cases the stress is the derivative of the springs' energy at kept viscous strains.  So the
    density is S : C/2, whose derivative at kept S is that stress; it is not the energy's value.
    The tangent has in addition how S follows C.

    Parameters
    ----------
    symmetric
        Whether the moduli are symmetric: no branch has a flow law of its own.
    """

    name = "viscous flow"
    stored_as = "viscous"
    history = ("viscous",)

    def __init__(self, symmetric: bool) -> None:
        self.symmetric = symmetric  # type: ignore[misc]

    def lives_on(self, kernel: Kernel) -> bool:
        return kernel.flowing is not None

    def density(self, at: MaterialPoint) -> Any:
        flowing = at.kernel.flowing
        assert flowing is not None
        total = ufl.inner(flowing.tensor, at.strain.C) / 2
        if at.kernel.is_incompressible:
            total -= flowing.slope * ufl.ln(at.J)
        return at.per_stress * total

    def stored(self, at: MaterialPoint) -> Any:
        """The energy of the springs."""
        assert at.kernel.flowing is not None
        return at.per_stress * at.kernel.flowing.measures[0]

    def following(self, at: MaterialPoint, change: Variation, virtual: Variation) -> Any:
        assert at.kernel.flowing is not None
        moved = ufl.dot(at.kernel.flowing.moduli, _mandel(change(at.strain.C)))
        return at.per_stress * ufl.dot(moved, _mandel(virtual(at.strain.C))) / 4


def _mandel(tensor: Any) -> Any:
    """The vector of a symmetric tensor whose scalar product is the double contraction."""
    return ufl.as_vector([
        tensor[i, j] if i == j else (tensor[i, j] + tensor[j, i]) / ufl.sqrt(2) for i, j in PAIRS
    ])  # fmt: skip
