"""Body forces: weight, a given force per volume, and the centrifugal force."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import ufl

from dea_fenicsx.scene.condition import InRegions, Load, Setting, Told
from dea_fenicsx.scene.declarations import Declaration
from dea_fenicsx.scene.part_declarations import RigidSurface
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import finite


class BodyFields(Protocol):
    """The symbolic fields in a body, in which the virtual work of a body force is written.

    Attributes
    ----------
    virtual
        Virtual displacement, in the components of u.
    place
        Present place in units of the device's length, in the components of u.
    length
        The unit of length in m.
    mass
        Density times the unit of length over that of stress, in s^2/m^2 by volume: an acceleration
        in m/s^2 times it is a force per volume, dimensionless.
    """

    @property
    def virtual(self) -> Any: ...
    @property
    def place(self) -> Any: ...
    @property
    def length(self) -> float: ...
    @property
    def mass(self) -> Any: ...

    def number(self, value: Any) -> Any:
        """A number, or several, as a constant of the form."""
        ...

    def force(self, newtons_per_cubic_metre: tuple[float, ...], regions: Sequence[str]) -> Any:
        """A force per volume in N/m^3 in some regions, and 0 elsewhere, dimensionless."""
        ...

    def pressure(
        self, pascal: float, away_from: tuple[float, ...], regions: Sequence[str]
    ) -> Any:
        """Virtual work per volume of a pressure in Pa on regions of a membrane, dimensionless.

        It pushes the undeformed film away from a point in m.
        """
        ...


@dataclass(frozen=True)
class BodyWork(Declaration):
    """Virtual work of a body force.

    Attributes
    ----------
    ramp
        Name of the ramp.
    follows
        Whether the force depends on the place.
    """

    ramp: str
    follows: ClassVar[bool] = False

    def density(self, at: BodyFields) -> Any:
        """Virtual work per undeformed volume at ramp factor 1, dimensionless."""
        # The class is no abstract one, for the same reason as `SurfaceWork`.
        raise NotImplementedError(f"{type(self).__name__} must say its density.")


@dataclass(frozen=True)
class WeightWork(BodyWork):
    """Work of an acceleration in m/s^2, one number for each axis."""

    acceleration: tuple[float, ...]

    def amounts(self) -> Mapping[str, tuple[float, ...]]:
        return {"acceleration": self.acceleration}

    def density(self, at: BodyFields) -> Any:
        return at.mass * ufl.dot(at.number(self.acceleration), at.virtual)


@dataclass(frozen=True)
class ForceWork(BodyWork):
    """Work of a force in N/m^3 in regions, one number for each axis."""

    regions: tuple[str, ...]
    newtons: tuple[float, ...]

    def amounts(self) -> Mapping[str, tuple[float, ...]]:
        return {"newtons per cubic metre": self.newtons}

    def density(self, at: BodyFields) -> Any:
        return ufl.dot(at.force(self.newtons, self.regions), at.virtual)


@dataclass(frozen=True)
class CentrifugalWork(BodyWork):
    """Work of the centrifugal force at a speed in rad/s about an axis through a centre in m.

    `across` are the numbers of the components of u that lie across the axis.
    """

    speed: float
    across: tuple[int, ...]
    centre: tuple[float, ...]
    follows = True

    def amounts(self) -> Mapping[str, tuple[float, ...]]:
        return {"square of the speed": (self.speed**2,)}

    def density(self, at: BodyFields) -> Any:
        square = at.number(self.speed**2 * at.length)
        arms = [at.place[a] - at.number(self.centre[a] / at.length) for a in self.across]
        pairs = zip(arms, self.across, strict=True)
        return at.mass * square * sum(arm * at.virtual[a] for arm, a in pairs)


@dataclass(frozen=True)
@in_si(acceleration="m/s**2")
class Gravity(Load):
    """Weight of the whole device: its materials' density times an acceleration.

    Parameters
    ----------
    acceleration
        In m/s^2 at ramp factor 1, one number for each axis, such as ``(0, 0, -9.81)``.
    """

    acceleration: tuple[float, ...]
    ramp: str = "load"

    def check(self, scene: Setting) -> None:
        _check_vector(self, self.acceleration, "acceleration", scene)
        _check_densities(self, scene)

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        return [WeightWork(self.ramp, tuple(map(float, self.acceleration)))]


@dataclass(frozen=True)
@in_si(newtons_per_cubic_metre="N/m**3")
class BodyForce(InRegions, Load):
    """Force per undeformed volume of a region, fixed in direction.

    Parameters
    ----------
    where
        Name of a region, or several names.
    newtons_per_cubic_metre
        Components at ramp factor 1, one for each axis.
    """

    where: str | tuple[str, ...]
    newtons_per_cubic_metre: tuple[float, ...]
    ramp: str = "load"

    def check(self, scene: Setting) -> None:
        super().check(scene)
        self.check_named()
        _check_vector(self, self.newtons_per_cubic_metre, "force", scene)

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        force = tuple(map(float, self.newtons_per_cubic_metre))
        return [ForceWork(self.ramp, tuple(dict.fromkeys(self.names)), force)]


@dataclass(frozen=True)
@in_si(radians_per_second="rad/s", centre="m")
class Centrifugal(Load):
    """Centrifugal force of a device that spins steadily, with its materials' density.

    It is proportional to the present distance from the axis.  A ramp's factor multiplies the force:
    at the factor f the speed is sqrt(f) times `radians_per_second`.

    Parameters
    ----------
    radians_per_second
        Speed at ramp factor 1.
    about
        The axis: ``"x"``, ``"y"`` or ``"z"``; in the plane and in axisymmetry ``"z"``.
    centre
        A point of the axis in m, one number for each axis of the kinematics; the origin by default.
    """

    radians_per_second: float
    ramp: str = "load"
    about: str = "z"
    centre: tuple[float, ...] | None = None

    def check(self, scene: Setting) -> None:
        _check_kinematics(self, scene)
        _check_densities(self, scene)
        finite(self.radians_per_second, "The speed of Centrifugal")
        known_axes = "xyz" if len(scene.kinematics.axes) == 3 else "z"
        if self.about not in tuple(known_axes):
            raise InputError(
                f"Centrifugal is about {self.about!r}, but must be about "
                f"{' or '.join(known_axes)}."
            )
        if self.centre is not None:
            _check_vector(self, self.centre, "centre", scene)

    def check_beside(self, told: Told) -> None:
        for _, one in told:
            if isinstance(one, RigidSurface) and one.attached:
                raise InputError(
                    f"Centrifugal does not act on the body attached to {one.surface!r}; mesh that "
                    "body as a rigid region with a density, or leave kilograms= of Rigid out."
                )

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        axes = scene.kinematics.axes
        across = tuple(a for a, axis in enumerate(axes) if axis != self.about)
        centre = self.centre or (0.0,) * len(axes)
        return [CentrifugalWork(self.ramp, self.radians_per_second, across, centre)]


def _check_kinematics(item: Load, scene: Setting) -> None:
    if scene.kinematics.periodic_ends is not None:
        raise InputError(
            f"{type(item).__name__} is not available in a helical cell, whose turns would bear "
            "different forces; take Axisymmetric() or ThreeD()."
        )


def _check_vector(item: Load, vector: Sequence[float], what: str, scene: Setting) -> None:
    """Raise InputError unless a vector has one finite number for each axis, and none is radial."""
    _check_kinematics(item, scene)
    name, kinematics = type(item).__name__, scene.kinematics
    if len(vector) != len(kinematics.axes):
        raise InputError(
            f"The {what} of {name} has {len(vector)} components, but must have "
            f"{len(kinematics.axes)}: one for each of {', '.join(kinematics.axes)}."
        )
    for value in vector:
        finite(value, f"The {what} of {name}")
    if not kinematics.cartesian and vector[0] and what != "force":
        raise InputError(
            f"The {what} of {name} has a radial component, but an axisymmetric section only knows "
            "one along the axis; give 0 for it."
        )


def _check_densities(item: Load, scene: Setting) -> None:
    for name, material in scene.materials.items():
        if material.density is None and not material.is_air:  # air without one has no weight
            raise InputError(
                f"{type(item).__name__} needs the density of each region, but {name!r} has none; "
                "give Material(..., density=...) in kg/m^3."
            )
