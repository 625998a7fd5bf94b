"""What an obstacle declares: a facet group that touches it from one side."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import ufl

from dea_fenicsx.scene.declarations import Declaration
from dea_fenicsx.scene.shapes import Cylinder, Plane, Shape, Sphere


@dataclass(frozen=True)
class UnilateralContact(Declaration):
    """A facet group has a gap g >= 0 to an obstacle, and a pressure p >= 0 where it touches it.

    Attributes
    ----------
    surface
        Name of the facet group.
    shape
        The shape of the obstacle in space, or a function that gives the gap.
    along
        Which components of a place in space a function takes.
    travel
        Displacement of the obstacle in m at ramp factor 1, in space.
    ramp
        Name of the ramp, or None for an obstacle that does not move.
    tolerance, friction
        As of `Obstacle`.
    carrier
        Name of the rigid part with which the obstacle moves, or None.
    """

    surface: str
    shape: Shape
    along: tuple[int, ...]
    travel: tuple[float, ...]
    ramp: str | None
    tolerance: float | None
    friction: float = 0.0
    carrier: str | None = None

    def amounts(self) -> Mapping[str, tuple[float, ...]]:
        return {"metres": self.travel} if self.ramp else {}

    @property
    def lies_between(self) -> bool:
        """Whether other parts of the device may lie behind it."""
        return isinstance(self.shape, Plane) and self.shape.between

    def gap(self, place: Any, number: Callable[[float], Any] = float) -> Any:
        """The gap in m between the undisplaced obstacle and a place in space in m, a UFL vector.

        Numbers of the shape are given to the form by `number`.
        """
        shape = self.shape
        if isinstance(shape, Plane | Sphere | Cylinder):
            return shape.gap(place, number)
        return ufl.as_ufl(shape(ufl.as_vector([place[i] for i in self.along])))

    @property
    def centre(self) -> tuple[float, ...] | None:
        """A point in m that lies deep in the obstacle, or None where none is known."""
        shape = self.shape
        if isinstance(shape, Sphere | Cylinder) and not shape.hollow:
            return shape.point
        return None
