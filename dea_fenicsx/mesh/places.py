"""Places at which facets of a mesh are named: planes, boxes, cylinders, and functions.

A place judges the midpoints of facets.  Places are combined by ``&`` (both), ``|`` (either) and
``~`` (not).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import finite, is_finite, one_of, positive

PLACE_TOLERANCE = 1e-6
"""Distance that counts as rounding, as a share of the device's largest extent."""


class Place(ABC):
    """Where facets are named, judged by their midpoints.

    The axes x, y and z are the first, second and third coordinate of the mesh: r is x and z is y in
    an axisymmetric mesh.
    """

    @abstractmethod
    def check(self, dim: int) -> None:
        """Raise InputError unless the place makes sense for a mesh of a dimension."""

    @abstractmethod
    def holds(self, x: np.ndarray, size: float) -> np.ndarray:
        """Which midpoints lie there.

        Parameters
        ----------
        x
            Midpoints in m, shape (3, n); coordinates that the mesh does not have are 0.
        size
            The largest extent of the device in m.

        Returns
        -------
        ndarray of bool, shape (n,)
        """

    def __and__(self, other: Place) -> Place:
        return Both(self, other)

    def __or__(self, other: Place) -> Place:
        return Either(self, other)

    def __invert__(self) -> Place:
        return Outside(self)


class PlaceNear(Place):
    """A place at a distance of 0 from something, up to a tolerance."""

    tolerance: float | None

    @abstractmethod
    def distance(self, x: np.ndarray) -> np.ndarray:
        """Distance of points from it in m, shape (n,)."""

    def holds(self, x: np.ndarray, size: float) -> np.ndarray:
        tolerance = PLACE_TOLERANCE * size if self.tolerance is None else self.tolerance
        return self.distance(x) <= tolerance

    def check(self, dim: int) -> None:
        if self.tolerance is not None:
            positive(self.tolerance, f"The tolerance of {type(self).__name__}", "a length > 0 in m")


@dataclass(frozen=True)
@in_si(at="m", tolerance="m")
class OnPlane(PlaceNear):
    """On a plane that is normal to an axis.

    Parameters
    ----------
    axis
        ``"x"``, ``"y"`` or ``"z"``: the first, second or third coordinate of the mesh.
    at
        Its coordinate in m.
    tolerance
        Largest distance in m; a millionth of the device's extent unless given.
    """

    axis: str
    at: float
    tolerance: float | None = None

    def check(self, dim: int) -> None:
        super().check(dim)
        one_of(self.axis, "xyz"[:dim], "The axis of OnPlane")
        finite(self.at, "The coordinate of OnPlane (at=)")

    def distance(self, x: np.ndarray) -> np.ndarray:
        return np.abs(x["xyz".index(self.axis)] - self.at)


@dataclass(frozen=True)
@in_si(radius="m", tolerance="m", through="m")
class OnCylinder(PlaceNear):
    """On the side of a circular cylinder along an axis; in the plane on a circle.

    Where cells have straight edges, midpoints of facets lie inside of the circle by about an eighth
    of the squared length of an edge over the radius; then give a tolerance.

    Parameters
    ----------
    radius
        Radius in m.
    axis
        Axis of the cylinder, ``"x"``, ``"y"`` or ``"z"``; in the plane ``"z"``.
    through
        A point of the axis in m.
    tolerance
        Largest distance in m; a millionth of the device's extent unless given.
    """

    radius: float
    axis: str = "z"
    through: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tolerance: float | None = None

    def check(self, dim: int) -> None:
        super().check(dim)
        _check_cylinder(self, dim)

    def distance(self, x: np.ndarray) -> np.ndarray:
        return np.abs(_from_axis(self, x) - self.radius)


@dataclass(frozen=True)
@in_si(radius="m", through="m")
class InCylinder(Place):
    """Within a circular cylinder along an axis; in the plane within a circle.

    Parameters
    ----------
    radius, axis, through
        As of `OnCylinder`.
    """

    radius: float
    axis: str = "z"
    through: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def check(self, dim: int) -> None:
        _check_cylinder(self, dim)

    def holds(self, x: np.ndarray, size: float) -> np.ndarray:
        return _from_axis(self, x) <= self.radius + PLACE_TOLERANCE * size


