"""GMRES for small problems on one rank, where calls from PETSc back into Python cost most."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

Action = Callable[[np.ndarray], np.ndarray]


def fgmres(
    product: Action, precondition: Action, rhs: np.ndarray, rtol: float, most: int
) -> tuple[np.ndarray | None, int]:
    """Flexible GMRES from 0, preconditioned from the right, without a restart (Saad 1993).

    Parameters
    ----------
    product
        Product of the matrix with a vector.
    precondition
        Approximate solution for a vector.
    rhs
        Right-hand side.
    rtol
        Wanted size of the residual, relative to `rhs`.
    most
        Largest number of iterations.

    Returns
    -------
    ndarray or None, int
        The solution, None if it does not converge; the number of iterations.  If the matrix maps a
        direction to 0, as those of pressures in a rigid part, the best solution without it.
    """
    size = float(np.linalg.norm(rhs))
    if not np.isfinite(size):
        return None, 0
    if size == 0.0:
        return np.zeros_like(rhs), 0
    V = np.empty((most + 1, len(rhs)))
    Z = np.empty((most, len(rhs)))
    columns: list[list[float]] = []  # of the triangle R
    turns: list[tuple[float, float]] = []
    g = [size]
    V[0] = rhs / size
    for k in range(most):
        Z[k] = precondition(V[k])
        w = product(Z[k])
        h = V[: k + 1] @ w
        w = w - h @ V[: k + 1]
        norm = math.sqrt(float(w @ w))
        if not math.isfinite(norm):
            return None, k + 1
        column = h.tolist()
        for i, (c, s) in enumerate(turns):
            column[i], column[i + 1] = (
                c * column[i] + s * column[i + 1], c * column[i + 1] - s * column[i]
            )  # fmt: skip
        length = math.hypot(column[k], norm)
        if length == 0.0:  # the matrix has no part along this direction: the rest cannot be solved
            return _combined(columns, g, Z), k + 1
        c, s = column[k] / length, norm / length
        turns.append((c, s))
        column[k] = length
        columns.append(column)
        g.append(-s * g[k])
        g[k] *= c
        if abs(g[k + 1]) <= rtol * size:
            return _combined(columns, g, Z), k + 1
        V[k + 1] = w / norm
    return None, most


def _combined(columns: list[list[float]], g: list[float], Z: np.ndarray) -> np.ndarray:
    """The sum of the first directions whose residual is the smallest, by back substitution."""
    shares = g[: len(columns)]
    for k in reversed(range(len(columns))):
        column = columns[k]
        shares[k] /= column[k]
        for i in range(k):
            shares[i] -= shares[k] * column[i]
    return np.asarray(np.array(shares) @ Z[: len(shares)])
