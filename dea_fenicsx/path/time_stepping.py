"""Single steps in time: the state at a later time, from the last accepted one.

The history stays as it is while a state is searched.  So the search can be repeated with another
length of the step, and events within a step are found in this way.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from mpi4py import MPI

from dea_fenicsx.drives.waves import Wave
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import State
from dea_fenicsx.model.viscous_history import STAGE_SHARE, Rule, ViscousHistory
from dea_fenicsx.path.interpolation import lagrange_weights
from dea_fenicsx.path.step_lengths import estimate
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.outcome import Attempt, Outcome

MOST_MISSED = 0.1
"""Largest distance of a state from its prediction, as a share of the device's size.

A state that lies farther away may be one of another branch, so that the step is halved.
"""


class TimeStepper:
    """Finds the states of a problem at later times.

    Parameters
    ----------
    solver
        The nonlinear solver; its problem is in equilibrium.
    drive
        The wave of each ramp that is driven.
    began
        Time in s of the problem at which the time of the drive is 0.
    order
        1 for backward Euler, 2 for BDF2 with first steps of SDIRK2.

    Attributes
    ----------
    base
        The last accepted state.
    """

    def __init__(
        self, solver: NewtonSolver, drive: Mapping[str, Wave], began: float, order: int = 2
    ) -> None:
        self.solver = solver
        self.problem: Problem = solver.problem
        self.memory = self.problem.forms.memory
        self.drive, self.began, self.order = drive, began, order
        self.known: list[State] = []
        self._stage: np.ndarray | None = None
        self.restart(self.problem.state)

    @property
    def now(self) -> float:
        """Time of the drive at the last accepted state, in s."""
        return self.base.time - self.began

    @property
    def history(self) -> ViscousHistory:
        """The history of the last accepted state."""
        found: ViscousHistory = self.base.history[self.memory.NAME]
        return found

    def restart(self, state: State, jump: bool = False) -> None:
        """Go on from a state that is not the end of the last step, such as one after a jump."""
        self.base = state
        self.known = [state]
        if self.memory and (jump or self.memory.NAME not in state.history):
            history = state.history.get(self.memory.NAME) or self.memory.at_rest()
            self.base = _remembering(state, history.restarted())

    def accept(self, state: State) -> None:
        """Go on from the settled end of a step."""
        self.base = state
        self.known = [*self.known[-2:], state]

    def rule(self) -> Rule:
        """The rule of the next step."""
        if self.order == 1:
            return Rule.EULER
        return Rule.BDF2 if len(self.history.strains) > 2 else Rule.STAGE

    def target(self, seconds: float, history: ViscousHistory) -> State:
        """The state that is searched after a time, with the last accepted unknowns.  Collective."""
        local = self.now + seconds
        loads = {name: wave.before(local) for name, wave in self.drive.items()}
        moved = self.problem.under(self.base, loads)
        return _remembering(replace(moved, time=self.began + local), history)

    def predicted(self, target: State) -> State:
        """The polynomial in time through the accepted states, at the time and load of another."""
        times = np.array([s.time for s in self.known])
        if len(times) < 2:
            return target
        weights = lagrange_weights(times, target.time)
        values = sum(w * s.values for w, s in zip(weights, self.known, strict=True))
        return target.with_values(np.asarray(values))

    def step(self, seconds: float) -> Attempt:
        """The state after a time; its history is that of the step, not yet settled.  Collective."""
        rule = self.rule()
        if rule is not Rule.STAGE:
            return self._solve(self.target(seconds, self.history.ahead(seconds, rule)))
        part = STAGE_SHARE * seconds
        first = self._solve(self.target(part, self.history.ahead(part, Rule.EULER)))
        if not first.converged:
            return first
        with self.problem.at(first.found):
            stage = self.memory.strained(first.found.history[self.memory.NAME])
        old = self.history
        both = ViscousHistory(
            (stage, *old.strains), (first.found.time, *old.times), part, Rule.STAGE
        )
        self._stage = stage
        attempt = self._solve(self.target(seconds, both), near=first.found)
        return replace(attempt, iterations=attempt.iterations + first.iterations)

    def _solve(self, target: State, near: State | None = None) -> Attempt:
        """Newton's method from the prediction; if it fails, from the last accepted state."""
        problem, solver = self.problem, self.solver
        guess = self.predicted(target) if near is None else target.with_values(near.values)
        if len(self.known) > 1 or near is not None:
            start = problem.imposed(guess)
            with problem.at(start):
                admissible = problem.probe().admissible
            if admissible:
                attempt = self._judged(solver.solve(start), guess)
                if attempt.converged:
                    return attempt
        return self._judged(solver.solve(target, target.factors), guess)

    def _judged(self, attempt: Attempt, guess: State) -> Attempt:
        """Refuse a state that lies far from its prediction.  Collective."""
        if not attempt.converged or len(self.known) < 2:
            return attempt
        dofs = self.problem.roles.owned(Role.MOTION)
        off = np.abs(attempt.found.values[dofs] - guess.values[dofs])
        most = self.problem.comm.allreduce(float(np.max(off, initial=0.0)), op=MPI.MAX)
        return attempt if most <= MOST_MISSED else attempt.refused(Outcome.JUMPED)

    def settled(self, state: State) -> State:
        """A state with the viscous strains at its own time.  Collective."""
        if not self.memory:
            return state
        with self.problem.at(state):
            history = self.memory.settled(state.history[self.memory.NAME], state.time)
        return _remembering(state, history)

    def place(self, seconds: float) -> Attempt:
        """The settled state after a time, for the search of events.  Collective."""
        attempt = self.step(seconds)
        if not attempt.converged:
            return attempt
        return replace(attempt, state=self.settled(attempt.found))

    def error(self, settled: State, rule: Rule, corner: bool = False) -> float | None:
        """Estimated error of a step that has ended in a settled state; None if not known.

        `corner` tells whether the step began at a corner of the drive.

        A step of SDIRK2 is compared with backward Euler's rule over the first stage, continued to
        the end of the step, which has order 1.  Collective.
        """
        history = settled.history[self.memory.NAME]
        if rule is Rule.STAGE:
            assert self._stage is not None
            old = history.strains[1]
            found = history.strains[0] - old - (self._stage - old) / STAGE_SHARE
        else:
            estimated = estimate(history, 1 if rule is Rule.EULER else 2, corner)
            if estimated is None:
                return None
            found = estimated
        return self.memory.size(found)


def _remembering(state: State, history: ViscousHistory) -> State:
    return replace(state, history={**state.history, "viscous": history})
