"""Polarisations that follow the field with a delay, in the virtual work."""

from __future__ import annotations

from typing import Any

import ufl

from dea_fenicsx.model.kernels import BoundDebye, Kernel
from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.model.terms.base import Variation, WorkTerm


class DielectricRelaxation(WorkTerm):
    """Variation of |F P|^2/(2 eps J) - P . E for each Debye term, with its polarisation P held.

    P follows the present field by a share of it, so that the tangent is not symmetric.  Where no
    time passes it stays, and the work is the variation of an energy.
    """

    name, symmetric_at_once = "dielectric relaxation", True
    fields = ("phi",)
    stored_as = "electric"
    history = ("charge",)

    def lives_on(self, kernel: Kernel) -> bool:
        return bool(kernel.relaxation)

    def work(self, at: MaterialPoint, virtual: Variation) -> Any:
        total: Any = 0
        for term in at.kernel.relaxation:
            P = at.polarisation(term)
            FP = ufl.dot(at.F, P)
            change = ufl.dot(FP, ufl.dot(virtual(at.F), P)) / at.J
            change -= ufl.dot(FP, FP) / (2 * at.J**2) * virtual(at.J)
            total += change / term.eps - ufl.dot(P, virtual(at.nominal_field))
        return total

    def stored(self, at: MaterialPoint) -> Any:
        """The energy of the polarisations, |F P|^2/(2 eps J)."""
        return sum(_energy(at, term) for term in at.kernel.relaxation)


def _energy(at: MaterialPoint, term: BoundDebye) -> Any:
    FP = ufl.dot(at.F, at.polarisation(term))
    return ufl.dot(FP, FP) / (2 * term.eps * at.J)


def relaxation_power(at: MaterialPoint) -> Any:
    """Power that delayed polarisations turn into heat, per undeformed volume in stress per s.

    With the polarisation of the present field X it is |F (X - P)|^2/(eps tau J).
    """
    total: Any = 0
    for term in at.kernel.relaxation:
        X = term.eps / at.kernel.eps * at.displacement_field
        lag = ufl.dot(at.F, X - at.polarisation(term))
        total += ufl.dot(lag, lag) / (term.eps * term.tau * at.J)
    return total
