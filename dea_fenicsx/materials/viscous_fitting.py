"""Fitting of viscous branches, with the equilibrium beside them, to tests over time."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from dea_fenicsx.materials.base import Elastic, constants
from dea_fenicsx.materials.fitted import constants_told, with_spread
from dea_fenicsx.materials.fitting import (
    PENALTY_RESIDUAL,
    TestData,
    _deviation,
    _flat,
    _shaped,
    _start,
)  # fmt: skip
from dea_fenicsx.materials.material import Material
from dea_fenicsx.materials.rate_data import Programme, RateData, rate_errors
from dea_fenicsx.materials.stretches import nominal_stress
from dea_fenicsx.materials.viscous import Maxwell
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import whole

MOST_BRANCHES = 4
"""Largest number of branches that is tried unless it is given."""

MOST_TRIALS_OF_BRANCHES = 40
"""Most trials of constants from one start."""

TIME_STEP = 1e-5
"""Relative step of a relaxation time for the derivative by it."""

EXACT = 1e-3
"""Relative error below which no more branches are tried: no test is measured better."""

SMALLEST_GAIN = 1.002
"""Fall of the sum of squares with one branch more, below which no more are tried."""

SLOWEST = 100.0
"""Longest relaxation time that is tried, relative to the longest test."""

FASTEST = 0.02
"""Shortest one, relative to the shortest time between two points."""

LEAST_BRANCH_MODULUS = 1e-9
"""Smallest modulus of a branch, relative to the size of the stresses."""


@dataclass(frozen=True, eq=False)
class RateFit:
    """Fitted equilibrium and branches.

    Attributes
    ----------
    model
        The elastic model of the equilibrium with the fitted constants.
    branches
        The branches, by growing relaxation time.
    uncertainty
        Standard deviation of each constant of the model, by name; infinite where the data do not
        determine it.
    branch_uncertainty
        The same of mu and tau of each branch.
    data
        The tests.
    criterion
        For each number of branches that was tried the criterion of the choice, the smallest being
        best; see `fit_rates`.
    """

    model: Elastic
    branches: tuple[Maxwell, ...]
    uncertainty: dict[str, Any]
    branch_uncertainty: tuple[tuple[float, float], ...]
    data: tuple[RateData, ...]
    criterion: dict[int, float]

    @property
    def material(self) -> Material:
        """Equilibrium and branches as a material, without electric properties."""
        return Material(self.model, viscous=self.branches)

    @cached_property
    def errors(self) -> np.ndarray:
        """Root mean square error in Pa of each test."""
        return rate_errors(self.material, self.data)

    def predicted(self, data: RateData | Sequence[RateData]) -> np.ndarray:
        """Root mean square error in Pa in tests that were not fitted."""
        return rate_errors(self.material, data)

    def __str__(self) -> str:
        told = [
            f"({with_spread(b.mu, dm)} Pa, {with_spread(b.tau, dt)} s)"
            for b, (dm, dt) in zip(self.branches, self.branch_uncertainty, strict=True)
        ]
        branches = ", ".join(told) or "none"
        share = [
            e / np.sqrt(np.mean(d.stress[d.measured] ** 2))
            for e, d in zip(self.errors, self.data, strict=True)
        ]
        return (
            f"{constants_told(self.model, self.uncertainty)}; branches {branches}; "
            f"root mean square error {100 * min(share):.1f} to {100 * max(share):.1f} %"
        )


def fit_rates(
    model: Any, data: RateData | Sequence[RateData], branches: int | None = None
) -> RateFit:
    """Fit an equilibrium model and Maxwell branches to tests over time, each of equal weight.

    Parameters
    ----------
    model
        The elastic model of the equilibrium: one to start from, or a class, as in `fit`.
    data
        The tests: relaxation, cycles at several rates, or both.
    branches
        How many branches.  None chooses among 0 to `MOST_BRANCHES`.

    Raises
    ------
    InputError
        If there are too few points, or no admissible start.

    Notes
    -----
    The number of branches is chosen by Bayes' information criterion, n ln(RSS/n) + k ln n, with k
    constants and the sum RSS of the squared relative errors.  The criterion is made for errors that
    are independent, but those along a measured curve are not: they are the model's own, and smooth.
    So n is the number of independent errors, for each test its number of points times
    (1 - rho)/(1 + rho) with the correlation rho of neighbouring errors under the richest model.
    With the plain number of points the criterion would always take the largest number of branches.
    """
    tests = [data] if isinstance(data, RateData) else list(data)
    if not tests:
        raise InputError("There are no data to fit.")
    if branches is not None:
        whole(branches, "The number of branches", 0)
    first = _start(model, _as_curves(tests)) if isinstance(model, type) else model
    points = sum(int(d.measured.sum()) for d in tests)
    least = len(_flat(first)) + 2 * (branches or 0) + 1
    if points < least:
        raise InputError(
            f"There are {points} measured points, but {least - 1} constants to fit; give at least "
            f"{least} points or fewer branches."
        )
    problem = _Problem(first, tests)
    numbers = range(MOST_BRANCHES + 1) if branches is None else [branches]
    found: dict[int, np.ndarray] = {}
    for k in numbers:
        if len(_flat(first)) + 2 * k < points:
            found[k] = problem.solve(k, found.get(k - 1))
            gain = problem.cost(found[k - 1]) / problem.cost(found[k]) if k - 1 in found else 2.0
            if gain < SMALLEST_GAIN or problem.cost(found[k]) < EXACT**2 * len(tests):
                break
    independent = problem.independent(found[max(found)])
    criterion = {k: problem.criterion(x, independent) for k, x in found.items()}
    best = min(criterion, key=lambda k: criterion[k])
    return problem.report(found[best], criterion, independent)


def _as_curves(tests: Sequence[RateData]) -> list[TestData]:
    return [TestData(d.test, d.stretch[d.measured], d.stress[d.measured]) for d in tests]


class _Problem:
    """Least squares for a number of branches.

    The unknowns are the model's constants over their start values, ln(mu/size) and ln(tau) of the
    branches, `size` being the largest root mean square stress.
    """

    def __init__(self, first: Any, tests: list[RateData]):
        self.first, self.tests = first, tests
        self.programme = Programme(tests, even=1)
        self.start = _flat(first)
        self.scale = np.where(self.start == 0, 1.0, np.abs(self.start))
        self.own = len(self.start)
        rms = [float(np.sqrt(np.mean(d.stress[d.measured] ** 2))) for d in tests]
        self.size = max(max(rms), 1e-300)
        self.weights = [
            1 / max(r, 1e-300) / np.sqrt(d.measured.sum()) for r, d in zip(rms, tests, strict=True)
        ]
        gaps = np.concatenate([np.diff(d.time) for d in tests])
        longest = max(float(d.time[-1]) for d in tests)
        self.range = FASTEST * float(np.min(gaps[gaps > 0], initial=longest)), SLOWEST * longest
        self.span = float(np.min(gaps[gaps > 0], initial=longest)), longest

    # ------------------------------------------------------------------ residuals

    def split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Constants of the model, moduli and relaxation times."""
        k = (len(x) - self.own) // 2
        return (
            x[: self.own] * self.scale,
            np.exp(x[self.own : self.own + k]) * self.size,
            np.exp(x[self.own + k :]),
        )

    def joined(self, parts: list[np.ndarray]) -> np.ndarray:
        """Weighted values of all measured points, one after the other along axis 0."""
        return np.concatenate([
            w * p[d.measured] for w, p, d in zip(self.weights, parts, self.tests, strict=True)
        ])  # fmt: skip

    def elastic(self, values: np.ndarray) -> np.ndarray:
        model = _shaped(self.first, values)
        with np.errstate(all="ignore"):
            return self.joined([nominal_stress(model, d.test, d.stretch) for d in self.tests])

    def springs(self, tau: np.ndarray) -> np.ndarray:
        """Weighted stresses of branches over their moduli, shape (n, K)."""
        if not len(tau):
            return np.zeros((len(self.measured), 0))
        return self.joined(self.programme.springs(tau))

    @cached_property
    def measured(self) -> np.ndarray:
        return self.joined([d.stress for d in self.tests])

    def residuals(self, x: np.ndarray) -> np.ndarray:
        values, mu, tau = self.split(x)
        r = self.elastic(values) + self.springs(tau) @ mu - self.measured
        # A trial beyond lock-up has a huge residual, so the method shortens its step.
        return np.where(np.isfinite(r), r, PENALTY_RESIDUAL)

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        values, mu, tau = self.split(x)
        K = len(tau)
        both = self.springs(np.append(tau, tau * (1 + TIME_STEP)))
        J = np.empty((len(self.measured), len(x)))
        for k in range(self.own):
            step = np.zeros(self.own)
            step[k] = 1e-6 * self.scale[k]
            J[:, k] = (self.elastic(values + step) - self.elastic(values - step)) / 2e-6
        J[:, self.own : self.own + K] = both[:, :K] * mu
        J[:, self.own + K :] = (both[:, K:] - both[:, :K]) / np.log1p(TIME_STEP) * mu
        return np.where(np.isfinite(J), J, 0.0)

    # ------------------------------------------------------------------ solution

    def cost(self, x: np.ndarray) -> float:
        """Sum of squared errors."""
        r = self.residuals(x)
        return max(float(r @ r), 1e-300)

    def solve(self, branches: int, fewer: np.ndarray | None = None) -> np.ndarray:
        """Best constants for a number of branches, from several starts.

        `fewer` are the best ones for one branch less.
        """
        from scipy.optimize import least_squares  # slow to load, and most scripts fit nothing

        low = np.full(self.own + 2 * branches, -np.inf)
        high = -low
        low[self.own : self.own + branches] = np.log(LEAST_BRANCH_MODULUS)
        low[self.own + branches :], high[self.own + branches :] = np.log(self.range)
        best, cost = None, np.inf
        for x in self.starts(branches, fewer):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                found = least_squares(
                    self.residuals, np.clip(x, low + 1e-9, high - 1e-9), self.jacobian,
                    bounds=(low, high), x_scale="jac", xtol=1e-7, ftol=1e-7, gtol=1e-9,
                    max_nfev=MOST_TRIALS_OF_BRANCHES,
                )  # fmt: skip
            good = not _shaped(self.first, found.x[: self.own] * self.scale).faults()
            if good and found.cost < cost:
                best, cost = found.x, found.cost
        if best is None:
            raise InputError(
                f"No admissible {type(self.first).__name__} model was found from {self.first}; "
                "start nearer."
            )
        order = np.argsort(best[self.own + branches :])
        return np.concatenate([
            best[: self.own], best[self.own : self.own + branches][order],
            best[self.own + branches :][order],
        ])  # fmt: skip

    def starts(self, branches: int, fewer: np.ndarray | None = None) -> list[np.ndarray]:
        """Relaxation times spread over the times of the tests, with the best moduli for them."""
        from scipy.optimize import nnls

        low, high = np.log(self.span)
        spread = [(0.0, 1.0)] if branches < 2 else [(0.0, 1.0), (0.2, 0.8)]
        made = [] if fewer is None else [self.widened(fewer)]
        for a, b in spread:
            share = a + (b - a) * (np.arange(branches) + 0.5) / max(branches, 1)
            tau = np.exp(low + (high - low) * share)
            A = np.column_stack([self.elastic(self.start)[:, None], self.springs(tau)])
            if not np.all(np.isfinite(A)):
                A[:, 0] = 0.0
            moduli = nnls(A / self.weights[0], self.measured / self.weights[0])[0]
            mu = np.maximum(moduli[1:] / self.size, 0.01)
            factor = np.clip(moduli[0], 0.05, 20.0)
            values = self.start / self.scale
            first = _shaped(self.first, self.start)
            # only constants in Pa grow with the stress: tell them by what they do to it
            grown = np.array([
                factor if _is_modulus(first, k) else 1.0 for k in range(self.own)
            ])  # fmt: skip
            made.append(np.concatenate([values * grown, np.log(mu), np.log(tau)]))
        return made

    def widened(self, x: np.ndarray) -> np.ndarray:
        """The same with one small branch more, in the widest gap between relaxation times."""
        k = (len(x) - self.own) // 2
        ln_tau = x[self.own + k :]
        ends = np.sort(np.concatenate([np.log(self.span), ln_tau]))
        gap = int(np.argmax(np.diff(ends)))
        middle = (ends[gap] + ends[gap + 1]) / 2
        return np.concatenate([x[: self.own + k], [np.log(0.02)], ln_tau, [middle]])

    # ------------------------------------------------------------------ choice and report

    def independent(self, x: np.ndarray) -> float:
        """Number of independent errors; see `fit_rates`."""
        r, total, at = self.residuals(x), 0.0, 0
        for d in self.tests:
            n = int(d.measured.sum())
            own = r[at : at + n]
            at += n
            size = float(own @ own)
            rho = float(own[1:] @ own[:-1]) / size if size > 0 else 0.0
            rho = min(max(rho, 0.0), 1 - 1e-9)
            total += max(n * (1 - rho) / (1 + rho), 1.0)
        return total

    def criterion(self, x: np.ndarray, independent: float) -> float:
        r = self.residuals(x)
        rss = max(float(r @ r) / len(self.tests), 1e-30)
        return independent * np.log(rss) + len(x) * np.log(independent)

    def report(self, x: np.ndarray, criterion: dict[int, float], independent: float) -> RateFit:
        values, mu, tau = self.split(x)
        size = np.maximum(np.abs(x), 1.0)
        deviation = _deviation(self.residuals, x, size, max(len(self.measured) - len(x), 1))
        # neighbouring errors are not independent, so constants are less certain
        deviation = deviation * np.sqrt(max(len(self.measured) / independent, 1.0))
        k = len(mu)
        own = _shaped(self.first, deviation[: self.own] * self.scale)
        return RateFit(
            model=_shaped(self.first, values),
            branches=tuple(Maxwell(float(m), float(t)) for m, t in zip(mu, tau, strict=True)),
            uncertainty={name: getattr(own, name) for name in constants(own)},
            branch_uncertainty=tuple(
                (float(m * dm), float(t * dt)) for m, dm, t, dt in zip(
                    mu, deviation[self.own : self.own + k], tau, deviation[self.own + k :],
                    strict=True,
                )
            ),
            data=tuple(self.tests),
            criterion=criterion,
        )  # fmt: skip


def _is_modulus(model: Any, k: int) -> bool:
    """Whether the stress grows with a constant in proportion, at small strain."""
    values = _flat(model)
    grown = values.copy()
    grown[k] *= 1.01
    small = np.array([1.01])
    before = nominal_stress(model, "uniaxial", small)
    after = nominal_stress(_shaped(model, grown), "uniaxial", small)
    return bool(after > 1.003 * before)
