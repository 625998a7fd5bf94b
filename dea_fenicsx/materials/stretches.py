"""Energies in the principal stretches, with exact first and second derivatives.

Numeric strains for the energies of this package: the same `energy` that finite elements
differentiate symbolically is evaluated here in the arithmetic of truncated Taylor series (value,
gradient, Hessian) in the logarithms of the principal stretches, for any number of states at once.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dea_fenicsx.materials.base import Elastic, is_compressible
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.later import Later

special = Later("scipy.special")

# order of the six second derivatives: 11, 22, 33, 23, 13, 12
_I = np.array([0, 1, 2, 1, 0, 0])
_J = np.array([0, 1, 2, 2, 2, 1])
_BLOCK = 8192
"""Number of states that are evaluated together, so that they fit into the processor's cache."""
INFINITE_ENERGY = 1e60
"""Energies in Pa above this are treated as infinite."""


class Series:
    """A number with its first and second derivatives in three variables.

    Parameters
    ----------
    c
        Coefficients, shape (10, ...): value, gradient, second derivatives 11 22 33 23 13 12.
    """

    __slots__ = ("c",)
    __array_ufunc__ = None  # NumPy scalars and arrays on the left leave the operation to us

    def __init__(self, c: np.ndarray):
        self.c = c

    def _of(self, f: Any, d1: Any, d2: Any) -> Series:
        """Composition with a function of value f and derivatives d1, d2 at this value."""
        c, out = self.c, np.empty_like(self.c)
        out[0] = f
        out[1:4] = d1 * c[1:4]
        out[4:] = d1 * c[4:] + d2 * c[1 + _I] * c[1 + _J]
        return Series(out)

    def __neg__(self) -> Series:
        return Series(-self.c)

    def __add__(self, other: Any) -> Series:
        if isinstance(other, Series):
            return Series(self.c + other.c)
        out = self.c.copy()
        out[0] += other
        return Series(out)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Series:
        if isinstance(other, Series):
            return Series(self.c - other.c)
        out = self.c.copy()
        out[0] -= other
        return Series(out)

    def __rsub__(self, other: Any) -> Series:
        return -self + other

    def __mul__(self, other: Any) -> Series:
        if not isinstance(other, Series):
            return Series(self.c * other)
        a, b = self.c, other.c
        out = a[0] * b + b[0] * a
        out[0] = a[0] * b[0]
        out[4:] += a[1 + _I] * b[1 + _J] + a[1 + _J] * b[1 + _I]
        return Series(out)

    __rmul__ = __mul__

    def reciprocal(self) -> Series:
        y = 1 / self.c[0]
        return self._of(y, -y * y, 2 * y**3)

    def __truediv__(self, other: Any) -> Series:
        if isinstance(other, Series):
            return self * other.reciprocal()
        return Series(self.c / other)

    def __rtruediv__(self, other: Any) -> Series:
        return self.reciprocal() * other

    def __pow__(self, n: Any) -> Series:
        if isinstance(n, int) and n == 2:
            return self * self
        x = self.c[0]
        y = x ** (n - 2)
        return self._of(y * x * x, n * y * x, n * (n - 1) * y)

    def exp(self) -> Series:
        y = np.exp(self.c[0])
        return self._of(y, y, y)

    def log(self) -> Series:
        y = 1 / self.c[0]
        return self._of(np.log(self.c[0]), y, -y * y)


