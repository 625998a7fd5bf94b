"""Dielectrics with electrostriction, with saturation, and composites, each one energy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal, get_args

from dea_fenicsx.materials.base import EPSILON_0
from dea_fenicsx.materials.electric import Breakdown, Dielectric, FieldPoint
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import is_number, shown
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import is_finite, is_positive

LARGEST_SERIES_ARGUMENT = 0.03
"""Square of the argument x up to which ln cosh x and ln(sinh x/x) are computed by their series."""

_LN_COSH = (1 / 2, -1 / 12, 1 / 45, -17 / 2520, 31 / 14175, -691 / 935550, 10922 / 42567525)
_LN_SINHC = (1 / 6, -1 / 180, 1 / 2835, -1 / 37800, 1 / 467775, -691 / 3831077250)


def _start(d: Any) -> list[str]:
    """Complaints about eps_r and the breakdown field."""
    if not is_finite(d.eps_r) or d.eps_r < 1:
        return [f"eps_r is {d.eps_r!r}, but a relative permittivity is a finite number >= 1"]
    law = d.breakdown_law()
    return [] if law is None else law.faults()


def _series(coefficients: tuple[float, ...], y: Any) -> Any:
    value: Any = 0.0
    for c in reversed(coefficients):
        value = (value + c) * y
    return value


def ln_cosh(s: FieldPoint, y: Any) -> Any:
    """ln cosh x of y = x^2, smooth at 0 and without overflow."""
    x = s.at_least(y, LARGEST_SERIES_ARGUMENT) ** 0.5
    large = x + s.ln((1 + s.exp(-2 * x)) / 2)
    return s.choose(y, LARGEST_SERIES_ARGUMENT, _series(_LN_COSH, y), large)


def ln_sinhc(s: FieldPoint, y: Any) -> Any:
    """ln(sinh x/x) of y = x^2, smooth at 0 and without overflow."""
    x = s.at_least(y, LARGEST_SERIES_ARGUMENT) ** 0.5
    large = x + s.ln((1 - s.exp(-2 * x)) / (2 * x))
    return s.choose(y, LARGEST_SERIES_ARGUMENT, _series(_LN_SINHC, y), large)


@dataclass(frozen=True)
@in_si(eps_r="", a1="", a2="", breakdown="V/m")
class Electrostriction(Dielectric):
    """A permittivity that strain makes anisotropic, eps_ij = eps_0 (eps_r I + a1 h + a2 ln J I).

    h = (F F^T - 1)/2 is the strain in the deformed body, so that eps_r + a1 (lam3^2 - 1)/2 acts
    along the thickness of a film.  For small strains u it is eps_r delta_ij + a1 u_ij + a2 u_kk
    delta_ij, and the stress of the field is

        sigma_ij = eps_0 [(eps_r - a1/2) e_i e_j - (eps_r + a2)/2 e.e delta_ij].

    A positive a1 lowers the permittivity of a film that the field squeezes, and its contraction.

    Parameters
    ----------
    eps_r
        Relative permittivity of the undeformed dielectric.
    a1, a2
        Electrostrictive coefficients in units of eps_0.  a2 acts on changes of volume alone.
    breakdown
        Breakdown field in V/m, or a law of it.

    References
    ----------
    L. D. Landau, E. M. Lifshitz, Electrodynamics of Continuous Media, section 12 (there in Gaussian
    units, with the same signs); Y. M. Shkel, D. J. Klingenberg, J. Appl. Phys. 83 (1998) 7834.
    """

    eps_r: float
    a1: float
    a2: float = 0.0
    breakdown: float | Breakdown | None = None
    is_ideal: ClassVar[bool] = False
    depends_on_strain: ClassVar[bool] = True
    constants: ClassVar[dict[str, str]] = dict.fromkeys(("eps_r", "a1", "a2"), "permittivity")

    def permittivity(self) -> float:
        return self.eps_r * EPSILON_0

    def coenergy(self, s: FieldPoint) -> Any:
        """eps_ij e_i e_j/2"""
        return (self.eps_r + self.a2 * s.ln_J) / 2 * s.e2 + self.a1 / 4 * (s.E2 - s.e2)

    def faults(self) -> list[str]:
        if found := _start(self):
            return found
        if not (is_finite(self.a1) and is_finite(self.a2)):
            return [f"a1 and a2 are {shown(self.a1)} and {shown(self.a2)}, but must be finite"]
        if self.eps_r - self.a1 / 2 < 1:
            return [
                f"the relative permittivity falls to {self.eps_r - self.a1 / 2:.3g} in a film that "
                "is squeezed flat, but must be at least 1; take a1 <= 2 (eps_r - 1)"
            ]
        return []


@dataclass(frozen=True)
@in_si(eps_r="", D_s="C/m**2", breakdown="V/m")
class SaturatingDielectric(Dielectric):
    """Polarisation that saturates, D = D_s tanh(eps e/D_s), u = D_s^2/eps ln cosh(eps e/D_s).

    Parameters
    ----------
    eps_r
        Relative permittivity at small fields.
    D_s
        Largest displacement in C/m^2.
    breakdown
        Breakdown field in V/m, or a law of it.

    References
    ----------
    B. Li, L. Liu, Z. Suo, Int. J. Smart Nano Mater. 2 (2011) 59.
    """

    eps_r: float
    D_s: float
    breakdown: float | Breakdown | None = None
    is_ideal: ClassVar[bool] = False
    is_linear: ClassVar[bool] = False
    constants: ClassVar[dict[str, str]] = {"eps_r": "permittivity", "D_s": "displacement"}

    def permittivity(self) -> float:
        return self.eps_r * EPSILON_0

    def coenergy(self, s: FieldPoint) -> Any:
        """D_s^2/eps ln cosh(eps e/D_s)"""
        return self.D_s**2 / self.eps_r * ln_cosh(s, (self.eps_r / self.D_s) ** 2 * s.e2)

    def faults(self) -> list[str]:
        ok = is_positive(self.D_s)
        return _start(self) or (
            [] if ok else [f"D_s is {shown(self.D_s)}, but must be a finite number > 0 in C/m^2"]
        )


@dataclass(frozen=True)
@in_si(eps_r="", P_s="C/m**2", eps_r_high="", breakdown="V/m")
class LangevinDielectric(Dielectric):
    """Dipoles that turn into the field: D = eps_high e + P_s L(x), L(x) = coth x - 1/x.

    x = 3 (eps - eps_high) e/P_s, so that eps_r is the permittivity at small fields and eps_r_high
    that beyond saturation; u = eps_high e.e/2 + P_s^2/[3 (eps - eps_high)] ln(sinh x/x).

    Parameters
    ----------
    eps_r
        Relative permittivity at small fields.
    P_s
        Polarisation in C/m^2 with all dipoles along the field.
    eps_r_high
        Relative permittivity of what does not saturate, from 1 to less than eps_r.
    breakdown
        Breakdown field in V/m, or a law of it.

    References
    ----------
    P. Langevin, Ann. Chim. Phys. 5 (1905) 70.
    """

    eps_r: float
    P_s: float
    eps_r_high: float = 1.0
    breakdown: float | Breakdown | None = None
    is_ideal: ClassVar[bool] = False
    is_linear: ClassVar[bool] = False
    constants: ClassVar[dict[str, str]] = {
        "eps_r": "permittivity", "P_s": "displacement", "eps_r_high": "permittivity"
    }  # fmt: skip

    def permittivity(self) -> float:
        return self.eps_r * EPSILON_0

    def coenergy(self, s: FieldPoint) -> Any:
        """eps_high e.e/2 + P_s^2/[3 (eps - eps_high)] ln(sinh x/x)"""
        rise = 3 * (self.eps_r - self.eps_r_high)
        dipoles = self.P_s**2 / rise * ln_sinhc(s, (rise / self.P_s) ** 2 * s.e2)
        return self.eps_r_high / 2 * s.e2 + dipoles

    def faults(self) -> list[str]:
        if found := _start(self):
            return found
        if not is_positive(self.P_s):
            return [f"P_s is {shown(self.P_s)}, but must be a finite number > 0 in C/m^2"]
        if not is_finite(self.eps_r_high) or not 1 <= self.eps_r_high < self.eps_r:
            return [f"eps_r_high is {shown(self.eps_r_high)}, but must be from 1 to below eps_r"]
        return []


Mixing = Literal[
    "maxwell-garnett", "bruggeman", "lichtenecker", "series", "parallel", "hashin-shtrikman upper"
]
"""Rules for the permittivity of a composite.

