"""Which marches are derived in which way."""

from __future__ import annotations

from dea_fenicsx.gradients.changes import Recorded
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import State
from dea_fenicsx.path.items import CONSERVING


def has_past(state: State) -> bool:
    """Whether a state depends on those before it, so that its derivative does, too."""
    return bool(state.time or state.history)


def is_carried(problem: Problem, recorded: Recorded) -> bool:
    """Whether the changes of the state are carried along over the steps to a recorded one.

    Where they are not, the march is gone over again, see `replay`.
    """
    inertia = getattr(recorded.item, "moving", None)
    conserves = inertia is not None and inertia.scheme == CONSERVING
    shifted = any(
        kernel.heat is not None and kernel.heat.thermal.shift is not None and kernel.branches
        for kernel in problem.kernels
    )
    return not (
        conserves
        or shifted
        or problem.charges
        or problem.frictions
        or problem.forms.damages
        or problem.rigid
        or problem.springs.rows.size
        or any(kernel.flowing for kernel in problem.kernels)
    )
