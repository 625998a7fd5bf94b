"""Iterative refinement: linear solves to a stated accuracy, as far as rounding lets them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

PASS_TOLERANCE = 1e-8
"""Relative tolerance of one pass, which a Krylov method reaches before rounding stops it."""

MOST_PASSES = 6
"""Largest number of passes.  Each pass gains up to eight digits, as far as rounding allows."""

LEAST_REDUCTION = 0.5
"""If a pass leaves more than this share of the residual, only rounding is left, and we stop."""


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
    for _ in range(MOST_PASSES):
        change = solve(rest, max(0.5 * rtol / share, PASS_TOLERANCE))
        if change is None:
            break
        values = values + change
        rest = rhs - times(values)
        before, share = share, norm(rest) / size
        if best is None or share < best.residual:
            best = Solution(values, share)
        if share <= rtol or not share < LEAST_REDUCTION * before:
            break
    return best
