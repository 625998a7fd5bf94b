"""Rubber with families of fibres: any isotropic rubber plus an energy of each family.

With the direction a of a family in the undeformed body, I4 = a . C a is the square of its stretch.
Each energy of a family and its slope vanish at rest, so that the reference bears no stress.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dea_fenicsx.materials.base import (
    Elastic,
    Strain,
    is_compressible,
    is_isotropic,
    not_finite,
    not_positive,
    stress_size,
)
from dea_fenicsx.materials.directions import Direction, direction
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import is_finite

BEARS = ("tension", "both")


class Family(ABC):
    """A family of fibres: an energy of the strain along a direction.

    A subclass is a frozen dataclass with the field `direction`, and states `energy` and
    `own_faults`.
    """

    direction: Any

    def __post_init__(self) -> None:
        object.__setattr__(self, "direction", direction(self.direction))

    @abstractmethod
    def energy(self, s: Strain) -> Any:
        """Energy density in Pa; it and its slope are 0 at rest."""

    @abstractmethod
    def own_faults(self) -> list[str]:
        """What is wrong with the constants, as a list of clauses."""

    def faults(self) -> list[str]:
        if not isinstance(self.direction, Direction):
            return [
                f"the direction of {type(self).__name__} is {shown(self.direction)}, but must be "
                "three numbers, Along, Cylindrical, Wound or Helix"
            ]
        found = self.direction.faults() + self.own_faults()
        bears = getattr(self, "bears", "both")
        if bears not in BEARS:
            found.append(f'bears is {shown(bears)}, but must be "tension" or "both"')
        return found


@dataclass(frozen=True)
@in_si(k="Pa")
class StandardReinforcing(Family):
    """The standard reinforcing energy, W = k/2 (I4 - 1)^2.

    Parameters
    ----------
    k
        Stiffness in Pa; a family adds 4 k to Young's modulus along it.
    direction
        A vector, `Along`, `Cylindrical`, `Wound` or `Helix`.
    bears
        ``"both"``, or ``"tension"`` for fibres that buckle and bear no pressure: then W = 0 where
        I4 < 1, and the stress is continuous there.

    References
    ----------
    Qiu and Pence, J. Elasticity 49 (1997) 1.
    """

    k: float
    direction: Any
    bears: str = "both"

    def energy(self, s: Strain) -> Any:
        x = s.I4(self.direction) - 1
        x = s.positive(x) if self.bears == "tension" else x
        return self.k / 2 * x * x

    def own_faults(self) -> list[str]:
        return not_positive(self, "k")


@dataclass(frozen=True)
@in_si(k1="Pa", k2="", dispersion="")
class HolzapfelFibres(Family):
    """Holzapfel's fibres, W = k1/(2 k2) [exp(k2 E^2) - 1], E = d (I1 - 3) + (1 - 3 d)(I4 - 1).

    Parameters
    ----------
    k1
        Stiffness in Pa.
    k2
        How fast they stiffen, > 0.
    direction
        A vector, `Along`, `Cylindrical`, `Wound` or `Helix`.
    dispersion
        Spread d of the directions, from 0 (all along one) to 1/3 (isotropic).
    bears
        ``"tension"``: W = 0 where E < 0; or ``"both"``.

    References
    ----------
    Holzapfel, Gasser and Ogden, J. Elasticity 61 (2000) 1; Gasser, Ogden and Holzapfel, J. R. Soc.
    Interface 3 (2006) 15.
    """

    k1: float
    k2: float
    direction: Any
    dispersion: float = 0.0
    bears: str = "tension"

    def energy(self, s: Strain) -> Any:
        d = self.dispersion
        x = d * (s.I1 - 3) + (1 - 3 * d) * (s.I4(self.direction) - 1)
        x = s.positive(x) if self.bears == "tension" else x
        return self.k1 / 2 / self.k2 * (s.exp(self.k2 * x * x) - 1)

    def own_faults(self) -> list[str]:
        found = not_positive(self, "k1", "k2")
        if not is_finite(self.dispersion) or not 0 <= self.dispersion <= 1 / 3:
            found.append(
                f"dispersion is {shown(self.dispersion)}, but must lie between 0 (all fibres along "
                "one direction) and 1/3 (isotropic)"
            )
        return found


@dataclass(frozen=True)
@in_si(k="Pa", c="Pa")
class TransverselyIsotropic(Family):
    """What makes an electrode stiffer along one direction, W = k/2 (I4 - 1)^2 + c/2 |(C - 1) a|^2.

    |(C - 1) a|^2 = I5 - 2 I4 + 1.  In an incompressible rubber of shear modulus mu Young's modulus
    along a is 3 mu + 4 (k + c), and the shear modulus along a is mu + c.

    Parameters
    ----------
    k, c
        Stiffnesses in Pa, >= 0 and not both 0; see `from_moduli`.
    direction
        A vector, `Along`, `Cylindrical`, `Wound` or `Helix`.

    References
    ----------
    Merodio and Ogden, Int. J. Non-Linear Mech. 40 (2005) 213, for energies of I4 and I5.
    """

    k: float
    c: float
    direction: Any

    @classmethod
    def from_moduli(
        cls, young: float, shear: float, mu: float, direction: Any
    ) -> TransverselyIsotropic:
        """From Young's and shear modulus along the direction, and mu across it, in Pa."""
        c = shear - mu
        return cls((young - 3 * mu) / 4 - c, c, direction)

    def energy(self, s: Strain) -> Any:
        four = s.I4(self.direction)
        turned = s.I5(self.direction) - 2 * four + 1
        return self.k / 2 * (four - 1) * (four - 1) + self.c / 2 * turned

    def own_faults(self) -> list[str]:
        found = not_finite(self, "k", "c")
        if not found and (min(self.k, self.c) < 0 or self.k + self.c <= 0):
            found = [
                f"k is {self.k:g} and c is {self.c:g} Pa, but both must be >= 0 and one > 0; by "
                "from_moduli: shear >= mu and young >= 4 shear - mu"
            ]
        return found


