"""Electric properties of a region: an ideal dielectric with its breakdown field, or a conductor."""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np

from dea_fenicsx.materials.base import EPSILON_0
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import is_number
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import is_finite, is_positive

MOST_EXPONENT = 50.0
"""Largest exponent of a conductivity.  A dielectric breaks down long before."""


@dataclass(frozen=True)
@in_si(field="V/m", exponent="")
class Breakdown:
    """True breakdown field that grows with the stretch, E_b = field * lam^exponent.

    lam is the square root of the area stretch lam1 lam2, so that it is the stretch itself in
    equi-biaxial tension.

    Parameters
    ----------
    field
        Breakdown field of the unstretched film in V/m.
    exponent
        Exponent of the stretch, 0 for a constant field.
    """

    field: float
    exponent: float = 0.0

    def at(self, stretch: Any) -> Any:
        """Breakdown field in V/m at an (equi-biaxial) in-plane stretch."""
        return self.field * stretch**self.exponent

    def faults(self) -> list[str]:
        found = []
        if not is_finite(self.field) or not self.field > 0:
            found.append(
                f"the breakdown field is {self.field!r}, but must be a finite number of V/m > 0"
            )
        elif self.field < 1e5:
            found.append(
                f"the breakdown field is {self.field:g} V/m, less than that of air; the unit is "
                "V/m (1 MV/m = 1e6 V/m)"
            )
        if not is_finite(self.exponent):
            found.append(f"the breakdown exponent is {self.exponent!r}, but must be finite")
        return found


@dataclass(frozen=True)
@in_si(siemens_per_metre="S/m", field="V/m")
class Conductivity:
    """Conductivity of a dielectric that grows with the true field E: g exp(|E|/field).

    Parameters
    ----------
    siemens_per_metre
        g in S/m at small fields, >= 0.
    field
        Field in V/m over which it grows by a factor of e; None for a constant conductivity.

    References
    ----------
    Conduction of VHB 4910 and of silicones grows exponentially with the field: T. A. Gisby, S. Q.
    Xie, E. P. Calius, I. A. Anderson, Proc. SPIE 7642 (2010) 764213.
    """

    siemens_per_metre: float
    field: float | None = None

    def at(self, field: Any) -> Any:
        """Conductivity in S/m at a true field in V/m."""
        if self.field is None:
            return self.siemens_per_metre + 0 * field
        return self.siemens_per_metre * np.exp(np.minimum(field / self.field, MOST_EXPONENT))

    def faults(self) -> list[str]:
        """What is unphysical about the constants, as a list of clauses."""
        found = []
        if not is_finite(self.siemens_per_metre) or self.siemens_per_metre < 0:
            found.append(
                f"the conductivity is {self.siemens_per_metre!r}, but must be a finite number "
                ">= 0 in S/m"
            )
        elif self.siemens_per_metre > 1e-3:
            found.append(
                f"the conductivity is {self.siemens_per_metre:g} S/m, which is that of an "
                "electrode, not of a dielectric; the unit is S/m"
            )
        if self.field is not None and (not is_finite(self.field) or not self.field > 0):
            found.append(
                f"the field of the conductivity is {self.field!r}, but must be a number > 0 in "
                "V/m, or None"
            )
        return found


@dataclass(frozen=True)
@in_si(eps_r="", tau="s")
class Debye:
    """A term of dielectric relaxation: a polarisation that follows the field with a delay.

    The nominal polarisation P has the energy J |J^-1 F P|^2/(2 eps) - P . E per undeformed volume
    and flows towards its minimum, where it adds eps to the permittivity:

        dP/dt = (eps J C^-1 E - P)/tau,    eps = eps_r eps_0,

    with the nominal field E.  In a body of fixed shape the permittivity at the angular frequency w
    grows by eps/(1 + i w tau).

    Parameters
    ----------
    eps_r
        What the term adds to the relative permittivity at slow fields, > 0.
    tau
        Relaxation time in s, > 0.

    References
    ----------
    P. Debye, Polar Molecules, Chemical Catalog Company, New York (1929).
    """

    eps_r: float
    tau: float

    def faults(self) -> list[str]:
        """What is unphysical about the constants, as a list of clauses."""
        return [
            f"{name} of a Debye term is {value!r}, but must be a finite number > 0"
            for name, value in (("eps_r", self.eps_r), ("tau", self.tau))
            if not is_positive(value)
        ]

    def permittivity(self) -> float:
        """What it adds to the absolute permittivity at slow fields, in F/m."""
        return self.eps_r * EPSILON_0


