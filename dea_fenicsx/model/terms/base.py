"""What every term of the energy or of the virtual work is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

from dea_fenicsx.model.kernels import Kernel
from dea_fenicsx.model.material_point import MaterialPoint

Variation = Callable[[Any], Any]
"""Gives the variation of an expression in the fields: ``virtual(at.F)`` is that of F."""


class Term(ABC):
    """A term of the energy or of the virtual work, per undeformed volume.

    Attributes
    ----------
    name
        Its name.
    stored_as
        The kind of stored energy that it is part of, such as ``"elastic"``; its own name where it
        is empty.  `Energy` adds up the terms of a kind.
    stored_sign
        1 where the energy that is stored is the term itself, -1 where it is minus the term.
    symmetric
        Whether its tangent is symmetric.
    symmetric_at_once
        Whether it is so where no time passes, so that all that it keeps stays as it is.
    couples_cells
        Whether it couples unknowns that share no cell, so that the tangent's pattern changes.
    history
        Names of what it keeps from one accepted state to the next.
    fields
        Names of fields that it needs: it acts only where all of them live.
    """

    name: ClassVar[str]
    stored_as: ClassVar[str] = ""
    stored_sign: ClassVar[int] = 1
    symmetric: ClassVar[bool] = True
    symmetric_at_once: ClassVar[bool] = True
    couples_cells: ClassVar[bool] = False
    history: ClassVar[tuple[str, ...]] = ()
    fields: ClassVar[tuple[str, ...]] = ()

    def lives_on(self, kernel: Kernel) -> bool:
        """Whether it acts on the regions of a kernel."""
        return set(self.fields) <= set(kernel.fields)

    def settle(self, volume: float) -> None:  # noqa: B027  (most need no volume)
        """Take the volume of the whole device, dimensionless, once it is known."""

    def stored(self, at: MaterialPoint) -> Any:
        """What it stores in the body, per undeformed volume, dimensionless; None for nothing."""
        return None

    def work(self, at: MaterialPoint, virtual: Variation) -> Any:
        """Virtual work per undeformed volume, dimensionless, symbolic, linear in the variation.

        A term of the energy that gives None has the variation of its density.  A density whose
        derivatives are long compiles many times faster if the term gives its stress times
        virtual(F) here, because only one more derivative is left for the tangent.
        """
        return None

    def following(self, at: MaterialPoint, change: Variation, virtual: Variation) -> Any:
        """What the tangent has beside the derivative at kept coefficients, or None.

        A term whose coefficients at quadrature points follow the deformation says here how: its
        virtual work per undeformed volume due to their change, symbolic, linear in both variations.
        """
        return None


class EnergyTerm(Term):
    """A term of the energy; its tangent is symmetric."""

    @abstractmethod
    def density(self, at: MaterialPoint) -> Any:
        """Energy per undeformed volume, dimensionless, symbolic."""

    def stored(self, at: MaterialPoint) -> Any:
        """What of it is stored in the body, per undeformed volume, dimensionless, symbolic."""
        return self.stored_sign * self.density(at)


class WorkTerm(Term):
    """A term of the virtual work that is no variation of an energy.

    It adds to the variation of the energy.  So a stress P gives P : virtual(F), and a body force b
    per undeformed volume, which acts from outside, gives -b . virtual(u).  Reactions contain it;
    the written Cauchy stress is that of the energy alone.  It may not depend on the factor of a
    pre-stretch.
    """

    symmetric: ClassVar[bool] = False
    symmetric_at_once: ClassVar[bool] = False

    @abstractmethod
    def work(self, at: MaterialPoint, virtual: Variation) -> Any:
        """Virtual work per undeformed volume, dimensionless, symbolic, linear in the variation."""
