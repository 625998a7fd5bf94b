"""An energy without a formula: convex splines in the invariants, found from measured curves.

The energy is W = f(x) + g(y) with x = |F|/sqrt 3 = sqrt(I1/3) and y = |cof F|/sqrt 3 = sqrt(I2/3),
both 1 at rest.  f and g have piecewise linear second derivatives that are nowhere negative, and
slopes that are nowhere negative.  So W is convex and rising in the norms of F and of its cofactor:
it is polyconvex, whatever the data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dea_fenicsx.materials.base import Strain
from dea_fenicsx.materials.curve_data import TestData
from dea_fenicsx.materials.stretches import log_stretches, nominal_stress
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.later import Later
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import is_finite

optimize = Later("scipy.optimize")


@dataclass(frozen=True)
@in_si(slope_1="Pa", slope_2="Pa", curvature_1="Pa", curvature_2="Pa", knots_1="", knots_2="")
class SplineEnergy:
    """W = f(sqrt(I1/3)) + g(sqrt(I2/3)), with convex, rising cubic splines; see the module.

    Make it by `from_data`.

    Parameters
    ----------
    slope_1, slope_2
        Slopes of f and g at rest in Pa, >= 0 and not both 0; the shear modulus is a third of their
        sum.
    knots_1, knots_2
        Knots from 1 on, rising, at least two.
    curvature_1, curvature_2
        Second derivatives at the knots in Pa, >= 0; linear in between, that of the last one beyond
        it.
    """

    slope_1: float
    knots_1: tuple[float, ...]
    curvature_1: tuple[float, ...]
    slope_2: float
    knots_2: tuple[float, ...]
    curvature_2: tuple[float, ...]

    @classmethod
    def from_data(cls, curves: Sequence[TestData], knots: int = 5) -> SplineEnergy:
        """The energy that is nearest to measured curves: a linear problem, with one solution.

        Errors are relative to the largest stress of each curve.  Beyond the data g is linear, and f
        keeps its last second derivative.

        Parameters
        ----------
        curves
            Data of `read_data`: uniaxial, planar or equibiaxial.
        knots
            Knots of each spline, at equal distances from 1 to the largest value in the data.

        Raises
        ------
        InputError
            If there is no curve, or fewer than 2 knots.
        """
        if not curves or knots < 2:
            raise InputError(
                "A SplineEnergy is made of measured curves and at least 2 knots, but "
                f"{len(curves)} curves and {knots} knots are given."
            )
        ends = [max(_largest(c)[k] for c in curves) for k in range(2)]
        places = [tuple(np.linspace(1.0, end, knots).tolist()) for end in ends]

        def law(values: Any) -> SplineEnergy:
            v = [float(x) for x in values]
            return cls(
                v[0], places[0], tuple(v[1 : knots + 1]),
                v[knots + 1], places[1], (*v[knots + 2 :], 0.0),
            )  # fmt: skip

        weights = [1 / (np.abs(c.stress).max() * np.sqrt(len(c.stress))) for c in curves]
        columns = [
            np.concatenate([
                w * nominal_stress(law(unit), c.test, c.stretch)
                for w, c in zip(weights, curves, strict=True)
            ])
            for unit in np.eye(2 * knots + 1)
        ]  # fmt: skip
        wanted = np.concatenate([w * c.stress for w, c in zip(weights, curves, strict=True)])
        size = np.linalg.norm(columns, axis=1)
        size[size == 0] = 1.0
        found, _ = optimize.nnls((np.array(columns) / size[:, None]).T, wanted, maxiter=2000)
        return law(found / size)

    def energy(self, s: Strain) -> Any:
        x, y = (s.I1 / 3) ** 0.5 - 1, (s.I2 / 3) ** 0.5 - 1
        first = _spline(s, x, self.slope_1, self.knots_1, self.curvature_1)
        return first + _spline(s, y, self.slope_2, self.knots_2, self.curvature_2)

    def shear_modulus(self) -> float:
        return (self.slope_1 + self.slope_2) / 3

    def spherical_slope(self) -> float:
        return (self.slope_1 + 2 * self.slope_2) / 3

    def stress_size(self, s: Strain, lnJ: Any) -> Any:
        """f' and g' at rest times (I1 - 3 - 2 ln J)/3 and (I2 - 3 - 4 ln J)/3; see `Elastic`."""
        first, second = s.I1 - 3 - 2 * lnJ, s.I2 - 3 - 4 * lnJ
        return (self.slope_1 * first + self.slope_2 * second) / 3

    def chain_margin(self, s: Strain) -> None:
        return None

    def faults(self) -> list[str]:
        found = []
        for k in ("1", "2"):
            slope, knots, curvature = (
                getattr(self, f"{name}_{k}") for name in ("slope", "knots", "curvature")
            )
            if not isinstance(knots, tuple) or not isinstance(curvature, tuple):
                return [f"knots_{k} and curvature_{k} must be tuples of numbers"]
            if len(knots) != len(curvature) or len(knots) < 2:
                return [f"knots_{k} and curvature_{k} must hold equally many numbers, at least 2"]
            if not all(map(is_finite, (slope, *knots, *curvature))):
                return [f"slope_{k}, knots_{k} and curvature_{k} must hold finite numbers"]
            if knots[0] != 1 or min(np.diff(knots)) <= 0:
                found.append(f"knots_{k} is {knots}, but must rise from 1 on")
            if min(slope, *curvature) < 0:
                found.append(
                    f"slope_{k} or a curvature_{k} is negative, but the energy must be convex and "
                    "rising: all must be >= 0"
                )
        if not found and not self.shear_modulus() > 0:
            found = ["slope_1 and slope_2 are both 0, so that there is no shear modulus"]
        return found


def _spline(s: Strain, x: Any, slope: Any, knots: Any, curvature: Any) -> Any:
    """slope x plus the double integral of the piecewise linear curvature, at x = value - 1."""
    found = x * (slope + x * curvature[0] / 2)
    before: Any = 0.0
    for k in range(len(knots)):
        after: Any = 0.0
        if k + 1 < len(knots):
            after = (curvature[k + 1] - curvature[k]) / (knots[k + 1] - knots[k])
        beyond = x if k == 0 else s.positive(x - (knots[k] - 1))
        found = found + (after - before) / 6 * beyond * beyond * beyond
        before = after
    return found


def _largest(curve: TestData) -> tuple[float, float]:
    """The largest values of sqrt(I1/3) and sqrt(I2/3) in a curve."""
    e = log_stretches(curve.test, curve.stretch)
    return tuple(
        float(np.sqrt(np.exp(sign * 2 * e).sum(axis=0) / 3).max()) for sign in (1, -1)
    )  # type: ignore[return-value]
