"""What a calibration has found: values, their certainty, what the data do not fix, predictions."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.calibration.bands import slopes_of
from dea_fenicsx.calibration.experiments import Column, Experiment
from dea_fenicsx.calibration.parameters import Coordinates, Parameter, Trial
from dea_fenicsx.calibration.statistics import (
    ParameterCombination,
    corrected_criterion,
    half_width,
    quantile,
)
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.files import replace_file
from dea_fenicsx.support.validation import known, one_of

CRITERIA = ("AICc", "BIC")
"""Criteria by which models are compared."""

AT_BOUND = 1e-6
"""Distance of a coordinate from its bound that counts as none."""


@dataclass(frozen=True, eq=False)
class Fitted:
    """A column of a test with the fit.

    Attributes
    ----------
    test, column : the test, and what was measured
    predicted : values at the fitted parameters, shape (n,)
    slopes : their derivatives by the coordinates, shape (n, p)
    """

    test: Experiment
    column: Column
    predicted: np.ndarray
    slopes: np.ndarray

    @property
    def name(self) -> str:
        """The names of the test and of the column."""
        return f"{self.test.name}: {self.column.name}"

    @property
    def residual(self) -> np.ndarray:
        """Measured less predicted values."""
        return np.asarray(self.column.measured - self.predicted)

    @property
    def rms(self) -> float:
        """Root mean square of the residual, in the column's unit."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def relative(self) -> float:
        """The same over the root mean square of what was measured."""
        return self.rms / max(float(np.sqrt(np.mean(self.column.measured**2))), 1e-300)


@dataclass(frozen=True, eq=False)
class Prediction:
    """Predicted values of a column with their band.

    Attributes
    ----------
    x : where, shape (n,)
    value : values at the fitted parameters, shape (n,)
    low, high : ends of the band of the curve, without the scatter of single measurements
    measured : what was measured there
    """

    x: np.ndarray
    value: np.ndarray
    low: np.ndarray
    high: np.ndarray
    measured: np.ndarray

    @property
    def rms(self) -> float:
        """Root mean square of measured less predicted values."""
        return float(np.sqrt(np.mean((self.measured - self.value) ** 2)))


