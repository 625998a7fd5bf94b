"""Equilibrium of a homogeneous film, and its samples from zero voltage on."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from dea_fenicsx.exact.film import Film, Held
from dea_fenicsx.exact.states import without_time
from dea_fenicsx.support.errors import InputError


class Equations:
    """Equilibrium of a film in its free logarithmic stretches y and the Maxwell pressure M.

    Attributes
    ----------
    film : the film with its mechanical loads
    e0, B : logarithmic stretches are e = e0 + B y
    n : number of free stretches
    scale : shear modulus in Pa, with which residuals are compared
    """

    def __init__(self, film: Film):
        without_time(film.material, "A branch of equilibria")
        self.film = film
        self.e0, self.B = film.freedoms(symmetric=True)
        self.n = self.B.shape[1]
        self.scale = film.material.elastic.shear_modulus()

    def e(self, y: np.ndarray) -> np.ndarray:
        return self.e0 + self.B @ y

    def parts(self, e: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """a and b of the equations a(e) - M b(e) = 0, reduced to the free directions."""
        _, R, _ = self.film.elastic(e)
        tau, _ = self.film.applied(e)
        return self.B.T @ (R - tau), self.B.T @ (self.film.push(e) * np.exp(e.sum(axis=0)))

    def matrix(self, e: np.ndarray, M: float) -> np.ndarray:
        """Derivative in (y, M), shape (n, n + 1)."""
        K = self.B.T @ self.film.tangent(e, np.float64(M), "pressure") @ self.B
        _, b = self.parts(e)
        return np.column_stack([K, -b])

    def rest(self) -> tuple[np.ndarray, float]:
        """Equilibrium without voltage, by Newton's method with steps of bounded length."""
        y = np.zeros(self.n)
        if self.film.incompressible:  # half way between the held stretch and equal stretches
            y += -self.e0.sum() / 2
            if isinstance(self.film.first, Held) or isinstance(self.film.second, Held):
                held = self.film.first if isinstance(self.film.first, Held) else self.film.second
                y = np.array([-np.log(held.stretch) / 2])  # type: ignore[union-attr]
        for _ in range(400):
            e = self.e(y)
            a, _ = self.parts(e)
            if not np.all(np.isfinite(a)):
                break
            K = self.B.T @ self.film.tangent(e, np.float64(0), "pressure") @ self.B
            values, vectors = np.linalg.eigh((K + K.T) / 2)
            # minimise: against a negative curvature go downhill all the same
            step = -vectors @ ((vectors.T @ a) / np.maximum(np.abs(values), 1e-3 * self.scale))
            step *= min(1.0, 0.1 / max(np.abs(step).max(), 1e-300))
            while not self.film.margin(self.e(y + step)) > 0:
                step /= 2
            y = y + step
            if np.abs(step).max() < 1e-15:
                break
        a, _ = self.parts(self.e(y))
        size = self.scale + np.abs(self.film.elastic(self.e(y))[1]).max()
        if not np.all(np.abs(a) <= 1e-9 * size):
            raise InputError(
                "The film has no equilibrium without voltage under its dead loads or true "
                "stresses; take smaller ones."
            )
        return y, 0.0

    def near(self, e: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, float]:
        """The equilibrium near e in the plane through e across `along`."""
        y = np.linalg.lstsq(self.B, e - self.e0, rcond=None)[0]
        a, b = self.parts(self.e(y))
        M = float(a @ b / (b @ b))
        if self.n == 1:
            return self.e(y), M
        t = np.linalg.lstsq(self.B, along, rcond=None)[0]
        y, M, _ = self.correct(y, M, t / np.linalg.norm(t))
        return self.e(y), M

    def correct(self, y: np.ndarray, M: float, t: np.ndarray) -> tuple[np.ndarray, float, bool]:
        """Newton's method in the plane through y across t."""
        last = np.inf
        for _ in range(12):
            e = self.e(y)
            a, b = self.parts(e)
            A = np.vstack([self.matrix(e, M), np.append(t, 0.0)])
            A[:-1] /= self.scale
            rhs = np.append((a - M * b) / self.scale, 0.0)
            if not np.all(np.isfinite(A)) or not np.all(np.isfinite(rhs)):
                return y, M, False
            d = np.linalg.solve(A, -rhs)
            y, M = y + d[:-1], M + d[-1]
            size = float(np.abs(d[:-1]).max())
            if size < 1e-15 or (size < 1e-12 and size >= last):
                break
            last = size
        return y, M, size < 1e-9


def scan(
    eq: Equations, y0: np.ndarray, max_stretch: float, step: float
) -> tuple[np.ndarray, np.ndarray, bool]:
    """Sample the branch of a film with one free stretch, of which M is an explicit function.

    Returns
    -------
    e, M, locked
        Logarithms of the principal stretches (3, n), Maxwell pressures in Pa (n,), and whether the
        branch ends where the chains lock up.
    """
    film, start = eq.film, float(y0[0])
    end = start + 2 * np.log(max_stretch)

    def margin(y: float) -> float:
        return float(film.margin(eq.e(np.array([y]))))

    locked = bool(margin(end) <= 0)
    if locked:
        end = brentq(margin, start, end, xtol=1e-15, rtol=1e-15)
    n = max(int((end - start) / step), 200)
    share = np.linspace(0, 1, n + 1)
    # towards lock-up the load soars: sample more closely there
    y = start + (end - start) * (np.sin(share * np.pi / 2) if locked else share)
    if locked:
        y[-1] = end - 1e-12
    e = eq.e0[:, None] + eq.B * y[None, :]
    a, b = eq.parts(e)
    with np.errstate(invalid="ignore"):
        M = a[0] / b[0]
    M[0] = 0.0
    inside = np.all(np.abs(e[:2]) <= np.log(max_stretch) + 1e-12, axis=0)
    good = np.isfinite(M) & (M >= 0) & inside
    stop = len(M) if good.all() else int(np.argmin(good))
    return e[:, :stop], M[:stop], locked and stop == len(M)


def walk(
    eq: Equations, y: np.ndarray, max_stretch: float, step: float
) -> tuple[np.ndarray, np.ndarray, bool]:
    """Follow the branch of a film with several free stretches by predictor and corrector.

    Returns the same as `scan`.
    """
    film = eq.film
    points, loads = [eq.e(y)], [0.0]
    M, size = 0.0, step
    direction = np.append(np.zeros(eq.n), 1.0)
    locked = False
    for _ in range(20000):
        null = np.linalg.svd(eq.matrix(eq.e(y), M) / [*[eq.scale] * eq.n, 1.0])[2][-1]
        null = null if null @ direction >= 0 else -null
        t = null[:-1] / np.linalg.norm(null[:-1])
        slope = null[-1] / np.linalg.norm(null[:-1])
        trial, load, ok = eq.correct(y + size * t, M + size * slope, t)
        ok = ok and bool(film.margin(eq.e(trial)) > 0) and np.abs(trial - y).max() < 2 * size
        if not ok:
            size /= 2
            if size < 1e-9:
                locked = bool(np.isfinite(film.margin(eq.e(y))))
                break
            continue
        e = eq.e(trial)
        if load < 0 or np.abs(e[:2]).max() > np.log(max_stretch):
            break
        direction = np.append(trial - y, load - M)
        y, M = trial, load
        points.append(e)
        loads.append(load)
        size = min(2 * size, step)
    return np.array(points).T, np.array(loads), locked
