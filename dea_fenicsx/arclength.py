"""Arc length: a branch of equilibria followed through its limit points.

The load factor f becomes an unknown.  A step of length s along the branch starts from the tangent
(x', f'), and Newton corrects in the plane normal to it:

    R(x, f) = 0,     <x', x - x_0> / U^2 + f' (f - f_0) / F^2 = s.

Each correction takes two solves with one and the same factor, for -R and for -dR/df; the latter is
the exact derivative: fixed values enter through the tangent's columns, dead loads linearly.
Lengths are measured by displacements, in units U of 5 % stretch, and by the load, in units F of the
first step.

At a bifurcation the null vector takes the tangent's place: the plane normal to it meets the new
branch and not the old one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from scipy.optimize import brentq

from dea_fenicsx.solver import LINEARISING, Attempt, NewtonSolver
from dea_fenicsx.stability import Place, load_derivative
from dea_fenicsx.weakform import Problem

UNIT_STRETCH = 0.05
"""Displacement that counts as one unit of arc, as a share of the device's size."""

SHORTEST = 2.0**-12
"""Smallest arc before the branch counts as lost."""


@dataclass(frozen=True)
class Point:
    """A point of the branch: its state, its load factor, and the tangent there (unit length).

    `direction` holds the free unknowns' part; `slope` is df along the branch, 0 at a limit point.
    """

    state: np.ndarray
    factor: float
    direction: np.ndarray
    slope: float


