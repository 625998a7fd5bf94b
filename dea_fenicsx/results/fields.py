"""Fields of a state for pictures: at the nodes of a grid, and one value a cell.

The grid is of first or second degree, see `FieldWriter`.  It is numbered by the mesh file's own
order of cells, so results are the same on any number of ranks.  Each rank has a block of the rows;
small tables are gathered on rank 0, large ones stay spread (`dea_fenicsx.results.spread`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.mesh.device import group_size
from dea_fenicsx.model.components import Component
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import Factors, State
from dea_fenicsx.results.axes import axes_of_fields
from dea_fenicsx.results.contact_pressure import contact_pressure
from dea_fenicsx.results.file_order import FileOrder, by_first_appearance
from dea_fenicsx.results.grids import (
    Grid,
    SurfaceGrid,
    facet_nodes,
    quadratic_from_linear,
    surface_grid,
)
from dea_fenicsx.results.moment import NO_MOMENT, MomentInTime, history_of, table_of, width
from dea_fenicsx.results.split_grid import Block, SplitGrid, SplitNodes, count_is_small, split
from dea_fenicsx.results.spread import MOST_WHOLE, Spread, collected, dealt, serving
from dea_fenicsx.results.within_cells import Evaluated, Fields, WithinCells
from dea_fenicsx.support import compat
from dea_fenicsx.support.cell_types import BY_DEGREE
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import known

__all__ = ["FieldWriter", "Fields", "Grid", "SurfaceGrid"]


class FieldWriter:
    """Evaluates the fields of a problem and gives them to rank 0, in the grid's order.

    Every method is collective.  Tables of a small grid are gathered on rank 0, and None on all
    others.  Those of a grid of more than `MOST_WHOLE` nodes on several ranks are `Spread`.

    The cells of the grid are of second degree if the geometry, the displacement or the potential is
    of second degree or higher, else of first.  A field of lower degree is exact on them.  Fields
    and geometry of degree 3 and more are interpolated at the nodes of quadratic cells, and what is
    between these nodes is lost.

    Parameters
    ----------
    problem
        The problem.
    surfaces
        Facet groups that get a grid of their own, each facet once.

    Attributes
    ----------
    grid
        The grid of the whole device, on rank 0; if its tables are spread, on all ranks.
    surface_grids
        The grid of each of the surfaces, on rank 0; empty on all others.

    Raises
    ------
    InputError
        If there is no such facet group in the mesh, or it has no facets.
    """

    def __init__(self, problem: Problem, surfaces: Sequence[str] = ()) -> None:
        self.problem = problem
        mesh = problem.mesh
        self.kind = mesh.topology.cell_name()
        self.parts = problem.displacement
        self.owned_cells = problem.scene.device.owned_cells()
        original = np.asarray(mesh.topology.original_cell_index)[: self.owned_cells]
        self.order = FileOrder(problem.comm, original)
        names = (surfaces,) if isinstance(surfaces, str) else tuple(dict.fromkeys(surfaces))
        self._check_surfaces(names)
        self._choose_nodes()
        self._within = WithinCells(problem, self.owned_cells)
        self._split: SplitNodes | None = None
        self._large = False
        self.grid = self._build_grid()
        self.surface_grids = self._build_surfaces(names)

    def _check_surfaces(self, names: tuple[str, ...]) -> None:
        device = self.problem.scene.device
        for name in names:
            known(name, device.surfaces, "facet group")
            if device.dim == 1:
                raise InputError(
                    f"The surface {name!r} is an end of a meridian, so it has no fields of its own;"
                    " leave it out."
                )
            if group_size(device, name) == 0:
                raise InputError(f"The surface {name!r} has no facets, so it has no fields.")

    def _choose_nodes(self) -> None:
        """Choose the degree of the grid, and the scalar space whose nodes are those of the grid."""
        mesh, potential = self.problem.mesh, self.problem.potential
        parts = [*self.parts, *([potential] if potential is not None else [])]
        degrees = [_degree(part) for part in parts]
        self.degree = min(2, max(*degrees, compat.coordinate_element(mesh).degree))
        fitting = [part.space for part in self.parts if _degree(part) == self.degree]
        element = ("Lagrange", self.degree)
        self._nodes = fitting[0] if fitting else dolfinx.fem.functionspace(mesh, element)

    def gather(self, values: np.ndarray) -> Any:
        """Values of the owned cells of all ranks as a table in the order of the mesh file."""
        return self._table(self.order.rows(values))

    def _table(self, block: np.ndarray) -> Any:
        return collected(self.problem.comm, block, self._large)

    def _nodal(self, part: Any, array: np.ndarray) -> np.ndarray:
        """Values of a field at the grid's nodes of each owned cell, in basix's order.

        Parameters
        ----------
        part
            A displacement component or the potential.
        array
            Local values of the mixed space.

        Returns
        -------
        ndarray of shape (cells, nodes)
        """
        table = part.space.dofmap.list[: self.owned_cells]
        degree = _degree(part)
        if degree > 2:  # such elements number their nodes in each cell in another way
            found, grid = dolfinx.fem.Function(part.space), dolfinx.fem.Function(self._nodes)
            found.x.array[:] = array[part.dofs]
            grid.interpolate(found)
            return grid.x.array[self._nodes.dofmap.list[: self.owned_cells]]
        values = array[part.dofs[table]]
        if degree == 0:  # the voltage through a membrane, one number in each cell
            return np.repeat(values, self._nodes.dofmap.list.shape[1], axis=1)
        return values if degree == self.degree else values @ quadratic_from_linear(self.kind).T

    def _build_grid(self) -> Grid | None:
        problem = self.problem
        space = self._nodes
        table = space.dofmap.list[: self.owned_cells]
        imap = space.dofmap.index_map
        local = np.arange(imap.size_local + imap.num_ghosts, dtype=np.int32)
        numbers = imap.local_to_global(local)[table]
        coordinates = space.tabulate_dof_coordinates()[table] * problem.scales.length
        cells = problem.scene.device.cells
        tags = np.zeros(int(cells.indices.max(initial=-1)) + 1, dtype=np.int32)
        tags[cells.indices] = cells.values
        regions, comm = tags[: self.owned_cells].astype(np.int64), problem.comm
        table, self._first = by_first_appearance(comm, self.order.rows(numbers), self.order.start)
        self.count = int(comm.allreduce(len(self._first), op=MPI.SUM))
        self._large = comm.size > 1 and self.count > MOST_WHOLE
        self._points = self.order.rows(coordinates).reshape(-1, 3)[self._first]
        self._block = Block(
            comm, self.kind, self.degree, table, self.order.start, self.order.rows(regions),
            len(self._first),
        )  # fmt: skip
        self._connectivity = self._table(table)
        return self._grid_of(self._points, table)

    def _grid_of(self, points: np.ndarray, table: np.ndarray) -> Grid | None:
        """A grid from this rank's block of its nodes and cells; None if another rank has it."""
        problem = self.problem
        order = BY_DEGREE[self.degree][self.kind].vtk_order
        names = {tag: name for name, tag in problem.scene.device.regions.items()}
        axes = axes_of_fields(problem.scene.kinematics)
        blocks = (points, table[:, order], self._block.regions)
        places, cells, regions = (self._table(block) for block in blocks)
        if places is None:
            return None
        return Grid(places, cells, self.kind, regions, self.degree, names, axes)

    def _build_surfaces(self, names: tuple[str, ...]) -> dict[str, SurfaceGrid]:
        """The grid of each surface on rank 0.  Collective."""
        device, comm = self.problem.scene.device, self.problem.comm
        sides = {n: comm.gather(self._sides(device.facets_by_surface[n]), root=0) for n in names}

        def build() -> dict[str, SurfaceGrid]:
            assert self.grid is not None
            return {
                name: surface_grid(self.grid, self._connectivity, np.concatenate(parts))
                for name, parts in sides.items()
            }

        return serving(comm, build) or {} if names else {}

    def named_facets(self) -> dict[str, SurfaceGrid]:
        """The grid of each facet group of the mesh that has facets, on rank 0.  Collective."""
        return self._build_surfaces(self._named())

    def _named(self) -> tuple[str, ...]:
        """The facet groups of the mesh that have facets.  Collective."""
        device = self.problem.scene.device
        if device.dim == 1:  # the ends of a meridian are points
            return ()
        return tuple(name for name in device.surfaces if group_size(device, name))

    def _sides(self, facets: np.ndarray) -> np.ndarray:
        """Each side of some facets that lies in an owned cell.

        Returns
        -------
        ndarray of shape (n, 2)
            Number of the cell in the mesh file, and of the facet within the cell.
        """
        cells, numbers = np.nonzero(self._on(facets))
        return np.column_stack([self.order.places[cells], numbers])

    def _on(self, facets: np.ndarray) -> np.ndarray:
        """Whether each facet of the owned cells is among some, shape (cells, facets)."""
        topology, dim = self.problem.mesh.topology, self.problem.mesh.topology.dim
        to_facets = topology.connectivity(dim, dim - 1)
        chosen = np.zeros(int(to_facets.array.max(initial=-1)) + 1, dtype=bool)
        chosen[facets] = True
        size = len(facet_nodes(self.kind, 1)[1])
        return chosen[to_facets.array.reshape(-1, size)[: self.owned_cells]]

    def surface_fields(
        self, nodes: Fields | None, cells: Fields | None
    ) -> dict[str, tuple[Fields, Fields]]:
        """Fields on each surface's grid, taken from those of the whole device.

        Parameters
        ----------
        nodes, cells
            What `node_fields` and `cell_fields` gave, on rank 0.

        Returns
        -------
        dict
            For each surface the values at its nodes, and of each of its facets those of the cell
            behind it.  Of two cells it is the one that comes first in the mesh file.  Empty on all
            ranks but 0.
        """

        def part(fields: Mapping[str, np.ndarray], rows: np.ndarray) -> Fields:
            return {name: values[rows] for name, values in fields.items()}

        def take() -> dict[str, tuple[Fields, Fields]]:
            return {
                name: (part(nodes or {}, grid.nodes), part(cells or {}, grid.parents))
                for name, grid in self.surface_grids.items()
            }

        return serving(self.problem.comm, take) or {}

    def vector(self, state: np.ndarray) -> Any:
        """The displacement part of a state, dimensionless, as a table at the grid's nodes."""
        return self._table(self._vector(state))

    def _vector(self, state: np.ndarray) -> np.ndarray:
        """The same at the nodes of this rank's block."""
        u = np.zeros((len(self._first), 3))
        for a, part in enumerate(self.parts):
            u[:, a] = self._at_nodes(part, state)
        return u

    def _at_nodes(self, part: Component, state: np.ndarray) -> np.ndarray:
        """Values of a displacement component or the potential at the nodes of this rank's block."""
        return self.order.rows(self._nodal(part, state)).ravel()[self._first]

    def node_fields(self) -> Any:
        """Displacement (m) and potential (V) at the grid's nodes.

        Of a helical cell the displacement is that of the section Theta = 0, along (r, z, hoop).
        """
        return self._tables(self._node_fields())

    def _node_fields(self) -> Fields:
        """The same at the nodes of this rank's block."""
        problem, state = self.problem, self.problem.w.x.array
        overall = problem.space.global_values(problem.scales.length)
        u = self._vector(state) * problem.scales.length
        u = problem.scene.kinematics.section(self._points, u, overall)
        fields = {"displacement_m": u}
        if problem.potential is not None:
            phi = self._at_nodes(problem.potential, state) * problem.scales.potential
            fields["potential_V"] = phi
        return fields

    def _tables(self, fields: Fields) -> Any:
        """Fields of this rank's block as tables; None if they were gathered on another rank."""
        found = {name: self._table(values) for name, values in fields.items()}
        return found if all(one is not None for one in found.values()) else None

    def evaluate(self) -> Evaluated:
        """J, the electric field and the stress of the present state in the owned cells."""
        return self._within.evaluate()

    def cell_fields(self, values: Evaluated | None = None) -> Any:
        """J, true field (V/m), Cauchy stress and pressure (Pa): values at the cells' middles.

        The stress includes its electrostatic part; the pressure is minus a third of its trace.
        With obstacles there is the contact pressure (Pa) on the facets of each cell, too.
        Components are ordered by `Grid.axes`: (x, y, z), or (r, z, hoop) in a body of revolution
        and a helical cell.  The strength of the field in MV/m is NaN in regions without a field.

        Parameters
        ----------
        values
            What `evaluate` gave, if it has been called for this state.
        """
        values = self.evaluate() if values is None else values
        rows = self.order.rows
        fields = self._within.named(rows(values.middle), rows(values.live))
        pressed = contact_pressure(self.problem, self.owned_cells)
        if pressed is not None:
            fields["contact_pressure_Pa"] = rows(pressed)
        return self._tables(fields)

    def split(self) -> SplitGrid | None:
        """The grid for `nodal_fields`, split at the faces of regions and at named surfaces.

        None if it would have too many nodes, and where `grid` is None.
        """
        if not count_is_small(self.count):
            return None
        groups = self.problem.scene.device.facets_by_surface
        chosen = [groups[name] for name in self._named()]
        facets = np.unique(np.concatenate([np.empty(0, dtype=np.int32), *chosen]))
        self._split = made = split(self._block, self.order.rows(self._on(facets)))
        points, origin = made.taken(self._points), self._table(made.origin)
        grid = self._grid_of(points, made.table) if made.split else self.grid
        return None if grid is None else SplitGrid(grid, origin)

    def nodal_fields(self, values: Evaluated | None = None) -> Any:
        """The fields of `node_fields` and `cell_fields` at the split grid's nodes, as float32.

        Each value of a cell's field is the mean over the cells on one side of regions and named
        surfaces; in each cell it is that of the polynomial of degree 1 through the values at the
        Gauss points.  None if there is no split grid.

        Parameters
        ----------
        values
            As in `cell_fields`.
        """
        made, rows = self._split, self.order.rows
        if made is None:
            return None
        values = self.evaluate() if values is None else values
        fields = self._node_fields().items()
        found = {name: made.taken(field).astype(np.float32) for name, field in fields}
        averages = made.averages(rows(values.inner), self._within.to_nodes(self.degree))
        lives = rows(values.live)[made.cells]
        return self._tables(found | self._within.named_short(averages, lives))

    # -------------------------------------------------------------- whole states

    def gather_state(self) -> Any:
        """The mixed function's values in each cell, as a table in the order of the mesh file.

        Behind them stands the history, if the problem keeps one.
        """
        table = self.problem.W.dofmap.list[: self.owned_cells]
        values = self.problem.w.x.array[table]
        return self.gather(np.hstack([values, table_of(self.problem, self.owned_cells)]))

    def fits(self, values: Any, moment: MomentInTime = NO_MOMENT) -> bool:
        """Whether what `gather_state` gave is a state of this problem.  Collective."""
        columns, more = self.problem.W.dofmap.list.shape[1], width(self.problem, moment)
        good = True
        if values is not None:  # a spread table may belong to another communicator
            mine = values.block if isinstance(values, Spread) else values
            good = (
                more is not None and values.shape == (self.order.count, columns + more)
                and bool(np.isfinite(mine).all())
            )  # fmt: skip
        return bool(self.problem.comm.allreduce(good, op=MPI.LAND))

    def scattered(
        self, values: Any, factors: Factors, moment: MomentInTime = NO_MOMENT
    ) -> State:
        """The state that `gather_state` gave at a load, on any number of ranks."""
        problem = self.problem
        table = problem.W.dofmap.list[: self.owned_cells]
        carry = dolfinx.fem.Function(problem.W)
        mine = self.order.back(dealt(problem.comm, values))
        carry.x.array[table.ravel()] = mine[:, : table.shape[1]].ravel()
        carry.x.scatter_forward()
        history = history_of(problem, mine[:, table.shape[1] :], moment)
        return State(carry.x.array.copy(), factors, moment.now, history=history)


def _degree(part: Component) -> int:
    """Polynomial degree of a scalar part's element."""
    return int(part.space.ufl_element().basix_element.degree)
