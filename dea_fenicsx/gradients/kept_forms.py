"""Derivatives of forms, each compiled once for all states of a problem.

UFL takes longer to derive a form and to find its compiled code than DOLFINx to assemble it.  So a
form that was derived is kept, and its constants and its functions get other values.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.model.problem import Problem
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx


class KeptForms:
    """The compiled derivatives of forms of a problem.

    Parameters
    ----------
    problem
        The problem.

    Attributes
    ----------
    problem
        The problem.
    weight
        A function of the unknowns, by which `work` weighs the residual.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.weight = dolfinx.fem.Function(problem.W)
        self._work: Any = None
        self._nodes: Any = None
        # The keys hold the numbers of objects, so that the objects must live as long.
        self._vectors: dict[tuple[int, int], tuple[Any, Any, Any]] = {}
        self._scalars: dict[int, tuple[Any, Any]] = {}

    @property
    def work(self) -> Any:
        """The virtual work of the residual in the motion `weight`, symbolic."""
        if self._work is None:
            self._work = ufl.action(self.problem.forms.residual, self.weight)
        return self._work

    def value(self, form: Any) -> float:
        """The value of a form without arguments.  Collective."""
        if id(form) not in self._scalars:
            self._scalars[id(form)] = form, compat.compile_form(form)
        mine = float(np.real(dolfinx.fem.assemble_scalar(self._scalars[id(form)][1])))
        return self.total(mine)

    def total(self, mine: float) -> float:
        """A sum over all ranks.  Collective."""
        return float(self.problem.comm.allreduce(float(mine), op=MPI.SUM))

    def by_state(self, form: Any) -> np.ndarray:
        """The derivative of a form by the unknowns, over the owned values.  Collective."""
        problem = self.problem
        found = self._vector(form, problem.w, lambda: problem.space.test, problem.W)
        return found[: problem.owned]

    def by_coefficient(self, form: Any, coefficient: Any) -> np.ndarray:
        """The derivative of a form by a cell-wise coefficient in each local cell.  Collective."""
        space = coefficient.function_space
        return self._vector(form, coefficient, lambda: ufl.TestFunction(space), space)

    def along(self, form: Any, coefficient: Any, direction: Any) -> np.ndarray:
        """The derivative of a linear form by a coefficient along a direction (owned).  Collective.

        The direction must be the same function at each call.
        """
        found = self._vector(form, coefficient, lambda: direction, self.problem.W)
        return found[: self.problem.owned]

    def by_nodes(self, form: Any) -> np.ndarray:
        """The derivative of a form by the coordinates of the nodes, owned values.  Collective."""
        space = self.nodes
        x = ufl.SpatialCoordinate(self.problem.mesh)
        found = self._vector(form, x, lambda: ufl.TestFunction(space), space)
        return found[: space.dofmap.index_map.size_local * space.dofmap.index_map_bs]

    @property
    def nodes(self) -> Any:
        """The function space of the mesh's own coordinates."""
        if self._nodes is None:
            mesh = self.problem.mesh
            element = mesh.ufl_domain().ufl_coordinate_element()
            self._nodes = dolfinx.fem.functionspace(mesh, element)
        return self._nodes

    def _vector(
        self, form: Any, variable: Any, argument: Callable[[], Any], space: Any
    ) -> np.ndarray:
        """The derivative of a form by a variable, over the local values of a space.  Collective."""
        # each call makes another object for the coordinates
        place = -1 if isinstance(variable, ufl.SpatialCoordinate) else id(variable)
        key = id(form), place
        if key not in self._vectors:
            derived = ufl.derivative(form, variable, argument())
            derived = ufl.algorithms.expand_derivatives(derived)
            # of an empty form nothing depends on the variable
            compiled = None if derived.empty() else compat.compile_form(derived)
            self._vectors[key] = form, variable, compiled
        compiled = self._vectors[key][2]
        if compiled is None:
            return np.zeros(dolfinx.fem.Function(space).x.array.size)
        vector = dolfinx.fem.assemble_vector(compiled)
        vector.scatter_reverse(dolfinx.la.InsertMode.add)
        return np.asarray(vector.array.copy())
