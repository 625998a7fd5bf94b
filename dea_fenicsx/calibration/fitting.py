"""Fitting of parameters to several tests at once, by Gauss-Newton steps in a trust region."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypedDict

import numpy as np
from mpi4py import MPI

from dea_fenicsx.calibration.checks import doubt_unit, shaped
from dea_fenicsx.calibration.experiments import Column, Experiment
from dea_fenicsx.calibration.parameters import Coordinates, Parameter, Trial
from dea_fenicsx.calibration.result import Calibration, Fitted
from dea_fenicsx.calibration.statistics import covariance, directions, inflation, only_fixed
from dea_fenicsx.studies.samples import LatinHypercube, points
from dea_fenicsx.support.errors import DeaError, InputError, Interrupted, MachineError, install_hook
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.validation import keywords, whole

FAR = 1.0
"""Distance from the start, in coordinates, at which further starts are without bounds."""

MOST_TRIALS_OF_START = 200
"""Most trials from one start."""

SAME_COST = 1e-3
"""Relative difference of two sums of squares that count as the same minimum."""


class CalibrationOptions(TypedDict, total=False):
    """Keywords of `calibrate`.

    Attributes
    ----------
    starts
        Number of starts: the first as given, others by a Latin hypercube within the bounds, or
        within a factor of e where there are none.
    seed
        Starts of the same seed are the same.
    tolerance
        Relative change of the sum of squares, and of the coordinates, at which a search ends.
    comm
        The ranks.
    """

    starts: int
    seed: int
    tolerance: float
    comm: Any


def calibrate(
    tests: Experiment | Sequence[Experiment],
    parameters: Sequence[Parameter],
    material: Any = None,
    **options: Any,
) -> Calibration:
    """Find parameters from several tests at once, and tell how certain they are.  Collective.

    Parameters
    ----------
    tests
        What was measured: `RateTests`, `FilmTest`, `SceneTest`, `FunctionTest`.
    parameters
        What is to be found.
    material
        The material with the constants that are not fitted; several by their names.
    options
        ``starts`` (1), ``seed`` (1), ``tolerance`` (1e-8), ``comm``; see `CalibrationOptions`.

    Raises
    ------
    InputError
        For a parameter that there is not or that no test reads, for fewer data than parameters, and
        where the tests cannot be predicted at the start.

    Warns
    -----
    UserWarning
        If a column is hundreds of times what is predicted at the start, so that its unit is in
        doubt.

    Notes
    -----
    The residuals are (prediction - measured)/error.  Where no errors are given, each column is
    divided by its own root mean square and by the root of its number of values, so that all columns
    count alike; the variances then come from the residuals, column by column, with neighbouring
    residuals that are correlated counting for less.  Priors then weigh as against these variances.
    Regions are those of a model that is linear near the fit; with variances from the residuals they
    are right for many values only.
    """
    install_hook()
    given = keywords("calibrate", options, CalibrationOptions, {
        "starts": 1, "seed": 1, "tolerance": 1e-8, "comm": MPI.COMM_WORLD,
    })  # fmt: skip
    whole(given["starts"], "The number of starts", 1)
    whole(given["seed"], "The seed", 0)
    some = [tests] if isinstance(tests, Experiment) else list(tests)
    for test in some:
        if not isinstance(test, Experiment):
            raise InputError(
                f"tests holds {shown(test)}, but must hold RateTests, FilmTest, SceneTest or "
                "FunctionTest."
            )
    problem = LeastSquares(some, Coordinates(parameters, material), given["comm"])
    problem.check_start()
    return problem.report(problem.solve(given["starts"], given["seed"], given["tolerance"]))


@dataclass(frozen=True)
class Search:
    """Where the searches have ended: coordinates, and the sum of squares from each start."""

    z: np.ndarray
    costs: tuple[float, ...]


class LeastSquares:
    """The residuals of all tests as a function of the coordinates.

    Attributes
    ----------
    factor
        What all residuals but those of the priors are multiplied with.
    exact
        Whether the errors of the data are given.
    """

    def __init__(self, tests: Sequence[Experiment], over: Coordinates, comm: Any) -> None:
        if not tests:
            raise InputError("There are no tests to fit; give at least one.")
        names = [t.name for t in tests]
        if twice := [n for n in names if names.count(n) > 1]:
            raise InputError(f"Two tests have the name {twice[0]!r}; give each its own.")
        self.tests, self.over, self.comm = tests, over, comm
        self.columns: list[tuple[Experiment, Column]] = [(t, c) for t in tests for c in t.columns()]
        self.count = sum(len(c.measured) for _, c in self.columns)
        known = {c.error is not None for _, c in self.columns}
        if len(known) > 1:
            lacking = next(f"{t.name}: {c.name}" for t, c in self.columns if c.error is None)
            raise InputError(
                f"The errors of some columns are given, but not that of {lacking!r}; give those of "
                "all or of none."
            )
        self.exact, self.factor = known == {True}, 1.0
        self.prior_rows, self.due = over.priors()
        least = len(over) + 1 - len(self.due)
        if self.count < least:
            raise InputError(
                f"There are {self.count} measured values, but {len(over)} parameters to fit; give "
                f"at least {least} values, fewer parameters, or priors."
            )
        self.weights = [self._weight(c) for _, c in self.columns]
        self.penalty = 1e3

    def _weight(self, c: Column) -> np.ndarray:
        if c.error is not None:
            return math.sqrt(c.weight) / c.error
        size = max(float(np.sqrt(np.mean(c.measured**2))), 1e-300)
        return np.full(len(c.measured), math.sqrt(c.weight / len(c.measured)) / size)

    # ------------------------------------------------------------------ predictions

    def predicted(self, trial: Trial, test: Experiment) -> dict[str, np.ndarray]:
        """The columns of a test at a trial.

        Raises
        ------
        InputError
            If one is missing or of another length.
        """
        found = test.predict(trial)
        return {c.name: shaped(found, c, test) for t, c in self.columns if t is test}

    def _tried(self, trial: Trial, test: Experiment) -> dict[str, np.ndarray]:
        """The same, with NaN where the trial has no answer."""
        try:
            trial.check()  # before a test builds anything
            return self.predicted(trial, test)
        except (Interrupted, MachineError):
            raise
        except DeaError:
            nan = {c.name: np.full(len(c.measured), np.nan) for t, c in self.columns if t is test}
            return nan

    def _joined(self, found: Mapping[int, Mapping[str, np.ndarray]], measured: bool) -> np.ndarray:
        """Weighted columns of all tests, less what was measured."""
        parts = [
            (found[id(t)][c.name] - c.measured * measured) * w
            for (t, c), w in zip(self.columns, self.weights, strict=True)
        ]
        return np.concatenate(parts) * self.factor

    def residuals(self, z: np.ndarray) -> np.ndarray:
        """Residuals of the data, and then those of the priors.  Collective."""
        trial = self.over.trial(z)
        r = self._joined({id(t): self._tried(trial, t) for t in self.tests}, True)
        # where a trial has no answer its residuals are huge, so that the search shortens its step
        r = np.where(np.isfinite(r), r, self.penalty)
        return np.asarray(self.comm.bcast(self._with_priors(r, z), root=0))

    def _with_priors(self, r: np.ndarray, z: np.ndarray) -> np.ndarray:
        return np.concatenate([r, self.prior_rows @ z - self.due])

    def jacobian(self, z: np.ndarray) -> np.ndarray:
        """Derivatives of the residuals by the coordinates.  Collective."""
        trial = self.over.trial(z)
        exact = {id(t): t.slopes(trial) for t in self.tests}
        J = np.zeros((self.count, len(z)))
        for k, p in enumerate(self.over.all):
            slopes = {}
            for t in self.tests:
                own = exact[id(t)].get(p.name)
                if own is None:
                    slopes[id(t)] = self._difference(z, k, t)
                else:
                    slope = p.slope(trial[p.name])
                    slopes[id(t)] = {name: np.asarray(s) * slope for name, s in own.items()}
            J[:, k] = self._joined(slopes, False)
        J = np.where(np.isfinite(J), J, 0.0)
        return np.asarray(self.comm.bcast(np.concatenate([J, self.prior_rows]), root=0))

    def _fixing(self, z: np.ndarray) -> np.ndarray:
        """The Jacobian without what rounding alone fixes, so that a search does not wander."""
        return only_fixed(self.jacobian(z))

    def _difference(self, z: np.ndarray, k: int, test: Experiment) -> dict[str, np.ndarray]:
        """Central difference by a coordinate, or one-sided at the edge of what is possible."""
        ends = []
        for sign in (-1.0, 1.0):
            moved = z.copy()
            moved[k] += sign * test.step
            ends.append(self._tried(self.over.trial(moved), test))
        below, above = ends
        found = {}
        middle: dict[str, np.ndarray] = {}
        for name in below:
            slope = (above[name] - below[name]) / (2 * test.step)
            if not np.all(np.isfinite(slope)):
                middle = middle or self._tried(self.over.trial(z), test)
                sides = (above[name] - middle[name], middle[name] - below[name])
                one = np.where(np.isfinite(sides[0]), sides[0], sides[1]) / test.step
                slope = np.where(np.isfinite(slope), slope, one)
            found[name] = slope
        return found

    # ------------------------------------------------------------------ the search

    def check_start(self) -> None:
        """Raise InputError where a test has no answer at the start, or a parameter is not read."""
        trial = self.over.trial(self.over.start)
        found = {id(t): self.predicted(trial, t) for t in self.tests}
        for t, c in self.columns:
            values = found[id(t)][c.name]
            if not np.all(np.isfinite(values)):
                k = int(np.argmax(~np.isfinite(values)))
                raise InputError(
                    f"At the start the test {t.name!r} has no {c.name!r} at {t.x_name} = "
                    f"{c.x[k]:g}; start nearer to what was measured."
                )
            doubt_unit(t, c, values)
        for name in self.over.names:
            if name not in trial.read:
                raise InputError(
                    f"No test reads the parameter {name!r}; leave it out, or let a test depend on "
                    "it."
                )
        self.penalty = 1e3 + 10 * float(np.abs(self._joined(found, True)).max())

    def starts(self, count: int, seed: int) -> list[np.ndarray]:
        """Coordinates from which searches begin."""
        first, (low, high) = self.over.start, self.over.bounds
        low = np.where(np.isfinite(low), low, first - FAR)
        high = np.where(np.isfinite(high), high, first + FAR)
        low, high = np.minimum(low, first), np.maximum(high, first)
        if count == 1:
            return [first]
        names = [str(k) for k in range(len(first))]
        ranges = {n: (float(a), float(b)) for n, a, b in zip(names, low, high, strict=True)}
        others = points(LatinHypercube(ranges, count - 1, seed))
        return [first, *(np.array([one[n] for n in names]) for one in others)]

    def solve(self, count: int, seed: int, tolerance: float) -> Search:
        """The least squares.  Collective.

        Without errors of the data the priors count against the residuals that the data alone leave.
        """
        if len(self.due) and not self.exact:
            priors = self.prior_rows, self.due
            self.prior_rows, self.due = self.prior_rows[:0], self.due[:0]
            self.factor = self.factor_of(self.search(count, seed, tolerance))
            self.prior_rows, self.due = priors
        return self.search(count, seed, tolerance)

    def search(self, count: int, seed: int, tolerance: float) -> Search:
        """The best of the least squares from several starts.  Collective.

        Raises
        ------
        InputError
            If no start leads anywhere.
        """
        ends = [self._end_from(z, tolerance) for z in self.starts(count, seed)]
        costs = tuple(cost for cost, _ in ends)
        best = ends[int(np.argmin(costs))][1]
        if np.any(np.abs(self.residuals(best)[: self.count]) >= self.penalty):
            raise InputError(
                "No start leads to parameters at which all tests have an answer; start nearer, or "
                "narrow the bounds."
            )
        return Search(best, costs)

    def _end_from(self, z: np.ndarray, tolerance: float) -> tuple[float, np.ndarray]:
        """Where the search from some coordinates ends: sum of squares, coordinates.  Collective.

        Rank 0 searches, and the others evaluate what it asks for.  If each rank searched, rounding
        errors could give them different numbers of trials, and they would wait for one another.
        """
        from scipy.optimize import least_squares  # slow to load

        functions = {"residuals": self.residuals, "jacobian": self._fixing}

        def on_all_ranks(name: str) -> Callable[[np.ndarray], np.ndarray]:
            def evaluate(at: np.ndarray) -> np.ndarray:
                self.comm.bcast((name, at), root=0)
                return functions[name](at)

            return evaluate

        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            if self.comm.rank > 0:
                while (asked := self.comm.bcast(None, root=0))[0]:
                    functions[asked[0]](asked[1])
                return asked[1]
            low, high = self.over.bounds
            inside = 1e-10 * (1 + np.abs(self.over.start))
            found = least_squares(
                on_all_ranks("residuals"), np.clip(z, low + inside, high - inside),
                on_all_ranks("jacobian"), bounds=(low, high), x_scale="jac", xtol=tolerance,
                ftol=tolerance, gtol=1e-12, max_nfev=MOST_TRIALS_OF_START,
            )  # fmt: skip
            return self.comm.bcast(("", (2 * float(found.cost), found.x)), root=0)[1]

    # ------------------------------------------------------------------ the report

    def slices(self) -> list[slice]:
        """Where the residuals of each column are."""
        ends = np.cumsum([0, *(len(c.measured) for _, c in self.columns)])
        return [slice(int(a), int(b)) for a, b in pairwise(ends)]

    def factor_of(self, found: Search) -> float:
        """What brings the variance of the residuals of the data to 1."""
        r = self.residuals(found.z)[: self.count]
        shares = [1 / inflation(r[s]) for s in self.slices()]
        free = sum(f * len(r[s]) for f, s in zip(shares, self.slices(), strict=True))
        # residuals of the rounding of the data are no measure of anything
        return self.factor * math.sqrt(max(free, 1.0) / max(float(r @ r), 1e-24))

    def variances(self, J: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Variance of each residual, and the number of independent ones in each column."""
        v, count = np.ones(self.count), np.array([float(len(c.measured)) for _, c in self.columns])
        if self.exact:
            for s, (_, c) in zip(self.slices(), self.columns, strict=True):
                v[s] = c.weight
            return v, count
        both = np.concatenate([J, self.prior_rows])
        leverage = np.einsum("ij,jk,ik->i", J, np.linalg.pinv(both.T @ both), J)
        for k, s in enumerate(self.slices()):
            free = max(count[k] - float(leverage[s].sum()), 1.0)
            count[k] /= inflation(r[s])
            v[s] = float(r[s] @ r[s]) / free * inflation(r[s])
        return np.maximum(v, 1e-300), count

    def report(self, found: Search) -> Calibration:
        """What the search has found, with its certainty.  Collective."""
        z, over = found.z, self.over
        J, r = self.jacobian(z)[: self.count], self.residuals(z)[: self.count]
        v, independent = self.variances(J, r)
        C, inverse, rank = covariance(J, v, self.prior_rows)
        trial = over.trial(z)
        columns = []
        for (t, c), s, weight in zip(self.columns, self.slices(), self.weights, strict=True):
            w = weight * self.factor
            columns.append(Fitted(t, c, c.measured + r[s] / w, J[s] / w[:, None]))
        best = min(found.costs)
        same = sum(cost <= best * (1 + SAME_COST) + 1e-18 for cost in found.costs)
        return Calibration(
            parameters=over.all, values=over.values(z), coordinates=z, covariance=C,
            inverse=inverse, rank=rank, exact=self.exact,
            freedom=max(float(independent.sum()) - len(z), 1.0), independent=independent,
            directions=directions(J, v, over.names), columns=tuple(columns),
            costs=found.costs, same=same, template=over.template,
            material=None if trial.template is None else trial.material,
        )  # fmt: skip
