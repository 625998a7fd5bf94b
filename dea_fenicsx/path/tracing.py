"""A branch traced step by step: limit points, requested loads, bifurcations and other branches."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from dea_fenicsx.model.state import State
from dea_fenicsx.path.arclength import SHORTEST_ARC, Point, TracedBranch
from dea_fenicsx.path.crossing import SOFT_SHAPES, Crossings, Passage
from dea_fenicsx.path.events import MOST_CHANGES_LOCATED, Passed, Sentinel
from dea_fenicsx.path.guiding import Guide
from dea_fenicsx.path.items import Trace
from dea_fenicsx.path.leaving import Exits
from dea_fenicsx.path.load_course import LoadCourse
from dea_fenicsx.path.recalling import kept, recall
from dea_fenicsx.path.roots import Bracket
from dea_fenicsx.path.soft_watch import SoftWatch
from dea_fenicsx.path.step_lengths import growth, just_beyond
from dea_fenicsx.path.trace_memory import TraceMemory
from dea_fenicsx.path.traced import Reached, Spot, Traced
from dea_fenicsx.path.turning import TURN_ASIDE, Turns
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.outcome import Outcome

TRACE_END_TOLERANCE = 1e-7
"""Largest distance from the value at which a trace ends, as a share of the gap of the last step."""

MOST_SETTLING = 0.01
"""Largest motion when guiding forces are taken away from an event, as a share of its step."""

MAYBE_ASIDE = (
    "the motion turns aside, and no way leads straight on; the branch may turn into another one "
    'that almost crosses it, and at_turn="follow" looks for such turns'
)
"""What the log says where an unstable branch turns and is followed by default."""

SHORTEST_ARC_TO_SEPARATE_EVENTS = 0.1
"""Largest arc for which several events in one step are accepted as they are.

