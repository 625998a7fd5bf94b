"""The discretisation error of observables: the dual weighted residual.

The equations R(u; v) = 0 for all v are solved in elements of degree k, u_h, and an observable
J(u_h) is measured.  In elements of one degree more on the same mesh let z be the dual solution,

    R'(u_h; v, z) = J'(u_h; v) for all v of one degree more.

Then, to first order in the error of u_h and up to what the richer elements cannot hold either,

    J(u) - J(u_h) = -R(u_h; z - i_h z),

with the interpolant i_h z in elements of degree k, whose part is 0 up to quadrature and the
tolerance of Newton's method [Becker & Rannacher 2001, Acta Numerica 10, section 2].  In elements of
degree k the whole would be 0.  The residual is known cell by cell, and so is the estimate.
What the first order leaves out is found by Newton's method in the richer elements.  It begins in
u_h and keeps the factor of the dual solution.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import basix.ufl
import numpy as np
import ufl

from dea_fenicsx.gradients.adjoint import Gradients
from dea_fenicsx.gradients.differences import displacement_size, fourth_order, small_step
from dea_fenicsx.gradients.enriched import Enriched
from dea_fenicsx.gradients.past_checks import has_past
from dea_fenicsx.gradients.reductions import added_parts
from dea_fenicsx.gradients.shapes import most
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import State
from dea_fenicsx.solvers.refinement import solve_to
from dea_fenicsx.support import compat
from dea_fenicsx.support.agreement import bind_alike
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError, SolverError

DUAL_TOLERANCE = 1e-8
"""Residual of the dual solution that is aimed at, relative to its right-hand side."""

LARGEST_RESIDUAL = 1e-3
"""Residual of the dual solution with which the estimate is given; it is hardly ever that large."""


CORNER = 3.0
"""Power of the degree with which an observable's error falls at the strongest corners of rubber.

