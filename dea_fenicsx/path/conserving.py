"""Steps of a motion that keep energy, momentum and angular momentum, by the midpoint rule.

With the mean forces f of a step, see `mean_forces`,

    (v_1 + v_0)/2 = (u_1 - u_0)/h,      M (v_1 - v_0)/h + f + d M (u_1 - u_0)/h = 0.

The product of the two equations says that the kinetic energy changes by the work of -f, which is
minus the change of the total potential energy.  It is of second order in u and v.  The pressure of
the step itself belongs to its middle, so that the one at its end follows from the equation of
motion there, as at the start of a motion.

Sources: J. C. Simo, N. Tarnow, Z. angew. Math. Phys. 43 (1992) 757; O. Gonzalez, Comput. Methods
Appl. Mech. Engrg. 190 (2000) 1763.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.drives.waves import Wave
from dea_fenicsx.model.motion import MOTION, Motion
from dea_fenicsx.model.rigid_starts import start_of_parts
from dea_fenicsx.model.state import State
from dea_fenicsx.path.items import Inertia
from dea_fenicsx.path.motion_stepping import MotionStepper, Scheme
from dea_fenicsx.solvers.consistent import Start
from dea_fenicsx.solvers.mean_steps import MeanSteps
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.outcome import Attempt


@dataclass(frozen=True)
class Midpoint(Scheme):
    """The midpoint rule.  The auxiliary acceleration is that of the middle of a step."""

    @property
    def error(self) -> float:
        return 1 / 12

    def ahead(self, values: np.ndarray, motion: Motion, seconds: float, drag: float) -> Motion:
        stiffness = 2 / seconds**2 + drag / seconds
        constant = -stiffness * values - 2 / seconds * motion.velocity
        return replace(motion, stiffness=stiffness, constant=constant)

    def landed(
        self, old: np.ndarray, new: np.ndarray, motion: Motion, seconds: float
    ) -> Motion:
        velocity = 2 / seconds * (new - old) - motion.velocity
        middle = (velocity - motion.velocity) / seconds
        # The acceleration at the end, by a line through those of the middles of two steps.
        off = middle - motion.auxiliary
        there = middle + seconds / (seconds + motion.length) * off
        return Motion(velocity, there, middle, seconds)


class ConservingStepper(MotionStepper):
    """Finds the states of a body in motion by the energy-conserving scheme.

    The parameters are those of `MotionStepper`.
    """

    def __init__(
        self, solver: NewtonSolver, drive: Mapping[str, Wave], began: float, inertia: Inertia,
        finest: float,
    ) -> None:  # fmt: skip
        super().__init__(solver, drive, began, inertia, finest)
        self.scheme = Midpoint(0.0, 0.0, 0.5, 0.25)
        self._steps, self._ends = MeanSteps(solver), Start(solver, inertia.drag)

    def settled(self, state: State) -> State:
        """The end of a step with the acceleration and the pressure that belong to it.

        Its velocity is that of the scheme, of which nothing may be taken.
        """
        base, seconds = self.base, state.time - self.base.time
        old, new = (self._moving(values) for values in (base.values, state.values))
        landed = self.scheme.landed(old, new, self.motion, seconds)
        fixed = self.problem.conditions.fixed_values.fixed
        driven, velocity = np.where(fixed, landed.acceleration, 0.0), landed.velocity
        if parts := self.problem.rigid:
            velocity = velocity.copy()
            start_of_parts(
                parts, velocity, driven, state.values, fixed, self.problem.owned, self.problem.comm
            )
        there = self._ends.consistent(state, velocity, driven, corrected=False)
        motion = replace(
            there.history[MOTION], velocity=landed.velocity, auxiliary=landed.auxiliary,
            length=seconds,
        )  # fmt: skip
        return self._remembering(there, {MOTION: motion})

    def _solve(self, target: State, near: State | None = None) -> Attempt:
        attempt = self._steps.solve(self.base, self.predicted(target))
        return attempt if attempt.converged else self._steps.solve(self.base, target)
