"""The spring of a viscous branch at many points, each in the frame of its elastic stretches.

A point's frame is a matrix P with det P = 1 and P P^T = C_v^-1, such that P^T C P is diagonal.  Its
entries x_i are the squares of the elastic stretches.  A neighbouring viscous strain is
C_v^-1 = P exp(X) P^T with X symmetric and without trace, which has five numbers in the basis
`TRACELESS`.  So the determinant stays 1 whatever X is.

Symmetric tensors are vectors of six numbers xx, yy, zz, yz, xz, xy.  "Mandel's" vectors have the
last three times sqrt(2), so that the double contraction is the scalar product of the vectors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dea_fenicsx.materials.base import Elastic
from dea_fenicsx.materials.stretches import margin, taylor
from dea_fenicsx.model.viscous_history import PAIRS

SHEARS = ((1, 2), (0, 2), (0, 1))
"""Places of the last three of the six numbers."""

SMALLEST_GAP = 1e-5
"""Logarithmic stretches that are closer than this share a derivative in place of a quotient."""

MANDEL_WEIGHTS = np.sqrt([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
"""Mandel's vector over the six numbers."""


def _traceless() -> np.ndarray:
    found = np.zeros((5, 3, 3))
    found[0] = np.diag([1, -1, 0]) / np.sqrt(2)
    found[1] = np.diag([1, 1, -2]) / np.sqrt(6)
    for k, (i, j) in enumerate(SHEARS):
        found[2 + k, i, j] = found[2 + k, j, i] = 1 / np.sqrt(2)
    return found


TRACELESS = _traceless()
"""Orthonormal basis of the symmetric tensors without trace: two diagonal ones, three shears."""

_DIAGONAL = np.einsum("aii->ai", TRACELESS[:2])
_PRODUCTS = (
    np.einsum("aij,bjk->abik", TRACELESS, TRACELESS)
    + np.einsum("bij,ajk->abik", TRACELESS, TRACELESS)
) / 4


def matrices(six: np.ndarray) -> np.ndarray:
    """Symmetric 3 x 3 matrices of six numbers each, shape (N, 3, 3)."""
    found = np.empty((len(six), 3, 3))
    for k, (i, j) in enumerate(PAIRS):
        found[:, i, j] = found[:, j, i] = six[:, k]
    return found


def six_of(matrix: np.ndarray) -> np.ndarray:
    """The six numbers of symmetric matrices, shape (N, 6)."""
    return np.stack([(matrix[:, i, j] + matrix[:, j, i]) / 2 for i, j in PAIRS], axis=-1)


def transposed(matrix: np.ndarray) -> np.ndarray:
    return np.swapaxes(matrix, -1, -2)


