"""Following a whole path, item by item."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.model.state import State
from dea_fenicsx.path.cursor import AcceptedStep, Cursor
from dea_fenicsx.path.events import Sentinel
from dea_fenicsx.path.items import (
    Close,
    Item,
    March,
    Ramp,
    Switch,
    Trace,
    fed,
)
from dea_fenicsx.path.load_orientation import turn_to_loads
from dea_fenicsx.path.marching import MarchWalk
from dea_fenicsx.path.moving import MotionWalk
from dea_fenicsx.path.path_checks import check_path
from dea_fenicsx.path.ramping import RampWalk
from dea_fenicsx.path.relaxing import come_to_rest, respond, settle
from dea_fenicsx.path.switching import move_switch
from dea_fenicsx.path.tracing import BranchLost, BranchTurned, Tracer
from dea_fenicsx.path.verdicts import trace_lost, trace_short, trace_turned
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.solvers.newton import NewtonSolver


@dataclass
class Walk:
    """Follows a path.

    Attributes
    ----------
    solver
        The nonlinear solver with its problem.
    path
        Ramps, traces and marches, one after another.
    sentinel
        Watches for events; without one, only limit points of traces are noticed.
    log
        Called with a line of text for every retry.
    gap
        How far the present state is from the value at which an item of the path ends; None if
        it ends at none.
    origin
        The equilibrium in which the path begins, at any load; None for the undeformed state.
    earlier
        What `earlier` of the last step was, if a run is resumed.
    """

    solver: NewtonSolver
    path: Sequence[Item]
    sentinel: Sentinel | None = None
    log: Callable[[str], None] = lambda line: None
    gap: Callable[[int], float | None] = lambda item: None
    origin: State | None = None
    earlier: Sequence[State] = ()

    def follow(self, resume: Cursor | None = None) -> Iterator[AcceptedStep]:
        """Yield each accepted step, that in which the path begins first.

        Parameters
        ----------
        resume
            Where to carry on; the problem must hold the state that belongs to it.

        Raises
        ------
        EquilibriumLost
            If no equilibrium is found beyond a load.  The problem then holds the last accepted
            state.
        SolverError
            If the linear solver fails however small the step.
        NotReached
            If a trace uses up its steps before its end.
        """
        problem = self.solver.problem
        scene = problem.scene
        sentinel = self.sentinel or Sentinel(self.solver)
        if resume is None:
            origin = self.origin or problem.under(
                problem.state, dict.fromkeys(scene.ramps, 0.0)
            )
            check_path(scene, self.path, origin.factors)
            cursor = Cursor(start=dict(origin.factors), began=origin.time)
            problem.commit(origin)
            yield AcceptedStep(cursor, self.path[0].label(scene), problem.state)
        else:
            check_path(scene, self.path, dict.fromkeys(scene.ramps))
            cursor = resume
        sentinel.start()
        while cursor.ramp < len(self.path):
            item = self.path[cursor.ramp]
            if isinstance(item, Switch):
                # A state within the item, as a resumed run has it, is beyond the switch.
                if cursor.position == 0:
                    move_switch(problem, item)
                    cursor = replace(cursor, start=dict(problem.factors))
                if isinstance(item, Close) and not fed(scene, item.where).ohms:
                    item = item.ramp(scene)
            if len(self.path) > 1:
                self.log(f"stage {cursor.ramp + 1} of {len(self.path)}: {item.words(scene)}")
            if not (isinstance(item, March) and item.moving):
                come_to_rest(self.solver)
            self._orient(item)
            if isinstance(item, Ramp | Trace):
                respond(self.solver, item, self.log)
            is_last = cursor.ramp == len(self.path) - 1
            for step in self._steps(item, cursor, is_last, sentinel):
                cursor = step.cursor
                yield step
            self.earlier = ()
            settle(problem)
            cursor = replace(
                cursor, ramp=cursor.ramp + 1, position=0.0, size=0.0,
                start=dict(problem.factors), direction=0.0, switched=False, passed=0,
                began=problem.state.time, memory=None,
            )  # fmt: skip

    def _steps(
        self, item: Item, cursor: Cursor, is_last: bool, sentinel: Sentinel
    ) -> Iterator[AcceptedStep]:
        """The steps of one item of the path; a switch that is moved takes none."""
        if isinstance(item, Switch):
            return iter(())
        if isinstance(item, Trace):
            return self._trace(item, cursor, is_last, sentinel)
        if isinstance(item, March) and item.moving:
            return MotionWalk(self.solver, item, cursor, is_last, sentinel, self.log).follow()
        if isinstance(item, March):
            march = MarchWalk(self.solver, item, cursor, is_last, sentinel, self.log)
            return march.follow()
        ramp = RampWalk(self.solver, item, cursor, is_last, sentinel, self.log, self.earlier)
        return ramp.follow()

    def _orient(self, item: Item) -> None:
        """Turn a free body to where the loads that begin to act have no moment."""
        problem = self.solver.problem
        problem.commit(problem.anchored(problem.state))
        state, angle = turn_to_loads(problem, _rates(item, problem.scene, problem.factors))
        if angle:
            problem.commit(state)
            self.log(
                f"{item.label(problem.scene)}: the loads turn the free body by "
                f"{math.degrees(angle):.3g} degrees, to where they have no moment"
            )

    def _trace(
        self, item: Trace, cursor: Cursor, is_last: bool, sentinel: Sentinel
    ) -> Iterator[AcceptedStep]:
        """Follow one trace from a cursor to its end or until its steps are used up."""
        problem, number = self.solver.problem, cursor.ramp
        done = round(cursor.position * item.steps)
        if done >= item.steps:
            return  # resumed after its last step
        sign = cursor.direction or float(np.sign(item.first))
        tracer = Tracer(self.solver, item, sentinel, lambda: self.gap(number), self.log)
        arc = min(cursor.size or 1.0, item.longest)
        first = item.exits[0] if item.exits else 0
        passed = max(cursor.passed, first * cursor.switched)
        points = tracer.follow(arc, sign, passed, tuple(self.earlier), cursor.memory)
        while True:
            try:
                found = next(points, None)
            except BranchLost as lost:
                raise trace_lost(item.what, problem.factors, lost.outcome) from None
            except BranchTurned as turned:
                now = problem.factors
                raise trace_turned(item.what, now, turned.factor, turned.tried) from None
            if found is None:
                return
            problem.commit(found.state)
            done = item.steps if found.last else done + 1
            passed = cursor.passed + (found.event == "bifurcation")
            switched = cursor.switched or (bool(item.switch) and passed >= first)
            cursor = replace(
                cursor, step=cursor.step + 1, position=done / item.steps, size=found.arc,
                start=dict(cursor.start), direction=found.direction, switched=switched,
                passed=passed, memory=found.memory,
            )  # fmt: skip
            last = done >= item.steps and is_last
            yield AcceptedStep(
                cursor, item.what, found.state, found.retries, last, found.event, found.mode,
                held=found.held, earlier=found.earlier,
            )  # fmt: skip
            if done >= item.steps:
                left = None if found.last else self.gap(number)
                if left is not None and item.until is not None:
                    raise trace_short(item.what, *item.until, left, item.steps)
                return


def _rates(item: Item, scene: Scene, factors: Mapping[str, float]) -> dict[str, float]:
    """Change of the factor of each ramp over an item of a path, or over its first step."""
    if isinstance(item, Switch):
        return {}
    if isinstance(item, Trace):
        return {item.what: item.first}
    if isinstance(item, March):
        return {name: wave(item.seconds) - factors[name] for name, wave in item.waves.items()}
    return {name: item.to - factors[name] for name in item.names(scene)}
