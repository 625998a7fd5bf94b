"""The two limits of a viscous material: relaxed after an infinite time, and instantaneous."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from dea_fenicsx.exact.film import Film
from dea_fenicsx.materials import Material, Maxwell, NeoHookean
from dea_fenicsx.materials.base import Elastic, Strain
from dea_fenicsx.materials.viscous import Branch


@dataclass(frozen=True)
class Stiffened:
    """An elastic model with springs beside it.

    Parameters
    ----------
    base
        The model.
    springs
        The springs.
    """

    base: Elastic
    springs: tuple[Elastic, ...]

    def energy(self, s: Strain) -> Any:
        total = self.base.energy(s)
        for spring in self.springs:
            total = total + spring.energy(s)
        return total

    def shear_modulus(self) -> float:
        return self.base.shear_modulus() + sum(spring.shear_modulus() for spring in self.springs)

    def spherical_slope(self) -> float:
        return self.base.spherical_slope() + sum(s.spherical_slope() for s in self.springs)

    def chain_margin(self, s: Strain) -> Any | None:
        """The product of all margins, which is positive where each of them is."""
        found = None
        for model in (self.base, *self.springs):
            margin = model.chain_margin(s)
            if margin is not None:
                found = margin if found is None else found * margin
        return found

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
    made = replace(material, viscous=())
    if springs := _springs(material.viscous):
        made = replace(made, elastic=Stiffened(material.elastic, springs))
    return replace(of, material=made) if isinstance(of, Film) else made


def _springs(branches: tuple[Branch, ...]) -> tuple[Elastic, ...]:
    """The springs of branches, those of `Maxwell` ones together."""
    others = [branch.spring for branch in branches if not isinstance(branch, Maxwell)]
    mu = sum(branch.mu for branch in branches if isinstance(branch, Maxwell))
    return (NeoHookean(mu), *others) if mu else tuple(others)
