"""Iterative refinement: linear solves to a stated accuracy, as far as rounding lets them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

PASS = 1e-8
"""Relative tolerance of one pass: Krylov's method reaches it before rounding stops it."""

PASSES = 6
"""Most passes; each gains up to eight digits of those that rounding leaves."""

PROGRESS = 0.5
"""Share of the last residual above which a pass has gained nothing but rounding."""


@dataclass(frozen=True)
class Solution:
    """A solution of a linear system.

    Attributes
    ----------
    values
        The solution in the free unknowns (owned).
    residual
        2-norm of what it leaves of the right-hand side, relative to that of the right-hand side.
    """

    values: np.ndarray
    residual: float


def solve_to(
    rhs: np.ndarray,
    rtol: float,
    solve: Callable[[np.ndarray, float], np.ndarray | None],
    times: Callable[[np.ndarray], np.ndarray],
    comm: MPI.Comm,
) -> Solution | None:
    """Solve a linear system to a stated accuracy, or as far as rounding lets it.  Collective.

    Parameters
    ----------
    rhs
        Right-hand side (owned).
    rtol
        Wanted residual relative to the right-hand side.
    solve
        Solves for a right-hand side to a relative tolerance; None if it fails.
    times
        Product of the matrix with a vector.
    comm
        The ranks that share the vectors.

    Returns
    -------
    Solution or None
        None if not even the first pass succeeds.
    """

    def norm(vector: np.ndarray) -> float:
        return float(np.sqrt(comm.allreduce(float(vector @ vector), op=MPI.SUM)))

    size = norm(rhs)
    if size == 0.0:
        return Solution(np.zeros_like(rhs), 0.0)
    best: Solution | None = None
    values, rest, share = np.zeros_like(rhs), rhs, 1.0
    for _ in range(PASSES):
        change = solve(rest, max(0.5 * rtol / share, PASS))
        if change is None:
            break
        values = values + change
        rest = rhs - times(values)
        before, share = share, norm(rest) / size
        if best is None or share < best.residual:
            best = Solution(values, share)
        if share <= rtol or not share < PROGRESS * before:
            break
    return best
