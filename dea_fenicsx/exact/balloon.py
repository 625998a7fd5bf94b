"""A thick neo-Hookean sphere in motion under inner pressure and voltage, exact in space.

With the inner radius a, the outer one b (b^3 = a^3 + B^3 - A^3) and f = a^2 da/dt,

    rho [df/dt (1/a - 1/b) - f^2/2 (a^-4 - b^-4)]
        = P - [g(a/A) - g(b/B)] + eps V^2/2 (a^-4 - b^-4)/(1/a - 1/b)^2,

    g(s) = mu (-2/s - 1/(2 s^4)).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import is_finite, is_positive

LARGEST_RADIUS_RATIO = 20.0
"""Radii up to this many times the undeformed one are looked at."""


@dataclass(frozen=True)
@in_si(inner="m", outer="m", mu="Pa", density="kg/m**3")
class Balloon:
    """A thick sphere of an incompressible neo-Hookean dielectric.

    Parameters
    ----------
    inner, outer
        Undeformed radii A and B in m.
    mu
        Shear modulus in Pa.
    density
        Mass per volume in kg/m^3.
    permittivity
        In F/m.
    """

    inner: float
    outer: float
    mu: float
    density: float = 1000.0
    permittivity: float = 0.0

    def __post_init__(self) -> None:
        for name in ("inner", "outer", "mu", "density", "permittivity"):
            value = getattr(self, name)
            least = name == "permittivity"
            if not is_finite(value) or value < 0 or (value == 0 and not least):
                raise InputError(
                    f"Balloon: {name} is {shown(value)}, but must be a number "
                    f"{'of at least 0' if least else '> 0'}."
                )
        if self.outer <= self.inner:
            raise InputError(
                f"Balloon: the outer radius {self.outer:g} m must be larger than the inner one, "
                f"{self.inner:g} m."
            )

    def outer_radius(self, a: float) -> float:
        """Deformed outer radius in m at an inner radius a in m."""
        return float(np.cbrt(a**3 + self.outer**3 - self.inner**3))

    def push(self, a: float, pascal: float = 0.0, volts: float = 0.0) -> float:
        """Right-hand side of the equation of motion in Pa: 0 in equilibrium."""
        b = self.outer_radius(a)

        def g(s: float) -> float:
            return self.mu * (-2 / s - 1 / (2 * s**4))

        field = self.permittivity * volts**2 / 2 * (a**-4 - b**-4) / (1 / a - 1 / b) ** 2
        return pascal - (g(a / self.inner) - g(b / self.outer)) + field

    def equilibrium(self, pascal: float = 0.0, volts: float = 0.0) -> float | None:
        """Smallest inner radius in m at which it rests, stably; None beyond the limit point."""
        stretches = np.geomspace(0.2, LARGEST_RADIUS_RATIO, 4001)
        values = [self.push(s * self.inner, pascal, volts) for s in stretches]
        for k in range(len(stretches) - 1):
            if values[k] > 0 >= values[k + 1]:
                low, high = (s * self.inner for s in stretches[k : k + 2])
                return float(brentq(lambda a: self.push(a, pascal, volts), low, high, xtol=1e-15))
        return None

    def breathing(self, a: float, volts: float = 0.0) -> float:
        """Angular frequency in 1/s of breathing about an equilibrium; NaN where it grows."""
        h = 1e-5 * a
        ends = [self.push(a + k * h, 0.0, volts) for k in (-2, -1, 1, 2)]
        slope = (ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / (12 * h)
        mass = self.density * a**2 * (1 / a - 1 / self.outer_radius(a))
        return math.sqrt(-slope / mass) if slope <= 0 else math.nan

    def answer(self, omega: float, modulus: complex = 1.0) -> complex:
        """Complex da/dP in m/Pa about rest, for a complex shear modulus over `mu`."""
        A, B = self.inner, self.outer
        stiffness = 4 * self.mu * (1 / A - A**2 / B**3)
        return 1 / (stiffness * modulus - self.density * A * (1 - A / B) * omega**2)

    def largest(self, pascal: float = 0.0, volts: float = 0.0) -> tuple[float, float] | None:
        """Largest inner radius in m, and its time in s, after loads are switched on at rest.

        None if it grows beyond `LARGEST_RADIUS_RATIO` times its undeformed radius.
        """
        if not is_positive(self.push(self.inner, pascal, volts)):
            return self.inner, 0.0
        unit = self.inner * math.sqrt(self.density / self.mu)

        def rates(_: float, y: np.ndarray) -> list[float]:
            a, f = y
            b = self.outer_radius(a)
            push = self.push(a, pascal, volts) / self.density + f * f / 2 * (a**-4 - b**-4)
            return [f / a**2, push / (1 / a - 1 / b)]

        def turns(_: float, y: np.ndarray) -> float:
            return float(y[1])

        def leaves(_: float, y: np.ndarray) -> float:
            return float(y[0] - LARGEST_RADIUS_RATIO * self.inner)

        turns.terminal, turns.direction = True, -1.0  # type: ignore[attr-defined]
        leaves.terminal = True  # type: ignore[attr-defined]
        found = solve_ivp(
            rates, (0.0, 1e4 * unit), [self.inner, 0.0], rtol=1e-11, atol=1e-13 * self.inner,
            events=(turns, leaves), method="DOP853",
        )  # fmt: skip
        if not len(found.t_events[0]):
            return None
        return float(found.y_events[0][0][0]), float(found.t_events[0][0])
