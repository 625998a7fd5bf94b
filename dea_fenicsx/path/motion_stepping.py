"""Single steps of a motion with inertia, by the generalised-alpha method for constrained motion.

The equation of motion and all constraints hold at the end of each step, with the acceleration A
there.  Displacement u and velocity v follow from an auxiliary acceleration a by Newmark's rules,

    (1 - m) a_new + m a = (1 - f) A_new + f A,
    u_new = u + h v + h^2 [(1/2 - b) a + b a_new],      v_new = v + h [(1 - g) a + g a_new],

    m = (2 r - 1)/(r + 1),  f = r/(r + 1),  g = 1/2 + f - m,  b = (1/2 + g)^2/4,

with r the spectral radius at infinite frequency.  The method is of second order in displacement,
velocity and pressure.  An auxiliary acceleration belongs to a time that lies (m - f) h beside that
of its state, so that it is moved where the length of the step changes.

Sources: J. Chung, G. M. Hulbert, J. Appl. Mech. 60 (1993) 371; M. Arnold, O. Bruels, Multibody
Syst. Dyn. 18 (2007) 185.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from mpi4py import MPI

from dea_fenicsx.drives.waves import Wave
from dea_fenicsx.model.motion import MOTION, Motion
from dea_fenicsx.model.rigid_starts import start_of_parts
from dea_fenicsx.model.state import State
from dea_fenicsx.model.viscous_history import Rule
from dea_fenicsx.path.items import Inertia
from dea_fenicsx.path.time_stepping import Histories, TimeStepper
from dea_fenicsx.solvers.consistent import Start
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.outcome import Attempt

DRIVE_STEP = 1e-4
"""Step by which a drive is differentiated at a start, as a share of the longest step."""


@dataclass(frozen=True)
class Scheme:
    """The constants of the method for a spectral radius.

    Attributes
    ----------
    m, f, g, b
        Shares of old accelerations, and Newmark's constants.
    """

    m: float
    f: float
    g: float
    b: float

    @classmethod
    def of(cls, radius: float) -> Scheme:
        m, f = (2 * radius - 1) / (radius + 1), radius / (radius + 1)
        g = 0.5 + f - m
        return cls(m, f, g, (0.5 + g) ** 2 / 4)

    @property
    def error(self) -> float:
        """Error of u in one step over h^3 times the third derivative."""
        return abs(self.b + (self.m - self.f) / 2 - 1 / 6)

    def scaled(self, motion: Motion, seconds: float) -> np.ndarray:
        """The auxiliary acceleration for a step of another length."""
        if not motion.length:
            return motion.auxiliary
        off = motion.auxiliary - motion.acceleration
        return motion.acceleration + seconds / motion.length * off

    def ahead(self, values: np.ndarray, motion: Motion, seconds: float, drag: float) -> Motion:
        """The inertial forces at the end of a step, as a function of the displacement there."""
        h, a = seconds, self.scaled(motion, seconds)
        past = (self.f * motion.acceleration - self.m * a) / (1 - self.m)
        there = values + h * motion.velocity + h * h * ((0.5 - self.b) * a + self.b * past)
        stiffness = (1 - self.m) / (h * h * self.b * (1 - self.f))
        constant = -stiffness * there
        if drag:
            slope = self.g / (h * self.b)
            rest = motion.velocity + h * (1 - self.g) * a + h * self.g * past
            rest = rest - slope * there
            constant, stiffness = constant + drag * rest, stiffness + drag * slope
        return replace(motion, stiffness=stiffness, constant=constant)

    def landed(
        self, old: np.ndarray, new: np.ndarray, motion: Motion, seconds: float
    ) -> Motion:
        """The motion at the end of a step from old values to new ones."""
        h, a = seconds, self.scaled(motion, seconds)
        v, A = motion.velocity, motion.acceleration
        a_new = ((new - old - h * v) / (h * h) - (0.5 - self.b) * a) / self.b
        v_new = v + h * ((1 - self.g) * a + self.g * a_new)
        A_new = ((1 - self.m) * a_new + self.m * a - self.f * A) / (1 - self.f)
        return Motion(v_new, A_new, a_new, h)


class MotionStepper(TimeStepper):
    """Finds the states of a body in motion at later times.

    Parameters
    ----------
    solver
        The nonlinear solver.
    drive
        The wave of each ramp that is driven.
    began
        Time in s of the problem at which the time of the drive is 0.
    inertia
        How inertia is taken.
    finest
        Length in s that is short for the drive, by which it is differentiated at a start.
    """

    def __init__(
        self, solver: NewtonSolver, drive: Mapping[str, Wave], began: float, inertia: Inertia,
        finest: float,
    ) -> None:  # fmt: skip
        super().__init__(solver, drive, began)
        self.inertia, self.scheme = inertia, Scheme.of(inertia.spectral_radius)
        self.finest = finest
        self.mask = np.zeros(self.problem.size, dtype=bool)
        for part in self.problem.displacement:
            self.mask[part.dofs] = True
        for carrying in self.problem.rigid.carrying(self.problem.size):
            self.mask |= carrying

    @property
    def motion(self) -> Motion:
        """The motion of the last accepted state."""
        found: Motion = self.base.history[MOTION]
        return found

    def rule(self, seconds: float) -> Rule:
        return Rule.BDF2 if self.memories and self.levels > 1 else Rule.EULER

    def target(self, seconds: float, histories: Histories) -> State:
        state = super().target(seconds, histories)
        ahead = self.scheme.ahead(
            self._moving(self.base.values), self.motion, seconds, self.inertia.drag
        )
        return self._remembering(state, {MOTION: ahead})

    def _moving(self, values: np.ndarray) -> np.ndarray:
        """The displacement alone."""
        return np.where(self.mask, values, 0.0)

    def predicted(self, target: State) -> State:
        """By velocity and acceleration; other fields by the polynomial through earlier states."""
        guess = super().predicted(target)
        h, motion = target.time - self.base.time, self.motion
        there = self.base.values + h * motion.velocity + h * h / 2 * motion.acceleration
        return target.with_values(np.where(self.mask, there, guess.values))

    def step(self, seconds: float) -> Attempt:
        return self._solve(self.target(seconds, self.ahead(seconds, self.rule(seconds))))

    def _judged(self, attempt: Attempt, guess: State) -> Attempt:
        """With inertia, a short step has one solution alone."""
        return attempt

    def settled(self, state: State) -> State:
        state = super().settled(state)
        seconds, ahead = state.time - self.base.time, state.history[MOTION]
        there = self._moving(state.values)
        landed = self.scheme.landed(self._moving(self.base.values), there, self.motion, seconds)
        # These are the very forces with which the state was found: in a short step the rounding of
        # an acceleration, which is a second difference, would be an unbalanced force.
        forces = ahead.stiffness * there + ahead.constant
        return self._remembering(state, {MOTION: replace(landed, constant=forces)})

    def begin(self, state: State, velocity: np.ndarray) -> None:
        """Start from a displacement, a velocity and the present load.  Collective."""
        velocity, driven = velocity.copy(), np.zeros(self.problem.size)
        fixed = self.problem.conditions.fixed_values
        local, h = self.now, DRIVE_STEP * self.finest
        on = fixed.fixed & self.mask
        velocity[on] = 0.0
        if parts := self.problem.rigid:  # their unknowns are no displacements, and may be given
            on = on | parts.prescribable(fixed.fixed)
        for name, wave in self.drive.items():
            # The formulas look ahead only, since the drive may have a corner here.
            y0, y1, y2, y3 = (wave(local), *(wave.before(local + k * h) for k in (1, 2, 3)))
            velocity[on] += fixed.base[name][on] * (-1.5 * y0 + 2 * y1 - 0.5 * y2) / h
            driven[on] += fixed.base[name][on] * (2 * y0 - 5 * y1 + 4 * y2 - y3) / h**2
        if parts:
            start_of_parts(
                parts, velocity, driven, state.values, fixed.fixed, self.problem.owned,
                self.problem.comm,
            )  # fmt: skip
        start = Start(self.solver, self.inertia.drag)
        self.restart(start.consistent(state, velocity, driven), jump=True)

    def motion_error(self, settled: State) -> float:
        """Estimated error of a step in the displacement, root mean square, over L.  Collective."""
        new: Motion = settled.history[MOTION]
        jump = new.acceleration - self.motion.acceleration
        wrong = self.scheme.error * new.length**2 * jump[: self.problem.owned]
        mass = self.problem.massive()
        one = self.mask[: self.problem.owned].astype(float)
        sums = np.array([wrong @ mass.times(wrong), one @ mass.times(one)])
        total = self.problem.comm.allreduce(sums, op=MPI.SUM)
        return float(np.sqrt(abs(total[0]) * len(self.problem.displacement) / total[1]))
