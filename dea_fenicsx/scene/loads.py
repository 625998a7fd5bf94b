"""Loads: forces, torques, tractions and pressures that a ramp drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dea_fenicsx.scene.condition import Load, OnSurface, Setting, check_global
from dea_fenicsx.scene.declarations import (
    ELONGATION,
    TWIST,
    DeadNormalPressure,
    DeadTraction,
    Declaration,
    FollowingPressure,
    GlobalForce,
)
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import finite


@dataclass(frozen=True)
@in_si(pascal="Pa")
class DeadLoad(OnSurface, Load):
    """Nominal traction on a facet group: force per undeformed area, fixed in direction.

    Parameters
    ----------
    where
        Name of a facet group.
    pascal
        Components of the traction in Pa at ramp factor 1, one for each axis.
    """

    where: str
    pascal: tuple[float, ...]
    ramp: str = "load"

    def check(self, scene: Setting) -> None:
        super().check(scene)
        axes = scene.kinematics.axes
        if len(self.pascal) != len(axes):
            raise InputError(
                f"The dead load on {self.where!r} has {len(self.pascal)} components, but must "
                f"have {len(axes)}: one for each of {', '.join(axes)}."
            )
        for value in self.pascal:
            finite(value, f"The dead load on {self.where!r}")

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        return [DeadTraction(self.where, self.ramp, self.pascal)]


@dataclass(frozen=True)
@in_si(pascal="Pa")
class _Pressure(OnSurface, Load):
    """A pressure on a facet group, which presses on the material that it acts on.

    On a surface inside the device the region on which it presses may have to be named.
    """

    where: str
    pascal: float
    on: str | None = None
    ramp: str = "load"

    @property
    def region_names(self) -> tuple[str, ...]:
        return () if self.on is None else (self.on,)

    def check(self, scene: Setting) -> None:
        super().check(scene)
        finite(self.pascal, f"The pressure on {self.where!r}")


@dataclass(frozen=True)
class DeadPressure(_Pressure):
    """Nominal pressure along the undeformed normal, pressing on the material it acts on.

    On a surface inside the device, between an electrode layer and a dielectric, it presses on the
    dielectric: this is how a given Maxwell pressure is applied without solving for the field.

    Parameters
    ----------
    where
        Name of a facet group.
    pascal
        Pressure in Pa at ramp factor 1.
    on
        Name of the region it presses on, needed for a surface inside the device unless one side
        of it alone is dielectric.
    """

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        return [DeadNormalPressure(self.where, self.ramp, self.pascal, self.on)]


@dataclass(frozen=True)
class FollowerPressure(_Pressure):
    """True pressure: force per deformed area, along the deformed normal, pressing on the body.

    Negative values pull, so that on the side of a homogeneous film it is a true stress.  Its
    stiffness is part of the tangent, which is not symmetric unless the surface is closed or held at
    its edge; the inertia then counts for the symmetric part only.

    Parameters
    ----------
    where
        Name of a facet group.
    pascal
        Pressure in Pa at ramp factor 1.
    on
        Name of the region it presses on, needed for a surface inside the device unless one side
        of it alone is dielectric.
    """

    def check(self, scene: Setting) -> None:
        super().check(scene)
        if scene.kinematics.global_unknowns:
            raise InputError(
                f"FollowerPressure on {self.where!r} is not available in "
                f"{scene.kinematics.title}; use DeadPressure."
            )

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        return [FollowingPressure(self.where, self.ramp, self.pascal, self.on)]


@dataclass(frozen=True)
@in_si(newtons="N")
class AxialForce(Load):
    """Force along the axis on a device of which a helical cell is a part, in N; tension is > 0.

    The same force goes through every turn.
    """

    newtons: float
    ramp: str = "load"

    def check(self, scene: Setting) -> None:
        check_global(scene, ELONGATION, self)
        finite(self.newtons, "The axial force")

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        return [GlobalForce(ELONGATION, self.newtons, self.ramp)]


@dataclass(frozen=True)
@in_si(newton_metres="N*m")
class Torque(Load):
    """Torque about the axis on a device of which a helical cell is a part, in N m."""

    newton_metres: float
    ramp: str = "load"

    def check(self, scene: Setting) -> None:
        check_global(scene, TWIST, self)
        finite(self.newton_metres, "The torque")

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        return [GlobalForce(TWIST, self.newton_metres, self.ramp)]
