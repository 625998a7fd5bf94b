"""Supports: what holds a device at every load."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dea_fenicsx.scene.condition import OnSurface, Setting, Support, check_axes
from dea_fenicsx.scene.declarations import Declaration, FixedDisplacement, HeldRigidMotions


@dataclass(frozen=True)
class Fix(OnSurface, Support):
    """No displacement along the named axes (``"x"``, ``"yz"``, ``"rz"``) on a facet group.

    A symmetry plane is a `Fix` along its normal.
    """

    where: str
    axes: str

    def check(self, scene: Setting) -> None:
        super().check(scene)
        check_axes(self, self.axes, scene)

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        return [FixedDisplacement(self.where, axis) for axis in self.axes]


@dataclass(frozen=True)
class Clamp(OnSurface, Support):
    """No displacement at all on a facet group."""

    where: str

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        return [FixedDisplacement(self.where, axis) for axis in scene.kinematics.axes]


@dataclass(frozen=True)
class FreeBody(Support):
    """Removes the rigid motions that the other supports leave to a device, and no more.

    As many displacements of single vertices are held as there are rigid motions left: six of a
    device that nothing else holds in space, three in the plane, one (along the axis) in
    axisymmetry, two (along the axis, and rotation about it) in a helical cell.  Half a device with
    `Fix` on its plane of symmetry keeps two translations and one rotation.

    Under loads that balance one another the reactions vanish and the device deforms as if free.
    Loads whose resultant force lies along a translation that only `FreeBody` prevents are refused.
    """

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        return [HeldRigidMotions()]
