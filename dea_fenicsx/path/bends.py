"""Evidence for a step in which a surface closes on an obstacle, opens, or begins to slide on it.

There the path has a bend: its tangent changes at once, and no parabola through earlier states leads
over it.  A step with one bend is a straight way along the tangent at its start, followed by one
along the tangent at its end.  States half-way on both parts prove it.

Where a contact that is there grows, the tangent changes little by little.  Then the mean of the
tangents at both ends leads from one state to the other, and no state half-way is needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.state import State
from dea_fenicsx.path.predictor import Predictor
from dea_fenicsx.path.stability import path_slope
from dea_fenicsx.solvers.newton import NewtonSolver

MOST_DISTANCE = 0.25
"""Largest distance of a state from the bent way, as a share of the motion there."""

NEAR = 0.1
"""Distance of a state from the bent way, as a share of the whole motion, that is always allowed.

Where the contact grows behind the bend, the corner is rounded.  A short straight part then lies off
the path by much of its own length, but by little of the whole motion.
"""

SLOPE_TOLERANCE = 1e-8
"""Relative tolerance of the linear solves for both tangents.

A looser one leaves a large error in the bending of thin parts, and so in the bent way.
"""

SHORT = 0.05
"""Motion along a straight part, as a share of the whole motion, that needs no state half-way."""

BEND_TOLERANCE = 1e-6
"""Newton's tolerance for the states between."""


def contact_changes(solver: NewtonSolver, first: State, second: State) -> bool:
    """Whether the points that are pressed, or slide, are others in two states.  Collective."""
    if not solver.problem.forms.contacts:
        return False
    before, after = (_touching(solver, state) for state in (first, second))
    return bool(solver.problem.comm.allreduce(bool(np.any(before != after)), op=MPI.LOR))


def contact_begins(solver: NewtonSolver, first: State, second: State) -> bool:
    """Whether a point is pressed in one of two states, and none in the other.  Collective."""
    if not solver.problem.forms.contacts:
        return False
    mine = [bool(np.any(_touching(solver, state))) for state in (first, second)]
    before, after = (solver.problem.comm.allreduce(one, op=MPI.LOR) for one in mine)
    return bool(before != after)


def _touching(solver: NewtonSolver, state: State) -> np.ndarray:
    """What `ContactForms.touching` tells of a state, on this rank."""
    with solver.problem.at(state):
        return solver.problem.forms.contacts.touching()


@dataclass(frozen=True)
class Bend:
    """A way between two equilibria with one bend.

    Attributes
    ----------
    predictor
        Measures motions.
    first, last
        The two equilibria.
    forward, backward
        The end of the step along the tangent at the first state, and its start along the tangent at
        the last one.
    share
        Where the bend lies, as a share of the step.
    """

    predictor: Predictor
    first: State
    last: State
    forward: State
    backward: State
    share: float

    @classmethod
    def between(
        cls, solver: NewtonSolver, predictor: Predictor, first: State, last: State
    ) -> Bend | None:
        """The bend that fits best; None if a tangent cannot be computed.  Collective."""
        problem = solver.problem
        rates = {name: last.factors[name] - f for name, f in first.factors.items()}
        slopes = [
            path_slope(solver, state, rates, SLOPE_TOLERANCE) for state in (first, last)
        ]
        if slopes[0] is None or slopes[1] is None:
            return None
        ends = problem.moved(first, slopes[0]), problem.moved(last, -slopes[1])
        forward = problem.imposed(problem.under(ends[0], last.factors))
        backward = problem.imposed(problem.under(ends[1], first.factors))
        dofs = problem.roles.owned(Role.MOTION)
        ways = (forward.values - first.values)[dofs], (last.values - backward.values)[dofs]
        rest = (last.values - first.values)[dofs] - ways[1]
        differ = ways[0] - ways[1]
        sums = problem.comm.allreduce(np.array([rest @ differ, differ @ differ]), op=MPI.SUM)
        share = float(np.clip(sums[0] / sums[1], 0.0, 1.0)) if sums[1] > 0 else 0.5
        return cls(predictor, first, last, forward, backward, share)

    def at(self, share: float) -> State:
        """The state on the bent way at a share of the step."""
        start, end = self.first.values, self.last.values
        if share <= self.share:
            values = start + share * (self.forward.values - start)
        else:
            values = end - (1 - share) * (end - self.backward.values)
        problem = self.predictor.problem
        factors = self.first.factors.mixed(share, self.last.factors)
        return problem.imposed(problem.under(self.first.with_values(values), factors))

    def is_gentle(self, usual: float) -> bool:
        """Whether the mean of both tangents leads from one state to the other.  Collective.

        Then the tangent changes little by little on the way, as where a contact grows, and both
        ends agree about the way between them: no state half-way is needed.  A state of another
        branch lies off this way by the size of the jump.  `usual` is as of `is_followed`.
        """
        if self.predictor.speed(self.first, self.forward) > usual:
            return False
        start, end = self.first.values, self.last.values
        mean = (self.forward.values - start + end - self.backward.values) / 2
        missed = self.first.with_values(end - mean)
        moved = self.predictor.moved(self.first, self.last)
        return self.predictor.moved(self.first, missed) <= MOST_DISTANCE * moved

    def is_followed(self, solver: NewtonSolver, usual: float) -> bool:
        """Whether the path follows it, as states half-way on both sides show.  Collective.

        Parameters
        ----------
        solver
            The nonlinear solver.
        usual
            Largest speed (displacement per load coordinate) at the beginning of the step; inf for
            no limit.  Towards a limit point the speed grows, and a jump lies ahead.
        """
        predictor = self.predictor
        moved = predictor.moved(self.first, self.last)
        if predictor.speed(self.first, self.forward) > usual:
            return False
        reach = self.forward.values - self.first.values, self.last.values - self.backward.values
        gap = self.last.values - self.first.values
        gap = gap - self.share * reach[0] - (1 - self.share) * reach[1]
        if predictor.moved(self.first, self.first.with_values(self.first.values + gap)) > (
            MOST_DISTANCE * moved
        ):
            return False
        corner = self.at(self.share)
        return self._passes(solver, self.share / 2, predictor.moved(self.first, corner)) and (
            self._passes(solver, (1 + self.share) / 2, predictor.moved(corner, self.last))
        )

    def _passes(self, solver: NewtonSolver, share: float, way: float) -> bool:
        """Whether an equilibrium lies near the bent way at a share of the step.

        `way` is the motion along the straight part in which it lies.
        """
        predictor = self.predictor
        whole = predictor.moved(self.first, self.last)
        if way <= SHORT * whole:
            return True
        guess = self.at(share)
        attempt = solver.solve(guess, None, BEND_TOLERANCE, patient=True)
        if not attempt.converged:
            return False
        return predictor.moved(guess, attempt.found) <= max(MOST_DISTANCE * way, NEAR * whole)
