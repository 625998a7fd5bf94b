"""Differences of fourth order, and the steps that they take."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from dea_fenicsx.gradients.shapes import most
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import State

OBSERVABLE_STEP = 1e-3
"""Step of the differences of an observable, relative to the state and to the variable.

The formula is of fourth order, so that its error is about 1e-12.
"""

LEAST_MOTION = 1e-3
"""Displacement that counts as a small one where nothing has moved, in units of the device."""


def fourth_order[Value: (float, np.ndarray)](of: Callable[[float], Value], step: float) -> Value:
    """The derivative of a function at 0, [8 (f(h) - f(-h)) - (f(2h) - f(-2h))]/(12 h)."""
    near = of(step) - of(-step)
    far = of(2 * step) - of(-2 * step)
    found: Value = (8 * near - far) / (12 * step)
    return found


def displacement_size(problem: Problem, state: State) -> float:
    """The largest displacement of a state, or `LEAST_MOTION`.  Collective."""
    sizes = [most(problem, state.values[part.dofs]) for part in problem.displacement]
    return max([*sizes, LEAST_MOTION])


def small_step(rates: Iterable[tuple[float, float]]) -> float:
    """A step that changes nothing much.

    Parameters
    ----------
    rates
        Sizes of what changes, each with its change for a unit of the step; 0 where there is none.
    """
    steps = [abs(size / rate) for size, rate in rates if size and rate]
    return OBSERVABLE_STEP * min(steps, default=1.0)
