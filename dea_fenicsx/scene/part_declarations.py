"""Declarations about rigid parts: which nodes move as one body, and what turns and loads it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dea_fenicsx.scene.attached import Attached
from dea_fenicsx.scene.declarations import Declaration


@dataclass(frozen=True)
class RigidSurface(Declaration):
    """The nodes of a facet group or a region move as one body.

    Attributes
    ----------
    surface
        Name of the facet group or the region.
    held
        Axes along which its centre does not move.
    turns
        Axes about which it may turn: none, one, or all that the kinematics has.
    along
        The direction along which alone its centre moves, or None.
    across
        The normal of the plane in which its centre moves, or None.
    centre
        The centre in m, one number for each coordinate; None for the mean of its nodes.
    attached
        The body that is attached to it, or None.
    """

    surface: str
    held: str = ""
    turns: str = "z"
    along: tuple[float, ...] | None = None
    across: tuple[float, ...] | None = None
    centre: tuple[float, ...] | None = None
    attached: Attached | None = None

    @property
    def field(self) -> str:
        """Name of the field of its unknowns."""
        return f"rigid {self.surface}"

    @property
    def attached_field(self) -> str:
        """Name of the field of the points that carry the mass of its attached body."""
        return f"attached to {self.surface}"


@dataclass(frozen=True)
class RigidAngle(Declaration):
    """Angle in rad, at ramp factor 1, by which a rigid part is turned; it has no limit.

    `about` is the unit vector of the axis, through the centre of the part.
    """

    surface: str
    radians: float
    ramp: str
    about: tuple[float, ...] = (0.0, 0.0, 1.0)

    def amounts(self) -> Mapping[str, tuple[float, ...]]:
        return {"radians": (self.radians,)}


@dataclass(frozen=True)
class RigidShift(Declaration):
    """Displacement in m along an axis, at ramp factor 1, of the centre of a rigid part."""

    surface: str
    axis: str
    metres: float
    ramp: str

    def amounts(self) -> Mapping[str, tuple[float, ...]]:
        return {"metres": (self.metres,)}


@dataclass(frozen=True)
class RigidMoment(Declaration):
    """Moment in N m on a rigid part at ramp factor 1; its axis `about` is fixed in space."""

    surface: str
    newton_metres: float
    ramp: str
    about: tuple[float, ...] = (0.0, 0.0, 1.0)

    def amounts(self) -> Mapping[str, tuple[float, ...]]:
        return {"newton metres": (self.newton_metres,)}


@dataclass(frozen=True)
class RigidForce(Declaration):
    """Force in N on the centre of a rigid part at ramp factor 1, one number for each axis."""

    surface: str
    newtons: tuple[float, ...]
    ramp: str

    def amounts(self) -> Mapping[str, tuple[float, ...]]:
        return {"newtons": self.newtons}