@dataclass(frozen=True, eq=False)
class Calibration:
    """Fitted parameters.

    Attributes
    ----------
    parameters
        What was fitted.
    values
        The values by the names of the parameters.
    material
        The material with them, several by their names, or None.
    coordinates
        What was fitted by: logarithms of positive parameters, others over their size; shape (p,).
    covariance
        Of the coordinates, shape (p, p); infinite on the diagonal where nothing fixes a parameter.
    inverse, rank
        Its inverse along what is fixed, and the number of these directions.
    exact
        Whether the errors of the data were given; otherwise they are found from the residuals.
    freedom
        Number of independent residuals less that of parameters.
    independent
        Number of independent residuals of each column.
    directions
        Independent combinations of the parameters by growing certainty, from the data alone.
    columns
        What was measured, with the fit.
    costs, same
        The sum of squares from each start, and how many of them end at the least one.
    template
        The material before the fit.
    """

    parameters: tuple[Parameter, ...]
    values: dict[str, float]
    coordinates: np.ndarray
    covariance: np.ndarray
    inverse: np.ndarray
    rank: int
    exact: bool
    freedom: float
    independent: np.ndarray
    directions: tuple[ParameterCombination, ...]
    columns: tuple[Fitted, ...]
    costs: tuple[float, ...]
    same: int
    template: Any = field(repr=False)
    material: Any = field(repr=False)

    # ------------------------------------------------------------------ certainty

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviation of each parameter's coordinate: relative where it is positive."""
        spread = np.sqrt(np.diag(self.covariance))
        return {p.name: float(s) for p, s in zip(self.parameters, spread, strict=True)}

    def interval(self, name: str, share: float = 0.95) -> tuple[float, float]:
        """The interval of one parameter alone.

        Raises
        ------
        InputError
            If there is no such parameter.
        """
        known(name, self.values, "parameter", "the calibration")
        k = list(self.values).index(name)
        p, z = self.parameters[k], float(self.coordinates[k])
        wide = half_width(self.freedom, self.exact, share) * self.deviations[name]
        if not np.isfinite(wide):
            return (0.0 if p.positive else -np.inf), np.inf
        return p.value(z - wide), p.value(z + wide)

    def contains(self, values: Mapping[str, float], share: float = 0.95) -> bool:
        """Whether the common region of all parameters contains some values."""
        d = self._over.of(values) - self.coordinates
        limit = quantile(self.rank, self.freedom, self.exact, share)
        return bool(d @ self.inverse @ d <= limit)

    @property
    def correlation(self) -> np.ndarray:
        """Correlation of the coordinates, shape (p, p); NaN where nothing fixes a parameter."""
        spread = np.sqrt(np.diag(self.covariance))
        with np.errstate(all="ignore"):
            return np.asarray(self.covariance / np.outer(spread, spread))

    @property
    def loose(self) -> tuple[ParameterCombination, ...]:
        """The combinations of parameters that the data do not fix."""
        return tuple(d for d in self.directions if d.is_loose)

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """Names of the parameters that end at a bound."""
        low, high = self._over.bounds
        near = np.minimum(self.coordinates - low, high - self.coordinates) < AT_BOUND
        return tuple(p.name for p, there in zip(self.parameters, near, strict=True) if there)

    @property
    def _over(self) -> Coordinates:
        return Coordinates(self.parameters, self.template)

    def criterion(self, kind: str = "AICc", independent: float | None = None) -> float:
        """Akaike's (``"AICc"``) or Bayes' (``"BIC"``) criterion; the smaller the better.

        Parameters
        ----------
        kind
            The criterion.
        independent
            Number of independent measurements; models that are compared must have the same one.

        Notes
        -----
        Minus twice the logarithm of the likelihood is the sum of squared residuals over their
        errors where these are given, and otherwise n ln(s), s being the mean over the columns of
        the squared relative residuals.
        """
        one_of(kind, CRITERIA, "The criterion")
        n = float(self.independent.sum()) if independent is None else independent
        if self.exact:
            fit = sum(float(np.sum((f.residual / f.column.error) ** 2)) for f in self.columns)
        else:
            mean = float(np.mean([f.relative**2 for f in self.columns]))
            fit = n * float(np.log(max(mean, 1e-30)))
        return corrected_criterion(kind, fit, len(self.parameters), n)

    # ------------------------------------------------------------------ predictions

    def predict(self, test: Experiment, share: float = 0.95) -> dict[str, Prediction]:
        """A test's columns at the fitted parameters, with the band that their covariance gives.

        The test may be one that was not fitted.  To first order: the variance of a value is
        g^T C g with its derivative g by the coordinates.  Collective for a `SceneTest`.

        Raises
        ------
        InputError
            If the test has no answer.
        """
        over = self._over
        trial = over.trial(self.coordinates)
        found = dict(test.predict(trial))
        slopes = slopes_of(over, self.coordinates, test)
        C = np.where(np.isfinite(self.covariance), self.covariance, 0.0)
        wide = half_width(self.freedom, self.exact, share)
        made = {}
        for c in test.columns():
            if c.name not in found:
                raise InputError(f"The test {test.name!r} predicts no column {c.name!r}.")
            value = np.broadcast_to(np.asarray(found[c.name], dtype=float), c.measured.shape)
            g = slopes[c.name]
            half = wide * np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", g, C, g), 0.0))
            made[c.name] = Prediction(c.x, value, value - half, value + half, c.measured)
        return made

    def trial(self) -> Trial:
        """The fitted parameters as tests read them."""
        return self._over.trial(self.coordinates)

    # ------------------------------------------------------------------ the report

    def summary(self) -> dict[str, Any]:
        """All findings as numbers and texts that JSON keeps; infinite ones are None."""
        return _plain({
            "parameters": {
                p.name: {
                    "value": self.values[p.name], "deviation": self.deviations[p.name],
                    "relative": p.positive, "interval_95": list(self.interval(p.name)),
                    "bounds": [p.low, p.high], "prior": p.prior, "start": p.start,
                } for p in self.parameters
            },
            "covariance": self.covariance.tolist(),
            "correlation": self.correlation.tolist(),
            "columns": {
                f.name: {"rms": f.rms, "relative_rms": f.relative, "values": len(f.residual)}
                for f in self.columns
            },
            "loose": [{"parts": d.parts, "deviation": d.deviation} for d in self.loose],
            "directions": [{"parts": d.parts, "deviation": d.deviation} for d in self.directions],
            "at_bounds": list(self.at_bounds), "errors_given": self.exact,
            "freedom": self.freedom, "independent": float(self.independent.sum()),
            "AICc": self.criterion("AICc"), "BIC": self.criterion("BIC"),
            "starts": list(self.costs), "starts_at_the_least": self.same,
        })  # type: ignore[no-any-return]  # fmt: skip

    def __str__(self) -> str:
        lines = []
        for p in self.parameters:
            low, high = self.interval(p.name)
            lines.append(f"{p.name} = {self.values[p.name]:.5g} (95 %: {low:.4g} to {high:.4g})")
        lines += [f"the data do not fix {d}" for d in self.loose]
        lines += [f"{name} ends at a bound" for name in self.at_bounds]
        lines += [
            f"{f.name}: root mean square residual {f.rms:.4g} ({100 * f.relative:.2g} %)"
            for f in self.columns
        ]
        if len(self.costs) > 1:
            lines.append(f"{self.same} of {len(self.costs)} starts end at the least squares")
        return "\n".join(lines)

    __repr__ = __str__

    def write(self, folder: str | os.PathLike) -> Path:
        """Write calibration.json, calibration.txt and calibration.png.

        On one rank; call it where ``comm.rank == 0``.
        """
        from dea_fenicsx.calibration.picture import draw

        place = Path(folder)
        place.mkdir(parents=True, exist_ok=True)
        text = json.dumps(self.summary(), indent=1, allow_nan=False) + "\n"
        replace_file(place / "calibration.json", lambda p: p.write_text(text, "utf-8"))
        told = str(self) + "\n"
        replace_file(place / "calibration.txt", lambda p: p.write_text(told, "utf-8"))
        draw(self, place / "calibration.png")
        return place


def _plain(value: Any) -> Any:
    """What JSON keeps: numbers that are not finite become None."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
