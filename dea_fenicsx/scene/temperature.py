"""The temperature of a device: that at first, and regions that a ramp heats or cools."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import ufl

from dea_fenicsx.scene.condition import InRegions, Prescribed, Setting
from dea_fenicsx.scene.declarations import Declaration, HeatedRegions
from dea_fenicsx.scene.kinematics_base import place_of
from dea_fenicsx.scene.own_functions import scalar_of
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import finite


@dataclass(frozen=True)
@in_si(kelvin="K")
class Temperature(InRegions, Prescribed):
    """The temperature of a region, which its ramp brings from that at first to a given one.

    At ramp factor t the temperature is T_0 + t (kelvin - T_0), with the temperature T_0 of
    ``Scene(temperature=...)``, or the reference of the material where the scene tells none.
    Nothing conducts heat: the temperature is what is given.  The mesh shows the body at T_0.

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
    heats: ClassVar[bool] = True

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
            if callable(self.kelvin):
                x = place_of(scene.kinematics, ufl.SpatialCoordinate(scene.device.mesh))
                self.symbolic(x, name)
            else:
                finite(self.kelvin, f"The temperature kelvin of {label!r}")
                thermal.check(self.kelvin, f"The temperature of {name!r}")
        others = (*scene.prescribed, *scene.loads, *scene.supports)
        if any(item is not self and item.moved_by == self.ramp
               and not item.heats for item in others):  # fmt: skip
            raise InputError(
                f"The temperature of {label!r} and another condition share the ramp "
                f"{self.ramp!r}; give them two, and move both in one "
                'Ramp(("temperature", "load")).'
            )

    def symbolic(self, x: Any, region: str) -> Any:
        """The temperature in K of a region at a place x in m, a UFL vector."""
        assert callable(self.kelvin)
        what = f"The function kelvin of the temperature of {region!r}"
        return scalar_of(self.kelvin, x, what, "the temperature in K")

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        found = []
        for name in self.names:
            thermal = scene.materials[name].thermal
            assert thermal is not None  # it has been checked
            found.append(thermal.reference if scene.temperature is None else scene.temperature)
        return [HeatedRegions(self.names, self.kelvin, tuple(found), self.ramp)]
