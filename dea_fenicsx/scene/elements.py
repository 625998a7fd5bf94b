"""The finite elements of a scene."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
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
        ``"discontinuous"``: a polynomial of one degree less than the displacement in each cell, so
        that it may jump at electrodes as it must.  ``"continuous"``: Taylor-Hood.  ``"auto"`` takes
        discontinuous on hexahedra and quadrilaterals, continuous on tetrahedra and triangles (where
        a discontinuous pressure of this degree is not stable).
    potential_degree
        Polynomial degree of the potential, from 1 to `degree`, which is the default.
    quadrature_degree
        Degree of exactness of the quadrature, ``2 degree`` by default.
    augmentation
        gamma, a pure number: incompressible regions get gamma/2 s (J - 1)^2 on top of p (J - 1),
        with a stress s >= 0 that grows with that of the material, such as mu (I1 - 3 - 2 ln J) in
        neo-Hookean rubber.  It vanishes in the exact state.  Without it mixed elements have
        instabilities that the rubber does not have; from gamma = 2 on they have none.  The table of
        s, and what was measured, is in docs/theory.md, "Elements".
    degree
        Polynomial degree of the displacement, 2, 3 or 4.  Errors fall with the power ``degree + 1``
        of the size of cells where the solution is smooth and the cells are as curved as it is.
    """

    pressure: PressureElement = "auto"
    potential_degree: int = None  # type: ignore[assignment]
    quadrature_degree: int = None  # type: ignore[assignment]
    augmentation: float = 5.0
    degree: int = 2

    PRESSURES: ClassVar[tuple[str, ...]] = get_args(PressureElement)
    DEGREES: ClassVar[tuple[int, ...]] = (2, 3, 4)

    def __post_init__(self) -> None:
        degree = self.degree if self.degree in self.DEGREES else self.DEGREES[0]
        for name, size in (("potential_degree", 1), ("quadrature_degree", 2)):
            if getattr(self, name) is None:
                object.__setattr__(self, name, size * degree)

    @property
    def quadrature_of_mass(self) -> int:
        """Degree of a quadrature of products of two displacements, axisymmetric ones included."""
        return 2 * self.degree + 2

    @property
    def quadrature_of_surfaces(self) -> int:
        """Degree of a quadrature of displacements over surfaces, axisymmetric ones included."""
        return self.degree + 2

    @property
    def quadrature_of_volumes(self) -> int:
        """Degree of a quadrature over the wall of a cavity that gives the volume behind it."""
        return 3 * self.degree

    def pressure_on(self, cell: str) -> str:
        """``"continuous"`` or ``"discontinuous"``: the pressure on a type of cell."""
        if self.pressure != "auto":
            return self.pressure
        return "continuous" if cell in SIMPLICES else "discontinuous"

    def richer(self) -> Discretisation:
        """Elements of one degree more in each field, in which errors of these are estimated."""
        values = {field.name: getattr(self, field.name) for field in fields(Discretisation)}
        values["degree"] += 1
        values["potential_degree"] += 1
        values["quadrature_degree"] = min(values["quadrature_degree"] + 2, 12)
        return _Richer(**values)

    def check(self, cell: str) -> None:
        """Raise InputError unless the elements exist and are stable on a type of cell."""
        if self.degree not in self.DEGREES:
            raise InputError(
                f"The degree of the displacement is {self.degree!r}, but must be 2, 3 or 4."
            )
        one_of(self.pressure, self.PRESSURES, "The pressure element")
        if self.pressure == "discontinuous" and cell in SIMPLICES:
            raise InputError(
                "A discontinuous pressure is unstable on triangles and tetrahedra; use "
                'pressure="continuous".'
            )
        if not 1 <= self.potential_degree <= self.degree:
            among = "1 or 2" if self.degree == 2 else f"from 1 to {self.degree}"
            raise InputError(
                f"The degree of the potential is {self.potential_degree!r}, but must be {among}."
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


@dataclass(frozen=True)
class _Richer(Discretisation):
    """Elements in which errors are estimated: of one degree more than a scene may have."""

    DEGREES: ClassVar[tuple[int, ...]] = (*Discretisation.DEGREES, Discretisation.DEGREES[-1] + 1)
