"""What every term of the energy is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

from dea_fenicsx.model.kernels import Kernel
from dea_fenicsx.model.material_point import MaterialPoint


class EnergyTerm(ABC):
    """A term of the energy per undeformed volume.

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
        Whether its tangent is symmetric; that of an energy always is.
    couples_cells
        Whether it couples unknowns that share no cell, so that the tangent's pattern changes.
    history
        Names of what it keeps from one accepted state to the next.
    """

    name: ClassVar[str]
    stored_as: ClassVar[str] = ""
    stored_sign: ClassVar[int] = 1
    symmetric: ClassVar[bool] = True
    couples_cells: ClassVar[bool] = False
    history: ClassVar[tuple[str, ...]] = ()

    def lives_on(self, kernel: Kernel) -> bool:
        """Whether it acts on the regions of a kernel."""
        return True

    @abstractmethod
    def density(self, at: MaterialPoint) -> Any:
        """Energy per undeformed volume, dimensionless, symbolic."""
