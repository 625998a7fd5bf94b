"""Cone: a pre-stretched annular membrane between a rigid disc and a rigid ring, under a force.

The film, of undeformed radii A and B and thickness H, is stretched by lp in all directions of its
plane and glued to a disc of radius lp A and to a ring of radius lp B.  A force F pulls the disc
along the axis, and a voltage V acts through the thickness.  In the limit H/B -> 0, with lengths in
units of B, stresses in units of the neo-Hookean modulus mu, q = F/(2 pi mu H B) and
e = (V/H) sqrt(eps/mu), the undeformed radius R has the place r, z and the slope t:

    d(R s1 cos t)/dR = s2,    R s1 sin t = q,    tan t = z'/r',
    s_i = (lam_i^2 - lam_3^2 - e^2/lam_3^2)/lam_i,
    lam_1 = sqrt(r'^2 + z'^2),  lam_2 = r/R,  lam_3 = 1/(lam_1 lam_2).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize_scalar

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import is_number, shown

PRECISION = 1e-11
"""Relative error of the integration."""

TENSIONS = np.array([*np.arange(0.0, 1.55, 0.1), 2.0, 2.5, 5.0, 10.0])
"""Tensions at the disc that are tried one after another, over a size of theirs."""


def _bracket(
    tried: Sequence[tuple[float, float]], beyond: Callable[[float], float]
) -> tuple[float, float] | None:
    """Two tensions between which the end comes to the ring from within, or None.

    Parameters
    ----------
    tried
        The last tensions, up to three, each with the distance of the end beyond the ring.
    beyond
        This distance as a function.
    """
    if len(tried) < 2 or not np.all(np.isfinite([value for _, value in tried])):
        return None  # the end is at infinity where a stress loses its tension: a jump, no root
    (low, a), (high, b) = tried[-2:]
    if a <= 0 <= b:
        return low, high
    if len(tried) == 3 and tried[0][1] < a > b and a < 0:  # the largest place lies between
        top = minimize_scalar(
            lambda start: -beyond(start), bounds=(tried[0][0], high), method="bounded",
            options={"xatol": 1e-9 * high},
        )  # fmt: skip
        if top.fun <= 0:
            return tried[0][0], float(top.x)
    return None


@dataclass(frozen=True)
class Cone:
    """A cone in the limit of a thin membrane; see this module for its equations and units.

    Parameters
    ----------
    prestretch
        lp.
    force
        q = F/(2 pi mu H B).
    field
        e = (V/H) sqrt(eps/mu), of the undeformed thickness.
    inner
        A/B.
    """

    prestretch: float
    force: float
    field: float = 0.0
    inner: float = 0.3

    def __post_init__(self) -> None:
        for name in ("prestretch", "force", "field", "inner"):
            value = getattr(self, name)
            if not is_number(value) or not np.isfinite(float(value)):
                raise InputError(f"{name}= of Cone is {shown(value)}, but must be a finite number.")
        if not self.prestretch > 0:
            raise InputError(f"prestretch= of Cone is {self.prestretch:g}, but must be > 0.")
        if not 0 < self.inner < 1:
            raise InputError(f"inner= of Cone is {self.inner:g}, but must lie between 0 and 1.")

    def deflection(self) -> float:
        """Displacement of the disc along the force in units of B.

        Raises
        ------
        InputError
            If there is no state of equilibrium in which the membrane is taut.
        """
        if self.force == 0:
            return 0.0
        return float(self._integrate(self._start())[1])

    def _start(self) -> float:
        """R s1 cos t at the disc, for which the outer end reaches the ring."""

        def beyond(start: float) -> float:
            return float(self._integrate(start)[0]) - self.prestretch

        lam, e = self.prestretch, self.field
        tension = self.inner * (lam - lam**-5 - e**2 * lam**3)
        size = abs(self.force) + abs(tension)
        # With the tension at the disc the end moves out, under a field only up to a largest place.
        # The first root is stable.  Pull-in is where the largest place is that of the ring.
        found: list[tuple[float, float]] = []
        for start in size * TENSIONS:
            found.append((start, beyond(start)))
            bracket = _bracket(found[-3:], beyond)
            if bracket is not None:
                return float(brentq(beyond, *bracket, xtol=1e-14 * size, rtol=1e-13))
        raise InputError(
            f"The cone of pre-stretch {lam:g} has no taut state at the force {self.force:g} and "
            f"the field {e:g}; lower the field or raise the pre-stretch."
        )

    def _integrate(self, start: float) -> tuple[float, float]:
        """r at the ring, and the deflection; r is infinite where a stress loses its tension."""
        if 1 - (self.field * self.prestretch) ** 2 <= 0:
            return np.inf, np.inf

        def rates(R: float, y: np.ndarray) -> list[float]:
            r, h, _ = y
            around = r / R
            s1 = float(np.hypot(h, self.force)) / R
            lam = self._meridian(s1, around)
            cos, sin = h / (R * s1), self.force / (R * s1)
            s2 = around - around**-3 * lam**-2 - self.field**2 * around * lam**2
            return [lam * cos, s2, lam * sin]

        y = [self.prestretch * self.inner, start, 0.0]
        done = solve_ivp(rates, (self.inner, 1.0), y, "DOP853", rtol=PRECISION, atol=1e-13)
        r, _, z = done.y[:, -1]
        return (r, z) if done.success and np.isfinite(r) else (np.inf, np.inf)

    def _meridian(self, s1: float, around: float) -> float:
        """lam_1 at a stress: the root of lam (1 - e^2 lam_2^2) - lam^-3 lam_2^-2 = s1."""
        softened = 1 - (self.field * around) ** 2
        if softened <= 0:
            return np.nan
        lam = max((s1 + 1) / softened, 1.0)
        for _ in range(100):  # Newton's method from above converges monotonically: it is concave
            rest = softened * lam - lam**-3 * around**-2 - s1
            new = lam - rest / (softened + 3 * lam**-4 * around**-2)
            if new <= 0:
                new = lam / 2
            if abs(new - lam) < 1e-15 * lam:
                return new
            lam = new
        return lam
