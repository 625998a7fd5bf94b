"""A body that has lost its equilibrium moves at constant load until its damping lets it rest.

The motion begins with no velocity in a state a little way behind the limit point.  The body is at
rest where its speed and its acceleration, both weighted by the mass,

    sqrt(v . M v) <= r max sqrt(v . M v),      sqrt(a . M a) <= r max sqrt(a . M a),

are small shares of the largest ones.  A body with viscous branches must creep slowly as well.  Then
Newton's method finds the equilibrium there, which has to be stable.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.motion import MOTION
from dea_fenicsx.model.state import State
from dea_fenicsx.path.cursor import AcceptedStep, Cursor
from dea_fenicsx.path.events import Sentinel
from dea_fenicsx.path.items import InMotion, March, Response
from dea_fenicsx.path.moving import MotionWalk
from dea_fenicsx.path.relaxing import settle
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.support.errors import SolverError

MOTION_EVENT = "motion"
"""The event of a step on the way from a limit point to the state of rest."""

LONGEST_MOTION = 1e4
"""Longest time of a motion, in units of its time scale 1/omega + drag/omega^2."""

LONGEST_CREEP = 1e5
"""Longest time of a motion, in units of the longest relaxation time."""

FIRST_STEP_OF_MOTION = 0.02
"""First step of a motion, in units of 1/omega."""

SHARE_OF_REST = 0.1
"""The share at which a body is at rest, over that at which it was not in equilibrium."""

SMALLEST_REST = 1e-12
"""Smallest share of the largest speed at which it is asked whether a body is in equilibrium."""

LEAST_DIFFERENCE = 1e-6
"""Two states differ if some displacement differs by more than this share of the device's extent."""