@dataclass(frozen=True)
class Reinforced:
    """A rubber with fibres: the energy of an isotropic matrix plus that of each family.

    Parameters
    ----------
    matrix
        The rubber between the fibres, an isotropic elastic model.
    fibres
        One family or several: `StandardReinforcing`, `HolzapfelFibres`, `TransverselyIsotropic`.
        Directions are those in the undeformed body, before any `PreStretch`.

    Notes
    -----
    With a bulk modulus the stretch of fibres is that of the volume-preserving part of F.
    """

    matrix: Elastic
    fibres: tuple[Family, ...]
    isotropic = False

    def __post_init__(self) -> None:
        if isinstance(self.fibres, Family):
            object.__setattr__(self, "fibres", (self.fibres,))
        elif isinstance(self.fibres, list):
            object.__setattr__(self, "fibres", tuple(self.fibres))

    def energy(self, s: Strain) -> Any:
        return sum((family.energy(s) for family in self.fibres), self.matrix.energy(s))

    def shear_modulus(self) -> float:
        """That of the matrix."""
        return self.matrix.shear_modulus()

    def spherical_slope(self) -> float:
        return self.matrix.spherical_slope()

    def chain_margin(self, s: Strain) -> Any | None:
        return self.matrix.chain_margin(s)

    def stress_size(self, s: Strain, lnJ: Any) -> Any:
        return stress_size(self.matrix, s, lnJ)

    def faults(self) -> list[str]:
        if not isinstance(self.matrix, Elastic) or not is_isotropic(self.matrix):
            return [
                f"the matrix is {shown(self.matrix)}, but must be an isotropic rubber such as "
                "NeoHookean(mu)"
            ]
        if is_compressible(self.matrix):
            return ["the matrix is a foam, but must be a rubber such as NeoHookean(mu)"]
        if (
            not isinstance(self.fibres, tuple)
            or not self.fibres
            or not all(isinstance(one, Family) for one in self.fibres)
        ):
            return [
                f"fibres is {shown(self.fibres)}, but must hold one family or several, such as "
                "HolzapfelFibres(k1, k2, (1, 0, 0))"
            ]
        return self.matrix.faults() + [fault for one in self.fibres for fault in one.faults()]

    def is_mirrored(self, axis: int, place: Sequence[float] = (0.0, 0.0, 0.0)) -> bool:
        """Whether the reflection of one component leaves the fibres at a place as they are."""
        left = [(_law_of(one), _unit_at(one, place)) for one in self.fibres]
        mirror = np.ones(3)
        mirror[axis] = -1
        for law, a in list(left):
            alike = [
                k for k, (other, b) in enumerate(left)
                if other == law and abs(abs(np.dot(mirror * a, b)) - 1) < 1e-12
            ]  # fmt: skip
            if not alike:
                return False
            left.pop(alike[0])
        return True

    def check_axes(self) -> None:
        """Raise InputError unless a film's axes are those of symmetry of its fibres."""
        for family in self.fibres:
            family.direction.unit()
        if not all(map(self.is_mirrored, range(3))):
            raise InputError(
                "A Film takes fibres along its axes, or pairs of alike families at plus and minus "
                "an angle to one, since others shear it; take finite elements for them."
            )


def _law_of(family: Any) -> Any:
    """A family without its direction."""
    return replace(family, direction=None)


def _unit_at(family: Family, place: Sequence[float]) -> np.ndarray:
    """The direction of a family at a place, as a unit vector."""
    a = np.array(family.direction.at(place), dtype=float)
    return a / np.linalg.norm(a)


