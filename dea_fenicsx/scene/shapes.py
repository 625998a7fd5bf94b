"""Shapes of rigid obstacles: the gap between a point and an obstacle, as a symbolic expression."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import ufl

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import finite, positive

AXIS_TOLERANCE = 1e-9
"""Largest sine of the angle, or relative offset, at which a shape still fits the kinematics."""


@dataclass(frozen=True)
@in_si(point="m", normal="")
class Plane:
    """A half-space; the device is on the side to which the normal points.

    The gap is n . (x - X0)/|n|.

    Parameters
    ----------
    point
        X0 in m, a point of the plane, with one component for each axis of the kinematics.
    normal
        n, the direction from the obstacle to the device, of any length.
    between
        Whether the plane lies between two parts of the device, so that other parts than the surface
        of the obstacle lie behind it.  Two parts that a symmetry of the device takes to each other
        meet at a plane that it takes to itself, such as a plane of symmetry, or one through a
        two-fold axis: each of the two surfaces then gets such an obstacle, with opposite normals.
    """

    point: tuple[float, ...]
    normal: tuple[float, ...]
    between: bool = False

    def check(self) -> None:
        """Raise InputError unless it is a shape."""
        _numbers(self.point, "The point of Plane")
        _direction(self.normal, "The normal of Plane")
        _same_length(self, self.point, self.normal)

    def in_space(self, rotational: bool) -> Plane:
        """The same plane with three components, where it is given with two."""
        point, normal = (_in_space(v, rotational) for v in (self.point, self.normal))
        return replace(self, point=point, normal=normal)

    def gap(self, x: Any, number: Callable[[float], Any]) -> Any:
        """The gap in m at a point x in space in m, symbolic."""
        normal = np.array(self.normal) / np.linalg.norm(self.normal)
        return sum(number(n) * (x[i] - number(self.point[i])) for i, n in enumerate(normal))

    def misfit(self, rotational: bool) -> str | None:
        """Why it does not fit a section, in the plane or `rotational`; None where it fits."""
        if rotational and abs(self.normal[0]) > AXIS_TOLERANCE * np.linalg.norm(self.normal):
            return "a plane of an axisymmetric section has its normal along z"
        return None


@dataclass(frozen=True)
@in_si(centre="m", radius="m")
class Sphere:
    """A ball, or with `hollow` all that is outside of one.  Its gap is |x - C| - R.

    In an axisymmetric section its centre lies on the axis.  In plane kinematics take `Cylinder`.

    Parameters
    ----------
    centre
        C in m.
    radius
        R in m.
    hollow
        Whether the device is inside, so that the gap is R - |x - C|.
    """

    centre: tuple[float, ...]
    radius: float
    hollow: bool = False

    def check(self) -> None:
        """Raise InputError unless it is a shape."""
        _numbers(self.centre, "The centre of Sphere")
        positive(self.radius, "The radius of Sphere", "a length > 0 in m")

    def in_space(self, rotational: bool) -> Sphere:
        """The same ball with three components, where it is given with two."""
        return replace(self, centre=_in_space(self.centre, rotational))

    def gap(self, x: Any, number: Callable[[float], Any]) -> Any:
        """The gap in m at a point x in space in m, symbolic."""
        distance = _length([x[i] - number(c) for i, c in enumerate(self.centre)])
        radius = number(self.radius)
        return radius - distance if self.hollow else distance - radius

    @property
    def point(self) -> tuple[float, ...]:
        """The centre."""
        return self.centre

    def misfit(self, rotational: bool) -> str | None:
        """Why it does not fit a section, in the plane or `rotational`; None where it fits."""
        if not rotational:
            return "a sphere is no obstacle of a plane section; take a Cylinder"
        if abs(self.centre[0]) > AXIS_TOLERANCE * self.radius:
            return "the centre of a sphere lies on the axis r = 0 of an axisymmetric section"
        return None


@dataclass(frozen=True)
@in_si(point="m", radius="m")
class Cylinder:
    """An endless cylinder, or with `hollow` all that is outside of one.

    Its gap is the distance from its axis minus R.  In plane kinematics its axis is normal to the
    plane, in an axisymmetric section and a helical cell it is the axis r = 0.

    Parameters
    ----------
    point
        A point of the axis in m.
    axis
        Direction of the axis, of any length, in space; None in plane and axisymmetric kinematics.
    radius
        R in m.
    hollow
        Whether the device is inside.
    """

    point: tuple[float, ...]
    axis: tuple[float, ...] | None = None
    radius: float = float("nan")  # it must be given: the check refuses what is no number
    hollow: bool = False

    def check(self) -> None:
        """Raise InputError unless it is a shape."""
        _numbers(self.point, "The point of Cylinder")
        positive(self.radius, "The radius of Cylinder", "a length > 0 in m")
        if len(self.point) == 3 and self.axis is None:
            raise InputError("The axis of Cylinder is missing; in space it is a direction.")
        if self.axis is not None:
            _direction(self.axis, "The axis of Cylinder")
            if len(self.axis) != 3:
                raise InputError(
                    f"The axis of Cylinder has {len(self.axis)} components, but must have 3; in "
                    "plane and axisymmetric kinematics it is None."
                )

    def in_space(self, rotational: bool) -> Cylinder:
        """The same cylinder with three components, where it is given with two."""
        if len(self.point) == 3:
            return self
        return replace(self, point=_in_space(self.point, rotational), axis=(0.0, 0.0, 1.0))

    def gap(self, x: Any, number: Callable[[float], Any]) -> Any:
        """The gap in m at a point x in space in m, symbolic."""
        assert self.axis is not None
        along = np.array(self.axis) / np.linalg.norm(self.axis)
        offset = [x[i] - number(c) for i, c in enumerate(self.point)]
        if np.count_nonzero(along) == 1:
            # Along an axis of coordinates fewer terms are left.
            across = [d for d, a in zip(offset, along, strict=True) if not a]
        else:
            axis = [number(a) for a in along]
            rise = sum(a * d for a, d in zip(axis, offset, strict=True))
            across = [d - a * rise for a, d in zip(axis, offset, strict=True)]
        distance, radius = _length(across), number(self.radius)
        return radius - distance if self.hollow else distance - radius

    def misfit(self, rotational: bool) -> str | None:
        """Why it does not fit a section, in the plane or `rotational`; None where it fits."""
        axis = self.axis
        if axis is not None and (
            np.linalg.norm(axis[:2]) > AXIS_TOLERANCE * np.linalg.norm(axis)
        ):
            return "the axis of a cylinder is that of the third direction there; give None"
        if rotational and abs(self.point[0]) > AXIS_TOLERANCE * self.radius:
            return "the axis of a cylinder is r = 0 there"
        return None


type Shape = Plane | Sphere | Cylinder | Callable[[Any], Any]


def _in_space(values: tuple[float, ...], rotational: bool) -> tuple[float, ...]:
    """Two components of a plane section, or of an axisymmetric one, as three in space."""
    if len(values) == 3:
        return values
    return (values[0], 0.0, values[1]) if rotational else (values[0], values[1], 0.0)


def _length(components: list[Any]) -> Any:
    return ufl.sqrt(sum(c**2 for c in components))


def _numbers(values: tuple[float, ...], what: str) -> None:
    for value in values:
        finite(value, what)


def _direction(values: tuple[float, ...], what: str) -> None:
    _numbers(values, what)
    if not np.linalg.norm(values) > 0:
        raise InputError(f"{what} is {values!r}, but must have a direction.")


def _same_length(shape: object, first: tuple[float, ...], second: tuple[float, ...]) -> None:
    if len(first) != len(second):
        raise InputError(
            f"{type(shape).__name__} has {len(first)} and {len(second)} components, but must have "
            "the same number of both."
        )
