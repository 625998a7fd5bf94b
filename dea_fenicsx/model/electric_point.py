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
        self._at, self.law = at, at.kernel.electric
        self._true = pulled / at.J
        self.e2 = ufl.variable(ufl.dot(pulled, pulled) / at.J**2)

    @property
    def I1(self) -> Any:
        return self._at.strain.I1

    @cached_property
    def E2(self) -> Any:
        """With the deformation that the material has undergone, pre-stretch included."""
        back = ufl.dot(ufl.transpose(self._at.total), self._true)
        return ufl.variable(ufl.dot(back, back))

    @property
    def ln_J(self) -> Any:
        solid = self._at.kernel.is_incompressible
        return self._at.constant(0.0) if solid else ufl.ln(self._at.J)

    @property
    def vacuum(self) -> Any:
        return self._at.constant(self._at.kernel.vacuum)

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
        return self._at.J * self.law.coenergy(self)

    @property
    def displacement(self) -> Any:
        """Nominal displacement J F^-1 du/de, charge per undeformed area."""
        u, along = self.law.coenergy(self), self._true
        found = 2 * ufl.diff(u, self.e2) * along
        if self.law.depends_on_strain:
            total = self._at.total
            back = ufl.dot(total, ufl.dot(ufl.transpose(total), along))
            found = found + 2 * ufl.diff(u, self.E2) * back
        return ufl.dot(ufl.transpose(self._at.cofactor), found)
