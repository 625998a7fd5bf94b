"""Arc length: a branch of equilibria followed through its limit points.

The load factor f becomes an unknown.  A step of length s along the branch starts from the tangent
(x', f'), and Newton corrects in the plane normal to it:

    R(x, f) = 0,     <x', x - x_0> / U^2 + f' (f - f_0) / F^2 = s.

Each correction needs two linear solves with the same factor, for the right-hand sides -R and
-dR/df.  The derivative dR/df is exact: fixed values enter through the columns of the tangent, and
dead loads are linear in f.  Its solution changes little from one state to the next.  Near a limit
point both solutions have a large error along the null vector of the tangent.  The equation of the
plane determines the combination of the two in which this error cancels.

The cubic through two points of a branch with their tangents predicts other points, see `cubic`.
Displacements are measured in units U of 5 % stretch, the load in units F of the first step.

At a bifurcation the null vector takes the place of the tangent: the plane normal to it intersects
the new branch and not the old one.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import State
from dea_fenicsx.path.cubic import Cubic, Point
from dea_fenicsx.path.guiding import Guide, Products
from dea_fenicsx.path.load_course import BranchLoad
from dea_fenicsx.path.roots import Bracket, root
from dea_fenicsx.path.stability import Place
from dea_fenicsx.solvers.newton import LINEARISING, NewtonSolver
from dea_fenicsx.solvers.outcome import Attempt, Outcome, fault_of

UNIT_STRETCH = 0.05
"""Mean displacement of one unit of arc, as a share of the device's size."""

SHORTEST_ARC = 2.0**-12
"""Smallest step, in units of arc, before we give up the branch."""

BRANCH_SOLVE_TOLERANCE = 1e-6
"""Relative tolerance of the linear solves along a branch.

The tolerance of a ramp would need twice as many Newton iterations here.  See "Measured constants"
in docs/developers/solver.md.
"""

TANGENT_TOLERANCE = 1e-9
"""Relative tolerance of the linear solve for the tangent of a branch.

The next point lies on this tangent, so its error must be small compared with a step.  Where neutral
states are searched for, all solves take it: the error along the null vector is large there, and
would keep Newton's method from converging.
"""

MOST_LANDING_CORRECTION = 0.1
"""Largest correction when a trace lands on a load, as a share of the arc between its neighbours.

A larger correction means that Newton's method has found a state of another branch.
"""


MOST_CUBIC_ERROR = 0.01
"""Largest error of the cubic between two points of one branch, as a share of their arc."""

SHARES_WHERE_SMOOTH = (0.5, 0.3)
"""Where the cubic is compared with the branch.

One of them is enough, for the other may be near a crossing.
"""


