"""Derivatives of the loads of events: of buckling, breakdown, loss of tension, a stretch limit.

An event is where a function g(x, f, p) vanishes on the path R(x, f, p) = 0 of equilibria under a
load f.  With K^T m = (dg/dx)^T the derivative of its load is

    df/dp = - (dg/dp - m . dR/dp) / (dg/df - m . dR/df).

For a failure g is its margin at the point where it is least.  At a bifurcation g = w . K w, with
the null vector w of the tangent K.  There K is singular.  The equation for m has a solution if
(dg/dx) . w = 0, which says that both directions of buckling are alike.  A variable with
w . dR/dp = 0 leaves the bifurcation in being; another one is an imperfection, under which there is
none (W. T. Koiter, On the stability of elastic equilibrium, 1945).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl

from dea_fenicsx.gradients.adjoint import Gradients, check_static
from dea_fenicsx.gradients.failure_margins import PointMargin
from dea_fenicsx.gradients.functionals import Functional
from dea_fenicsx.gradients.gradient import Gradient
from dea_fenicsx.gradients.paired import Paired
from dea_fenicsx.gradients.variables import (
    Coefficients,
    LoadVariable,
    Told,
    Variable,
    variables,
)
from dea_fenicsx.measure.failures import FailureMode, Gauge
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.state import State
from dea_fenicsx.path.stability import CriticalEigenvalue
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError, SolverError

EVENTS = {
    "buckling": "bifurcation",
    "breakdown": "electrical breakdown",
    "electrical breakdown": "electrical breakdown",
    "loss of tension": "loss of tension",
    "stretch limit": "stretch limit",
}
"""What one asks for, and what the event is called in the history."""

ALIKE = 1e-6
"""Relative difference of derivatives that counts as none."""

SYMMETRIC = 1e-4
"""Cosine of two vectors that counts as 0 at a bifurcation, whose null vector is known to 1e-7."""

LEAST = 1e-9
"""A dimensionless force that counts as none."""

ROUNDS = 3
"""Most steps of Newton's rule from the located event to the load at which g vanishes."""

AT_ONCE = 1e-5
"""Difference of the loads of two modes, relative to the load, below which they buckle at once."""

INVERSE_STEPS = 30
"""Most inverse iterations for the second mode; few are needed where it is a null vector."""

CLOSE = 1e-11
"""Change of the load, relative to that of the path, at which this rule ends."""

LOAD = "the load of the path"


@dataclass(frozen=True)
class Asked:
    """What is asked for: the name of the event, the variables, and the failures of the run."""

    name: str
    to: Iterable[Told]
    failures: Sequence[FailureMode]


def event_row(history: Sequence[Mapping[str, Any]], name: str, step: int) -> int:
    """The row of an event in a history: the first one by default.

    Raises
    ------
    InputError
        If there is none.
    """
    event = EVENTS[name]
    rows = [k for k, row in enumerate(history) if row["event"] == event]
    if not rows:
        how = (
            'solve with stability="every"' if event == "bifurcation"
            else "let the load grow further, and watch for it by failures="
        )  # fmt: skip
        raise InputError(
            f"The run has no event {event!r}, so that there is no load of it to derive; {how}."
        )
    if step >= 0 and step not in rows:
        raise InputError(
            f"step={step} is no event {event!r}; the run has some at the steps "
            f"{', '.join(map(str, rows))}."
        )
    return step if step >= 0 else rows[0]


def event_load(
    gradients: Gradients, state: State, row: Mapping[str, Any], asked: Asked
) -> Gradient:
    """The derivatives of the load of an event.  Collective.

    Parameters
    ----------
    gradients
        What derives.
    state, row
        The state of the event, and its row of the history.
    asked
        What is asked for.

    Returns
    -------
    Gradient
        In V, or by the factor of a ramp that drives no voltage.  Its value is the load at which
        the event's condition holds to rounding, which the path has located to about 1e-8.

    Raises
    ------
    InputError
        For an unknown variable, the load itself, a path that moves several loads at once, and
        where a derivative does not exist.
    SolverError
        If a linear solve fails.
    """
    problem, ramp = gradients.problem, str(row["ramp"])
    check_static(state)
    if ramp not in problem.scene.ramps:
        raise InputError(
            f"The event lies where the ramps {ramp} move together, so that its load is not one "
            "number; derive it on a path whose last item moves one of them."
        )
    told = [asked.to] if isinstance(asked.to, Told) else list(asked.to)
    strength, rest = _strengths(gradients, told)
    found = variables(problem, rest) if rest or not strength else []
    if any(isinstance(one, LoadVariable) and one.ramp == ramp for one in found):
        raise InputError(
            f"{ramp!r} is the load of the event itself, so that its derivative by it says nothing; "
            "leave it out of to=."
        )
    unit = problem.scene.unit_volts.get(ramp, 0.0) or 1.0
    with problem.at(state):
        kind = _Buckling if EVENTS[asked.name] == "bifurcation" else _Failing
        event = kind(gradients, ramp, asked)
        factor, slopes, residual = event.derived(state, found, strength)
    names = [one if isinstance(one, str) else one.name for one in told]
    return Gradient(
        asked.name, factor * unit, {name: slopes[name] * unit for name in names}, "adjoint",
        residual,
    )  # fmt: skip