A longer step with a limit point and a bifurcation, or with two bifurcations, is halved, so that
each of them gets a step of its own.  A long step also may have jumped over them to another branch.
"""


class BranchLost(Exception):
    """A branch cannot be followed any further, however short the arc."""

    def __init__(self, outcome: Outcome) -> None:
        super().__init__(outcome.value)
        self.outcome = outcome


class BranchTurned(Exception):
    """A branch turns aside, and is not to be followed.

    Attributes
    ----------
    factor
        The load factor at which the turn begins.
    tried
        Whether no way straight on was found.
    """

    def __init__(self, factor: float, tried: bool) -> None:
        super().__init__(f"{factor:.6g}")
        self.factor, self.tried = factor, tried


class Tracer:
    """Follows a branch from the problem's present state.

    Parameters
    ----------
    solver
        The nonlinear solver, in equilibrium.
    item
        What to follow.
    sentinel
        Watches for bifurcations and alarms.
    gap
        How far the problem's present state is from the end, of either sign; None for no end.
    log
        Called with a line for every retry and every event.
    """

    def __init__(
        self,
        solver: NewtonSolver,
        item: Trace,
        sentinel: Sentinel,
        gap: Callable[[], float | None],
        log: Callable[[str], None],
    ) -> None:
        self.solver, self.problem, self.item = solver, solver.problem, item
        self.sentinel, self.gap, self.log = sentinel, gap, log
        self.rates, now = {item.what: 1.0}, self.problem.factors[item.what]
        self.branch = TracedBranch(solver, LoadCourse(solver, self.rates, now), item.first)
        self.branch.precise = sentinel.stability
        watch = SoftWatch(self.branch)
        self.crossings = Crossings(self.branch, item.longest, watch)
        self.turns = Turns(self.branch, self.crossings, item.at_turn)
        self._cut = 1.0
        self._over: Passage | None = None

    def follow(
        self, arc: float, sign: float, passed: int = 0, earlier: tuple[State, ...] = (),
        memory: TraceMemory | None = None,
    ) -> Iterator[Traced]:  # fmt: skip
        """Yield the accepted points, one after another.

        Parameters
        ----------
        arc, sign
            Length of the first step, and the sign of the load's change along it.
        passed
            Number of bifurcations that it has met before.
        earlier, memory
            In a resumed run, those of its last step, see `Traced`.

        Raises
        ------
        BranchLost
            If no step can be made any more.
        BranchTurned
            If the branch turns aside and is not to be followed, and no way leads straight on.
        """
        item, branch = self.item, self.branch
        here = branch.point(self.problem.state, None, sign)
        if here is None:
            raise BranchLost(self.solver.trouble)
        before = None
        if memory is not None:
            before, self._cut = recall(self.turns, here, memory, earlier)
        exits = Exits(branch, item, passed)
        while True:
            step = self._step(here, arc, before)
            start, there, arc, retries = step.start, step.there, step.arc, step.retries
            left = self._left(start.state)
            switched = False
            for spot in self._spots(step, left):
                traced = spot.traced
                if traced.event:
                    factor = branch.factor_of(traced.state)
                    self.log(f"{item.what}: {traced.event} at factor {factor:.8g}")
                yield replace(traced, retries=retries)
                if traced.last:
                    return
                retries = 0
                aside = None
                if traced.event == "bifurcation" and traced.mode is not None:
                    aside = exits.taken(traced.state, traced.mode)
                if aside is not None:
                    here, switched = aside, True
                    before, arc, self._cut = None, abs(item.switch), 1.0
                    self.turns.forget()
                    self.sentinel.excess = None  # the new branch's own is taken at its first state
                    break
            if switched:
                continue
            turn = self.turns.reached(there, start, arc)
            if self.crossings.is_told():
                self.log(f"{item.what}: {MAYBE_ASIDE}")
            beyond = just_beyond(arc, left, self._left(there.state))
            usual = min(arc * growth(step.attempt.iterations), item.longest)
            arc = min(usual, beyond)
            self._cut = arc / usual  # a step that is short because the end is near tells nothing
            before, here = start, there
            if turn is not None:
                self.log(f"{item.what}: the branch turns aside; another one almost crosses it")
            name = "" if turn is None else TURN_ASIDE
            behind, memory = kept(self.turns, there, start, self._cut)
            yield Traced(
                there.state, arc, float(np.sign(there.slope)), retries, name, earlier=behind,
                memory=memory,
            )  # fmt: skip
            if turn is None:
                continue
            if item.at_turn == "pass":
                self._over = self.crossings.straight_on(turn, there)
            if item.at_turn != "follow" and self._over is None:
                raise BranchTurned(turn.factor, item.at_turn == "pass")

    def _left(self, state: State) -> float | None:
        """How far a state is from the end of the trace, of either sign; None for no end."""
        with self.problem.at(state):
            return self.gap()

    def _step(self, here: Point, arc: float, before: Point | None) -> Reached:
        """Go an arc, halved until the step is accepted, or pass a crossing in one step."""
        retries = 0
        while True:
            over, self._over = self._over, None
            if over is None and self.crossings.announced(arc / self._cut):
                over = self._may_pass(self.crossings.passage(here))
            if over is not None:
                return self._passed(over, retries)
            attempt, there = self.crossings.advance(here, arc, before)
            if self.item.at_turn is None:
                over = self._may_pass(self.crossings.held_passage(here, arc))
            if over is not None:
                return self._passed(over, retries)
            outcome = attempt.outcome
            if there is not None:
                count = self.sentinel.count(there.state)
                if not self._is_doubtful(here, there, arc, count):
                    self._tell_unexplained(count, here.slope * there.slope < 0)
                    return Reached(attempt, here, there, arc, count, retries)
                outcome = Outcome.MIXED_EVENTS
            retries += 1
            arc /= 2
            self.log(f"{self.item.what}: arc halved ({outcome.value})")
            if arc < SHORTEST_ARC:
                raise BranchLost(outcome)

    def _is_doubtful(self, here: Point, there: Point, arc: float, count: int | None) -> bool:
        """Whether a step may have jumped to another branch.

        The number of negative eigenvalues changes by other than limit points, and no smooth curve
        joins the two points.  Several changes in one long step are separated.
        """
        before = self.sentinel.excess
        if before is None or count is None or arc <= SHORTEST_ARC_TO_SEPARATE_EVENTS:
            return False
        many = arc > 0.5 and self.sentinel.stability and abs(count - before) > 1
        explained = abs(count - before) == int(here.slope * there.slope < 0)
        return many or (not explained and not self.branch.is_smooth(here, there, arc))

    def _may_pass(self, over: Passage | None) -> Passage | None:
        """The passage, or None where the trace would end in it while it holds many shapes."""
        if over is None or not over.holds_many:
            return over
        before, behind = (self._left(point.state) for point in (over.start, over.there))
        return over if before is None or behind is None or before * behind > 0 else None

    def _passed(self, over: Passage, retries: int) -> Reached:
        """A step from an earlier point, straight on over what comes after it."""
        self.log(f"{self.item.what}: went straight on where another branch crosses or almost does")
        count = self.sentinel.count(over.there.state)
        return Reached(
            over.attempt, over.start, over.there, over.arc, count, retries, over.done, over.guide
        )  # fmt: skip

    def _tell_unexplained(self, count: int | None, turns: bool) -> None:
        """Log a change of the number of negative eigenvalues that no limit point explains."""
        before = self.sentinel.excess
        if self.sentinel.stability or before is None or count is None:
            return
        if abs(count - before) != int(turns):
            limits = "its limit point explains only one" if turns else "it has no limit point"
            change = f"the number of negative eigenvalues changes from {before} to {count}"
            told = f'{change} within this step; {limits}, and stability="every" looks for others'
            self.log(f"{self.item.what}: {told}")

    # ------------------------------------------------------------------ between two points

    def _spots(self, step: Reached, left: float | None) -> list[Spot]:
        """Events, requested loads and the end within a step, in the order of travel."""
        branch, start, there, arc = self.branch, step.start, step.there, step.arc
        spots = list(self._landings(step))
        if end := self._end(step, left):
            spots.append(end)
        turns = start.slope * there.slope < 0
        before = self.sentinel.excess
        events = self.sentinel.passed(
            there.state, branch.place(start, there, arc, step.guide), self.rates, step.count,
            int(turns),
        )  # fmt: skip
        if missed := self._missed(step, before, events, int(turns)):
            step, events = missed
        slope = float(np.sign(there.factor - start.factor))
        for event in events:
            state, held = self._settled(step, event.state)
            traced = Traced(state, arc, slope, event=event.name, mode=event.mode, held=held)
            spots.append(Spot(event.share * arc, traced))
        return sorted((s for s in spots if s.arc > step.done), key=lambda spot: spot.arc)

    def _missed(
        self, step: Reached, before: int | None, events: list[Passed], limits: int
    ) -> tuple[Reached, list[Passed]] | None:
        """The step with the soft shapes held, and its events, if bifurcations were not located.

        A mesh that is not quite symmetric opens them, so that no equilibrium near them has a
        singular tangent.  With the shapes held the states between pass through them.
        """
        found = sum(event.changes for event in events if event.mode is not None)
        if not self.sentinel.stability or before is None or step.count is None:
            return None
        if found >= min(abs(step.count - before) - limits, MOST_CHANGES_LOCATED):
            return None
        held = self._with_guide(step)
        if held is None:
            return None
        place = self.branch.place(held.start, held.there, held.arc, held.guide)
        more = self.sentinel.bifurcations(place, before, step.count, self.rates, limits)
        if sum(event.changes for event in more) <= found:
            return None
        others = [event for event in events if event.mode is None]
        return held, [*others, *more]

    def _with_guide(self, step: Reached) -> Reached | None:
        """A step with the soft shapes held; None if they are held already or cannot be found."""
        if step.guide is not None or not self.problem.forms.is_symmetric:
            return None
        guide = Guide.across(self.branch, step.start, step.there, SOFT_SHAPES)
        return None if guide is None else replace(step, guide=guide)

    def _landings(self, step: Reached) -> Iterator[Spot]:
        """Limit point and requested loads within a step."""
        branch, item = self.branch, self.item
        here, there, arc = step.start, step.there, step.arc
        pieces = [(0.0, here), (arc, there)]
        sign = float(np.sign(there.slope))
        found = None
        if here.slope * there.slope < 0:
            found = branch.limit_point(here, there, arc, step.guide)
            if found is None and (guided := self._with_guide(step)) is not None:
                step = guided
                found = branch.limit_point(here, there, arc, step.guide)
        if found is not None:
            limit, s = found
            kind = "maximum" if here.slope > 0 else "minimum"
            pieces.insert(1, (s, limit))
            mode = self.sentinel.mode_of(limit.direction) if self.sentinel.stability else None
            state, held = self._settled(step, limit.state)
            yield Spot(s, Traced(state, arc, sign, event=kind, mode=mode, held=held))
        for (low, start), (high, end) in pairwise(pieces):
            for wanted in item.at:
                if (start.factor - wanted) * (end.factor - wanted) < 0:
                    attempt = branch.land(start, end, wanted, step.guide)
                    if attempt.converged:
                        share = (wanted - start.factor) / (end.factor - start.factor)
                        traced = Traced(attempt.found, arc, sign, event="landed")
                        yield Spot(low + share * (high - low), traced)

    def _end(self, step: Reached, left: float | None) -> Spot | None:
        """Where the trace ends, if that is in this step; `left` is the gap at its start."""
        here, there, arc = step.start, step.there, step.arc
        beyond = self._left(there.state)
        if left is None or beyond is None or left == 0 or left * beyond > 0:
            return None
        s, state, held = arc, there.state, 0.0
        bracket = Bracket((0.0, left), (arc, beyond))
        close = TRACE_END_TOLERANCE * max(abs(left), abs(beyond))
        for _ in range(20):
            if abs(bracket.high[1]) <= close:
                break
            s = bracket.secant
            attempt = self.branch.step(here, s, there, step.guide)
            now = None
            if attempt.converged:  # What is asked for is the value of the settled state.
                settled = self._settled(step, attempt.found)
                now = self._left(settled[0])
            if now is None:  # The end of the step is an equilibrium, a little beyond the value.
                self.log("no equilibrium was found at the very end of the trace; it ends behind")
                s, state, held = arc, there.state, 0.0
                break
            state, held = settled
            bracket.narrow(s, now)
        return Spot(s, Traced(state, arc, float(np.sign(there.slope)), held=held, last=True))

    def _settled(self, step: Reached, state: State) -> tuple[State, float]:
        """The equilibrium near a state that was found with guiding forces.

        Where there is none, it is the state itself, and its scaled residual.
        """
        if step.guide is None or state is step.there.state:
            return state, 0.0
        branch, problem = self.branch, self.problem
        attempt = branch.corrected(step.start, state, branch.factor_of(state))
        if attempt.converged:
            change = branch.factor_of(attempt.found) - branch.factor_of(state)
            moved = (attempt.found.values - state.values)[problem.free]
            if np.sqrt(branch.dot(moved, change, moved, change)) < MOST_SETTLING * step.arc:
                return attempt.found, 0.0
        with problem.at(state):
            held = self.solver.residual_of(problem.residual(), anew=True)
        self.log(
            f"{self.item.what}: other branches cross so near to this state that it is held in "
            f"place; without that its residual is {held:.1e}, an error of the mesh"
        )
        return state, held
