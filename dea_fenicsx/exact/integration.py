"""Integration of a film's branches over one smooth piece of its drive.

Far from loss of equilibrium the time is the independent variable, and the stretches follow from
equilibrium at each instant.  Near it the stretches run away in time, so the arc length over
stretches and time is taken instead: with the stiffness K, the residual's rate r at kept stretches
and the branches' rates adot,

    dt/ds = det K / N,   dy/ds = -adj(K) r / N,   da/ds = adot dt/ds,

which is smooth where K is singular.  There dt/ds changes its sign, and equilibrium is lost.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import DOP853, OdeSolution, OdeSolver, Radau
from scipy.optimize import brentq

from dea_fenicsx.exact.film_drive import FilmLoads, Jump, Window
from dea_fenicsx.exact.viscous_film import ViscousFilm, adjugate
from dea_fenicsx.support.errors import InputError

ARC_BEGINS_AT, ARC_ENDS_AT = 0.1, 0.2
"""Below the first stiffness the film is followed by arc length; above the second, by time again.

Both are relative to the sum of all moduli.
"""

LONGEST_EXPLICIT_PIECE = 3000.0
"""Length of a piece over the shortest relaxation time, above which an implicit method is taken."""

LOG_STRETCH_OF_RUNAWAY = 3.0
"""Logarithmic stretch at which a film counts as running away without losing equilibrium.

