"""Changes of a state with a variable, and of what is measured on it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dea_fenicsx.gradients.differences import displacement_size, fourth_order, small_step
from dea_fenicsx.gradients.motion_changes import moved
from dea_fenicsx.gradients.shapes import distortion, most
from dea_fenicsx.gradients.variables import Coefficients, LoadVariable, Shape, Variable, larger
from dea_fenicsx.gradients.viscous_changes import Strains
from dea_fenicsx.model.motion import MOTION, Motion
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import State


@dataclass(frozen=True, eq=False)
class Change:
    """How a state changes with a variable.

    Attributes
    ----------
    values
        The change of all local values for a unit of the variable.
    strains
        That of the viscous strains of which the state's history tells; None without branches.
    motion
        That of its motion; None without inertia.
    """

    values: np.ndarray
    strains: Strains | None = None
    motion: Motion | None = None


@dataclass(frozen=True, eq=False)
class Recorded:
    """A recorded step.

    Attributes
    ----------
    state
        Its state.
    item
        The item of the path in which it lies.
    began
        Time in s at which that item began.
    event
        What happened there, such as a failure; empty for a step of the path.
    """

    state: State
    item: Any
    began: float
    event: str = ""


def slopes(
    problem: Problem, state: State, changes: Iterable[tuple[Variable, Change]],
    measure: Callable[[], float], anew: Callable[[], float] | None = None,
) -> dict[str, float]:  # fmt: skip
    """The derivatives of an observable by variables, along the changes of the state.  Collective.

    The problem is left in the state.

    Parameters
    ----------
    problem, state, changes
        The problem, a state, and its change with each variable.
    measure
        The observable.
    anew
        The same where nothing is kept of the mesh: for changes of shape.
    """

    found = {}
    for one, change in changes:
        value = anew if anew and isinstance(one, Shape) else measure

        def measured(
            step: float, one: Variable = one, change: Change = change,
            value: Callable[[], float] = value,
        ) -> float:  # fmt: skip
            with larger(problem, one, step):
                problem.show(changed(problem, state, change, one, step))
                return float(value())

        found[one.name] = fourth_order(measured, step_of(problem, state, change, one))
        problem.show(state)
    return found


def step_of(problem: Problem, state: State, change: Change, one: Variable) -> float:
    """The step of a variable for differences.  Collective."""
    speeds = [most(problem, change.values[part.dofs]) for part in problem.displacement]
    flow = 0.0 if change.strains is None else most(problem, change.strains)
    value = one.value if isinstance(one, Coefficients) else 0.0
    if isinstance(one, LoadVariable):
        value = one.unit
    size = displacement_size(problem, state)
    rates = [(size, max(speeds)), (1.0, flow), (value, 1.0)]
    if isinstance(one, Shape):
        rates.append((1.0, distortion(problem, one.velocity)))
    return small_step(rates)


def changed(problem: Problem, state: State, change: Change, one: Variable, step: float) -> State:
    """A state where a variable is larger by a step, to first order."""
    factors, history = state.factors, dict(state.history)
    if isinstance(one, LoadVariable):
        factors = factors | {one.ramp: factors[one.ramp] * (1 + step / one.unit)}
    if change.strains is not None:
        memory = problem.forms.memory
        told = history.get(memory.NAME) or memory.at_rest()
        newest = told.strains[0] + step * change.strains
        history[memory.NAME] = replace(told, strains=(newest, *told.strains[1:]))
    if change.motion is not None:
        history[MOTION] = moved(history[MOTION], change.motion, step)
    values = state.values + step * change.values
    return replace(state, values=values, factors=factors, history=history)
