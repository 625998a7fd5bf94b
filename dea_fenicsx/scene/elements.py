"""The finite elements of a scene."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

from dea_fenicsx.support.cell_types import SIMPLICES
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import plain_numbers
from dea_fenicsx.support.validation import one_of

PressureElement = Literal["auto", "discontinuous", "continuous"]


@dataclass(frozen=True)
@plain_numbers
class Discretisation:
    """The finite elements.

    Parameters
    ----------
    pressure
        ``"discontinuous"``: linear in each cell, so that it may jump at electrodes as it must.
        ``"continuous"``: Taylor-Hood.  ``"auto"`` takes discontinuous on hexahedra and
        quadrilaterals, continuous on tetrahedra and triangles (where linear discontinuous pressure
        is not stable).
    potential_degree
        Polynomial degree of the potential, 1 or 2.
    quadrature_degree
        Degree of exactness of the quadrature.
    augmentation
        gamma, a pure number: incompressible regions get gamma/2 s (J - 1)^2 on top of p (J - 1),
        with a stress s >= 0 that grows with that of the material, such as mu (I1 - 3 - 2 ln J) in
        neo-Hookean rubber.  It vanishes in the exact state.  Without it mixed elements have
        instabilities that the rubber does not have; from gamma = 2 on they have none.  The table of
        s, and what was measured, is in docs/theory.md, "Elements".
    """

    pressure: PressureElement = "auto"
    potential_degree: int = 2
    quadrature_degree: int = 4
    augmentation: float = 5.0

    PRESSURES: ClassVar[tuple[str, ...]] = get_args(PressureElement)

    def pressure_on(self, cell: str) -> str:
        """``"continuous"`` or ``"discontinuous"``: the pressure on a type of cell."""
        if self.pressure != "auto":
            return self.pressure
        return "continuous" if cell in SIMPLICES else "discontinuous"

    def check(self, cell: str) -> None:
        """Raise InputError unless the elements exist and are stable on a type of cell."""
        one_of(self.pressure, self.PRESSURES, "The pressure element")
        if self.pressure == "discontinuous" and cell in SIMPLICES:
            raise InputError(
                "A discontinuous linear pressure is unstable on triangles and tetrahedra; use "
                'pressure="continuous".'
            )
        if self.potential_degree not in (1, 2):
            raise InputError(
                f"The degree of the potential is {self.potential_degree!r}, but must be 1 or 2."
            )
        if not (math.isfinite(self.augmentation) and 0 <= self.augmentation <= 1e4):
            raise InputError(
                f"The augmentation is {self.augmentation!r}, but must lie between 0 and 10000 "
                "(times the shear modulus)."
            )
        if not 2 <= self.quadrature_degree <= 12:
            raise InputError(
                f"The quadrature degree is {self.quadrature_degree!r}, but must lie between 2 and "
                "12."
            )
