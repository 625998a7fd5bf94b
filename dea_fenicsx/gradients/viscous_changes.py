"""How the viscous strains of Maxwell branches change with a variable, over one step of time.

A step ends at C_v = M det(M)^(-1/3) with M = h/tau C + H, see `model.viscous_history`.  So

    dC_v = det(M)^(-1/3) [dM - (M^-1 : dM)/3 M],    dM = h/tau dC + d(h/tau) C + dH,

and dH is the same combination of the earlier dC_v as H is of the earlier C_v.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl

from dea_fenicsx.gradients.differences import fourth_order, small_step
from dea_fenicsx.gradients.shapes import distortion
from dea_fenicsx.gradients.variables import Coefficients, Shape, Variable, larger
from dea_fenicsx.model.memory import INFINITE_STEP
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.viscous_history import (
    PAIRS,
    STAGE_SHARE,
    Rule,
    ViscousHistory,
    combined,
    contracted,
    cubic_rule,
    determinant,
    inverse,
    is_positive,
)
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx

Strains = np.ndarray
"""Symmetric tensors at quadrature points, of shape (branches, cells, points, 6)."""


def combined_change(history: ViscousHistory, changes: tuple[Strains, ...]) -> Strains:
    """dH of a step, from the changes of the strains of its history, the newest first."""
    strains, rule = history.strains, history.rule
    if rule is Rule.EULER or len(strains) < 2 or not 0 < history.span < np.inf:
        return changes[0]
    if rule is Rule.STAGE:
        w = (1 - STAGE_SHARE) / STAGE_SHARE
        now, moved = strains[1], changes[1]
        both, change = now + w * (strains[0] - now), moved + w * (changes[0] - moved)
    else:
        now, moved = strains[0], changes[0]
        w = history.span / (history.times[0] - history.times[1])
        one, two = 1 + w, w * w / (1 + w)
        both, change = one * now - two * strains[1], one * moved - two * changes[1]
    found = np.where(is_positive(both)[..., None], change, moved)
    if rule is Rule.BDF3 and len(strains) > 2:
        three = cubic_rule(history)
        cubic = cubic_rule(ViscousHistory(changes, history.times, history.span, rule))
        found = np.where(is_positive(three)[..., None], cubic, found)
    return found


def unimodular_change(M: Strains, change: Strains) -> Strains:
    """The change of the unimodular part of positive tensors."""
    share = contracted(inverse(M), change)[..., None] / 3
    return np.asarray((change - share * M) / np.cbrt(determinant(M))[..., None])


class ViscousChanges:
    """The changes of viscous strains, and the forces that follow from them.

    Parameters
    ----------
    problem
        A problem with Maxwell branches.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem, self.memory = problem, problem.forms.memory
        self.along = dolfinx.fem.Function(problem.W)
        self._branches = [b for kernel in problem.kernels for b in kernel.branches]
        self._histories, self._steps = self._directions()
        terms = [
            ufl.derivative(problem.forms.residual, held, way)
            for held, way in [*self._histories.values(), *self._steps.values()]
        ]
        total = terms[0]
        for term in terms[1:]:
            total = total + term
        self._forces: Any = compat.compile_form(ufl.algorithms.expand_derivatives(total))
        mesh, self._per_cell = problem.mesh, len(problem.forms.quadrature)
        self._mesh = mesh
        self._strain = [
            (kernel, compat.expression(
                ufl.as_vector([
                    ufl.derivative(point.strain.C[i, j], problem.w, self.along) for i, j in PAIRS
                ]), problem.forms.quadrature,
            ))
            for kernel, point in zip(problem.kernels, problem.forms.points, strict=True)
            if kernel.is_viscous
        ]  # fmt: skip

    def _directions(self) -> tuple[dict[int, Any], dict[int, Any]]:
        """Directions for each history, by the place of its branch, and for each step length."""
        histories, steps = {}, {}
        for number, branch in enumerate(self._branches):
            held = branch.function
            if branch.place not in histories:
                way = dolfinx.fem.Function(held.function_space)
                histories[branch.place] = held, way
            steps[number] = branch.step, dolfinx.fem.Function(branch.step.function_space)
        return histories, steps

    def none(self) -> Strains:
        """No change."""
        return np.zeros_like(self.memory.at_rest().strains[0])

    def rates(self) -> np.ndarray:
        """1/tau of each branch in each local cell, shape (branches, cells); 0 elsewhere."""
        found = np.zeros(self.none().shape[:2])
        for branch in self._branches:
            tau = branch.tau.x.array
            found[branch.place, tau > 0] = 1 / tau[tau > 0]
        return found

    def rate_changes(self, one: Variable) -> np.ndarray:
        """The change of 1/tau with a variable, shape (branches, cells)."""
        rates, found = self.rates(), np.zeros(self.none().shape[:2])
        for coefficient, cells, slope in one.changes if isinstance(one, Coefficients) else ():
            for branch in self._branches:
                if coefficient is branch.tau:
                    found[branch.place, cells] -= slope * rates[branch.place, cells] ** 2
        return found

    def forces(self, history: ViscousHistory, change: Strains, one: Variable) -> np.ndarray:
        """The change of the residual at fixed unknowns, over the owned values.  Collective.

        Parameters
        ----------
        history
            That of the step, which the problem shows.
        change
            dH.
        one
            The variable.
        """
        for place, (_, way) in self._histories.items():
            way.x.array[:] = change[place].ravel()
        faster = min(history.span, INFINITE_STEP) * self.rate_changes(one)
        for number, (_, way) in self._steps.items():
            way.x.array[:] = faster[self._branches[number].place]
        vector = dolfinx.fem.assemble_vector(self._forces)
        vector.scatter_reverse(dolfinx.la.InsertMode.add)
        return np.asarray(vector.array[: self.problem.owned].copy())

    def landed(
        self, history: ViscousHistory, change: Strains, values: np.ndarray, one: Variable
    ) -> Strains:
        """The change of C_v at the end of a step, in the problem's present state.

        Parameters
        ----------
        history, change, one
            As of `forces`.
        values
            The change of all local values.
        """
        if history.span == 0:
            return change
        self.along.x.array[:] = values
        span, C = min(history.span, INFINITE_STEP), self.memory.strains()
        moved = np.zeros_like(C)
        for kernel, evaluate in self._strain:
            if len(kernel.cells):
                found = evaluate(self._mesh, kernel.cells)
                moved[kernel.cells] = found.reshape(len(kernel.cells), self._per_cell, 6)
        rates, faster = (
            span * each[..., None, None] for each in (self.rates(), self.rate_changes(one))
        )
        if isinstance(one, Shape):
            moved += self._by_shape(one)
        M = rates * C + combined(history)
        return unimodular_change(M, rates * moved + faster * C + change)

    def _by_shape(self, one: Shape) -> np.ndarray:
        """The change of C with a shape at fixed unknowns, shape (cells, points, 6).  Collective."""
        problem = self.problem

        def strains(step: float) -> np.ndarray:
            with larger(problem, one, step):
                return self.memory.strains()

        step = small_step([(1.0, distortion(problem, one.velocity))])
        return fourth_order(strains, step)