def _strengths(
    gradients: Gradients, told: Sequence[Told]
) -> tuple[dict[str, str], list[Told]]:
    """Regions whose breakdown field is a variable, by its name, and the other variables."""
    laws = {
        f"{name}.electric.breakdown": name
        for name, material in gradients.problem.scene.materials.items()
        if material.is_dielectric and material.dielectric.breakdown_law() is not None
    }
    chosen = {one: laws[one] for one in told if isinstance(one, str) and one in laws}
    return chosen, [one for one in told if not isinstance(one, str) or one not in chosen]


class _Event(ABC):
    """A condition g = 0 on a path, with its derivatives at states near to where it holds.

    Parameters
    ----------
    gradients
        What derives.
    ramp
        The ramp of the path.

    Attributes
    ----------
    shared
        Why more than one value belongs to the condition, in words.
    """

    shared = "two principal values are equal there"

    def __init__(self, gradients: Gradients, ramp: str) -> None:
        self.gradients, self.problem, self.ramp = gradients, gradients.problem, ramp

    @abstractmethod
    def conditions(self) -> list[Functional]:
        """g near the present state, and what must change as it does.  Collective."""

    def solve(self, rhs: np.ndarray) -> tuple[np.ndarray, float]:
        """Solve with the transpose of the tangent.  Collective."""
        return self.gradients.transposed(rhs)

    def check(self, found: Iterable[Variable]) -> None:  # noqa: B027  (most have all derivatives)
        """Raise InputError for a variable without a derivative.  Collective."""

    def strength_slope(self, region: str) -> float:
        """dg/dE_b by the breakdown field of a region."""
        return 0.0

    def derived(
        self, state: State, found: list[Variable], strength: Mapping[str, str]
    ) -> tuple[float, dict[str, float], float]:
        """Factor of the load, its derivatives, and a residual.  Collective."""
        problem, gradients = self.problem, self.gradients
        load = LoadVariable(LOAD, self.ramp, 1.0)
        for _ in range(ROUNDS):
            problem.show(state)
            gradients.linearise()
            first, *others = self.conditions()
            slopes, residual = gradients.by_adjoint(first, [load, *found], self.solve)
            by_load = slopes[LOAD]
            if not by_load:
                raise InputError("The event does not depend on the load of the path.")
            change = -self._value(first) / by_load
            if abs(change) <= CLOSE * max(abs(state.factors[self.ramp]), CLOSE):
                break
            state = self._ahead(state, change)
        self.check(found)
        for other in others:
            self._agree(found, slopes, gradients.by_adjoint(other, [load, *found], self.solve)[0])
        found_slopes = {one.name: -slopes[one.name] / by_load for one in found}
        for name, region in strength.items():
            found_slopes[name] = -self.strength_slope(region) / by_load
        return state.factors[self.ramp] + change, found_slopes, residual

    def _value(self, functional: Functional) -> float:
        kept = self.gradients.kept
        values = [kept.value(form) for form in functional.forms]
        return float(functional.combine(values, self.problem.factors))

    def _ahead(self, state: State, change: float) -> State:
        """The equilibrium at a load that differs by very little, to second order.  Collective."""
        problem = self.problem
        slope, _ = self.solve(-self.gradients.forces(LoadVariable(LOAD, self.ramp, 1.0)))
        moved = problem.moved(state, change * slope)
        factors = {self.ramp: state.factors[self.ramp] + change}
        return problem.imposed(problem.under(moved, factors))

    def _agree(
        self, found: Iterable[Variable], slopes: Mapping[str, float], others: Mapping[str, float]
    ) -> None:
        """Raise InputError unless two values that belong to the condition change alike."""
        load = LoadVariable(LOAD, self.ramp, 1.0)
        least = abs(slopes[LOAD])  # a change of the load that counts as none
        for one in (load, *found):
            a, b = (self.size(one) * each[one.name] for each in (slopes, others))
            if abs(a - b) > ALIKE * max(abs(a), abs(b), least):
                raise InputError(
                    f"The load of the event has no derivative here, because {self.shared} and "
                    f"change differently with {one.name!r}; compare two runs."
                )

    def size(self, one: Variable) -> float:
        """A usual size of a variable, in its unit."""
        if isinstance(one, LoadVariable):
            return one.unit
        return abs(one.value) if isinstance(one, Coefficients) else self.problem.scales.length


