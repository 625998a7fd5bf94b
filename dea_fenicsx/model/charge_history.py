"""The charge that has leaked through dielectrics and flowed in wires, from one time to the next.

Every charge is counted by the total displacement T: the electric displacement D plus the charge per
undeformed area that has passed through the dielectric by conduction,

    T = D + K,    dK/dt = omega D,    omega = g/eps,

all nominal, at quadrature points.  T has no source within the body, and its flux through an
electrode is the charge that has come through the wire.  Over a step of length dt, in which T is
taken as linear in time, D follows exactly:

    D_new = e^-z D_n + (1 - e^-z)/z (T_new - T_n),    z = omega dt,

or, solved for what the step ends with,

    T_new = psi D_new + (T_n - e^-z psi D_n),    psi = z/(1 - e^-z).

The rule is of second order, stable for any step, and exact where T is linear in time: in a
disconnected film, however it deforms, and in a film of constant voltage and shape.

A polarisation P that follows the field with a delay, dP/dt = (X - P)/tau, is added to T where there
is one; then T - P takes the place of T above.  With X = (eps_P/eps) D taken as linear in time,

    P_new = e^-z P_n + (phi - e^-z) X_n + (1 - phi) X_new,    z = dt/tau,  phi = (1 - e^-z)/z.

The charge q of a wire obeys dq/dt = current.  It follows the same rules as the viscous strains,
q_new = H + h current_new; see `model.viscous_history`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.model.viscous_history import STAGE_SHARE, Rule

SMALL_DECAY = 1e-5
"""Below it functions of z are taken from their series, which is then exact to 1e-15."""

TOTAL, FIELD, RATE = slice(0, 3), slice(3, 6), 6
"""Places of T, D and omega among the numbers of a quadrature point."""

NUMBERS = 7
"""Numbers at a quadrature point before those of the polarisations."""


def polarised(k: int) -> slice:
    """Places of the polarisation k."""
    return slice(NUMBERS + 3 * k, NUMBERS + 3 * k + 3)


def delay_weights(z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights of P_n, X_n and X_new in P_new, for z = dt/tau."""
    decay, mean = np.exp(-z), 1 / swell(z)
    return decay, mean - decay, 1 - mean


@dataclass(frozen=True, eq=False)
class ChargeHistory:
    """What dielectrics and wires remember.

    Attributes
    ----------
    leaks
        T and D, dimensionless, omega in 1/s and the polarisations at the last accepted times, the
        newest first, each of shape (cells, points, 7 + 3 polarisations).  There are no points
        where no dielectric conducts or relaxes.
    wires
        The charge in C that has come through the wire of each electrode, at the same times.
    times, span, rule
        As of `ViscousHistory`.
    closed
        Whether the switch in each electrode's wire is closed.
    """

    leaks: tuple[np.ndarray, ...]
    wires: tuple[np.ndarray, ...]
    times: tuple[float, ...]
    closed: tuple[bool, ...]
    span: float = 0.0
    rule: Rule = Rule.BDF2

    @property
    def levels(self) -> int:
        """Number of accepted times that are known."""
        return len(self.times)

    @property
    def settled(self) -> bool:
        """Whether it is that of an accepted state."""
        return self.span == 0

    @property
    def passes_time(self) -> bool:
        """Whether the present state lies later than the history, by a finite time."""
        return 0 < self.span < np.inf

    def restarted(self) -> ChargeHistory:
        """The same without earlier values, for the rates jump here."""
        return replace(self, leaks=self.leaks[:1], wires=self.wires[:1], times=self.times[:1])

    def ahead(self, span: float, rule: Rule = Rule.BDF2) -> ChargeHistory:
        """The same for a state that lies later by a time in s.

        Leakage is of second order, so that wires follow BDF2 where viscous strains follow BDF3.
        """
        return replace(self, span=span, rule=Rule.BDF2 if rule is Rule.BDF3 else rule)

    def switched(self, wire: int, closed: bool) -> ChargeHistory:
        """The same with a switch in another position."""
        flags = list(self.closed)
        flags[wire] = closed
        return replace(self, closed=tuple(flags))

    @property
    def begin(self) -> int:
        """Place of the level at which the whole step began."""
        return 1 if self.rule is Rule.STAGE and self.passes_time else 0

    @property
    def whole_span(self) -> float:
        """Length in s of the whole step that ends in the present state; 0 if no time passes."""
        if not self.passes_time:
            return 0.0
        return self.span / STAGE_SHARE if self.rule is Rule.STAGE else self.span

    def combined(self, q: Sequence[np.ndarray]) -> np.ndarray:
        """H of the step to the present state, for q = H + h dq/dt, from q at the times known."""
        if not self.passes_time or self.rule is Rule.EULER or len(q) < 2:
            return q[0]
        if self.rule is Rule.STAGE:
            return q[1] + (1 - STAGE_SHARE) / STAGE_SHARE * (q[0] - q[1])
        w = self._growth
        return ((1 + w) ** 2 * q[0] - w**2 * q[1]) / (1 + 2 * w)

    @property
    def _growth(self) -> float:
        """Length of the step to the present state over that of the step before."""
        return self.span / (self.times[0] - self.times[1])

    @property
    def rule_length(self) -> float:
        """h in s of the same step; 0 if no time passes."""
        if not self.passes_time:
            return 0.0
        if self.rule is not Rule.BDF2 or self.levels < 2:
            return self.span
        return self.span * (1 + self._growth) / (1 + 2 * self._growth)

    def rate(self) -> np.ndarray:
        """omega in 1/s in the middle of the whole step, continued from the rates before."""
        here = self.begin
        now = self.leaks[here][..., RATE]
        if self.rule is Rule.STAGE and self.passes_time:
            ahead, since = self.leaks[0][..., RATE] - now, self.span
        elif self.levels > 1 and self.passes_time:
            ahead, since = now - self.leaks[1][..., RATE], self.times[0] - self.times[1]
        else:
            return np.asarray(now)
        middle = now + self.whole_span / 2 / since * ahead
        return np.asarray(np.clip(middle, now / 4, 4 * now))


def swell(z: np.ndarray) -> np.ndarray:
    """psi = z/(1 - e^-z), which is at least 1."""
    safe = np.maximum(z, SMALL_DECAY)
    return np.where(z < SMALL_DECAY, 1 + z / 2 + z**2 / 12, -safe / np.expm1(-safe))


def bend_weight(z: np.ndarray) -> np.ndarray:
    """What D misses, in units of dt^2 times the second derivative of T: about z/12.

    It is the integral of e^(-z (1 - s)) (s - 1/2) over s from 0 to 1.
    """
    safe = np.maximum(z, 1e-2)
    exact = (1 + np.exp(-safe)) / (2 * safe) + np.expm1(-safe) / safe**2
    return np.where(z < 1e-2, z / 12 - z**2 / 24, exact)
