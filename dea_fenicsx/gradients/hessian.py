"""Second derivatives of observables: products of the Hessian with a direction.

With the adjoint m of an observable J its derivative by a variable q is that of L = J - m . R at
fixed unknowns.  Along a direction d of the variables the state moves by x', and m by m':

    K x' = -R_d,        K^T m' = d/ds (J_x - K^T m),        (H d)_q = d/ds L_q - m' . R_q,

where d/ds is the derivative along the states x + s x' and variables p + s d, with m held (forward
over adjoint; Papadimitriou and Giannakoglou, Arch. Comput. Methods Eng. 15 (2008) 447).  It is
taken by a difference of fourth order of what the first derivatives are made of, so that nothing
else is compiled.  Its error is about 1e-11.  A product costs two linear solves, however many
variables there are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from dea_fenicsx.gradients.adjoint import (
    Gradients,
    check_height,
    check_static,
)
from dea_fenicsx.gradients.differences import displacement_size, fourth_order, small_step
from dea_fenicsx.gradients.functionals import Functional
from dea_fenicsx.gradients.gradient import Gradient
from dea_fenicsx.gradients.paired import Paired
from dea_fenicsx.gradients.shapes import most, of_moved_nodes
from dea_fenicsx.gradients.variables import (
    Coefficients,
    LoadVariable,
    Shape,
    Told,
    Variable,
    larger,
    variables,
)
from dea_fenicsx.measure.observables import Measurement
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.state import State
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.validation import finite

Direction = list[tuple[Variable, float]]
"""Variables with their parts in a direction."""


def hessian_product(
    gradients: Gradients, state: State, measured: tuple[str, Any],
    to: Iterable[Told], along: Mapping[str, float],
) -> Gradient:  # fmt: skip
    """The derivatives of the slope of an observable along a direction.  Collective.

    Parameters
    ----------
    gradients
        What derives.
    state
        An equilibrium.
    measured
        The observable's name, and the observable.
    to
        The variables.
    along
        Variable to its part in the direction, in its unit; a change of shape must be in `to`.

    Returns
    -------
    Gradient
        Its value is the slope of the observable along the direction.

    Raises
    ------
    InputError
        For an unknown variable, an observable that is no function of integrals, a frequency, and a
        step of a march.
    SolverError
        If a linear solve fails.
    """
    problem, (name, observable) = gradients.problem, measured
    check_static(state)
    found = variables(problem, to)
    direction = _direction(gradients, found, along)
    with problem.at(state):
        functional = gradients.functional(observable)
        if functional is None or functional.refresh is not None:
            raise InputError(
                f"{type(observable).__name__} has no second derivative here; those that have are "
                "the observables that are functions of integrals, such as MeanDisplacement, "
                "MeanStretch, Area, Charge, Capacitance, Energy, Reaction, and the mean or the "
                "integral of an Expression."
            )
        if functional.per_period:
            check_height([*found, *(one for one, _ in direction)], type(observable).__name__)

        def measure() -> float:
            return functional.value(problem, gradients.kept)

        product = _Product(gradients, state, functional, direction)
        value, slopes, residual = product.derived(found, measure)
    return Gradient(f"slope of {name}", value, slopes, "adjoint", residual)


def _direction(
    gradients: Gradients, found: list[Variable], along: Mapping[str, float]
) -> Direction:
    """The variables of a direction, with their parts.

    Raises
    ------
    InputError
        For a direction without a part, and for an unknown variable.
    """
    if not isinstance(along, Mapping) or not along:
        raise InputError(
            f"along= is {shown(along)}, but must map names of variables to their parts in the "
            "direction, as in {'voltage': 1.0}."
        )
    own = {one.name: one for one in found}
    parts = []
    for name, part in along.items():
        finite(part, f"The part of {name!r} in along=")
        one = own.get(name) or variables(gradients.problem, [name])[0]
        parts.append((one, float(part)))
    if not any(part for _, part in parts):
        raise InputError("along= has no part that differs from 0, so that it is no direction.")
    return parts


PASSES = 6
"""Passes to find where a node was at rest; each makes the error a thousand times smaller."""


class _Product:
    """The product of the Hessian of a functional with a direction, at an equilibrium.

    Parameters
    ----------
    gradients, state, functional, direction
        What derives, the equilibrium, the functional, and the direction.
    """

    def __init__(
        self, gradients: Gradients, state: State, functional: Functional, direction: Direction
    ) -> None:
        self.gradients, self.problem, self.state = gradients, gradients.problem, state
        self.functional, self.direction = functional, direction
        self.changed = np.zeros(len(self.problem.free))  # x'
        self._shift = 0.0  # the present step along the direction

    def derived(
        self, found: list[Variable], measure: Measurement
    ) -> tuple[float, dict[str, float], float]:
        """The slope along the direction, the product by each variable, and a residual."""
        problem, gradients, kept = self.problem, self.gradients, self.gradients.kept
        gradients.linearise()
        held = problem.circuits.given_rows()
        rhs = problem.restrict(gradients.pulled(self.functional).by_state)
        rhs[held] = 0.0
        adjoint, first = gradients.transposed(rhs)
        pushed = self._along(lambda: problem.restrict(problem.residual()), self._step())
        problem.show(self.state)
        gradients.linearise()
        self.changed, second = gradients.solved(-pushed)

        held_back = [self._from_rest(one) for one in found]

        def parts() -> np.ndarray:
            """L_x and L_q at a state nearby, one after the other."""
            pulled = gradients.pulled(self.functional)
            by_state = problem.restrict(pulled.by_state)
            by_state = by_state - gradients.solver.tangent.times_transposed(adjoint)
            by_state[held] = 0.0
            slopes = gradients.partial(pulled, held_back, adjoint)
            return np.concatenate([by_state, [slopes[one.name] for one in found], [measure()]])

        n = len(problem.free)
        change = self._along(parts, self._step())
        problem.show(self.state)
        turned, third = gradients.transposed(change[:n])  # m'
        paired = Paired(kept, gradients.solver.tangent, -turned)
        slopes = {one.name: change[n + k] + paired.slope(one) for k, one in enumerate(found)}
        return float(change[-1]), slopes, max(first, second, third)

    def _along(self, of: Callable[[], np.ndarray], step: float) -> np.ndarray:
        """The derivative of an array along the direction, by a formula of fourth order."""

        def there(s: float) -> np.ndarray:
            with self._moved(s):
                return np.array(of())

        return fourth_order(there, step)

    @contextmanager
    def _moved(self, step: float) -> Iterator[None]:
        """The problem a step along the direction, its state to first order.  Collective."""
        problem, tangent = self.problem, self.gradients.solver.tangent
        factors = {
            one.ramp: self.state.factors[one.ramp] + step * part / one.unit
            for one, part in self.direction if isinstance(one, LoadVariable)
        }  # fmt: skip
        x = problem.mesh.geometry.x
        rest, self._shift = x.copy(), step
        try:
            with ExitStack() as stack:
                for one, part in self.direction:
                    if not isinstance(one, Shape):
                        stack.enter_context(larger(problem, one, step * part))
                    else:
                        x += step * part * one.velocity(rest)
                if any(isinstance(one, Shape) for one, _ in self.direction):
                    stack.enter_context(of_moved_nodes(problem, rest))
                moved = problem.moved(self.state, step * self.changed)
                problem.show(problem.imposed(problem.under(moved, factors)))
                tangent.renew()
                yield
        finally:
            x[:], self._shift = rest, 0.0
            tangent.renew()
            problem.show(self.state)

    def _from_rest(self, one: Variable) -> Variable:
        """A change of shape whose velocities belong to the nodes, wherever these have moved to.

        A node at X moves to X + s v(X) + p q(X), and not to a place that depends on q(X + s v(X)).
        """
        if not isinstance(one, Shape):
            return one
        moving = [(other, part) for other, part in self.direction if isinstance(other, Shape)]

        def velocity(X: np.ndarray) -> np.ndarray:
            rest = X
            for _ in range(PASSES if moving else 0):
                shift = sum(part * other.velocity(rest) for other, part in moving)
                rest = X - self._shift * shift
            return np.asarray(one.velocity(rest))

        return replace(one, velocity=velocity)

    def _step(self) -> float:
        """The step along the direction for differences.  Collective."""
        problem, state = self.problem, self.state
        speed = most(problem, self.changed[problem.roles.free(Role.MOTION)])
        rates = [(displacement_size(problem, state), speed)]
        for one, part in self.direction:
            size = problem.scales.length
            if isinstance(one, Coefficients):
                size = one.value
            elif isinstance(one, LoadVariable):
                size = state.factors[one.ramp] * one.unit
            rates.append((size, part))
        return small_step(rates)