class _Failing(_Event):
    """A failure at the point where its margin is least."""

    def __init__(self, gradients: Gradients, ramp: str, asked: Asked) -> None:
        super().__init__(gradients, ramp)
        event = EVENTS[asked.name]
        self._failure = next(one for one in asked.failures if one.name == event)
        self._margin = PointMargin(Gauge(self._failure, self.problem))

    def conditions(self) -> list[Functional]:
        return self._margin.functionals

    def strength_slope(self, region: str) -> float:
        """The margin 1 - E/E_b grows with E_b by 1/E_b; by its value at rest, if it has a law."""
        if region != self._margin.region or self._failure.name != "electrical breakdown":
            return 0.0
        law = self.problem.parameters.materials[region].dielectric.breakdown_law()
        assert law is not None  # else the region is not watched
        return float(1 / law.field)


class _Buckling(_Event):
    """A bifurcation, at which the tangent is singular."""

    shared = "two modes buckle at one load"

    def __init__(self, gradients: Gradients, ramp: str, asked: Asked) -> None:
        super().__init__(gradients, ramp)
        problem = self.problem
        if problem.rigid or problem.springs.rows.size or not problem.forms.is_symmetric:
            raise InputError(
                "The load of buckling has no derivative here: the scene has rigid parts, springs "
                "or a tangent without symmetry; compare two runs."
            )
        self._modes: list[np.ndarray] = []
        self._stiffnesses: list[tuple[Any, Functional]] = []

    def conditions(self) -> list[Functional]:
        problem, gradients = self.problem, self.gradients
        solver = gradients.solver
        solver.forget_factor()
        found = CriticalEigenvalue(solver).nearest_zero(problem.state)
        mode = None
        if found is not None:
            load = np.zeros_like(found[2])
            moving = problem.roles.free(Role.MOTION)
            load[moving] = found[2][moving]
            mode = solver.linear_solve(load, 1e-10)
        if mode is None:
            raise SolverError("The null vector of the tangent at the bifurcation was not found.")
        first = mode / np.sqrt(gradients.kept.total(mode @ mode))
        self._modes = [first]
        second = self._second()
        if second is None:
            return [self._stiffness(0, first)]
        self._modes.append(second)
        shapes = first, second, (first + second) / np.sqrt(2)
        return [self._stiffness(k, shape) for k, shape in enumerate(shapes)]

    def _stiffness(self, number: int, shape: np.ndarray) -> Functional:
        """shape . K shape as a functional of the state; those of some numbers are kept."""
        problem = self.problem
        if number == len(self._stiffnesses):
            function = dolfinx.fem.Function(problem.W)
            form = ufl.action(problem.forms.tangent(function), function)
            self._stiffnesses.append((function, Functional([form], lambda i, _: i[0])))
        function, functional = self._stiffnesses[number]
        problem.spread(shape, function)
        return functional

    def _second(self) -> np.ndarray | None:
        """A second null vector of the tangent, or None.  Collective.

        With f_2 the load at which the second mode buckles, its stiffness over that without a load
        is about 1 - f/f_2.
        """
        first, solver, total = self._modes[0], self.gradients.solver, self.gradients.kept.total
        moving = self.problem.roles.free(Role.MOTION)
        mode = np.zeros(len(first))
        mode[moving] = np.random.default_rng(1 + self.problem.comm.rank).normal(size=len(moving))
        stiffness = np.inf
        for _ in range(INVERSE_STEPS):
            load = np.zeros(len(first))
            load[moving] = (mode - total(float(first @ mode)) * first)[moving]
            found = solver.linear_solve(load - total(float(first @ load)) * first, 1e-8)
            if found is None:
                return None
            found = found - total(float(first @ found)) * first
            mode, before = found / np.sqrt(total(float(found @ found))), stiffness
            stiffness = abs(total(float(mode @ solver.tangent.times(mode))))
            if abs(stiffness - before) < AT_ONCE * stiffness:
                break
        with self.problem.at(self.problem.rest):
            unloaded = abs(total(float(mode @ solver.tangent.times(mode))))
        return mode if stiffness <= AT_ONCE * unloaded else None

    def solve(self, rhs: np.ndarray) -> tuple[np.ndarray, float]:
        """In the space without the null vectors, in which the tangent is regular."""
        total, size = self.gradients.kept.total, np.sqrt(self.gradients.kept.total(rhs @ rhs))
        for mode in self._modes:
            along = total(mode @ rhs)
            if abs(along) > SYMMETRIC * size:
                raise InputError(
                    "The load of buckling has no derivative here, because the two directions of "
                    "buckling differ, so that the bifurcation is not symmetric; compare two runs."
                )
            rhs = rhs - along * mode
        values, residual = self.gradients.solved(rhs)
        for mode in self._modes:
            values = values - total(mode @ values) * mode
        return values, residual

    def check(self, found: Iterable[Variable]) -> None:
        paired = Paired(self.gradients.kept, self.gradients.solver.tangent, self._modes[0])
        for one in found:
            slope, size = paired.slope(one), paired.size(one)
            if abs(slope) > max(SYMMETRIC * size, LEAST / self.size(one)):
                raise InputError(
                    f"The load of buckling has no derivative by {one.name!r}, because the device "
                    "with another value of it has no bifurcation: it bends from the first load on."
                )