@dataclass(eq=False)
class Frames:
    """Points in the frames of their elastic stretches.

    Attributes
    ----------
    P
        The frames, shape (N, 3, 3).
    H
        The history in them, P^T H P, shape (N, 3, 3).
    x
        Squares of the elastic stretches, shape (N, 3).
    W, t, K
        The spring's energy and its derivatives by the logarithmic stretches over a modulus, shapes
        (N,), (N, 3) and (N, 3, 3).  NaN beyond the chains' lock-up.
    """

    P: np.ndarray
    H: np.ndarray
    x: np.ndarray
    W: np.ndarray
    t: np.ndarray
    K: np.ndarray

    @staticmethod
    def of(spring: Elastic, mu: float, P: np.ndarray, C: np.ndarray, H: np.ndarray) -> Frames:
        """Turn matrices P with P P^T = C_v^-1 into frames, and evaluate the spring there."""
        squares = transposed(P) @ C @ P
        finite = np.isfinite(squares).all(axis=(1, 2))
        x, turn = np.linalg.eigh(np.where(finite[:, None, None], squares, np.eye(3)))
        x[~finite] = np.nan
        P = P @ turn
        with np.errstate(invalid="ignore", divide="ignore"):
            W, t, K = taylor(spring, np.log(x).T / 2)
        K = np.moveaxis(K, -1, 0)
        return Frames(P, transposed(P) @ H @ P, x, W / mu, t.T / mu, K / mu)

    def chosen(self, which: np.ndarray) -> Frames:
        """Some of the points."""
        return Frames(*(getattr(self, name)[which] for name in self.__dataclass_fields__))

    def put(self, which: np.ndarray, other: Frames) -> None:
        """Replace some of the points."""
        for name in self.__dataclass_fields__:
            getattr(self, name)[which] = getattr(other, name)

    def margin(self, spring: Elastic) -> np.ndarray:
        """Distance to the lock-up of the spring's chains; infinite where there is none."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return margin(spring, np.log(self.x).T / 2)

    # ------------------------------------------------------------------ what belongs to the strain

    @property
    def strain(self) -> np.ndarray:
        """C_v, shape (N, 6); its determinant is 1 to rounding."""
        inverse = np.linalg.inv(self.P)
        return six_of(transposed(inverse) @ inverse)

    @property
    def flow(self) -> np.ndarray:
        """(dev S) C_v over the modulus, shape (N, 6): dC_v/dt times the relaxation time."""
        inverse = np.linalg.inv(self.P)
        deviator = self.t - self.t.mean(axis=1, keepdims=True)
        return six_of(transposed(inverse) @ (deviator[..., None] * inverse))

    @property
    def I1(self) -> np.ndarray:
        """Trace of C_v."""
        return np.asarray((np.linalg.inv(self.P) ** 2).sum(axis=(1, 2)))

    def I1_slope(self) -> np.ndarray:
        """Derivative of tr C_v by X, shape (N, 5)."""
        metric = np.linalg.inv(transposed(self.P) @ self.P)
        return -np.einsum("aij,nij->na", TRACELESS, metric)

    @property
    def J2(self) -> np.ndarray:
        """Half the square of the stress deviator over the modulus squared."""
        return np.asarray(((self.t - self.t.mean(axis=1, keepdims=True)) ** 2).sum(axis=1) / 2)

    def J2_slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of `J2` by X and by Mandel's vector of P^T C P, (N, 5) and (N, 6)."""
        deviator = self.t - self.t.mean(axis=1, keepdims=True)
        by_log = np.einsum("ni,nij->nj", deviator, self.K)
        by_X, by_C = np.zeros((len(self.x), 5)), np.zeros((len(self.x), 6))
        by_X[:, :2] = by_log @ _DIAGONAL.T / 2
        by_C[:, :3] = by_log / (2 * self.x)
        return by_X, by_C

    # ------------------------------------------------------------------ derivatives of the energies

    @property
    def quotients(self) -> np.ndarray:
        """(t_i - t_j)/(x_i - x_j) for the three shears, also where both coincide, (N, 3)."""
        found = np.empty((len(self.x), 3))
        for k, (i, j) in enumerate(SHEARS):
            gap = np.log(self.x[:, i] / self.x[:, j]) / 2
            close = np.abs(gap) < SMALLEST_GAP
            safe = np.where(close, 1.0, gap)
            slope = (self.K[:, i, i] - 2 * self.K[:, i, j] + self.K[:, j, j]) / 2
            slope = np.where(close, slope, (self.t[:, i] - self.t[:, j]) / safe)
            ratio = np.where(close, 1.0, safe / np.sinh(safe))
            found[:, k] = slope * ratio / (2 * np.sqrt(self.x[:, i] * self.x[:, j]))
        return found

    def spring_gradient(self) -> np.ndarray:
        """Derivative of W by X, shape (N, 5)."""
        found = np.zeros((len(self.x), 5))
        found[:, :2] = self.t @ _DIAGONAL.T / 2
        return found

    def history_gradient(self) -> np.ndarray:
        """Derivative of tr(H C_v^-1)/2 by X, shape (N, 5)."""
        return np.einsum("aij,nij->na", TRACELESS, self.H) / 2

    def spring_curvature(self) -> np.ndarray:
        """Second derivative of W by X, shape (N, 5, 5)."""
        found = np.zeros((len(self.x), 5, 5))
        found[:, :2, :2] = np.einsum("ai,nij,bj->nab", _DIAGONAL, self.K, _DIAGONAL) / 4
        quotients = self.quotients
        for k, (i, j) in enumerate(SHEARS):
            found[:, 2 + k, 2 + k] = quotients[:, k] * (self.x[:, i] + self.x[:, j]) / 4
        return found

    def history_curvature(self) -> np.ndarray:
        """Second derivative of tr(H C_v^-1)/2 by X, shape (N, 5, 5)."""
        return np.einsum("abij,nij->nab", _PRODUCTS, self.H)

    def mixed(self) -> np.ndarray:
        """Derivative of W by X and by Mandel's vector of P^T C P, shape (N, 5, 6)."""
        found = np.zeros((len(self.x), 5, 6))
        found[:, :2, :3] = np.einsum("ai,nij,nj->naj", _DIAGONAL, self.K, 1 / self.x) / 4
        found[:, range(2, 5), range(3, 6)] = self.quotients / 2
        return found

    def stiffness(self) -> np.ndarray:
        """4 times the second derivative of W by Mandel's vector of P^T C P, at kept C_v."""
        x, t = self.x, self.t
        found = np.zeros((len(x), 6, 6))
        found[:, :3, :3] = self.K / (x[:, :, None] * x[:, None, :])
        found[:, range(3), range(3)] -= 2 * t / x**2
        quotients = self.quotients
        for k, (i, j) in enumerate(SHEARS):
            both = x[:, i] * x[:, j]
            shear = quotients[:, k] * (x[:, i] + x[:, j]) - (t[:, i] + t[:, j])
            found[:, 3 + k, 3 + k] = shear / both
        return found

    # ------------------------------------------------------------------ back to the body's axes

    @property
    def stress(self) -> np.ndarray:
        """2 dW/dC over the modulus in the body's axes, shape (N, 6)."""
        return six_of(self.P @ ((self.t / self.x)[..., None] * transposed(self.P)))

    def turned(self, moduli: np.ndarray) -> np.ndarray:
        """Moduli between Mandel's vectors in the frames, in the body's axes, (N, 6, 6)."""
        P, into = self.P, np.empty((len(self.P), 6, 6))
        for m, (a, b) in enumerate(PAIRS):
            for n, (i, j) in enumerate(PAIRS):
                both = P[:, i, a] * P[:, j, b]
                if i != j:
                    both = (both + P[:, j, a] * P[:, i, b]) / np.sqrt(2)
                into[:, m, n] = MANDEL_WEIGHTS[m] * both
        return transposed(into) @ moduli @ into
