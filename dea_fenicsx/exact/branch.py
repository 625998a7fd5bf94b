"""The whole branch of equilibria of a film, from zero voltage on, and what happens along it.

A branch is one curve, whatever drives it: a state in equilibrium at some voltage is in equilibrium
at the charge or pressure that it then has.  What differs is its stability, and which states a
growing load can reach.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import brentq

from dea_fenicsx.exact.equilibrium import Equations, scan, walk
from dea_fenicsx.exact.film import Film, Held, known_control
from dea_fenicsx.support.errors import InputError

SAMPLE_STEP = 0.01
"""Distance between sampled states in logarithmic stretch."""


@dataclass(frozen=True)
class HomogeneousState:
    """One homogeneous equilibrium.

    Attributes
    ----------
    stretches : the three principal stretches, the third along the field
    maxwell : Maxwell pressure eps E^2 in Pa
    voltage : V
    charge : C per undeformed m^2
    field : true field in V/m
    stress : true in-plane stresses in Pa
    place : where on its branch, in units of samples
    """

    stretches: np.ndarray
    maxwell: float
    voltage: float
    charge: float
    field: float
    stress: np.ndarray
    place: float


@dataclass(frozen=True)
class Event:
    """Something that happens along a branch.

    Attributes
    ----------
    kind
        ``"pull-in"`` (a maximum of the load), ``"snap minimum"``, ``"bifurcation"`` (equal sides
        part), ``"loss of tension 1"`` or ``"2"``, ``"breakdown"``, ``"lock-up"``.
    state
        The state where it happens.
    """

    kind: str
    state: HomogeneousState


@dataclass(frozen=True, eq=False)
class Branch:
    """A traced branch.

    Attributes
    ----------
    film
        The film.
    e
        Logarithms of the principal stretches of the samples, shape (3, n).
    M
        Maxwell pressure of the samples in Pa, shape (n,).
    locked
        Whether the branch ends where the chains lock up.
    """

    film: Film
    e: np.ndarray
    M: np.ndarray
    locked: bool
    _solve: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, float]] = field(repr=False)
    _events: dict[str, list[Event]] = field(default_factory=dict, repr=False)

    @cached_property
    def stretches(self) -> np.ndarray:
        """Principal stretches, shape (3, n)."""
        return np.exp(self.e)

    @cached_property
    def voltage(self) -> np.ndarray:
        """Voltage in V."""
        return self.film.voltage(self.e, self.M)

    @cached_property
    def charge(self) -> np.ndarray:
        """Charge per undeformed area in C/m^2."""
        return self.film.charge(self.e, self.M)

    @cached_property
    def stress(self) -> np.ndarray:
        """True in-plane stresses in Pa, shape (2, n)."""
        return self.film.true_stress(self.e, self.M)

    def load(self, control: str) -> np.ndarray:
        """The load that `control` imposes at each sample."""
        return self.film.load(control, self.e, self.M)

    def stability(self, control: str = "voltage") -> np.ndarray:
        """Smallest eigenvalue of the second variation in Pa; positive where stable."""
        return self._eigenvalues(self.e, self.M, control)[..., 0]

    def _eigenvalues(self, e: np.ndarray, M: Any, control: str) -> np.ndarray:
        _, B = self.film.freedoms(symmetric=False)
        K = np.moveaxis(self.film.tangent(e, M, control), (0, 1), (-2, -1))
        K = np.swapaxes(B, 0, 1) @ K @ B
        return np.linalg.eigvalsh((K + np.swapaxes(K, -1, -2)) / 2)

    # ------------------------------------------------------------------ states

    def at(self, place: float) -> HomogeneousState:
        """The equilibrium at a place on the branch, in units of samples (2.5: between 2 and 3)."""
        k = int(np.clip(np.floor(place), 0, len(self.M) - 2))
        s = place - k
        if s == 0 or s == 1:
            e, M = self.e[:, k + int(s)], float(self.M[k + int(s)])
        else:
            a, b = self.e[:, k], self.e[:, k + 1]
            e, M = self._solve(a + s * (b - a), b - a)
        film = self.film
        return HomogeneousState(
            stretches=np.exp(e),
            maxwell=M,
            voltage=float(film.voltage(e, M)),
            charge=float(film.charge(e, M)),
            field=float(film.electric.field(e, np.float64(M))),
            stress=film.true_stress(e, np.float64(M)),
            place=place,
        )

    def _crossings(
        self, samples: np.ndarray, value: Callable[[HomogeneousState], float]
    ) -> list[tuple[float, bool]]:
        """Places where a quantity changes sign, each with whether it rises there."""
        found = []
        above = samples >= 0
        for k in np.flatnonzero(above[:-1] != above[1:]):
            a, b = value(self.at(float(k))), value(self.at(float(k + 1)))
            if a == 0 or b == 0:
                found.append((float(k if a == 0 else k + 1), bool(b > a)))
            elif a * b < 0:
                place = brentq(lambda s: value(self.at(s)), k, k + 1, xtol=1e-13, rtol=1e-15)
                found.append((float(place), bool(b > a)))
        return found

    def states_at(
        self, load: float, control: str = "voltage"
    ) -> list[tuple[HomogeneousState, bool]]:
        """Every equilibrium at a load, each with whether it is stable under that control."""
        found = self._states_where(
            self.load(control) - load, lambda s: self._load_of(s, control) - load
        )
        return [(s, self.is_stable(s, control)) for s in found]

    def at_stretch(self, stretch: float, axis: int = 0) -> list[HomogeneousState]:
        """Every state of the branch with a given stretch along an axis (0, 1 or 2)."""
        return self._states_where(
            self.stretches[axis] - stretch, lambda s: float(s.stretches[axis]) - stretch
        )

    def _states_where(
        self, samples: np.ndarray, value: Callable[[HomogeneousState], float]
    ) -> list[HomogeneousState]:
        """Where a quantity is 0: also at the start, from which it may grow without a new sign."""
        places = [place for place, _ in self._crossings(samples, value)]
        if samples[0] == 0 and samples[1] > 0:
            places.insert(0, 0.0)
        return [self.at(place) for place in places]

    def is_stable(self, state: HomogeneousState, control: str = "voltage") -> bool:
        """Whether the second variation is positive definite while the control is kept."""
        e = np.log(state.stretches)
        return bool(self._eigenvalues(e, np.float64(state.maxwell), control)[0] > 0)

    def _load_of(self, s: HomogeneousState, control: str) -> float:
        return float(self.film.load(control, np.log(s.stretches), s.maxwell))

    # ------------------------------------------------------------------ events

    def events(self, control: str = "voltage") -> list[Event]:
        """Everything that happens along the branch under a control, in the order of the branch."""
        if known_control(control) not in self._events:
            found = self._limits(control) + self._losses() + self._breakdown()
            if self.locked:
                end = self.at(float(len(self.M) - 1))
                beyond = replace(end, maxwell=np.inf, voltage=np.inf, charge=np.inf, field=np.inf)
                found.append(Event("lock-up", beyond))
            self._events[control] = sorted(found, key=lambda e: e.state.place)
        return self._events[control]

    def event(self, kind: str, control: str = "voltage") -> HomogeneousState | None:
        """The first event of a kind, or None."""
        return next((e.state for e in self.events(control) if e.kind == kind), None)

    def landing(self, control: str = "voltage") -> HomogeneousState | None:
        """Where the film comes to rest after pull-in at constant load, or None."""
        peak = self.event("pull-in", control)
        if peak is None:
            return None
        load = self._load_of(peak, control)
        after = [s for s, ok in self.states_at(load, control) if ok and s.place > peak.place + 1]
        return after[0] if after else None

    def _limits(self, control: str) -> list[Event]:
        """Limit points in the traced plane, and bifurcations out of it."""
        film = self.film
        _, B = film.freedoms(symmetric=True)
        _, full = film.freedoms(symmetric=False)

        def singular(e: np.ndarray, M: np.ndarray) -> np.ndarray:
            K = np.moveaxis(film.tangent(e, M, control), (0, 1), (-2, -1))
            return np.linalg.det(B.T @ K @ B / film.material.elastic.shear_modulus())

        def parting(e: np.ndarray, M: np.ndarray) -> np.ndarray:
            K = film.tangent(e, M, control)
            return (K[0, 0] - K[0, 1] - K[1, 0] + K[1, 1]) / 2

        def of(f: Callable, s: HomogeneousState) -> float:
            return float(f(np.log(s.stretches), np.float64(s.maxwell)))

        events = []
        load = self.load(control)
        for place, _ in self._crossings(singular(self.e, self.M), lambda s: of(singular, s)):
            peak = self._load_of(self.at(place), control)
            k = int(place)
            kind = "pull-in" if peak >= max(load[k], load[k + 1]) else "snap minimum"
            events.append(Event(kind, self.at(place)))
        if full.shape[1] > B.shape[1]:
            for place, _ in self._crossings(parting(self.e, self.M), lambda s: of(parting, s)):
                events.append(Event("bifurcation", self.at(place)))
        return events

    def _losses(self) -> list[Event]:
        """Where a held direction ceases to be in tension."""
        events = []
        tiny = 1e-9 * self.film.material.elastic.shear_modulus()
        for k, side in enumerate(self.film.sides):
            if not isinstance(side, Held):
                continue
            kind = f"loss of tension {k + 1}"
            if self.stress[k, 0] < tiny and self.stress[k, 1] < 0:
                events.append(Event(kind, self.at(0.0)))

            def tension(s: HomogeneousState, k: int = k) -> float:
                return float(s.stress[k])

            for place, rises in self._crossings(self.stress[k], tension):
                if not rises:
                    events.append(Event(kind, self.at(place)))
        return events

    def _breakdown(self) -> list[Event]:
        electric = self.film.material.dielectric
        if electric.breakdown_field() is None:
            return []

        def excess(lam: np.ndarray, M: Any) -> np.ndarray:
            limit = electric.breakdown_field(np.sqrt(lam[0] * lam[1]))
            return self.film.electric.field(np.log(lam), M) - limit

        return [
            Event("breakdown", self.at(place))
            for place, rises in self._crossings(
                excess(self.stretches, self.M),
                lambda s: float(excess(s.stretches, np.float64(s.maxwell))),
            )
            if rises
        ]


def trace(film: Film, max_stretch: float = 20.0, step: float = SAMPLE_STEP) -> Branch:
    """Trace the branch of equilibria from zero voltage towards larger area.

    Parameters
    ----------
    film
        The film with its mechanical loads.  Two equal loads are traced with equal stretches; where
        such states become unstable against unequal ones, a bifurcation is reported.
    max_stretch
        Where to stop, at an in-plane stretch (or thickness ratio) of this size.
    step
        Distance between samples in logarithmic stretch.

    Raises
    ------
    InputError
        If the film has no equilibrium without voltage.
    """
    equations = Equations(film)
    y, M = equations.rest()
    if equations.n == 1:
        e, M_all, locked = scan(equations, y, max_stretch, step)
    else:
        e, M_all, locked = walk(equations, y, max_stretch, step)
    if len(M_all) < 3:
        raise InputError("The film's branch ends at once; check the dead loads and max_stretch.")
    return Branch(film, e, M_all, locked, equations.near)
