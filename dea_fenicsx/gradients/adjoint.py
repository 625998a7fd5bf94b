"""Derivatives of observables at an equilibrium, by the adjoint or the direct method.

The residual R(w, p) of the free unknowns x vanishes at an equilibrium.  For an observable J(w, p)
that is a function of integrals, one solve with the transpose of the tangent K gives a vector m, and
with it the derivative by any number of variables:

    K^T m = (dJ/dx)^T,        dJ/dp = dJ/dp (x fixed) - m . dR/dp.

For another observable the state's own derivative dx/dp = -K^{-1} dR/dp is found for each variable,
and the observable is differenced along it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from dea_fenicsx.gradients.differences import displacement_size, fourth_order, small_step
from dea_fenicsx.gradients.functionals import Functional, functional_of
from dea_fenicsx.gradients.gradient import Gradient
from dea_fenicsx.gradients.kept_forms import KeptForms
from dea_fenicsx.gradients.paired import Paired
from dea_fenicsx.gradients.shapes import distortion, fixed_change, most
from dea_fenicsx.gradients.variables import (
    Coefficients,
    LoadVariable,
    Shape,
    Told,
    Variable,
    larger,
    variables,
)
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import State
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.options import NewtonOptions
from dea_fenicsx.solvers.refinement import solve_to
from dea_fenicsx.support.agreement import bind_alike
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError, SolverError

ADJOINT_TOLERANCE = 1e-10
"""Residual of a linear solve, relative to its right-hand side."""

ROUNDING_UNITS = 4
"""A residual of this number of rounding errors is accepted even if it is above the tolerance."""

LARGEST_ROUNDING = 1e-7
"""Largest relative residual that we accept as an effect of rounding."""

Solve = Callable[[np.ndarray], tuple[np.ndarray, float]]
"""Gives the solution of a linear system with a right-hand side, and its relative residual."""


@dataclass(frozen=True, eq=False)
class Pulled:
    """How a functional depends on the state at fixed variables.

    Attributes
    ----------
    forms
        Forms whose derivatives add up to its own, at fixed factors of the ramps.
    by_factor
        Its derivative by these factors.
    by_state
        Its derivative by the unknowns, over the owned values.
    """

    forms: Sequence[Any]
    by_factor: Mapping[str, float]
    by_state: np.ndarray


class Gradients:
    """Finds derivatives at states of a problem; what is compiled for one serves the others.

    Parameters
    ----------
    problem
        The problem.
    lent
        A solver of the problem that a run needs no more, whose factor serves again; or None.

    Attributes
    ----------
    walks
        What has gone over the steps of a march, by the variables.
    replays
        What goes over the steps of a march again, by the row to which it goes.
    """

    def __init__(self, problem: Problem, lent: NewtonSolver | None = None) -> None:
        self.problem, self._lent = problem, lent
        self._is_plane = problem.mesh.topology.dim < 3
        self._at: State | None = None
        self.kept = KeptForms(problem)
        self._directions: dict[int, Any] = {}
        self._functionals: dict[tuple[int, frozenset[str]], tuple[Any, Functional | None]] = {}
        self.walks: dict[tuple[Told, ...], Any] = {}
        self.replays: dict[int, Any] = {}

    @cached_property
    def solver(self) -> NewtonSolver:
        """What solves: the lent solver in space, and a new one in the plane."""
        # A factor in single precision costs as much in the plane, and many more Krylov iterations.
        # In space a factor costs as much as six Newton iterations, and so the last one is used on.
        if self._lent and not self._is_plane:
            return self._lent
        options = NewtonOptions(factor="whole") if self._is_plane else NewtonOptions()
        return NewtonSolver(self.problem, options)

    def of_observable(
        self, state: State, name: str, observable: Any, to: Iterable[Told]
    ) -> Gradient:
        """The derivatives of an observable at an equilibrium.  Collective.

        Raises
        ------
        InputError
            For an unknown variable, an observable without a derivative, and a step of a march.
        SolverError
            If a linear solve fails, as at a limit point.
        """
        problem = self.problem
        check_static(state)
        found = variables(problem, to)
        with problem.at(state):
            functional = self.functional_by(observable, found)
            measure = bind_alike(problem, name, observable)
            value = measure()
            self.linearise()
            if self._is_plane and state is not self._at:
                # a new one costs less than the Krylov iterations with one of another state
                self.solver.forget_factor()
            self._at = state
            if functional is None:
                slopes, residual = self._direct(state, measure, found)
                return Gradient(name, value, slopes, "direct", residual)
            slopes, residual = self.by_adjoint(functional, found)
        return Gradient(name, value, slopes, "adjoint", residual)

    def functional_by(self, observable: Any, found: Iterable[Variable]) -> Functional | None:
        """The observable as a function of integrals, for some variables; None if it is none.

        Raises
        ------
        InputError
            For an observable that has no derivative, or none by one of the variables.
        """
        functional = self.functional(observable)
        shapes = [one.name for one in found if isinstance(one, Shape)]
        if functional is None and shapes:
            raise InputError(
                f"{type(observable).__name__} has no derivative by {shapes[0]!r}: it is measured "
                "on the mesh as it was; those that are known as integrals are "
                "MeanDisplacement, MeanStretch, Contraction, Area, Charge, Capacitance, "
                "Energy, and the mean or the integral of an Expression."
            )
        if functional is not None and functional.per_period:
            check_height(found, type(observable).__name__)
        return functional

    def linearise(self) -> None:
        """Let the rows of the linear systems be weighed as Newton's method does it."""
        self.solver.residual_of(self.problem.residual())

    def functional(self, observable: Any) -> Functional | None:
        """The observable as a function of integrals, whose forms are kept; None if it is none."""
        loaded = frozenset(name for name, factor in self.problem.factors.items() if factor)
        key = id(observable), loaded  # a capacitance is no such function without a voltage
        if key not in self._functionals:
            self._functionals[key] = observable, functional_of(observable, self.problem)
        return self._functionals[key][1]

    def by_adjoint(
        self, functional: Functional, found: Iterable[Variable], solve: Solve | None = None
    ) -> tuple[dict[str, float], float]:
        """The derivatives of a functional at the present equilibrium, and a residual.  Collective.

        Parameters
        ----------
        functional
            What is derived.
        found
            The variables.
        solve
            Solves with the transpose of the tangent; by default exactly.
        """
        problem = self.problem
        pulled = self.pulled(functional)
        rhs = problem.restrict(pulled.by_state)
        solution, residual = np.zeros(len(problem.free)), 0.0
        if self.kept.total(rhs @ rhs) > 0:
            rhs[problem.circuits.given_rows()] = 0.0
            solution, residual = (solve or self.transposed)(rhs)
        return self.partial(pulled, found, solution), residual

    def pulled(self, functional: Functional) -> Pulled:
        """The derivatives of a functional at fixed variables, in the present state.  Collective."""
        forms, by_factor = functional.weighted(self.problem, self.kept)
        by_state = np.zeros(self.problem.owned)
        for form in forms:
            by_state += self.kept.by_state(form)
        return Pulled(forms, by_factor, by_state)

    def partial(
        self, pulled: Pulled, found: Iterable[Variable], adjoint: np.ndarray
    ) -> dict[str, float]:
        """The derivatives of J - adjoint . R by variables, at fixed free unknowns.  Collective."""
        problem = self.problem
        paired = Paired(self.kept, self.solver.tangent, -adjoint, pulled.forms)
        slopes = {}
        for one in found:
            slope = paired.slope(one)
            if isinstance(one, LoadVariable):
                slope += self.kept.total(pulled.by_state @ self.lifted(one.ramp)) / one.unit
                slope += pulled.by_factor.get(one.ramp, 0.0) / one.unit
            elif isinstance(one, Shape):
                change = fixed_change(problem, one.velocity)
                slope += self.kept.total(pulled.by_state @ self.followed(change))
            slopes[one.name] = slope
        return slopes

    def _direct(
        self, state: State, measure: Any, found: list[Variable]
    ) -> tuple[dict[str, float], float]:
        problem = self.problem
        slopes, worst = {}, 0.0
        for one in found:
            changed, residual = self.solved(-self.forces(one))
            worst = max(worst, residual)
            step = self._step(state, changed, one)

            def value(step: float, one: Variable = one, changed: Any = changed) -> float:
                return self._measured(state, changed, one, step, measure)

            slopes[one.name] = fourth_order(value, step)
            problem.show(state)
        return slopes, worst

    def _step(self, state: State, changed: np.ndarray, one: Variable) -> float:
        """The step of a variable for differences.  Collective."""
        problem = self.problem
        moving = problem.roles.free(Role.MOTION)
        size, speed = displacement_size(problem, state), most(problem, changed[moving])
        value = one.value if isinstance(one, Coefficients) else 0.0
        if isinstance(one, LoadVariable):
            value = problem.factors[one.ramp] * one.unit
        return small_step([(size, speed), (value, 1.0)])

    def _measured(
        self, state: State, changed: np.ndarray, one: Variable, step: float, measure: Any
    ) -> float:
        """The observable where a variable is larger by a step, to first order.  Collective."""
        problem = self.problem
        problem.show(state)
        moved = problem.moved(state, step * changed)
        if isinstance(one, LoadVariable):
            factors = {one.ramp: state.factors[one.ramp] + step / one.unit}
            moved = problem.imposed(problem.under(moved, factors))
            problem.show(moved)
            return float(measure())
        problem.show(moved)
        with larger(problem, one, step):
            return float(measure())

    def forces(self, one: Variable) -> np.ndarray:
        """dR/dp in the free rows.  Collective."""
        problem = self.problem
        if isinstance(one, LoadVariable):
            return self.solver.tangent.by_load(one.ramp) / one.unit
        if isinstance(one, Shape):
            return self._forces_of(one)
        total = np.zeros(problem.owned)
        for coefficient, cells, rate in one.changes:
            total += self._along(coefficient, cells, rate)
        rows = problem.restrict(total)
        rows[problem.circuits.given_rows()] = 0.0
        return rows

    def _forces_of(self, one: Shape) -> np.ndarray:
        """dR/dp of a change of shape, by a formula of fourth order.  Collective.

        Fixed values that depend on the place change with it.
        """
        problem, state = self.problem, self.problem.state
        given = self.followed(fixed_change(problem, one.velocity), everywhere=True)

        def rows(step: float) -> np.ndarray:
            with larger(problem, one, step):
                problem.show(state.with_values(state.values + step * given))
                return problem.restrict(problem.residual())

        found = fourth_order(rows, small_step([(1.0, distortion(problem, one.velocity))]))
        problem.show(state)
        found[problem.circuits.given_rows()] = 0.0
        return found

    def _along(self, coefficient: Any, cells: np.ndarray, rate: float) -> np.ndarray:
        """The residual's derivative by a coefficient that changes in some cells.  Collective."""
        along = self._directions.setdefault(
            id(coefficient), dolfinx.fem.Function(coefficient.function_space)
        )
        along.x.array[:] = 0.0
        along.x.array[cells] = rate
        return self.kept.along(self.problem.forms.residual, coefficient, along)

    def transposed(self, rhs: np.ndarray) -> tuple[np.ndarray, float]:
        """Solve with the transpose of the tangent; see `solved`.  Collective."""
        return self.solved(rhs, transposed=True)

    def solved(self, rhs: np.ndarray, transposed: bool = False) -> tuple[np.ndarray, float]:
        """Solve with the tangent or its transpose; the solution and its residual.  Collective.

        Raises
        ------
        SolverError
            If the solution is not exact enough.
        """
        if self.kept.total(rhs @ rhs) == 0:
            return np.zeros(len(rhs)), 0.0
        solver = self.solver
        if transposed:
            found = solver.solve_transposed(rhs, ADJOINT_TOLERANCE)
        else:
            times = solver.tangent.times
            found = solve_to(rhs, ADJOINT_TOLERANCE, solver.linear_solve, times, self.problem.comm)
        if found is None or not (
            found.residual < 10 * ADJOINT_TOLERANCE
            or found.residual < min(self._rounding(found.values, rhs, transposed), LARGEST_ROUNDING)
        ):
            reached = "none" if found is None else f"{found.residual:.1e}"
            raise SolverError(
                "The derivative was not found: the linear system is singular or nearly so "
                f"(residual {reached}), as at a limit point; take a step away from it."
            )
        return found.values, found.residual

    def _rounding(self, values: np.ndarray, rhs: np.ndarray, transposed: bool) -> float:
        """The residual that rounding the solution leaves, relative to the right-hand side.

        In slender devices it is large: bending moves much, and hardly changes the residual.
        Collective.
        """
        tangent, total = self.solver.tangent, self.kept.total
        times = tangent.times_transposed if transposed else tangent.times
        signs = np.where(np.arange(len(values)) % 2, 1.0, -1.0)
        noise = times(values * (1 + ROUNDING_UNITS * np.finfo(float).eps * signs)) - times(values)
        return float(np.sqrt(total(noise @ noise) / total(rhs @ rhs)))

    def lifted(self, ramp: str) -> np.ndarray:
        """Change of the fixed values with a ramp's factor, over the owned values.  Collective."""
        problem = self.problem
        along = np.zeros(problem.size)
        along[problem.fixed] = problem.conditions.fixed_values.base[ramp][problem.fixed]
        problem.circuits.per_factor(ramp, along)
        return self.followed(along)

    def followed(self, change: np.ndarray, everywhere: bool = False) -> np.ndarray:
        """A change of fixed values with what follows them, over the owned values.  Collective.

        `everywhere` takes all local values.
        """
        problem, along = self.problem, dolfinx.fem.Function(self.problem.W)
        along.x.array[:] = change
        along.x.scatter_forward()
        problem.rigid.follow(along.x.array, problem.w.x.array)
        problem.conditions.ties.follow(along.x.array)
        return np.asarray(along.x.array if everywhere else along.x.array[: problem.owned])


def check_height(found: Iterable[Variable], what: str) -> None:
    """Raise InputError for a change of shape that may alter the height of a periodic cell."""
    for one in found:
        if isinstance(one, Shape) and not one.name.endswith(":r"):
            raise InputError(
                f"{what} has no derivative by {one.name!r}, which may change the height of the "
                "periodic cell; a thickness along r, as 'thickness:film:r', is derived."
            )


def check_static(state: State) -> None:
    """Raise InputError at a step of a march, whose derivative depends on all steps before it."""
    if state.time or state.history:
        raise InputError(
            "The state of this step depends on the steps before it (a march, viscous strains, "
            "charges that move), and so does its derivative; only equilibria without a past are "
            "derived."
        )
