"""A branch traced step by step: limit points, requested loads, bifurcations and other branches."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dea_fenicsx.path.arclength import SHORTEST, Branch, Point
from dea_fenicsx.path.events import Sentinel
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.solvers.newton import Attempt, NewtonSolver
from dea_fenicsx.support.errors import SolverError
from dea_fenicsx.support.type_checks import plain_numbers

CLOSE = 1e-7
"""How close a trace comes to the value at which it ends, of the change over the last step."""


@dataclass(frozen=True)
@plain_numbers
class Trace:
    """Follow the branch by arc length in one ramp of the scene, through limit points.

    Parameters
    ----------
    what
        Name of the ramp, such as ``"voltage"``.
    first
        Load factor of the first step; negative to start backwards.
    steps
        Most steps that are taken, events included.
    until
        A column of the history and a value: the trace ends where the column takes the value.
    longest
        Longest step in units of arc, of 5 % stretch each.
    at
        Load factors to land on exactly, each time that the branch passes one.
    switch
        Length of a step, in units of arc, along the null vector of the first bifurcation: the
        trace goes on along the branch that lies there, and the sign chooses the side.  0 stays on
        the branch.  Needs ``stability="every"``.
    """

    what: str
    first: float = 0.05
    steps: int = 200
    until: tuple[str, float] | None = None
    longest: float = 4.0
    at: tuple[float, ...] = ()
    switch: float = 0.0

    def names(self, scene: Scene) -> tuple[str, ...]:
        return (self.what,)

    def label(self, scene: Scene) -> str:
        return self.what


@dataclass(frozen=True)
class Traced:
    """An accepted point of a trace: what `stepping` makes a step of."""

    factor: float
    arc: float
    direction: float
    attempt: Attempt
    retries: int
    event: str = ""
    mode: np.ndarray | None = None
    last: bool = False


def trace(
    solver: NewtonSolver,
    item: Trace,
    arc: float,
    sign: float,
    log: Callable[[str], None],
    sentinel: Sentinel,
    gap: Callable[[], float | None],
    may_switch: bool = True,
) -> Iterator[Traced | str]:
    """Follow a branch from the problem's state; yields accepted points, then a reason if lost.

    Parameters
    ----------
    solver, item
        The solver, in equilibrium, and what to follow.
    arc, sign
        Length of the first step, and the sign of the load's change along it.
    log
        Called with a line for every retry and every event.
    sentinel
        Watches for bifurcations and alarms.
    gap
        How far the problem's present state is from the end, of either sign; None for no end.
    may_switch
        False once the trace has left its first branch.
    """
    problem = solver.problem
    branch = Branch(solver, {item.what: 1.0}, item.first, problem.factors[item.what])
    here = branch.point(None, sign)
    if here is None:
        yield solver.trouble
        return
    before: Point | None = None
    retries, left = 0, gap()
    while True:
        attempt, there, reason = branch.advance(here, arc, before)
        count = None
        turns = there is not None and here.slope * there.slope < 0
        if not reason:
            count = sentinel.count()
            if turns and arc > 0.1 and _mixed(sentinel.excess, count):
                reason = "a limit point and a bifurcation in one step"
        if reason or there is None:
            retries += 1
            arc /= 2
            branch.restore(here)
            log(f"{item.what}: arc halved ({reason})")
            if arc < SHORTEST:
                yield reason
                return
            continue
        if not sentinel.stability and _unexplained(sentinel.excess, count, turns):
            log(f"{item.what}: the number of negative eigenvalues changes from {sentinel.excess} "
                f"to {count} within this step, and no limit point explains it")  # fmt: skip
        spots = list(_spots(branch, item, here, there, arc, turns, sentinel))
        branch.restore(there)
        if end := _end(branch, here, there, arc, left, gap, log):
            spots.append(end)
            branch.restore(there)
        events = sentinel.passed(branch.place(here, there, arc), branch.rates, count, int(turns))
        for event in events:
            slope = np.sign(there.factor - here.factor)
            factor = event.factors[item.what]
            spots.append((event.share * arc, event.state,
                          Traced(factor, arc, slope, event.attempt, 0, event.name, event.mode)))
        for _, state, traced in sorted(spots, key=lambda spot: spot[0]):
            branch.set_factor(traced.factor)
            problem.set_state(state)
            if traced.event:
                log(f"{item.what}: {traced.event} at factor {traced.factor:.8g}")
            yield replace(traced, retries=retries)
            if traced.last:
                return
            retries = 0
            if traced.event == "bifurcation" and item.switch and may_switch:
                may_switch = False
                assert traced.mode is not None
                before = None
                here = branch.aside(state, traced.factor, np.sign(item.switch) * traced.mode)
                arc = abs(item.switch)
                left = gap()
                break
        else:
            branch.restore(there)
            was, left = left, gap()
            grown = 1.5 if attempt.iterations <= 3 else 1.0 if attempt.iterations <= 6 else 0.7
            arc = min(arc * grown, item.longest, _just_beyond(arc, was, left))
            before, here = here, there
            yield Traced(there.factor, arc, np.sign(there.slope), attempt, retries)
            retries = 0
            continue
        sentinel.excess = None  # the new branch's own count is taken at its first state


def _unexplained(before: int | None, after: int | None, turns: bool) -> bool:
    """Whether the count of negative eigenvalues changes by something else than a limit point."""
    return before is not None and after is not None and abs(after - before) != int(turns)


def _mixed(before: int | None, after: int | None) -> bool:
    """Whether more than the one limit point of a step changed the inertia."""
    return before is not None and after is not None and abs(after - before) != 1


def _spots(
    branch: Branch,
    item: Trace,
    here: Point,
    there: Point,
    arc: float,
    turns: bool,
    sentinel: Sentinel,
) -> Iterator[tuple[float, np.ndarray, Traced]]:
    """Limit point and requested loads between two points: arc, state and what to report."""
    pieces = [(0.0, here), (arc, there)]
    sign = np.sign(there.slope)
    if turns and (found := branch.limit_point(here, there, arc)) is not None:
        limit, s = found
        branch.restore(limit)
        kind = "maximum" if here.slope > 0 else "minimum"
        attempt = Attempt("", 0, branch.solver.residual_of(branch.problem.residual()),
                          branch.problem.probe())  # fmt: skip
        pieces.insert(1, (s, limit))
        mode = sentinel.mode_of(limit.direction) if sentinel.stability else None
        yield s, limit.state, Traced(limit.factor, arc, sign, attempt, 0, kind, mode)
    for (low, start), (high, end) in pairwise(pieces):
        for wanted in item.at:
            if (start.factor - wanted) * (end.factor - wanted) < 0:
                attempt = branch.land(start, end, wanted)
                if attempt.converged:
                    share = (wanted - start.factor) / (end.factor - start.factor)
                    yield (low + share * (high - low), branch.problem.get_state(),
                           Traced(wanted, arc, sign, attempt, 0, "landed"))  # fmt: skip


def _just_beyond(arc: float, was: float | None, left: float | None) -> float:
    """An arc a little longer than to the end of the trace, by what the last arc has closed."""
    if was is None or left is None or left * (was - left) <= 0:
        return np.inf
    return arc * max(1.1 * left / (was - left), 0.05)


def _end(
    branch: Branch,
    here: Point,
    there: Point,
    arc: float,
    left: float | None,
    gap: Callable[[], float | None],
    log: Callable[[str], None],
) -> tuple[float, np.ndarray, Traced] | None:
    """Where the trace ends, if that is in this step: arc, state and what to report.

    `left` is the gap at the step's start; the problem is at its end.
    """
    beyond = gap()
    if left is None or beyond is None or left == 0 or left * beyond > 0:
        return None
    whole = Attempt("", 0, branch.solver.residual_of(branch.problem.residual()),
                    branch.problem.probe())  # fmt: skip
    s, attempt = arc, whole
    low, high, close = (0.0, left), (arc, beyond), CLOSE * max(abs(left), abs(beyond))
    for _ in range(20):
        if abs(high[1]) <= close:
            break
        s = (low[0] * high[1] - high[0] * low[1]) / (high[1] - low[1])
        attempt = branch.step(here, s, there)
        now = gap() if attempt.converged else None
        if now is None:  # the step's own end is an equilibrium, a little behind the value
            log("no equilibrium was found at the very end of the trace; it ends behind")
            branch.restore(there)
            s, attempt = arc, whole
            break
        # Illinois rule, as for a limit point
        low = high if now * high[1] < 0 else (low[0], low[1] / 2)
        high = (s, now)
    sign = np.sign(there.slope)
    return s, branch.problem.get_state(), Traced(branch.factor, arc, sign, attempt, 0, last=True)


def over_the_limit(
    solver: NewtonSolver,
    rates: dict[str, float],
    factor: float,
    first: float,
    log: Callable[[str], None],
    steps: int = 400,
) -> tuple[Point, Attempt | None]:
    """Where a load that can only grow takes the device that it carries over a limit point.

    The branch is followed by arc length over the limit point, on which nothing rests, to the next
    state that bears the same load and is stable: the landing of a snap with enough damping.

    Parameters
    ----------
    solver
        The solver, in equilibrium before the limit point.
    rates, factor, first
        As in `Branch`; the load f grows.
    steps
        Most steps that are taken.

    Returns
    -------
    Point, Attempt or None
        The limit point, and the landing, in which the problem then is; None if there is none.

    Raises
    ------
    SolverError
        If no limit point is found.
    """
    branch = Branch(solver, rates, first, factor)
    here, arc = branch.point(None, 1.0), 1.0
    before: Point | None = None
    limit: Point | None = None
    for _ in range(steps):
        if here is None:
            break
        attempt, there, reason = branch.advance(here, arc, before)
        if there is None or reason:
            arc /= 2
            branch.restore(here)
            if arc < SHORTEST:
                log(f"the branch could be followed to {here.factor:.8g} only ({reason})")
                break
            continue
        if limit is None and there.slope < 0 and (
            found := branch.limit_point(here, there, arc)
        ):  # fmt: skip
            limit = found[0]
            log(f"limit point at {limit.factor:.8g} of the ramp; its far side is searched")
            branch.restore(there)
        if limit is not None and there.slope > 0 and there.factor > limit.factor:
            landing = branch.land(here, there, limit.factor)
            solver.refresh_inertia()
            if landing.converged and solver.inertia.excess == 0:
                return limit, landing
            branch.restore(there)
        # forces grow by orders of magnitude towards lock-up, and rounding with them
        solver.references.remember(solver.problem.residual())
        arc = min(arc * (1.5 if attempt.iterations <= 3 else 1.0), 4.0)
        before, here = here, there
    if limit is None:
        raise SolverError("no limit point was found")
    return limit, None
