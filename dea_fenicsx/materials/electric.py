"""Electric properties of a region: an ideal dielectric with its breakdown field, or a conductor."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

from dea_fenicsx.materials.base import EPSILON_0
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import is_finite


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

    def breakdown_law(self) -> Breakdown | None:
        """The law of its breakdown field, or None where it is not known."""
        return None

    def breakdown_field(self, stretch: Any = 1.0) -> Any:
        """True breakdown field in V/m at an in-plane stretch, or None where it is not known."""
        law = self.breakdown_law()
        return None if law is None else law.at(stretch)


@dataclass(frozen=True)
@in_si(eps_r="", breakdown="V/m")
class IdealDielectric(Dielectric):
    """A dielectric whose true permittivity does not depend on strain: D = eps_r eps_0 E.

    Parameters
    ----------
    eps_r
        Relative permittivity.
    breakdown
        Breakdown field: a number in V/m, a `Breakdown` law, or None where it is not known.

    References
    ----------
    Zhao, Hong, Suo, Phys. Rev. B 76 (2007) 134113.
    """

    eps_r: float
    breakdown: float | Breakdown | None = None

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
        return found if law is None else found + law.faults()


@dataclass(frozen=True)
class Conductor(Electric):
    """A region of one potential: a compliant electrode of finite thickness."""

    is_conductor = True

    def faults(self) -> list[str]:
        return []
