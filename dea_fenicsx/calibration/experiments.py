"""What a fit is compared with: tests without a mesh, each with any number of measured columns."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from dea_fenicsx.calibration.parameters import Trial
from dea_fenicsx.materials import Material, RateData
from dea_fenicsx.materials.rate_data import Programme
from dea_fenicsx.materials.stretches import nominal_stress
from dea_fenicsx.materials.viscous import closed_branches
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.validation import known, positive

TIME_STEP = 1e-5
"""Relative step of a relaxation time for the derivative by it."""

MOST_TIME_SETS_KEPT = 3
"""Number of sets of relaxation times for which the stresses of branches are kept."""


@dataclass(frozen=True, eq=False)
class Column:
    """One measured quantity of a test.

    Attributes
    ----------
    name : its name, ending in its unit as in ``"stress_Pa"``
    x : where it was measured, shape (n,)
    measured : its values, shape (n,)
    error : standard deviation of each value, shape (n,), or None where it is not known
    weight : what its sum of squares is multiplied with
    """

    name: str
    x: np.ndarray
    measured: np.ndarray
    error: np.ndarray | None
    weight: float


class Experiment(ABC):
    """A test: what was measured, and how a trial's parameters predict it.

    Attributes
    ----------
    name
        For reports.
    x_name
        What stands on the axis below, ending in its unit.
    step
        Step of a coordinate (a relative change of a positive parameter) in differences.
    """

    __test__ = False  # not a test of pytest's
    name: str
    x_name: str
    step: float = 1e-4
    quantity: str = ""
    """What all columns are, ending in its unit, where their names do not say it."""

    @abstractmethod
    def columns(self) -> list[Column]:
        """What was measured."""

    @abstractmethod
    def predict(self, trial: Trial) -> Mapping[str, Any]:
        """The values of all columns, by their names.  NaN where a trial has none."""

    def slopes(self, trial: Trial) -> Mapping[str, Mapping[str, Any]]:
        """For each parameter that it knows the derivatives of all columns by its value."""
        return {}


def columns_of(
    name: str, x: Any, measured: Mapping[str, Any], error: Any, weight: float
) -> list[Column]:
    """Check and collect the columns of a test.

    Raises
    ------
    InputError
        For lengths that differ, and for what is no number.
    """
    positive(weight, f"The weight of the test {name!r}")
    places = _numbers(x, f"The places x of the test {name!r}")
    if not isinstance(measured, Mapping) or not measured:
        raise InputError(
            f"The test {name!r} has measured = {shown(measured)}, but needs arrays by the names of "
            "their columns."
        )
    if isinstance(error, Mapping):
        for column in error:
            known(column, measured, "measured column", f"the test {name!r}")
    found = []
    for column, values in measured.items():
        got = _numbers(values, f"The column {column!r} of the test {name!r}")
        if len(got) != len(places):
            raise InputError(
                f"The column {column!r} of the test {name!r} has {len(got)} values at "
                f"{len(places)} places, but must have as many of each."
            )
        spread = error.get(column) if isinstance(error, Mapping) else error
        if spread is not None:
            spread = np.broadcast_to(
                _numbers(spread, f"The error of {column!r} of the test {name!r}"), got.shape
            )
            if not np.all(spread > 0):
                raise InputError(f"The error of {column!r} of the test {name!r} must be > 0.")
        found.append(Column(str(column), places, got, spread, float(weight)))
    return found


def _numbers(values: Any, what: str) -> np.ndarray:
    try:
        found = np.atleast_1d(np.asarray(values, dtype=float)).ravel()
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{what}: {shown(values)} is no array of numbers.") from error
    if not len(found) or not np.all(np.isfinite(found)):
        raise InputError(f"{what} must be finite numbers, at least one.")
    return found


@dataclass(frozen=True, eq=False)
class FunctionTest(Experiment):
    """A test that a function of yours predicts: a device, a formula, another program.

    Parameters
    ----------
    name
        For reports.
    predict_by
        Called as ``predict_by(trial, x)``; returns the values of all columns by their names, or an
        array if there is one column.
    x
        Where it was measured, shape (n,).
    measured
        Values by the names of their columns, which end in their units, each of shape (n,).
    error
        Standard deviation of a measured value: a number, an array, or either by column.  None if it
        is not known; it is then found from the residuals.
    weight
        What its sum of squares is multiplied with.
    slopes_by
        Called as ``slopes_by(trial, x)``; returns for each parameter the derivatives of all columns
        by its value.  Parameters that it leaves out are differenced.
    x_name, step
        See `Experiment`.
    """

    name: str
    predict_by: Callable[[Trial, np.ndarray], Any]
    x: Any
    measured: Mapping[str, Any]
    error: Any = None
    weight: float = 1.0
    slopes_by: Callable[[Trial, np.ndarray], Any] | None = None
    x_name: str = "x"
    step: float = 1e-4

    def columns(self) -> list[Column]:
        return columns_of(self.name, self.x, self.measured, self.error, self.weight)

    def predict(self, trial: Trial) -> Mapping[str, Any]:
        found = self.predict_by(trial, np.asarray(self.x, dtype=float))
        if isinstance(found, Mapping):
            return found
        return {next(iter(self.measured)): found}

    def slopes(self, trial: Trial) -> Mapping[str, Mapping[str, Any]]:
        if self.slopes_by is None:
            return {}
        found: Mapping[str, Mapping[str, Any]] = self.slopes_by(trial, np.asarray(self.x, float))
        return found


@dataclass(frozen=True, eq=False)
class RateTests(Experiment):
    """Tests of a material at known stretches over time: relaxation, cycles, slow loading.

    Parameters
    ----------
    name
        For reports.
    data
        The tests; each is a column of its own.
    error
        Standard deviation of a stress in Pa: a number, or numbers by the name of the test.
    weight
        What the sum of squares is multiplied with.
    of
        The name of the material where the fit has several.

    Notes
    -----
    The derivatives by the branches are exact or differenced without a new march of the others.
    """

    name: str
    data: Sequence[RateData]
    error: Any = None
    weight: float = 1.0
    of: str = ""
    x_name: str = "stretch"
    step: float = 1e-5
    quantity: str = "nominal_stress_Pa"

    @cached_property
    def _named(self) -> dict[str, RateData]:
        data = [self.data] if isinstance(self.data, RateData) else list(self.data)
        if not data:
            raise InputError(f"The tests {self.name!r} hold no data.")
        found = {}
        for k, one in enumerate(data):
            name = one.name or f"{one.test} {k + 1}"
            found[name if name not in found else f"{name} ({k + 1})"] = one
        return found

    @cached_property
    def _kept(self) -> dict[tuple[float, ...], dict[str, np.ndarray]]:
        """What `_springs` has found for the last relaxation times."""
        return {}

    @cached_property
    def _programme(self) -> Programme:
        return Programme(list(self._named.values()))

    def columns(self) -> list[Column]:
        found = []
        for name, one in self._named.items():
            held = np.ptp(one.stretch[one.measured]) == 0
            x = (one.time if held else one.stretch)[one.measured]
            error = self.error.get(name) if isinstance(self.error, Mapping) else self.error
            own = columns_of(self.name, x, {name: one.stress[one.measured]}, error, self.weight)
            found += own
        return found

    def _elastic(self, elastic: Any) -> dict[str, np.ndarray]:
        with np.errstate(all="ignore"):
            return {
                name: nominal_stress(elastic, one.test, one.stretch[one.measured])
                for name, one in self._named.items()
            }

    def _springs(self, tau: Sequence[float]) -> dict[str, np.ndarray]:
        """Stress of each branch over its modulus, each of shape (n, K)."""
        key = tuple(map(float, tau))
        if key not in self._kept:  # differences by other parameters need no new march
            while len(self._kept) >= MOST_TIME_SETS_KEPT:
                del self._kept[next(iter(self._kept))]
            parts = self._programme.springs(np.array(key))
            self._kept[key] = {
                name: part[one.measured]
                for (name, one), part in zip(self._named.items(), parts, strict=True)
            }
        return self._kept[key]

    def _material(self, trial: Trial) -> Material:
        found = trial.material
        if self.of:
            known(self.of, found, "material", "the fit")
        one: Material = found[self.of] if self.of else found
        return one

    def predict(self, trial: Trial) -> Mapping[str, Any]:
        material = self._material(trial)
        branches = closed_branches(material, "RateTests")
        found = self._elastic(material.elastic)
        if branches:
            mu = np.array([b.mu for b in branches])
            springs = self._springs([b.tau for b in branches])
            found = {name: stress + springs[name] @ mu for name, stress in found.items()}
        return found

    def slopes(self, trial: Trial) -> Mapping[str, Mapping[str, Any]]:
        branches, dot = closed_branches(self._material(trial), "RateTests"), "." * bool(self.of)
        if not branches:
            return {}
        mu, tau = (np.array([getattr(b, n) for b in branches]) for n in ("mu", "tau"))
        K, both = len(mu), self._springs([*tau, *(tau * (1 + TIME_STEP))])
        slopes: dict[str, dict[str, Any]] = {}
        for k in range(K):
            slopes[f"{self.of}{dot}viscous[{k}].mu"] = {n: s[:, k] for n, s in both.items()}
            change = mu[k] / (tau[k] * TIME_STEP)
            slopes[f"{self.of}{dot}viscous[{k}].tau"] = {
                n: (s[:, K + k] - s[:, k]) * change for n, s in both.items()
            }
        return {name: slopes[name] for name in slopes if name in trial}
