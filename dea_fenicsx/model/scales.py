"""The units of a problem: the SI value of each dimensionless one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.materials.electric import in_unit
from dea_fenicsx.scene.scene import Scene


@dataclass(frozen=True)
class Scales:
    """SI value of each dimensionless unit.

    Attributes
    ----------
    length : m
    stress : Pa, the shear modulus of the softest dielectric; 1 Pa where all is air
    permittivity : F/m
    depth : third dimension of a plane problem in units of `length`, 1 otherwise
    """

    length: float
    stress: float
    permittivity: float
    depth: float

    @property
    def field(self) -> float:
        """Electric field in V/m."""
        return float(np.sqrt(self.stress / self.permittivity))

    @property
    def potential(self) -> float:
        """Potential in V."""
        return self.length * self.field

    @property
    def force(self) -> float:
        """Force in N."""
        return self.stress * self.length**2 * self.depth

    @property
    def charge(self) -> float:
        """Charge in C."""
        return self.permittivity * self.field * self.length**2 * self.depth

    @property
    def volume(self) -> float:
        """Volume in m^3."""
        return self.length**3 * self.depth

    def of_dielectric(self, value: float, kind: str) -> float:
        """A dimensionless constant of a dielectric; `kind` is as in `Dielectric.constants`."""
        return float(
            in_unit(
                value, kind, EPSILON_0 / self.permittivity, 1 / (self.permittivity * self.field)
            )
        )

    @classmethod
    def of(cls, scene: Scene) -> Scales:
        """Scales of a scene: its size, its softest dielectric and its largest permittivity.

        Air counts only where there is no other dielectric, and then with its permittivity alone.
        """
        solids = scene.solids.values()
        active = [m for m in solids if m.is_dielectric]
        moduli = [m.elastic.shear_modulus() for m in active or solids] or [1.0]
        active = active or [m for m in scene.materials.values() if m.is_dielectric]
        return cls(
            length=scene.device.length,
            stress=min(moduli),
            permittivity=max((m.dielectric.permittivity() for m in active), default=1.0),
            depth=scene.kinematics.depth_factor(scene.device.length),
        )