class Electric(ABC):
    """Base of the electric properties of a region.

    Attributes
    ----------
    is_dielectric
        Whether a field may live in it; then it is a `Dielectric`.
    is_conductor
        Whether it is at one potential throughout.
    """

    is_dielectric: ClassVar[bool] = False
    is_conductor: ClassVar[bool] = False

    @abstractmethod
    def faults(self) -> list[str]:
        """What is unphysical about the constants, as a list of clauses."""


class FieldPoint(Protocol):
    """What an electric energy is given: a strain, and the square of the true field e.

    It is symbolic in finite elements and a truncated Taylor series in the theory of films, like
    the `Strain` of elastic models, whose invariants it has, too.
    """

    @property
    def I1(self) -> Any:
        """tr C; of the volume-preserving part of F in a compressible material."""
        ...

    @property
    def e2(self) -> Any:
        """e . e, with the true field e = F^-T E."""
        ...

    @property
    def E2(self) -> Any:
        """E . E = e . F F^T e, with the nominal field E."""
        ...

    @property
    def ln_J(self) -> Any:
        """Logarithm of det F; 0 in an incompressible material."""
        ...

    @property
    def vacuum(self) -> Any:
        """eps_0 in the units of the point."""
        ...

    def exp(self, x: Any) -> Any:
        """Exponential."""
        ...

    def ln(self, x: Any) -> Any:
        """Natural logarithm."""
        ...

    def choose(self, x: Any, edge: float, below: Any, above: Any) -> Any:
        """`below` where x < edge, else `above`; both are finite everywhere."""
        ...

    def at_least(self, x: Any, edge: float) -> Any:
        """The larger of x and a number."""
        ...


class Dielectric(Electric):
    """A dielectric by its energy: u(F, e) per deformed volume at a given true field e.

    u is the co-energy, whose change with the field is that of the charge: the nominal displacement
    is d(J u)/dE and the nominal stress of the field -d(J u)/dF at kept nominal field E.  One
    energy gives both, so that Maxwell's relation between them holds.

    Attributes
    ----------
    is_ideal
        Whether u = eps e.e/2 with one permittivity eps at all strains and fields.
    is_linear
        Whether u is quadratic in the field, so that displacement and field are proportional.
    depends_on_strain
        Whether u at a kept true field changes with the strain.
    constants
        The numbers in the energy, each with its kind: ``"permittivity"`` for one in units of
        eps_0, ``"displacement"`` for C/m^2, or ``""``.
    """

    is_dielectric = True
    is_ideal: ClassVar[bool] = True
    is_linear: ClassVar[bool] = True
    depends_on_strain: ClassVar[bool] = False
    constants: ClassVar[dict[str, str]] = {}

    @abstractmethod
    def permittivity(self) -> float:
        """Absolute permittivity in F/m of the undeformed dielectric at small fields."""

    def coenergy(self, s: FieldPoint) -> Any:
        """u, per deformed volume.  All `constants` are those of `in_units`, none is relative.

        That of an ideal dielectric, eps e.e/2, unless a law says otherwise.
        """
        return s.vacuum * (self.permittivity() / EPSILON_0) / 2 * s.e2

    def form(self) -> Hashable:
        """What shapes the formula beside the constants."""
        return () if self.constants else self.permittivity()

    def in_units(self, convert: Callable[[str, str], Any]) -> Dielectric:
        """A copy whose constants are `convert(name, kind)`."""
        made = copy.copy(self)
        for name, kind in self.constants.items():
            object.__setattr__(made, name, convert(name, kind))
        return made

    def times(self, factor: float) -> Dielectric:
        """A copy whose energy is larger by a factor at the same field: all permittivities are."""
        return self.in_units(
            lambda name, kind: getattr(self, name) * (factor if kind else 1.0)
        )

    def in_si(self) -> Dielectric:
        """A copy with its permittivities in F/m, ready for `coenergy` at fields in V/m."""
        return self.in_units(lambda name, kind: in_unit(getattr(self, name), kind, EPSILON_0, 1.0))

    def constant_permittivity(self, what: str) -> float:
        """Its permittivity in F/m, if that is one number.

        Raises
        ------
        InputError
            If it depends on strain or field, of which `what` knows nothing.
        """
        if not self.is_ideal:
            raise InputError(
                f"{what} needs one permittivity at all strains and fields, but that of "
                f"{type(self).__name__} changes; take IdealDielectric, or exact.Film and elements, "
                "which know it."
            )
        return self.permittivity()

    def conductivity_law(self) -> Conductivity | None:
        """The law of its conductivity, or None where it does not conduct."""
        return None

    def relaxation_terms(self) -> tuple[Debye, ...]:
        """The polarisations that follow the field with a delay."""
        return ()

    def breakdown_law(self) -> Breakdown | None:
        """The law of its breakdown field, or None where it is not known."""
        law: Any = getattr(self, "breakdown", None)
        return Breakdown(law) if is_number(law) else law

    def breakdown_field(self, stretch: Any = 1.0) -> Any:
        """True breakdown field in V/m at an in-plane stretch, or None where it is not known."""
        law = self.breakdown_law()
        return None if law is None else law.at(stretch)


