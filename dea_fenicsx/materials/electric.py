"""Electric properties of a region: an ideal dielectric with its breakdown field, or a conductor."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dea_fenicsx.materials.base import EPSILON_0
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


class Dielectric(Electric):
    """A dielectric whose true permittivity does not depend on strain."""

    is_dielectric = True

    @abstractmethod
    def permittivity(self) -> float:
        """Absolute permittivity in F/m."""

    def conductivity_law(self) -> Conductivity | None:
        """The law of its conductivity, or None where it does not conduct."""
        return None

    def relaxation_terms(self) -> tuple[Debye, ...]:
        """The polarisations that follow the field with a delay."""
        return ()

    def breakdown_law(self) -> Breakdown | None:
        """The law of its breakdown field, or None where it is not known."""
        return None

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

    def breakdown_law(self) -> Breakdown | None:
        if self.breakdown is None or isinstance(self.breakdown, Breakdown):
            return self.breakdown
        return Breakdown(self.breakdown)

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


@dataclass(frozen=True)
class Conductor(Electric):
    """A region of one potential: a compliant electrode of finite thickness."""

    is_conductor = True

    def faults(self) -> list[str]:
        return []
