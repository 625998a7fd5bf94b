"""Pull-in times of many drives at once: a field that is raised at a rate and then held.

All drives are integrated together, each with steps of its own.  With one free logarithmic stretch
y, the stiffness K, the residual's rate r at kept y and the rates g of the branches' logarithms a,

    dt/ds = K,   dy/ds = -r,   da/ds = g K,

which stays smooth where equilibrium is lost, at K = 0.  The method is the extrapolated linearly
implicit Euler method: of high order, and fit for relaxation times much shorter than the course.
Deuflhard, SIAM Rev. 27 (1985) 505; Hairer and Wanner, Solving ODEs II (1996), section IV.9.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq

from dea_fenicsx.exact.equilibrium import Equations
from dea_fenicsx.exact.film import Dead, Film
from dea_fenicsx.exact.film_drive import checked_seconds
from dea_fenicsx.exact.limits import instantaneous, relaxed
from dea_fenicsx.materials.viscous import closed_branches
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import si

EXTRAPOLATION_ORDER = 6
"""Number of columns of the extrapolation, which is its order."""

MAP_TOLERANCE = 1e-10
"""Error of a step: absolute in logarithms of stretches, relative in time."""

RAMP_END_TOLERANCE = 1e-11
"""The end of the ramp is reached if the remaining time is a smaller share of the ramp than this."""

NEGLIGIBLE_STIFFNESS = 1e-9
"""A stiffness below this, over the sum of all moduli, counts as 0; the time is exact to its
square.
"""

LONGEST_WALK = 3000
"""Most steps of a drive."""

SAMPLED_FORCES = 6000
"""Number of stretches at which elastic forces are sampled; a cubic between them is exact to
1e-12.
"""


@dataclass(frozen=True, eq=False)
class PullInMap:
    """Pull-in of a film for many drives; all arrays of the same shape.

    Attributes
    ----------
    held : nominal field in V/m up to which it is raised and at which it is held
    rate : rate in V/(m s); infinite where the field is switched on
    time : time from the start to pull-in in s; infinite where there is none within the seconds
    field : nominal field at pull-in in V/m; NaN where there is none
    stretch : free stretch at pull-in; NaN where there is none
    """

    held: np.ndarray
    rate: np.ndarray
    time: np.ndarray
    field: np.ndarray
    stretch: np.ndarray


def pull_in_map(
    film: Film,
    field: Any,
    rate: Any = np.inf,
    *,
    seconds: float,
    start: Literal["undeformed", "relaxed"] = "undeformed",
) -> PullInMap:
    """Times to pull-in under fields that are raised at given rates and then held.

    Parameters
    ----------
    film
        An incompressible film with one free stretch: two equal sides, or one of them held.
    field, rate
        Nominal fields V/T in V/m and their rates in V/(m s); they broadcast.  An infinite rate
        (the default) switches the field on at the start: creep to pull-in.
    seconds
        How long to wait for pull-in, from the start.
    start
        ``"undeformed"`` or ``"relaxed"``, as in `march`: what the film has rested in before.

    Raises
    ------
    InputError
        For a film with more than one free stretch, and numbers without sense.
    """
    seconds = checked_seconds(si(seconds, "s", "The duration"))
    held, rates = np.broadcast_arrays(
        np.asarray(si(field, "V/m", "The field"), float), np.asarray(rate, float)
    )
    if not (np.all(np.isfinite(held)) and np.all(held >= 0) and np.all(rates > 0)):
        raise InputError("A map of pull-in needs finite fields >= 0 and rates > 0.")
    if start not in ("undeformed", "relaxed"):
        raise InputError(f'The start is {start!r}, but must be "undeformed" or "relaxed".')
    line = _Line(film, start)
    walk = _Walk(line, held.ravel(), rates.ravel(), seconds)
    walk.run()
    found = (walk.found_time, walk.found_field, walk.found_stretch)
    return PullInMap(held.copy(), rates.copy(), *(x.reshape(held.shape) for x in found))


class _Line:
    """Equations of a film along its one free logarithmic stretch y."""

    def __init__(self, film: Film, start: str):
        rest = Equations(relaxed(film))
        if not film.incompressible or rest.n != 1:
            raise InputError(
                "A map of pull-in needs an incompressible film with one free stretch: two equal "
                "sides, or one of them held."
            )
        law = film.material.dielectric
        if not law.is_linear:
            raise InputError(
                f"A map of pull-in needs a permittivity that does not change with the field, but "
                f"that of {type(law).__name__} does; call exact.march for each drive."
            )
        branches = closed_branches(film.material, "A map of pull-in")
        self.film, self.b, self.e0 = film, rest.B[:, 0], rest.e0
        self.mu = np.array([x.mu for x in branches]).reshape(-1, 1, 1)
        self.tau = np.array([x.tau for x in branches]).reshape(-1, 1, 1)
        self.count = len(branches)
        if start == "relaxed":
            self.y0 = float(rest.rest()[0][0])
            e = rest.e(np.array([self.y0]))
            self.a0 = np.broadcast_to(2 * e[:, None], (self.count, 3, 1))
        else:
            self.y0 = float(Equations(instantaneous(film)).rest()[0][0])
            self.a0 = np.zeros((self.count, 3, 1))
        self.scale = film.material.elastic.shear_modulus() + float(self.mu.sum())
        self._sample(rest)

    def _sample(self, rest: Equations) -> None:
        """Forces of the elastic energy and of the sides along the line, as a spline."""
        y = self.y0 + np.linspace(-0.3, 2.5, SAMPLED_FORCES)
        e = self.e0[:, None] + self.b[:, None] * y
        inside = self.film.margin(e) > 1e-3
        y, e = y[inside], e[:, inside]
        _, R, H = self.film.elastic(e)
        force = self.b @ R
        slope = np.einsum("i,ijn,j->n", self.b, H, self.b)
        for k, side in enumerate(self.film.sides):
            if self.b[k]:
                pull = side.pascal * (np.exp(e[k]) if isinstance(side, Dead) else 1.0)  # type: ignore
                force = force - self.b[k] * pull
                slope = slope - self.b[k] ** 2 * pull * isinstance(side, Dead)
        force, slope = force / self.scale, slope / self.scale
        self.elastic = CubicHermiteSpline(y, force, slope, extrapolate=False)
        self.stiffness = self.elastic.derivative()
        eps, g, h = self.film.electric.strain_part(e)
        pull = self.b @ self.film.push(e)
        size = eps * np.exp(-2 * e[2]) / self.scale
        slope = size * (pull * (self.b @ g - 2 * self.b[2])
                        + np.einsum("i,ijn,j->n", self.b, h, self.b) / 2)  # fmt: skip
        self.field_term = CubicHermiteSpline(y, size * pull, slope, extrapolate=False)
        self.field_slope = self.field_term.derivative()

    def springs(self, y: np.ndarray, a: np.ndarray) -> np.ndarray:
        e = self.e0[:, None] + self.b[:, None] * y
        return np.exp(2 * e - a)

    def forces(self, y: np.ndarray, x: np.ndarray, E: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residual and stiffness."""
        b = self.b[:, None] * self.mu / self.scale
        F = self.elastic(y) + (b * x).sum(axis=(0, 1)) - self.field_term(y) * E**2
        K = self.stiffness(y) + (2 * b * self.b[:, None] * x).sum(axis=(0, 1))
        return F, K - self.field_slope(y) * E**2


    def frozen_branch(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Stretches y and squares of the field at frozen branches, up to the peak, and its y."""

        def square(y: np.ndarray) -> np.ndarray:
            F, _ = self.forces(y, self.springs(y, self.a0), np.zeros(1))
            return np.maximum(F / self.field_term(y), 0)

        def stiffness(y: float) -> float:
            at = np.array([y])
            return float(self.forces(at, self.springs(at, self.a0), np.sqrt(square(at)))[1][0])

        y = np.linspace(self.y0, self.elastic.x[-1], 20000)
        falls = np.flatnonzero(np.diff(square(y)) <= 0)
        falls = falls[falls > 1]
        if not len(falls):
            return y, square(y), float(y[-1])
        k = int(falls[0])
        peak = float(brentq(stiffness, y[k - 1], y[k + 1], xtol=1e-15, rtol=1e-14))
        y = np.append(y[:k], peak)
        values = square(y)
        return y, np.minimum(np.maximum.accumulate(values), values[-1]), peak


class _Walk:
    """Steps of all drives together."""

    def __init__(self, line: _Line, held: np.ndarray, rate: np.ndarray, seconds: float):
        self.line, self.held, self.rate, self.seconds = line, held, rate, seconds
        # with equal directions one logarithm of each branch says all
        self.own = 1 if line.b[0] == line.b[1] else 2
        self.size = line.count * self.own + 2
        n = len(held)
        self.found_time = np.full(n, np.inf)
        self.found_field = np.full(n, np.nan)
        self.found_stretch = np.full(n, np.nan)
        self.on_ramp = np.isfinite(rate)
        self.u = np.zeros((n, self.size))
        a = line.a0[:, : self.own, 0].ravel()
        self.u[:, : len(a)] = a
        self.u[:, -2] = line.y0
        self.active = np.ones(n, dtype=bool)
        self._switch_on()

    def _switch_on(self) -> None:
        """Equilibria just after the start, at frozen branches, of fields that are switched on."""
        line, at_once = self.line, np.flatnonzero(~self.on_ramp)
        if not len(at_once):
            return
        y, square, y_peak = line.frozen_branch()
        top = float(square[-1])
        lost = self.held[at_once] ** 2 >= top
        gone = at_once[lost]
        self.active[gone] = False
        self.found_time[gone] = 0.0
        self.found_field[gone] = np.sqrt(top)
        self.found_stretch[gone] = self._stretch(np.array([y_peak]))[0]
        rest = at_once[~lost]
        if not len(rest):
            return
        E = self.held[rest]
        # over the square root of the distance to the peak the branch is nearly straight there
        found = np.interp(-np.sqrt(top - E**2), -np.sqrt(top - square), y)
        for _ in range(30):
            F, K = line.forces(found, line.springs(found, line.a0), E)
            found = found - np.where(K > 0, F / np.where(K > 0, K, 1.0), 0.0)
        self.u[rest, -2] = found

    def _stretch(self, y: np.ndarray) -> np.ndarray:
        k = 0 if self.line.b[0] else 1
        return np.exp(self.line.e0[k] + self.line.b[k] * y)

    # ------------------------------------------------------------------ equations

    def rates(self, u: np.ndarray, who: np.ndarray) -> np.ndarray:
        """du/ds of states, shape (N, size)."""
        line, own = self.line, self.own
        t, y = u[:, -1], u[:, -2]
        a = u[:, :-2].T.reshape(line.count, own, -1)
        rest = [a, -2 * a] if own == 1 else [-a.sum(axis=1, keepdims=True)]
        a = np.concatenate([a, *rest], axis=1)
        ramp = self.on_ramp[who]
        Edot = np.where(ramp, self.rate[who], 0.0)
        E = np.where(ramp, np.where(ramp, self.rate[who], 0.0) * t, self.held[who])
        x = line.springs(y, a)
        _, K = line.forces(y, x, E)
        adot = (x - x.mean(axis=1, keepdims=True)) / line.tau
        b = line.b[:, None] * line.mu / line.scale
        r = -(b * x * adot).sum(axis=(0, 1)) - 2 * line.field_term(y) * E * Edot
        out = np.empty_like(u)
        out[:, :-2] = (adot[:, :own] * K).reshape(-1, len(u)).T
        out[:, -2] = -r
        out[:, -1] = K
        return out

    def jacobian(self, u: np.ndarray, f: np.ndarray, who: np.ndarray) -> np.ndarray:
        """Derivative of the rates by forward differences, shape (N, size, size)."""
        J = np.empty((len(u), self.size, self.size))
        for k in range(self.size):
            step = 1e-7 * (1.0 if k < self.size - 1 else 1.0 + np.abs(u[:, -1]))
            moved = u.copy()
            moved[:, k] += step
            J[:, :, k] = (self.rates(moved, who) - f) / np.reshape(step, (-1, 1))
        return J

    def trial(self, u: np.ndarray, h: np.ndarray, who: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A step of length h for each drive, and the error of each, relative to the tolerance."""
        f = self.rates(u, who)
        J = self.jacobian(u, f, who)
        good = np.isfinite(J).all(axis=(1, 2))
        J[~good] = 0.0
        table: list[np.ndarray] = []
        unit = np.eye(self.size)
        for j in range(EXTRAPOLATION_ORDER):
            n = j + 2
            inverse = np.linalg.inv(unit - (h / n)[:, None, None] * J)
            v = u + np.einsum("nij,nj->ni", inverse, f) * (h / n)[:, None]
            for _ in range(n - 1):
                v = v + np.einsum("nij,nj->ni", inverse, self.rates(v, who)) * (h / n)[:, None]
            row = [v]
            for k in range(j):
                row.append(row[k] + (row[k] - table[k]) / ((j + 2) / (j + 1 - k) - 1))
            table = row
        scale = np.full_like(u, MAP_TOLERANCE)
        times = np.maximum(np.abs(u[:, -1]), np.abs(table[-1][:, -1]))
        scale[:, -1] = MAP_TOLERANCE * (times + 1e-300)
        error = np.abs(table[-1] - table[-2]) / scale
        worst = np.where(good, np.max(error, axis=1), np.inf)
        return table[-1], np.where(np.isfinite(worst), worst, np.inf)

    # ------------------------------------------------------------------ steps

    def run(self) -> None:
        """Integrate all drives until each has pulled in or its time is over."""
        h = np.full(len(self.held), 1e-3 * self._first_step())
        corner = np.where(self.on_ramp, self.held / self.rate, np.inf)
        with np.errstate(all="ignore"):
            for _ in range(LONGEST_WALK):
                who = np.flatnonzero(self.active)
                if not len(who):
                    return
                self._advance(who, h, corner)
        raise InputError("Some drives of the map need too many steps; take fewer seconds.")

    def _first_step(self) -> float:
        tau = self.line.tau[np.isfinite(self.line.tau)]
        longest = float(np.min(tau, initial=self.seconds))
        return longest / 3

    def _advance(self, who: np.ndarray, h: np.ndarray, corner: np.ndarray) -> None:
        """Try one step of each active drive, and accept what is exact and not too far."""
        u = self.u[who]
        new, error = self.trial(u, h[who], who)
        slope = self.rates(new, who)
        K, t = slope[:, -1], new[:, -1]
        exact = error <= 1
        power = -1 / (EXTRAPOLATION_ORDER + 1)
        grow = np.clip(0.85 * np.maximum(error, 1e-12) ** power, 0.1, 4.0)
        # land on the end of the ramp and on loss of equilibrium by Newton's method in the step
        passed = exact & self.on_ramp[who] & (t > corner[who] * (1 + RAMP_END_TOLERANCE)) & (K > 0)
        gone = exact & (K < -NEGLIGIBLE_STIFFNESS)
        next_h = h[who] * grow
        K0 = self.rates(u, who)[:, -1]
        next_h = np.where(gone, h[who] * np.clip(K0 / (K0 - K), 0.02, 0.98), next_h)
        back = h[who] - (t - corner[who]) / K
        next_h = np.where(passed, np.clip(back, 0.02 * h[who], h[who] * (1 - 1e-15)), next_h)
        taken = exact & ~passed & ~gone
        self.u[who[taken]] = new[taken]
        h[who] = next_h
        self._after(who, taken, np.abs(K) <= NEGLIGIBLE_STIFFNESS, t, corner)

    def _after(
        self, who: np.ndarray, taken: np.ndarray, at_peak: np.ndarray, t: np.ndarray,
        corner: np.ndarray,
    ) -> None:  # fmt: skip
        """Note what accepted steps have reached: pull-in, the end of the ramp, the end of time."""
        on_ramp = self.on_ramp[who]
        done = who[taken & at_peak]
        E = np.where(on_ramp, self.rate[who] * t, self.held[who])
        self.found_time[done] = t[taken & at_peak]
        self.found_field[done] = E[taken & at_peak]
        self.found_stretch[done] = self._stretch(self.u[done, -2])
        landed = taken & on_ramp & (np.abs(t - corner[who]) <= RAMP_END_TOLERANCE * corner[who])
        self.on_ramp[who[landed]] = False
        over = taken & (t > self.seconds)
        self.active[done] = False
        self.active[who[over]] = False
        late = self.found_time > self.seconds
        self.found_time[late & ~self.active] = np.inf