class Branch:
    """Steps and tangents along a branch of equilibria.

    Parameters
    ----------
    solver
        The nonlinear solver, whose problem is in equilibrium.
    rates
        Change of each ramp's factor with the load f.
    first
        The first step's f.
    factor
        The present f.
    """

    def __init__(
        self, solver: NewtonSolver, rates: dict[str, float], first: float, factor: float
    ) -> None:
        self.solver = solver
        self.problem: Problem = solver.problem
        self.rates = rates
        self.factor = factor
        now = self.problem.factors
        self._origin = now | {name: now[name] - rate * factor for name, rate in rates.items()}
        self.load_unit = abs(first)
        x = self.problem.displacement
        here = [c.space.tabulate_dof_coordinates() for c in x]
        owned = [c.space.dofmap.index_map.size_local for c in x]
        rows = np.concatenate([h[:n, a] for a, (h, n) in enumerate(zip(here, owned, strict=True))])
        count, total, square = self._sum(np.array([len(rows), rows.sum(), (rows**2).sum()]))
        size = np.sqrt(square / count - (total / count) ** 2)
        self.weight = 1.0 / (count * (UNIT_STRETCH * size) ** 2)
        self.u = self.problem.free_fields["u"]

    def _sum(self, values: np.ndarray) -> np.ndarray:
        return np.asarray(self.problem.comm.allreduce(values, op=MPI.SUM))

    def dot(self, x: np.ndarray, f: float, y: np.ndarray, g: float) -> float:
        """Scalar product of two directions, each a vector of free unknowns and a load."""
        mine = np.array([x[self.u] @ y[self.u]])
        return float(self._sum(mine)[0]) * self.weight + f * g / self.load_unit**2

    def factors_at(self, factor: float) -> dict[str, float]:
        """Factor of each ramp at a load."""
        moved = {name: self._origin[name] + rate * factor for name, rate in self.rates.items()}
        return self._origin | moved

    def set_factor(self, factor: float) -> None:
        """Set the load and put its fixed values into the state."""
        self.factor = factor
        self.problem.set_factors(self.factors_at(factor))
        self.problem.insert_fixed()

    def point(self, along: Point | None, sign: float = 1.0) -> Point | None:
        """The problem's present state with its tangent, oriented along another point's.

        Without another point the load's change has the given sign.  None if the solve fails.
        """
        x = self.solver.linear_solve(-load_derivative(self.solver.tangent, self.rates), 1e-9)
        if x is None:
            return None
        length = np.sqrt(self.dot(x, 1.0, x, 1.0))
        if along is not None:
            sign = self.dot(x, 1.0, along.direction, along.slope)
        length = np.copysign(length, sign)
        return Point(self.problem.get_state(), self.factor, x / length, 1.0 / length)

    def aside(self, state: np.ndarray, factor: float, mode: np.ndarray) -> Point:
        """A bifurcation with its null vector as the direction to go."""
        x = mode[self.problem.free]
        return Point(state, factor, x / np.sqrt(self.dot(x, 0.0, x, 0.0)), 0.0)

    def restore(self, point: Point) -> None:
        """Put the problem into the state of a point."""
        self.set_factor(point.factor)
        self.problem.set_state(point.state)

    def step(self, start: Point, arc: float) -> Attempt:
        """Go an arc along the branch: tangent predictor, Newton in its normal plane."""
        problem, solver = self.problem, self.solver
        self.restore(start)
        self._move(arc * start.direction, arc * start.slope)
        iterations, previous = 0, np.inf
        while True:
            if fault := problem.probe().fault:
                return Attempt(fault, iterations, np.inf)
            residual = problem.residual()
            norm = solver.residual_of(residual)
            if norm <= solver.options.tolerance and iterations > 0:
                return Attempt("", iterations, norm, problem.probe())
            if iterations == solver.options.max_iterations:
                return Attempt("slow", iterations, norm)
            if not np.isfinite(norm) or (iterations > 3 and norm > 1e3 * previous):
                return Attempt("diverged", iterations, norm)
            solver.notify(LINEARISING)
            r = solver.linear_solve(-problem.unbalanced(residual), 1e-6)
            b = solver.linear_solve(-load_derivative(solver.tangent, self.rates), 1e-6)
            if r is None or b is None:
                return Attempt(solver.trouble, iterations, norm)
            down = self.dot(r, 0.0, start.direction, start.slope)
            across = self.dot(b, 1.0, start.direction, start.slope)
            change = -down / across
            self._move(r + change * b, change)
            solver.counters.newton += 1
            iterations += 1
            previous = norm

    def advance(self, here: Point, arc: float) -> tuple[Attempt, Point | None, str]:
        """Go an arc along the branch: how the step ended, its point, and why it is refused.

        The reason is empty, and there is a point, if the step is accepted.
        """
        attempt = self.step(here, arc)
        there = self.point(along=here) if attempt.converged else None
        if there is None:
            return attempt, None, attempt.reason or self.solver.trouble
        return attempt, there, self._objection(here, there, arc)

    def _objection(self, here: Point, there: Point, arc: float) -> str:
        """Why a step has not stayed on its branch: far off its plane's foot, or turned about.

        The foot of the plane lies at distance `arc`; a point much farther away is on another
        branch.
        """
        moved = (there.state - here.state)[self.problem.free]
        change = there.factor - here.factor
        distance = np.sqrt(self.dot(moved, change, moved, change))
        turn = self.dot(here.direction, here.slope, there.direction, there.slope)
        if not distance < 1.3 * arc:
            return "on another branch"
        return "" if turn > 0.6 else "turned too sharply"

    def place(self, start: Point, arc: float) -> Place:
        """How to find equilibria at a share of an arc behind a point."""
        return lambda share: self.step(start, share * arc)

    def _move(self, increment: np.ndarray, change: float) -> None:
        self.problem.add_free(increment)
        self.set_factor(self.factor + change)

    def limit_point(self, start: Point, end: Point, arc: float) -> tuple[Point, float] | None:
        """The point between two others at which the load is stationary, and its arc.

        Illinois rule on df.
        """
        low, high = (0.0, start.slope), (arc, end.slope)
        scale = max(abs(start.slope), abs(end.slope))
        found = None
        for _ in range(30):
            s = (low[0] * high[1] - high[0] * low[1]) / (high[1] - low[1])
            if not self.step(start, s).converged:
                return found
            point = self.point(along=start)
            if point is None:
                return found
            found = (point, s)
            if abs(point.slope) < 1e-6 * scale:
                return found
            if point.slope * high[1] < 0:
                low, high = high, (s, point.slope)
            else:
                low, high = (low[0], low[1] / 2), (s, point.slope)
        return found

    def land(self, start: Point, arc: float, low: float, high: float, wanted: float) -> Attempt:
        """Equilibrium at exactly a load that is passed once between two arcs behind a point."""

        def miss(s: float) -> float:
            if not self.step(start, s).converged:
                raise _OffBranch
            return self.factor - wanted

        try:
            # near enough for the last correction, which is at the given load
            brentq(miss, low, high, xtol=1e-3 * arc, rtol=1e-3)
        except (_OffBranch, ValueError):
            return Attempt("slow", 0, np.inf)
        self.set_factor(wanted)
        return self.solver.solve(lift=False)


class _OffBranch(Exception):
    """A trial step was lost."""
