"""Single steps in time: the state at a later time, from the last accepted one.

The history stays as it is while a state is searched.  So the search can be repeated with another
length of the step, and events within a step are found in this way.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.drives.waves import Wave
from dea_fenicsx.model.charge_history import TOTAL, ChargeHistory
from dea_fenicsx.model.charge_memory import ChargeMemory
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.rigid_starts import turn_on
from dea_fenicsx.model.state import State
from dea_fenicsx.model.viscous_history import STAGE_SHARE, Rule
from dea_fenicsx.path.interpolation import lagrange_weights
from dea_fenicsx.path.step_lengths import MOST_GROWTH_OF_BDF3, estimate, stage_estimate
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.outcome import Attempt, Outcome

MOST_MISSED = 0.1
"""Largest distance of a state from its prediction, as a share of the device's size.

A state that lies farther away may be one of another branch, so that the step is halved.
"""

MOST_MISSED_BY_MOTION = 10.0
"""The same distance in units of the predicted motion, beyond `SMALL_MISS`."""

SMALL_MISS = 1e-3
"""Distance of a state from its prediction that is always small, as a share of the device's size."""

Histories = dict[str, Any]
"""What a state remembers, by the name of the memory that knows what to do with it."""


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
        1 for backward Euler, 2 for BDF2 with first steps of SDIRK2, 3 for BDF3 with first steps of
        SDIRK2 and BDF2.
    only
        Name of the one memory for which time passes; None for all.

    Attributes
    ----------
    base
        The last accepted state.
    now
        Time of the drive there, in s.  That of the problem is rounded more coarsely where much time
        had passed before: after a rest of an hour to 5e-13 s, which a fast drive would notice.
    """

    def __init__(
        self, solver: NewtonSolver, drive: Mapping[str, Wave], began: float, order: int = 2,
        only: str | None = None,
    ) -> None:  # fmt: skip
        self.solver = solver
        self.problem: Problem = solver.problem
        self.memories = {
            memory.NAME: memory for memory in self.problem.memories if only in (None, memory.NAME)
        }
        self.drive, self.began, self.order = drive, began, order
        self.known: list[State] = []
        self._stages: Histories = {}
        self.base = self.problem.state
        self.now = self._shown(self.base)
        self.restart(self.base)

    @property
    def histories(self) -> Histories:
        """The histories of the last accepted state, by the names of their memories."""
        return {name: self.base.history[name] for name in self.memories}

    @property
    def levels(self) -> int:
        """Number of accepted times that are known since the last jump."""
        return min(history.levels for history in self.histories.values())

    def ahead(self, seconds: float, rule: Rule) -> Histories:
        """The histories for a state that lies later by a time in s."""
        return {name: h.ahead(seconds, rule) for name, h in self.histories.items()}

    def restart(self, state: State, jump: bool = False) -> None:
        """Go on from a state that is not the end of the last step, such as one after a jump.

        Collective.
        """
        new = {name for name in self.memories if name not in state.history}
        if jump or new:
            with self.problem.at(state):
                state = self._remembering(state, {
                    name: memory.refreshed(self.problem.histories[name], state.time)
                    for name, memory in self.memories.items() if jump or name in new
                })  # fmt: skip
        if state.time != self.base.time:
            self.now = self._shown(state)
        self.base = state
        self.known = [state]

    def accept(self, state: State, now: float | None = None) -> None:
        """Go on from the settled end of a step, at some time of the drive in s."""
        self.base = state
        self.now = self._shown(state)
        if now is not None:
            self.set_clock(now)
        self.known = [*self.known[-2:], state]

    def set_clock(self, now: float) -> None:
        """Take a more exact time of the drive in s, if it is that of the last accepted state."""
        if abs(self.now - now) <= 2 * math.ulp(max(abs(self.base.time), abs(self.began))):
            self.now = now

    def _shown(self, state: State) -> float:
        """Time of the drive in s by the time of a state."""
        return state.time - self.began

    def rule(self, seconds: float) -> Rule:
        """The rule of a next step of some length in s."""
        if self.order == 1:
            return Rule.EULER
        if self.levels < Rule.BDF2.known:
            return Rule.STAGE
        return self._highest(seconds)

    def _highest(self, seconds: float) -> Rule:
        """BDF3 if it is asked for and the step is not much longer than the last one, or BDF2."""
        if self.order < 3 or self.levels < Rule.BDF3.known:
            return Rule.BDF2
        times = next(iter(self.histories.values())).times
        return Rule.BDF3 if seconds <= MOST_GROWTH_OF_BDF3 * (times[0] - times[1]) else Rule.BDF2

    def limit_rule(self) -> Rule:
        """The rule by which a limit point is looked for, over the length of the next step."""
        return self._highest(0.0) if self.levels > 1 and self.order > 1 else Rule.EULER

    def target(self, seconds: float, histories: Histories) -> State:
        """The state that is searched after a time, with the last accepted unknowns.  Collective."""
        local = self.now + seconds
        loads = {name: wave.before(local) for name, wave in self.drive.items()}
        moved = self.problem.under(self.base, loads)
        return self._remembering(replace(moved, time=self.began + local), histories)

    def predicted(self, target: State) -> State:
        """The polynomial in time through the accepted states, at the time and load of another."""
        times = np.array([s.time for s in self.known])
        if len(times) < 2:
            return target
        weights = lagrange_weights(times, target.time)
        values = sum(w * s.values for w, s in zip(weights, self.known, strict=True))
        share = (target.time - times[-1]) / (times[-1] - times[-2])
        old, new = (state.values for state in self.known[-2:])
        turn_on(self.problem.rigid, values, old, new, share)
        return target.with_values(np.asarray(values))

    def step(self, seconds: float) -> Attempt:
        """The state after a time; its history is that of the step, not yet settled.  Collective."""
        rule = self.rule(seconds)
        if rule is not Rule.STAGE:
            return self._solve(self.target(seconds, self.ahead(seconds, rule)))
        part = STAGE_SHARE * seconds
        first = self._solve(self.target(part, self.ahead(part, Rule.EULER)))
        if not first.converged:
            return first
        with self.problem.at(first.found):
            self._stages = {
                name: memory.staged(first.found.history[name], first.found.time)
                for name, memory in self.memories.items()
            }
        attempt = self._solve(self.target(seconds, self._stages), near=first.found)
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
        predicted = np.abs(guess.values[dofs] - self.base.values[dofs])
        mine = np.array([np.max(off, initial=0.0), np.max(predicted, initial=0.0)])
        self.problem.comm.Allreduce(MPI.IN_PLACE, mine, MPI.MAX)
        missed, moved = mine
        most = min(MOST_MISSED, MOST_MISSED_BY_MOTION * moved + SMALL_MISS)
        return attempt if missed <= most else attempt.refused(Outcome.JUMPED)

    def settled(self, state: State) -> State:
        """A state whose histories are those at its own time.  Collective."""
        if not self.memories:
            return state
        with self.problem.at(state):
            histories = {
                name: memory.settled(state.history[name], state.time)
                for name, memory in self.memories.items()
            }
        return self._remembering(state, histories)

    def place(self, seconds: float) -> Attempt:
        """The settled state after a time, for the search of events.  Collective."""
        attempt = self.step(seconds)
        if not attempt.converged:
            return attempt
        return replace(attempt, state=self.settled(attempt.found))

    def error(self, settled: State, rule: Rule, corner: bool = False) -> float | None:
        """Estimated error of a step that has ended in a settled state; None if not known.

        `corner` tells whether the step began at a corner of the drive.  Collective.
        """
        errors = []
        if (strains := self.problem.forms.memory) and (new := settled.history[strains.NAME]):
            wrong = self._wrong(new.times, new.strains, strains.NAME, "strains", rule, corner)
            errors.append(None if wrong is None else strains.size(wrong))
        if (charges := self.problem.charges) and (new := settled.history[charges.NAME]):
            lower = Rule.BDF2 if rule is Rule.BDF3 else rule  # see `ChargeHistory.ahead`
            wrong = self._wrong(new.times, new.wires, charges.NAME, "wires", lower, corner)
            errors.append(None if wrong is None else charges.wire_error(wrong, new.wires[0]))
            if rule is Rule.STAGE:
                stage = self._stages[charges.NAME]
                times = (new.times[0], stage.times[0], new.times[1])
                leaks = (new.leaks[0], stage.leaks[0], new.leaks[1])
            else:
                times, leaks = new.times, new.leaks
            errors.append(charges.leak_error(times, leaks, new.times[0] - new.times[1]))
            if charges.has_sheets:
                errors.append(self._sheet_error(charges, new, rule, corner))
        known = [error for error in errors if error is not None]
        return max(known) if len(known) == len(errors) else None

    def _sheet_error(
        self, charges: ChargeMemory, new: ChargeHistory, rule: Rule, corner: bool
    ) -> float | None:
        """The estimated error of charge that flows along electrodes.  Collective."""
        totals = tuple(level[..., TOTAL] for level in new.leaks)
        if rule is Rule.STAGE:
            stage = self._stages[charges.NAME].leaks[0][..., TOTAL]
            wrong: np.ndarray | None = stage_estimate(totals[0], totals[1], stage)
        else:
            wrong = estimate(new.times, totals, 1 if rule is Rule.EULER else 2, corner)
        return None if wrong is None else charges.sheet_error(wrong, totals[0])

    def _wrong(
        self, times: tuple[float, ...], values: tuple[np.ndarray, ...], name: str, what: str,
        rule: Rule, corner: bool,
    ) -> np.ndarray | None:  # fmt: skip
        """The estimated error of the newest of some values of a history."""
        if rule is Rule.STAGE:
            return stage_estimate(values[0], values[1], getattr(self._stages[name], what)[0])
        return estimate(times, values, rule.order, corner)

    @staticmethod
    def _remembering(state: State, histories: Histories) -> State:
        return replace(state, history={**state.history, **histories})
