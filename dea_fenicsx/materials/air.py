"""Air or any other gas around and between the parts of a device."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from dea_fenicsx.materials.base import EPSILON_0, Elastic, Strain
from dea_fenicsx.materials.damage import OgdenRoxburgh
from dea_fenicsx.materials.electric import Dielectric, Electric
from dea_fenicsx.materials.material import Material
from dea_fenicsx.materials.thermal import Thermal
from dea_fenicsx.materials.viscous import Branch
from dea_fenicsx.support.type_checks import is_number, shown

MOST_STIFFNESS = 1e-2
"""Largest stiffness of air; a stiffer medium is a foam, which is a material of its own."""

LEAST_STIFFNESS_OF_AIR = 1e-14
"""Smallest stiffness of air; below it the closed gap is thinner than rounding can tell."""

MOST_SMOOTHING = 10.0
"""Largest smoothing of air."""


@dataclass(frozen=True)
class Vacuum(Dielectric):
    """The permittivity eps_0, without a breakdown field."""

    def permittivity(self) -> float:
        """Absolute permittivity in F/m."""
        return EPSILON_0

    def faults(self) -> list[str]:
        return []


@dataclass(frozen=True)
class ThirdMedium:
    """The energy of the shape of air in units of its stiffness, which the model adds up itself:

        M = (|F|^2/2 + |cof F|^3/J^2 + J^-2/2 - 2 - 3 sqrt(3))/(1 + 3 sqrt(3)).

    It is polyconvex, and its stress vanishes in the undeformed state, where its shear modulus is 1.
    A layer that is squeezed to the share l of its thickness has the energy l^-2, up to a factor,
    while the energy of a field between two electrodes grows as l^-1 only.  The second and the third
    term hold each other along the layer, so that the air is not pressed out at its sides.
    """

    def energy(self, s: Strain) -> Any:
        """The part without J."""
        return (s.I1 - 3) / (2 + 6 * 3**0.5)

    def shear_modulus(self) -> float:
        """1, the unit of the energy."""
        return 1.0

    def spherical_slope(self) -> float:
        """0: there is no pressure that could carry a stress."""
        return 0.0

    def chain_margin(self, s: Strain) -> None:
        """The energy is defined for all J > 0."""

    def faults(self) -> list[str]:
        return []


@dataclass(frozen=True)
class Air(Material):
    """A region that is not part of the body: air, which carries the field with eps_0.

    The field outside of a device, the attraction between its parts, and contact need a mesh of the
    air.  Where two parts meet, the air between them is squeezed to almost nothing and carries the
    pressure of the contact, without a search for it (third medium).  The cells of the air follow
    the body: their shape makes the integral of the energy M of `ThirdMedium` smallest for the given
    surface of the body, whatever the field is.  Times `stiffness` and the smallest shear modulus mu
    of the solids this is the elastic energy of the air; ``Energy("air")`` tells it.  Two faces that
    press each other with p stay apart by about (stiffness mu/(2 p))^(1/3) times the initial gap.

    In a scene whose regions are all air nothing moves, and the field alone is solved for.

    Parameters
    ----------
    name
        A name for reports.
    stiffness
        Shear modulus of the air over the smallest one of the solids.
    smoothing
        Weight of the second derivatives of the displacement in the shape of the air's cells,
        h^2/2 |Grad Grad u|^2 with the size h of a cell.  It keeps cells apart that fold.

    References
    ----------
    P. Wriggers, J. Schroeder, A. Schwarz, Comput. Mech. 52 (2013) 837 (third medium);
    V. Faltus, M. Horak, M. Doskar, O. Rokos, Comput. Methods Appl. Mech. Eng. 428 (2024) 117061
    (second derivatives).
    """

    elastic: Elastic = field(default=ThirdMedium(), init=False, repr=False)
    electric: Electric | None = field(default=Vacuum(), init=False, repr=False)
    bulk_modulus: float | None = field(default=None, init=False, repr=False)
    viscous: tuple[Branch, ...] = field(default=(), init=False, repr=False)
    damage: OgdenRoxburgh | None = field(default=None, init=False, repr=False)
    thermal: Thermal | None = field(default=None, init=False, repr=False)
    stiffness: float = field(default=1e-11, kw_only=True)
    smoothing: float = field(default=0.0, kw_only=True)

    @property
    def is_air(self) -> bool:
        """Whether it is no part of the body."""
        return True

    def faults(self) -> list[str]:
        found = []
        if not is_number(self.stiffness) or not (
            LEAST_STIFFNESS_OF_AIR <= self.stiffness <= MOST_STIFFNESS
        ):
            found.append(
                f"the stiffness of the air is {shown(self.stiffness)}, but must be a number from "
                f"{LEAST_STIFFNESS_OF_AIR:g} to {MOST_STIFFNESS:g}, in units of the smallest shear "
                "modulus"
            )
        if not is_number(self.smoothing) or not 0 <= self.smoothing <= MOST_SMOOTHING:
            found.append(
                f"the smoothing of the air is {shown(self.smoothing)}, but must be a number from 0 "
                f"to {MOST_SMOOTHING:g}"
            )
        return found
