"""The two limits of a viscous material: relaxed after an infinite time, and instantaneous."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from dea_fenicsx.exact.film import Film
from dea_fenicsx.materials import Material
from dea_fenicsx.materials.base import Elastic, Strain


@dataclass(frozen=True)
class Stiffened:
    """An elastic model with a neo-Hookean spring beside it.

    Parameters
    ----------
    base
        The model.
    mu
        Shear modulus of the spring in Pa.
    """

    base: Elastic
    mu: float

    def energy(self, s: Strain) -> Any:
        return self.base.energy(s) + self.mu / 2 * (s.I1 - 3)

    def shear_modulus(self) -> float:
        return self.base.shear_modulus() + self.mu

    def spherical_slope(self) -> float:
        return self.base.spherical_slope() + self.mu

    def chain_margin(self, s: Strain) -> Any | None:
        return self.base.chain_margin(s)

    def faults(self) -> list[str]:
        return self.base.faults()


def relaxed[T: (Film, Material)](of: T) -> T:
    """A film or material as it is after an infinite time: without its viscous branches."""
    material = of.material if isinstance(of, Film) else of
    made = replace(material, viscous=())
    return replace(of, material=made) if isinstance(of, Film) else made


def instantaneous[T: (Film, Material)](of: T) -> T:
    """A film or material as it answers at once: with the springs of its branches at their start.

    The branches are those of an undeformed material, C_v = 1.
    """
    material = of.material if isinstance(of, Film) else of
    mu = sum(branch.mu for branch in material.viscous)
    made = replace(material, viscous=())
    if mu:
        made = replace(made, elastic=Stiffened(material.elastic, mu))
    return replace(of, material=made) if isinstance(of, Film) else made
