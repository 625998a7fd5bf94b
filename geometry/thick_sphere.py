"""A thick-walled sphere: a quarter or a half of its section, or an octant in space."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si

from . import _check
from ._structured import StructuredMesh, block, lattice_points
from .base import Geometry

Part = Literal["quarter", "half", "octant"]


@dataclass(frozen=True)
@in_si(inner_radius="m", outer_radius="m")
class ThickSphere(Geometry):
    """The wall of a hollow sphere about the origin.

    Parameters
    ----------
    inner_radius, outer_radius
        In metres.
    part
        ``"quarter"``, the quarter r, z >= 0 of the section in the (r, z) plane, for `Axisymmetric`
        with the plane z = 0 as one of symmetry; ``"half"``, the whole section; or ``"octant"``, in
        space with three planes of symmetry.
    radial
        Cells through the wall.
    around
        Cells over a right angle; an octant has three blocks of half as many along each edge.
    order
        Degree of the cells' geometry, 1 or 2.

    Notes
    -----
    Volume group: ``wall``.  Facet groups: ``inner`` and ``outer``; of a section ``axis``, of its
    quarter also ``equator``; of an octant ``x_min``, ``y_min`` and ``z_min``.

    Raises
    ------
    InputError
        A parameter is not usable.
    """

    inner_radius: float
    outer_radius: float
    part: Part = "quarter"
    radial: int = 2
    around: int = 6
    order: int = 2

    def __post_init__(self) -> None:
        owner = "ThickSphere"
        for name in ("inner_radius", "outer_radius"):
            _check.length(owner, name, getattr(self, name))
        if self.inner_radius >= self.outer_radius:
            raise InputError(
                f"{owner}: the inner radius {self.inner_radius:g} m must be smaller than the outer "
                f"one, {self.outer_radius:g} m."
            )
        if self.part not in get_args(Part):
            raise InputError(
                f"{owner}: part is {shown(self.part)}; it must be one of "
                f"{', '.join(get_args(Part))}."
            )
        _check.count(owner, "radial", self.radial)
        _check.count(owner, "around", self.around)
        if self.part == "octant" and self.around % 2:
            raise InputError(
                f"{owner}: around is {self.around}; of an octant it must be an even number."
            )
        _check.order(owner, self.order)

    @property
    def dimension(self) -> int:
        """3 of an octant, else 2."""
        return 3 if self.part == "octant" else 2

    def measures(self) -> dict[str, float]:
        """Exact volume and areas of the groups; of a section areas and lengths."""
        a, b = self.inner_radius, self.outer_radius
        if self.part == "octant":
            plane = math.pi / 4 * (b**2 - a**2)
            return {
                "wall": math.pi / 6 * (b**3 - a**3), "inner": math.pi / 2 * a**2,
                "outer": math.pi / 2 * b**2, "x_min": plane, "y_min": plane, "z_min": plane,
            }  # fmt: skip
        angle = math.pi / 2 if self.part == "quarter" else math.pi
        found = {"wall": angle / 2 * (b**2 - a**2), "inner": angle * a, "outer": angle * b}
        if self.part == "quarter":
            return found | {"axis": b - a, "equator": b - a}
        return found | {"axis": 2 * (b - a)}

    def refine(self, factor: int) -> ThickSphere:
        """The same sphere with all divisions multiplied by ``factor``."""
        k = _check.count("ThickSphere.refine", "factor", factor)
        return replace(self, radial=k * self.radial, around=k * self.around)

    def mesh(self) -> StructuredMesh:
        """Nodes, cells and named parts as plain arrays."""
        mesh = self._octant() if self.part == "octant" else self._section()
        mesh.add_region("wall", np.arange(len(mesh.cells)))
        return mesh

    def _radii(self) -> np.ndarray:
        ends = np.linspace(self.inner_radius, self.outer_radius, self.radial + 1)
        return lattice_points(ends, self.order)

    def _section(self) -> StructuredMesh:
        quarters = 1 if self.part == "quarter" else 2
        around = quarters * self.around
        start = 0.0 if quarters == 1 else -math.pi / 2
        angles = lattice_points(np.linspace(start, math.pi / 2, around + 1), self.order)
        radii = self._radii()
        (i, j), (node_i, node_j) = block((self.radial, around), self.order)
        # cos of a right angle is not 0 by rounding, but nodes on the axis must lie there
        cosines = np.where(np.isclose(np.abs(angles), math.pi / 2), 0.0, np.cos(angles))
        points = np.zeros((len(radii), len(angles), 3))
        points[..., 0] = radii[:, None] * cosines
        points[..., 1] = radii[:, None] * np.sin(angles)
        mesh = StructuredMesh(points.reshape(-1, 3), node_i * len(angles) + node_j)
        mesh.add_facets("inner", i == 0, 0, 0)
        mesh.add_facets("outer", i == self.radial - 1, 0, 1)
        mesh.add_facets("axis", j == around - 1, 1, 1)
        mesh.add_facets("equator" if quarters == 1 else "axis", j == 0, 1, 0)
        return mesh

    def _octant(self) -> StructuredMesh:
        """Three blocks, one about each axis, that meet along the line x = y = z."""
        half = self.around // 2
        cell, node = block((half, half, self.radial), self.order)
        share = lattice_points(np.linspace(0.0, 1.0, half + 1), self.order)
        radii = self._radii()
        shape = (len(share), len(share), len(radii))
        numbers = np.ravel_multi_index(node, shape)
        size = math.prod(shape)
        # Each block is a map of a square: two angles from its axis, up to 45 degrees.
        s, t = np.meshgrid(np.tan(share * math.pi / 4), np.tan(share * math.pi / 4), indexing="ij")
        ray = np.stack([s, t, np.ones_like(s)], axis=-1)
        ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
        whole = (ray[:, :, None, :] * radii[None, None, :, None]).reshape(-1, 3)
        turns = ((0, 1, 2), (1, 2, 0), (2, 0, 1))
        points = np.concatenate([whole[:, np.argsort(turn)] for turn in turns])
        cells = np.concatenate([numbers + k * size for k in range(3)])
        keys = np.round(points / (1e-9 * self.outer_radius)).astype(np.int64)
        _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        mesh = StructuredMesh(points[first], inverse.ravel()[cells])
        i, j, k = (np.tile(c, 3) for c in cell)
        number = np.repeat(np.arange(3), len(cell[0]))
        mesh.add_facets("inner", k == 0, 2, 0)
        mesh.add_facets("outer", k == self.radial - 1, 2, 1)
        for axis, name in enumerate(("x_min", "y_min", "z_min")):
            for b, turn in enumerate(turns):
                for direction, index in ((0, i), (1, j)):
                    if turn[direction] == axis:
                        mesh.add_facets(name, (number == b) & (index == 0), direction, 0)
        return mesh
