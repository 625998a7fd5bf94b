"""What a membrane has beside the terms of a solid: a reference for residuals, and wrinkles."""

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


class WrinkledElasticity(EnergyTerm):
    """(1 - slack) [W* - W] where the film is not taut, with the relaxed energy W*.

    So the share `slack` of the energy of a film without wrinkles stays; see `model.tension_field`.
    """

    name = "wrinkled elasticity"
    stored_as = "elastic"

    def __init__(self, slack: float) -> None:
        self.slack = float(slack)

    def lives_on(self, kernel: Kernel) -> bool:
        return kernel.is_membrane

    def density(self, at: MaterialPoint) -> Any:
        elastic, field = at.kernel.elastic, at.tension_field
        change = elastic.energy(field.strain) - elastic.energy(at.strain)
        share = at.per_stress * at.constant(1 - self.slack)
        return ufl.conditional(field.taut, 0.0, share * change)


class WrinkledDielectric(EnergyTerm):
    """The same of the electric energy, - eps E^2/2 times the square of the area of the film."""

    name = "wrinkled dielectric"
    fields = ("phi",)
    stored_as = "electric"
    stored_sign = -1

    def __init__(self, slack: float) -> None:
        self.slack = float(slack)

    def density(self, at: MaterialPoint) -> Any:
        field, before = at.tension_field, ufl.dot(at.prestretch, at.normal)
        ahead, across = field.squares
        E, cofactors, eps = at.nominal_field, at.cofactor_field, at.kernel.eps
        assert eps is not None
        relaxed = ufl.dot(E, E) * ufl.dot(before, before) * ahead * across
        change = -(eps / 2 * (relaxed - ufl.dot(cofactors, cofactors)))
        return ufl.conditional(field.taut, 0.0, at.constant(1 - self.slack) * change)