class PrincipalStrain:
    """The `Strain` of principal stretches, to second order in their logarithms.

    Parameters
    ----------
    e
        Logarithms of the principal stretches, shape (3, ...).
    along_axes
        Whether the first, second and third principal direction are those of the axes in which the
        directions of fibres are given.
    """

    def __init__(self, e: np.ndarray, along_axes: bool = False):
        self.e, self.along_axes = e, along_axes

    @property
    def I1(self) -> Series:
        return self.power_sum(2)

    @property
    def I2(self) -> Series:
        """lam1^2 lam2^2 + lam2^2 lam3^2 + lam3^2 lam1^2."""
        e = self.e
        out = np.zeros((10, *e.shape[1:]))
        for k in range(3):
            i, j = [n for n in range(3) if n != k]
            term = np.exp(2 * (e[i] + e[j]))
            out[0] += term
            for n in (i, j):
                out[1 + n] += 2 * term
                out[4 + n] += 4 * term
            out[4 + 3 + k] += 4 * term  # mixed derivatives stand in the order 23, 13, 12
        return Series(out)

    @property
    def J(self) -> Series:
        out = np.empty((10, *self.e.shape[1:]))
        out[:] = np.exp(self.e.sum(axis=0))
        return Series(out)

    @staticmethod
    def exp(x: Series) -> Series:
        return x.exp()

    @staticmethod
    def erf_integral(x: Any) -> Any:
        at = x.c[0] if isinstance(x, Series) else np.asarray(x, dtype=float)
        bell = np.exp(-at * at) / np.sqrt(np.pi)
        value = at * special.erf(at) + bell
        return x._of(value, special.erf(at), 2 * bell) if isinstance(x, Series) else value

    @staticmethod
    def positive(x: Series) -> Series:
        return Series(np.where(x.c[0] > 0, x.c, 0.0))

    def I4(self, direction: Any) -> Series:
        """a . C a, the sum of a_k^2 lam_k^2."""
        return self._weighted(2, direction)

    def I5(self, direction: Any) -> Series:
        """a . C^2 a, the sum of a_k^2 lam_k^4."""
        return self._weighted(4, direction)

    def _weighted(self, power: int, direction: Any) -> Series:
        """Sum of powers of the principal stretches, times the squares of a unit vector's parts."""
        if not self.along_axes:
            raise InputError(
                "This state is that of an isotropic rubber, but the material has fibres; a Film "
                "takes fibres along its axes, and finite elements take any."
            )
        squares = direction.unit() ** 2
        term = np.exp(power * self.e) * squares.reshape(3, *[1] * (self.e.ndim - 1))
        out = np.zeros((10, *self.e.shape[1:]))
        out[0] = term.sum(axis=0)
        out[1:4] = power * term
        out[4:7] = power * power * term
        return Series(out)

    @staticmethod
    def ln(x: Series) -> Series:
        return x.log()

    def power_sum(self, alpha: Any) -> Series:
        term = np.exp(alpha * self.e)
        out = np.zeros((10, *self.e.shape[1:]))
        out[0] = term.sum(axis=0)
        out[1:4] = alpha * term
        out[4:7] = alpha * alpha * term
        return Series(out)


def taylor(
    elastic: Elastic, e: Any, along_axes: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Energy, its gradient and its Hessian in the logarithms of the principal stretches.

    The gradient's differences are true stresses: sigma_i - sigma_3 = dW/de_i - dW/de_3.

    Parameters
    ----------
    elastic
        The elastic model.
    e
        Logarithms of the three principal stretches, shape (3, ...).
    along_axes
        Whether the principal directions are the axes of the directions of fibres.

    Returns
    -------
    W, R, H : ndarrays of shape (...), (3, ...), (3, 3, ...)
        In Pa.  NaN beyond a chain's lock-up.
    """
    e = np.asarray(e, dtype=float)
    flat = e.reshape(3, -1)
    c = np.empty((10, flat.shape[1]))
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for k in range(0, flat.shape[1], _BLOCK):
            part = flat[:, k : k + _BLOCK]
            strain = PrincipalStrain(part, along_axes)
            value = elastic.energy(strain)
            # An exponential energy leaves the range of numbers, and is of no use long before that.
            finite = np.abs(value.c).max(axis=0) < INFINITE_ENERGY
            c[:, k : k + _BLOCK] = np.where(finite, value.c, np.nan)
            if (margin := elastic.chain_margin(strain)) is not None:
                c[:, k : k + _BLOCK][:, ~(margin.c[0] > 0)] = np.nan
    c = c.reshape(10, *e.shape[1:])
    hessian = np.empty((3, 3, *e.shape[1:]))
    hessian[_I, _J] = c[4:]
    hessian[_J, _I] = c[4:]
    return c[0], c[1:4], hessian


def margin(elastic: Elastic, e: Any) -> np.ndarray:
    """Distance to chain lock-up (positive where the energy is defined; inf without a limit)."""
    e = np.asarray(e, dtype=float)
    value = elastic.chain_margin(PrincipalStrain(e))
    return np.full(e.shape[1:], np.inf) if value is None else value.c[0]


TESTS = {"uniaxial": (1.0, -0.5, -0.5), "planar": (1.0, 0.0, -1.0), "equibiaxial": (1.0, 1.0, -2.0)}
"""Logarithms of the principal stretches in each test, per logarithm of the first stretch."""


def log_stretches(test: str, stretch: Any) -> np.ndarray:
    """Logarithms of the principal stretches of a test at `stretch`, shape (3, ...)."""
    if test not in TESTS:
        raise InputError(f"There is no test {test!r}; the tests are {', '.join(TESTS)}.")
    e = np.log(np.asarray(stretch, dtype=float))
    return np.array([share * e for share in TESTS[test]])


def nominal_stress(elastic: Elastic, test: str, stretch: Any) -> np.ndarray:
    """Nominal stress in Pa along the first direction of an incompressible material.

    Parameters
    ----------
    elastic
        The elastic model.
    test
        ``"uniaxial"``, ``"planar"`` (second direction held) or ``"equibiaxial"``.
    stretch
        Stretch along the first direction.
    """
    e = log_stretches(test, stretch)
    if is_compressible(elastic):
        raise InputError(
            f"{type(elastic).__name__} changes its volume, but the tests of an incompressible "
            "rubber do not; take a Film with a dead load along one side."
        )
    _, R, _ = taylor(elastic, e)
    return (R[0] - R[2]) / np.exp(e[0])
