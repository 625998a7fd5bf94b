"""Derivatives at a step of a march: the discrete ones, with the lengths of all steps held.

A step ends where R(x, H, p) = 0, with the history H that the steps before have left.  The direct
method goes over the recorded steps once and carries the changes of the state with each variable
along (Tortorelli and Michaleris, Inverse Problems in Engineering 1 (1994) 71):

    K dx = -(dR/dp + dR/dH dH),

with the tangent K of the step, flow included, and then the change of the history at its end.  The
first stage of SDIRK2 is not recorded and is solved for again.  An observable is differenced along
the change of the last state.

A load is derived by what the scene gives at factor 1 (a voltage in V), while all factors of the
path stay: the whole drive grows in proportion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.gradients.adjoint import Gradients
from dea_fenicsx.gradients.changes import Change, Recorded, changed, slopes, step_of
from dea_fenicsx.gradients.gradient import Gradient
from dea_fenicsx.gradients.motion_changes import MotionChanges, differenced, driven, started
from dea_fenicsx.gradients.past_checks import is_carried
from dea_fenicsx.gradients.replay import Replay
from dea_fenicsx.gradients.shapes import fixed_change
from dea_fenicsx.gradients.variables import (
    LoadVariable,
    Shape,
    Told,
    Variable,
    larger,
    variables,
)
from dea_fenicsx.gradients.viscous_changes import Strains, ViscousChanges, combined_change
from dea_fenicsx.model.motion import MOTION, Motion
from dea_fenicsx.model.state import State
from dea_fenicsx.model.viscous_history import STAGE_SHARE, Rule, ViscousHistory
from dea_fenicsx.path.step_lengths import MOST_GROWTH_OF_BDF3
from dea_fenicsx.path.time_stepping import TimeStepper
from dea_fenicsx.support.agreement import bind_alike
from dea_fenicsx.support.errors import SolverError

SAME = 1e-7
"""Difference of viscous strains that counts as none where the rule of a step is found out.

The strains of a wrong rule differ by the error of a step, and those of the right one by rounding
and by the tolerance of Newton's method.
"""

STAGE_TOLERANCE = 1e-12
"""Newton's tolerance where a first stage is solved for again."""

RECENT = 8
"""Number of earlier times whose changes are kept; rules of time look back by less."""


