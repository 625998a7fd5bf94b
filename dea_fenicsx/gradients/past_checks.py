"""Which marches are derived, and by what."""

from __future__ import annotations

from collections.abc import Iterable

from dea_fenicsx.gradients.changes import Recorded
from dea_fenicsx.gradients.variables import Shape, Variable
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import State
from dea_fenicsx.path.items import CONSERVING
from dea_fenicsx.support.errors import InputError


def has_past(state: State) -> bool:
    """Whether a state depends on those before it, so that its derivative does, too."""
    return bool(state.time or state.history)


def check_past(problem: Problem, recorded: Recorded, found: Iterable[Variable]) -> None:
    """Raise InputError where the steps of a march are not derived."""
    inertia = getattr(recorded.item, "moving", None)
    conserves = inertia is not None and inertia.scheme == CONSERVING
    parts = {
        "charges that leak, relax or come from a source": bool(problem.charges),
        "friction": bool(problem.frictions),
        "rubbers that soften": bool(problem.forms.damages),
        "relaxation times that change with temperature": any(
            kernel.heat is not None and kernel.heat.thermal.shift is not None
            and kernel.branches for kernel in problem.kernels
        ),
        "rigid parts": bool(problem.rigid),
        "springs of a free body": bool(problem.springs.rows.size),
        "viscous branches that are solved at each quadrature point (only Maxwell branches are "
        "derived)": any(kernel.flowing for kernel in problem.kernels),
        "the energy-conserving scheme": conserves,
    }
    for what, there in parts.items():
        if there:
            raise InputError(
                f"A step of a march with {what} has no derivative here; compare two runs instead."
            )
    for one in found:
        if isinstance(one, Shape):
            raise InputError(
                f"{one.name!r} has no derivative at a step of a march; equilibria without a past "
                "are derived by shape, and a march by constants and loads."
            )
