"""A hollow sphere, such as a balloon: half a section, a whole section, or an eighth in space."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si

from . import _check
from ._structured import Floats, Ints, StructuredMesh, block, lattice_points
from .base import Geometry

Part = Literal["half", "whole", "octant"]
PARTS: tuple[Part, ...] = get_args(Part)


@dataclass(frozen=True)
@in_si(inner="m", outer="m")
class HollowSphere(Geometry):
    """A spherical wall about the origin.

    Parameters
    ----------
    inner, outer
        Radii in metres.
    part
        ``"half"``: the section above the equator in the (r, z) plane; ``"whole"``: the section from
        pole to pole; ``"octant"``: the eighth in space with x, y, z >= 0.
    layers
        Cells through the wall.
    cells
        Cells from the equator to a pole; of an octant an even number.
    order
        Degree of the cells' geometry, 1 or 2.

    Notes
    -----
    Volume group: ``wall``.  Facet groups: ``inner``, ``outer``; of the sections ``axis``, of the
    upper half ``equator``; of an octant ``x_min``, ``y_min``, ``z_min``.

    Raises
    ------
    InputError
        A parameter is not usable.
    """

    inner: float
    outer: float
    part: Part = "half"
    layers: int = 2
    cells: int = 8
    order: int = 2

    def __post_init__(self) -> None:
        owner = "HollowSphere"
        for name in ("inner", "outer"):
            _check.length(owner, name, getattr(self, name))
        if self.inner >= self.outer:
            raise InputError(
                f"{owner}: inner is {self.inner:g} m, but must be less than outer, "
                f"{self.outer:g} m."
            )
        if self.part not in PARTS:
            raise InputError(
                f"{owner}: part is {shown(self.part)}; it must be one of {', '.join(PARTS)}."
            )
        for name in ("layers", "cells"):
            _check.count(owner, name, getattr(self, name))
        if self.part == "octant" and self.cells % 2:
            raise InputError(f"{owner}: cells is {self.cells}; it must be even for an octant.")
        _check.order(owner, self.order)

    @property
    def dimension(self) -> int:
        """3, or 2 for a section."""
        return 3 if self.part == "octant" else 2

    def measures(self) -> dict[str, float]:
        """Exact volume of the wall and area of every facet group; areas, lengths in 2-D."""
        a, b = self.inner, self.outer
        if self.part == "octant":
            quarter = math.pi / 4 * (b**2 - a**2)
            return {
                "wall": math.pi / 6 * (b**3 - a**3),
                "inner": math.pi / 2 * a**2, "outer": math.pi / 2 * b**2,
                "x_min": quarter, "y_min": quarter, "z_min": quarter,
            }  # fmt: skip
        angle = math.pi / (2 if self.part == "half" else 1)
        found = {
            "wall": angle / 2 * (b**2 - a**2), "inner": angle * a, "outer": angle * b,
            "axis": (b - a) * (1 if self.part == "half" else 2),
        }  # fmt: skip
        return found | ({"equator": b - a} if self.part == "half" else {})

    def refine(self, factor: int) -> HollowSphere:
        """The same sphere with all divisions multiplied by ``factor``."""
        k = _check.count("HollowSphere.refine", "factor", factor)
        return replace(self, layers=k * self.layers, cells=k * self.cells)

    def mesh(self) -> StructuredMesh:
        """Nodes, cells and named parts as plain arrays."""
        return self._octant() if self.part == "octant" else self._section()

    @property
    def _radii(self) -> Floats:
        """Radii of the nodes through the wall."""
        return lattice_points(np.linspace(self.inner, self.outer, self.layers + 1), self.order)

    def _section(self) -> StructuredMesh:
        """Cells along the radius and from pole to pole, upwards."""
        around = self.cells * (1 if self.part == "half" else 2)
        low = 0.0 if self.part == "half" else -math.pi / 2
        angles = lattice_points(np.linspace(low, math.pi / 2, around + 1), self.order)
        cell, node = block((self.layers, around), self.order)
        rho, angle = (a.ravel() for a in np.meshgrid(self._radii, angles, indexing="ij"))
        points = np.column_stack([rho * np.cos(angle), rho * np.sin(angle), 0 * rho])
        # The cosine of a right angle is no exact 0.
        points[np.abs(points) < 1e-12 * self.outer] = 0.0
        cells = np.ravel_multi_index(node, (len(self._radii), len(angles)))
        mesh = StructuredMesh(points, cells)
        mesh.add_region("wall", np.arange(len(cells)))
        mesh.add_facets("inner", cell[0] == 0, 0, 0)
        mesh.add_facets("outer", cell[0] == self.layers - 1, 0, 1)
        mesh.add_facets("axis", cell[1] == around - 1, 1, 1)
        mesh.add_facets("axis" if self.part == "whole" else "equator", cell[1] == 0, 1, 0)
        return mesh

    def _octant(self) -> StructuredMesh:
        """Three patches, each the central projection of a quarter of a cube's face."""
        n = self.cells // 2
        cell, node = block((n, n, self.layers), self.order)
        line = np.tan(math.pi / 4 * lattice_points(np.linspace(0, 1, n + 1), self.order))
        line[-1] = 1.0  # the tangent of an eighth of a turn is no exact 1
        s, t, rho = (a.ravel() for a in np.meshgrid(line, line, self._radii, indexing="ij"))
        scale = rho / np.sqrt(1 + s**2 + t**2)
        faces = [(1 + 0 * s, s, t), (t, 1 + 0 * s, s), (s, t, 1 + 0 * s)]
        points = np.concatenate([np.column_stack(face) * scale[:, None] for face in faces])
        shape = (len(line), len(line), len(self._radii))
        cells = np.ravel_multi_index(node, shape)
        cells = np.concatenate([cells + k * len(s) for k in range(3)])
        points, cells = _merged(points, cells, self.outer)
        mesh = StructuredMesh(points, cells)
        mesh.add_region("wall", np.arange(len(cells)))
        low, high = (np.tile(c, 3) for c in (cell[2] == 0, cell[2] == self.layers - 1))
        mesh.add_facets("inner", low, 2, 0)
        mesh.add_facets("outer", high, 2, 1)
        face = np.repeat(np.arange(3), len(cell[0]))
        for k, name in enumerate(("x_min", "y_min", "z_min")):
            mesh.add_facets(name, (face == (k + 2) % 3) & (np.tile(cell[0], 3) == 0), 0, 0)
            mesh.add_facets(name, (face == (k + 1) % 3) & (np.tile(cell[1], 3) == 0), 1, 0)
        return mesh


def _merged(points: Floats, cells: Ints, size: float) -> tuple[Floats, Ints]:
    """Points at the same place made one."""
    _, first, number = np.unique(
        np.round(points / size, 9), axis=0, return_index=True, return_inverse=True
    )
    return points[first], number.ravel()[cells]
