"""From the scatter of constants and sizes to the scatter of what a device does.

To first order a quantity f(x) of independent variables has the variance sum (df/dx s)^2 with their
standard deviations s.  Sampling by a Latin hypercube says how far that can be trusted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypedDict

import numpy as np

from dea_fenicsx.studies.samples import LatinHypercube, points
from dea_fenicsx.support.errors import DeaError, InputError, Interrupted, MachineError
from dea_fenicsx.support.type_checks import check_declared, plain_numbers, shown
from dea_fenicsx.support.validation import finite, keywords, known, one_of, positive, whole

DEVIATION_STEP = 1e-2
"""Step of a difference, over the standard deviation."""

LEAST_PROBABILITY = 1e-12
"""Distance of a sample from the ends of a distribution, as a probability."""


@dataclass(frozen=True)
@plain_numbers
class Scatter:
    """How a variable scatters.

    Parameters
    ----------
    mean
        Its mean, or the median of a lognormal one.
    deviation
        Its standard deviation, in its own unit.
    kind
        ``"normal"``, or ``"lognormal"`` for what is > 0.
    """

    mean: float
    deviation: float
    kind: str = "normal"

    def check(self, name: str) -> None:
        """Raise InputError for numbers without sense."""
        check_declared(self)
        finite(self.mean, f"The mean of {name!r}")
        positive(self.deviation, f"The standard deviation of {name!r}")
        one_of(self.kind, ("normal", "lognormal"), f"The kind of the scatter of {name!r}")
        if self.kind == "lognormal":
            positive(self.mean, f"The median of {name!r}")

    def at(self, normal: float) -> float:
        """The value at a number of a standard normal variable."""
        if self.kind == "lognormal":
            return self.mean * math.exp(normal * self.deviation / self.mean)
        return self.mean + normal * self.deviation


class UncertaintyOptions(TypedDict, total=False):
    """Keywords of `uncertainty`.

    Attributes
    ----------
    samples
        Number of samples; 0 for none.
    seed
        Samples of the same seed are the same.
    slopes
        Called with the means; returns for each quantity its derivatives by the variables, as
        `Run.sensitivity` gives them.  Without it there are central differences.
    failure
        For a quantity the least value at which the device does not fail.
    """

    samples: int
    seed: int
    slopes: Callable[..., Mapping[str, Mapping[str, float]]]
    failure: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """The scatter of quantities.

    Attributes
    ----------
    value
        Each quantity at the means.
    deviation
        Its standard deviation to first order.
    shares
        For each quantity the share of each variable in its variance.
    sampled_mean, sampled_deviation
        The same by sampling; empty without samples.
    samples
        The sampled quantities, each of shape (n,), NaN where the device has no answer.
    failure
        For each quantity with a limit the probability of falling below it, to first order.
    sampled_failure
        The same by sampling, with its standard error.  No answer counts as a failure.
    """

    value: dict[str, float]
    deviation: dict[str, float]
    shares: dict[str, dict[str, float]]
    sampled_mean: dict[str, float]
    sampled_deviation: dict[str, float]
    samples: dict[str, np.ndarray]
    failure: dict[str, float]
    sampled_failure: dict[str, tuple[float, float]]

    def __str__(self) -> str:
        lines = []
        for name, value in self.value.items():
            text = f"{name} = {value:.5g} ± {self.deviation[name]:.3g}"
            if name in self.sampled_deviation:
                text += (
                    f" (sampled {self.sampled_mean[name]:.5g} ± {self.sampled_deviation[name]:.3g})"
                )
            main = max(self.shares[name], key=lambda k: self.shares[name][k])
            lines.append(f"{text}; {100 * self.shares[name][main]:.0f} % by {main}")
        for name, p in self.failure.items():
            text = f"{name} fails with a probability of {p:.2g}"
            if name in self.sampled_failure:
                text += " (sampled {:.2g} ± {:.1g})".format(*self.sampled_failure[name])
            lines.append(text)
        return "\n".join(lines)

    __repr__ = __str__


def uncertainty(
    model: Callable[..., Mapping[str, float]], scatter: Mapping[str, Scatter], **options: Any
) -> Uncertainty:
    """The scatter of what a device does, from that of its constants and sizes.

    Parameters
    ----------
    model
        Called with the variables by name; returns quantities by name, such as a stroke, the voltage
        of pull-in, or the breakdown field over the largest field.
    scatter
        How each variable scatters, independently of the others.
    options
        ``samples`` (200), ``seed`` (1), ``slopes``, ``failure``; see `UncertaintyOptions`.

    Raises
    ------
    InputError
        For scatter without sense, a quantity that the model does not return, and a model that has
        no answer at the means.

    Notes
    -----
    The probability of failure to first order is Phi(-(value - limit)/deviation), which is exact if
    the quantity is linear and all variables are normal.  A lognormal variable enters by its
    logarithm.
    """
    given = keywords("uncertainty", options, UncertaintyOptions, {
        "samples": 200, "seed": 1, "slopes": None, "failure": {},
    })  # fmt: skip
    whole(given["samples"], "The number of samples", 0)
    if not scatter:
        raise InputError("No variable scatters; give at least one Scatter.")
    for name, one in scatter.items():
        if not isinstance(one, Scatter):
            raise InputError(f"The scatter of {name!r} is {shown(one)}, but must be Scatter(...).")
        one.check(name)
    means = {name: one.mean for name, one in scatter.items()}
    value = _quantities(model, means)
    for name, limit in given["failure"].items():
        known(name, value, "quantity", "the model")
        finite(limit, f"The limit of {name!r}")
    changes = _changes(model, scatter, value, given["slopes"])
    deviation = {q: math.sqrt(sum(c**2 for c in row.values())) for q, row in changes.items()}
    shares = {
        q: {n: c**2 / max(deviation[q] ** 2, 1e-300) for n, c in row.items()}
        for q, row in changes.items()
    }
    sampled = _sampled(model, scatter, list(value), given["samples"], given["seed"])
    with np.errstate(all="ignore"):
        mean = {q: float(np.nanmean(v)) for q, v in sampled.items()}
        spread = {q: float(np.nanstd(v, ddof=1)) for q, v in sampled.items()}
    return Uncertainty(
        value, deviation, shares, mean, spread, sampled,
        {q: _below(value[q], deviation[q], limit) for q, limit in given["failure"].items()},
        {q: _failed(sampled[q], limit) for q, limit in given["failure"].items() if sampled},
    )  # fmt: skip


def _quantities(model: Callable[..., Mapping[str, float]], at: Mapping[str, float]) -> dict:
    found = model(**at)
    if not isinstance(found, Mapping) or not found:
        raise InputError(
            f"The model returns {shown(found)}, but must return quantities by their names."
        )
    values = {str(name): float(v) for name, v in found.items()}
    for name, v in values.items():
        finite(v, f"The quantity {name!r} at {', '.join(f'{n} = {x:g}' for n, x in at.items())}")
    return values


def _changes(
    model: Callable[..., Mapping[str, float]], scatter: Mapping[str, Scatter],
    value: Mapping[str, float], slopes: Any,
) -> dict[str, dict[str, float]]:  # fmt: skip
    """The change of each quantity with one standard deviation of each variable."""
    means = {name: one.mean for name, one in scatter.items()}
    if slopes is not None:
        found = slopes(**means)
        for q in value:
            known(q, found, "quantity", "slopes")
            for name in scatter:
                known(name, found[q], "variable", f"the slopes of {q!r}")
        return {q: {n: found[q][n] * one.deviation for n, one in scatter.items()} for q in value}
    changes: dict[str, dict[str, float]] = {q: {} for q in value}
    for name, one in scatter.items():
        moved = [means | {name: one.at(sign * DEVIATION_STEP)} for sign in (1, -1)]
        ends = [_quantities(model, constants) for constants in moved]
        for q in value:
            changes[q][name] = (ends[0][q] - ends[1][q]) / (2 * DEVIATION_STEP)
    return changes


def _sampled(
    model: Callable[..., Mapping[str, float]], scatter: Mapping[str, Scatter],
    names: list[str], count: int, seed: int,
) -> dict[str, np.ndarray]:  # fmt: skip
    """The quantities at samples of the variables; NaN where the device has no answer."""
    from scipy.stats import norm

    if not count:
        return {}
    ends = (LEAST_PROBABILITY, 1 - LEAST_PROBABILITY)
    found: dict[str, np.ndarray] = {name: np.full(count, np.nan) for name in names}
    for k, share in enumerate(points(LatinHypercube(dict.fromkeys(scatter, ends), count, seed))):
        at = {name: one.at(float(norm.ppf(share[name]))) for name, one in scatter.items()}
        try:
            values = model(**at)
        except (Interrupted, MachineError):
            raise
        except DeaError:
            continue
        for name in names:
            found[name][k] = float(values.get(name, np.nan))
    return found


def _below(value: float, deviation: float, limit: float) -> float:
    """Probability that a normal variable lies below a limit."""
    if deviation == 0:
        return float(value < limit)
    return 0.5 * math.erfc((value - limit) / (deviation * math.sqrt(2)))


def _failed(values: np.ndarray, limit: float) -> tuple[float, float]:
    """Share of samples below a limit, with its standard error."""
    share = float(np.mean(~(values >= limit)))
    n = len(values)
    return share, math.sqrt(max(share * (1 - share), 1 / (4 * n)) / n)
