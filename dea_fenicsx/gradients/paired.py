"""Derivatives of the residual's product with a vector, by many variables at once."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.gradients.kept_forms import KeptForms
from dea_fenicsx.gradients.shapes import fixed_change, nodal_values
from dea_fenicsx.gradients.variables import Coefficients, LoadVariable, Variable
from dea_fenicsx.solvers.tangent import Tangent


class Paired:
    """The derivatives of `vector . R + beside` by variables, at fixed free unknowns.

    The derivative by all cells of a coefficient, or by all nodes, is assembled once.  That by one
    variable is a sum over it.

    Parameters
    ----------
    kept
        The forms of the problem.
    tangent
        Its tangent at the present state.
    vector
        In the free unknowns (owned).
    beside
        Forms, which are added.
    """

    def __init__(
        self, kept: KeptForms, tangent: Tangent, vector: np.ndarray, beside: Iterable[Any] = ()
    ) -> None:
        self._kept, self._tangent, self.vector = kept, tangent, vector
        self._problem = problem = kept.problem
        inside = vector.copy()
        inside[problem.circuits.given_rows()] = 0.0
        problem.spread(inside, kept.weight)
        self._forms = [kept.work, *beside]
        self._by_coefficient: dict[int, np.ndarray] = {}
        self._by_nodes: np.ndarray | None = None

    def slope(self, one: Variable) -> float:
        """The derivative by a variable, in units of the variable.  Collective."""
        problem, kept = self._problem, self._kept
        if isinstance(one, LoadVariable):
            forces = self._tangent.by_load(one.ramp)
            return kept.total(self.vector @ forces) / one.unit
        if isinstance(one, Coefficients):
            return kept.total(sum(float(part.sum()) for part in self._parts(one)))
        gradient = self.by_nodes()
        values = nodal_values(kept.nodes, one.velocity)[: len(gradient)]
        slope = kept.total(gradient @ values)
        change = fixed_change(problem, one.velocity)
        if problem.comm.allreduce(bool(change.any()), op=MPI.LOR):
            moved = self._tangent.times_fixed(change[problem.fixed])
            slope += kept.total(self.vector @ moved)
        return slope

    def size(self, one: Variable) -> float:
        """The sum of the sizes of all parts of which `slope` is the sum.  Collective."""
        kept = self._kept
        if isinstance(one, LoadVariable):
            parts = self.vector * self._tangent.by_load(one.ramp) / one.unit
        elif isinstance(one, Coefficients):
            parts = np.concatenate(self._parts(one))
        else:
            gradient = self.by_nodes()
            parts = gradient * nodal_values(kept.nodes, one.velocity)[: len(gradient)]
        return kept.total(float(np.abs(parts).sum()))

    def _parts(self, one: Coefficients) -> list[np.ndarray]:
        """The derivatives by the value in each owned cell, times its change.  Collective."""
        owned, found = self._problem.scene.device.owned_cells(), []
        for coefficient, cells, rate in one.changes:
            mine = cells < owned
            rates = np.broadcast_to(rate, cells.shape)[mine]
            found.append(rates * self._cells(coefficient)[cells[mine]])
        return found

    def _cells(self, coefficient: Any) -> np.ndarray:
        """The derivative by a cell-wise coefficient in each local cell.  Collective."""
        key, kept = id(coefficient), self._kept
        if key not in self._by_coefficient:
            self._by_coefficient[key] = np.sum(
                [kept.by_coefficient(form, coefficient) for form in self._forms], axis=0
            )
        return self._by_coefficient[key]

    def by_nodes(self) -> np.ndarray:
        """The derivative by each owned coordinate of the nodes.  Collective.

        Displacements that are given as functions of the place are not among it.
        """
        if self._by_nodes is None:
            kept = self._kept
            self._by_nodes = np.sum([kept.by_nodes(form) for form in self._forms], axis=0)
        return self._by_nodes
