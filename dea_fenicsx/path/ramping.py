"""A ramp followed in adaptive steps, with exact landings, retries and a clear end."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

from dea_fenicsx.model.state import Factors, State
from dea_fenicsx.path.bridging import bridge
from dea_fenicsx.path.crushing import Crush, find_crush
from dea_fenicsx.path.cursor import AcceptedStep, Cursor
from dea_fenicsx.path.events import Sentinel
from dea_fenicsx.path.evidence import Evidence
from dea_fenicsx.path.falling import Fall
from dea_fenicsx.path.items import InMotion, Ramp
from dea_fenicsx.path.limit_ahead import limit_ahead
from dea_fenicsx.path.predictor import Predictor
from dea_fenicsx.path.snapping import over_the_limit
from dea_fenicsx.path.stability import Place
from dea_fenicsx.path.step_lengths import LONGEST_LAST_STEP
from dea_fenicsx.path.verdicts import (
    INCONCLUSIVE_OUTCOMES,
    is_near_limit,
    never_at_rest,
    ramp_lost,
    stability_lost,
)
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.outcome import Attempt, Outcome
from dea_fenicsx.support.errors import EquilibriumLost, PathError, SolverError

SMALLEST_STEP = 2.0**-10
"""Smallest step, in units of the first one.  Below it equilibrium counts as lost."""

SMALLEST_STEP_AT_JUMP = 2.0**-16
"""Smallest step, in units of the first one, if Newton's method finds states of another branch.

It also holds if no limit point is seen ahead.  In both cases the path may have a sharp bend, which
is sharper for a smaller imperfection: with two loads that differ by 1e-5 the sheet of Treloar and
Kearsley needs steps of 1e-4.
"""

STEP_OF_SEARCH = 2.0**-2
"""Step, in units of the first one, below which a limit point is searched for by arc length."""

LONGEST_BRIDGE = 2.0**-4
"""Longest way along the load over which the branch is followed by arc length behind a sharp bend.

