"""Tests of uniformly deformed films: over time by a march, or at rest over the voltage."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dea_fenicsx.calibration.experiments import Column, Experiment, columns_of
from dea_fenicsx.calibration.parameters import Trial
from dea_fenicsx.exact.branch import HomogeneousState, trace
from dea_fenicsx.exact.course import Moments
from dea_fenicsx.exact.film import Film
from dea_fenicsx.exact.marching import march
from dea_fenicsx.support.validation import known, one_of

MARCH_TOLERANCE = 1e-8
"""Relative error of a step of a march: far below that of a measurement, and of its differences."""

FILM_COLUMNS: dict[str, Callable[[Moments], np.ndarray]] = {
    "stretch": lambda m: m.stretches[0],
    "second_stretch": lambda m: m.stretches[1],
    "thickness_stretch": lambda m: m.stretches[2],
    "stress_Pa": lambda m: m.stress[0],
    "second_stress_Pa": lambda m: m.stress[1],
    "voltage_V": lambda m: m.voltage,
    "charge_C_per_m2": lambda m: m.charge,
    "capacitance_F_per_m2": lambda m: m.charge / m.voltage,
}
"""Columns of a film in time; charge and capacitance are per undeformed area."""

STATE_COLUMNS: dict[str, Callable[[HomogeneousState], float]] = {
    "stretch": lambda s: float(s.stretches[0]),
    "second_stretch": lambda s: float(s.stretches[1]),
    "thickness_stretch": lambda s: float(s.stretches[2]),
    "stress_Pa": lambda s: float(s.stress[0] / s.stretches[0]),
    "second_stress_Pa": lambda s: float(s.stress[1] / s.stretches[1]),
    "charge_C_per_m2": lambda s: s.charge,
    "capacitance_F_per_m2": lambda s: s.charge / s.voltage if s.voltage else np.nan,
}
"""Columns of a film at rest over the voltage."""


@dataclass(frozen=True, eq=False)
class FilmTest(Experiment):
    """A test of a uniformly deformed film: by `exact.march` over time, or at rest over the voltage.

    Parameters
    ----------
    name
        For reports.
    film
        Called with the trial; returns an `exact.Film`.
    x
        Times in s, or voltages in V with ``over="voltage"``, shape (n,).
    measured
        Values by the names of their columns: see `FILM_COLUMNS` and `STATE_COLUMNS`.
    error, weight
        As in `FunctionTest`.
    over
        ``"time"`` or ``"voltage"``.
    drives
        Keywords of `exact.march` over time: voltage, field, charge, sides, start.
    slack
        Whether a film under pressure carries no stress, as it folds.
    """

    name: str
    film: Callable[[Trial], Film]
    x: Any
    measured: Mapping[str, Any]
    error: Any = None
    weight: float = 1.0
    over: str = "time"
    drives: Mapping[str, Any] = field(default_factory=dict)
    slack: bool = False

    @property
    def x_name(self) -> str:  # type: ignore[override]
        return "time_s" if self.over == "time" else "voltage_V"

    def columns(self) -> list[Column]:
        one_of(self.over, ("time", "voltage"), f"What the film test {self.name!r} is over")
        names = FILM_COLUMNS if self.over == "time" else STATE_COLUMNS
        for name in self.measured:
            known(name, names, "column", "a film test")
        return columns_of(self.name, self.x, self.measured, self.error, self.weight)

    def predict(self, trial: Trial) -> Mapping[str, Any]:
        film, x = self.film(trial), np.asarray(self.x, dtype=float).ravel()
        found = self._in_time(film, x) if self.over == "time" else self._at_rest(film, x)
        if self.slack:
            stress = [name for name in found if "stress" in name]
            found |= {name: np.maximum(found[name], 0.0) for name in stress}
        return found

    def _in_time(self, film: Film, x: np.ndarray) -> dict[str, np.ndarray]:
        end = float(x.max())
        course = march(film, end, tolerance=MARCH_TOLERANCE, **self.drives)
        there = x <= course.end_time
        moments = course.at(x[there])
        found = {name: np.full(len(x), np.nan) for name in self.measured}
        with np.errstate(all="ignore"):
            for name, values in found.items():
                values[there] = FILM_COLUMNS[name](moments)
        return found

    def _at_rest(self, film: Film, x: np.ndarray) -> dict[str, np.ndarray]:
        branch = trace(film)
        found = {name: np.full(len(x), np.nan) for name in self.measured}
        for k, volts in enumerate(x):
            # the branch begins at rest without voltage, where its voltage crosses nothing
            start = [(branch.at(0.0), True)] if volts == 0 else []
            stable = [s for s, good in start or branch.states_at(float(volts)) if good]
            for name in found if stable else ():
                found[name][k] = STATE_COLUMNS[name](stable[0])
        return found
