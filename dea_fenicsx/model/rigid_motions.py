"""Rigid motions that no support of a scene prevents, found before anything is solved.

A part of the mesh is a set of cells that are joined through shared vertices.  Its rigid motions are
combinations of translations and of rotations about its middle.  Each fixed displacement adds one
row to a matrix: the displacement there by each of these motions.  The null space of the matrix,
from a singular value decomposition, holds the motions that are free.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from mpi4py import MPI

from dea_fenicsx.mesh.cell_quality import point
from dea_fenicsx.mesh.device import Device
from dea_fenicsx.model.components import Component
from dea_fenicsx.model.motion_words import BoundingCube, in_words
from dea_fenicsx.scene.kinematics_base import Kinematics
from dea_fenicsx.support import compat
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.exchange import ghosts_at_owners
from dea_fenicsx.support.later import Later

csgraph = Later("scipy.sparse.csgraph")
sparse = Later("scipy.sparse")

SMALLEST_HOLD = 1e-9
"""A motion with a smaller singular value, relative to the largest, is free.

The smallest singular value of a film that is clamped at its end is about its thickness over its
length, 1e-6 in an extreme case.
"""


class Ties(Protocol):
    """Periodic faces, see `periodic_faces.PeriodicTies`."""

    def joined_parts(self, parts: np.ndarray) -> tuple[np.ndarray, np.ndarray]: ...

    def restraints(
        self, kinematics: Kinematics, fixed: np.ndarray, parts: np.ndarray,
        boxes: Sequence[BoundingCube],
    ) -> list[np.ndarray]: ...


class Joined(NamedTuple):
    """Nodes that move as one body, and what of rigid motions that body prevents.

    Attributes
    ----------
    dofs
        Local degrees of freedom in the mixed space of the first displacement component there.
    rows
        Gives for the box of a part of the mesh one row for each condition on its rigid motions.
    """

    dofs: np.ndarray
    rows: Callable[[BoundingCube], np.ndarray]


@dataclass(frozen=True)
class FreePart:
    """A part of the mesh and the rigid motions that nothing prevents.

    A rigid motion is a row of coefficients of the columns of `Kinematics.rigid_motions` about the
    middle of the box, with lengths in units of half its size.

    Attributes
    ----------
    kinematics
        The kinematics of the scene.
    cells
        Mask of the local cells that belong to it.
    size
        How many cells it has over all ranks.
    count
        How many parts the mesh has.
    box
        The box around it.
    motions
        The free motions, shape (n, number of rigid motions), orthonormal.
    """

    kinematics: Kinematics
    cells: np.ndarray
    size: int
    count: int
    box: BoundingCube
    motions: np.ndarray

    @property
    def translations(self) -> np.ndarray:
        """An orthonormal basis of those combinations of its motions that do not rotate."""
        turns = self.kinematics.rotations
        if not turns:
            return self.motions
        basis, values, _ = np.linalg.svd(self.motions[:, :turns])
        still = np.ones(len(self.motions), dtype=bool)
        still[: len(values)] = values < 1e-6
        return np.asarray(basis[:, still].T @ self.motions)

    def holds(self, component: Component) -> np.ndarray:
        """Mask of the nodes of a displacement component that lie in the part."""
        mine = np.zeros(len(component.dofs), dtype=bool)
        mine[component.space.dofmap.list[self.cells].ravel()] = True
        return mine


def free_parts(
    device: Device, kinematics: Kinematics, motion: Sequence[Component], fixed: np.ndarray,
    joined: Sequence[Joined] = (),
    ties: Ties | None = None,
    cells: np.ndarray | None = None,
) -> list[FreePart]:  # fmt: skip
    """The parts of the device that can move freely, the largest first.  Collective.

    Parameters
    ----------
    device, kinematics
        The device and the kinematics.
    motion
        The displacement components.
    fixed
        Mask of the fixed local degrees of freedom of the mixed space.
    joined
        Nodes that move as one body, each with what it prevents.
    ties
        Periodic faces, which join the parts that they lie on, and prevent some of their rotations.
    cells
        Mask of the local cells that belong to the device; None for all.
    """
    labels, count = joined_parts(device, cells)
    if kinematics.periodic_ends is not None:
        # The two ends are tied, so two separate parts of one period may be one strand of the helix.
        labels, count = np.minimum(labels, 0), 1
    if ties:
        ends = np.array(ties.joined_parts(_part_of_dofs(motion, labels, len(fixed))))
        # Nodes beside cells that do not belong to the device join nothing.
        count, number = components(count, *ends[:, np.all(ends >= 0, axis=0)])
        labels = np.where(labels < 0, labels, number[labels])
    labels, count, names = _joined_again(motion[0], labels, count, joined)
    boxes = _boxes(device, labels, count)
    rows = _held(motion, fixed, labels, boxes, kinematics)
    if ties:
        more = ties.restraints(kinematics, fixed, _part_of_dofs(motion, labels, len(fixed)), boxes)
        rows = np.array([
            _triangle(np.vstack([held, tied])) if len(tied) else held
            for held, tied in zip(rows, more, strict=True)
        ])  # fmt: skip
    for one, k in zip(joined, names, strict=True):
        rows[k] = _triangle(np.vstack([rows[k], one.rows(boxes[k])]))
    owned = labels[: device.owned_cells()]
    found = []
    for k, box in enumerate(boxes):
        values, motions = np.linalg.svd(rows[k])[1:]
        free = motions[values <= SMALLEST_HOLD * max(values[0], 1e-300)]
        if len(free):
            size = device.comm.allreduce(int(np.count_nonzero(owned == k)), op=MPI.SUM)
            found.append(FreePart(kinematics, labels == k, size, count, box, free))
    return sorted(found, key=lambda part: (-part.size, *np.round(part.box.middle, 9)))


def refuse_free_parts(free: Sequence[FreePart], device: Device, cure: str) -> None:
    """Raise InputError if a part of the device can move freely.  Collective.

    Parameters
    ----------
    free
        The parts that nothing holds, the largest first.
    device
        The device.
    cure
        Names of the supports that may hold them.

    Raises
    ------
    InputError
        Naming the first part, if the mesh has several, and its motions.
    """
    if not free:
        return
    part, who = free[0], "The device"
    if part.count > 1:
        middle = point(part.box.middle * device.length, device.dim)
        where = regions_in(device, part.cells)
        who = (
            f"A part of {part.size} cells around {middle} ({where}) is not joined to the rest of "
            f"the mesh (which has {part.count} parts), and it"
        )
    words = in_words(part.kinematics, part.box, part.motions, device.length)
    raise InputError(f"{who} can move freely: {words}; add a {cure} that holds it.")


# -------------------------------------------------------------------------- parts of the mesh


def joined_parts(
    device: Device, cells: np.ndarray | None = None
) -> tuple[np.ndarray, int]:
    """The part that each local cell belongs to, and how many there are.  Collective.

    Parts are numbered alike on all ranks; a part may span several.  With `cells`, a mask, only
    these belong to parts; all others have the number -1.
    """
    mesh, comm = device.mesh, device.comm
    mesh.topology.create_connectivity(device.dim, 0)
    link = mesh.topology.connectivity(device.dim, 0)
    imap = mesh.topology.index_map(0)
    owned, n_vertices = imap.size_local, imap.size_local + imap.num_ghosts
    n_cells = link.num_nodes
    mine = np.ones(n_cells, dtype=bool) if cells is None else cells
    start = np.repeat(np.arange(n_cells), np.diff(link.offsets))
    kept = mine[start]
    local, of_node = components(n_cells + n_vertices, start[kept], n_cells + link.array[kept])
    offset = comm.exscan(local) or 0
    total = comm.allreduce(local, op=MPI.SUM)
    of_node = of_node + offset

    # A vertex that a rank shares with another rank connects the parts on both ranks.
    of_vertex = of_node[n_cells:]
    here, theirs = ghosts_at_owners(imap, comm, np.arange(imap.num_ghosts), of_vertex[owned:])
    ties = np.column_stack([of_vertex[here], theirs])
    ties = np.vstack(comm.allgather(np.unique(ties, axis=0)))
    _, joined = components(total, ties[:, 0], ties[:, 1])

    # A rank may have vertices that belong to none of its cells; they are no part.
    used = np.zeros(total, dtype=bool)
    used[joined[of_node[:n_cells][mine]]] = True
    comm.Allreduce(MPI.IN_PLACE, used, op=MPI.LOR)
    labels = (np.cumsum(used) - 1)[joined[of_node[:n_cells]]]
    return np.where(mine, labels, -1), int(used.sum())


def _joined_again(
    component: Component, labels: np.ndarray, count: int, joined: Sequence[Joined]
) -> tuple[np.ndarray, int, list[int]]:
    """Parts of the mesh, taken as one where nodes of several move as one body.  Collective.

    Returns the part of each cell, their number, and the part of each of the bodies.
    """
    if not joined:
        return labels, count, []
    table = component.space.dofmap.list
    part = np.full(len(component.dofs), -1)
    belongs = labels >= 0  # a node of such a cell may lie beside cells of no part, too
    part[table[belongs].ravel()] = np.repeat(labels[belongs], table.shape[1])
    touched = np.zeros((len(joined), count), dtype=bool)
    for k, one in enumerate(joined):
        mine = part[np.isin(component.dofs, one.dofs)]
        touched[k, mine[mine >= 0]] = True
    component.space.mesh.comm.Allreduce(MPI.IN_PLACE, touched, op=MPI.LOR)
    body, of_part = np.nonzero(touched)
    number, found = components(count + len(joined), count + body, of_part)
    labels = np.where(labels < 0, labels, found[labels])
    return labels, number, [int(k) for k in found[count:]]


def components(n: int, a: np.ndarray, b: np.ndarray) -> tuple[int, np.ndarray]:
    """Number of connected components of a graph on n nodes with edges (a, b), and their labels."""
    if n == 0:
        return 0, np.zeros(0, dtype=np.int64)
    edges = sparse.coo_array((np.ones(len(a)), (a, b)), shape=(n, n))
    count, labels = csgraph.connected_components(edges, False)
    return int(count), labels.astype(np.int64)


def _boxes(device: Device, labels: np.ndarray, count: int) -> list[BoundingCube]:
    """The box around each part."""
    mesh = device.mesh
    table = compat.geometry_dofmap(mesh)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    inside = labels >= 0
    x, labels = mesh.geometry.x[table[inside]], labels[inside]
    np.minimum.at(low, labels, x.min(axis=1, initial=np.inf))
    np.maximum.at(high, labels, x.max(axis=1, initial=-np.inf))
    device.comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
    device.comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
    return [
        BoundingCube((a + b) / 2, float((b - a).max()) / 2) for a, b in zip(low, high, strict=True)
    ]


def regions_in(device: Device, mask: np.ndarray) -> str:
    """Names of the regions with cells in a mask, collected over all ranks."""
    tags = {int(v) for i, v in zip(device.cells.indices, device.cells.values, strict=True)
            if mask[i]}  # fmt: skip
    tags = set().union(*device.comm.allgather(tags))
    names = sorted(name for name, tag in device.regions.items() if tag in tags)
    return f"region{'s' * (len(names) > 1)} {', '.join(names)}"


# -------------------------------------------------------------------------------- the motions


def _held(
    parts: Sequence[Component],
    fixed: np.ndarray,
    labels: np.ndarray,
    boxes: Sequence[BoundingCube],
    kinematics: Kinematics,
) -> np.ndarray:
    """For each part a triangle R with R^T R = sum over its fixed displacements of row^T row."""
    width = kinematics.rigid_motions(np.zeros((1, 3)), 0, np.zeros(3), 1.0).shape[1]
    triangles: np.ndarray = np.zeros((len(boxes), width, width))
    comm = parts[0].space.mesh.comm
    for a, component in enumerate(parts):
        table = component.space.dofmap.list
        part = np.full(len(component.dofs), -1)
        inside = labels >= 0
        part[table[inside].ravel()] = np.repeat(labels[inside], table.shape[1])
        held = np.flatnonzero(fixed[component.dofs] & (part >= 0))
        x = component.space.tabulate_dof_coordinates()[held]
        order = np.argsort(part[held], kind="stable")
        ends = np.searchsorted(part[held][order], np.arange(len(boxes) + 1))
        for k, box in enumerate(boxes):
            mine = x[order[ends[k] : ends[k + 1]]]
            if len(mine):
                rows = kinematics.rigid_motions(mine, a, *box)
                triangles[k] = _triangle(np.vstack([triangles[k], rows]))
    everyone = np.concatenate(comm.allgather(triangles), axis=1)
    return np.array([_triangle(rows) for rows in everyone])


def _part_of_dofs(
    motion: Sequence[Component], labels: np.ndarray, size: int
) -> np.ndarray:
    """The part of each of `size` local degrees of freedom; -1 where it is no displacement."""
    found = np.full(size, -1, dtype=np.int64)
    belongs = labels >= 0
    for part in motion:
        table = part.space.dofmap.list[belongs]
        found[part.dofs[table.ravel()]] = np.repeat(labels[belongs], table.shape[1])
    return found


def _triangle(rows: np.ndarray) -> np.ndarray:
    return np.linalg.qr(rows, mode="r")


# ----------------------------------------------------------------------------------- in words