The chains of a branch's spring may hold it at each instant while the branch flows ever faster.
"""

FEWEST_STEPS_OF_COURSE = 32
"""Steps of a course at least, so that what is drawn or integrated between them is exact too."""

INTEGRATION_TOLERANCE = 1e-11
"""Relative error of a step of the explicit method, of order 8."""

IMPLICIT_TOLERANCE = 1e-8
"""The same of the implicit one, whose estimate is of order 3 and its steps of order 5."""


@dataclass(frozen=True, eq=False)
class FilmInTime:
    """Where a film is: time, branches a (K, 2), dissipated energy over the scale, stretches y."""

    t: float
    a: np.ndarray
    w: float
    y: np.ndarray


@dataclass(frozen=True, eq=False)
class Part:
    """A stretch of the course with one independent variable p.

    Attributes
    ----------
    kind
        ``"time"`` (p is the time), ``"arc"`` or ``"jump"``.
    nodes
        Values of p at the ends of steps.
    times
        Times there.
    states
        States at values of p: t (N,), a (K, 2, N), w (N,), y (n, N) and loads (3, N).
    """

    kind: str
    nodes: np.ndarray
    times: np.ndarray
    states: Callable[[np.ndarray], tuple[np.ndarray, ...]]


class Integrator:
    """Integrates one film; see the module."""

    def __init__(
        self, film: ViscousFilm, loads: FilmLoads, tolerance: float = INTEGRATION_TOLERANCE
    ) -> None:
        self.film, self.loads = film, loads
        self.tighten = tolerance / INTEGRATION_TOLERANCE
        self.parts: list[Part] = []
        finite = film.tau[np.isfinite(film.tau)]
        self.shortest = float(finite.min()) if len(finite) else np.inf

    # ------------------------------------------------------------------ one piece

    def piece(self, place: FilmInTime, low: float, high: float) -> tuple[FilmInTime, bool]:
        """Integrate up to `high`; returns where the film is, and whether equilibrium is lost."""
        f = self._forces(place, self.loads.inside(place.t, low, high))
        by_time = bool(self.film.softness(f)[0] > ARC_BEGINS_AT)
        for _ in range(100000):
            if place.t >= high:
                return place, False
            if by_time:
                place = self._by_time(place, low, high)
                by_time = False
            else:
                span = 8 * self.loads.finest()
                window = Window(self.loads, (low, high), place.t, min(high, place.t + span))
                place, lost, by_time = self._by_arc(place, window, frozen=False)
                if lost:
                    return place, True
        raise InputError("The film's drive needs too many steps; take a shorter time.")

    def jump(
        self, place: FilmInTime, before: np.ndarray, after: np.ndarray
    ) -> tuple[FilmInTime, bool]:
        """Pass from one load to another at frozen branches."""
        if np.array_equal(before, after):
            return place, False
        place, lost, _ = self._by_arc(place, Jump(before, after), frozen=True)
        return place, lost

    def _forces(self, place: FilmInTime, loads: np.ndarray) -> Any:
        return self.film.forces(place.y[:, None], place.a[..., None], loads[:, None])

    # ------------------------------------------------------------------ time

    def _by_time(self, place: FilmInTime, low: float, high: float) -> FilmInTime:
        """Integrate in time up to `high`, or until the film is soft; returns where it is."""
        film, K, n = self.film, self.film.count, self.film.n
        last: Any = [place.t, place.y[:, None], np.zeros((n, 1))]  # time, stretches and their rate

        def settled(t: float, u: np.ndarray) -> Any:
            loads = self.loads.inside(t, low, high)[:, None]
            guess = last[1] + np.clip(last[2] * (t - last[0]), -0.05, 0.05)
            return film.equilibrium(guess, u[: 2 * K].reshape(K, 2, 1), loads)

        def rate(t: float, u: np.ndarray) -> np.ndarray:
            y, f = settled(t, u)
            if np.isnan(y).any():
                return np.full_like(u, np.nan)
            return np.append(film.flow(f).ravel(), film.dissipation(f).sum() / film.scale)

        u = np.append(place.a.ravel(), place.w)
        step = min(self.loads.seconds / FEWEST_STEPS_OF_COURSE, 4 * self.loads.finest())

        def jacobian(t: float, u: np.ndarray) -> np.ndarray:
            return film.flow_slope(settled(t, u)[1])

        stiffness = (high - low) / self.shortest
        slope = jacobian if film.HAS_SLOPE else None
        solver = self._solver(rate, place.t, u, high, step, stiffness, slope)
        dense, nodes, ys = [], [place.t], [place.y]
        while solver.status == "running":
            solver.step()
            if solver.status == "failed":
                break
            dense.append(solver.dense_output())
            nodes.append(solver.t)
            y, f = settled(solver.t, solver.y)
            last = [solver.t, y, (y - last[1]) / (solver.t - last[0])]
            ys.append(y[:, 0])
            self._check_runaway(y, solver.t)
            if not film.softness(f)[0] > ARC_BEGINS_AT:
                break
        if not dense:
            return place
        t = np.array(nodes)
        sol, guess = OdeSolution(t, dense), np.array(ys).reshape(len(t), n)

        def states(p: np.ndarray) -> tuple[np.ndarray, ...]:
            u = sol(p)
            a, loads = u[: 2 * K].reshape(K, 2, len(p)), self.loads.several(p, low, high)
            y = np.array([np.interp(p, t, g) for g in guess.T]).reshape(n, len(p))
            return p, a, u[2 * K], film.equilibrium(y, a, loads)[0], loads

        self.parts.append(Part("time", t, t, states))
        end = solver.y if solver.status != "failed" else sol(t[-1])
        return FilmInTime(float(t[-1]), end[: 2 * K].reshape(K, 2), float(end[2 * K]), ys[-1])

    def _check_runaway(self, y: np.ndarray, t: float) -> None:
        """Refuse to follow stretches that grow without bound."""
        if np.abs(self.film.B @ y).max(initial=0.0) > LOG_STRETCH_OF_RUNAWAY:
            raise InputError(
                f"The film runs away at about {t:g} s: its stretches grow without bound, although "
                "the springs of its branches hold it in equilibrium at each instant."
            )

    def _solver(
        self, rate: Any, p: float, u: np.ndarray, end: float, step: float, stiffness: float,
        jacobian: Any = None,
    ) -> OdeSolver:  # fmt: skip
        """A method for one part; `stiffness` is its length over the shortest relaxation time."""
        if stiffness > LONGEST_EXPLICIT_PIECE:
            error = IMPLICIT_TOLERANCE * self.tighten
            return Radau(rate, p, u, end, max_step=step, rtol=error, atol=error / 10, jac=jacobian)
        error = INTEGRATION_TOLERANCE * self.tighten
        return DOP853(rate, p, u, end, max_step=step, rtol=error, atol=error / 10)

    # ------------------------------------------------------------------ arc length

    def _by_arc(
        self, place: FilmInTime, drive: Window | Jump, frozen: bool
    ) -> tuple[FilmInTime, bool, bool]:
        """Integrate over the arc length, to the drive's end or loss of equilibrium.

        Returns where the film is, whether equilibrium is lost, and whether the time may be the
        independent variable again.
        """
        film, K = self.film, self.film.count
        start = 0.0 if frozen else place.t
        scale = self._time_scale(place, drive, start, frozen)

        def parts(u: np.ndarray) -> tuple[np.ndarray, ...]:
            return u[: 2 * K].reshape(K, 2, 1), u[2 * K + 1 : -1, None], u[-1:]

        def rate(s: float, u: np.ndarray) -> np.ndarray:
            a, y, t = parts(u)
            loads = drive(t)
            f = film.forces(y, a, loads)
            adot = 0 * a if frozen else film.flow(f)
            lost = 0.0 if frozen else film.dissipation(f).sum() / film.scale
            adj, det = adjugate(f.stiffness[..., 0]) if film.n else (np.zeros((0, 0)), 1.0)
            vy = -adj @ film.drift(f, adot, loads, drive.rates(t))[:, 0]
            size = np.sqrt(np.sum(vy**2) + (det / scale) ** 2)
            return np.concatenate([adot.ravel() * det, [lost * det], vy, [det]]) / size

        def stiffness(u: np.ndarray) -> Any:
            a, y, t = parts(u)
            return film.forces(y, a, drive(t))

        u = np.concatenate([place.a.ravel(), [place.w], place.y, [start]])
        fast = 0.0 if frozen else 20 * scale / self.shortest
        step = 0.05 if not frozen else 0.1
        solver = self._solver(rate, 0.0, u, np.inf, step, fast)
        return self._follow(solver, place, drive, frozen, stiffness)

    def _time_scale(
        self, place: FilmInTime, drive: Window | Jump, start: float, frozen: bool
    ) -> float:
        """Time in which the stretches change by about 1, at most that of the drive."""
        film, t = self.film, np.array([start])
        a = place.a[..., None]
        f = film.forces(place.y[:, None], a, drive(t))
        adot = 0 * a if frozen else film.flow(f)
        r = film.drift(f, adot, drive(t), drive.rates(t))
        speed = float(np.abs(r).max(initial=0.0) / max(float(film.softness(f)[0]), 1e-3))
        return min(1 / max(speed, 1e-300), 2 * (drive.end - drive.start))

    def _follow(
        self, solver: OdeSolver, place: FilmInTime, drive: Window | Jump, frozen: bool,
        stiffness: Any,
    ) -> tuple[FilmInTime, bool, bool]:
        """Take steps until something happens; see `_by_arc`."""
        film, K = self.film, self.film.count
        dense, nodes, times = [], [0.0], [float(solver.y[-1])]
        lost = firm = False

        def det(u: np.ndarray) -> float:
            K_ = stiffness(u).stiffness[..., 0]
            return adjugate(K_)[1] if film.n else 1.0

        while True:
            solver.step()
            if solver.status == "failed":
                raise InputError(
                    f"The film's state could not be followed beyond {place.t:g} s: its chains lock "
                    "up there, or its loads have no equilibrium."
                )
            sol, a, b = solver.dense_output(), nodes[-1], float(solver.t)
            dense.append(sol)
            lost = det(solver.y) <= 0
            if lost:
                b = brentq(lambda s, f=sol: det(f(s)), a, b, xtol=1e-15, rtol=1e-14)
            over = float(sol(b)[-1]) >= drive.end
            if over:
                lost = False
                b = brentq(lambda s, f=sol: f(s)[-1] - drive.end, a, b, xtol=1e-15, rtol=1e-14)
            nodes.append(b)
            times.append(drive.end if over else float(sol(b)[-1]))
            self._check_runaway(solver.y[2 * K + 1 : -1, None], times[-1])
            firm = not frozen and bool(film.softness(stiffness(solver.y))[0] > ARC_ENDS_AT)
            if lost or over or firm:
                break
        p = np.array(nodes)
        ends = OdeSolution(np.array([0.0, *[d.t for d in dense]]), dense)

        def states(s: np.ndarray) -> tuple[np.ndarray, ...]:
            u = ends(np.minimum(s, p[-1]))
            t, a = u[-1], u[: 2 * K].reshape(K, 2, len(s))
            loads = drive(t)
            along = np.full_like(t, place.t) if frozen else t
            return along, a, u[2 * K], u[2 * K + 1 : -1], loads

        along = np.full(len(p), place.t) if frozen else np.array(times)
        self.parts.append(Part("jump" if frozen else "arc", p, along, states))
        u = ends(p[-1])
        t, y = float(along[-1]), u[2 * K + 1 : -1]
        a = u[: 2 * K].reshape(K, 2)
        if not lost:
            load = drive(np.array([drive.end if times[-1] >= drive.end else times[-1]]))
            settled, _ = film.equilibrium(y[:, None], a[..., None], load)
            y = y if np.isnan(settled).any() else settled[:, 0]
        return FilmInTime(t, a, float(u[2 * K]), y), lost, firm and not lost
