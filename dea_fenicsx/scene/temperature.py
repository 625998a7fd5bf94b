"""The temperature of a device: that at first, and regions that a ramp heats or cools."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from dea_fenicsx.scene.condition import InRegions, Prescribed, Setting
from dea_fenicsx.scene.declarations import Declaration, HeatedRegions
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import finite

if TYPE_CHECKING:
    from dea_fenicsx.scene.scene import Scene


@dataclass(frozen=True)
@in_si(kelvin="K")
class Temperature(InRegions, Prescribed):
    """The temperature of a region, which its ramp brings from that at first to a given one.

    At ramp factor t the temperature is T_0 + t (kelvin - T_0), with the temperature T_0 of
    ``Scene(temperature=...)``, or the reference of the material where the scene tells none.  Nothing
    conducts heat: the temperature is what is given.  The mesh shows the body at T_0.

    Parameters
    ----------
    where
        Name of a region whose material is given `thermal`, or several names.
    kelvin
        Temperature in K at factor 1: a number, or a function of the position in m, a UFL vector,
        that is written with the functions of ufl.
    """

    where: str | tuple[str, ...]
    kelvin: float | Callable[[Any], Any]
    ramp: str = "temperature"

    def check(self, scene: Setting) -> None:
        self.check_named()
        super().check(scene)
        label = "+".join(self.names)
        for name in self.names:
            thermal = scene.materials[name].thermal
            if thermal is None:
                raise InputError(
                    f"Region {name!r} is given a temperature, but its material does not change "
                    "with it; give the material thermal=Thermal(...)."
                )
            if not callable(self.kelvin):
                finite(self.kelvin, f"The temperature of {label!r}")
                thermal.check(self.kelvin, f"The temperature of {name!r}")
        others = (*scene.prescribed, *scene.loads, *scene.supports)
        if any(item is not self and item.moved_by == self.ramp
               and not isinstance(item, Temperature) for item in others):  # fmt: skip
            raise InputError(
                f"The temperature of {label!r} and another condition share the ramp "
                f"{self.ramp!r}; give them two, and move both in one "
                'Ramp(("temperature", "load")).'
            )

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        found = []
        for name in self.names:
            thermal = scene.materials[name].thermal
            assert thermal is not None  # it has been checked
            found.append(thermal.reference if scene.temperature is None else scene.temperature)
        return [HeatedRegions(self.names, self.kelvin, tuple(found), self.ramp)]


def check_temperatures(scene: Scene) -> None:
    """Check the temperature of a scene against its materials and what is modelled of them."""
    heated = scene.declared.heated
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
        if name in scene.thermal_regions:
            _check_modelled(scene, name)


def _check_modelled(scene: Scene, name: str) -> None:
    """Check that what a region has is modelled at a temperature that is not the reference."""
    material = scene.materials[name]
    thermal = material.thermal
    assert thermal is not None
    what = ""
    if scene.kinematics.is_membrane:
        what = "a membrane"
    elif any(branch.changes_by_points for branch in material.viscous):
        what = "a ViscousBranch"
    elif scene.leaks and thermal.permittivity is not None and material.is_dielectric:
        what = "a permittivity that changes with temperature beside charge that leaks or relaxes"
    if what:
        raise InputError(
            f"Region {name!r} has a temperature, but {what} takes none in a scene; give the region "
            "the material at one temperature, material.at(kelvin)."
        )
