"""Fitting a model's constants to measured stress-stretch curves."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dea_fenicsx.materials.base import Elastic, constants
from dea_fenicsx.materials.chains import ArrudaBoyce, Gent
from dea_fenicsx.materials.curve_data import TestData
from dea_fenicsx.materials.fit_starts import other_starts
from dea_fenicsx.materials.fitted import Fit
from dea_fenicsx.materials.polynomial import MooneyRivlin, NeoHookean, Yeoh
from dea_fenicsx.materials.stretches import log_stretches, nominal_stress, taylor
from dea_fenicsx.support.errors import InputError

SOFTEST_PA, STIFFEST_PA = 1e3, 1e8
"""Initial shear moduli in Pa outside which the stress unit is doubted."""

PENALTY_RESIDUAL = 1e3
"""Residual in place of one whose stress is not finite."""

LEAST_MODULUS = 1e-3
"""Smallest initial shear modulus of an admissible fit, over that of the model it starts from.

It counts where the least squares without this bound have no positive initial shear modulus.
"""

DIFFERENCE_STEP = 1e-5
"""Step of a central difference, relative to the constant.  Its error is about 1e-10."""

SMALLEST_SENSITIVITY = 1e-6
"""Smallest relative change of the stresses by which data determine a constant.

It is the change if the constant changes by its own size.
"""

SMALLEST_SINGULAR_VALUE_OF_CONSTANTS = 1e-8
"""Smallest singular value, relative to the largest, of an independent combination of constants.