@dataclass(frozen=True)
@in_si(low="m", high="m")
class InBox(Place):
    """Within a box along the axes, its sides included.

    Parameters
    ----------
    low, high
        Least and largest coordinates in m, one for each of the mesh's; ``-math.inf`` and
        ``math.inf`` leave a side open.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]

    def check(self, dim: int) -> None:
        for name, corner in (("low", self.low), ("high", self.high)):
            if len(corner) != dim or any(np.isnan(c) for c in corner):
                raise InputError(
                    f"The corner {name} of InBox is {shown(corner)}, but must be {dim} coordinates "
                    "in m, one for each of the mesh's."
                )
        if any(a > b for a, b in zip(self.low, self.high, strict=True)):
            raise InputError(
                f"InBox reaches from {shown(self.low)} to {shown(self.high)}; the first corner "
                "(low) must have the smaller coordinates."
            )

    def holds(self, x: np.ndarray, size: float) -> np.ndarray:
        dim, margin = len(self.low), PLACE_TOLERANCE * size
        above = x[:dim] >= np.array(self.low)[:, None] - margin
        below = x[:dim] <= np.array(self.high)[:, None] + margin
        return np.asarray(np.all(above & below, axis=0))


@dataclass(frozen=True)
class Interior:
    """Facets inside of the body instead of those on its boundary.

    Parameters
    ----------
    where
        A place or a function, as for facets on the boundary; None for everywhere.
    between
        Two regions whose common facets alone are taken; None for all facets that two cells share.
    """

    where: Place | Callable[[np.ndarray], np.ndarray] | None = None
    between: tuple[str, str] | None = None

    def check(self) -> None:
        """Raise InputError unless its place is one."""
        if self.where is not None and not judges(self.where):
            raise InputError(
                f"The place of Interior (where=) is {shown(self.where)}, but must be a place such "
                "as OnPlane, a function of midpoints, or None."
            )


def judges(value: Any) -> bool:
    """Whether a value judges midpoints of facets: a place or a function does, a class does not."""
    return isinstance(value, Place) or (callable(value) and not isinstance(value, type))


@dataclass(frozen=True)
class Both(Place):
    """In two places at once: ``first & second``."""

    first: Place
    second: Place

    def check(self, dim: int) -> None:
        _check_parts(dim, self.first, self.second)

    def holds(self, x: np.ndarray, size: float) -> np.ndarray:
        return self.first.holds(x, size) & self.second.holds(x, size)


@dataclass(frozen=True)
class Either(Place):
    """In one of two places or in both: ``first | second``."""

    first: Place
    second: Place

    def check(self, dim: int) -> None:
        _check_parts(dim, self.first, self.second)

    def holds(self, x: np.ndarray, size: float) -> np.ndarray:
        return self.first.holds(x, size) | self.second.holds(x, size)


@dataclass(frozen=True)
class Outside(Place):
    """Not in a place: ``~place``."""

    place: Place

    def check(self, dim: int) -> None:
        _check_parts(dim, self.place)

    def holds(self, x: np.ndarray, size: float) -> np.ndarray:
        return ~self.place.holds(x, size)


def _check_parts(dim: int, *parts: Place) -> None:
    for part in parts:
        if not isinstance(part, Place):
            raise InputError(
                f"A place is combined with {shown(part)}, but must be combined with a place such "
                "as OnPlane, InBox, OnCylinder or InCylinder."
            )
        part.check(dim)


def _check_cylinder(item: OnCylinder | InCylinder, dim: int) -> None:
    name = type(item).__name__
    positive(item.radius, f"The radius of {name}", "a length > 0 in m")
    one_of(item.axis, "xyz" if dim == 3 else "z", f"The axis of {name}")
    if len(item.through) != 3 or not all(map(is_finite, item.through)):
        raise InputError(
            f"The point of {name} (through=) is {shown(item.through)}, but must be three finite "
            "coordinates in m."
        )


def _from_axis(item: OnCylinder | InCylinder, x: np.ndarray) -> np.ndarray:
    """Distance of points from the axis of a cylinder in m, shape (n,)."""
    across = [k for k, axis in enumerate("xyz") if axis != item.axis]
    offset: Sequence[np.ndarray] = [x[k] - item.through[k] for k in across]
    return np.asarray(np.hypot(*offset))
