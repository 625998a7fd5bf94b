"""Derivatives of critical loads: of the load of a limit point, such as the voltage of pull-in.

At a limit point of the load f the tangent K has a null vector v and a left null vector y.  There

    df/dp = - (y . dR/dp) / (y . dR/df),

because R(x, f, p) = 0 and y . K = 0.  The limit point of a trace is located to a millionth of the
slope.  It is located more closely here, since the null vector must be that of the point itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from dea_fenicsx.gradients.adjoint import Gradients, check_static
from dea_fenicsx.gradients.gradient import Gradient
from dea_fenicsx.gradients.paired import Paired
from dea_fenicsx.gradients.variables import LoadVariable, Told, variables
from dea_fenicsx.model.state import State
from dea_fenicsx.path.arclength import Point, TracedBranch
from dea_fenicsx.path.load_course import LoadCourse
from dea_fenicsx.support.errors import InputError, SolverError

SLOPE_AT_LIMIT = 1e-11
"""Slope of the load along the branch, in units of the first one, that counts as zero."""

FIRST_ARC_OF_SECANT = 1e-3
"""The first step of the secant rule, in units of arc."""

MOST_STEPS_OF_SECANT = 12
"""Most steps of the secant rule."""


def limit_row(history: Sequence[Mapping[str, Any]], step: int) -> int:
    """The row of a history with the limit point that is asked for: the first one by default.

    Raises
    ------
    InputError
        If there is none.
    """
    rows = [k for k, row in enumerate(history) if row["event"] in ("maximum", "minimum")]
    chosen = step if step >= 0 else None
    if not rows:
        raise InputError(
            "The run has no limit point of a load, so that there is no pull-in to derive; a Trace "
            "locates it, and a Ramp cannot pass it: use dea.Trace."
        )
    if chosen is not None and chosen not in rows:
        raise InputError(
            f"step={step} is no limit point of a load; the run has some at the steps "
            f"{', '.join(map(str, rows))}."
        )
    return rows[0] if chosen is None else chosen


def critical_load(
    gradients: Gradients, state: State, row: Mapping[str, Any], to: Iterable[Told]
) -> Gradient:
    """The derivatives of the load of a limit point.  Collective.

    Parameters
    ----------
    gradients
        What derives.
    state, row
        The state of the limit point, and its row of the history.
    to
        The variables.

    Raises
    ------
    InputError
        For an unknown variable.
    SolverError
        If the limit point cannot be located more closely.
    """
    problem, ramp = gradients.problem, str(row["ramp"])
    check_static(state)
    found = variables(problem, to)
    unit = problem.scene.unit_volts.get(ramp, 0.0) or 1.0
    with problem.at(state):
        point = _located(gradients, state, ramp)
    with problem.at(point.state):
        left = point.direction if gradients.solver.tangent.is_symmetric else _left(gradients)
        paired = Paired(gradients.kept, gradients.solver.tangent, left)
        by_load = paired.slope(LoadVariable(ramp, ramp, 1.0))
        slopes = {one.name: -paired.slope(one) / by_load * unit for one in found}
    return Gradient("pull-in", point.factor * unit, slopes, "adjoint", abs(point.slope))


def _located(gradients: Gradients, state: State, ramp: str) -> Point:
    """The limit point near a state, where the load's slope vanishes.  Collective."""
    solver = gradients.solver
    solver.residual_of(gradients.problem.residual())
    solver.forget_factor()
    factor = state.factors[ramp]
    branch = TracedBranch(solver, LoadCourse(solver, {ramp: 1.0}, factor), factor or 1.0)
    start = branch.point(state, None)
    if start is None:
        raise SolverError("The tangent at the limit point was not found.")
    there, arc, slopes = start, 0.0, [(0.0, start.slope)]
    step = FIRST_ARC_OF_SECANT
    for _ in range(MOST_STEPS_OF_SECANT):
        if abs(there.slope) * branch.load_unit < SLOPE_AT_LIMIT:
            break
        if len(slopes) > 1:
            (a, one), (b, two) = slopes[-2:]
            step = -two * (b - a) / (two - one) if two != one else 0.0
        arc += step
        attempt = branch.step(start, arc)
        moved = branch.point(attempt.found, along=start) if attempt.converged else None
        if moved is None:
            break
        there = moved
        slopes.append((arc, there.slope))
    return there


def _left(gradients: Gradients) -> np.ndarray:
    """The left null vector at the present state, by inverse iteration.  Collective."""
    solver, problem = gradients.solver, gradients.problem
    vector = solver.tangent.by_load(next(iter(problem.factors)))
    for _ in range(3):
        vector = vector / np.sqrt(gradients.kept.total(vector @ vector))
        found = solver.solve_transposed(vector)
        if found is None:
            raise SolverError("The left null vector of the tangent was not found.")
        vector = found.values
    return vector / np.sqrt(gradients.kept.total(vector @ vector))
