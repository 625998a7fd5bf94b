"""The surface of an eighth of a sphere in space, for a balloon as a membrane."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import in_si

from . import _check
from ._structured import StructuredMesh, compact
from .base import Geometry
from .hollow_sphere import HollowSphere


@dataclass(frozen=True)
@in_si(radius="m")
class Balloon(Geometry):
    """The eighth of a sphere about the origin with x, y, z >= 0, as a surface in space.

    Parameters
    ----------
    radius
        In metres.
    cells
        Cells from one plane of symmetry to the next, an even number.

    Notes
    -----
    Surface group: ``film``.  Groups of lines: ``x_min``, ``y_min``, ``z_min``.

    Raises
    ------
    InputError
        A parameter is not usable.
    """

    radius: float
    cells: int = 4

    def __post_init__(self) -> None:
        _check.length("Balloon", "radius", self.radius)
        _check.count("Balloon", "cells", self.cells)
        if self.cells % 2:
            raise InputError(f"Balloon: cells is {self.cells}; it must be even.")

    def measures(self) -> dict[str, float]:
        """Exact area of the surface and length of its edges."""
        edge = math.pi / 2 * self.radius
        area = math.pi / 2 * self.radius**2
        return {"film": area, "x_min": edge, "y_min": edge, "z_min": edge}

    def refine(self, factor: int) -> Balloon:
        """The same surface with its division multiplied by ``factor``."""
        k = _check.count("Balloon.refine", "factor", factor)
        return replace(self, cells=k * self.cells)

    def mesh(self) -> StructuredMesh:
        """Nodes, cells and named parts as plain arrays."""
        wall = HollowSphere(self.radius, 2 * self.radius, "octant", 1, self.cells, 2).mesh()
        cells, used = compact(wall.facets["inner"])
        mesh = StructuredMesh(wall.points[used], cells)
        mesh.add_region("film", np.ones(len(cells), dtype=bool))
        room = 1e-9 * self.radius
        for axis, name in enumerate(("x_min", "y_min", "z_min")):
            for side in (0, 1):
                for end in (0, 1):
                    edge = np.take(cells, -1 if end else 0, axis=side + 1)
                    flat = np.all(np.abs(mesh.points[edge][:, :, axis]) < room, axis=1)
                    mesh.add_facets(name, flat, axis=side, end=end)
        return mesh
