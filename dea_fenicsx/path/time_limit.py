"""The states over the length of one step in time, its history held, followed by arc length.

A viscous body that is about to lose its equilibrium moves ever faster.  Over the length of a step
its states then form a branch that turns back at a limit point, as a static branch does over the
load.  The length of the step takes the place of the load.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dea_fenicsx.model.state import State
from dea_fenicsx.model.viscous_history import Rule
from dea_fenicsx.path.arclength import TracedBranch
from dea_fenicsx.path.bridging import follow
from dea_fenicsx.path.events import Sentinel
from dea_fenicsx.path.time_stepping import TimeStepper

STEP_LENGTH_DIFFERENCE = 1e-5
"""Step of the difference that gives the derivative by the length of the step, in the latter's unit.

The derivative only aims Newton's corrections; their end does not depend on it.
"""


MOTION_LEFT = 1 / (np.sqrt(2.0) - 1)
"""Motion up to a limit point over that of the last step, if this went half of the time left."""

SMALLEST_MOTION_OF_ARC = 1e-7
"""Smallest unit of motion along a branch, in units of arc: below it there is rounding."""


class TimeCourse:
    """The length of a step in time as the load of a branch.

    Parameters
    ----------
    stepper
        Gives the states and their history.
    seconds
        The unit of length in s.
    """

    def __init__(self, stepper: TimeStepper, seconds: float) -> None:
        self.stepper, self.problem, self.unit = stepper, stepper.problem, seconds
        self.rule = stepper.limit_rule()

    def loaded(self, state: State, share: float) -> State:
        """The unknowns of a state at the end of a step of this length, its fixed values set."""
        seconds = max(share, 0.0) * self.unit
        target = self.stepper.target(seconds, self.stepper.ahead(seconds, self.rule))
        return self.problem.imposed(target.with_values(state.values))

    def factor_of(self, state: State) -> float:
        """Length of the step that ends in a state."""
        return float(next(state.history[name].span for name in self.stepper.memories)) / self.unit

    def derivative(self) -> np.ndarray:
        """Derivative of the residual in the free rows by the length, at the present state."""
        here = self.problem.state
        share = self.factor_of(here)
        first = max(share - STEP_LENGTH_DIFFERENCE, 0.0)
        rows = []
        for place in (first, first + STEP_LENGTH_DIFFERENCE, first + 2 * STEP_LENGTH_DIFFERENCE):
            with self.problem.at(self.loaded(here, place)):
                rows.append(self.problem.unbalanced(self.problem.residual()))
        at = (share - first) / STEP_LENGTH_DIFFERENCE
        weights = (at - 1.5, 2 - 2 * at, at - 0.5)
        total = sum(w * r for w, r in zip(weights, rows, strict=True))
        return np.asarray(total / STEP_LENGTH_DIFFERENCE)


@dataclass(frozen=True)
class TimeLimit:
    """The limit point of a step.

    Attributes
    ----------
    seconds
        The length of the step there, in s.
    state
        The equilibrium there, not settled.
    rule
        The rule of the step.
    """

    seconds: float
    state: State
    rule: Rule


def _measure(branch: TracedBranch, stepper: TimeStepper) -> None:
    """Measure the motion along a branch by that of the last step, if this was a small one.

    The closer the limit point, the less the body moves on the way to it.  With the motion of half
    of the time left as known from the last step, the whole rest is 1/(sqrt(2) - 1) times as long.
    Collective.
    """
    if len(stepper.known) < 2:
        return
    before, last = stepper.known[-2:]
    moved = (last.values - before.values)[stepper.problem.free]
    length = MOTION_LEFT * np.sqrt(branch.dot(moved, 0.0, moved, 0.0))
    branch.weight /= min(max(length, SMALLEST_MOTION_OF_ARC), 1.0) ** 2


def follow_time(stepper: TimeStepper, sentinel: Sentinel, seconds: float) -> TimeLimit | None:
    """Look for a limit point within a step that has failed.  Collective.

    Parameters
    ----------
    stepper
        Holds the last accepted state.
    sentinel
        Counts negative eigenvalues.
    seconds
        Length of the step that has failed, in s.
    """
    course = TimeCourse(stepper, seconds)
    with stepper.problem.at(stepper.base):
        branch = TracedBranch(stepper.solver, course, 1.0)
        _measure(branch, stepper)
        found = follow(branch, sentinel, 1.0)
    stepper.solver.forget_factor()
    if found.limit is None:
        return None
    return TimeLimit(found.limit * seconds, found.points[-1].state, course.rule)
