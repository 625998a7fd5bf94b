"""A march with inertia: steps in time whose length follows an error estimate, or is fixed.

A step lands on corners of the drive and on asked times.  After a jump of the drive the body is
where it was, with the same velocity, and has another acceleration, pressure and potential.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from mpi4py import MPI

from dea_fenicsx.drives.waves import TIME_TOLERANCE
from dea_fenicsx.model.motion import MOTION
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import State
from dea_fenicsx.path.conserving import ConservingStepper
from dea_fenicsx.path.cursor import AcceptedStep, Cursor
from dea_fenicsx.path.events import Sentinel
from dea_fenicsx.path.items import CONSERVING, Inertia, March
from dea_fenicsx.path.motion_stepping import MotionStepper
from dea_fenicsx.path.step_lengths import CLOCK_STEP, StepSizes, landings, next_after, tell_landings
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.outcome import Attempt, Outcome
from dea_fenicsx.support.errors import InputError, SolverError

FIRST_SHARE = 2.0**-10
"""First step after a jump whose length is adapted, in units of the longest one."""

SHORTEST_STEP_OF_MOTION = 2.0**-40
"""Shortest step, in units of the longest one.  Below it the march is given up."""

JUMPED = 1e-9
"""Change of a prescribed displacement, dimensionless, that a jump of the drive may cause."""


class MotionWalk:
    """Follows one march with inertia from a cursor to its end.

    Parameters
    ----------
    solver, march, cursor, is_last, sentinel, log
        As of `MarchWalk`.
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
        self.sentinel, self.log, self.drive = sentinel, log, march.waves
        assert march.moving is not None
        self.inertia: Inertia = march.moving
        self.room = TIME_TOLERANCE * march.seconds
        self.adaptive = march.steps is None
        end = march.seconds
        corners = {t for wave in self.drive.values() for t in wave.corners(0.0, end)}
        self.stops = landings(corners, march.at, end, self.room)
        self.ladder = StepSizes(self._longest())
        kind = ConservingStepper if self.inertia.scheme == CONSERVING else MotionStepper
        self.stepper = kind(solver, self.drive, cursor.began, self.inertia, self.ladder.longest)
        self.stepper.set_clock(cursor.position * end)
        self.rung = self.ladder.at_most(cursor.size) if cursor.size else 0
        self.failed: tuple[float, float, Outcome] | None = None  # first failure at a time
        self.fresh = not cursor.size  # whether the first step since a jump is still to come

    def _longest(self) -> float:
        """Longest step in s."""
        if self.march.steps is not None:
            return self.march.seconds / self.march.steps
        finest = min((wave.finest() for wave in self.drive.values()), default=math.inf)
        return min(self.march.seconds, finest)

    def follow(self) -> Iterator[AcceptedStep]:
        """Yield the accepted steps, one after another.

        Raises
        ------
        InputError
            If the drive would let a prescribed displacement jump.
        SolverError
            If no step can be made, however short.
        """
        if self.cursor.position == 0:
            tell_landings(self.stops, self.ladder.longest, self.log)
            self._start()
        retries = 0
        while True:
            yield from self._jump()
            now = self.stepper.now
            if now >= self.march.seconds - self.room:
                return
            if self.adaptive and self.fresh:
                self.rung = self.ladder.at_most(FIRST_SHARE * self.ladder.longest)
            self.fresh = False
            stop = next_after(self.stops, now, self.room)
            seconds = self.ladder.portion(self.rung, stop - now)
            attempt = self.stepper.step(seconds)
            if not attempt.converged:
                self._shorten(now, seconds, attempt)
                retries += 1
                continue
            settled = self.stepper.settled(attempt.found)
            if self.adaptive and not self._exact(settled, seconds):
                continue
            if not self.adaptive and self.rung:
                self.rung -= 1
            lands = now + seconds >= stop - self.room
            yield from self._alarms(now, seconds, settled)
            yield self._accept(stop if lands else now + seconds, settled, retries)
            retries = 0

    # ------------------------------------------------------------------ starts and jumps

    def _start(self) -> None:
        """Begin the march: with the velocity that is given, that of before, or at rest."""
        state = self.problem.state
        motion = state.history.get(MOTION)
        if self.inertia.velocity is not None:
            velocity = initial_velocity(self.problem, self.inertia)
        elif motion is not None and not self._due():
            self.fresh = not motion.length
            self.rung = self.ladder.at_most(motion.length or self.ladder.longest)
            return
        else:
            velocity = np.zeros(self.problem.size) if motion is None else motion.velocity
        # A drive that is elsewhere at once jumps at the start, which takes no step of its own.
        state = self._under_drive(state)
        self.stepper.begin(state, velocity)
        self.problem.commit(self.stepper.base)

    def _due(self) -> dict[str, float]:
        """Factors of the drive at the present time of ramps that are elsewhere."""
        now, factors = self.stepper.now, self.problem.factors
        goals = {name: wave(now) for name, wave in self.drive.items()}
        return {
            name: goal for name, goal in goals.items()
            if abs(goal - factors[name]) > TIME_TOLERANCE * max(1.0, abs(goal))
        }  # fmt: skip

    def _under_drive(self, state: State) -> State:
        """A state under the load that the drive has now; the displacement stays.  Collective."""
        moved = self.problem.under(state, self._due())
        imposed = self.problem.imposed(moved)
        off = np.abs(imposed.values - state.values)[self.stepper.mask]
        largest = float(np.max(off, initial=0.0))
        if self.problem.comm.allreduce(largest, op=MPI.MAX) > JUMPED:
            raise InputError(
                "The drive lets a prescribed displacement jump, for which inertia would need an "
                "infinite force; let it grow by dea.Rise or another wave without a jump."
            )
        return moved

    def _jump(self) -> Iterator[AcceptedStep]:
        """Go to the load of the drive at once, if it is not the present one."""
        if not self._due():
            return
        state = self._under_drive(self.problem.state)
        self.stepper.begin(state, self.stepper.motion.velocity)
        self.problem.commit(self.stepper.base)
        self.fresh = True
        here = self.cursor
        self.cursor = replace(here, step=here.step + 1, size=0.0)
        last = self.is_last and self.stepper.now >= self.march.seconds - self.room
        yield AcceptedStep(self.cursor, "march", self.stepper.base, last=last)

    # ------------------------------------------------------------------ steps

    def _exact(self, settled: State, seconds: float) -> bool:
        """Whether a step is exact enough; chooses the length of the next one, or of the retry."""
        error = self.stepper.motion_error(settled) / self.inertia.tolerance
        if self.stepper.memories:
            known = self.stepper.error(settled, self.stepper.rule(seconds))
            error = max(error, (known or 0.0) / self.march.tolerance)
        allowed = seconds * max(error, 1e-30) ** (-1 / 3)
        if error > 1:
            self.rung = max(self.rung + 1, self.ladder.at_most(allowed))
            if self.ladder.size(self.rung) < self._shortest():
                raise SolverError(
                    f"The estimated error of a step at {self.stepper.now:.9g} s of the march stays "
                    f"{error:.2g} times its tolerance, however short the step; give Inertia or "
                    "March a larger tolerance."
                )
            return False
        used = self.ladder.at_most(seconds * (1 + 1e-9))
        if used <= self.rung:  # else the step was cut short, and tells less of the next one
            self.rung = self.ladder.next_rung(self.rung, allowed)
        return True

    def _shorten(self, now: float, seconds: float, attempt: Attempt) -> None:
        """Halve the next step after one that has failed.

        The longest step that failed tells why: the shortest ones fail by rounding alone.
        """
        if self.failed is None or self.failed[0] != now:
            self.failed = now, seconds, attempt.outcome
        _, longest, why = self.failed
        self.log(
            f"march: no state at {now + seconds:.9g} s ({attempt.outcome.value}, "
            f"{attempt.iterations} Newton iterations); step halved"
        )
        self.rung = max(self.rung + 1, self.ladder.at_most(seconds / 2))
        if self.ladder.size(self.rung) < self._shortest():
            speed = self._speed()
            raise SolverError(
                f"No step from {now:.9g} s of the march could be made, from {longest:.3g} s "
                f"({why.value}) down to {seconds:.3g} s; the body moves at up to {speed:.3g} m/s "
                "there, perhaps in a collapse that nothing stops, and all steps before it are kept."
            )

    def _shortest(self) -> float:
        """Shortest step in s."""
        clock = abs(self.cursor.began + self.stepper.now)
        return max(SHORTEST_STEP_OF_MOTION * self.ladder.longest, CLOCK_STEP * clock)

    def _speed(self) -> float:
        """Largest velocity of a node along an axis in m/s.  Collective."""
        found = np.abs(self.stepper.motion.velocity[self.stepper.mask])
        largest = float(np.max(found, initial=0.0)) * self.problem.scales.length
        return float(self.problem.comm.allreduce(largest, op=MPI.MAX))

    def _alarms(self, now: float, seconds: float, settled: State) -> Iterator[AcceptedStep]:
        """Failures within a step, each as a step of its own."""

        def place(share: float) -> Attempt:
            attempt = self.stepper.step(share * seconds)
            if not attempt.converged:
                return attempt
            return replace(attempt, state=self.stepper.settled(attempt.found))

        for event in self.sentinel.passed(settled, place, {}):
            self.problem.commit(event.state)
            at = now + event.share * seconds
            self.cursor = self._moved(at, self.cursor.size)
            self.log(f"march: {event.name} at {at:.9g} s")
            yield AcceptedStep(self.cursor, "march", event.state, event=event.name)

    def _moved(self, now: float, size: float) -> Cursor:
        share = min(now / self.march.seconds, 1.0)
        return replace(self.cursor, step=self.cursor.step + 1, position=share, size=size)

    def _accept(self, now: float, settled: State, retries: int) -> AcceptedStep:
        self.problem.commit(settled)
        self.stepper.accept(settled, now)
        self.cursor = self._moved(now, self.ladder.size(self.rung))
        last = self.is_last and now >= self.march.seconds - self.room and not self._due()
        return AcceptedStep(self.cursor, "march", settled, retries, last)


def initial_velocity(problem: Problem, inertia: Inertia) -> np.ndarray:
    """Rates of all local values in 1/s at the start of a march.  Collective.

    Raises
    ------
    InputError
        If the velocity has not one finite number for each axis.
    """
    given, axes = inertia.velocity, problem.scene.kinematics.axes
    found = np.zeros(problem.size)
    good = True
    for a, part in enumerate(problem.displacement):
        x = part.space.tabulate_dof_coordinates().T * problem.scales.length
        try:
            values = np.asarray(given(x) if callable(given) else given, dtype=float)
            values = np.broadcast_to(values.T, (x.shape[1], len(axes)))[:, a]
        except (TypeError, ValueError, OverflowError):
            good = False
            break
        good = good and bool(np.isfinite(values).all())
        found[part.dofs] = values / problem.scales.length
    if not problem.comm.allreduce(good, op=MPI.LAND):
        raise InputError(
            "The velocity of Inertia must be one finite number in m/s for each of "
            f"{', '.join(axes)}, or a function of positions that gives such numbers of shape "
            f"({len(axes)}, n)."
        )
    return found
