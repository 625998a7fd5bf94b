"""Whether a scene's kinematics can show what fibres do."""

from __future__ import annotations

from typing import Any

from dea_fenicsx.materials.base import is_isotropic
from dea_fenicsx.materials.directions import AboutAxis
from dea_fenicsx.scene.condition import Setting
from dea_fenicsx.support.errors import InputError

COMPARED_POINT = (0.6180339887, 0.0, 0.3141592654)
"""Where directions are compared, in units of the device's length; no place of symmetry."""


def check_fibres(scene: Setting) -> None:
    """Raise InputError for fibres whose effect the kinematics leave out."""
    kinematics = scene.kinematics
    what = kinematics.title or type(kinematics).__name__
    place = [scene.device.length * x for x in COMPARED_POINT]
    for name, material in scene.materials.items():
        elastic: Any = material.elastic
        if material.is_air or is_isotropic(elastic):
            continue
        about = [one.direction for one in elastic.fibres if isinstance(one.direction, AboutAxis)]
        if kinematics.axis_of_rotation and any(
            any(d.axis[:2]) or any(d.through[:2]) for d in about
        ):
            raise InputError(
                f"The fibres of region {name!r} have an axis of their own, but in {what} it must "
                "be that of rotation: axis (0, 0, 1) through the origin."
            )
        if kinematics.wrinkles:
            raise InputError(
                f"Region {name!r} has fibres, but a membrane that wrinkles takes an isotropic "
                "rubber; take the membrane without wrinkles, or a mesh in space."
            )
        axis = kinematics.mirrored
        if axis is not None and not elastic.is_mirrored(axis, place):
            raise InputError(
                f"The fibres of region {name!r} lie oblique to the symmetry of {what} and would "
                "move the body out of it; add the mirrored family, or take Helical(pitch=0) or "
                "ThreeD()."
            )
