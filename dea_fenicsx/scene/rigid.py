"""Rigid parts in the plane: a surface that moves as one body, and what turns it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dea_fenicsx.scene.condition import (
    Load,
    OnSurface,
    Prescribed,
    Setting,
    Support,
    Told,
    of_kind,
)
from dea_fenicsx.scene.declarations import (
    Declaration,
    HeldRigidMotions,
    RigidAngle,
    RigidMoment,
    RigidSurface,
)
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import finite


@dataclass(frozen=True)
class Rigid(OnSurface, Support):
    """A facet group whose nodes move as one body, by any angle.  Plane kinematics only.

    Its translation and its angle are unknowns.  It may be turned by `Turn` and loaded by `Moment`,
    and by any other load on its surface.

    Parameters
    ----------
    where
        Name of a facet group, no node of which is held or moved by anything else.
    held
        Axes along which its middle, the mean of its nodes, does not move, such as ``"xy"``.
    """

    where: str
    held: str = ""

    def check(self, scene: Setting) -> None:
        super().check(scene)
        axes = tuple(scene.kinematics.axes)
        if axes != ("x", "y") or scene.kinematics.dim != 2:
            raise InputError(
                f"Rigid on {self.where!r} needs PlaneStrain(depth) or GeneralisedPlaneStrain(depth)"
                f", but the kinematics is {type(scene.kinematics).__name__}; leave it out."
            )
        if any(axis not in axes for axis in self.held):
            raise InputError(
                f"Rigid on {self.where!r} is held along {self.held!r}, but must be held along "
                f"none or some of {', '.join(axes)}."
            )

    def check_beside(self, told: Told) -> None:
        if of_kind(told, HeldRigidMotions):
            raise InputError(
                f"Rigid on {self.where!r} and FreeBody() do not go together; hold the rigid part, "
                'as in Rigid(..., held="xy"), or another surface.'
            )
        if len(_on(self.where, told, RigidSurface)) > 1:
            raise InputError(f"{self.where!r} is rigid twice; name it once.")

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        return [RigidSurface(self.where, self.held)]


@dataclass(frozen=True)
@in_si(radians="rad")
class Turn(OnSurface, Prescribed):
    """Angle of a rigid part in rad at ramp factor 1, counter-clockwise; several turns count."""

    where: str
    radians: float
    ramp: str = "turn"

    def check(self, scene: Setting) -> None:
        super().check(scene)
        finite(self.radians, f"The angle of {self.where!r}")

    def check_beside(self, told: Told) -> None:
        _check_part(self, self.where, told)
        if len(_on(self.where, told, RigidAngle)) > 1:
            raise InputError(f"{self.where!r} is turned twice; give one angle.")

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        return [RigidAngle(self.where, self.radians, self.ramp)]


@dataclass(frozen=True)
@in_si(newton_metres="N*m")
class Moment(OnSurface, Load):
    """Moment on a rigid part in N m at ramp factor 1, counter-clockwise."""

    where: str
    newton_metres: float
    ramp: str = "load"

    def check(self, scene: Setting) -> None:
        super().check(scene)
        finite(self.newton_metres, f"The moment on {self.where!r}")

    def check_beside(self, told: Told) -> None:
        _check_part(self, self.where, told)
        if _on(self.where, told, RigidAngle):
            raise InputError(
                f"The moment on {self.where!r} has no effect, since its angle is prescribed; "
                "leave one of the two out."
            )

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        return [RigidMoment(self.where, self.newton_metres, self.ramp)]


def _on[T: RigidSurface | RigidAngle](where: str, told: Told, kind: type[T]) -> list[T]:
    """The declarations of a kind that are about one facet group."""
    return [one for _, one in of_kind(told, kind) if one.surface == where]


def _check_part(item: Turn | Moment, where: str, told: Told) -> None:
    if not _on(where, told, RigidSurface):
        raise InputError(
            f"{type(item).__name__} on {where!r} needs a rigid part; add Rigid({where!r}) to the "
            "supports."
        )