class Fall:
    """Follows one motion from a state that is not in equilibrium to a state of rest.

    Parameters
    ----------
    solver
        The nonlinear solver.
    how
        How the body moves, and when it is at rest.
    response
        How viscous branches take part in the ramp that goes on from the state of rest.
    sentinel, log
        As of `RampWalk`.

    Attributes
    ----------
    trouble
        Why the body has not come to rest, in words; empty if it has.
    """

    def __init__(
        self,
        solver: NewtonSolver,
        how: InMotion,
        response: Response | None,
        sentinel: Sentinel,
        log: Callable[[str], None],
    ) -> None:
        self.solver, self.problem, self.how = solver, solver.problem, how
        self.response, self.sentinel, self.log = response, sentinel, log
        self.trouble = ""
        self.rest = how.rest
        self.fastest = np.zeros(2)
        self.fell = 0.0
        memory = self.problem.forms.memory
        times = memory.relaxation_times() if memory else None
        self.creeping = times[1] if times else 0.0

    def follow(
        self, begin: State, stable: State, landing: State | None, cursor: Cursor
    ) -> Iterator[AcceptedStep]:
        """Yield the steps of the motion, and the state of rest as the last one.

        Parameters
        ----------
        begin
            Where the motion begins, under the load that stays constant.
        stable
            A stable state of the ramp, whose stiffness tells the time scale.
        landing
            The state to which the device snaps statically, or None.
        cursor
            The cursor of the step before.
        """
        omega = self._omega(begin, stable)
        self.problem.commit(begin)
        settle(self.problem)
        start = self.problem.state.time
        seconds = self.how.seconds or self._limit(omega)
        here = replace(cursor, position=0.0, size=FIRST_STEP_OF_MOTION / omega, began=start)
        march = March(seconds, inertia=self.how.inertia)
        walk = MotionWalk(self.solver, march, here, False, self.sentinel, self.log)
        at_rest = None
        try:
            for step in walk.follow():
                here = step.cursor
                yield replace(step, event=step.event or MOTION_EVENT, last=False)
                if not step.event and (at_rest := self._at_rest()):
                    break
        except SolverError as error:
            self.trouble = str(error)
            return
        if at_rest is None:
            self.trouble = (
                f"after {seconds:.3g} s it still moves; give InMotion a longer time or more drag."
            )
            return
        self.fell = at_rest.time - start
        self.problem.commit(at_rest)
        note = {"seconds": self.fell, "static_difference_m": self._difference(landing)}
        here = replace(here, step=here.step + 1)
        yield AcceptedStep(here, "", at_rest, event="snap", note=note)

    def _omega(self, begin: State, stable: State) -> float:
        """Frequency in 1/s of the motion, by the stiffness of a stable state.  Collective.

        It is the root of d . K d / d . M d with the displacement d between the two states.
        """
        problem = self.problem
        along = np.zeros(problem.size)
        for part in problem.displacement:
            along[part.dofs] = (begin.values - stable.values)[part.dofs]
        with problem.at(stable):
            stiff = self.solver.tangent.times_values(along)
        mine = along[: problem.owned]
        work = np.array([stiff @ along[problem.free], mine @ problem.massive().times(mine)])
        work = problem.comm.allreduce(work, op=MPI.SUM)
        return math.sqrt(abs(work[0] / work[1]))

    def _limit(self, omega: float) -> float:
        """Longest time in s that the body has to come to rest."""
        fall = 1 / omega + self.how.inertia.drag / omega**2
        return LONGEST_MOTION * fall + LONGEST_CREEP * self.creeping

    def _at_rest(self) -> State | None:
        """The equilibrium in which the body is at rest now; None while it moves.  Collective."""
        motion, problem = self.problem.motion, self.problem
        assert motion is not None
        mass, found = problem.massive(), []
        for rates in (motion.velocity, motion.acceleration):
            mine = rates[: problem.owned]
            found.append(problem.comm.allreduce(float(mine @ mass.times(mine)), op=MPI.SUM))
        now = np.sqrt(np.maximum(found, 0.0))
        self.fastest = np.maximum(self.fastest, now)
        if (now > self.rest * self.fastest).any():
            return None
        if self.creeping:
            speed = float(np.max(np.abs(motion.velocity[: problem.owned]), initial=0.0))
            if problem.comm.allreduce(speed, op=MPI.MAX) * self.creeping > self.how.rest:
                return None
        rests = self._equilibrium()
        if rests is None:
            self.rest *= SHARE_OF_REST
            if self.rest < SMALLEST_REST:
                raise SolverError("it moves hardly any more, but no stable equilibrium is near.")
        return rests

    def _equilibrium(self) -> State | None:
        """The stable equilibrium at the present state, or None.  Collective."""
        problem, solver = self.problem, self.solver
        moving = problem.state
        memory = problem.forms.memory
        still = {name: h for name, h in moving.history.items() if name != MOTION}
        if memory:
            still[memory.NAME] = still[memory.NAME].ahead(math.inf)
        solver.forget_factor()
        attempt = solver.solve(replace(moving, history=still))
        if not attempt.converged:
            return None
        found = attempt.found
        with problem.at(found):
            solver.refresh_inertia()
        if solver.inertia.excess:
            return None
        if memory and self.response != "relaxed":
            with problem.at(found):
                settled = memory.settled(found.history[memory.NAME], found.time)
            found = replace(found, history={**found.history, memory.NAME: settled})
        return found

    def _difference(self, landing: State | None) -> float | None:
        """Largest difference of the present displacement from a state's, in m.  Collective."""
        if landing is None:
            return None
        problem = self.problem
        dofs = problem.roles.owned(Role.MOTION)
        off = np.abs(problem.state.values[dofs] - landing.values[dofs])
        largest = problem.comm.allreduce(float(np.max(off, initial=0.0)), op=MPI.MAX)
        if largest > LEAST_DIFFERENCE:
            self.log(
                "the body rests elsewhere than where it snaps statically: displacements differ by "
                f"up to {largest * problem.scales.length:.3g} m"
            )
        return largest * problem.scales.length
