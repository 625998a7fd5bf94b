"""How much one Newton step squeezes the air.

The energy of air grows as J^-2, so that Newton's method overshoots where a gap closes: from a state
with too small a J it comes back by a factor of 4/3 each time.  As in interior-point methods a step
is therefore not longer than such that each J in the air keeps a share of its value.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.problem import Problem

LEAST_KEPT_SHARE_OF_J = 0.25
"""Share of its J that each point of the air keeps in one Newton step."""

TOLERATED_SHARE = 0.1
"""Share from which on a step is taken as it is, since another trial would cost more."""


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
