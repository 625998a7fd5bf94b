"""The path: ramps followed in adaptive steps, with exact landings, retries and a clear end."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from dea_fenicsx.path.events import Sentinel
from dea_fenicsx.path.evidence import Evidence
from dea_fenicsx.path.load_orientation import turn_to_loads
from dea_fenicsx.path.predictor import Known, Predictor
from dea_fenicsx.path.tracing import Trace, over_the_limit, trace
from dea_fenicsx.path.verdicts import (
    UNCERTAIN,
    describe,
    is_near_limit,
    ramp_lost,
    trace_lost,
    trace_short,
)  # fmt: skip
from dea_fenicsx.scene.scene import Scene, finite, known
from dea_fenicsx.solvers.newton import REASONS, Attempt, NewtonSolver
from dea_fenicsx.support.errors import EquilibriumLost, InputError, SolverError
from dea_fenicsx.support.type_checks import check_declared, plain_numbers, shown


@dataclass(frozen=True)
@plain_numbers
class Ramp:
    """Bring one or more ramps of the scene to a factor, in steps.

    Parameters
    ----------
    what
        Name or names of the ramps (``"voltage"``, ``"stretch"``, ``"load"`` or your own); empty
        for all of the scene.  Ramps that are not named keep their present factor.
    to
        Factor at the end; 1 is the value written in the scene.
    steps
        Number of equal steps; each of their ends is landed on exactly.
    at
        Factors to land on instead, in the order of travel; between them steps grow and shrink
        freely, starting from a `steps`-th of the ramp.
    snap
        What happens at a limit point.  False: the ramp ends there with `EquilibriumLost`.  True:
        the load stays, as that of a battery does, and the device snaps to the next stable state
        along the branch that bears it; from there the ramp goes on.
    """

    what: str | tuple[str, ...] = ()
    to: float = 1.0
    steps: int = 10
    at: tuple[float, ...] | None = None
    snap: bool = False

    def names(self, scene: Scene) -> tuple[str, ...]:
        """Names of the scene's ramps that this one moves."""
        if not self.what:
            return scene.ramps
        return (self.what,) if isinstance(self.what, str) else tuple(self.what)

    def label(self, scene: Scene) -> str:
        return "+".join(self.names(scene))


@dataclass(frozen=True)
class Cursor:
    """Where on the path a run stands; enough, with the state, to carry on.

    Attributes
    ----------
    step : number of the accepted step
    ramp : number of the ramp in the path
    position : travelled share of that ramp, 0 to 1
    size : size of the next step, as a share of the ramp
    factors : factor of each of the scene's ramps
    start : factors at the start of the current ramp
    direction : in a trace, sign of the load's change
    switched : whether a trace has left its first branch
    """

    step: int = 0
    ramp: int = 0
    position: float = 0.0
    size: float = 0.0
    factors: dict[str, float] = field(default_factory=dict)
    start: dict[str, float] = field(default_factory=dict)
    direction: float = 0.0
    switched: bool = False


@dataclass(frozen=True)
class Step:
    """An accepted step; the problem holds its state while it is yielded.

    `event` is empty for the path's own steps.  A step with an event lies between two of them, and a
    run is not resumed from it: ``"maximum"`` or ``"minimum"`` where the load is stationary,
    ``"snap"`` where a device has landed behind a limit point, ``"bifurcation"``, ``"landed"`` on a
    requested load of a trace, or an alarm's name.  `mode` is the null vector of a critical point.
    """

    cursor: Cursor
    label: str
    attempt: Attempt
    retries: int
    last: bool
    event: str = ""
    mode: np.ndarray | None = None


SMALLEST = 2.0**-10
"""Smallest step in units of the first one, before equilibrium counts as lost."""

SMALLEST_JUMP = 2.0**-16
"""The same where Newton's method finds states, but on another branch, or no limit point is seen.

The path turns sharply there, the more so the smaller an imperfection is: with two loads that differ
by 1e-5 the sheet of Treloar and Kearsley needs steps of 1e-4.
"""

MOST_STEPS = 1_000_000

EASY = 5
"""Newton iterations up to which a step counts as easy and the next one may grow."""


