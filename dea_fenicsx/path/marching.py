"""A march: steps in time whose length follows an error estimate, or is fixed.

A step lands on corners of the drive and on asked times.  A jump of the drive is a ramp in no time,
to which the branches respond instantaneously.  A step that fails is halved, and this is no verdict:
equilibrium is lost where the branch of states over the length of the step, its history held, turns
back, and where this step is short enough to be exact.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

from dea_fenicsx.drives.waves import TIME_TOLERANCE, Wave
from dea_fenicsx.model.state import State
from dea_fenicsx.model.viscous_history import Rule
from dea_fenicsx.path.cursor import AcceptedStep, Cursor
from dea_fenicsx.path.events import Sentinel
from dea_fenicsx.path.items import March, Ramp
from dea_fenicsx.path.ramping import RampWalk
from dea_fenicsx.path.step_lengths import (
    CLOCK_STEP,
    StepSizes,
    is_among,
    landings,
    next_after,
    tell_landings,
)
from dea_fenicsx.path.time_limit import follow_time
from dea_fenicsx.path.time_stepping import TimeStepper
from dea_fenicsx.path.verdicts import march_lost, march_stuck, march_too_exact
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.outcome import Attempt
from dea_fenicsx.support.errors import EquilibriumLost

LOST = "loss of equilibrium"
"""The event of the state beyond which there is no equilibrium."""

FEWEST_STEPS_BETWEEN_CORNERS = 10
"""Steps between two corners of the drive at least, where no error is estimated."""

SHORTEST_STEP_OF_MARCH = 2.0**-30
"""Shortest step, in units of the time gone.  Below it the march is given up.