class TracedBranch:
    """Steps and tangents along a branch of equilibria.

    Parameters
    ----------
    solver
        The nonlinear solver, whose problem is in equilibrium.
    course
        What the load f is.
    first
        The first step's f.
    """

    def __init__(self, solver: NewtonSolver, course: BranchLoad, first: float) -> None:
        self.solver = solver
        self.problem: Problem = solver.problem
        self.course = course
        self.factor_of = course.factor_of
        self.load_unit = abs(first)
        self.precise = False
        x = self.problem.displacement
        here = [c.space.tabulate_dof_coordinates() for c in x]
        owned = [c.space.dofmap.index_map.size_local for c in x]
        rows = np.concatenate([h[:n, a] for a, (h, n) in enumerate(zip(here, owned, strict=True))])
        count, total, square = self._sum(np.array([len(rows), rows.sum(), (rows**2).sum()]))
        size = np.sqrt(square / count - (total / count) ** 2)
        self.weight = 1.0 / (count * (UNIT_STRETCH * size) ** 2)
        self.u = self.problem.roles.free(Role.MOTION)
        self._by_load: np.ndarray | None = None

    def loaded(self, state: State, factor: float) -> State:
        """A state with the load f and the fixed values of this load.  Its free unknowns stay."""
        return self.course.loaded(state, factor)

    @cached_property
    def products(self) -> Products:
        """The scalar products of motions, by which shapes are told apart."""
        return Products(self.problem)

    def _sum(self, values: np.ndarray) -> np.ndarray:
        return np.asarray(self.problem.comm.allreduce(values, op=MPI.SUM))

    def dot(self, x: np.ndarray, f: float, y: np.ndarray, g: float) -> float:
        """Scalar product of two directions, each a vector of free unknowns and a load."""
        mine = np.array([x[self.u] @ y[self.u]])
        return float(self._sum(mine)[0]) * self.weight + f * g / self.load_unit**2

    def point(
        self, state: State, along: Point | None, sign: float = 1.0, guide: Guide | None = None
    ) -> Point | None:
        """An equilibrium with its tangent, which points forward along the tangent of `along`.

        If `along` is None, the load changes with the given sign.  With a guide, the tangent is that
        of the states that it holds.  None if a solve fails.
        """
        with self.problem.at(state):
            x = self._response(TANGENT_TOLERANCE)
            if guide is not None and x is not None:
                answers = guide.responses()
                x = None if answers is None else guide.along(x, answers)
        if x is None:
            return None
        length = np.sqrt(self.dot(x, 1.0, x, 1.0))
        if along is not None:
            sign = self.dot(x, 1.0, along.direction, along.slope)
        length = np.copysign(length, sign)
        return Point(state, self.factor_of(state), x / length, 1.0 / length)

    def behind(self, state: State, here: Point) -> Point | None:
        """An equilibrium with its tangent, which points towards a later point of the branch."""
        point = self.point(state, None)
        if point is None or self.advanced(point, here) > 0:
            return point
        return Point(state, point.factor, -point.direction, -point.slope)

    def _response(self, tolerance: float) -> np.ndarray | None:
        """dx/df at the present state; None if the solve fails.

        The iteration starts from dx/df of the last state.
        """
        rhs = -self.course.derivative()
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

    def aside(self, state: State, mode: np.ndarray) -> Point:
        """A bifurcation as a point whose tangent is its null vector."""
        x = mode[self.problem.free]
        length = np.sqrt(self.dot(x, 0.0, x, 0.0))
        return Point(state, self.factor_of(state), x / length, 0.0)

    def step(
        self, start: Point, arc: float, end: Point | None = None, guide: Guide | None = None
    ) -> Attempt:
        """Go an arc along the branch: predict a state, then correct it by Newton's method.

        The corrections lie in the plane normal to the tangent at `start`.  The prediction lies on
        this tangent, or on the cubic through `start` and `end` if another point is given.  A guide
        holds some shapes.
        """
        if end is None:
            factor = start.factor + arc * start.slope
            moved = self.problem.moved(start.state, arc * start.direction)
            guess = self.loaded(moved, factor)
        else:
            guess, factor = Cubic.through(self, start, end).guess(arc)
        if guide is not None:
            guide.release()
            guess = guide.held(guess)
        return self.corrected(start, guess, factor, 0 if end is not None else 1, guide)

    def corrected(
        self, start: Point, guess: State, factor: float, at_least: int = 0,
        guide: Guide | None = None,
    ) -> Attempt:  # fmt: skip
        """Newton's method from a state in the plane through it that is normal to a tangent."""
        with self.problem.at(guess):
            return self._correct(start, guess, factor, at_least, guide)

    def _correct(
        self, start: Point, state: State, factor: float, at_least: int, guide: Guide | None
    ) -> Attempt:
        """Newton's method from the present state in the plane normal to a point's tangent."""
        problem, solver = self.problem, self.solver
        iterations, previous = 0, np.inf
        while True:
            if (fault := fault_of(problem.probe())) is not Outcome.CONVERGED:
                return Attempt(fault, iterations, np.inf)
            residual = problem.residual()
            checked = residual if guide is None else guide.balanced(residual)
            norm = solver.residual_of(checked)
            if norm <= solver.options.tolerance:
                # A trial state far off may have had larger load forces, and so a looser test.
                norm = solver.residual_of(checked, anew=True)
            if norm <= solver.options.tolerance and iterations >= at_least:
                return Attempt(Outcome.CONVERGED, iterations, norm, state)
            if iterations == solver.options.max_iterations:
                norm = solver.without_rounding(checked, norm, solver.options.tolerance)
                if norm <= solver.options.tolerance:
                    return Attempt(Outcome.CONVERGED, iterations, norm, state)
                return Attempt(Outcome.SLOW, iterations, norm)
            if not np.isfinite(norm) or (iterations > 3 and norm > 1e3 * previous):
                return Attempt(Outcome.DIVERGED, iterations, norm)
            solver.notify(LINEARISING)
            rows = problem.unbalanced(residual)
            if guide is not None:
                rows = guide.unbalanced(rows)
            tolerance = TANGENT_TOLERANCE if self.precise else BRANCH_SOLVE_TOLERANCE
            r, b = solver.linear_solve(-rows, tolerance), self._response(tolerance)
            if r is None or b is None:
                return Attempt(solver.trouble, iterations, norm)
            if guide is None:
                down = self.dot(r, 0.0, start.direction, start.slope)
                across = self.dot(b, 1.0, start.direction, start.slope)
                change = -down / across
                increment = r + change * b
            else:
                if (answers := guide.responses()) is None:
                    return Attempt(solver.trouble, iterations, norm)
                increment, change = guide.increment(r, b, answers, start)
            factor += change
            state = self.loaded(problem.moved(state, increment), factor)
            problem.show(state)
            solver.counters.newton += 1
            iterations += 1
            previous = norm

    def correction(self, start: Point, guess: State) -> np.ndarray | None:
        """The first increment of Newton's method in the plane normal to a point's tangent.

        It shows how far the branch lies from a state.  dx/df is that of the last state where it was
        asked for, which changes the increment a little.  None if there is none.  Collective.
        """
        problem, solver = self.problem, self.solver
        with problem.at(guess):
            if fault_of(problem.probe()) is not Outcome.CONVERGED:
                return None
            rows = problem.unbalanced(problem.residual())
            r, b = solver.linear_solve(-rows, BRANCH_SOLVE_TOLERANCE), self._by_load
        if r is None or b is None:
            return None
        down = self.dot(r, 0.0, start.direction, start.slope)
        return np.asarray(r - down / self.dot(b, 1.0, start.direction, start.slope) * b)

    def advance(
        self, here: Point, arc: float, before: Point | None = None
    ) -> tuple[Attempt, Point | None]:
        """Go an arc along the branch: how the step ended, and its point if it is accepted.

        The cubic through a point before this one is followed first, if there is one.
        """
        attempt = self.step(here, arc, before)
        if before is not None and not attempt.converged:
            attempt = self.step(here, arc)
        return self.judged(attempt, here, arc)

    def judged(
        self, attempt: Attempt, here: Point, arc: float
    ) -> tuple[Attempt, Point | None]:
        """How a step from a point ended, and its point if it has not left the branch."""
        if not attempt.converged:
            return attempt, None
        there = self.point(attempt.found, along=here)
        if there is None:
            return attempt.refused(self.solver.trouble), None
        objection = self._objection(here, there, arc)
        if objection is not Outcome.CONVERGED:
            return attempt.refused(objection), None
        return attempt, there

    def _objection(self, here: Point, there: Point, arc: float) -> Outcome:
        """Why a step has left its branch; `Outcome.CONVERGED` if it has not.

        The plane of the corrections lies at the distance `arc`.  A point much farther away is on
        another branch, and so may be a point whose tangent has turned by more than 53 degrees.
        """
        moved = (there.state.values - here.state.values)[self.problem.free]
        change = there.factor - here.factor
        distance = np.sqrt(self.dot(moved, change, moved, change))
        turn = self.dot(here.direction, here.slope, there.direction, there.slope)
        if not distance < 1.3 * arc:
            return Outcome.OTHER_BRANCH
        return Outcome.CONVERGED if turn > 0.6 else Outcome.SHARP_TURN

    def advanced(self, start: Point, end: Point) -> float:
        """How far a point lies ahead of another one, along the tangent there."""
        moved = (end.state.values - start.state.values)[self.problem.free]
        return self.dot(moved, end.factor - start.factor, start.direction, start.slope)

    def place(
        self, start: Point, end: Point, arc: float, guide: Guide | None = None
    ) -> Place:
        """A function that finds the equilibrium at a share (0 to 1) of the arc between points."""
        return lambda share: self.step(start, share * arc, end, guide)

    def is_smooth(
        self, start: Point, end: Point, arc: float, guide: Guide | None = None
    ) -> bool:
        """Whether the cubic through two points and their tangents meets the branch in between.

        The cubic's error is of fourth order in the arc.  Between points of two different branches
        the equilibria in between lie off the cubic by a part of the distance of the branches.
        """
        cubic = Cubic.through(self, start, end)
        for share in SHARES_WHERE_SMOOTH:
            guess, factor = cubic.guess(share * arc)
            attempt = self.step(start, share * arc, end, guide)
            if attempt.converged:
                moved = (attempt.found.values - guess.values)[self.problem.free]
                if guide is not None:
                    moved = guide.others(moved)
                change = self.factor_of(attempt.found) - factor
                if np.sqrt(self.dot(moved, change, moved, change)) < MOST_CUBIC_ERROR * arc:
                    return True
        return False

    def limit_point(
        self, start: Point, end: Point, arc: float, guide: Guide | None = None
    ) -> tuple[Point, float] | None:
        """The point between two others at which the load is stationary, and its arc.

        We search the zero of the load's change along the branch.  The search starts at the
        stationary load of the cubic.
        """
        bracket = Bracket((0.0, start.slope), (arc, end.slope))
        scale = max(abs(start.slope), abs(end.slope))
        s = Cubic.through(self, start, end).stationary
        found = None
        for _ in range(30):
            attempt = self.step(start, s, end, guide)
            if not attempt.converged:
                return found
            point = self.point(attempt.found, along=start, guide=guide)
            if point is None:
                return found
            found = (point, s)
            if abs(point.slope) < 1e-6 * scale:
                return found
            bracket.narrow(s, point.slope)
            s = bracket.secant
        return found

    def land(
        self, start: Point, end: Point, wanted: float, guide: Guide | None = None
    ) -> Attempt:
        """Find the equilibrium at a given load, which the branch passes once between two points."""
        cubic = Cubic.through(self, start, end)
        try:
            s = root(lambda x: cubic.load(x) - wanted, 0.0, cubic.arc)
        except ValueError:
            return Attempt(Outcome.SLOW, 0, np.inf)
        first = self.step(start, s, end, guide)
        if not first.converged:
            return first
        change = wanted - self.factor_of(first.found)
        attempt = self.solver.solve(self.loaded(first.found, wanted))
        if not attempt.converged:
            return attempt
        moved = (attempt.found.values - first.found.values)[self.problem.free]
        way = np.sqrt(self.dot(moved, change, moved, change))
        small = way < MOST_LANDING_CORRECTION * cubic.arc
        return attempt if small else attempt.refused(Outcome.JUMPED)