def check_path(scene: Scene, path: Sequence[Ramp | Trace]) -> None:
    """Raise InputError if the path does not fit the scene."""
    for item in path:
        if not isinstance(item, Ramp | Trace):
            raise InputError(f"The path holds {shown(item)}, but needs Ramp(...) or Trace(...).")
        check_declared(item)
    if not path:
        raise InputError("The path is empty; give at least one Ramp(...).")
    if not scene.ramps:
        raise InputError(
            "Nothing in the scene can be ramped; give an Electrode a voltage, or add a Stretch or "
            "a load."
        )
    reached: dict[str, float | None] = dict.fromkeys(scene.ramps, 0.0)
    for item in path:
        for name in item.names(scene):
            known(name, scene.ramps, "ramp in the scene")
        if isinstance(item, Trace):
            _check_trace(item)
            reached[item.what] = None  # where a trace ends is not known before
        else:
            _check_ramp(item, scene, reached)
            reached |= dict.fromkeys(item.names(scene), float(item.to))


def _check_trace(trace: Trace) -> None:
    finite(trace.first, f"The first step of the trace in {trace.what}")
    for value in (*trace.at, *(trace.until[1:] if trace.until else ())):
        finite(value, f"A value at which the trace in {trace.what} is to land or end")
    if not 0 < abs(trace.first) <= 1e6 or trace.steps < 1 or not trace.longest > 0:
        raise InputError(
            f"The trace in {trace.what} needs a first step other than 0 (at most a million "
            "times the load), at least one step and a longest step > 0."
        )


def _check_ramp(ramp: Ramp, scene: Scene, reached: dict[str, float | None]) -> None:
    """Check a ramp; `reached` holds the factors where it starts, None where they are not known."""
    label = ramp.label(scene)
    if not 1 <= ramp.steps <= MOST_STEPS:
        raise InputError(
            f"The ramp of {label} has {ramp.steps} steps, but needs a whole number from 1 to "
            f"{MOST_STEPS}."
        )
    landings = () if ramp.at is None else ramp.at
    for value in (ramp.to, *landings):
        finite(value, f"A target of the ramp of {label}")
    start = reached[ramp.names(scene)[0]]
    for value in landings:
        if start is not None and not min(start, ramp.to) <= value <= max(start, ramp.to):
            raise InputError(
                f"The ramp of {label} is to land on {value:g}, but it goes from {start:g} to "
                f"{ramp.to:g}; name values between the two in at=, or change to=."
            )


def follow(
    solver: NewtonSolver,
    path: Sequence[Ramp | Trace],
    resume: Cursor | None = None,
    log: Callable[[str], None] = lambda line: None,
    gap: Callable[[int], float | None] = lambda item: None,
    sentinel: Sentinel | None = None,
) -> Iterator[Step]:
    """Follow a path and yield each accepted step, the undeformed state first.

    Parameters
    ----------
    solver
        The nonlinear solver with its problem.
    path
        Ramps, one after another.
    resume
        Where to carry on; the problem must hold the state that belongs to it.
    log
        Called with a line of text for every retry.
    gap
        How far the present state is from the value at which an item of the path ends; None if
        it ends at none.
    sentinel
        Watches for events; without one, only limit points of traces are noticed.

    Raises
    ------
    EquilibriumLost
        If no equilibrium is found beyond a load.  The problem then holds the last accepted state.
    SolverError
        If the linear solver fails however small the step.
    """
    problem = solver.problem
    scene = problem.scene
    check_path(scene, path)
    sentinel = sentinel or Sentinel(solver)
    if resume is None:
        zero = dict.fromkeys(scene.ramps, 0.0)
        cursor = Cursor(factors=zero, start=zero)
        problem.set_factors(zero)
        yield Step(cursor, path[0].label(scene), Attempt("", 0, 0.0, problem.probe()), 0, False)
    else:
        cursor = resume
        problem.set_factors(cursor.factors)
    sentinel.start()
    while cursor.ramp < len(path):
        item = path[cursor.ramp]
        problem.keep_orientation()
        angle = turn_to_loads(problem, _rates(item, scene, cursor.factors))
        if angle:
            log(f"{item.label(scene)}: the loads turn the free body by {math.degrees(angle):.3g} "
                "degrees, to where they have no moment")  # fmt: skip
        steps = (
            _follow_trace(solver, path, item, cursor, log, gap, sentinel)
            if isinstance(item, Trace)
            else _follow_ramp(solver, path, item, cursor, log, sentinel)
        )
        for step in steps:
            cursor = step.cursor
            yield step
        cursor = replace(
            cursor, ramp=cursor.ramp + 1, position=0.0, size=0.0, start=dict(cursor.factors),
            direction=0.0, switched=False,
        )  # fmt: skip


