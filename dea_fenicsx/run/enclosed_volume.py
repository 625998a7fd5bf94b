"""Displacements that would change the volume of an incompressible region, found before the solve.

If every surface of an incompressible region is held or moved along its normal, the prescribed
displacements alone determine its volume.  If they change it, there is no equilibrium, however small
the step, and without this check the linear solver would fail for no visible reason.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.kernels import measure
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.rigid_motions import components, regions_in
from dea_fenicsx.path.items import Item, March, Open, Trace
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.exchange import ghosts_at_owners

QUADRATURE_OF_VOLUME = 8
"""Degree of a quadrature that is exact for det F of quadratic displacements."""

VOLUME_TOLERANCE = 1e-8
"""Relative changes of volume, and shares of its gradient, that are below this are rounding."""

RAMP_SHARES = np.array([6, 3, 1, 2, 4, 5]) / 6
"""Shares of a ramp at which the volumes are checked, its end first.

A volume is a cubic polynomial in the displacements.  So if it is unchanged at four loads, it is
unchanged at all loads.  Loads between the steps must be checked as well, because a step may be
shortened to any size.
"""

NOWHERE: Mapping[str, float] = MappingProxyType({})
"""The factors of an undeformed state, at which every ramp is 0."""


def check_volume(
    problem: Problem, path: Sequence[Item], start: Mapping[str, float] = NOWHERE
) -> None:
    """Raise InputError if a path prescribes a change of an incompressible volume.  Collective.

    Parameters
    ----------
    problem
        The problem; its state is left as it was.
    path
        Ramps and traces, one after another.
    start
        Factors at which the path begins; those that are left out are 0.

    Raises
    ------
    InputError
        Naming the regions, the change of volume and the load.
    """
    if not _moves(problem):
        return
    chambers = _closed(problem)
    _check(
        problem, [_Chamber(problem, cells) for cells in chambers], _loads(problem, path, start)
    )


def _moves(problem: Problem) -> bool:
    """Whether any displacement, stretch or twist is prescribed that is not 0.  Collective."""
    dofs = problem.roles.owned(Role.MOTION)
    moves = any(np.any(base[dofs]) for base in problem.conditions.fixed_values.base.values())
    return bool(problem.comm.allreduce(moves, op=MPI.LOR))


def _check(
    problem: Problem, chambers: list[_Chamber], loads: Iterable[dict[str, float]]
) -> None:
    for factors in loads:
        rest = problem.under(problem.state.with_values(np.zeros(problem.size)), factors)
        with problem.at(problem.imposed(rest)):
            for chamber in chambers:
                _check_chamber(chamber, factors)


def _check_chamber(chamber: _Chamber, factors: Mapping[str, float]) -> None:
    change = chamber.change()
    if abs(change) > VOLUME_TOLERANCE and chamber.is_given():
        words = ", ".join(f"{n} factor {v:.6g}" for n, v in factors.items() if v)
        raise InputError(
            f"The prescribed displacements bring incompressible material in {chamber.where} to "
            f"{1 + change:.6g} times its volume at {words}: each of its surfaces is held or moved "
            "along its normal, so that none can give way; release one of them, or give the "
            "material a bulk_modulus."
        )


def _loads(
    problem: Problem, path: Sequence[Item], start: Mapping[str, float]
) -> Iterator[dict[str, float]]:
    """Ramp factors along the path, one after another."""
    scene = problem.scene
    factors = dict.fromkeys(scene.ramps, 0.0) | dict(start)
    for item in path:
        if isinstance(item, Trace):
            yield factors | {item.what: factors[item.what] + item.first}
            continue
        if isinstance(item, March):
            for share in RAMP_SHARES:
                time = share * item.seconds
                factors |= {name: wave(time) for name, wave in item.waves.items()}
                yield dict(factors)
            continue
        if isinstance(item, Open):
            continue
        names, start = item.names(scene), dict(factors)
        factors |= dict.fromkeys(names, float(item.to))
        for share in RAMP_SHARES:
            yield {n: (1 - share) * start[n] + share * factors[n] for n in factors}


class _Chamber:
    """Incompressible cells that are enclosed by surfaces with prescribed displacements.

    Parameters
    ----------
    problem
        The problem.
    cells
        Owned cells.
    """

    def __init__(self, problem: Problem, cells: np.ndarray) -> None:
        self.problem, self.comm = problem, problem.comm
        mesh, device = problem.mesh, problem.scene.device
        imap = mesh.topology.index_map(device.dim)
        mask = np.zeros(imap.size_local + imap.num_ghosts, dtype=bool)
        mask[cells] = True
        self.where = regions_in(device, mask)
        inside = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("DG", 0)))
        inside.x.array[inside.function_space.dofmap.list[cells].ravel()] = 1.0
        inside.x.scatter_forward()
        weight = problem.scene.kinematics.weight(ufl.SpatialCoordinate(mesh))
        dx = measure(device, [k.cells for k in problem.kernels], QUADRATURE_OF_VOLUME)
        self.volume = self._total(
            sum(inside * weight * dx(k) for k in range(len(problem.kernels)))
        )
        J = sum(inside * (s.J - 1) * weight * dx(k) for k, s in enumerate(problem.states))
        self._swelling: Any = compat.compile_form(J)
        self._gradient: Any = compat.compile_form(
            ufl.derivative(J, problem.w, ufl.TestFunction(problem.W))
        )

    def _total(self, form: Any) -> float:
        compiled = compat.compile_form(form)
        return self.comm.allreduce(float(dolfinx.fem.assemble_scalar(compiled)), op=MPI.SUM)

    def change(self) -> float:
        """Relative change of volume in the problem's present state.  Collective."""
        mine = float(dolfinx.fem.assemble_scalar(self._swelling))
        return self.comm.allreduce(mine, op=MPI.SUM) / self.volume

    def is_given(self) -> bool:
        """Whether no free unknown changes the volume, to first order, in the present state."""
        vector = dolfinx.fem.assemble_vector(self._gradient)
        vector.scatter_reverse(dolfinx.la.InsertMode.add)
        slope = vector.array[: self.problem.owned].copy()
        free = self.problem.restrict(slope)
        sums = np.array([np.sum(free**2), np.sum(slope**2)])
        free_sum, whole = self.comm.allreduce(sums, op=MPI.SUM)
        return bool(free_sum <= VOLUME_TOLERANCE**2 * whole)


