"""A film with viscous branches: its equilibrium at given viscous strains, and how those flow.

The principal stretches are lam_i = exp(e_i), the principal values of a branch's viscous strain C_v
are exp(a_i) with a_1 + a_2 + a_3 = 0.  With x_i = exp(2 ebar_i - a_i), ebar the volume-preserving
part of e, and dev the part without mean, a branch of modulus mu and relaxation time tau has

    W = mu/2 (x_1 + x_2 + x_3 - 3),   Kirchhoff stresses mu dev(x),   da/dt = dev(x)/tau,

and dissipates mu/(2 tau) |dev(x)|^2 per undeformed volume and time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dea_fenicsx.exact.film import Dead, Film, Held

DEVIATOR = np.eye(3) - 1 / 3

LARGEST_LOG_STRETCH_CHANGE = 0.2
"""Largest change of a logarithmic stretch in one search of equilibrium."""


@dataclass(frozen=True, eq=False)
class Forces:
    """Equilibrium of a film at N states, in units of its `ViscousFilm.scale`.

    Attributes
    ----------
    e : logarithms of the principal stretches, shape (3, N)
    residual : forces on the free stretches, shape (n, N); 0 in equilibrium
    stiffness : derivative of the residual by the free stretches at frozen branches, (n, n, N)
    full : the same for all three stretches, (3, 3, N)
    x : exp(2 ebar - a) of each branch, (K, 3, N)
    """

    e: np.ndarray
    residual: np.ndarray
    stiffness: np.ndarray
    full: np.ndarray
    x: np.ndarray


class ViscousFilm:
    """Equations of a film with branches, for arrays of states.

    A state is: free stretches y, shape (n, N); branches a, shape (K, 2, N), the first two of the
    three logarithms; loads, shape (3, N): nominal field in V/m or charge per undeformed area in
    C/m^2, and what acts on each side (stretch or Pa).

    Parameters
    ----------
    film
        The film.  The values of its sides are not used, only their kinds.
    control
        ``"voltage"`` or ``"charge"``: what the first load is.
    symmetric
        Whether the two directions in the plane stay equal.
    """

    HAS_SLOPE = True
    """Whether `flow_slope` is known."""

    def __init__(self, film: Film, control: str, symmetric: bool):
        self.film, self.control = film, control
        branches = film.material.viscous
        self.mu = np.array([b.mu for b in branches], dtype=float).reshape(-1, 1, 1)
        self.tau = np.array(self._times(), dtype=float).reshape(-1, 1, 1)
        self.count = len(branches)
        self.scale = film.material.elastic.shear_modulus() + float(self.mu.sum())
        self.thickness_follows = film.incompressible
        self.held = [k for k, side in enumerate(film.sides) if isinstance(side, Held)]
        self.B = self._basis(symmetric)
        self.n = self.B.shape[1]

    def _times(self) -> list[float]:
        """The relaxation times of the branches in s."""
        return [b.tau for b in self.film.material.viscous]  # type: ignore[misc]

    def _basis(self, symmetric: bool) -> np.ndarray:
        columns = [np.eye(3)[k] for k in range(2) if k not in self.held]
        if symmetric and len(columns) == 2:
            columns = [columns[0] + columns[1]]
        if self.thickness_follows:
            columns = [c - c.sum() * np.eye(3)[2] for c in columns]
        else:
            columns.append(np.eye(3)[2])
        return np.array(columns).reshape(-1, 3).T

    # ------------------------------------------------------------------ strains and loads

    def stretches(self, y: np.ndarray, loads: np.ndarray) -> np.ndarray:
        """Logarithms of the principal stretches, shape (3, N)."""
        e = self.B @ y
        if not self.held:
            return e
        along = np.zeros_like(loads[1:])
        along[self.held] = np.log(loads[1:][self.held])
        return e + self._held(along)

    def _held(self, along: np.ndarray) -> np.ndarray:
        """What held sides add to the logarithmic stretches, from their values or rates (2, N)."""
        e = np.zeros((3, along.shape[1]))
        for k in self.held:
            e[k] = along[k]
        if self.thickness_follows:
            e[2] = -e[0] - e[1]
        return e

    def maxwell(self, e: np.ndarray, loads: np.ndarray) -> np.ndarray:
        """Maxwell pressure D E in Pa, shape (N,)."""
        electric = self.film.electric
        if self.control == "voltage":
            return np.asarray(electric.maxwell(e, loads[0] * np.exp(-e[2])))
        D = np.abs(loads[0]) * np.exp(-e[0] - e[1])
        return np.asarray(D * electric.field_of(e, D))

    def _sides(self, e: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Kirchhoff stresses in Pa of loads on the sides (or their rates), shape (3, N)."""
        tau = np.zeros_like(e)
        volume = np.exp(e.sum(axis=0))
        for k, side in enumerate(self.film.sides):
            if k not in self.held:
                tau[k] = values[k] * (np.exp(e[k]) if isinstance(side, Dead) else volume)
        return tau

    def _sides_slope(self, e: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Derivative of `_sides` by the stretches, shape (3, 3, N)."""
        slope = np.zeros((3, *e.shape))
        for k, side in enumerate(self.film.sides):
            if k not in self.held:
                slope[k, k if isinstance(side, Dead) else slice(None)] = tau[k]
        return slope

    # ------------------------------------------------------------------ equilibrium

    def springs(self, e: np.ndarray, a: np.ndarray) -> np.ndarray:
        """x = exp(2 ebar - a) of each branch, shape (K, 3, N)."""
        third = np.concatenate([a, -a.sum(axis=1, keepdims=True)], axis=1)
        return np.exp(2 * (e - e.mean(axis=0)) - third)

    def forces(self, y: np.ndarray, a: np.ndarray, loads: np.ndarray) -> Forces:
        """Equilibrium of states."""
        e = self.stretches(y, loads)
        x = self.springs(e, a)
        pull = (self.mu * x).sum(axis=0)
        slope = 2 * np.einsum("ij,jn,jk->ikn", DEVIATOR, pull, DEVIATOR)
        return Forces(e, *self._balance(e, pull, slope, loads), x)

    def _balance(
        self, e: np.ndarray, pull: np.ndarray, slope: np.ndarray, loads: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Residual, stiffness and full stiffness, from the branches' stresses and stiffness."""
        _, R, H = self.film.elastic(e)
        tau = self._sides(e, loads[1:])
        M = self.maxwell(e, loads)
        MJ, push = M * np.exp(e.sum(axis=0)), self.film.push(e)
        R = R + DEVIATOR @ pull - tau - push * MJ
        H = H + slope - self._sides_slope(e, tau)
        kept = self.film.electric.controls(e, M, self.control)
        H = H - (push[:, None] * kept[None, :] + self.film.electric.strain_part(e)[2] / 2) * MJ
        B = self.B
        K = np.einsum("ip,ijn,jq->pqn", B, H, B)
        return B.T @ R / self.scale, K / self.scale, H / self.scale

    def pull(self, f: Forces) -> np.ndarray:
        """Sum of the branches' Kirchhoff stresses in Pa, shape (3, N)."""
        return np.asarray((self.mu * (f.x - f.x.mean(axis=1, keepdims=True))).sum(axis=0))

    def spring_energy(self, f: Forces) -> np.ndarray:
        """Energy of the branches' springs in Pa, shape (N,)."""
        return np.asarray((self.mu[:, 0] / 2 * (f.x.sum(axis=1) - 3)).sum(axis=0))

    def flow(self, f: Forces) -> np.ndarray:
        """Rates da/dt in 1/s of the first two logarithms of each branch, shape (K, 2, N)."""
        x = f.x
        return (x[:, :2] - x.mean(axis=1, keepdims=True)) / self.tau

    def flow_slope(self, f: Forces) -> np.ndarray:
        """Derivative by (a, w) of the rates of the branches and of the dissipated energy w.

        The stretches follow from equilibrium.  For one state; shape (2 K + 1, 2 K + 1).
        """
        K, x = self.count, f.x[..., 0]
        third = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, -1.0]])
        own = -x[:, :, None] * third  # dx/da of each branch, (K, 3, 2)
        pull = (self.mu * own).transpose(1, 0, 2).reshape(3, 2 * K)
        out = np.zeros((2 * K + 1, 2 * K + 1))
        by_e = np.zeros((3, 2 * K))
        if self.n:
            force = self.B.T @ DEVIATOR @ pull / self.scale
            by_e = -self.B @ np.linalg.solve(f.stiffness[..., 0], force)
        dx = 2 * x[:, :, None] * (DEVIATOR @ by_e)  # (K, 3, 2 K)
        for k in range(K):
            dx[k, :, 2 * k : 2 * k + 2] += own[k]
        flow = np.einsum("ij,kjl->kil", DEVIATOR[:2], dx) / self.tau
        out[: 2 * K, : 2 * K] = flow.reshape(2 * K, 2 * K)
        deviator = x - x.mean(axis=1, keepdims=True)
        lost = self.mu[..., 0] / self.tau[..., 0] * deviator
        out[2 * K, : 2 * K] = np.einsum("ki,kil->l", lost, dx) / self.scale
        return out

    def dissipation(self, f: Forces) -> np.ndarray:
        """Dissipation of each branch in W per undeformed m^3, shape (K, N)."""
        x = f.x
        deviator = x - x.mean(axis=1, keepdims=True)
        return (self.mu / (2 * self.tau) * deviator**2).sum(axis=1)

    def drift(
        self, f: Forces, adot: np.ndarray, loads: np.ndarray, rates: np.ndarray
    ) -> np.ndarray:
        """Rate of the residual in 1/s while the free stretches are kept, shape (n, N)."""
        third = np.concatenate([adot, -adot.sum(axis=1, keepdims=True)], axis=1)
        R = -DEVIATOR @ self._released(f, third) - self._sides(f.e, rates[1:])
        M = self.maxwell(f.e, loads)
        n = self.film.electric.growth(f.e, M)
        power = 1 + (n if self.control == "voltage" else 1 / n)  # d ln M / d ln load
        driven = loads[0] != 0
        rate = power * rates[0] * np.where(driven, M / np.where(driven, loads[0], 1.0), 0.0)
        R = R / self.scale - self.film.push(f.e) * rate * np.exp(f.e.sum(axis=0)) / self.scale
        if self.held:
            along = np.zeros_like(rates[1:])
            along[self.held] = rates[1:][self.held] / loads[1:][self.held]
            R = R + np.einsum("ijn,jn->in", f.full, self._held(along))
        return self.B.T @ R

    def _released(self, f: Forces, adot: np.ndarray) -> np.ndarray:
        """Minus the rates in Pa/s of the springs' Kirchhoff stresses at kept stretches, (3, N)."""
        return np.asarray((self.mu * f.x * adot).sum(axis=0))

    def equilibrium(
        self, y: np.ndarray, a: np.ndarray, loads: np.ndarray
    ) -> tuple[np.ndarray, Forces]:
        """The stable equilibrium near y at frozen branches; NaN where there is none near."""
        start = y
        if self.n == 0:
            return y, self.forces(y, a, loads)
        for _ in range(25):
            f = self.forces(y, a, loads)
            step = self._solved(f.stiffness, f.residual)
            y = y - step
            size = float(np.max(np.abs(step), initial=0.0))
            # the error after a step is about the square of the step
            if not np.isfinite(size) or size < 3e-9:
                break
        f = self.forces(y, a, loads)
        moved = np.abs(y - start).max(axis=0)
        lost = (self.softness(f) <= 0) | (moved > LARGEST_LOG_STRETCH_CHANGE)
        lost |= ~(np.abs(f.residual).max(axis=0) < 1e-9)
        return (np.where(lost, np.nan, y), f) if lost.any() else (y, f)

    @staticmethod
    def _solved(K: np.ndarray, b: np.ndarray) -> np.ndarray:
        if K.shape[0] == 1:
            return b / np.where(K[0] == 0, np.nan, K[0])
        K = np.moveaxis(K, -1, 0)
        if not np.all(np.isfinite(K)):
            return np.full_like(b, np.nan)
        return np.linalg.lstsq(K[0], b[:, 0])[0][:, None] if len(K) == 1 else np.moveaxis(
            np.linalg.solve(K, np.moveaxis(b, -1, 0)[..., None])[..., 0], 0, -1
        )  # fmt: skip

    def softness(self, f: Forces) -> np.ndarray:
        """Smallest eigenvalue of the stiffness, positive where stable, shape (N,); NaN if lost."""
        if self.n == 0:
            return np.ones(f.e.shape[1])
        if self.n == 1:
            return f.stiffness[0, 0]
        K = np.moveaxis(f.stiffness, -1, 0)
        good = np.isfinite(K).all(axis=(1, 2))
        K = np.where(good[:, None, None], (K + np.swapaxes(K, 1, 2)) / 2, 0.0)
        return np.where(good, np.linalg.eigvalsh(K)[:, 0], np.nan)


def adjugate(K: np.ndarray) -> tuple[np.ndarray, float]:
    """Adjugate and determinant of a matrix of 1 to 3 rows: K adj(K) = det(K) 1."""
    n = len(K)
    if n == 1:
        return np.ones((1, 1)), float(K[0, 0])
    out = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            rest = np.delete(np.delete(K, i, 0), j, 1)
            out[j, i] = (-1) ** (i + j) * np.linalg.det(rest)
    return out, float(K[0] @ out[:, 0])
