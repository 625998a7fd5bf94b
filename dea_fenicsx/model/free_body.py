"""A free body: what holds it, and the axes about which dead loads turn it.

A free body is held by exactly one displacement of a single vertex for each rigid motion that is
left.  Since these displacements only prevent rigid motions, their reactions are 0 if the loads are
balanced, and the body deforms as if nothing held it.  Dead loads keep their direction in space, so
they may turn the body; then its rotations are not held.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.mesh.device import Device
from dea_fenicsx.model.components import Component
from dea_fenicsx.model.rigid_motions import FreePart
from dea_fenicsx.scene.declarations import SurfaceWork
from dea_fenicsx.support import compat

SMALLEST_PIN_SHARE = 0.1
"""A free motion is held at the first vertex if it moves this vertex by at least this share.

It is a share of the largest displacement by the motion anywhere in the part.
"""

OTHER_AXIS_WEIGHT = 0.1
"""Score of a displacement that is not along the last axis, relative to one along the last axis.

Layers are usually stacked along the last axis, so they contract across it by different amounts from
bottom to top.  If displacements across this axis were held at two different heights, this
contraction would turn the device.
"""

SCORE_TOLERANCE = 1e-6
"""Scores whose relative difference is smaller than this are equal but for rounding errors."""

PARALLEL_TOLERANCE = 1e-9
"""Squared share of the loads across a common direction, up to which all loads are parallel."""


@dataclass(frozen=True)
class Pin:
    """One displacement component of one vertex that is held.

    Attributes
    ----------
    axis
        Number of the displacement component.
    vertices
        The local vertices, none or one.
    place
        Dimensionless position of the vertex, shape (3,).
    """

    axis: int
    vertices: np.ndarray
    place: np.ndarray


@dataclass(frozen=True)
class HeldBody:
    """A free body and what holds it.

    Attributes
    ----------
    part
        The part of the mesh, with the rigid motions that nothing else holds.
    pins
        The displacement components that hold it: against all these motions, or against its
        translations where dead loads may turn it.
    axes
        Orthonormal axes about which dead loads turn it, shape (n, 3).
    turns
        The ramps of these loads; empty if nothing turns it.  If there are some, its rotations are
        unknowns, see `orientation_springs`.
    """

    part: FreePart
    pins: tuple[Pin, ...]
    axes: np.ndarray
    turns: frozenset[str]


def held_body(part: FreePart, device: Device, works: Iterable[SurfaceWork]) -> HeldBody:
    """Choose what holds a part of a device on whose surfaces loads do work.  Collective."""
    dead = [(work.ramp, work.direction) for work in works if work.direction is not None]
    axes = axes_turned(part, [direction for _, direction in dead])
    turns = frozenset(ramp for ramp, _ in dead) if len(axes) else frozenset()
    held = replace(part, motions=part.translations) if turns else part
    return HeldBody(part, tuple(pins(Corners(device, held))), axes, turns)


# ------------------------------------------------------------------------ what holds it


def pins(corners: Corners) -> Iterator[Pin]:
    """Choose what to hold, one displacement component of one vertex for each free motion.

    The choice depends on positions alone, not on numbers or ranks.  At the first vertex, the
    lowest along (1, 1, 1), every motion that moves it is held; `across` holds what is left.
    """
    free, rows = corners.part.motions, corners.rows()
    first = corners.best(-corners.x.sum(axis=1)[:, None])
    anchor = corners.place(first)
    at_anchor = corners.rows_at(anchor)
    while len(free):
        sizes = np.linalg.norm(at_anchor @ free.T, axis=1)
        largest = corners.largest(np.linalg.norm(rows @ free.T, axis=2))
        a = int(np.flatnonzero(sizes >= (1 - SCORE_TOLERANCE) * sizes.max())[0])
        if sizes[a] < SMALLEST_PIN_SHARE * largest:
            break
        yield corners.pin(first, a)
        free = without(free, at_anchor[a])
    yield from across(corners, anchor, free)


def across(corners: Corners, anchor: np.ndarray, free: np.ndarray) -> Iterator[Pin]:
    """Choose the displacements to hold so that nothing turns about an anchor.

    Each rotation is held at a vertex that lies far from the anchor along one axis, by a
    displacement across this axis.  Then a strain along the axes does not turn the body.  If the
    vertex lay obliquely, the body would turn: a slender actuator of 20 turns that shortens by 2.3 %
    would lean by 2.2 degrees, and one of 14 turns by 3.5 degrees at 13 %, which changes its height.

    Parameters
    ----------
    corners
        The corners of the part to choose from.
    anchor
        The place that is held already.
    free
        The free motions, see `FreePart.motions`.
    """
    kinematics, box = corners.part.kinematics, corners.part.box
    axes, n_turns, rows = kinematics.axes, kinematics.rotations, corners.rows()
    away = (corners.x - anchor) / box.half
    distance = np.maximum(np.linalg.norm(away, axis=1), 1e-300)
    aligned = np.max(np.abs(away), axis=1, initial=0.0) / distance
    liked = np.where(np.arange(len(axes)) == len(axes) - 1, 1.0, OTHER_AXIS_WEIGHT)
    while len(free):
        turns = free[:, :n_turns]
        if np.linalg.matrix_rank(turns, tol=1e-6) == len(free):
            free = np.linalg.solve(np.linalg.qr(turns.T)[1].T, free)  # by unit of angle
        moved = np.linalg.norm(rows @ free.T, axis=2)
        share = np.minimum(1.0, moved / distance[:, None])
        vertex, a = corners.best_of(liked * moved * (aligned[:, None] * share) ** 8)
        yield corners.pin(vertex, a)
        free = without(free, corners.rows_at(corners.place(vertex))[a])


def without(free: np.ndarray, row: np.ndarray) -> np.ndarray:
    """An orthonormal basis of those of the free motions that leave a displacement at 0."""
    values = free @ row
    keep = np.linalg.svd(values[None, :])[2][1:]
    basis = keep @ free
    return np.linalg.qr(basis.T)[0].T


class Corners:
    """Corners of the local cells of a part, and the choice of one among those of all ranks.

    All ranks identify a corner by its undeformed coordinates and its number in the mesh file.

    Parameters
    ----------
    device, part
        The device and the part.
    motion, state
        The displacement components and values of the mixed space, if the deformed positions count.

    Attributes
    ----------
    part
        The part.
    x
        Positions, dimensionless, shape (n, 3).
    """

    def __init__(
        self, device: Device, part: FreePart,
        motion: Sequence[Component] = (), state: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        mesh, tdim = device.mesh, device.dim
        self.part, self.comm = part, device.comm
        mesh.topology.create_connectivity(tdim, 0)
        mesh.topology.create_connectivity(0, tdim)
        link = mesh.topology.connectivity(tdim, 0)
        count = len(link.links(0)) if link.num_nodes else 0
        vertices = link.array.reshape(-1, count)[part.cells] if count else np.empty(0, np.int32)
        nodes = compat.geometry_dofmap(mesh)[:, :count][part.cells]
        self._vertices, which = np.unique(vertices.ravel(), return_index=True)
        nodes = nodes.ravel()[which]
        self._X = mesh.geometry.x[nodes]
        self._numbers = np.asarray(mesh.geometry.input_global_indices)[nodes]
        self.x = self._X.copy()
        for a, component in enumerate(motion if state is not None else ()):
            layout = component.space.dofmap.dof_layout
            at = [layout.entity_dofs(0, i)[0] for i in range(count)]
            dofs = component.dofs[component.space.dofmap.list[part.cells][:, at].ravel()[which]]
            self.x[:, a] += state[dofs]  # type: ignore[index]

    def rows(self) -> np.ndarray:
        """Each component of each rigid motion at each corner: (corners, axes, motions)."""
        return self._rows(self.x)

    def rows_at(self, place: np.ndarray) -> np.ndarray:
        """Each component of each rigid motion at a place: (axes, motions)."""
        return self._rows(place[None])[0]

    def _rows(self, x: np.ndarray) -> np.ndarray:
        kinematics, box = self.part.kinematics, self.part.box
        components = range(len(kinematics.axes))
        return np.stack([kinematics.rigid_motions(x, a, *box) for a in components], axis=1)

    def largest(self, scores: np.ndarray) -> float:
        """The largest score on any rank."""
        return max(self.comm.allgather(float(scores.max(initial=-np.inf))))

    def best_of(self, scores: np.ndarray) -> tuple[tuple, int]:
        """The corner and the column with the highest score; of equal ones the lowest position."""
        top = self.largest(scores)
        near = np.argwhere(scores >= top - SCORE_TOLERANCE * abs(top))
        mine = [
            (*self._X[i].tolist(), int(self._numbers[i]), int(column), *self.x[i].tolist())
            for i, column in near
        ]
        found = min(c for c in self.comm.allgather(min(mine, default=None)) if c is not None)
        return (*found[:4], *found[5:]), found[4]

    def best(self, scores: np.ndarray) -> tuple:
        """The corner with the highest score."""
        return self.best_of(scores)[0]

    @staticmethod
    def place(corner: tuple) -> np.ndarray:
        """Dimensionless position of a corner, shape (3,)."""
        return np.array(corner[4:])

    def pin(self, corner: tuple, axis: int) -> Pin:
        """One displacement component of a corner."""
        vertices = self._vertices[self._numbers == corner[3]].astype(np.int32)
        return Pin(axis, vertices, self.place(corner))


# ------------------------------------------------------------------- what dead loads turn


def axes_turned(part: FreePart, directions: Sequence[tuple[float, ...]]) -> np.ndarray:
    """Orthonormal axes about which loads of fixed directions turn a part, shape (n, 3).

    The part must be free to turn without strain, by any angle: free in the plane or in space, or
    free along a plane and about its normal, as half of a body by symmetry.  About an axis along
    which all dead loads point they have no moment, whatever its orientation.
    """
    kinematics = part.kinematics
    if not directions or not kinematics.cartesian:
        return np.empty((0, 3))
    axes = _free_axes(part.motions, kinematics.rotations)
    if not len(axes) or kinematics.dim == 2:
        return axes
    return _felt(axes, _summed(directions))


def _free_axes(motions: np.ndarray, n_turns: int) -> np.ndarray:
    """Orthonormal axes about which a body can turn by any angle without strain, shape (n, 3)."""
    none = np.empty((0, 3))
    if n_turns == 1:
        return np.eye(3)[2:] if len(motions) == 3 else none
    if len(motions) == 6:
        return np.eye(3)
    values, axes = np.linalg.svd(motions[:, :3])[1:]
    if len(motions) != 3 or np.count_nonzero(values > 1e-6) != 1:
        return none
    # The part is free along a plane.  The normal of the plane is the axis.
    moves = motions @ np.concatenate([np.zeros(3), axes[0]])
    return axes[:1] if np.max(np.abs(moves)) < 1e-6 else none


def _felt(axes: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Those of the axes, or combinations of them, along which not all loads point."""
    values, vectors = np.linalg.eigh(directions)
    if len(axes) == 1:
        along = axes[0] @ directions @ axes[0]
        total = np.trace(directions)
        return axes if total - along > PARALLEL_TOLERANCE * total else axes[:0]
    one = values[1] <= PARALLEL_TOLERANCE * values[2]
    return vectors[:, :2].T if one else axes


def _summed(directions: Sequence[tuple[float, ...]]) -> np.ndarray:
    """Sum of t t^T over the unit directions t, shape (3, 3)."""
    total = np.zeros((3, 3))
    for direction in directions:
        t = np.array(direction, dtype=float) / np.linalg.norm(direction)
        total += np.outer(t, t)
    return total
