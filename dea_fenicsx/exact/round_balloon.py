"""A thick sphere under voltage: its round states, and the shapes at which they lose stability.

The rubber fills the sphere between the radii A and B, with electrodes on both faces.  With the
inner radius a, the outer one b (b^3 = a^3 + B^3 - A^3) and the stretch s = r/R, a round state is in
equilibrium if, for a constant permittivity,

    integral of 2 (t_s - t_r)/r dr from a to b = eps V^2/2 (a^-4 - b^-4)/(1/a - 1/b)^2,

where t_s, t_r are the elastic stresses along the sphere and through it at the stretches s and s^-2.

Next to a round state lie those with the displacement (U(r) P_n, V(r) dP_n/dtheta), where P_n is the
Legendre polynomial of cos(theta), and with the potential phi(r) P_n.  Shapes of different n do not
mix.  Incompressibility gives V = (r U' + 2 U)/(n (n + 1)), and what is left of the energy's second
variation is a quadratic form in U and phi.  Both are polynomials in r here, so that the form is
a small matrix.  A round state is stable against the shapes n if, after the potential is eliminated,
no eigenvalue of it is negative.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
from numpy.polynomial import legendre
from scipy.optimize import brentq

from dea_fenicsx.exact.film_field import FilmField
from dea_fenicsx.exact.states import of_kept_volume, without_time
from dea_fenicsx.materials import Material
from dea_fenicsx.materials.stretches import taylor
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import is_finite, is_positive, is_whole

RADIAL_DEGREE = 8
"""Degree of the polynomials in the radius."""

DEGREE_IN_THIN_WALLS = 5
"""The same in a wall thinner than `LARGEST_THIN_WALL` inner radii.

