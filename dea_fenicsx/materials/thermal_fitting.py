"""Shift factors and a spectrum of relaxation times, from tests at several temperatures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dea_fenicsx.materials.base import Elastic
from dea_fenicsx.materials.material import Material
from dea_fenicsx.materials.rate_data import Programme, RateData, rate_errors
from dea_fenicsx.materials.stretches import nominal_stress
from dea_fenicsx.materials.thermal import WLF, Entropic, Scaled, Thermal, ThermalLaw
from dea_fenicsx.materials.viscous import Maxwell
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import finite

ENTROPIC = Entropic()

PER_DECADE = 8
"""Relaxation times per decade at which springs are computed; cubic splines go through them."""

MARGIN = 6.0
"""Decades of shift either way for which they are."""

SMALLEST_SHARE_OF_MODULUS = 1e-3
"""Branches with less than this share of the largest modulus are left out."""


@dataclass(frozen=True)
class ThermalFit:
    """What `fit_temperatures` has found.

    Attributes
    ----------
    material
        Equilibrium and branches at the reference, with their `Thermal`; not electric.
    shift
        The WLF law.
    shifts
        log10 of the factor on relaxation times at each temperature, each fitted by itself.
    errors
        Root mean square error at each temperature over the root mean square stress, by `shift`.
    """

    material: Material
    shift: WLF
    shifts: dict[float, float]
    errors: dict[float, float]

    def predicted(self, kelvin: float, tests: Sequence[RateData]) -> float:
        """Root mean square error over the root mean square stress in tests at a temperature."""
        return _error(self.material.at(kelvin), tests)


def fit_temperatures(
    tests: Mapping[float, Sequence[RateData]], reference: float, equilibrium: Elastic,
    times: Sequence[float], modulus: ThermalLaw | None = ENTROPIC,
) -> ThermalFit:  # fmt: skip
    """Fit moduli of a spectrum of Maxwell branches, and how their times change with temperature.

    For given shift factors the stress is linear in the moduli, so that these follow from least
    squares with moduli >= 0.  The shift factors are fitted twice: each by itself, and by WLF.  All
    temperatures have the same weight.

    Parameters
    ----------
    tests
        Tests by temperature in K, the reference among them.
    reference
        Temperature in K at which the constants hold.
    equilibrium
        Elastic model of the equilibrium, whose size alone is fitted, not its shape.
    times
        Relaxation times in s at the reference; those that get no modulus are left out.
    modulus
        Law of all moduli.

    Raises
    ------
    InputError
        If there are fewer than three temperatures, or the reference is not among them.
    """
    for kelvin in tests:
        finite(kelvin, "A temperature")
    if reference not in tests or len(tests) < 3:
        raise InputError(
            f"The tests are at {', '.join(f'{k:g}' for k in tests)} K, but must be at three "
            f"temperatures at least, the reference {reference:g} K among them."
        )
    spectrum = _Spectrum(tests, reference, equilibrium, np.asarray(times, dtype=float), modulus)
    free = spectrum.fitted_shifts()
    law = spectrum.fitted_law(free)
    material = spectrum.material(law)
    errors = {k: _error(material.at(k), some) for k, some in tests.items()}
    shifts = {k: float(a / np.log(10)) for k, a in free.items()}
    return ThermalFit(material, law, shifts, errors)


def _error(material: Material, tests: Sequence[RateData]) -> float:
    """Root mean square error over the root mean square stress, over all points."""
    count = np.array([d.measured.sum() for d in tests])
    squares = sum(float((d.stress[d.measured] ** 2).sum()) for d in tests)
    return float(np.sqrt((rate_errors(material, list(tests)) ** 2 * count).sum() / squares))


class _Spectrum:
    """Weighted stresses of the equilibrium and of branches over their moduli."""

    def __init__(
        self, tests: Mapping[float, Sequence[RateData]], reference: float, equilibrium: Elastic,
        times: np.ndarray, modulus: ThermalLaw | None,
    ) -> None:  # fmt: skip
        from scipy.interpolate import CubicSpline

        self.reference, self.model, self.times = reference, equilibrium, times
        self.kelvin, self.modulus = sorted(tests), modulus
        span = np.log(times.min()) - MARGIN * np.log(10), np.log(times.max()) + MARGIN * np.log(10)
        grid = np.linspace(*span, int(PER_DECADE * np.diff(span)[0] / np.log(10)) + 1)
        self._grid = grid
        self.curves, self.rest, self.stress = {}, {}, {}
        for kelvin, some in tests.items():
            programme = Programme(list(some), even=1)
            springs = programme.springs(np.exp(grid))
            b = np.concatenate([d.stress[d.measured] for d in some])
            weight = 1 / np.sqrt((b**2).sum())
            if modulus is not None:
                self.stress[kelvin] = weight * b
                weight *= float(modulus.factor(kelvin, reference))
            else:
                self.stress[kelvin] = weight * b
            both = [(s[d.measured], d) for s, d in zip(springs, some, strict=True)]
            curves = weight * np.concatenate([s for s, _ in both])
            self.curves[kelvin] = CubicSpline(grid, curves, axis=1)
            self.rest[kelvin] = weight * np.concatenate([
                nominal_stress(equilibrium, d.test, d.stretch[d.measured]) for _, d in both
            ])  # fmt: skip

    def moduli(self, shifts: Mapping[float, float]) -> tuple[np.ndarray, np.ndarray]:
        """Size of the equilibrium and moduli, and all errors, for the logarithms of shifts."""
        from scipy.optimize import nnls

        times, grid = np.log(self.times), self._grid
        A = np.concatenate([
            np.column_stack([
                self.rest[k], self.curves[k](np.clip(times + shifts[k], grid[0], grid[-1]))
            ])
            for k in self.kelvin
        ])  # fmt: skip
        b = np.concatenate([self.stress[k] for k in self.kelvin])
        size = max(np.abs(A).max(), 1e-300)
        x = nnls(A / size, b)[0] / size
        return x, A @ x - b

    def fitted_shifts(self) -> dict[float, float]:
        """Logarithm of each shift factor, each by itself."""
        from scipy.optimize import least_squares

        moved = [k for k in self.kelvin if k != self.reference]

        def all_of(x: np.ndarray) -> dict[float, float]:
            return {**dict(zip(moved, map(float, x), strict=True)), self.reference: 0.0}

        start = np.array([-0.05 * np.log(10) * (k - self.reference) for k in moved])
        limit = MARGIN * np.log(10)
        found = least_squares(
            lambda x: self.moduli(all_of(x))[1], start, bounds=(-limit, limit), diff_step=1e-3,
            max_nfev=40,
        )  # fmt: skip
        return dict(sorted(all_of(found.x).items()))

    def fitted_law(self, free: Mapping[float, float]) -> WLF:
        """The WLF law, from all tests."""
        from scipy.optimize import least_squares

        lowest = max(self.reference - self.kelvin[0], 0.0)

        def law(x: np.ndarray) -> WLF:
            return WLF(float(np.exp(x[0])), float(lowest + np.exp(x[1])))

        def of_shifts(x: np.ndarray) -> np.ndarray:
            return np.array([np.log(law(x).factor(k, self.reference)) - a for k, a in free.items()])

        def errors(x: np.ndarray) -> np.ndarray:
            made = {k: float(np.log(law(x).factor(k, self.reference))) for k in self.kelvin}
            return self.moduli(made)[1]

        first = least_squares(of_shifts, np.log([8.0, 60.0]), loss="soft_l1").x
        self.best = law(least_squares(errors, first, diff_step=1e-3, max_nfev=40).x)
        return self.best

    def material(self, law: WLF) -> Material:
        """The material at the reference with the moduli that belong to a law."""
        x, _ = self.moduli({k: float(np.log(law.factor(k, self.reference))) for k in self.kelvin})
        kept = x[1:] > SMALLEST_SHARE_OF_MODULUS * x[1:].max()
        thermal = Thermal(
            self.reference, self.kelvin[0], self.kelvin[-1], modulus=self.modulus, shift=law
        )
        branches = tuple(
            Maxwell(float(mu), float(tau))
            for mu, tau in zip(x[1:][kept], self.times[kept], strict=True)
        )
        elastic = Scaled(float(max(x[0], 1e-9)), self.model)
        return Material(elastic, viscous=branches, thermal=thermal)
