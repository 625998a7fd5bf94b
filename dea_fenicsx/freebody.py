"""Which displacements hold a free body: as many as there are rigid motions left, and no more.

Displacements of single vertices are held.  As they prevent rigid motions alone, they bear no force
where the loads balance, and the body deforms as if it were free.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dea_fenicsx import compat
from dea_fenicsx.components import Component
from dea_fenicsx.mesh import Device
from dea_fenicsx.rigid import FreePart, free_parts, modes, rotations
from dea_fenicsx.scene import Scene

CLEAR = 0.1
"""Share of the largest displacement by a free motion from which on the first vertex is held."""

TIE = 1e-6
"""Relative difference of two scores that counts as rounding."""


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
        Dimensionless coordinates of the vertex, shape (3,).
    """

    axis: int
    vertices: np.ndarray
    place: np.ndarray


def released(scene: Scene, parts: list[Component], fixed: np.ndarray) -> FreePart | None:
    """The rigid motions that the other supports leave to a device; None if they leave none.

    Of several separate parts that can move it is the largest: one free body is one body, and
    `check_rigid` tells of the others.  Collective.
    """
    free = free_parts(scene, parts, fixed)
    return free[0] if free else None


def pins(scene: Scene, part: FreePart) -> Iterator[Pin]:
    """Choose what to hold, one displacement component of one vertex for each free motion.

    The choice depends on positions alone, not on numbers or ranks.  At the first vertex, the
    lowest along (1, 1, 1), every motion that moves it is held.  What is left turns about it; each
    rotation is held at a vertex that lies far off along an axis, across this axis.  Then a strain
    along the axes turns nothing.  Held across an oblique line, a slender actuator of 20 turns that
    shortens by 2.3 % leans by 2.2 degrees, and at 13 % one of 14 turns by 3.5 degrees, which its
    height then feels.
    """
    device = scene.device
    corners = _Corners(device, part)
    axes, free = scene.kinematics.axes, part.motions
    n_axes, n_turns = len(axes), rotations(axes)
    x = corners.x
    rows = np.stack([modes(x, a, axes, part.box) for a in range(n_axes)], axis=1)
    first = corners.best(-x.sum(axis=1)[:, None])
    anchor = corners.place(first)
    at_anchor = np.vstack([modes(anchor[None], a, axes, part.box) for a in range(n_axes)])
    while len(free):
        sizes = np.linalg.norm(at_anchor @ free.T, axis=1)
        largest = corners.largest(np.linalg.norm(rows @ free.T, axis=2))
        a = int(np.flatnonzero(sizes >= (1 - TIE) * sizes.max())[0])
        if sizes[a] < CLEAR * largest:
            break
        yield corners.pin(first, a)
        free = _without(free, at_anchor[a])
    away = (x - anchor) / (part.box.size / 2)
    distance = np.maximum(np.linalg.norm(away, axis=1), 1e-300)
    aligned = np.max(np.abs(away), axis=1, initial=0.0) / distance
    while len(free):
        turns = free[:, :n_turns]
        if np.linalg.matrix_rank(turns, tol=1e-6) == len(free):
            free = np.linalg.solve(np.linalg.qr(turns.T)[1].T, free)  # by unit of angle
        moved = np.linalg.norm(rows @ free.T, axis=2)
        across = np.minimum(1.0, moved / distance[:, None])
        vertex, a = corners.best_of(moved * (aligned[:, None] * across) ** 8)
        yield corners.pin(vertex, a)
        at = corners.place(vertex)[None]
        free = _without(free, modes(at, a, axes, part.box)[0])


def _without(free: np.ndarray, row: np.ndarray) -> np.ndarray:
    """An orthonormal basis of those of the free motions that leave a displacement at 0."""
    values = free @ row
    keep = np.linalg.svd(values[None, :])[2][1:]
    basis = keep @ free
    return np.linalg.qr(basis.T)[0].T


class _Corners:
    """Corners of the local cells of a part, and the choice of one among those of all ranks.

    A corner is known on all ranks by its coordinates and its number in the mesh file.

    Parameters
    ----------
    device, part
        The device and the part.
    """

    def __init__(self, device: Device, part: FreePart) -> None:
        mesh, tdim = device.mesh, device.dim
        self.comm = device.comm
        mesh.topology.create_connectivity(tdim, 0)
        mesh.topology.create_connectivity(0, tdim)
        link = mesh.topology.connectivity(tdim, 0)
        count = len(link.links(0)) if link.num_nodes else 0
        vertices = link.array.reshape(-1, count)[part.cells] if count else np.empty(0, np.int32)
        nodes = compat.geometry_dofmap(mesh)[:, :count][part.cells]
        self._vertices, which = np.unique(vertices.ravel(), return_index=True)
        nodes = nodes.ravel()[which]
        self.x = mesh.geometry.x[nodes]
        self._numbers = np.asarray(mesh.geometry.input_global_indices)[nodes]

    def largest(self, scores: np.ndarray) -> float:
        """The largest score on any rank."""
        return max(self.comm.allgather(float(scores.max(initial=-np.inf))))

    def best_of(self, scores: np.ndarray) -> tuple[tuple, int]:
        """The corner and the column with the highest score; of equal ones the lowest position."""
        top = self.largest(scores)
        near = np.argwhere(scores >= top - TIE * abs(top))
        mine = [
            (*map(float, self.x[i]), int(self._numbers[i]), int(column)) for i, column in near
        ]
        found = min(c for c in self.comm.allgather(min(mine, default=None)) if c is not None)
        return found[:4], found[4]

    def best(self, scores: np.ndarray) -> tuple:
        """The corner with the highest score."""
        return self.best_of(scores)[0]

    @staticmethod
    def place(corner: tuple) -> np.ndarray:
        """Dimensionless coordinates of a corner, shape (3,)."""
        return np.array(corner[:3])

    def pin(self, corner: tuple, axis: int) -> Pin:
        """One displacement component of a corner."""
        vertices = self._vertices[self._numbers == corner[3]].astype(np.int32)
        return Pin(axis, vertices, self.place(corner))
