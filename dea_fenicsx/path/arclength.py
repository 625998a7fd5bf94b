"""Arc length: a branch of equilibria followed through its limit points.

The load factor f becomes an unknown.  A step of length s along the branch starts from the tangent
(x', f'), and Newton corrects in the plane normal to it:

    R(x, f) = 0,     <x', x - x_0> / U^2 + f' (f - f_0) / F^2 = s.

Each correction takes two solves with one and the same factor, for -R and for -dR/df; the latter is
the exact derivative: fixed values enter through the tangent's columns, dead loads linearly, and its
solution changes little from one state to the next.  What both solves miss along the vector that is
null at a limit point, the plane puts right.

From two points of a branch the cubic with their tangents leads to others, between and beyond: its
error is of fourth order in the arc.
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

from dea_fenicsx.model.problem import Problem
from dea_fenicsx.path.stability import Place, load_derivative
from dea_fenicsx.solvers.newton import LINEARISING, Attempt, NewtonSolver

UNIT_STRETCH = 0.05
"""Displacement that counts as one unit of arc, as a share of the device's size."""

SHORTEST = 2.0**-12
"""Smallest arc before the branch counts as lost."""

FORCING = 1e-6
"""Relative tolerance of the linear solves.

Measured on a film that snaps: with 3e-4, as on ramps, twice as many of Newton's iterations, and no
fewer of Krylov's.
"""

TANGENT = 1e-9
"""The same for a point's tangent, which decides where the next point lies: not on rounding."""

NEAR = 0.1
"""Largest way, as a share of the arc between two points, from their cubic to a state found."""


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
        self._by_load: np.ndarray | None = None

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
        x = self._response(TANGENT)
        if x is None:
            return None
        length = np.sqrt(self.dot(x, 1.0, x, 1.0))
        if along is not None:
            sign = self.dot(x, 1.0, along.direction, along.slope)
        length = np.copysign(length, sign)
        return Point(self.problem.get_state(), self.factor, x / length, 1.0 / length)

    def _response(self, tolerance: float) -> np.ndarray | None:
        """dx/df at the present state, solved for from the last one; None if the solve fails."""
        rhs = -load_derivative(self.solver.tangent, self.rates)
        rest, share = rhs, 1.0
        if self._by_load is not None:
            left = rhs - self.solver.tangent.times(self._by_load)
            squares = self._sum(np.array([left @ left, rhs @ rhs]))
            if squares[0] < squares[1]:
                rest, share = left, float(np.sqrt(squares[0] / squares[1]))
        x = self._by_load
        if share > tolerance:
            x = self.solver.linear_solve(rest, min(tolerance / share, 0.1))
            if x is not None and rest is not rhs:
                x = x + self._by_load
        self._by_load = x
        return x

    def aside(self, state: np.ndarray, factor: float, mode: np.ndarray) -> Point:
        """A bifurcation with its null vector as the direction to go."""
        x = mode[self.problem.free]
        return Point(state, factor, x / np.sqrt(self.dot(x, 0.0, x, 0.0)), 0.0)

    def restore(self, point: Point) -> None:
        """Put the problem into the state of a point."""
        self.set_factor(point.factor)
        self.problem.set_state(point.state)

    def step(self, start: Point, arc: float, end: Point | None = None) -> Attempt:
        """Go an arc along the branch: a guess, then Newton in the plane normal to the start.

        The guess lies on the start's tangent, or on the cubic through another point of the branch.
        """
        problem, solver = self.problem, self.solver
        self.restore(start)
        if end is None:
            self._move(arc * start.direction, arc * start.slope)
        else:
            Cubic.through(self, start, end).put(arc)
        iterations, previous = 0, np.inf
        while True:
            if fault := problem.probe().fault:
                return Attempt(fault, iterations, np.inf)
            residual = problem.residual()
            norm = solver.residual_of(residual)
            if norm <= solver.options.tolerance and (iterations > 0 or end is not None):
                return Attempt("", iterations, norm, problem.probe())
            if iterations == solver.options.max_iterations:
                return Attempt("slow", iterations, norm)
            if not np.isfinite(norm) or (iterations > 3 and norm > 1e3 * previous):
                return Attempt("diverged", iterations, norm)
            solver.notify(LINEARISING)
            r = solver.linear_solve(-problem.unbalanced(residual), FORCING)
            b = self._response(FORCING)
            if r is None or b is None:
                return Attempt(solver.trouble, iterations, norm)
            down = self.dot(r, 0.0, start.direction, start.slope)
            across = self.dot(b, 1.0, start.direction, start.slope)
            change = -down / across
            self._move(r + change * b, change)
            solver.counters.newton += 1
            iterations += 1
            previous = norm

    def advance(
        self, here: Point, arc: float, before: Point | None = None
    ) -> tuple[Attempt, Point | None, str]:
        """Go an arc along the branch: how the step ended, its point, and why it is refused.

        The reason is empty, and there is a point, if the step is accepted.  The cubic through a
        point before this one is followed first, if there is one.
        """
        attempt = self.step(here, arc, before)
        if before is not None and not attempt.converged:
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

    def place(self, start: Point, end: Point, arc: float) -> Place:
        """How to find equilibria at a share of the arc between two points."""
        return lambda share: self.step(start, share * arc, end)

    def _move(self, increment: np.ndarray, change: float) -> None:
        self.problem.add_free(increment)
        self.set_factor(self.factor + change)

    def limit_point(self, start: Point, end: Point, arc: float) -> tuple[Point, float] | None:
        """The point between two others at which the load is stationary, and its arc.

        Illinois rule on df, from where their cubic has its own.
        """
        low, high = (0.0, start.slope), (arc, end.slope)
        scale = max(abs(start.slope), abs(end.slope))
        s = Cubic.through(self, start, end).stationary
        found = None
        for _ in range(30):
            if not self.step(start, s, end).converged:
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
            s = (low[0] * high[1] - high[0] * low[1]) / (high[1] - low[1])
        return found

    def land(self, start: Point, end: Point, wanted: float) -> Attempt:
        """Equilibrium at exactly a load that is passed once between two points."""
        cubic = Cubic.through(self, start, end)
        try:
            s = brentq(lambda x: cubic.load(x) - wanted, 0.0, cubic.arc)
        except ValueError:
            return Attempt("slow", 0, np.inf)
        first = self.step(start, s, end)
        if not first.converged:
            return first
        before, load = self.problem.get_state(), self.factor
        self.set_factor(wanted)
        attempt = self.solver.solve(lift=False)
        moved = (self.problem.get_state() - before)[self.problem.free]
        way = np.sqrt(self.dot(moved, wanted - load, moved, wanted - load))
        return attempt if way < NEAR * cubic.arc else Attempt("jumped", attempt.iterations, np.inf)


