"""Tests over time, and the stress of a material with viscous branches in them.

The viscous strains follow from the implicit Euler step in closed form, C_v,new = the unimodular
part of C_v,old + (dt/tau) Cbar_new (Shutov et al. 2013), with 1, 2 and 4 steps of each interval
extrapolated to order 3; the logarithms are extrapolated, so that C_v stays unimodular.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.materials.curve_data import take_columns
from dea_fenicsx.materials.material import Material
from dea_fenicsx.materials.separators import parsed
from dea_fenicsx.materials.stretches import log_stretches, nominal_stress
from dea_fenicsx.materials.viscous import closed_branches
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si, si
from dea_fenicsx.support.validation import is_positive

EVEN = 2
"""Parts into which an interval of time between two points is divided."""

AFTER_JUMP = 40
"""The same where stretches are held, in lengths that grow evenly in the logarithm."""

SHORTEST = 1e-5
"""First of those lengths, relative to the interval."""


@dataclass(frozen=True, eq=False)
@in_si(time="s", stretch="", stress="Pa")
class RateData:
    """One test over time: relaxation, cycles, anything with a known stretch.

    Parameters
    ----------
    test
        ``"uniaxial"``, ``"planar"`` or ``"equibiaxial"``.
    time
        Times in s from the start of loading, not falling, shape (n,).  Before the first one the
        material is undeformed; a first stretch other than 1 is reached in a jump.
    stretch
        Stretches, shape (n,), with straight lines in between.
    stress
        Nominal stresses in Pa, shape (n,).  NaN where none was measured.
    name
        For reports.
    """

    test: str
    time: Any
    stretch: Any
    stress: Any
    name: str = ""

    def __post_init__(self) -> None:
        take_columns(self, self.test, ("time", "stretch", "stress"))
        if not len(self.time) == len(self.stretch) == len(self.stress) or not len(self.time):
            raise InputError(
                f"The {self.test} data have {len(self.time)} times, {len(self.stretch)} stretches "
                f"and {len(self.stress)} stresses, but must have as many of each."
            )
        if not (np.all(np.isfinite(self.time)) and np.all(np.isfinite(self.stretch))):
            raise InputError(f"The {self.test} data hold times or stretches that are not finite.")
        if np.any(np.diff(self.time) < 0):
            k = int(np.argmax(np.diff(self.time) < 0))
            raise InputError(
                f"The times of the {self.test} data run backwards at row {k + 1}, from "
                f"{self.time[k]:g} s to {self.time[k + 1]:g} s."
            )
        if np.any(self.stretch <= 0):
            raise InputError(
                f"The {self.test} data hold a stretch of {self.stretch.min():g}, but a stretch is "
                "> 0 (1 + strain)."
            )
        if not np.any(np.isfinite(self.stress)):
            raise InputError(f"The {self.test} data hold no stress.")

    @property
    def measured(self) -> np.ndarray:
        """Which points have a stress."""
        return np.isfinite(self.stress)

    @staticmethod
    def at_rate(test: str, rate: float, stretch: Any, stress: Any, name: str = "") -> RateData:
        """A test whose stretch changes with |d stretch/dt| = rate in 1/s, as in cycles."""
        rate = si(rate, "", "The rate")
        if not is_positive(rate):
            raise InputError(f"The rate is {shown(rate)}, but must be a number > 0 in 1/s.")
        way = np.abs(np.diff(np.asarray(stretch, dtype=float).ravel(), prepend=1.0))
        return RateData(test, np.cumsum(way) / rate, stretch, stress, name)

    @staticmethod
    def relaxation(test: str, stretch: float, time: Any, stress: Any, name: str = "") -> RateData:
        """A test at one stretch, reached in a jump at time 0."""
        time = np.append(0.0, np.asarray(time, dtype=float).ravel())
        stress = np.append(np.nan, np.asarray(stress, dtype=float).ravel())
        return RateData(test, time, np.full(len(time), float(stretch)), stress, name)


def read_cycles(
    path: str | Path, test: str, columns: tuple[int, int, int, int], unit: float = 1.0,
    delimiter: str | None = ",",
) -> list[RateData]:  # fmt: skip
    """Read tests at constant rates from a text file; lines without numbers are passed over.

    Parameters
    ----------
    path, test
        The file, and the kind of all its tests.
    columns
        Numbers of the columns, from 0: name of the test, rate in 1/s, stretch, nominal stress.
    unit
        Unit of the stresses in Pa.
    delimiter
        Column delimiter (None for blanks); others are tried where the file holds no numbers with
        it.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"There is no data file {path}.")
    groups: dict[str, list[list[float]]] = {}
    lines = path.read_text(encoding="latin-1").splitlines()

    def row(cells: list[str]) -> tuple[str, list[float]]:
        return cells[columns[0]], [float(cells[k]) for k in columns[1:]]

    for name, values in parsed(lines, delimiter, ".", row):
        groups.setdefault(name, []).append(values)
    if not groups:
        raise InputError(f"{path} holds no numbers in the columns {columns}.")
    found = []
    for name, rows in groups.items():
        rate, stretch, stress = np.array(rows).T
        found.append(RateData.at_rate(test, float(rate[0]), stretch, stress * unit, name))
    return found


