"""Arc length: a branch of equilibria followed through its limit points.

The load factor f becomes an unknown.  A step of length s along the branch starts from the tangent
(x', f'), and Newton corrects in the plane normal to it:

    R(x, f) = 0,     <x', x - x_0> / U^2 + f' (f - f_0) / F^2 = s.

Each correction takes two solves with one and the same factor, for -R and for -dR/df; the latter is
the exact derivative: fixed values enter through the tangent's columns, dead loads linearly.
Lengths are measured by displacements, in units U of 5 % stretch, and by the load, in units F of the
first step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from mpi4py import MPI

from dea_fenicsx.scene import Scene
from dea_fenicsx.solver import Attempt, NewtonSolver
from dea_fenicsx.weakform import Problem

UNIT_STRETCH = 0.05
"""Displacement that counts as one unit of arc, as a share of the device's size."""

SHORTEST = 2.0**-12
"""Smallest arc before the branch counts as lost."""


@dataclass(frozen=True)
class Trace:
    """Follow the branch by arc length in one ramp of the scene, through limit points.

    Parameters
    ----------
    what
        Name of the ramp, such as ``"voltage"``.
    first
        Load factor of the first step; negative to start backwards.
    steps
        Most steps that are taken.
    until
        A column of the history and a value: the trace ends when the column crosses the value.
    longest
        Longest step in units of arc, of 5 % stretch each.
    """

    what: str
    first: float = 0.05
    steps: int = 200
    until: tuple[str, float] | None = None
    longest: float = 4.0

    def names(self, scene: Scene) -> tuple[str, ...]:
        return (self.what,)

    def label(self, scene: Scene) -> str:
        return self.what


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
    name
        The ramp whose factor is the load.
    first
        The first step's load factor.
    """

    def __init__(self, solver: NewtonSolver, name: str, first: float) -> None:
        self.solver = solver
        self.problem: Problem = solver.problem
        self.name = name
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

    @property
    def factor(self) -> float:
        return self.problem.factors[self.name]

    def _set_factor(self, factor: float) -> None:
        self.problem.set_factors(self.problem.factors | {self.name: factor})
        self.problem.insert_fixed()

    def point(self, along: Point | None, sign: float = 1.0) -> Point | None:
        """The problem's present state with its tangent, oriented along another point's.

        Without another point the load's change has the given sign.  None if the solve fails.
        """
        tangent = self.solver.assemble()
        rhs = -self.problem.load_derivative(self.name)
        x = self.solver.linear_solve(tangent, rhs, 1e-9)
        if x is None:
            return None
        length = np.sqrt(self.dot(x, 1.0, x, 1.0))
        if along is not None:
            sign = self.dot(x, 1.0, along.direction, along.slope)
        length = np.copysign(length, sign)
        return Point(self.problem.get_state(), self.factor, x / length, 1.0 / length)

    def restore(self, point: Point) -> None:
        """Put the problem into the state of a point."""
        self.problem.set_factors(self.problem.factors | {self.name: point.factor})
        self.problem.set_state(point.state)

    def step(self, start: Point, arc: float) -> Attempt:
        """Go an arc along the branch: tangent predictor, Newton in its normal plane."""
        problem, solver = self.problem, self.solver
        self.restore(start)
        self._move(arc * start.direction, arc * start.slope)
        iterations, previous = 0, np.inf
        while True:
            if not problem.probe().admissible:
                return Attempt("inadmissible", iterations, np.inf)
            residual = problem.residual()
            norm = solver.residual_of(residual)
            if norm <= solver.options.tolerance and iterations > 0:
                return Attempt("", iterations, norm, problem.probe())
            if iterations == solver.options.max_iterations:
                return Attempt("slow", iterations, norm)
            if not np.isfinite(norm) or (iterations > 3 and norm > 1e3 * previous):
                return Attempt("diverged", iterations, norm)
            tangent = solver.assemble()
            r = solver.linear_solve(tangent, -problem.unbalanced(residual), 1e-6)
            b = solver.linear_solve(tangent, -problem.load_derivative(self.name), 1e-6)
            if r is None or b is None:
                return Attempt("linear solver", iterations, norm)
            down = self.dot(r, 0.0, start.direction, start.slope)
            across = self.dot(b, 1.0, start.direction, start.slope)
            change = -down / across
            self._move(r + change * b, change)
            solver.counters.newton += 1
            iterations += 1
            previous = norm

    def _move(self, increment: np.ndarray, change: float) -> None:
        self.problem.add_free(increment)
        self._set_factor(self.factor + change)

    def limit_point(self, start: Point, end: Point, arc: float) -> Point | None:
        """The point between two others at which the load is stationary (Illinois rule on df)."""
        low, high = (0.0, start.slope), (arc, end.slope)
        scale = max(abs(start.slope), abs(end.slope))
        found = None
        for _ in range(30):
            s = (low[0] * high[1] - high[0] * low[1]) / (high[1] - low[1])
            if not self.step(start, s).converged:
                return found
            found = self.point(along=start)
            if found is None or abs(found.slope) < 1e-6 * scale:
                return found
            if found.slope * high[1] < 0:
                low, high = high, (s, found.slope)
            else:
                low, high = (low[0], low[1] / 2), (s, found.slope)
        return found


@dataclass(frozen=True)
class Traced:
    """An accepted point of a trace: what `stepping` makes a step of."""

    factor: float
    arc: float
    direction: float
    attempt: Attempt
    retries: int
    event: str


def trace(
    solver: NewtonSolver,
    item: Trace,
    arc: float,
    sign: float,
    log: Callable[[str], None],
) -> Iterator[Traced | str]:
    """Follow a branch from the problem's state; yields accepted points, then a reason if lost.

    Parameters
    ----------
    solver, item
        The solver, in equilibrium, and what to follow.
    arc, sign
        Length of the first step, and the sign of the load's change along it.
    log
        Called with a line for every retry and every limit point.
    """
    branch = Branch(solver, item.what, item.first)
    here = branch.point(None, sign)
    if here is None:
        yield "linear solver"
        return
    retries = 0
    while True:
        attempt = branch.step(here, arc)
        there = branch.point(along=here) if attempt.converged else None
        if there is None or not _continues(branch, here, there, arc):
            retries += 1
            arc /= 2
            branch.restore(here)
            log(f"{item.what}: arc halved ({attempt.reason or 'turned too sharply'})")
            if arc < SHORTEST:
                yield attempt.reason or "turned too sharply"
                return
            continue
        if here.slope * there.slope < 0:
            kind = "maximum" if here.slope > 0 else "minimum"
            limit = branch.limit_point(here, there, arc)
            if limit is not None:
                branch.restore(limit)
                at = replace(attempt, probe=solver.problem.probe())
                yield Traced(limit.factor, arc, np.sign(limit.slope), at, retries, kind)
                retries = 0
            branch.restore(there)
        grown = 1.5 if attempt.iterations <= 3 else 1.0 if attempt.iterations <= 6 else 0.7
        arc = min(arc * grown, item.longest)
        here = there
        yield Traced(there.factor, arc, np.sign(there.slope), attempt, retries, "")
        retries = 0


def _continues(branch: Branch, here: Point, there: Point, arc: float) -> bool:
    """Whether a step stayed on its branch: neither far off its plane's foot nor turned about.

    The foot of the plane lies at distance `arc`; a point much farther away is on another branch.
    """
    problem = branch.problem
    moved = (there.state - here.state)[problem.free]
    change = there.factor - here.factor
    distance = np.sqrt(branch.dot(moved, change, moved, change))
    turn = branch.dot(here.direction, here.slope, there.direction, there.slope)
    return bool(distance < 1.3 * arc and turn > 0.6)