The time gone is at least the first step after a jump, and counts up to the longest step.
"""

EXACT_SHARE = 2.0**-8
"""Longest step to a limit point, in units of a fixed step, that counts as exact."""

HALVINGS_BEFORE_ARC = 2
"""How often a step is halved before the branch is followed over the length of the step."""

HITS_BEFORE_ARC = 4
"""How often steps end at one time in vain before the branch is followed as well."""

SAME_TIME = 1e-3
"""Times that differ by less are the same, in units of the step."""

FIRST_STEP_SHARE = 2.0**-10
"""Longest first step after a jump whose length is adapted, in units of the longest one."""

FIRST_ERROR_SHARE = 0.1
"""Share of the tolerance that the first step of a march aims at."""


@dataclass(frozen=True)
class LoadJump(Ramp):
    """A ramp of several loads, each to a factor of its own.

    Attributes
    ----------
    targets
        Factor at the end, by ramp.
    """

    targets: Mapping[str, float] = field(default_factory=dict)

    def goals(self, scene: Scene) -> dict[str, float]:
        return dict(self.targets)

    def names(self, scene: Scene) -> tuple[str, ...]:
        return tuple(self.targets)

    def label(self, scene: Scene) -> str:
        return "march"


class MarchWalk:
    """Follows one march from a cursor to its end.

    Parameters
    ----------
    solver
        The nonlinear solver; its problem is in equilibrium at the cursor.
    march
        The march.
    cursor
        Where the march is taken up.
    is_last
        Whether it is the last item of the path.
    sentinel
        Watches for events.
    log
        Called with a line of text for every retry.
    """

    def __init__(
        self,
        solver: NewtonSolver,
        march: March,
        cursor: Cursor,
        is_last: bool,
        sentinel: Sentinel,
        log: Callable[[str], None],
    ) -> None:
        self.solver, self.problem = solver, solver.problem
        self.march, self.cursor, self.is_last = march, cursor, is_last
        self.sentinel, self.log = sentinel, log
        self.drive: dict[str, Wave] = march.waves
        self.room = TIME_TOLERANCE * march.seconds
        self.stepper = TimeStepper(solver, self.drive, cursor.began, march.order)
        self.stepper.set_clock(cursor.position * march.seconds)
        self.adaptive = march.steps is None and bool(self.stepper.memories)
        end = march.seconds
        self.corners = sorted({t for w in self.drive.values() for t in w.corners(0.0, end)})
        self.stops = landings(self.corners, march.at, end, self.room)
        self.ladder = StepSizes(self._longest())
        self.wall, self.hits = -math.inf, 0  # a time that was not reached, and how often
        self.limit: float | None = None  # time of the limit point ahead, as known so far
        self.rung = self.ladder.at_most(cursor.size) if cursor.size else 0
        self.fresh = not cursor.size  # whether the first step since a jump is still to come
        self.first = self.ladder.size(self.rung)  # length of the first step since a jump

    def _longest(self) -> float:
        """Longest step in s."""
        end = self.march.seconds
        if self.march.steps is not None:
            return end / self.march.steps
        finest = min((wave.finest() for wave in self.drive.values()), default=math.inf)
        return min(end if self.adaptive else end / FEWEST_STEPS_BETWEEN_CORNERS, finest)

    # ------------------------------------------------------------------ the march

    def follow(self) -> Iterator[AcceptedStep]:
        """Yield the accepted steps, one after another.

        Raises
        ------
        EquilibriumLost
            If there is no equilibrium beyond a time, or beyond a load within a jump of the drive.
        SolverError
            If the linear solver or the method fails however short the step.
        """
        if self.cursor.position == 0:
            tell_landings(self.stops, self.ladder.longest, self.log)
            self._restart()
        retries, failures = 0, 0
        while True:
            yield from self._jump()
            now = self.stepper.now
            if now >= self.march.seconds - self.room:
                return
            if self.adaptive and self.fresh:
                self.rung, self.fresh = self.ladder.at_most(self._first_step()), False
                self.first = self.ladder.size(self.rung)
            corner = is_among(self.corners, now, self.room)
            if corner and self.march.order == 3:
                self._restart()  # a rule of three earlier values would look across the corner
            stop = next_after(self.stops, now, self.room)
            seconds = self._length(now, stop)
            lands = now + seconds >= stop - self.room
            if not self.stepper.memories:
                yield from self._elastic(now, seconds, stop if lands else now + seconds)
                continue
            attempt = self.stepper.step(seconds)
            if not attempt.converged:
                self._tell_retry(now + seconds, attempt)
                retries, failures = retries + 1, failures + 1
                if failures > HALVINGS_BEFORE_ARC or self._hits_wall(now + seconds, seconds):
                    yield from self._look_for_limit(now, seconds, retries)
                if self._halve(seconds) < self._shortest():
                    raise march_stuck(now, seconds, attempt)
                continue
            settled = self.stepper.settled(attempt.found)
            error = None
            if self.adaptive:
                rule = self.stepper.rule(seconds)
                error = self.stepper.error(settled, rule, corner)
                order = self._error_order(rule, corner)
                if error is not None and error > self.march.tolerance:
                    self.rung = max(
                        self.rung + 1, self.ladder.at_most(self._allowed(seconds, error, order))
                    )
                    if self.ladder.size(self.rung) < self._shortest():
                        raise march_too_exact(now, self.march.tolerance, error)
                    continue
                self._grow(seconds, error, order)
            elif self.rung > 0 and not failures:
                self.rung -= 1
            yield from self._events(now, seconds, settled)
            yield self._accept(stop if lands else now + seconds, settled, retries)
            retries = failures = 0
            if self.limit is not None:
                now = self.stepper.now
                yield from self._look_for_limit(now, 2 * max(self.limit - now, 0.0), 0)

    def _hits_wall(self, time: float, seconds: float) -> bool:
        """Whether several accepted steps in a row were followed by a failure at one time.

        Short steps may creep towards a limit point for long, since each of them succeeds.
        """
        if abs(time - self.wall) > SAME_TIME * seconds:
            self.wall, self.hits = time, 0
        self.hits += 1
        return self.hits > HITS_BEFORE_ARC

    def _length(self, now: float, stop: float) -> float:
        seconds = self.ladder.portion(self.rung, stop - now)
        if self.limit is not None and self.limit > now:
            seconds = min(seconds, (self.limit - now) / 2)
        return seconds

    def _halve(self, seconds: float) -> float:
        """Take half of a length in s for the next step, and return it."""
        self.rung = max(self.rung + 1, self.ladder.at_most(seconds / 2))
        return seconds / 2

    def _shortest(self) -> float:
        """Shortest step in s.  It is not tied to the length of the march, which may be generous."""
        now = self.stepper.now
        gone = min(self.ladder.longest, max(now, self.first))
        return max(SHORTEST_STEP_OF_MARCH * gone, CLOCK_STEP * abs(self._clock(now)))

    def _error_order(self, rule: Rule, corner: bool) -> int:
        """The power of its length with which the error of a step goes."""
        if rule is Rule.BDF3:
            return 3 if self.problem.charges else 4
        return 3 if rule is Rule.BDF2 and not corner else 2

    def _allowed(self, seconds: float, error: float, order: int) -> float:
        """The length of a step whose error, of an order in its length, is the tolerance."""
        return seconds * (self.march.tolerance / max(error, 1e-30)) ** (1 / order)

    def _grow(self, seconds: float, error: float | None, order: int) -> None:
        """Choose the rung of the next step after one that is accepted."""
        if error is None:
            return
        used = self.ladder.at_most(seconds * (1 + 1e-9))
        if used > self.rung:  # the step was cut short by a landing, and tells less of the next one
            return
        most = 1 if self.march.order == 3 else 2  # rungs up; see `MOST_GROWTH_OF_BDF3`
        self.rung = self.ladder.next_rung(self.rung, self._allowed(seconds, error, order), most)

    def _first_step(self) -> float:
        """Length of the first step after a jump, in which the error of backward Euler is small."""
        first, memory = FIRST_STEP_SHARE * self.ladder.longest, self.problem.forms.memory
        if not memory:
            return first
        with self.problem.at(self.stepper.base):
            strains = self.stepper.histories[memory.NAME].strains[0]
            size = memory.size(memory.second_rates(strains))
        if size == 0:
            return first
        wanted = 2 * FIRST_ERROR_SHARE * self.march.tolerance / size
        return min(first, math.sqrt(wanted))

    def _restart(self) -> None:
        """Forget what was before the present state, since the rates jump here."""
        self.stepper.restart(self.problem.state, jump=True)
        self.problem.commit(self.stepper.base)

    def _elastic(self, now: float, seconds: float, end: float) -> Iterator[AcceptedStep]:
        """A step of a body without memory: a ramp of its loads, with its evidence and events."""
        goals = self._due(end, before=True)
        share = replace(self.cursor, position=0.0, size=0.0, start=dict(self.problem.factors))
        if not goals:
            yield self._accept(end, replace(self.problem.state, time=self._clock(end)), 0)
            return
        for step in self._ramp(goals, share):
            time = end if step.cursor.position == 1.0 else now + step.cursor.position * seconds
            state = replace(step.state, time=self._clock(time))
            self.problem.commit(state)
            self.cursor = replace(self._moved(time, self.ladder.longest), step=step.cursor.step)
            last = self._is_end(time) and not step.event and not self._due(time)
            yield replace(step, cursor=self.cursor, state=state, last=last, earlier=())
        self.stepper.restart(self.problem.state)
        self.stepper.set_clock(time)

    def _clock(self, now: float) -> float:
        """Time of the problem at a time of the drive, in s."""
        return self.cursor.began + now

    def _ramp(self, goals: Mapping[str, float], start: Cursor) -> Iterator[AcceptedStep]:
        """The steps of a ramp in no time."""
        ramp = LoadJump(steps=1, targets=goals)
        try:
            yield from RampWalk(self.solver, ramp, start, False, self.sentinel, self.log).follow()
        except EquilibriumLost as error:
            error.args = (f"{error} The march had come to {self.stepper.now:.9g} s.",)
            raise

    # ------------------------------------------------------------------ jumps, events, ends

    def _due(self, now: float, before: bool = False) -> dict[str, float]:
        """Factors of the drive at a time, or just before it, of ramps that are elsewhere."""
        factors = self.problem.factors
        goals = {
            name: wave.before(now) if before else wave(now) for name, wave in self.drive.items()
        }
        return {
            name: goal for name, goal in goals.items()
            if abs(goal - factors[name]) > TIME_TOLERANCE * max(1.0, abs(goal))
        }  # fmt: skip

    def _jump(self) -> Iterator[AcceptedStep]:
        """Go to the load of the drive in no time, if it is not the present one."""
        goals = self._due(self.stepper.now)
        if not goals:
            return
        self._restart()
        here = self.cursor
        start = replace(here, position=0.0, size=0.0, start=dict(self.problem.factors))
        for step in self._ramp(goals, start):
            self.cursor = replace(here, step=step.cursor.step, size=0.0)
            last = self._is_end(self.stepper.now) and not self._due(self.stepper.now)
            yield replace(step, cursor=self.cursor, last=last, earlier=())
        self.stepper.restart(self.problem.state, jump=True)
        self.limit, self.fresh = None, True

    def _is_end(self, now: float) -> bool:
        return self.is_last and now >= self.march.seconds - self.room

    def _events(self, now: float, seconds: float, settled: State) -> Iterator[AcceptedStep]:
        """Events between the last accepted state and this one, each as a step of its own."""
        before, count = self.sentinel.excess, self.sentinel.count(settled)
        if before is not None and count is not None and before != count:
            self.log(
                f"march: the number of negative eigenvalues changes from {before} to {count} "
                f"between {now:.6g} s and {now + seconds:.6g} s"
            )
        rates = {n: settled.factors[n] - self.problem.factors[n] for n in self.drive}

        def place(share: float) -> Attempt:
            return self.stepper.place(share * seconds)

        for event in self.sentinel.passed(settled, place, rates, count):
            self.problem.commit(event.state)
            at = now + event.share * seconds
            self.cursor = self._moved(at, self.cursor.size)
            self.log(f"march: {event.name} at {at:.9g} s")
            yield AcceptedStep(self.cursor, "march", event.state, event=event.name, mode=event.mode)

    def _moved(self, now: float, size: float) -> Cursor:
        """The cursor of the next step."""
        share = min(now / self.march.seconds, 1.0)
        return replace(self.cursor, step=self.cursor.step + 1, position=share, size=size)

    def _accept(self, now: float, settled: State, retries: int) -> AcceptedStep:
        self.problem.commit(settled)
        self.stepper.accept(settled, now)
        self.cursor = self._moved(now, self.ladder.size(self.rung))
        last = self._is_end(now) and not self._due(now)
        return AcceptedStep(self.cursor, "march", settled, retries, last)

    def _tell_retry(self, time: float, attempt: Attempt) -> None:
        self.log(
            f"march: no equilibrium at {time:.9g} s ({attempt.outcome.value}, "
            f"{attempt.iterations} Newton iterations); step halved"
        )

    def _look_for_limit(self, now: float, seconds: float, retries: int) -> Iterator[AcceptedStep]:
        """Look for a limit point within a step of some length, its history held.

        Raises
        ------
        EquilibriumLost
            If there is one, and the step to it is short enough to be exact.
        """
        limit = follow_time(self.stepper, self.sentinel, seconds) if seconds else None
        if limit is None:
            self.limit = None
            return
        self.limit = there = now + limit.seconds
        settled = self.stepper.settled(limit.state)
        if self.adaptive:
            error = self.stepper.error(settled, limit.rule)
            exact = error is not None and error <= self.march.tolerance
        else:
            exact = limit.seconds <= EXACT_SHARE * self.ladder.longest
        if not exact:
            return
        self.problem.commit(settled)
        self.cursor = self._moved(there, 0.0)
        yield AcceptedStep(self.cursor, "march", settled, retries, self.is_last, event=LOST)
        raise march_lost(self.problem.scene, settled, there, list(self.drive))