It is well above the error of the central differences.
"""

SMALLEST_COMPONENT_OF_CONSTANT = 1e-4
"""Smallest component of a constant in a direction of constants that counts."""


def fit(model: Any, data: TestData | Sequence[TestData], starts: int = 8) -> Fit:
    """Fit a model's constants to one or several curves, each curve of equal weight.

    Parameters
    ----------
    model
        A model to start from, such as ``Ogden.from_eq76((1e5, 1e3), (1.3, 5.0))``; or one of the
        classes NeoHookean, MooneyRivlin, Yeoh, Gent and ArrudaBoyce, which find their own start.
    data
        The curves.
    starts
        Number of starting points: the first as given, others scattered about it.

    Raises
    ------
    InputError
        If there are too few points, or no admissible start.

    Warns
    -----
    UserWarning
        If the stresses look like another unit than Pa.
    """
    curves = [data] if isinstance(data, TestData) else list(data)
    if not curves:
        raise InputError("There are no data to fit.")
    first = _start(model, curves) if isinstance(model, type) else model
    x0 = _flat(first)
    points = sum(int(np.sum(np.abs(c.stretch - 1) > 1e-9)) for c in curves)
    if points < len(x0) + 1:
        raise InputError(
            f"There are {points} data points away from stretch 1, but {type(first).__name__} has "
            f"{len(x0)} constants; give at least {len(x0) + 1}."
        )
    _doubt_units(curves)
    sizes = [max(float(np.sqrt(np.mean(c.stress**2))), 1e-300) for c in curves]

    def residuals(x: np.ndarray) -> np.ndarray:
        m = _shaped(first, x * scale)
        out = [
            (nominal_stress(m, c.test, c.stretch) - c.stress) / size / np.sqrt(len(c.stress))
            for c, size in zip(curves, sizes, strict=True)
        ]
        r = np.concatenate(out)
        # A trial beyond lock-up has a huge residual, so the method shortens its step.
        return np.where(np.isfinite(r), r, PENALTY_RESIDUAL)

    scale = np.where(x0 == 0, 1.0, np.abs(x0))
    rng = np.random.default_rng(0)
    scattered = [rng.uniform(0.5, 1.5, len(x0)) for _ in range(max(starts, 1) - 1)]
    others = [_flat(other) / scale for other in other_starts(first, curves)]
    best, lowest = None, np.inf
    for x in [x0 / scale, *(x0 / scale * s for s in scattered), *others]:
        found = _searched(residuals, x)
        lowest = min(lowest, found.cost)
        good = not _shaped(first, found.x * scale).faults()
        if good and (best is None or found.cost < best.cost * (1 - 1e-12)):
            best = found
    if best is None or lowest < best.cost * (1 - 1e-9):
        # The least squares are those of a model that is not admissible.
        def admissible(x: np.ndarray) -> bool:
            return not _shaped(first, x * scale).faults()

        def modulus(x: np.ndarray) -> float:
            return float(_shaped(first, x * scale).shear_modulus())

        best = _within(residuals, [x0 / scale, *others], admissible, modulus, best)
    if best is None:
        raise InputError(
            f"No admissible {type(first).__name__} model was found from {first}; start nearer."
        )
    size = np.maximum(np.abs(best.x), 1.0)
    deviation = _deviation(residuals, best.x, size, len(best.fun) - len(best.x))
    return _report(first, best.x * scale, deviation * scale, curves)


def _searched(residuals: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> Any:
    """The least squares that are found from a starting point."""
    from scipy.optimize import least_squares  # slow to load, and most scripts fit nothing

    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        return least_squares(residuals, x, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14)


def _within(
    residuals: Callable[[np.ndarray], np.ndarray],
    starts: Sequence[np.ndarray],
    admissible: Callable[[np.ndarray], bool],
    modulus: Callable[[np.ndarray], float],
    best: Any,
) -> Any:
    """The least squares among admissible models, or None.

    Each search stays on this side of `LEAST_MODULUS`, and of every other bound by a large residual
    beyond it.

    Parameters
    ----------
    residuals, starts
        The residuals as a function of the constants, and where the searches begin.
    admissible, modulus
        Whether a model is admissible, and its initial shear modulus in Pa.
    best
        The best admissible model that is known, or None.
    """
    from scipy.optimize import minimize

    def guarded(x: np.ndarray) -> np.ndarray:
        r = residuals(x)
        return r if admissible(x) else np.full_like(r, PENALTY_RESIDUAL)

    for x in starts:
        if not admissible(x):
            continue
        size = modulus(x)
        bound = {"type": "ineq", "fun": lambda y, size=size: modulus(y) / size - LEAST_MODULUS}
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            ends = [x, minimize(
                lambda y: float(np.sum(residuals(y) ** 2)), x, method="SLSQP", constraints=[bound],
                options={"ftol": 1e-14, "maxiter": 500},
            ).x]  # fmt: skip
        for end in ends:
            if not (np.all(np.isfinite(end)) and admissible(end)):
                continue
            found = _searched(guarded, end)
            if admissible(found.x) and (best is None or found.cost < best.cost):
                best = found
    return best


def _deviation(
    residuals: Callable[[np.ndarray], np.ndarray], x: np.ndarray, size: np.ndarray, freedom: int
) -> np.ndarray:
    """Standard deviation of each constant of a least-squares fit; infinite where it is not fixed.

    With the Jacobian J = dr/dx = U S V^T and the residuals' variance s^2 = |r|^2 / freedom, the
    covariance of the constants is s^2 (J^T J)^-1 = s^2 V S^-2 V^T.  The columns of J are first
    brought to length 1.  Where a singular value vanishes, the constants that take part in its
    direction can change together without a change of the stresses.

    Parameters
    ----------
    residuals
        Residuals over the size of the stresses, as a function of the constants.
    x
        The fitted constants, shape (n,).
    size
        What counts as a change of each constant by its own size, shape (n,).
    freedom
        Number of residuals less that of the constants.
    """
    r = residuals(x)
    slopes = [_slope(residuals, x, k, DIFFERENCE_STEP * s) * s for k, s in enumerate(size)]
    J = np.column_stack(slopes)
    lengths = np.linalg.norm(J, axis=0)
    fixed = lengths > SMALLEST_SENSITIVITY
    found = np.full(len(x), np.inf)
    if not fixed.any():
        return found
    _, values, Vt = np.linalg.svd(J[:, fixed] / lengths[fixed], full_matrices=False)
    clear = values > SMALLEST_SINGULAR_VALUE_OF_CONSTANTS * values[0]
    scatter = np.sqrt(r @ r / max(freedom, 1))
    spread = scatter * np.sqrt(np.sum((Vt[clear] / values[clear, None]) ** 2, axis=0))
    spread[np.any(np.abs(Vt[~clear]) > SMALLEST_COMPONENT_OF_CONSTANT, axis=0)] = np.inf
    found[fixed] = spread * size[fixed] / lengths[fixed]
    return found


def _slope(
    residuals: Callable[[np.ndarray], np.ndarray], x: np.ndarray, k: int, step: float
) -> np.ndarray:
    """Derivative of the residuals by constant k: central, or one-sided at the edge of a model."""
    ends = []
    for sign in (-1.0, 1.0):
        moved = x.copy()
        moved[k] += sign * step
        ends.append((sign * step, residuals(moved)))
    (a, below), (b, above) = (
        (change, r) if r.max() < PENALTY_RESIDUAL else (0.0, residuals(x)) for change, r in ends
    )
    return (above - below) / (b - a) if b > a else np.zeros_like(below)


def _report(
    first: Any, values: np.ndarray, deviations: np.ndarray, curves: list[TestData]
) -> Fit:
    m = _shaped(first, values)
    deviation = _shaped(first, deviations)
    model_stress = [nominal_stress(m, c.test, c.stretch) for c in curves]
    residual: dict[str, float] = {}
    for k, (c, s) in enumerate(zip(curves, model_stress, strict=True)):
        label = c.test if c.test not in residual else f"{c.test} {k + 1}"
        rms = np.sqrt(np.mean((s - c.stress) ** 2))
        residual[label] = float(rms / np.sqrt(np.mean(c.stress**2)))
    # Each curve has the weight that it has in the sum of squares that was minimised.
    weights = [1 / max(float(c.stress @ c.stress), 1e-300) for c in curves]
    error = sum(
        w * float(np.sum((s - c.stress) ** 2))
        for w, c, s in zip(weights, curves, model_stress, strict=True)
    )
    spread = sum(
        w * float(np.sum((c.stress - c.stress.mean()) ** 2))
        for w, c in zip(weights, curves, strict=True)
    )
    return Fit(
        model=m,
        uncertainty={name: getattr(deviation, name) for name in constants(deviation)},
        residual=residual,
        r_squared=1 - error / spread if spread > 0 else float("nan"),
        stable=all(drucker(m, c.test, c.stretch.min(), c.stretch.max()) > 0 for c in curves),
    )


def drucker(model: Elastic, test: str, low: float, high: float) -> float:
    """Smallest eigenvalue in Pa of d(stress)/d(logarithmic strain) over a test's stretches.

    True stresses against logarithmic stretches in the two directions that incompressibility
    leaves; positive where the energy is stable in Drucker's sense.
    """
    stretch = np.linspace(min(low, 1.0), max(high, 1.0), 200)
    _, _, H = taylor(model, log_stretches(test, stretch))
    K = np.moveaxis(H, (0, 1), (-2, -1))
    B = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, -1.0]])
    K = B.T @ K @ B
    if not np.all(np.isfinite(K)):
        return -np.inf
    return float(np.linalg.eigvalsh(K)[:, 0].min())


def _moduli(curves: list[TestData]) -> list[float]:
    """Neo-Hookean modulus of each curve by least squares, in Pa."""
    out = []
    for c in curves:
        unit = nominal_stress(NeoHookean(1.0), c.test, c.stretch)
        out.append(float(unit @ c.stress / max(unit @ unit, 1e-300)))
    return out


def _doubt_units(curves: list[TestData]) -> None:
    for c, mu in zip(curves, _moduli(curves), strict=True):
        if not SOFTEST_PA <= mu <= STIFFEST_PA:
            size = "soft" if mu < SOFTEST_PA else "stiff"
            warnings.warn(
                f"The {c.test} data give a shear modulus of {mu:.3g} Pa, too {size} for an "
                "elastomer or a film; stresses must be in Pa (1 kPa = 1e3 Pa, 1 MPa = 1e6 Pa).",
                stacklevel=3,
            )


def _start(model: type, curves: list[TestData]) -> Any:
    # A falling curve can have a negative mean modulus; the fit starts from its absolute value.
    mu = max(float(np.median(np.abs(_moduli(curves)))), 1e-9)
    I1 = max(float(np.exp(2 * log_stretches(c.test, c.stretch)).sum(axis=0).max()) for c in curves)
    starts: dict[type, tuple[float, ...]] = {
        NeoHookean: (mu,),
        MooneyRivlin: (0.4 * mu, 0.1 * mu),
        Yeoh: (0.5 * mu, -1e-3 * mu, 1e-5 * mu),
        Gent: (mu, 1.5 * (I1 - 3) + 1),
        ArrudaBoyce: (mu, 1.2 * np.sqrt(I1 / 3) + 0.1),
    }
    if model not in starts:
        raise InputError(
            f"{model.__name__} has no starting point of its own; give fit() a model with constants "
            "to start from."
        )
    return model(*(float(x) for x in starts[model]))


def _flat(model: Any) -> np.ndarray:
    values = [np.atleast_1d(getattr(model, name)) for name in constants(model)]
    return np.concatenate(values).astype(float)


def _shaped(model: Any, x: np.ndarray) -> Any:
    """A model like `model` with the constants x."""
    values: dict[str, Any] = {}
    k = 0
    for name in constants(model):
        old = getattr(model, name)
        if isinstance(old, tuple):
            values[name] = tuple(float(v) for v in x[k : k + len(old)])
            k += len(old)
        else:
            values[name] = float(x[k])
            k += 1
    return replace(model, **values)
