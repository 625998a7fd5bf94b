"""Fitting a model's constants to measured stress-stretch curves."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.materials.base import Elastic, constants
from dea_fenicsx.materials.chains import ArrudaBoyce, Gent
from dea_fenicsx.materials.polynomial import MooneyRivlin, NeoHookean, Yeoh
from dea_fenicsx.materials.stretches import TESTS, log_stretches, nominal_stress, taylor
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si

SOFT, STIFF = 1e3, 1e8
"""Initial shear moduli in Pa outside which the stress unit is doubted."""

PENALTY_RESIDUAL = 1e3
"""Residual in place of one whose stress is not finite."""

DIFFERENCE_STEP = 1e-5
"""Step of a central difference, relative to the constant.  Its error is about 1e-10."""

SMALLEST_SENSITIVITY = 1e-6
"""Smallest relative change of the stresses by which data determine a constant.

It is the change if the constant changes by its own size.
"""

SMALLEST_SINGULAR_VALUE = 1e-8
"""Smallest singular value, relative to the largest, of an independent combination of constants.

It is well above the error of the central differences.
"""

SMALLEST_COMPONENT = 1e-4
"""Smallest component of a constant in a direction of constants that counts."""


@dataclass(frozen=True, eq=False)
@in_si(stretch="", stress="Pa")
class TestData:
    """One measured curve.

    Parameters
    ----------
    test
        ``"uniaxial"``, ``"planar"`` or ``"equibiaxial"``.
    stretch
        Stretches, shape (n,).
    stress
        Nominal stresses in Pa, shape (n,).
    """

    __test__ = False  # not a test of pytest's

    test: str
    stretch: Any
    stress: Any

    def __post_init__(self) -> None:
        for name in ("stretch", "stress"):
            given = getattr(self, name)
            try:
                object.__setattr__(self, name, np.asarray(given, dtype=float).ravel())
            except (TypeError, ValueError, OverflowError) as error:
                raise InputError(
                    f"The {name} of the data is {shown(given)}, but must be an array of numbers."
                ) from error
        if not isinstance(self.test, str) or self.test not in TESTS:
            raise InputError(
                f"There is no test {shown(self.test)}; the tests are {', '.join(TESTS)}."
            )
        if len(self.stretch) != len(self.stress):
            raise InputError(
                f"The {self.test} data have {len(self.stretch)} stretches and {len(self.stress)} "
                "stresses, but must have as many of each."
            )
        if not (np.all(np.isfinite(self.stretch)) and np.all(np.isfinite(self.stress))):
            raise InputError(f"The {self.test} data hold values that are no finite numbers.")
        if np.any(self.stretch <= 0):
            raise InputError(
                f"The {self.test} data hold a stretch of {self.stretch.min():g}, but a stretch is "
                "> 0 (1 + strain)."
            )


def read_data(
    path: str | Path,
    test: str,
    stretch: int,
    stress: int,
    unit: float,
    delimiter: str | None = None,
    decimal: str = ".",
) -> TestData:
    """Read a curve from a text file; lines that hold no numbers there are passed over.

    Parameters
    ----------
    path, test
        The file, and its test as in `TestData`.
    stretch, stress
        Numbers of the columns, from 0.
    unit
        Unit of the stresses in Pa (1e6 for MPa).
    delimiter, decimal
        Column delimiter (None for blanks) and decimal sign.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"There is no data file {path}.")
    rows = []
    for line in path.read_text(encoding="latin-1").splitlines():
        cells = line.split(delimiter)
        try:
            rows.append([float(cells[k].replace(decimal, ".")) for k in (stretch, stress)])
        except (ValueError, IndexError):
            continue
    if not rows:
        raise InputError(f"{path} holds no numbers in columns {stretch} and {stress}.")
    columns = np.array(rows).T
    return TestData(test, columns[0], columns[1] * unit)


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model.

    Attributes
    ----------
    model
        The elastic model with the fitted constants.
    uncertainty
        Standard deviation of each constant, by name (a tuple for constants with several entries).
        Infinite where the data do not determine the constant, alone or beside another one.
    residual
        Root mean square of the stress residual over each curve's root mean square stress.
    r_squared
        Share of the stresses' variance that is explained, all curves together.
    stable
        Whether the energy is stable in Drucker's sense over the data: every small change of stress
        does positive work on the strain it causes.
    """

    model: Elastic
    uncertainty: dict[str, Any]
    residual: dict[str, float]
    r_squared: float
    stable: bool

    def __str__(self) -> str:
        parts = ", ".join(f"{t} {100 * r:.1f} %" for t, r in self.residual.items())
        stability = "stable" if self.stable else "NOT stable (Drucker)"
        text = f"{self.model}: residual {parts}; R^2 {self.r_squared:.4f}; {stability} on the data"
        loose = self.undetermined
        return text + (f"; the data do not determine {', '.join(loose)}" if loose else "")

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of the constants whose standard deviation is larger than they are themselves."""
        return tuple(
            name for name, deviation in self.uncertainty.items()
            if np.any(np.asarray(deviation) > np.abs(getattr(self.model, name)))
        )  # fmt: skip


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
    from scipy.optimize import least_squares  # slow to load, and most scripts fit nothing

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
    best = None
    for k in range(max(starts, 1)):
        x = x0 / scale * (1.0 if k == 0 else rng.uniform(0.5, 1.5, len(x0)))
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            found = least_squares(residuals, x, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14)
        good = not _shaped(first, found.x * scale).faults()
        if good and (best is None or found.cost < best.cost * (1 - 1e-12)):
            best = found
    if best is None:
        raise InputError(
            f"No admissible {type(first).__name__} model was found from {first}; start nearer."
        )
    size = np.maximum(np.abs(best.x), 1.0)
    deviation = _deviation(residuals, best.x, size, len(best.fun) - len(best.x))
    return _report(first, best.x * scale, deviation * scale, curves)


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
    clear = values > SMALLEST_SINGULAR_VALUE * values[0]
    scatter = np.sqrt(r @ r / max(freedom, 1))
    spread = scatter * np.sqrt(np.sum((Vt[clear] / values[clear, None]) ** 2, axis=0))
    spread[np.any(np.abs(Vt[~clear]) > SMALLEST_COMPONENT, axis=0)] = np.inf
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
    measured = np.concatenate([c.stress for c in curves])
    error = np.concatenate(model_stress) - measured
    spread = np.sum((measured - measured.mean()) ** 2)
    return Fit(
        model=m,
        uncertainty={name: getattr(deviation, name) for name in constants(deviation)},
        residual=residual,
        r_squared=float(1 - np.sum(error**2) / spread) if spread > 0 else float("nan"),
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
        if not SOFT <= mu <= STIFF:
            size = "soft" if mu < SOFT else "stiff"
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
