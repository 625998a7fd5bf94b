"""A path in time: steps of BDF2 whose size follows an error estimate, or is fixed.

Sizes are taken from a fixed ladder, so that rounding on another number of ranks does not choose
others.  A step lands on corners of the drive and on asked times.  A step that fails is halved; it
is no verdict.

The local error of a step is estimated from the difference between the viscous strains and the
parabola through the three values before.  With the third derivative y''' and steps h, h1, h2 (the
newest first) BDF2 is wrong by E y''' and the parabola by -P y''',

    E = h^2 (h + h1)^2 / (6 (2 h + h1)),    P = h (h + h1)(h + h1 + h2) / 6,

so that the error of BDF2 is E/(E + P) of the difference.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.drives.waves import Wave
from dea_fenicsx.model.state import State
from dea_fenicsx.model.viscous_history import ViscousHistory
from dea_fenicsx.solvers.newton import NewtonSolver

RUNG = math.sqrt(2.0)
"""Ratio of neighbouring sizes on the ladder; BDF2 is stable up to a growth of 2.41."""

SAFETY = 0.8
"""Share of the step that the error estimate allows."""

GROWTH_MARGIN = 1.2
"""The step grows by a rung only if the estimate allows this many times the larger size."""


@dataclass(frozen=True)
class Ladder:
    """The sizes of steps: the longest one over powers of sqrt(2).

    Attributes
    ----------
    longest
        In s.
    """

    longest: float

    def size(self, rung: int) -> float:
        """Size in s of a rung; rung 0 is the longest."""
        return self.longest * RUNG**-rung

    def at_most(self, seconds: float) -> int:
        """The rung of the longest size that is not longer than this."""
        return max(0, math.ceil(math.log(self.longest / seconds) / math.log(RUNG) - 1e-9))

    def next_rung(self, rung: int, allowed: float) -> int:
        """The rung after a step whose error allows a size, at most two rungs up."""
        wanted = SAFETY * allowed
        if wanted < self.size(rung):
            return self.at_most(wanted)
        for up in (2, 1):
            if rung >= up and wanted > GROWTH_MARGIN * self.size(rung - up):
                return rung - up
        return rung


def estimate(new: ViscousHistory) -> np.ndarray | None:
    """Estimated error of the newest viscous strains, like them; None with too short a history.

    With two values before, the step was one of Euler from rest or after a jump, and the difference
    to the straight line is compared; with one there is none.
    """
    times, strains = new.times, new.strains
    if len(times) < 3:
        return None
    h, h1 = times[0] - times[1], times[1] - times[2]
    if len(times) == 3:
        line = strains[1] + h / h1 * (strains[1] - strains[2])
        return np.asarray((strains[0] - line) * h / (2 * h + h1))
    h2 = times[2] - times[3]
    weights = _lagrange(np.array(times[1:4]), times[0])
    parabola = sum(w * s for w, s in zip(weights, strains[1:4], strict=True))
    wrong = h**2 * (h + h1) ** 2 / (6 * (2 * h + h1))
    off = h * (h + h1) * (h + h1 + h2) / 6
    return np.asarray((strains[0] - parabola) * wrong / (wrong + off))


def _lagrange(nodes: np.ndarray, x: float) -> np.ndarray:
    others = [np.delete(nodes, k) for k in range(len(nodes))]
    return np.array([np.prod((x - o) / (n - o)) for n, o in zip(nodes, others, strict=True)])


class Stepper:
    """Makes single steps in time of a problem.

    Parameters
    ----------
    solver
        The nonlinear solver.
    drive
        The wave of each ramp that is driven.
    start
        Time in s of the problem at which the drive's time is 0.
    """

    def __init__(
        self, solver: NewtonSolver, drive: Mapping[str, Wave], start: float = 0.0
    ) -> None:
        self.solver, self.problem = solver, solver.problem
        self.drive, self.start = drive, start
        self.known: list[State] = [self.problem.state]

    def trial(self, state: State, time: float, span: float) -> State:
        """A state that is to be solved for at a later time, with the values of another one."""
        memory = self.problem.forms.memory
        history = state.history[memory.NAME]
        local = time - self.start
        moved = self.problem.under(
            state, {name: wave.before(local) for name, wave in self.drive.items()}
        )
        told = {**moved.history, memory.NAME: replace(history, span=span)}
        return replace(moved, time=time, history=told)
