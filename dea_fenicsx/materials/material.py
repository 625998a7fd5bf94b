"""A material: an elastic energy joined with what the region does electrically."""

from __future__ import annotations

from dataclasses import dataclass, replace

from dea_fenicsx.materials.base import Elastic, constants, is_compressible
from dea_fenicsx.materials.damage import OgdenRoxburgh, Softened
from dea_fenicsx.materials.electric import Dielectric, Electric
from dea_fenicsx.materials.thermal import Scaled, Thermal
from dea_fenicsx.materials.viscous import Branch, Maxwell, ViscousBranch
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import is_number, shown
from dea_fenicsx.support.units import in_si, si
from dea_fenicsx.support.validation import is_finite


@dataclass(frozen=True)
@in_si(bulk_modulus="Pa", density="kg/m**3")
class Material:
    """What fills a region.

    Parameters
    ----------
    elastic
        The elastic energy.
    electric
        ``IdealDielectric`` where a field may live, ``Conductor()`` for an electrode layer, or
        None for a passive part in which the field is not modelled.
    bulk_modulus
        Bulk modulus kappa in Pa.  None (the default) means exactly incompressible.  With a bulk
        modulus the elastic energy is taken of the volume-preserving part of F, and
        kappa/2 (J - 1)^2 is added (in Abaqus's terms D1 = 2/kappa).  Leave it out for a foam, whose
        energy states its own; it is then that of small strain.
    name
        A name for reports.
    viscous
        Viscous branches (`Maxwell`, `ViscousBranch`) beside the elastic energy, which is then that
        of the equilibrium, reached after an infinite time.
    density
        Mass per undeformed volume in kg/m^3.  Vibration and motion need it; None where nothing
        does.
    thermal
        How it changes with temperature; None for a material that does not.  Its constants are then
        those at ``thermal.reference``.  See `at`, and `Scene(temperature=...)`.
    damage
        How its equilibrium softens by the largest energy so far; None for a rubber that does not.
        Exact states are those of the first loading; `softened` is for those after it.
    """

    elastic: Elastic
    electric: Electric | None = None
    bulk_modulus: float | None = None
    name: str = ""
    viscous: tuple[Branch, ...] = ()
    density: float | None = None
    thermal: Thermal | None = None
    damage: OgdenRoxburgh | None = None

    def __post_init__(self) -> None:
        if isinstance(self.viscous, list):
            object.__setattr__(self, "viscous", tuple(self.viscous))
        elif isinstance(self.viscous, Branch):
            object.__setattr__(self, "viscous", (self.viscous,))
        foam = is_compressible(self.elastic) and not self.elastic.faults()
        if foam and self.bulk_modulus is None:
            bulk = self.elastic.initial_bulk_modulus()  # type: ignore[attr-defined]
            object.__setattr__(self, "bulk_modulus", bulk)

    @property
    def is_viscous(self) -> bool:
        """Whether its stress depends on the time."""
        return bool(self.viscous)

    @property
    def is_air(self) -> bool:
        """Whether it is no part of the body; see `Air`."""
        return False

    @property
    def is_dielectric(self) -> bool:
        return self.electric is not None and self.electric.is_dielectric

    @property
    def is_conductor(self) -> bool:
        return self.electric is not None and self.electric.is_conductor

    @property
    def dielectric(self) -> Dielectric:
        """Its dielectric.

        Raises
        ------
        InputError
            If it is none.
        """
        return self.dielectric_of("material")

    def dielectric_of(self, what: str) -> Dielectric:
        """Its dielectric; `what` tells in the message which material has none."""
        if not isinstance(self.electric, Dielectric):
            raise InputError(
                f"The {what} is no dielectric; give it electric=IdealDielectric(eps_r)."
            )
        return self.electric

    def faults(self) -> list[str]:
        """What is wrong with this material, as a list of clauses."""
        found = list(self.elastic.faults())
        if not found and not self.elastic.shear_modulus() > 0:
            found = [
                f"the initial shear modulus is {self.elastic.shear_modulus()!r} Pa, but must be > 0"
            ]
        if self.electric is not None:
            found += self.electric.faults()
        if not isinstance(self.viscous, tuple):
            found.append(f"viscous is {shown(self.viscous)}, but must be a list of branches")
        else:
            for branch in self.viscous:
                found += (
                    branch.faults() if isinstance(branch, Maxwell | ViscousBranch)
                    else [f"viscous holds {shown(branch)}, but needs Maxwell(mu, tau) or "
                          "ViscousBranch(spring, tau)"]
                )  # fmt: skip
        if is_compressible(self.elastic):
            if not found:
                own = self.elastic.initial_bulk_modulus()  # type: ignore[attr-defined]
                if self.bulk_modulus != own:
                    found.append(
                        f"bulk_modulus is {shown(self.bulk_modulus)}, but the energy states its "
                        f"own, {own:g} Pa; leave it out"
                    )
        elif self.bulk_modulus is not None and not found:
            kappa, mu = self.bulk_modulus, self.elastic.shear_modulus()
            if not is_finite(kappa) or kappa < 2 / 3 * mu:
                found.append(
                    f"bulk_modulus is {kappa!r}, but must be at least 2/3 of the shear modulus "
                    f"{mu:g} Pa (Poisson's ratio >= 0), or None for an incompressible material"
                )
        if self.density is not None and not (is_finite(self.density) and self.density > 0):
            found.append(
                f"the density is {shown(self.density)}, but must be a number > 0 in kg/m^3, or None"
            )
        if self.thermal is not None:
            found += self.thermal.faults() if isinstance(self.thermal, Thermal) else [
                f"thermal is {shown(self.thermal)}, but must be Thermal(...), or None"
            ]  # fmt: skip
        if self.damage is not None:
            found += self.damage.faults() if isinstance(self.damage, OgdenRoxburgh) else [
                f"damage is {shown(self.damage)}, but must be OgdenRoxburgh(r, m), or None"
            ]  # fmt: skip
        return found

    def softened(self, peak: float) -> Material:
        """The material after a largest energy density in Pa, which then softens no more.

        Raises
        ------
        InputError
            If the material has no `damage`, or the energy is negative.
        """
        if self.damage is None:
            raise InputError("The material does not soften; give it damage=OgdenRoxburgh(r, m).")
        bulk = None if is_compressible(self.elastic) else self.bulk_modulus
        elastic = Softened(self.elastic, self.damage, si(peak, "Pa", "The largest energy"))
        made = replace(self, elastic=elastic, bulk_modulus=bulk, damage=None)
        if faults := made.faults():
            raise InputError(f"The softened material: {faults[0]}.")
        return made

    def at(self, kelvin: float) -> Material:
        """The material with its constants at a temperature in K, which then no longer changes.

        Its undeformed state is the unloaded one at this temperature.

        Raises
        ------
        InputError
            If the material has no `thermal`, or its data do not reach that far.
        """
        kelvin = si(kelvin, "K", "The temperature")
        if self.thermal is None:
            raise InputError("The material does not change with temperature; give it thermal=...")
        if faults := self.faults():
            raise InputError(f"{type(self.elastic).__name__}: {faults[0]}.")
        self.thermal.check(kelvin, "The temperature")
        stiffer = float(self.thermal.modulus_factor(kelvin))
        slower = float(self.thermal.time_factor(kelvin))
        electric = self.electric
        if isinstance(electric, Dielectric):
            electric = electric.times(float(self.thermal.permittivity_factor(kelvin)))
        made = replace(
            self, elastic=Scaled(stiffer, self.elastic), electric=electric, thermal=None,
            viscous=tuple(branch.scaled(stiffer, slower) for branch in self.viscous),
            bulk_modulus=None if is_compressible(self.elastic) else self.bulk_modulus,
        )  # fmt: skip
        if faults := made.faults():
            raise InputError(f"The material at {kelvin:g} K: {faults[0]}.")
        return made

    def parameters(self) -> dict[str, float]:
        """The elastic model's constants by name."""
        return {name: getattr(self.elastic, name) for name in constants(self.elastic)}


def bulk_modulus_of(mu: float, nu: float) -> float:
    """Bulk modulus in Pa for shear modulus `mu` (Pa) and Poisson's ratio `nu` < 0.5."""
    mu, nu = si(mu, "Pa", "The shear modulus"), si(nu, "", "Poisson's ratio")
    if not is_number(mu) or not mu > 0:
        raise InputError(f"The shear modulus is {shown(mu)}, but must be a number > 0 in Pa.")
    if not is_number(nu) or not 0 <= nu < 0.5:
        raise InputError(
            f"Poisson's ratio is {shown(nu)}, but must lie in [0, 0.5) for a finite bulk modulus."
        )
    return 2 * mu * (1 + nu) / (3 * (1 - 2 * nu))
