"""Tube of coaxial layers: half a section, a quarter or the whole in space."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si

from . import _check
from ._lattice import FlatLattice, GroupBox, Lattice, between, side_boxes
from ._polar import rings
from ._structured import Floats, lattice_points
from .base import Layer, OfLattice, boxes_of_layers, checked_layers, ends_of_layers, refuse_clash

Part = Literal["section", "quarter", "whole"]
PARTS: tuple[Part, ...] = get_args(Part)


@dataclass(frozen=True)
@in_si(inner="m", height="m")
class Tube(OfLattice):
    """Coaxial layers around the z axis from z = 0, the first one inside.

    Parameters
    ----------
    inner
        Inner radius in metres.
    height
        In metres.
    layers
        From the inside out; their thicknesses add up to the wall's.
    part
        ``"section"``: the (r, z) plane, for `Axisymmetric`; ``"quarter"``: x, y >= 0 in space;
        ``"whole"``.
    angular
        Cells around a whole tube; a multiple of 4 for a quarter.
    axial
        Cells along z.
    order
        Degree of the cells' geometry, 1 or 2.

    Notes
    -----
    Volume groups: the layers' names.  Facet groups: ``inner``, ``outer``, ``bottom``, ``top``, and
    ``interface_1``, ``interface_2``, ... between layers 1 and 2, 2 and 3, ...; of a quarter
    ``x_min`` and ``y_min``.

    Raises
    ------
    InputError
        A parameter is not usable.
    """

    inner: float
    height: float
    layers: Sequence[Layer]
    part: Part = "section"
    angular: int = 16
    axial: int = 4
    order: int = 2

    def __post_init__(self) -> None:
        for name in ("inner", "height"):
            _check.length("Tube", name, getattr(self, name))
        object.__setattr__(self, "layers", checked_layers("Tube", self.layers))
        if self.part not in PARTS:
            raise InputError(
                f"Tube: part is {shown(self.part)}; it must be one of {', '.join(PARTS)}."
            )
        _check.count("Tube", "angular", self.angular, least=4)
        _check.count("Tube", "axial", self.axial)
        if self.part == "quarter" and self.angular % 4:
            raise InputError(
                f"Tube: angular is {self.angular}; a quarter needs a multiple of 4."
            )
        _check.order("Tube", self.order)
        refuse_clash("Tube", {layer.name for layer in self.layers}, set(self._facet_names()))

    def _facet_names(self) -> list[str]:
        cuts = ["x_min", "y_min"] if self.part == "quarter" else []
        between = [f"interface_{i}" for i in range(1, len(self.layers))]
        return ["inner", "outer", "bottom", "top", *cuts, *between]

    @property
    def dimension(self) -> int:
        """3, or 2 for the section."""
        return 2 if self.part == "section" else 3

    @property
    def radii(self) -> Floats:
        """Radii of the faces of the layers in metres, from the inside."""
        return self.inner + np.cumsum([0.0, *(layer.thickness for layer in self.layers)])

    def measures(self) -> dict[str, float]:
        """Exact volume of every layer name and area of every facet group; areas, lengths in 2-D."""
        radii, flat = [float(r) for r in self.radii], self.part == "section"
        angle = 2 * math.pi / (4 if self.part == "quarter" else 1)

        def disc(a: float, b: float) -> float:
            return b - a if flat else angle / 2 * (b**2 - a**2)

        def wall(r: float) -> float:
            return self.height * (1 if flat else angle * r)

        found: dict[str, float] = {}
        for layer, a, b in zip(self.layers, radii, radii[1:], strict=False):
            found[layer.name] = found.get(layer.name, 0.0) + self.height * disc(a, b)
        found |= {"inner": wall(radii[0]), "outer": wall(radii[-1])}
        found |= dict.fromkeys(("bottom", "top"), disc(radii[0], radii[-1]))
        if self.part == "quarter":
            found |= dict.fromkeys(("x_min", "y_min"), self.height * (radii[-1] - radii[0]))
        return found | {f"interface_{k}": wall(r) for k, r in enumerate(radii[1:-1], 1)}

    def refine(self, factor: int) -> Tube:
        """The same tube with all divisions multiplied by ``factor``."""
        k = _check.count("Tube.refine", "factor", factor)
        layers = tuple(replace(layer, divisions=k * layer.divisions) for layer in self.layers)
        return replace(self, layers=layers, angular=k * self.angular, axial=k * self.axial)

    def lattice(self) -> Lattice:
        """See `OfLattice.lattice`."""
        ends = ends_of_layers(self.layers, self.inner)
        heights = np.linspace(0.0, self.height, self.axial + 1)
        if self.part == "section":
            return between([ends, heights], self.order, self._boxes())
        return self._plane(ends).swept(heights, self.order, self._boxes())

    def _plane(self, ends: Floats) -> FlatLattice:
        """The quadrilaterals across the axis, along the radius and around."""
        radii = lattice_points(ends, self.order)
        around = self.angular // (4 if self.part == "quarter" else 1)
        turn = 2 * math.pi * around / self.angular
        angles = lattice_points(np.linspace(0.0, turn, around + 1), self.order)
        if self.part == "whole":  # the last angle is the first one
            angles = angles[:-1]
        directions = np.column_stack([np.cos(angles), np.sin(angles)])
        directions[np.abs(directions) < 1e-12] = 0.0  # the cosine of a right angle
        return rings(radii, directions, around, self.order)

    def _boxes(self) -> list[GroupBox]:
        """The groups by the logical indices of cells: along the radius, around, along z."""
        around = self.angular // (4 if self.part == "quarter" else 1)
        others = (*([] if self.part == "section" else [range(around)]), range(self.axial))
        whole = (range(sum(layer.divisions for layer in self.layers)), *others)
        regions, interfaces = boxes_of_layers(self.layers, whole, 0)
        walls = side_boxes(whole, 0, "inner", "outer")
        ends = side_boxes(whole, len(others), "bottom", "top")
        cuts = side_boxes(whole, 1, "y_min", "x_min") if self.part == "quarter" else []
        return [*regions, *walls, *ends, *cuts, *interfaces]