def _rates(item: Ramp | Trace, scene: Scene, factors: dict[str, float]) -> dict[str, float]:
    """By how much an item of a path changes the factor of each of its ramps, at first."""
    if isinstance(item, Trace):
        return {item.what: item.first}
    return {name: item.to - factors[name] for name in item.names(scene)}


def _follow_trace(
    solver: NewtonSolver,
    path: Sequence[Ramp | Trace],
    item: Trace,
    cursor: Cursor,
    log: Callable[[str], None],
    gap: Callable[[int], float | None],
    sentinel: Sentinel,
) -> Iterator[Step]:
    """Follow one trace from a cursor to its end or until its steps are used up."""
    scene = solver.problem.scene
    done = round(cursor.position * item.steps)
    if done >= item.steps:
        return  # resumed after its last step
    sign = cursor.direction or float(np.sign(item.first))
    factors = dict(cursor.factors)
    arc = cursor.size or 1.0
    for found in trace(solver, item, arc, sign, log, sentinel, partial(gap, cursor.ramp),
                       not cursor.switched):  # fmt: skip
        if isinstance(found, str):
            raise trace_lost(scene, item.what, factors, found)
        done = item.steps if found.last else done + 1
        factors = cursor.factors | {item.what: found.factor}
        switched = cursor.switched or (bool(item.switch) and found.event == "bifurcation")
        cursor = Cursor(
            cursor.step + 1, cursor.ramp, done / item.steps, found.arc, factors,
            dict(cursor.start), found.direction, switched,
        )  # fmt: skip
        last = done >= item.steps and cursor.ramp == len(path) - 1
        yield Step(
            cursor, item.what, found.attempt, found.retries, last, found.event, found.mode
        )
        if done >= item.steps:
            left = None if found.last else gap(cursor.ramp)
            if left is not None and item.until is not None:
                raise trace_short(item.what, *item.until, left, item.steps)
            return


def _follow_ramp(
    solver: NewtonSolver,
    path: Sequence[Ramp | Trace],
    ramp: Ramp,
    cursor: Cursor,
    log: Callable[[str], None],
    sentinel: Sentinel,
) -> Iterator[Step]:
    """Follow one ramp from a cursor to its end."""
    problem = solver.problem
    scene = problem.scene
    names, label = ramp.names(scene), ramp.label(scene)
    landings = _landings(ramp, cursor.start[names[0]])
    first = 1.0 / ramp.steps
    size = cursor.size or first
    start = cursor.start

    def factors_at(position: float) -> dict[str, float]:
        return _factors_at(ramp, names, cursor, position)

    lead = max(names, key=lambda name: abs(ramp.to - start[name]))
    predictor = Predictor(solver, names, lead)
    predictor.add(cursor.factors)
    evidence = Evidence(solver, predictor, sentinel)
    origin = predictor.known[-1]
    retries = 0
    while cursor.position < 1.0:
        position = cursor.position
        landing = min(s for s in landings if s > position)
        # no crumb is left before a landing
        target = landing if landing - position < 1.25 * size else position + size
        attempt = predictor.solve(factors_at(target), evidence.judge)
        if attempt.converged:
            rates = {n: (target - position) * (ramp.to - start[n]) for n in names}
            accepted = problem.get_state()
            place = predictor.between(predictor.known[-1], Known(factors_at(target), accepted))
            _tell_change(label, sentinel.excess, evidence.count, log)
            for event in sentinel.passed(place, rates, evidence.count):
                problem.set_factors(event.factors)
                problem.set_state(event.state)
                at = position + event.share * (target - position)
                cursor = replace(
                    cursor, step=cursor.step + 1, position=at, factors=dict(event.factors)
                )
                log(f"{label}: {event.name} at {describe(scene, event.factors, names)}")
                yield Step(cursor, label, event.attempt, 0, False, event.name, event.mode)
            problem.set_factors(factors_at(target))
            problem.set_state(accepted)
            predictor.add(factors_at(target))
            grown = 1.5 if attempt.iterations <= EASY else 1.0
            full = target == landing and target - position < size
            size = min(size * (1.0 if full else grown), 1.0)
            if not full and ramp.at is None:
                size = min(size, first)
            cursor = Cursor(
                cursor.step + 1, cursor.ramp, target, size, factors_at(target), dict(start)
            )
            last = target == 1.0 and cursor.ramp == len(path) - 1
            yield Step(cursor, label, attempt, retries, last)
            retries = 0
            continue
        problem.set_factors(cursor.factors)
        predictor.restore()
        retries += 1
        size = (target - position) / 2
        log(
            f"{label}: no equilibrium at {describe(scene, factors_at(target), names)} "
            f"({REASONS[attempt.reason]}, {attempt.iterations} Newton iterations); step halved"
        )
        if size >= first * (SMALLEST_JUMP if attempt.reason == "jumped" else SMALLEST):
            continue
        near_limit = is_near_limit(predictor, origin, factors_at(target))
        if not near_limit and attempt.reason in UNCERTAIN and size >= first * SMALLEST_JUMP:
            continue
        lost = ramp_lost(
            scene, names, label, cursor.factors, factors_at(target), attempt, near_limit
        )
        if not ramp.snap or not isinstance(lost, EquilibriumLost):
            raise lost
        for step in _snap(solver, ramp, lead, cursor, log, lost):
            cursor = step.cursor
            yield replace(step, retries=retries)
            retries = 0
        sentinel.start()
        size = first
        predictor = Predictor(solver, names, lead)
        predictor.add(cursor.factors)
        evidence = Evidence(solver, predictor, sentinel)