@dataclass(frozen=True)
@in_si(eps_r="", breakdown="V/m", conductivity="S/m")
class IdealDielectric(Dielectric):
    """A dielectric whose true permittivity does not depend on strain: D = eps_r eps_0 E.

    Parameters
    ----------
    eps_r
        Relative permittivity.
    breakdown
        Breakdown field: a number in V/m, a `Breakdown` law, or None where it is not known.
    conductivity
        Conductivity of the dielectric, by which charge leaks through it while time passes in a
        `March`: a number in S/m, or a `Conductivity` law.  0 for a perfect insulator.
    relaxation
        Polarisations that follow the field with a delay while time passes: `Debye` terms, to which
        `eps_r` is the permittivity at once.

    References
    ----------
    Zhao, Hong, Suo, Phys. Rev. B 76 (2007) 134113.
    """

    eps_r: float
    breakdown: float | Breakdown | None = None
    conductivity: float | Conductivity = 0.0
    relaxation: tuple[Debye, ...] = ()
    constants: ClassVar[dict[str, str]] = {"eps_r": "permittivity"}

    def __post_init__(self) -> None:
        if isinstance(self.relaxation, list):
            object.__setattr__(self, "relaxation", tuple(self.relaxation))
        elif isinstance(self.relaxation, Debye):
            object.__setattr__(self, "relaxation", (self.relaxation,))

    def relaxation_terms(self) -> tuple[Debye, ...]:
        return self.relaxation

    def conductivity_law(self) -> Conductivity | None:
        law = self.conductivity
        if not isinstance(law, Conductivity):
            law = Conductivity(law)
        return law if law.siemens_per_metre else None

    def permittivity(self) -> float:
        """Absolute permittivity in F/m."""
        return self.eps_r * EPSILON_0

    def coenergy(self, s: FieldPoint) -> Any:
        """eps e.e/2"""
        return self.eps_r / 2 * s.e2

    def faults(self) -> list[str]:
        found = []
        if not is_finite(self.eps_r) or self.eps_r < 1:
            found.append(
                f"eps_r is {self.eps_r!r}, but a relative permittivity is a finite number >= 1"
            )
        law = self.breakdown_law()
        if law is not None:
            found += law.faults()
        if not isinstance(self.relaxation, tuple):
            found.append(f"relaxation is {self.relaxation!r}, but must be a list of Debye terms")
        else:
            for term in self.relaxation:
                found += (
                    term.faults() if isinstance(term, Debye)
                    else [f"relaxation holds {term!r}, but needs Debye(eps_r, tau)"]
                )  # fmt: skip
        leak = self.conductivity
        return found + (leak if isinstance(leak, Conductivity) else Conductivity(leak)).faults()


def in_unit(value: Any, kind: str, permittivity: float, displacement: float) -> Any:
    """A constant of a dielectric of a kind, see `Dielectric`, in given units."""
    return value * {"permittivity": permittivity, "displacement": displacement}.get(kind, 1.0)


@dataclass(frozen=True)
class Conductor(Electric):
    """A region of one potential: a compliant electrode of finite thickness."""

    is_conductor = True

    def faults(self) -> list[str]:
        return []
