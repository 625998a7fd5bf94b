"""The charge that has leaked through dielectrics, in the rows of the potential."""

from __future__ import annotations

from typing import Any

import ufl

from dea_fenicsx.model.kernels import Kernel
from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.model.terms.base import EnergyTerm, Variation, WorkTerm


class AlikeLeak(EnergyTerm):
    """- h . E with the history h; for dielectrics that have one constant omega = g/eps.

    The rows of the potential say that T/psi = D + h has no source; see `model.charge_history`.
    """

    name = "leak"
    fields = ("phi",)
    history = ("charge",)

    def lives_on(self, kernel: Kernel) -> bool:
        return kernel.leak is not None

    def density(self, at: MaterialPoint) -> Any:
        assert at.kernel.leak is not None
        return -ufl.dot(at.kernel.leak.history, at.nominal_field)

    def stored(self, at: MaterialPoint) -> Any:
        """Nothing: charge that has left stores no energy."""
        return ufl.as_ufl(0.0)


class MixedLeak(WorkTerm):
    """- [(psi - 1) D + h] . virtual E, for dielectrics that conduct differently.

    The mechanical part of the virtual work knows D alone, so that the tangent is not symmetric.
    Where no time passes psi is 1, and - h . E is left, which has a symmetric one.
    """

    name, symmetric_at_once = "leak", True
    fields = ("phi",)
    history = ("charge",)

    def lives_on(self, kernel: Kernel) -> bool:
        return kernel.leak is not None

    def work(self, at: MaterialPoint, virtual: Variation) -> Any:
        leak = at.kernel.leak
        assert leak is not None
        flux = leak.excess * at.displacement_field + leak.history
        return -ufl.dot(flux, virtual(at.nominal_field))