def _tell_change(
    label: str, before: int | None, after: int | None, log: Callable[[str], None]
) -> None:
    """Say so if the number of negative eigenvalues has changed within an accepted step."""
    if before is not None and after is not None and before != after:
        log(f"{label}: the number of negative eigenvalues changes from {before} to {after} here")


def _factors_at(
    ramp: Ramp, names: Sequence[str], cursor: Cursor, position: float
) -> dict[str, float]:
    """Factors at a position of a ramp, weighted so that its end is hit to the last bit."""
    moved = {n: (1 - position) * cursor.start[n] + position * ramp.to for n in names}
    return cursor.factors | moved


def _snap(
    solver: NewtonSolver,
    ramp: Ramp,
    lead: str,
    cursor: Cursor,
    log: Callable[[str], None],
    lost: EquilibriumLost,
) -> Iterator[Step]:
    """The limit point that a ramp has come to, and the state to which the device snaps from it."""
    problem = solver.problem
    scene = problem.scene
    names, label = ramp.names(scene), ramp.label(scene)
    rates = {n: ramp.to - cursor.start[n] for n in names}
    try:
        limit, landing = over_the_limit(solver, rates, cursor.position, 1 / ramp.steps, log)
    except SolverError:
        raise lost from None
    landed = problem.get_state()
    factors = _factors_at(ramp, names, cursor, limit.factor)
    cursor = replace(
        cursor, step=cursor.step + 1, position=limit.factor, factors=factors, size=0.0
    )
    problem.set_factors(factors)
    problem.set_state(limit.state)
    # of the load's size: a voltage has its maximum at either polarity
    outwards = factors[lead] * (ramp.to - cursor.start[lead]) > 0
    kind = "maximum" if outwards else "minimum"
    at = Attempt("", 0, solver.residual_of(problem.residual()), problem.probe())
    yield Step(cursor, label, at, 0, False, kind)
    if landing is None:
        log(f"{label}: no stable state was found behind the limit point at this load")
        raise lost
    problem.set_factors(factors)
    problem.set_state(landed)
    log(f"{label}: snapped at {describe(scene, factors, names)}")
    cursor = replace(cursor, step=cursor.step + 1)
    yield Step(cursor, label, landing, 0, False, "snap")
    solver.forget_factor()


def _landings(ramp: Ramp, start: float) -> list[float]:
    """Positions in (0, 1] to land on."""
    if ramp.at is None:
        return [(k + 1) / ramp.steps for k in range(ramp.steps)]
    span = ramp.to - start
    inside = [(value - start) / span for value in ramp.at] if span else []
    return sorted({s for s in inside if 0 < s < 1} | {1.0})
