"""Fields of a state for pictures: on the nodes of a quadratic grid, and one value a cell.

The grid is numbered by the mesh file's own order of cells, so results are the same on any number
of ranks.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import basix
import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import Factors, State
from dea_fenicsx.support import compat
from dea_fenicsx.support.cell_types import QUADRATIC
from dea_fenicsx.support.compat import dolfinx


@dataclass(frozen=True)
class Grid:
    """A quadratic grid on rank 0.

    Attributes
    ----------
    points : ndarray (nodes, 3), undeformed, m
    cells : ndarray (cells, nodes of a cell), VTK order
    kind : DOLFINx's name of the cell
    regions : ndarray (cells,), tag of each cell's region
    """

    points: np.ndarray
    cells: np.ndarray
    kind: str
    regions: np.ndarray


class FieldWriter:
    """Evaluates the fields of a problem and gathers them on rank 0, in the grid's order.

    Every method is collective; results are None on all ranks but 0.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        mesh = problem.mesh
        self.kind = mesh.topology.cell_name()
        # each displacement component lives in a scalar quadratic space: the grid's nodes
        self.parts = problem.displacement
        self.owned_cells = problem.scene.device.owned_cells()
        self.original = np.asarray(mesh.topology.original_cell_index)[: self.owned_cells]
        self._prepare_cell_expressions()
        self.grid = self._build_grid()

    def gather(self, values: np.ndarray) -> np.ndarray | None:
        """Cell-wise values of all ranks on rank 0, sorted by the cells' numbers in the file."""
        parts = self.problem.comm.gather((self.original, values), root=0)
        if parts is None:
            return None
        order = np.argsort(np.concatenate([p[0] for p in parts]))
        return np.concatenate([p[1] for p in parts])[order]

    def _nodal(self, part: Any, array: np.ndarray) -> np.ndarray:
        """Values at the nodes of each owned cell, shape (cells, nodes), basix order."""
        table = part.space.dofmap.list[: self.owned_cells]
        return array[part.dofs[table]]

    def _build_grid(self) -> Grid | None:
        problem = self.problem
        space = self.parts[0].space
        table = space.dofmap.list[: self.owned_cells]
        imap = space.dofmap.index_map
        local = np.arange(imap.size_local + imap.num_ghosts, dtype=np.int32)
        numbers = imap.local_to_global(local)[table]
        coordinates = space.tabulate_dof_coordinates()[table] * problem.scales.length
        cells = problem.scene.device.cells
        tags = np.zeros(int(cells.indices.max(initial=-1)) + 1, dtype=np.int32)
        tags[cells.indices] = cells.values
        gathered = [
            self.gather(a) for a in (numbers, coordinates, tags[: self.owned_cells])
        ]
        if problem.comm.rank != 0:
            return None
        numbers, coordinates, regions = (np.asarray(g) for g in gathered)
        # number the nodes by their first appearance in the file's order of cells
        _, first, inverse = np.unique(numbers.ravel(), return_index=True, return_inverse=True)
        rank = np.empty(len(first), dtype=np.int64)
        rank[np.argsort(first)] = np.arange(len(first))
        self._connectivity = rank[inverse].reshape(numbers.shape)
        points = np.empty((len(first), 3))
        points[self._connectivity.ravel()] = coordinates.reshape(-1, 3)
        order = QUADRATIC[self.kind].vtk_order
        return Grid(points, self._connectivity[:, order], self.kind, regions)

    def _prepare_cell_expressions(self) -> None:
        problem = self.problem
        middle = basix.cell.geometry(getattr(basix.CellType, self.kind)).mean(axis=0)[None, :]
        self._cell_expressions = []
        for k, s in enumerate(problem.states):
            sigma = problem.states[k].cauchy_stress
            entries = [
                s.J,
                *(s.true_field[i] for i in range(3)),
                *(sigma[i, j] for i, j in _VOIGT),
            ]
            self._cell_expressions.append(compat.expression(ufl.as_vector(entries), middle))

    def vector(self, state: np.ndarray) -> np.ndarray | None:
        """The displacement part of a state, dimensionless, at the grid's nodes."""
        components = [self.gather(self._nodal(c, state)) for c in self.parts]
        if self.problem.comm.rank != 0:
            return None
        assert self.grid is not None
        u = np.zeros((len(self.grid.points), 3))
        for a, values in enumerate(components):
            assert values is not None
            u[self._connectivity.ravel(), a] = values.ravel()
        return u

    def node_fields(self) -> dict[str, np.ndarray] | None:
        """Displacement (m) and potential (V) at the grid's nodes.

        Of a helical cell the displacement is that of the section Theta = 0, along (r, z, hoop).
        """
        problem = self.problem
        u = self.vector(problem.w.x.array)
        overall = problem.space.global_values(problem.scales.length)
        potential = self._potential()
        if u is None:
            return None
        assert self.grid is not None
        u = u * problem.scales.length
        u = problem.scene.kinematics.section(self.grid.points, u, overall)
        fields: dict[str, np.ndarray] = {"displacement_m": u}
        if potential is not None:
            phi = np.zeros(len(self.grid.points))
            phi[self._connectivity.ravel()] = potential.ravel() * problem.scales.potential
            fields |= {"potential_V": phi}
        return fields

    def _potential(self) -> np.ndarray | None:
        """Potential at the nodes of each cell, interpolated if it is of first degree."""
        part = self.problem.potential
        if part is None:
            return None
        values = self._nodal(part, self.problem.w.x.array)
        if values.shape[1] != QUADRATIC[self.kind].nodes:
            values = values @ _quadratic_from_linear(self.kind).T
        return self.gather(values)

    def cell_fields(self) -> dict[str, np.ndarray] | None:
        """J, true field (V/m), Cauchy stress and pressure (Pa): values at the cells' middles.

        The stress includes its electrostatic part; the pressure is minus a third of its trace.
        """
        problem = self.problem
        values = np.zeros((self.owned_cells, 10))
        for kernel, evaluate in zip(problem.kernels, self._cell_expressions, strict=True):
            values[kernel.cells] = evaluate(problem.mesh, kernel.cells).reshape(-1, 10)
        gathered = self.gather(values)
        if gathered is None:
            return None
        stress: np.ndarray = np.zeros((len(gathered), 3, 3))
        for k, (i, j) in enumerate(_VOIGT):
            stress[:, i, j] = stress[:, j, i] = gathered[:, 4 + k]
        field = gathered[:, 1:4]
        if problem.scene.kinematics.axis_of_rotation:
            # the picture's plane is (r, z); the hoop direction comes last there
            turn = [0, 2, 1]
            stress, field = stress[:, turn][:, :, turn], field[:, turn]
        stress *= problem.scales.stress
        fields = {
            "J": gathered[:, 0],
            "cauchy_stress_Pa": stress.reshape(-1, 9),
            "pressure_Pa": -np.trace(stress, axis1=1, axis2=2) / 3,
        }
        if problem.potential is not None:
            fields["electric_field_V_per_m"] = field * problem.scales.field
            fields["field_strength_V_per_m"] = np.linalg.norm(field, axis=1) * problem.scales.field
        return fields

    # -------------------------------------------------------------- whole states

    def gather_state(self) -> np.ndarray | None:
        """The mixed function's values in each cell, in the order of the mesh file, on rank 0."""
        table = self.problem.W.dofmap.list[: self.owned_cells]
        return self.gather(self.problem.w.x.array[table])

    def fits(self, values: np.ndarray | None) -> bool:
        """Whether what `gather_state` gave (on rank 0) is a state of this problem.  Collective."""
        table = self.problem.W.dofmap.list
        cells = self.problem.comm.allreduce(self.owned_cells, op=MPI.SUM)
        good = values is None or (
            values.shape == (cells, table.shape[1]) and bool(np.isfinite(values).all())
        )
        return bool(self.problem.comm.bcast(good, root=0))

    def scattered(self, values: np.ndarray | None, factors: Factors) -> State:
        """The state that `gather_state` gave (on rank 0) at a load, on any number of ranks."""
        problem = self.problem
        shape = problem.comm.bcast(None if values is None else values.shape, root=0)
        if problem.comm.rank != 0:
            values = np.empty(shape)
        values = np.ascontiguousarray(values)
        problem.comm.Bcast(values, root=0)
        table = problem.W.dofmap.list[: self.owned_cells]
        carry = dolfinx.fem.Function(problem.W)
        carry.x.array[table.ravel()] = values[self.original].ravel()
        carry.x.scatter_forward()
        return State(carry.x.array.copy(), factors)


_VOIGT = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def _quadratic_from_linear(kind: str) -> np.ndarray:
    """Matrix from vertex values to the values at the nodes of the quadratic cell."""
    cell = getattr(basix.CellType, kind)
    linear = basix.create_element(basix.ElementFamily.P, cell, 1)
    quadratic = basix.create_element(
        basix.ElementFamily.P, cell, 2, basix.LagrangeVariant.gll_warped
    )
    return np.asarray(linear.tabulate(0, quadratic.points)[0, :, :, 0])


