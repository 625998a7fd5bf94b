"""The base of all terms of the energy."""

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
    symmetric
        Whether its tangent is symmetric; that of an energy always is.
    couples_cells
        Whether it couples unknowns that share no cell, so that the tangent's pattern changes.
    history
        Names of what it keeps from one accepted state to the next.
    """

    name: ClassVar[str]
    symmetric: ClassVar[bool] = True
    couples_cells: ClassVar[bool] = False
    history: ClassVar[tuple[str, ...]] = ()

    def lives_on(self, kernel: Kernel) -> bool:
        """Whether it acts on the regions of a kernel."""
        return True

    @abstractmethod
    def density(self, at: MaterialPoint) -> Any:
        """Energy per undeformed volume, dimensionless, symbolic."""
