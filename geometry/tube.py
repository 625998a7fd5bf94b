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
from ._structured import Floats, StructuredMesh, block, joined_ends, lattice_points
from .base import Geometry, Layer, checked_layers, refuse_clash
from .grading import graded

Part = Literal["section", "quarter", "whole"]
PARTS: tuple[Part, ...] = get_args(Part)


@dataclass(frozen=True)
@in_si(inner="m", height="m")
class Tube(Geometry):
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

    def mesh(self) -> StructuredMesh:
        """Nodes, cells and named parts as plain arrays."""
        ends = joined_ends(*(
            start + layer.thickness * graded(layer.divisions, layer.grading, layer.ends)
            for start, layer in zip(self.radii, self.layers, strict=False)
        ))  # fmt: skip
        radii = lattice_points(ends, self.order)
        heights = lattice_points(np.linspace(0.0, self.height, self.axial + 1), self.order)
        count, axis = len(ends) - 1, self.dimension - 1  # the direction along z comes last
        if self.part == "section":
            cell, node = block((count, self.axial), self.order)
            r, z = (a.ravel() for a in np.meshgrid(radii, heights, indexing="ij"))
            points = np.column_stack([r, z, 0 * r])
            shape: tuple[int, ...] = (len(radii), len(heights))
        else:
            around = self.angular // (4 if self.part == "quarter" else 1)
            turn = 2 * math.pi * around / self.angular
            angles = lattice_points(np.linspace(0.0, turn, around + 1), self.order)
            cell, node = block((count, around, self.axial), self.order)
            if self.part == "whole":  # the last angle is the first one
                angles = angles[:-1]
                node = (node[0], node[1] % len(angles), node[2])
            r, a, z = (
                x.ravel() for x in np.meshgrid(radii, angles, heights, indexing="ij")
            )
            points = np.column_stack([r * np.cos(a), r * np.sin(a), z])
            points[np.abs(points) < 1e-12 * radii[-1]] = 0.0  # the cosine of a right angle
            shape = (len(radii), len(angles), len(heights))
        mesh = StructuredMesh(points, np.ravel_multi_index(node, shape))
        bounds = np.cumsum([0, *(layer.divisions for layer in self.layers)])
        for i, layer in enumerate(self.layers):
            mesh.add_region(layer.name, (cell[0] >= bounds[i]) & (cell[0] < bounds[i + 1]))
        mesh.add_facets("inner", cell[0] == 0, 0, 0)
        mesh.add_facets("outer", cell[0] == count - 1, 0, 1)
        mesh.add_facets("bottom", cell[axis] == 0, axis, 0)
        mesh.add_facets("top", cell[axis] == self.axial - 1, axis, 1)
        if self.part == "quarter":
            mesh.add_facets("y_min", cell[1] == 0, 1, 0)
            mesh.add_facets("x_min", cell[1] == cell[1].max(), 1, 1)
        for i in range(1, len(self.layers)):
            mesh.add_facets(f"interface_{i}", cell[0] == bounds[i] - 1, 0, 1)
        return mesh