There it is exact enough, and second derivatives of higher polynomials would let rounding decide on
the sign of a stiffness that is the difference of much larger ones.
"""

LARGEST_THIN_WALL = 0.03
"""Thickness, in inner radii, below which a deformed wall is thin."""

GAUSS_POINTS_OF_RADIUS = 16
"""Number of Gauss points in the radius."""

SMALLEST_FIELD, LARGEST_FIELD = 1e-3, 1e10
"""True fields in V/m at the inner face between which a round state is sought."""

SAMPLED_RADII = 120
"""Number of radii at which the sign of a function is computed before its roots are refined."""


@dataclass(frozen=True)
class RoundState:
    """A round state.

    Attributes
    ----------
    radius
        Inner radius in m.
    volts
        Voltage in V.
    """

    radius: float
    volts: float


@dataclass(frozen=True)
class RoundnessChange:
    """A round state at which the shapes of one number n become unstable, or stable again.

    Attributes
    ----------
    mode
        The number n of the Legendre polynomial; 1 is a cavity that leaves the centre.
    state
        The round state.
    loses
        Whether they become unstable as the sphere grows.
    """

    mode: int
    state: RoundState
    loses: bool


@dataclass(frozen=True)
@in_si(inner="m", outer="m")
class RoundBalloon:
    """A thick sphere of an incompressible dielectric elastomer.

    Its stability is known for a constant permittivity only.

    Parameters
    ----------
    inner, outer
        Undeformed radii A and B in m.
    material
        The rubber, without viscous branches.

    Raises
    ------
    InputError
        If a radius is not positive, or the outer one is not the larger one.
    """

    inner: float
    outer: float
    material: Material

    def __post_init__(self) -> None:
        for name in ("inner", "outer"):
            value = getattr(self, name)
            if not is_finite(value) or not is_positive(value):
                raise InputError(
                    f"RoundBalloon: {name} is {shown(value)}, but must be a number > 0."
                )
        if self.outer <= self.inner:
            raise InputError(
                f"RoundBalloon: the outer radius {self.outer:g} m must be larger than the inner "
                f"one, {self.inner:g} m."
            )
        if not isinstance(self.material, Material):
            raise InputError(
                f"RoundBalloon: material is {shown(self.material)}, but must be a dea.Material."
            )
        without_time(self.material, "RoundBalloon()")
        of_kept_volume(self.material, "RoundBalloon()")

    def at(self, radius: float) -> RoundState:
        """The round state with an inner radius in m (at least the undeformed one)."""
        if not is_finite(radius) or radius < self.inner:
            raise InputError(
                f"RoundBalloon.at: the inner radius is {shown(radius)}, but must be a number of "
                f"at least the undeformed one, {self.inner:g} m."
            )
        return RoundState(float(radius), _Wall(self, float(radius)).volts)

    def limits(self, largest: float) -> list[RoundState]:
        """Maxima and minima of the voltage, up to a largest inner radius in m.

        They are in the order in which a growing sphere meets them.
        """
        radii = np.linspace(self.inner, largest, SAMPLED_RADII)[1:]
        step = 1e-4 * self.inner

        def slope(a: float) -> float:
            return (_Wall(self, a + step).volts - _Wall(self, a - step).volts) / step

        found = _sign_changes(slope, radii)
        return [self.at(a) for a, _ in found]

    def is_stable(self, radius: float, mode: int) -> bool:
        """Whether the round state resists the shapes of a number n, at kept voltage."""
        return self._softest(radius, _whole(mode)) > 0

    def _softest(self, radius: float, mode: int) -> float:
        return _Wall(self, radius).softest(mode)

    def shape_changes(
        self, largest: float, modes: tuple[int, ...] = (1, 2, 3, 4, 5)
    ) -> list[RoundnessChange]:
        """Where the shapes of some numbers n become unstable or stable, in the order of growth.

        Parameters
        ----------
        largest
            Largest inner radius in m that is looked at.
        modes
            The numbers n, each at least 1.
        """
        radii = np.linspace(self.inner, largest, SAMPLED_RADII)[1:]
        found = []
        for n in modes:
            number = _whole(n)
            changes = _sign_changes(partial(self._softest, mode=number), radii)
            found += [RoundnessChange(number, self.at(a), not rises) for a, rises in changes]
        return sorted(found, key=lambda change: change.state.radius)


def _whole(mode: int) -> int:
    if not is_whole(mode, 1):
        raise InputError(f"RoundBalloon: a mode is {shown(mode)}, but must be at least 1.")
    return int(mode)


def _sign_changes(
    function: Callable[[float], float], radii: np.ndarray
) -> list[tuple[float, bool]]:
    """Roots of a function of the radius, each with whether the function rises there."""
    values = [function(a) for a in radii]
    found = []
    for k in range(len(radii) - 1):
        if values[k] * values[k + 1] < 0:
            root = brentq(function, radii[k], radii[k + 1], xtol=1e-12 * radii[0], rtol=1e-12)
            found.append((float(root), bool(values[k + 1] > 0)))
    return found


class _Wall:
    """The wall of a round state at the Gauss points of its radius.

    Lengths are in units of the inner radius A, stresses in units of the shear modulus.

    Parameters
    ----------
    balloon
        The sphere.
    radius
        Inner radius in m.
    """

    def __init__(self, balloon: RoundBalloon, radius: float) -> None:
        material, A = balloon.material, balloon.inner
        mu = material.elastic.shear_modulus()
        self.a, a = radius / A, radius / A
        self.b = b = float(np.cbrt(a**3 + (balloon.outer / A) ** 3 - 1))
        self.count = 1 + (RADIAL_DEGREE if b - a > LARGEST_THIN_WALL * a else DEGREE_IN_THIN_WALLS)
        self.x, weights = legendre.leggauss(GAUSS_POINTS_OF_RADIUS)
        self.r = r = a + (b - a) * (self.x + 1) / 2
        self.weights = weights * (b - a) / 2
        e = np.log(r / np.cbrt(r**3 - a**3 + 1))
        _, R, H = taylor(material.elastic, np.stack([-2 * e, e, e]))
        self.R, self.H = np.asarray(R) / mu, np.asarray(H) / mu
        self.squares = np.exp(2 * np.stack([-2 * e, e, e]))
        wall = float(self.weights @ (2 * (self.R[1] - self.R[0]) / r))
        law = material.dielectric
        self.is_ideal = law.is_ideal
        if not law.is_ideal:
            self.volts = self._volts(FilmField(law), np.stack([e, e, -2 * e]), wall * mu, A)
            return
        # The wall's pressure, and that of the charges per V^2, in units of A sqrt(mu/eps).
        drop = 1 / a - 1 / b
        volts = math.copysign(math.sqrt(abs(2 * wall / (a**-4 - b**-4))) * drop, wall)
        self.volts = volts * A * math.sqrt(mu / law.permittivity())
        self.field = volts / drop / r**2
        # Radial stress from the outer face, where it vanishes, by the polynomial of its slope.
        slope = 2 / r * (self.R[1] - self.R[0] - self.field**2)
        slopes = legendre.legfit(self.x, slope, GAUSS_POINTS_OF_RADIUS - 1)
        series = legendre.legint(slopes) * (b - a) / 2
        outward = legendre.legval(self.x, series) - legendre.legval(1.0, series)
        self.pressure = self.R[0] + self.field**2 / 2 - outward

    def _volts(self, electric: FilmField, e: np.ndarray, wall: float, unit: float) -> float:
        """Voltage in V that carries the wall, for a permittivity that changes.

        Parameters
        ----------
        electric
            The dielectric.
        e
            Logarithms of the stretches along, along and through the sphere, shape (3, N).
        wall
            Integral of 2 (t_s - t_r)/r in Pa, of the elastic stresses.
        unit
            Inner radius A in m.
        """
        if wall == 0:
            return 0.0
        push = electric.push(e)
        shares = self.weights * 2 * (push[0] - push[2]) / self.r
        inner = e[:, :1]  # where the field is largest

        def fields(log_field: float) -> np.ndarray:
            E = np.array([math.exp(log_field)])
            flux = electric.maxwell(inner, E) / E * self.r[0] ** 2
            # Of a saturated part, the displacement does not tell the field, so that E stays.
            return np.concatenate([E, electric.field_of(e[:, 1:], flux / self.r[1:] ** 2)])

        def missing(log_field: float) -> float:
            return float(shares @ electric.maxwell(e, fields(log_field))) - abs(wall)

        ends = math.log(SMALLEST_FIELD), math.log(LARGEST_FIELD)
        if missing(ends[1]) < 0:
            raise InputError(
                f"RoundBalloon.at: no field up to {LARGEST_FIELD:g} V/m carries the wall at "
                f"{self.a:g} times its inner radius; ask for a smaller one."
            )
        E = fields(brentq(missing, *ends, xtol=1e-14, rtol=1e-14))
        return math.copysign(float(self.weights @ E) * unit, wall)

    def softest(self, n: int) -> float:
        """Smallest eigenvalue of the second variation against shapes of a number n.

        The potential is eliminated, and the shapes are measured by their displacements.
        """
        if not self.is_ideal:
            raise InputError(
                "RoundBalloon: the stability of a sphere is known for one permittivity at all "
                "strains and fields; take IdealDielectric, or finite elements."
            )
        K, mass = self._form(n)
        m = self.count
        stiffness = K[:m, :m] - K[:m, m:] @ np.linalg.solve(K[m:, m:], K[m:, :m])
        chosen = np.eye(m)
        if n == 1:  # A translation costs nothing, so the outer face keeps its place.
            ends, slopes = _basis(m, (1.0,), self.b - self.a)[:2]
            held = (self.b * slopes + 2 * ends)[:, 0]
            chosen = np.linalg.svd(held[None])[2][1:].T
        lower = np.linalg.cholesky(chosen.T @ mass[:m, :m] @ chosen)
        half = np.linalg.solve(lower, chosen.T @ stiffness @ chosen)
        return float(np.linalg.eigvalsh(np.linalg.solve(lower, half.T))[0])

    def _form(self, n: int) -> tuple[np.ndarray, np.ndarray]:
        """The second variation in U and phi, and the scalar product of displacements.

        With the displacement's gradient h and the potential's gradient e, twice its density is

            A[h, h] + (p + E^2/2) tr(h h) - |e - E h_r.|^2 + 2 E (h e)_r - 2 E^2 (h h)_rr.
        """
        r, N, E = self.r, n * (n + 1), self.field
        m = self.count
        U, slope, bend = _basis(m, tuple(self.x), self.b - self.a)
        V, V_slope = (r * slope + 2 * U) / N, (r * bend + 3 * slope) / N
        potential, potential_slope = (p[2:] - p[np.arange(2, m) % 2] for p in (U, slope))
        zeros = np.zeros_like(potential)
        u, v = (np.concatenate([f, zeros]) for f in (U, V))
        h_rr, h_rt, h_tr = (
            np.concatenate([f, zeros]) for f in (slope, (U - V) / r, V_slope)
        )  # fmt: skip
        e_r, e_t = (
            np.concatenate([np.zeros_like(U), f]) for f in (potential_slope, potential / r)
        )  # fmt: skip
        weights = self.weights * r**2

        def pair(f: np.ndarray, g: np.ndarray, factor: np.ndarray | float) -> np.ndarray:
            product = (f * (weights * factor)) @ g.T
            return (product + product.T) / 2

        def around(factor: np.ndarray) -> np.ndarray:
            """Of the squares h_tt^2 + h_pp^2, integrated over the sphere."""
            per = factor / r**2
            return pair(u, u, 2 * per) - pair(u, v, 2 * N * per) + pair(v, v, (N * N - N) * per)

        R, H = self.R, self.H
        iso = H - np.einsum("ij,j...->ij...", np.eye(3), R)  # s_i s_j d2W/ds_i ds_j
        shear = self._shears()
        both = shear[0] - R[1]
        pressed = self.pressure + E**2 / 2
        # h_tt + h_pp = -h_rr; the squares and the product of the two are told apart by
        # 2 h_tt h_pp = h_rr^2 - h_tt^2 - h_pp^2.
        K = pair(h_rr, h_rr, iso[0, 0] - 2 * iso[0, 1] + iso[1, 2]) + around(iso[1, 1] - iso[1, 2])
        K += pair(h_rt, h_rt, N * shear[0]) + pair(h_tr, h_tr, N * shear[1])
        K += pair(h_rt, h_tr, 2 * N * both)
        K += pair(h_rr, h_rr, pressed) + around(pressed) + pair(h_rt, h_tr, 2 * N * pressed)
        K -= pair(e_r - E * h_rr, e_r - E * h_rr, 1.0) + pair(e_t - E * h_rt, e_t - E * h_rt, N)
        K += pair(h_rr, e_r, 2 * E) + pair(h_tr, e_t, 2 * N * E)
        K -= pair(h_rr, h_rr, 2 * E**2) + pair(h_tr, h_rt, 2 * N * E**2)
        return K, pair(u, u, 1.0) + pair(v, v, N)

    def _shears(self) -> tuple[np.ndarray, np.ndarray]:
        """Stiffness against h_rt, and against h_tr."""
        R, s = self.R, self.squares
        gap = s[1] - s[0]
        # Unstrained rubber has no gap; its shear modulus is 1 in these units.
        safe = np.where(gap > 1e-9, gap, 1.0)
        ratio = np.where(gap > 1e-9, (R[1] - R[0]) / safe, 1.0)
        return ratio * s[1], ratio * s[0]


def _basis(
    count: int, x: tuple[float, ...], length: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Legendre polynomials of a radius and their first two derivatives, shape (count, points)."""
    values, slopes, bends = _legendre(count, x)
    return values, slopes * 2 / length, bends * (2 / length) ** 2


@lru_cache(maxsize=8)
def _legendre(count: int, x: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    points, rows = np.array(x), np.eye(count)
    values, slopes, bends = (
        np.array([legendre.legval(points, legendre.legder(c, k)) for c in rows])
        for k in range(3)
    )
    return values, slopes, bends