class ThroughTime:
    """Carries the changes of a state with some variables along the recorded steps of a run.

    Parameters
    ----------
    gradients
        What derives.
    found
        The variables.
    recorded
        Gives the recorded step of a row.

    Attributes
    ----------
    row
        The last row that it has come to; -1 at first.
    changes
        The change of the state there with each variable.
    residual
        Largest relative residual of a linear solve.
    """

    def __init__(
        self, gradients: Gradients, found: list[Variable], recorded: Callable[[int], Recorded]
    ) -> None:
        self.gradients, self.problem = gradients, gradients.problem
        self.found, self.recorded = found, recorded
        self.row, self.residual = -1, 0.0
        self.changes: list[Change] = []
        self.memory = self.problem.forms.memory
        self.viscous = ViscousChanges(self.problem) if self.memory else None
        self._levels: dict[float, list[Strains]] = {}
        self._states: dict[float, State] = {}
        self.moving = MotionChanges(self.problem)
        self._bases: list[tuple[Recorded, list[Change]]] = []

    def go_to(self, row: int) -> None:
        """Go over all steps up to a row.  Collective."""
        while self.row < row:
            recorded = self.recorded(self.row + 1)
            with self.problem.at(recorded.state):
                if MOTION in recorded.state.history:
                    self._move(recorded)
                elif self.viscous is None:
                    self.changes = [Change(v) for v in self._solved(recorded.state, None)]
                else:
                    self._flow(recorded)
            self._bases = [*self._bases, (recorded, self.changes)][-RECENT:]
            self.row += 1

    # ---------------------------------------------------------------------------- motion

    def _move(self, recorded: Recorded) -> None:
        """The changes after a step with inertia.  Collective."""
        state, problem = recorded.state, self.problem
        motion: Motion = state.history[MOTION]
        before, changes = self._bases[-1] if motion.length == 0 else self._base(recorded)
        if motion.length == 0:
            self._start(recorded, before, changes, jumps=True)
            return
        if before.began != recorded.began or MOTION not in before.state.history:
            begun = self._start(recorded, before, changes, jumps=False)
            before, changes = replace(before, state=begun), self.changes
            problem.show(state)
        ahead = self.moving.ahead(before.state, state, recorded.item)
        history, past = {**state.history, MOTION: ahead}, None
        if self.viscous is not None:
            told = state.history[self.memory.NAME]
            history[self.memory.NAME], past = self._step_of(recorded, told)
        item, seconds = recorded.item, motion.length
        pushed = []
        for change in changes:
            assert change.motion is not None
            pushed.append(self.moving.pushed(item, seconds, change.values, change.motion))
        values = self._solved(replace(state, history=history), past, pushed)
        motions = [
            self.moving.landed(item, ahead, seconds, (c.values, v), c.motion, p)
            for c, v, p in zip(changes, values, pushed, strict=True) if c.motion is not None
        ]  # fmt: skip
        strains: list[Any] = [None] * len(values)
        if self.viscous is not None and past is not None:
            strains = self._landed(history[self.memory.NAME], past, values)
            self._keep(told.times[0], state, strains)
        self.changes = list(map(Change, values, strains, motions))

    def _base(self, recorded: Recorded) -> tuple[Recorded, list[Change]]:
        """The recorded step from which a state in motion was found; the latest of its time."""
        state = recorded.state
        due = state.time - state.history[MOTION].length
        return min(reversed(self._bases), key=lambda base: abs(base[0].state.time - due))

    def _start(
        self, recorded: Recorded, before: Recorded, changes: list[Change], jumps: bool
    ) -> State:
        """The state in which a motion starts after another; its changes become the present ones.

        Collective.
        """
        solver, found = self.gradients.solver, []
        for one, change in zip(self.found, changes, strict=True):

            def begun(step: float, one: Variable = one, change: Change = change) -> State:
                state = changed(self.problem, before.state, change, one, step)
                item = driven(recorded.item, one, step)
                with larger(self.problem, one, step):
                    return started(solver, state, item, recorded.began, jumps)

            values, motion = differenced(begun, step_of(self.problem, before.state, change, one))
            found.append(replace(change, values=values, motion=motion))
        self.changes = found
        return started(solver, before.state, recorded.item, recorded.began, jumps)

    # ---------------------------------------------------------------------------- viscous flow

    def _flow(self, recorded: Recorded) -> None:
        """The changes after a step with viscous branches.  Collective."""
        state, name = recorded.state, self.memory.NAME
        told = state.history.get(name) or self.memory.at_rest()
        step, past = self._step_of(recorded, told)
        values = self._solved(replace(state, history={**state.history, name: step}), past)
        landed = self._landed(step, past, values)
        held = told.span != 0  # relaxed: what the state tells is the history before
        kept = past if held else landed
        self.changes = [Change(v, s) for v, s in zip(values, kept, strict=True)]
        self._keep(state.time if held else told.times[0], state, landed)

    def _keep(self, time: float, state: State, strains: list[Strains]) -> None:
        _put(self._levels, time, strains)
        _put(self._states, time, state)

    def _landed(
        self, step: ViscousHistory, past: list[Strains], values: list[np.ndarray]
    ) -> list[Strains]:
        """The changes of C_v at the end of a step, in the present state.  Collective."""
        assert self.viscous is not None
        each = zip(past, values, self.found, strict=True)
        return [self.viscous.landed(step, p, v, one) for p, v, one in each]

    # ---------------------------------------------------------------------------- one step

    def _step_of(
        self, recorded: Recorded, told: ViscousHistory
    ) -> tuple[ViscousHistory, list[Strains]]:
        """The history with which a state was found, and the changes of its H.  Collective."""
        assert self.viscous is not None
        none = [self.viscous.none() for _ in self.found]
        if told.times[0] in self._levels or len(told.times) == 1 or told.span:
            return told, self._levels.get(told.times[0], none)
        past = ViscousHistory(told.strains[1:], told.times[1:])
        if lost := [t for t in past.times[:3] if t not in self._levels]:
            raise SolverError(
                f"The step at {told.times[0]:.9g} s follows one at {lost[0]:.9g} s that is not "
                "recorded, so that its derivative cannot be found."
            )
        changes = [self._levels[t] for t in past.times if t in self._levels]
        seconds = told.times[0] - told.times[1]
        order = getattr(recorded.item, "order", 2)
        moves = MOTION in recorded.state.history
        if order > 1 and not moves and past.levels < Rule.BDF2.known:
            return self._second_stage(recorded, told, past)
        for rule in _rules(past, order, seconds, moves):
            step = past.ahead(seconds, rule)
            if self._differ(self.memory.strained(step), told.strains[0]) < SAME:
                return step, self._combined(step, changes)
        return self._second_stage(recorded, told, past)

    def _combined(self, step: ViscousHistory, changes: list[list[Strains]]) -> list[Strains]:
        """dH for each variable, from the changes at the earlier times, the newest first."""
        return [
            combined_change(step, tuple(level[k] for level in changes))
            for k in range(len(self.found))
        ]

    def _differ(self, one: Strains, other: Strains) -> float:
        """Largest difference of strains over all ranks.  Collective."""
        mine = float(np.max(np.abs(one - other), initial=0.0))
        return float(self.problem.comm.allreduce(mine, op=MPI.MAX))

    def _second_stage(
        self, recorded: Recorded, told: ViscousHistory, past: ViscousHistory
    ) -> tuple[ViscousHistory, list[Strains]]:
        """The same of a step of SDIRK2, whose first stage is solved for again.  Collective."""
        problem, name = self.problem, self.memory.NAME
        part = STAGE_SHARE * (told.times[0] - told.times[1])
        base = self._states[past.times[0]]
        problem.show(replace(base, history={**base.history, name: past}))
        solver = self.gradients.solver
        waves = getattr(recorded.item, "waves", {})
        stepper = TimeStepper(solver, waves, recorded.began, only=name)
        target = stepper.target(part, stepper.ahead(part, Rule.EULER))
        first = solver.solve(target, target.factors, tolerance=STAGE_TOLERANCE)
        if not first.converged:
            raise SolverError(
                f"The first stage of the step at {told.times[0]:.9g} s was not found again."
            )
        problem.show(first.found)
        inner = past.ahead(part, Rule.EULER)
        before = self._levels[past.times[0]]
        middle = self._landed(inner, before, self._solved(first.found, before))
        problem.show(first.found)
        step = replace(self.memory.staged(inner, first.found.time), span=part)
        problem.show(recorded.state)
        if self._differ(self.memory.strained(step), told.strains[0]) > SAME:
            raise SolverError(
                f"The step at {told.times[0]:.9g} s is of no rule that is known here, so that its "
                "derivative cannot be found."
            )
        return step, self._combined(step, [middle, before])

    def _solved(
        self, state: State, past: list[Strains] | None, pushed: list[np.ndarray] | None = None
    ) -> list[np.ndarray]:
        """The changes of all local values of a state with each variable.  Collective.

        `past` are the changes of its history H, and `pushed` those of its inertial forces.

        The problem is left in the state.
        """
        problem, gradients = self.problem, self.gradients
        problem.show(state)
        gradients.linearise()
        found = []
        for k, one in enumerate(self.found):
            rows = self._share(state, one) * gradients.forces(one)
            if past is not None:
                assert self.viscous is not None
                step = state.history.get(self.memory.NAME) or self.memory.at_rest()
                rows = rows + problem.restrict(self.viscous.forces(step, past[k], one))
            if pushed is not None:
                rows = rows + self.moving.forces(pushed[k])
            free, residual = gradients.solved(-rows)
            self.residual = max(self.residual, residual)
            found.append(self._values(state, free, one))
        return found

    def _share(self, state: State, one: Variable) -> float:
        """Change of a ramp's factor for a change of the load at factor 1, relative to that."""
        return state.factors[one.ramp] if isinstance(one, LoadVariable) else 1.0

    def _values(self, state: State, free: np.ndarray, one: Variable) -> np.ndarray:
        """The change of all local values, from that of the free unknowns.  Collective."""
        problem, along = self.problem, self.problem.w.copy()
        problem.spread(free, along)
        if isinstance(one, LoadVariable):
            lifted = self.gradients.lifted(one.ramp)
            along.x.array[: problem.owned] += self._share(state, one) / one.unit * lifted
            along.x.scatter_forward()
        elif isinstance(one, Shape):
            given = fixed_change(problem, one.velocity)
            along.x.array[:] += self.gradients.followed(given, everywhere=True)
        return np.asarray(along.x.array.copy())


