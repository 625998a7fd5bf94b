"""How a body in motion changes with a variable, over one step of the generalised-alpha method.

The rules of the method are linear in displacements, velocities and accelerations, so that their
changes follow the same rules.  A motion starts with an acceleration, a pressure and a potential
that follow from the displacement and the load (`solvers.consistent`); these are differenced.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.drives.scaled import ScaledWave
from dea_fenicsx.gradients.differences import fourth_order
from dea_fenicsx.gradients.variables import LoadVariable, Variable
from dea_fenicsx.model.motion import MOTION, Motion
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import State
from dea_fenicsx.path.cursor import Cursor
from dea_fenicsx.path.motion_stepping import Scheme
from dea_fenicsx.path.moving import MotionWalk
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.support.errors import SolverError

SAME_FORCES = 1e-5
"""Relative difference of inertial forces that counts as none, where a step is gone over again."""

MOTION_ARRAYS = ("velocity", "acceleration", "auxiliary", "constant")
"""The arrays of a motion."""


def driven(item: Any, one: Variable, step: float) -> Any:
    """A march with inertia whose drive of a load is larger by a step of the load."""
    if not isinstance(one, LoadVariable) or one.ramp not in item.drive:
        return item
    wave = ScaledWave(item.waves[one.ramp], 1 + step / one.unit)
    return replace(item, drive={**item.drive, one.ramp: wave})


def started(solver: NewtonSolver, state: State, item: Any, began: float, jumps: bool) -> State:
    """The state in which a motion starts, or goes on after a jump of its drive.  Collective.

    The problem is left in it.
    """
    solver.problem.show(state)
    walk = MotionWalk(solver, item, Cursor(began=began), False, None, lambda _: None)  # type: ignore[arg-type]
    if jumps:
        for _ in walk._jump():
            pass
    else:
        walk._start()
    found: State = walk.stepper.base
    return found


def differenced(find: Callable[[float], State], step: float) -> tuple[np.ndarray, Motion]:
    """The derivative of a state's values and motion, by a formula of fourth order.  Collective."""
    lengths: list[int] = []
    seconds = 0.0

    def arrays(step: float) -> np.ndarray:
        nonlocal seconds
        state = find(step)
        motion: Motion = state.history[MOTION]
        parts = [state.values, *(getattr(motion, name) for name in MOTION_ARRAYS)]
        lengths[:], seconds = [len(part) for part in parts], motion.length
        return np.concatenate(parts)

    slope = fourth_order(arrays, step)
    values, v, a, b, d = np.split(slope, np.cumsum(lengths)[:-1])
    return values, Motion(v, a, b, seconds, constant=d)


class MotionChanges:
    """The changes of motions over steps.

    Parameters
    ----------
    problem
        The problem.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.mask = np.zeros(problem.size, dtype=bool)
        for part in problem.displacement:
            self.mask[part.dofs] = True

    def moving(self, values: np.ndarray) -> np.ndarray:
        """The displacement alone."""
        return np.where(self.mask, values, 0.0)

    def ahead(self, base: State, state: State, item: Any) -> Motion:
        """The inertial forces of a step, as a function of the displacement at its end.  Collective.

        Raises
        ------
        SolverError
            If a state was not found from the base.
        """
        motion: Motion = state.history[MOTION]
        inertia = item.moving
        scheme = Scheme.of(inertia.spectral_radius)
        found = scheme.ahead(
            self.moving(base.values), base.history[MOTION], motion.length, inertia.drag
        )
        assert motion.constant is not None
        assert found.constant is not None
        due = found.stiffness * self.moving(state.values) + found.constant
        sizes = [
            self.problem.comm.allreduce(float(np.max(np.abs(a), initial=0.0)), op=MPI.MAX)
            for a in (due - motion.constant, due, found.stiffness * self.moving(state.values))
        ]
        if sizes[0] > SAME_FORCES * max(sizes[1:]):
            raise SolverError(
                f"The step at {state.time:.9g} s follows one that is not recorded, so that its "
                "derivative cannot be found."
            )
        return found

    def pushed(self, item: Any, seconds: float, values: np.ndarray, change: Motion) -> np.ndarray:
        """The change of d in the inertial forces M (c u + d), from changes before the step."""
        inertia = item.moving
        scheme = Scheme.of(inertia.spectral_radius)
        found = scheme.ahead(self.moving(values), change, seconds, inertia.drag).constant
        assert found is not None
        return found

    def forces(self, pushed: np.ndarray) -> np.ndarray:
        """The change of the residual by that of d, in the free rows.  Collective."""
        problem = self.problem
        return problem.restrict(problem.massive().times(pushed[: problem.owned]))

    def landed(
        self, item: Any, ahead: Motion, seconds: float, ends: tuple[np.ndarray, np.ndarray],
        change: Motion, pushed: np.ndarray,
    ) -> Motion:  # fmt: skip
        """The change of the motion at the end of a step; `ends` are those of the values."""
        scheme = Scheme.of(item.moving.spectral_radius)
        old, new = (self.moving(values) for values in ends)
        found = scheme.landed(old, new, change, seconds)
        return replace(found, constant=ahead.stiffness * new + pushed)


def moved(motion: Motion, change: Motion, step: float) -> Motion:
    """A motion that is changed."""
    parts = {name: getattr(motion, name) + step * getattr(change, name) for name in MOTION_ARRAYS}
    return replace(motion, **parts)
