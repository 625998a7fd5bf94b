"""How much one Newton step squeezes the air.

The energy of the air grows as J^-2, with the volume ratio J.  Where a gap closes, Newton's method
overshoots: it arrives at a J that is too small, and each further iteration enlarges this J by a
factor of 4/3 only.  So we shorten a step until each J in the air keeps a share of its value, as
interior-point methods do with their distance from a bound.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.problem import Problem

LEAST_KEPT_SHARE_OF_J = 0.25
"""Least share of its volume ratio J that each point of the air keeps in a shortened step."""

TOLERATED_SHARE = 0.1
"""If each J keeps at least this share, we take the step as it is: another trial would cost more."""


class Squeezing:
    """Watches the air in the steps of Newton's method.

    Parameters
    ----------
    problem
        The problem.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        cells = [kernel.cells for kernel in problem.kernels if kernel.air is not None]
        self._is_there = bool(cells) and bool(problem.scene.solids)
        self._cells = np.concatenate([np.empty(0, dtype=np.int32), *cells])
        self._before = np.empty(0)

    def __bool__(self) -> bool:
        return self._is_there

    def begin(self) -> None:
        """Take the present state as that before a step."""
        if self:
            self._before = self.problem.forms.prober.smallest_J(self._cells)

    def share(self) -> float:
        """Least share of J that is left in a cell of the air.  Collective."""
        now = self.problem.forms.prober.smallest_J(self._cells)
        least = float(np.min(now / self._before, initial=1.0))
        least = least if np.isfinite(least) else -1.0
        return self.problem.comm.allreduce(least, op=MPI.MIN)


def shortened(share: float) -> float:
    """What a step is multiplied by if it leaves too small a share of J, which is linear in it."""
    return float(np.clip((1 - LEAST_KEPT_SHARE_OF_J) / (1 - share), 0.05, 0.9))
