"""What a march of a film gives: its states in time, its loss of equilibrium and its energies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from dea_fenicsx.exact.film import Film
from dea_fenicsx.exact.integration import FilmInTime, Part
from dea_fenicsx.exact.viscous_film import ViscousFilm
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import one_of

NODES = 12
"""Points of a step at which work is integrated."""


@dataclass(frozen=True, eq=False)
class Moments:
    """A film at N times.

    Attributes
    ----------
    time : s, shape (N,)
    stretches : principal stretches, the third along the field, shape (3, N)
    viscous : principal values of each branch's viscous strain C_v, shape (K, 3, N)
    nominal_field : V/T in V/m, shape (N,)
    field : true field in V/m
    voltage : V
    charge : C per undeformed m^2
    stress : nominal stresses in the plane in Pa, without those of the field's source, shape (2, N)
    energy : stored energy in J per undeformed m^3: elastic, of all branches and of the field
    dissipation : W per undeformed m^3 of each branch, shape (K, N)
    dissipated : J per undeformed m^3 since the start
    """

    time: np.ndarray
    stretches: np.ndarray
    viscous: np.ndarray
    nominal_field: np.ndarray
    field: np.ndarray
    voltage: np.ndarray
    charge: np.ndarray
    stress: np.ndarray
    energy: np.ndarray
    dissipation: np.ndarray
    dissipated: np.ndarray


DRAWN: dict[str, tuple[str, Callable[[Moments], np.ndarray]]] = {
    "time": ("time in s", lambda m: m.time),
    "stretch": ("stretch 1", lambda m: m.stretches[0]),
    "second stretch": ("stretch 2", lambda m: m.stretches[1]),
    "stress": ("nominal stress 1 in kPa", lambda m: m.stress[0] / 1e3),
    "voltage": ("voltage in kV", lambda m: m.voltage / 1e3),
    "nominal field": ("nominal field in MV/m", lambda m: m.nominal_field / 1e6),
    "charge": ("charge per undeformed area in mC/m²", lambda m: m.charge * 1e3),
}
"""What `Course.draw` draws: its label, and its values."""


@dataclass(frozen=True)
class PullIn:
    """Where a film loses its equilibrium.

    Attributes
    ----------
    time : s
    nominal_field : V/T in V/m
    voltage : V
    stretches : principal stretches
    in_jump : whether it happens in a jump of the drive, at the values told here
    """

    time: float
    nominal_field: float
    voltage: float
    stretches: tuple[float, float, float]
    in_jump: bool


@dataclass(frozen=True, eq=False)
class Balance:
    """Energies since the start at the ends of steps, in J per undeformed m^3.

    Attributes
    ----------
    time : s, shape (n,)
    electric_work : work of the source of voltage
    mechanical_work : work of what acts on the sides, held ones included
    stored : change of the stored energy
    dissipated : what the branches have turned into heat, by its own formula
    """

    time: np.ndarray
    electric_work: np.ndarray
    mechanical_work: np.ndarray
    stored: np.ndarray
    dissipated: np.ndarray

    @property
    def gap(self) -> np.ndarray:
        """Work in less what is stored and dissipated: 0 but for rounding."""
        return self.electric_work + self.mechanical_work - self.stored - self.dissipated


@dataclass(frozen=True, eq=False)
class Course:
    """The course of a film in time, as `march` gives it.

    Attributes
    ----------
    film
        The film.
    pull_in
        Where equilibrium is lost, or None.
    """

    film: Film
    pull_in: PullIn | None
    _state: ViscousFilm = field(repr=False)
    _parts: list[Part] = field(repr=False)
    _end: FilmInTime = field(repr=False)

    @staticmethod
    def of(
        film: Film, state: ViscousFilm, parts: list[Part], end: FilmInTime, lost: bool
    ) -> Course:
        """The course of what an integrator has left."""
        course = Course(film, None, state, parts, end)
        if not lost:
            return course
        last = course._moments(parts[-1], parts[-1].nodes[-1:])
        found = PullIn(
            time=end.t,
            nominal_field=float(last.nominal_field[0]),
            voltage=float(last.voltage[0]),
            stretches=tuple(float(s) for s in last.stretches[:, 0]),  # type: ignore[arg-type]
            in_jump=parts[-1].kind == "jump",
        )
        return Course(film, found, state, parts, end)

    # ------------------------------------------------------------------ in short

    @property
    def end_time(self) -> float:
        """Last time in s."""
        return self._end.t

    @property
    def pull_in_time(self) -> float | None:
        return None if self.pull_in is None else self.pull_in.time

    @property
    def pull_in_field(self) -> float | None:
        """Nominal field V/T in V/m at pull-in."""
        return None if self.pull_in is None else self.pull_in.nominal_field

    @property
    def pull_in_stretch(self) -> float | None:
        """First stretch at pull-in."""
        return None if self.pull_in is None else self.pull_in.stretches[0]

    @property
    def stretch_at_0(self) -> float:
        """First stretch just after the start."""
        return float(self.stretch(0.0))

    @property
    def is_equal(self) -> bool:
        """Whether both directions in the plane are equal all the time."""
        return self._state.n == 0 or self._state.B.shape[1] < 2 + (not self.film.incompressible)

    def end_for(self, state: ViscousFilm) -> tuple[FilmInTime, np.ndarray]:
        """The end of this course as a beginning of another one of the same film, and its loads."""
        same = state.film.material == self.film.material and state.count == self._state.count
        if not same or self.pull_in is not None:
            raise InputError(
                "A march can go on only from a course of the same material, and from one that has "
                "not lost its equilibrium."
            )
        if state.held != self._state.held or state.control != self._state.control:
            raise InputError(
                "A march that goes on from a course must hold the same sides and have the same "
                "control (voltage or charge)."
            )
        loads = self._parts[-1].states(self._parts[-1].nodes[-1:])[4]
        e = self._state.stretches(self._end.y[:, None], loads)
        rest = e - state.stretches(np.zeros((state.n, 1)), loads)
        y = np.linalg.lstsq(state.B, rest[:, 0])[0] if state.n else np.zeros(0)
        return FilmInTime(0.0, self._end.a, 0.0, y), loads[:, 0]

    # ------------------------------------------------------------------ states

    @cached_property
    def times(self) -> np.ndarray:
        """Times of the steps in s; a jump of the drive stands there several times."""
        return np.concatenate([part.times for part in self._parts])

    @cached_property
    def steps(self) -> Moments:
        """States at `times`, both sides of jumps included."""
        return self.sampled(1)

    def sampled(self, per_step: int = 4) -> Moments:
        """States along the whole course, several in each step, jumps included: for drawings."""
        found = []
        for part in self._parts:
            p = part.nodes
            share = np.arange(per_step) / per_step
            inside = (p[:-1, None] + np.diff(p)[:, None] * share).ravel()
            found.append(self._moments(part, np.append(inside, p[-1])))
        names = Moments.__dataclass_fields__
        return Moments(**{
            name: np.concatenate([getattr(m, name) for m in found], axis=-1) for name in names
        })  # fmt: skip

    def at(self, time: Any) -> Moments:
        """States at times in s, after a jump where there is one.

        Raises
        ------
        InputError
            For times outside the course.
        """
        t = np.atleast_1d(np.asarray(time, dtype=float))
        if t.size and not (t.min() >= 0 and t.max() <= self.end_time * (1 + 1e-12)):
            raise InputError(
                f"A state is asked at {t.min():g} to {t.max():g} s, but the course goes from 0 to "
                f"{self.end_time:g} s."
            )
        t = np.minimum(t.ravel(), self.end_time)
        parts = [
            part for k, part in enumerate(self._parts)
            if part.kind != "jump" or k + 1 == len(self._parts)
        ]  # fmt: skip
        which = np.searchsorted([part.times[0] for part in parts], t, side="right") - 1
        order, found = [], []
        for k in np.unique(which):
            chosen = np.flatnonzero(which == k)
            order.append(chosen)
            found.append(self._moments(parts[k], _places(parts[k], t[chosen])))
        back = np.argsort(np.concatenate(order)) if order else np.array([], dtype=int)
        names = Moments.__dataclass_fields__
        values = {
            n: np.concatenate([getattr(m, n) for m in found], axis=-1)[..., back] for n in names
        }
        return Moments(**{**values, "time": t})

    def stretch(self, time: Any, axis: int = 0) -> Any:
        """Principal stretch at times in s, of their shape; axis 0 or 1 in the plane, 2 across."""
        found = self.at(time).stretches[axis].reshape(np.shape(time))
        return float(found) if np.ndim(time) == 0 else found

    def _moments(self, part: Part, p: np.ndarray) -> Moments:
        t, a, w, y, loads = part.states(p)
        state, film = self._state, self.film
        f = state.forces(y, a, loads)
        W, R, _ = film.elastic(f.e)
        J = np.exp(f.e.sum(axis=0))
        M = state.maxwell(f.e, loads)
        R = R + state.pull(f) - film.push(f.e) * M * J
        stress = (R[:2] - R[2] if film.incompressible else R[:2]) / np.exp(f.e[:2])
        charge = film.charge(f.e, M)
        sign = np.sign(loads[0])
        third = np.concatenate([a, -a.sum(axis=1, keepdims=True)], axis=1)
        volts = sign * film.voltage(f.e, M)
        return Moments(
            time=t, stretches=np.exp(f.e), viscous=np.exp(third),
            nominal_field=volts / film.thickness, field=sign * film.electric.field(f.e, M),
            voltage=volts, charge=sign * charge, stress=stress,
            energy=W + state.spring_energy(f) + film.electric.stored(f.e, M) * J,
            dissipation=state.dissipation(f),
            dissipated=w * state.scale,
        )  # fmt: skip

    def draw(self, x: str = "time", y: str = "stretch", ax: Any = None) -> Any:
        """Draw one quantity over another, a hysteresis loop for instance; returns the axes.

        Parameters
        ----------
        x, y
            Names of `DRAWN`.
        ax
            Axes of matplotlib; made if None.
        """
        import matplotlib.pyplot as plt

        for name in (x, y):
            one_of(name, tuple(DRAWN), "What is drawn")
        ax = ax or plt.subplots()[1]
        m = self.sampled(8)
        ax.plot(DRAWN[x][1](m), DRAWN[y][1](m))
        ax.set_xlabel(DRAWN[x][0])
        ax.set_ylabel(DRAWN[y][0])
        return ax

    # ------------------------------------------------------------------ energies

    def balance(self) -> Balance:
        """Works, stored and dissipated energies at the end of each step.

        A jump counts as a change of the loads through all values between, without loss.
        """
        nodes, slope, weights = _lobatto(NODES)
        electric, mechanical = [0.0], [0.0]
        times: list[np.ndarray] = []
        for part in self._parts:
            p = part.nodes
            t = p[:-1, None] + np.diff(p)[:, None] * (nodes + 1) / 2
            m = self._moments(part, t.ravel())

            def along(x: np.ndarray, n: int = len(p) - 1) -> np.ndarray:
                return x.reshape(n, NODES)

            work = weights * along(m.nominal_field) * (along(m.charge) @ slope.T)
            push = sum(
                weights * along(m.stress[k]) * (along(m.stretches[k]) @ slope.T) for k in range(2)
            )
            electric += [0.0, *work.sum(axis=1)] if times else [*work.sum(axis=1)]
            mechanical += [0.0, *push.sum(axis=1)] if times else [*push.sum(axis=1)]
            times.append(part.times)
        stored = self.steps.energy
        return Balance(
            time=np.concatenate(times),
            electric_work=np.cumsum(electric),
            mechanical_work=np.cumsum(mechanical),
            stored=stored - stored[0],
            dissipated=self.steps.dissipated,
        )


def _places(part: Part, t: np.ndarray) -> np.ndarray:
    """Values of a part's independent variable at times, by bisection within its steps."""
    if part.kind == "time":
        return np.clip(t, part.nodes[0], part.nodes[-1])
    if part.kind == "jump":
        return np.full_like(t, part.nodes[-1])
    k = np.clip(np.searchsorted(part.times, t, side="right") - 1, 0, len(part.nodes) - 2)
    low, high = part.nodes[k], part.nodes[k + 1]
    for _ in range(54):
        middle = (low + high) / 2
        early = part.states(middle)[0] < t
        low, high = np.where(early, middle, low), np.where(early, high, middle)
    # near loss of equilibrium the time is flat, so its end is taken as it is
    return np.where(t >= part.times[-1], part.nodes[-1], (low + high) / 2)


def _lobatto(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gauss-Lobatto points on [-1, 1], the matrix of derivatives there, and the weights."""
    legendre = np.polynomial.legendre.Legendre.basis(n - 1)
    x = np.concatenate([[-1.0], np.sort(legendre.deriv().roots().real), [1.0]])
    weights = 2 / (n * (n - 1) * legendre(x) ** 2)
    gaps = x[:, None] - x[None, :] + np.eye(n)
    c = np.prod(gaps, axis=1)
    D = c[:, None] / (c[None, :] * gaps)
    np.fill_diagonal(D, 0.0)
    np.fill_diagonal(D, -D.sum(axis=1))
    return x, D, weights