def _put(kept: dict[float, Any], time: float, new: Any) -> None:
    """Keep what belongs to a time as the newest, and let go of the oldest."""
    kept.pop(time, None)
    kept[time] = new
    for old in list(kept)[:-RECENT]:
        del kept[old]


def _rules(past: ViscousHistory, order: int, seconds: float, moves: bool) -> list[Rule]:
    """The rules that a step may have had, the likeliest first; SDIRK2 is not among them."""
    if order == 1 or past.levels < 2:
        return [Rule.EULER]
    rules = [Rule.BDF2, Rule.EULER]
    if order == 3 and not moves and past.levels >= Rule.BDF3.known:
        before = past.times[0] - past.times[1]
        rules.insert(int(seconds > MOST_GROWTH_OF_BDF3 * before * (1 + SAME)), Rule.BDF3)
    return rules


def at_step(
    gradients: Gradients, name: str, observable: Any, to: Iterable[Told],
    row: int, recorded: Callable[[int], Recorded],
) -> Gradient:  # fmt: skip
    """The derivatives of an observable at a step with a past.  Collective.

    The changes of the state are kept, so that other observables at the same row or a later one need
    no step again.

    Raises
    ------
    InputError
        For an unknown variable, an observable without a derivative, and a scene whose marches are
        not derived.
    SolverError
        If a linear solve fails, or if earlier steps are not known.
    """
    problem = gradients.problem
    told = [to] if isinstance(to, Told) else list(to)
    carried, state = is_carried(problem, recorded(row)), recorded(row).state
    found = variables(problem, told, replayed=not carried)
    with problem.at(state):
        functional = gradients.functional_by(observable, found)
        measure = bind_alike(problem, name, observable)
        value = measure()
    anew = None if functional is None else partial(functional.value, problem, gradients.kept)
    if not carried:
        if row not in gradients.replays:
            gradients.replays[row] = Replay(problem, recorded, row)
        replay = gradients.replays[row]
        gone_over = {
            one.name: replay.slope(asked, one, measure, anew)
            for asked, one in zip(told, found, strict=True)
        }
        return Gradient(name, value, gone_over, "replay", replay.residual)
    key = tuple(told)
    walk = gradients.walks.get(key)
    if walk is None or walk.row > row:
        walk = gradients.walks[key] = ThroughTime(gradients, found, recorded)
    walk.go_to(row)
    with problem.at(state):
        pairs = list(zip(walk.found, walk.changes, strict=True))
        found_slopes = slopes(problem, state, pairs, measure, anew)
    return Gradient(name, value, found_slopes, "direct", walk.residual)
