"""The meridian of an axisymmetric membrane: a straight line or an arc in the (r, z) plane."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si

from . import _check
from ._structured import Floats, StructuredMesh, block, lattice_points
from .base import Geometry
from .grading import graded

RADIUS_TOLERANCE = 1e-9
"""Largest difference of the radii of an arc's two ends, as a share of them."""


@dataclass(frozen=True)
@in_si(start="m", end="m", centre="m")
class Meridian(Geometry):
    """A line in the (r, z) plane; turned about the axis r = 0 it is a disc, a cone or a balloon.

    Parameters
    ----------
    start, end
        Coordinates (r, z) of its two ends in metres, with r >= 0.
    centre
        Centre (r, z) of the circle of which it is an arc, the shorter one between the two ends; a
        straight line without one.  A half circle has no shorter side: give it as two quarters.
    cells
        Cells from the start to the end.
    grading
        Largest over smallest cell; the smallest lie at the start.

    Notes
    -----
    Line group: ``film``.  Groups of single points: ``start``, ``end``.

    Raises
    ------
    InputError
        A parameter is not usable.
    """

    start: tuple[float, float]
    end: tuple[float, float]
    centre: tuple[float, float] | None = None
    cells: int = 16
    grading: float = 1.0

    def __post_init__(self) -> None:
        owner = "Meridian"
        for name in ("start", "end", "centre"):
            self._check_point(name)
        _check.count(owner, "cells", self.cells)
        _check.ratio(owner, "grading", self.grading)
        if self.start[0] < 0 or self.end[0] < 0:
            raise InputError(
                f"{owner}: an end lies at r = {min(self.start[0], self.end[0]):g} m, but the "
                "radius must be >= 0."
            )
        if math.dist(self.start, self.end) == 0:
            raise InputError(f"{owner}: start and end are the same point; give two points.")
        if self.centre is None:
            return
        one, two = math.dist(self.start, self.centre), math.dist(self.end, self.centre)
        if abs(one - two) > RADIUS_TOLERANCE * max(one, two):
            raise InputError(
                f"{owner}: the ends are {one:g} m and {two:g} m away from the centre, but must be "
                "equally far from it."
            )
        if math.pi - abs(self._angles()[1]) < 1e-6:
            raise InputError(
                f"{owner}: the ends lie on a diameter, so that the arc has no shorter side; give "
                "an arc of less than half a circle."
            )

    def _check_point(self, name: str) -> None:
        point = getattr(self, name)
        if point is None and name == "centre":
            return
        try:
            r, z = point
        except (TypeError, ValueError):
            raise InputError(
                f"Meridian: {name} is {shown(point)}; it must be two numbers, (r, z) in metres."
            ) from None
        _check.number("Meridian", name, r)
        _check.number("Meridian", name, z)

    def _angles(self) -> tuple[float, float]:
        """Angle of the start about the centre, and the angle from it to the end."""
        assert self.centre is not None
        a, b = (
            math.atan2(z - self.centre[1], r - self.centre[0]) for r, z in (self.start, self.end)
        )
        return a, (b - a + math.pi) % (2 * math.pi) - math.pi

    @property
    def dimension(self) -> int:
        """2: the line lies in a plane."""
        return 2

    def measures(self) -> dict[str, float]:
        """Exact length of the line; its ends are points and have none."""
        if self.centre is None:
            return {"film": math.dist(self.start, self.end)}
        return {"film": abs(self._angles()[1]) * math.dist(self.start, self.centre)}

    def refine(self, factor: int) -> Meridian:
        """The same line with its division multiplied by ``factor``."""
        k = _check.count("Meridian.refine", "factor", factor)
        return replace(self, cells=k * self.cells)

    def mesh(self) -> StructuredMesh:
        """Nodes, cells and named parts as plain arrays."""
        return self.mesh_of_order(2)

    def mesh_of_order(self, order: int) -> StructuredMesh:
        """The same with cells of a given degree."""
        share = lattice_points(graded(self.cells, self.grading, "start"), order)
        cell, node = block((self.cells,), order)
        points = np.zeros((len(share), 3))
        points[:, :2] = self._places(share)
        mesh = StructuredMesh(points, node[0])
        mesh.add_region("film", cell[0] >= 0)
        mesh.add_facets("start", cell[0] == 0, axis=0, end=0)
        mesh.add_facets("end", cell[0] == self.cells - 1, axis=0, end=1)
        return mesh

    def _places(self, share: Floats) -> Floats:
        """(r, z) at shares of the length, shape (n, 2); the ends are exact."""
        start, end = np.array(self.start), np.array(self.end)
        if self.centre is None:
            return start + share[:, None] * (end - start)
        first, turn = self._angles()
        angles = first + share * turn
        circle = np.column_stack([np.cos(angles), np.sin(angles)])
        found = np.array(self.centre) + math.dist(self.start, self.centre) * circle
        found[0], found[-1] = start, end
        return found