``"series"`` and ``"parallel"`` are Wiener's bounds.  Of Hashin and Shtrikman's bounds for isotropic
composites ``"maxwell-garnett"`` is the lower one where the filler has the larger permittivity, and
``"hashin-shtrikman upper"`` the other."""


def mixed_permittivity(matrix: float, filler: float, fraction: float, rule: Mixing) -> float:
    """Relative permittivity of spheres of a filler in a matrix.

    Parameters
    ----------
    matrix, filler
        Their relative permittivities.
    fraction
        Volume fraction of the filler, from 0 to 1.
    rule
        One of `Mixing`.

    Raises
    ------
    InputError
        For permittivities below 1, a fraction outside of 0 to 1, and an unknown rule.

    References
    ----------
    A. Sihvola, Electromagnetic Mixing Formulas and Applications (IEE, London, 1999).
    """
    for name, eps in (("matrix", matrix), ("filler", filler)):
        if not is_number(eps) or not is_finite(eps) or eps < 1:
            raise InputError(
                f"The relative permittivity of the {name} is {shown(eps)}, but must be a number "
                ">= 1."
            )
    if not is_number(fraction) or not 0 <= fraction <= 1:
        raise InputError(
            f"The volume fraction of the filler is {shown(fraction)}, but must be from 0 to 1."
        )
    if rule not in get_args(Mixing):
        raise InputError(
            f"There is no mixing rule {shown(rule)}; choose one of {', '.join(get_args(Mixing))}."
        )
    a, b, f = float(matrix), float(filler), float(fraction)
    if rule == "series":
        return 1 / ((1 - f) / a + f / b)
    if rule == "parallel":
        return (1 - f) * a + f * b
    if rule == "lichtenecker":
        return float(a ** (1 - f) * b**f)
    if rule == "bruggeman":
        half = ((2 - 3 * f) * a + (3 * f - 1) * b) / 4
        return float(half + (half**2 + a * b / 2) ** 0.5)
    if rule == "hashin-shtrikman upper":
        a, b, f = b, a, 1 - f
    return a + 3 * f * a * (b - a) / (b + 2 * a - f * (b - a))


@dataclass(frozen=True)
@in_si(matrix="", filler="", fraction="", breakdown="V/m")
class CompositeDielectric(Dielectric):
    """Spheres of a filler in a matrix, by a mixing rule; at all strains and fields the same.

    Parameters
    ----------
    matrix, filler
        Relative permittivities.
    fraction
        Volume fraction of the filler.
    rule
        See `Mixing`.
    breakdown
        Breakdown field in V/m, or a law of it.
    """

    matrix: float
    filler: float
    fraction: float
    rule: Mixing = "maxwell-garnett"
    breakdown: float | Breakdown | None = None

    @property
    def eps_r(self) -> float:
        """The mixed relative permittivity."""
        return mixed_permittivity(self.matrix, self.filler, self.fraction, self.rule)

    def permittivity(self) -> float:
        return self.eps_r * EPSILON_0

    def faults(self) -> list[str]:
        try:
            return _start(self)
        except InputError as error:
            return [str(error)[:-1]]