@dataclass(frozen=True)
class Cubic:
    """The cubic between two points of a branch that has their tangents.

    Its parameter is the distance from the plane normal to the first point, `arc` that of the
    second, negative if it lies behind; `turn` is the cosine between the tangents.
    """

    branch: Branch
    start: Point
    end: Point
    arc: float
    turn: float

    @classmethod
    def through(cls, branch: Branch, start: Point, end: Point) -> Cubic:
        moved = (end.state - start.state)[branch.problem.free]
        here = start.direction, start.slope
        arc = branch.dot(moved, end.factor - start.factor, *here)
        return cls(branch, start, end, arc, branch.dot(end.direction, end.slope, *here))

    def load(self, s: float) -> float:
        """The load at an arc."""
        far, first, last = _hermite(s / self.arc)
        ends = (1 - far) * self.start.factor + far * self.end.factor
        return float(ends + self.arc * (first * self.start.slope + last * self._last_slope))

    @property
    def _last_slope(self) -> float:
        return self.end.slope / self.turn

    @property
    def stationary(self) -> float:
        """The arc at which the load is, where it grows at one end and falls at the other."""
        rise = (self.end.factor - self.start.factor) / self.arc
        a, b = self.start.slope, self._last_slope

        def slope(t: float) -> float:
            return 6 * t * (1 - t) * rise + (1 - t) * (1 - 3 * t) * a + t * (3 * t - 2) * b

        return float(self.arc * brentq(slope, 0.0, 1.0))

    def put(self, s: float) -> None:
        """Bring the problem to an arc, which is not yet in equilibrium."""
        branch, problem = self.branch, self.branch.problem
        far, first, last = _hermite(s / self.arc)
        problem.set_state((1 - far) * self.start.state + far * self.end.state)
        ways = first * self.start.direction + last / self.turn * self.end.direction
        problem.add_free(self.arc * ways)
        branch.set_factor(self.load(s))


def _hermite(t: float) -> tuple[float, float, float]:
    """Weights of the second value and of the two slopes."""
    return t * t * (3 - 2 * t), t * (1 - t) ** 2, t * t * (t - 1)
