"""Whether what a scene has is modelled at its temperatures."""

from __future__ import annotations

from collections.abc import Sequence

from dea_fenicsx.scene.condition import Setting
from dea_fenicsx.scene.declarations import HeatedRegions
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import finite


def heated_regions(scene: Setting, heated: Sequence[HeatedRegions]) -> tuple[str, ...]:
    """Regions whose temperature is not the reference of their material at all loads."""
    moved = {name for one in heated for name in one.regions}
    at_first = scene.temperature
    return tuple(
        name for name, m in scene.materials.items() if m.thermal is not None
        and (name in moved or at_first not in (None, m.thermal.reference))
    )  # fmt: skip


def check_temperatures(scene: Setting, heated: Sequence[HeatedRegions], leaks: bool) -> None:
    """Check the temperature of a scene against its materials and what is modelled of them.

    `heated` are the regions that ramps heat, and `leaks` says whether charge leaks or relaxes.
    """
    names = [name for one in heated for name in one.regions]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"Region {name!r} is given two temperatures; give it one.")
    if scene.temperature is not None:
        finite(scene.temperature, "The temperature of the scene")
    for name, material in scene.materials.items():
        if material.thermal is None:
            continue
        if scene.temperature is not None:
            material.thermal.check(scene.temperature, f"The temperature of {name!r} in the scene")
        if name in heated_regions(scene, heated):
            _check_modelled(scene, name, leaks)


def _check_modelled(scene: Setting, name: str, leaks: bool) -> None:
    """Check that what a region has is modelled at a temperature that is not the reference."""
    material = scene.materials[name]
    thermal = material.thermal
    assert thermal is not None
    what = ""
    if scene.kinematics.is_membrane:
        what = "a membrane"
    elif any(branch.changes_by_points for branch in material.viscous):
        what = "a ViscousBranch"
    elif leaks and thermal.permittivity is not None and material.is_dielectric:
        what = "a permittivity that changes with temperature beside charge that leaks or relaxes"
    if what:
        raise InputError(
            f"Region {name!r} has a temperature, but {what} takes none in a scene; give the region "
            "the material at one temperature, material.at(kelvin)."
        )