# ------------------------------------------------------------------------------ what is closed


def _closed(problem: Problem) -> list[np.ndarray]:
    """Owned cells of each set of incompressible cells whose walls are all prescribed.  Collective.

    A facet is prescribed if all of its nodes are, along one axis at least.  Prescribed facets
    inside the region separate two sets if they are held along their normal, but not if they are
    held along themselves only.  So sets are formed both with and without such facets inside.
    """
    device = problem.scene.device
    tdim = device.dim
    imap = device.mesh.topology.index_map(tdim)
    n_cells = imap.size_local + imap.num_ghosts
    soft = np.zeros(n_cells, dtype=bool)
    for name, material in problem.parameters.materials.items():
        if material.bulk_modulus is None and not material.is_air:
            soft[device.cells_of(name)] = True
    held = _held_facets(problem)
    links = device.mesh.topology.connectivity(tdim - 1, tdim)
    counts = np.diff(links.offsets)
    two = np.flatnonzero(counts == 2)
    pairs = links.array[links.offsets[two][:, None] + np.arange(2)]
    joined = soft[pairs].all(axis=1)
    # A facet of an owned cell has all of its cells on this rank.  A facet is open if not held.
    one = np.flatnonzero(counts == 1)
    outer = links.array[links.offsets[one]]
    mixed = soft[pairs].any(axis=1) & ~joined
    edge = np.concatenate([outer[~held[one]], pairs[mixed & ~held[two]].ravel()]).astype(np.int64)
    edge = edge[soft[edge] & (edge < imap.size_local)]
    found: list[np.ndarray] = []
    for inside in (joined, joined & ~held[two]):
        labels, total = _labels(problem, n_cells, pairs[inside])
        opened = np.zeros(total, dtype=bool)
        opened[labels[edge]] = True
        used = np.zeros(total, dtype=bool)
        owned = labels[: imap.size_local][soft[: imap.size_local]]
        used[owned] = True
        for flags in (opened, used):
            problem.comm.Allreduce(MPI.IN_PLACE, flags, op=MPI.LOR)
        for k in np.flatnonzero(used & ~opened):
            cells = np.flatnonzero((labels[: imap.size_local] == k) & soft[: imap.size_local])
            known = any([
                problem.comm.allreduce(np.array_equal(cells, one), op=MPI.LAND) for one in found
            ])  # fmt: skip
            if not known:
                found.append(cells.astype(np.int32))
    return found


def _held_facets(problem: Problem) -> np.ndarray:
    """Mask of the local facets whose nodes are all prescribed along one axis.

    Facets on the axis of rotation, which have no area, count as prescribed.  So do the two ends of
    a periodic cell, which move alike, and periodic faces whose mean strain is given.
    """
    device, kinematics = problem.scene.device, problem.scene.kinematics
    topology, tdim = device.mesh.topology, device.dim
    imap = topology.index_map(tdim - 1)
    held = np.zeros(imap.size_local + imap.num_ghosts, dtype=bool)
    facets_of = topology.connectivity(tdim, tdim - 1)
    per_cell = len(facets_of.links(0)) if facets_of.num_nodes else 0
    facets = facets_of.array.reshape(facets_of.num_nodes, per_cell)
    fixed = problem.conditions.fixed_values.fixed
    for a, part in enumerate(problem.displacement):
        table, layout = part.space.dofmap.list, part.space.dofmap.dof_layout
        on_axis = np.zeros(len(part.dofs), dtype=bool)
        if kinematics.axis_of_rotation and a == 0:
            on_axis = part.space.tabulate_dof_coordinates()[:, 0] < 1e-12
        done = fixed[part.dofs] | on_axis
        for i in range(per_cell):
            nodes = table[:, layout.entity_closure_dofs(tdim - 1, i)]
            held[facets[done[nodes].all(axis=1), i]] = True
    given = problem.conditions.ties.given_surfaces(fixed)
    for name in (*(kinematics.periodic_ends or ()), *given):
        held[device.facets_by_surface[name]] = True
    return held


def _labels(problem: Problem, n_cells: int, pairs: np.ndarray) -> tuple[np.ndarray, int]:
    """A label for each local cell, equal where cells are joined by pairs on any rank."""
    comm, topology = problem.comm, problem.mesh.topology
    imap = topology.index_map(topology.dim)
    count, labels = components(n_cells, pairs[:, 0], pairs[:, 1])
    labels = labels + (comm.exscan(count) or 0)
    total = comm.allreduce(count, op=MPI.SUM)
    ghosts = np.arange(imap.num_ghosts)
    here, theirs = ghosts_at_owners(imap, comm, ghosts, labels[imap.size_local :])
    ties = np.column_stack([labels[here], theirs])
    ties = np.vstack(comm.allgather(np.unique(ties, axis=0)))
    return components(total, ties[:, 0], ties[:, 1])[1][labels], total