In units of the first step.  Behind it the ramp goes on in its own steps.
"""

MOST_NEWTON_FOR_LONGER_STEP = 5
"""Largest number of Newton iterations of a step after which the next step is longer."""

STEP_GROWTH = 1.5
"""Length of the next step over that of the last one, if the last one needed few iterations."""


class RampWalk:
    """Follows one ramp from a cursor to its end.

    Parameters
    ----------
    solver
        The nonlinear solver; its problem is in equilibrium at the cursor.
    ramp
        The ramp.
    cursor
        Where the ramp is taken up.
    is_last
        Whether it is the last item of the path.
    sentinel
        Watches for events.
    log
        Called with a line of text for every retry.
    earlier
        In a resumed run, what `earlier` of its last step was: the state at the start of the ramp,
        and those from which the next step is extrapolated.
    """

    def __init__(
        self,
        solver: NewtonSolver,
        ramp: Ramp,
        cursor: Cursor,
        is_last: bool,
        sentinel: Sentinel,
        log: Callable[[str], None],
        earlier: Sequence[State] = (),
    ) -> None:
        self.solver, self.problem = solver, solver.problem
        self.ramp, self.cursor, self.is_last = ramp, cursor, is_last
        self.sentinel, self.log = sentinel, log
        scene = self.problem.scene
        self.names, self.label = ramp.names(scene), ramp.label(scene)
        self.start = cursor.start
        self.goals = ramp.goals(scene)
        self.rates = {n: self.goals[n] - self.start[n] for n in self.names}
        self.first = 1.0 / ramp.steps
        self.size = cursor.size or self.first
        self.lead = max(self.names, key=lambda name: abs(self.rates[name]))
        self.origin = earlier[0] if earlier else self.problem.state
        self.limit: float | None = None  # position of the limit point ahead, where it is known
        self.near_limit: bool | None = None  # whether the last failed step shows one, if asked
        self.beyond: float | None = None  # position from which on there is no equilibrium nearby
        self._searched = False
        self._start_from(*earlier[1:], self.problem.state)

    def _start_from(self, *states: State) -> None:
        """Forget all earlier states but these, so that the next step is extrapolated from them."""
        self.predictor = Predictor(self.solver, self.names, self.lead)
        for state in states:
            self.predictor.add(state)
        self.evidence = Evidence(self.solver, self.predictor, self.sentinel)

    def factors_at(self, position: float) -> Factors:
        """The load at a position of the ramp.

        It is a weighted mean of both ends, so that position 1 gives the end to the last bit.
        """
        moved = {
            n: (1 - position) * self.start[n] + position * self.goals[n] for n in self.names
        }
        return self.problem.factors | moved

    def follow(self) -> Iterator[AcceptedStep]:
        """Yield the accepted steps, one after another.

        Raises
        ------
        EquilibriumLost
            If no equilibrium is found beyond a load.
        StabilityLost
            If the ramp is to end where the branch becomes unstable.
        SolverError
            If the linear solver or the method fails however small the step.
        """
        self._check_rest(self.sentinel.excess)
        landings = _landings(self.ramp, self.start[self.names[0]])
        retries = 0
        while self.cursor.position < 1.0:
            position = self.cursor.position
            landing = min(s for s in landings if s > position)
            # If the remainder would be under 25 % of a step, go straight to the landing point.
            near = landing - position < LONGEST_LAST_STEP * self.size
            target = landing if near else position + self.size
            if self._is_beyond(target, position):
                retries, self.size = retries + 1, (target - position) / 2
                continue
            attempt = self.predictor.solve(self.factors_at(target), self.evidence.judge)
            if attempt.converged:
                place = self.predictor.between(self.predictor.known[-1], attempt.found)
                yield from self._events(position, target, attempt.found, place)
                yield self._accept(position, target, target == landing, attempt, retries)
                retries = 0
                continue
            retries += 1
            self.size = (target - position) / 2
            self._tell_retry(target, attempt)
            if self._may_halve(target, attempt):
                self._search(target, attempt)
                continue
            left = self.cursor.position
            for step in self._cross(target, landing, attempt, retries):
                yield step
                retries = 0
            if self.cursor.position > left:
                continue
            crush = self._crush(target)
            lost = self._lost(target, attempt, crush)
            ends = crush or self.ramp.loss in ("end", "unstable")
            if ends or not isinstance(lost(), EquilibriumLost):
                raise lost()
            for step in self._snap(lost):
                yield replace(step, retries=retries)
                retries = 0
            self.sentinel.start()
            self.size, self.limit = self.first, None
            self.beyond, self._searched = None, False
            self._start_from(self.problem.state)

    def _events(
        self, position: float, target: float, found: State, place: Place
    ) -> Iterator[AcceptedStep]:
        """Events between the last accepted state and this one, each as a step of its own."""
        names, count = self.names, self.evidence.count
        rates = {n: (target - position) * rate for n, rate in self.rates.items()}
        self._tell_change(self.sentinel.excess, count)
        for event in self.sentinel.passed(found, place, rates, count):
            self.problem.commit(event.state)
            at = position + event.share * (target - position)
            self.cursor = replace(self.cursor, step=self.cursor.step + 1, position=at)
            self.log(f"{self.label}: {event.name} at {event.state.factors.told(names)}")
            yield AcceptedStep(
                self.cursor, self.label, event.state, event=event.name, mode=event.mode
            )
            if event.mode is not None:
                self._check_rest(count)
        self._check_rest(count)

    def _check_rest(self, count: int | None) -> None:
        """End the ramp where its states are unstable from now on, if it is to end there."""
        if self.ramp.loss == "unstable" and count:
            raise stability_lost(self.names, self.label, self.problem.factors)

    def _accept(
        self, position: float, target: float, lands: bool, attempt: Attempt, retries: int
    ) -> AcceptedStep:
        """Accept a state, and choose the size of the next step."""
        found = attempt.found
        self.problem.commit(found)
        if self.evidence.bent:
            self._start_from(found)
        else:
            self.predictor.add(found)
        cut = lands and target - position < self.size
        grown = STEP_GROWTH if attempt.iterations <= MOST_NEWTON_FOR_LONGER_STEP else 1.0
        self.size = min(self.size * (1.0 if cut else grown), 1.0)
        if not cut and self.ramp.at is None:
            self.size = min(self.size, self.first)
        cursor = self.cursor
        self.cursor = replace(
            cursor, step=cursor.step + 1, position=target, size=self.size, start=dict(self.start)
        )
        last = target == 1.0 and self.is_last
        earlier = (self.origin, *self.predictor.known[:-1])
        return AcceptedStep(self.cursor, self.label, found, retries, last, earlier=earlier)

    def _tell_retry(self, target: float, attempt: Attempt) -> None:
        load = self.factors_at(target).told(self.names)
        self.log(
            f"{self.label}: no equilibrium at {load} ({attempt.outcome.value}, "
            f"{attempt.iterations} Newton iterations); step halved"
        )

    def _tell_change(self, before: int | None, after: int | None) -> None:
        """Log a change of the number of negative eigenvalues within an accepted step."""
        if before is not None and after is not None and before != after:
            self.log(f"{self.label}: the number of negative eigenvalues changes from {before} to "
                     f"{after} here")  # fmt: skip

    def _may_halve(self, target: float, attempt: Attempt) -> bool:
        """Whether a step that has failed is tried again with half its length.  Collective."""
        jumped = attempt.outcome is Outcome.JUMPED
        self.near_limit = None
        if self.size >= self.first * (SMALLEST_STEP_AT_JUMP if jumped else SMALLEST_STEP):
            return True
        failed = self.factors_at(target)
        self.near_limit = is_near_limit(self.predictor, self.origin, failed)
        may_halve = self.size >= self.first * SMALLEST_STEP_AT_JUMP
        return not self.near_limit and attempt.outcome in INCONCLUSIVE_OUTCOMES and may_halve

    def _is_beyond(self, target: float, position: float) -> bool:
        """Whether a step need not be tried, because it leads over a limit point that is known.

        The last step before the ramp ends is tried nevertheless, so that the end does not rest on
        this alone.
        """
        shortest = self.first * SMALLEST_STEP
        return (
            self.beyond is not None and target > self.beyond
            and (target - position) / 2 >= shortest
        )  # fmt: skip

    def _search(self, target: float, attempt: Attempt) -> None:
        """Look once for a limit point ahead, when the steps have become short.  Collective."""
        position = self.cursor.position
        short = self.size < self.first * STEP_OF_SEARCH
        if self._searched or not short or attempt.outcome not in INCONCLUSIVE_OUTCOMES:
            return
        self._searched = True
        if not is_near_limit(self.predictor, self.origin, self.factors_at(target)):
            return
        self.beyond = limit_ahead(
            self.solver, self.sentinel, self.rates, self.first, position, target
        )
        self.solver.forget_factor()
        if self.beyond is not None:
            load = self.factors_at(self.beyond).told(self.names)
            self.log(f"{self.label}: a limit point lies at {load}; loads beyond it are not tried")

    def _cross(
        self, target: float, landing: float, attempt: Attempt, retries: int
    ) -> Iterator[AcceptedStep]:
        """Follow the branch by arc length where a step has failed although an equilibrium exists.

        Yields nothing if the branch does not lead to a larger load than that of the failed step.
        """
        if attempt.outcome not in INCONCLUSIVE_OUTCOMES or self.limit is not None:
            return
        position = self.cursor.position
        wanted = min(landing, position + LONGEST_BRIDGE * self.first)
        found = bridge(self.solver, self.sentinel, self.rates, self.first, position, wanted)
        self.solver.forget_factor()  # The factor may belong to a state of another branch.
        if found.limit is not None:
            self.limit = found.limit
            wanted = min(wanted, found.limit - SMALLEST_STEP * self.first)
        if wanted <= target:
            return
        landed = found.at(wanted)
        if not landed.converged:
            return
        state = landed.found.with_factors(self.factors_at(wanted))
        self.log(f"{self.label}: followed by arc length to {state.factors.told(self.names)}")
        self.evidence.count = self.sentinel.count(state)
        yield from self._events(position, wanted, state, found.place(wanted))
        self.size = wanted - position
        landed = replace(landed, state=state)
        step = self._accept(position, wanted, wanted == landing, landed, retries)
        self._start_from(self.problem.state)
        yield replace(step, earlier=(self.origin,))

    def _crush(self, target: float) -> Crush | None:
        """What the ramp presses to zero thickness, if that is how it ends.  Collective."""
        if self.limit is not None:
            return None
        return find_crush(self.predictor, self.origin, self.factors_at(target))

    def _lost(
        self, target: float, attempt: Attempt, crush: Crush | None
    ) -> Callable[[], PathError]:
        """A function that makes the error which ends the ramp.

        An error in a local variable of the function that raises it is a cycle of references, for
        its traceback holds the variable.  The whole run would stay until Python looks for cycles.
        """
        ends = [target] if self.limit is None else [target, self.limit]
        if crush:
            begin = self.start[self.lead]
            ends.append(min((crush.factor - begin) / (self.ramp.to - begin), 1.0))
        failed = self.factors_at(max(ends))
        near_limit = bool(self.near_limit) or self.limit is not None
        return partial(
            ramp_lost, self.names, self.label, self.problem.factors, failed, attempt, near_limit,
            crush,
        )  # fmt: skip

    def _snap(self, lost: Callable[[], PathError]) -> Iterator[AcceptedStep]:
        """The limit point that the ramp has come to, and the state to which the device snaps."""
        cursor, how = self.cursor, self.ramp.loss
        moves = isinstance(how, InMotion)
        try:
            limit, landing, behind = over_the_limit(
                self.solver, self.rates, cursor.position, self.first, self.log,
                landing=not isinstance(how, InMotion) or how.compare, behind=moves,
            )  # fmt: skip
        except SolverError:
            raise lost() from None
        factors = self.factors_at(limit.factor)
        cursor = replace(cursor, step=cursor.step + 1, position=limit.factor, size=0.0)
        # "maximum" refers to the size of the load: a voltage may have either sign.
        outwards = factors[self.lead] * self.rates[self.lead] > 0
        top = limit.state.with_factors(factors)
        self.problem.commit(top)
        yield AcceptedStep(cursor, self.label, top, event="maximum" if outwards else "minimum")
        self.cursor = cursor
        landed = None if landing is None else landing.with_factors(factors)
        if isinstance(how, InMotion):
            if behind is None:
                self.log(f"{self.label}: no state was found in which a motion could begin")
                raise lost()
            yield from self._fall(how, behind.with_factors(factors), landed, lost)
        elif landed is None:
            self.log(f"{self.label}: no stable state was found behind the limit point at this load")
            raise lost()
        else:
            self.problem.commit(landed)
            self.cursor = replace(cursor, step=cursor.step + 1)
            yield AcceptedStep(self.cursor, self.label, landed, event="snap")
        self.log(f"{self.label}: snapped at {factors.told(self.names)}")
        self.solver.forget_factor()

    def _fall(
        self, how: InMotion, begin: State, landed: State | None, lost: Callable[[], PathError]
    ) -> Iterator[AcceptedStep]:
        """The motion from a state until the body rests.

        Parameters
        ----------
        how, begin, landed
            As of `Fall`; `begin` has the load that stays constant.
        lost
            Makes the error that ends the ramp if the body does not come to rest.
        """
        fall = Fall(self.solver, how, self.ramp.response, self.sentinel, self.log)
        for step in fall.follow(begin, self.origin, landed, self.cursor):
            self.cursor = replace(step.cursor, position=self.cursor.position, size=0.0)
            yield replace(step, cursor=self.cursor, label=self.label)
        if fall.trouble:
            raise never_at_rest(lost, fall.trouble)


def _landings(ramp: Ramp, start: float) -> list[float]:
    """Positions in (0, 1] to land on."""
    if ramp.at is None:
        return [(k + 1) / ramp.steps for k in range(ramp.steps)]
    span = ramp.to - start
    inside = [(value - start) / span for value in ramp.at] if span else []
    return sorted({s for s in inside if 0 < s < 1} | {1.0})