class Programme:
    """Several tests on grids of time of their own, with as many intervals each.

    Parameters
    ----------
    data
        The tests.
    even
        Parts into which an interval between two points is divided.

    Attributes
    ----------
    e : logarithms of the principal stretches at the ends of intervals, (N + 1, T, 3)
    dt : lengths of the intervals in s, (N, T)
    places : for each test the ends of intervals at which its points lie
    """

    def __init__(self, data: Sequence[RateData], even: int = EVEN):
        grids = [_grid(d, even) for d in data]
        longest = max(len(t) for t, _, _ in grids)
        self.data = tuple(data)
        self.dt = np.zeros((longest - 1, len(data)))
        self.e = np.zeros((longest, len(data), 3))
        self.places = [places for _, _, places in grids]
        for k, ((t, stretch, _), d) in enumerate(zip(grids, data, strict=True)):
            self.dt[: len(t) - 1, k] = np.diff(t)
            e = log_stretches(d.test, stretch).T
            self.e[:, k] = np.concatenate([e, np.repeat(e[-1:], longest - len(t), axis=0)])

    def springs(self, tau: np.ndarray) -> list[np.ndarray]:
        """Nominal stress of a branch over its modulus at the points of each test.

        Parameters
        ----------
        tau
            Relaxation times in s, shape (...).

        Returns
        -------
        list of ndarrays of shape (n, ...)
        """
        shape = np.shape(tau)
        tau = np.asarray(tau, dtype=float).reshape(-1, 1, 1)
        v = np.ones((len(tau), *self.e.shape[1:]))
        out = np.empty((len(self.e), len(tau), self.e.shape[1]))
        square, first = np.exp(2 * self.e), np.exp(self.e[..., 0])
        e, change = self.e[:-1], np.diff(self.e, axis=0)
        # C at quarters of the intervals, for the steps that are extrapolated
        quarters = [np.exp(2 * (e + change * share)) for share in (0.25, 0.5, 0.75, 1.0)]
        out[0] = (square[0, :, 0] - square[0, :, 2]) / first[0]
        for n, dt in enumerate(self.dt):
            v = _step(v, [C[n] for C in quarters], dt[:, None] / tau)
            out[n + 1] = square[n + 1, :, 0] / v[..., 0] - square[n + 1, :, 2] / v[..., 2]
            out[n + 1] /= first[n + 1]
        return [
            out[places, :, k].reshape(len(places), *shape) for k, places in enumerate(self.places)
        ]


def _grid(d: RateData, parts: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times and stretches with intervals divided, and where the points of the data are."""
    # a first point at rest that stands later than 0 is where loading begins
    time, stretch = d.time, d.stretch
    growing = np.append(0.0, np.geomspace(SHORTEST, 1.0, AFTER_JUMP))
    even = np.linspace(0, 1, parts + 1)
    t, lam, places = [time[:1]], [stretch[:1]], [0]
    for k in range(len(time) - 1):
        held = stretch[k] == stretch[k + 1]
        share = (growing if held else even)[1:] if time[k + 1] > time[k] else np.ones(1)
        t.append(time[k] + (time[k + 1] - time[k]) * share)
        lam.append(stretch[k] + (stretch[k + 1] - stretch[k]) * share)
        places.append(places[-1] + len(share))
    return np.concatenate(t), np.concatenate(lam), np.array(places)


def _step(v: np.ndarray, C: list[np.ndarray], share: np.ndarray) -> np.ndarray:
    """C_v after an interval, from 1, 2 and 4 steps; share = dt/tau, C at its four quarters."""

    def through(*quarters: int) -> np.ndarray:
        w = v
        for k in quarters:
            w = w + share / len(quarters) * C[k]
            w = w / np.cbrt(w[..., 0] * w[..., 1] * w[..., 2])[..., None]
        return w

    one, two, four = through(3), through(1, 3), through(0, 1, 2, 3)
    return np.cbrt(one * four**8) / two**2


def rate_stress(material: Material, data: RateData | Sequence[RateData]) -> list[np.ndarray]:
    """Nominal stress in Pa of an incompressible material at the points of tests over time."""
    tests = [data] if isinstance(data, RateData) else list(data)
    branches = closed_branches(material, "rate_stress")
    tau = np.array([branch.tau for branch in branches], dtype=float)
    mu = np.array([branch.mu for branch in branches], dtype=float)
    springs = Programme(tests).springs(tau)
    return [
        nominal_stress(material.elastic, d.test, d.stretch) + s @ mu
        for d, s in zip(tests, springs, strict=True)
    ]


def rate_errors(material: Material, data: RateData | Sequence[RateData]) -> np.ndarray:
    """Root mean square error in Pa of a material's stress in each test."""
    tests = [data] if isinstance(data, RateData) else list(data)
    return np.array([
        np.sqrt(np.mean((s - d.stress)[d.measured] ** 2))
        for s, d in zip(rate_stress(material, tests), tests, strict=True)
    ])  # fmt: skip