At a corner where displacements are like r^a it is 4 a [Babuska & Suri 1987, Mathematical Modelling
and Numerical Analysis 21, 199-238], and a is about 0.75 where a clamped face meets a free one.
"""


def not_seen(degree: int) -> float:
    """The error over the part of it that one degree more removes, at the strongest corners."""
    return 1 / (1 - (degree / (degree + 1)) ** CORNER)


@dataclass(frozen=True)
class DiscretisationError:
    """The estimated discretisation error of an observable in a state.

    Attributes
    ----------
    name
        Name of the observable.
    value
        Its value in the state, in SI units.
    estimate
        The value in elements of one degree more, minus `value`, in SI units.  It holds the error of
        the shape of curved cells only if they are those of a mesh family.
    linear
        The same to first order, the dual weighted residual, of which `cells` has the parts.
    unknowns
        Number of unknowns of the state.
    degree
        Degree of its displacement.
    cells
        The parts of the estimate by cells, in SI units, shape (owned cells, parts): along each axis
        of a cell, and the whole last; on simplices the whole alone.  None for an observable that
        is no function of integrals.
    """

    name: str
    value: float
    estimate: float
    linear: float
    unknowns: int
    degree: int
    cells: np.ndarray | None = field(default=None, repr=False, compare=False)

    @property
    def error(self) -> float:
        """The estimated size of the error, in SI units.

        That of `estimate`, larger by the share which one degree more does not remove at a sharp
        corner.  Where the solution is smooth it is therefore too large by up to 1.4 at degree 2 and
        1.7 at degree 3.
        """
        return abs(self.estimate) * not_seen(self.degree)

    @property
    def relative(self) -> float:
        """`error` relative to the value; infinite where the value is 0."""
        return self.error / abs(self.value) if self.value else float("inf")

    def told(self) -> dict[str, float | None]:
        """What the summary of a run says of it."""
        finite = self.relative if self.value else None
        return {
            "value": self.value, "estimate": self.estimate, "error": self.error,
            "relative": finite,
        }  # fmt: skip


class ErrorEstimates:
    """Estimates the discretisation errors of observables in states of a problem.

    Parameters
    ----------
    base
        The problem.
    """

    def __init__(self, base: Problem) -> None:
        self.base = base

    @cached_property
    def enriched(self) -> Enriched:
        """The problem of one degree more."""
        return Enriched(self.base)

    @cached_property
    def _gradients(self) -> Gradients:
        return Gradients(self.enriched.problem)

    def of(
        self, state: State, observables: Mapping[str, Any], by_cells: bool = False
    ) -> dict[str, DiscretisationError]:
        """The errors of some observables in a state.  Collective.

        All share one factor of the tangent in elements of one degree more.

        Raises
        ------
        InputError
            For a state that depends on those before it, and an observable without a derivative.
        SolverError
            If a linear system is singular, as at a limit point.
        """
        if has_past(state):
            raise InputError(
                "The discretisation error is estimated in equilibria without a past, but this "
                "state depends on the steps before it (a march, viscous strains, charges that "
                "move, friction); compare two meshes instead."
            )
        found = {}
        richer = self.enriched.problem
        lifted = self.enriched.state(state)
        balanced = self._balanced(lifted)
        for name, observable in observables.items():
            with self.base.at(state):
                value = float(bind_alike(self.base, name, observable)())
            with richer.at(lifted):
                self._gradients.linearise()
                exact, cells = self._linear(lifted, name, observable, by_cells)
            linear = exact - value
            if balanced is not None:
                with richer.at(balanced):
                    exact = float(bind_alike(richer, name, observable)())
            found[name] = DiscretisationError(
                name, value, exact - value, linear, self.base.unknowns,
                self.base.scene.elements.degree, cells,
            )  # fmt: skip
        return found

    def _balanced(self, lifted: State) -> State | None:
        """The equilibrium of one degree more that lies beside a state, or None.  Collective.

        Newton's method takes few iterations with the factor of the dual solution.  At sharp corners
        strains are so large that the first-order estimate alone can be ten times too large.
        """
        attempt = self._gradients.solver.solve(lifted, patient=True)
        return attempt.state if attempt.converged else None

    def _linear(
        self, lifted: State, name: str, observable: Any, by_cells: bool
    ) -> tuple[float, np.ndarray | None]:
        """The exact value by the dual weighted residual, and the parts of its difference."""
        richer, gradients = self.enriched.problem, self._gradients
        measure = bind_alike(richer, name, observable)
        base, residual = float(measure()), richer.restrict(richer.residual())
        residual[richer.circuits.given_rows()] = 0.0
        functional = gradients.functional(observable)
        if functional is None:
            return base + self._along(lifted, measure, self._solved(-residual)), None
        rhs = richer.restrict(gradients.pulled(functional).by_state)
        rhs[richer.circuits.given_rows()] = 0.0
        dual = self._solved(rhs, transposed=True)
        change = -gradients.kept.total(dual @ residual)
        return base + change, -self._by_cells(dual) if by_cells else None

    def _solved(self, rhs: np.ndarray, transposed: bool = False) -> np.ndarray:
        """Solve with the tangent of one degree more, or with its transpose.  Collective."""
        solver, total = self._gradients.solver, self._gradients.kept.total
        if total(rhs @ rhs) == 0:
            return np.zeros(len(rhs))
        if transposed:
            found = solver.solve_transposed(rhs, DUAL_TOLERANCE)
        else:
            times, comm = solver.tangent.times, self.enriched.problem.comm
            found = solve_to(rhs, DUAL_TOLERANCE, solver.linear_solve, times, comm)
        if found is None or not found.residual < LARGEST_RESIDUAL:
            raise SolverError(
                "The discretisation error was not found: the linear system is singular or nearly "
                "so, as at a limit point; take a step away from it."
            )
        return np.asarray(found.values)

    def _along(self, lifted: State, measure: Any, change: np.ndarray) -> float:
        """The derivative of an observable along a change of the state.  Collective."""
        richer = self.enriched.problem
        moving = richer.roles.free(Role.MOTION)
        size = displacement_size(richer, lifted), most(richer, change[moving])

        def value(step: float) -> float:
            richer.show(richer.moved(lifted, step * change))
            return float(measure())

        found = fourth_order(value, small_step([size]))
        richer.show(lifted)
        return found

    @cached_property
    def _work_by_cells(self) -> tuple[Any, Any, Any]:
        """The virtual work of the residual by cells, and the motion in which it is done."""
        richer = self.enriched.problem
        mesh, space = richer.mesh, richer.space
        broken = [_broken(one.element) for one in space.fields]
        motion = dolfinx.fem.Function(
            dolfinx.fem.functionspace(mesh, basix.ufl.mixed_element(broken))
        )
        form = ufl.replace(richer.forms.residual, {space.test: motion})
        cells = dolfinx.fem.functionspace(mesh, ("DG", 0))
        one = ufl.TestFunction(cells)
        weighed = []
        for integral in form.integrals():
            inside = integral.integral_type().startswith("interior_facet")
            weight = (one("+") + one("-")) / 2 if inside else one
            weighed.append(integral.reconstruct(integrand=weight * integral.integrand()))
        return compat.compile_form(ufl.Form(weighed)), motion, cells

    def _by_cells(self, dual: np.ndarray) -> np.ndarray:
        """The residual's work in what one degree more adds to a dual solution.  Collective."""
        richer = self.enriched.problem
        form, motion, cells = self._work_by_cells
        whole = dolfinx.fem.Function(richer.W)
        richer.spread(dual, whole)
        local = whole.x.array[richer.W.dofmap.list]
        owned = cells.dofmap.index_map.size_local
        order = cells.dofmap.list[:, 0]
        parts = added_parts(
            self.base.space, richer.space, richer.mesh.topology.cell_name(),
            richer.mesh.topology.dim,
        )  # fmt: skip
        found = []
        for part in parts:
            motion.x.array[motion.function_space.dofmap.list.ravel()] = (local @ part.T).ravel()
            motion.x.scatter_forward()
            vector = dolfinx.fem.assemble_vector(form)
            vector.scatter_reverse(dolfinx.la.InsertMode.add)
            found.append(vector.array[order][:owned].copy())
        return np.column_stack(found)


def _broken(element: Any) -> Any:
    """The same element without continuity between cells."""
    scalar = element.sub_elements[0] if element.block_size > 1 else element
    family = "DPC" if scalar.family_name == "DPC" else "Lagrange"
    shape = (element.block_size,) if element.block_size > 1 else None
    return basix.ufl.element(
        family, element.cell_type, scalar.degree, discontinuous=True, shape=shape
    )
