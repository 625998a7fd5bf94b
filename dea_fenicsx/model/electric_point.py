"""The symbolic `FieldPoint`: strain and field for the energies of dielectrics."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import ufl


class ElectricPoint:
    """A field at a point of the material; see `materials.electric.FieldPoint`.

    Parameters
    ----------
    at
        The material point.
    pulled
        J times the true field.
    """

    def __init__(self, at: Any, pulled: Any) -> None:
        # We do not keep the material point itself, which keeps this one: the mesh of a scene that
        # is gone would otherwise live until Python looks for such circles.
        self.law, self._strain = at.kernel.electric, at.strain
        self._total = at.elastic_F if at.kernel.is_incompressible else at.total
        self._factor = at.heated.permittivity
        self._J, self._cofactor = at.J, at.cofactor
        self._true = pulled / at.J
        self.e2 = ufl.variable(ufl.dot(pulled, pulled) / at.J**2)
        self.ln_J = at.constant(0.0) if at.kernel.is_incompressible else ufl.ln(at.elastic_J)
        self.vacuum = at.constant(at.kernel.vacuum)

    @property
    def I1(self) -> Any:
        return self._strain.I1

    @cached_property
    def E2(self) -> Any:
        """With the deformation that the material has undergone, pre-stretch included."""
        back = ufl.dot(ufl.transpose(self._total), self._true)
        return ufl.variable(ufl.dot(back, back))

    @staticmethod
    def exp(x: Any) -> Any:
        return ufl.exp(x)

    @staticmethod
    def ln(x: Any) -> Any:
        return ufl.ln(x)

    @staticmethod
    def choose(x: Any, edge: float, below: Any, above: Any) -> Any:
        return ufl.conditional(ufl.lt(x, edge), below, above)

    @staticmethod
    def at_least(x: Any, edge: float) -> Any:
        return ufl.conditional(ufl.lt(x, edge), edge, x)

    @property
    def energy(self) -> Any:
        """J u, per undeformed volume."""
        return self._J * self._factor * self.law.coenergy(self)

    @property
    def displacement(self) -> Any:
        """Nominal displacement J F^-1 du/de, charge per undeformed area."""
        u, along = self.law.coenergy(self), self._true
        found = 2 * ufl.diff(u, self.e2) * along
        if self.law.depends_on_strain:
            total = self._total
            back = ufl.dot(total, ufl.dot(ufl.transpose(total), along))
            found = found + 2 * ufl.diff(u, self.E2) * back
        return ufl.dot(ufl.transpose(self._cofactor), self._factor * found)
