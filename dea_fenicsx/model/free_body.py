"""The displacements that hold a free body: exactly one for each rigid motion that is left.

They are displacements of single vertices.  Since they only prevent rigid motions, their reactions
are 0 if the loads are balanced, and the body deforms as if it were free.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dea_fenicsx.mesh.device import Device
from dea_fenicsx.model.components import Component
from dea_fenicsx.model.rigid_motions import Box, FreePart, free_parts, modes
from dea_fenicsx.scene.kinematics_base import Kinematics
from dea_fenicsx.scene.scene import Scene
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


def released(scene: Scene, parts: list[Component], fixed: np.ndarray) -> FreePart | None:
    """The rigid motions that the other supports leave to a device; None if they leave none.

    If several separate parts can move, the largest of them is the free body; `check_rigid` refuses
    the others.  Collective.
    """
    free = free_parts(scene, parts, fixed)
    return free[0] if free else None


def pins(scene: Scene, part: FreePart) -> Iterator[Pin]:
    """Choose what to hold, one displacement component of one vertex for each free motion.

    The choice depends on positions alone, not on numbers or ranks.  At the first vertex, the
    lowest along (1, 1, 1), every motion that moves it is held; `across` holds what is left.
    """
    corners = Corners(scene.device, part)
    kinematics, free = scene.kinematics, part.motions
    rows = corners.rows(kinematics, part.box)
    first = corners.best(-corners.x.sum(axis=1)[:, None])
    anchor = corners.place(first)
    at_anchor = np.vstack(
        [modes(anchor[None], a, kinematics, part.box) for a in range(len(kinematics.axes))]
    )
    while len(free):
        sizes = np.linalg.norm(at_anchor @ free.T, axis=1)
        largest = corners.largest(np.linalg.norm(rows @ free.T, axis=2))
        a = int(np.flatnonzero(sizes >= (1 - SCORE_TOLERANCE) * sizes.max())[0])
        if sizes[a] < SMALLEST_PIN_SHARE * largest:
            break
        yield corners.pin(first, a)
        free = without(free, at_anchor[a])
    yield from across(scene, corners, part.box, anchor, free)


def across(
    scene: Scene, corners: Corners, box: Box, anchor: np.ndarray, free: np.ndarray
) -> Iterator[Pin]:
    """Choose the displacements to hold so that nothing turns about an anchor.

    Each rotation is held at a vertex that lies far from the anchor along one axis, by a
    displacement across this axis.  Then a strain along the axes does not turn the body.  If the
    vertex lay obliquely, the body would turn: a slender actuator of 20 turns that shortens by 2.3 %
    would lean by 2.2 degrees, and one of 14 turns by 3.5 degrees at 13 %, which changes its height.

    Parameters
    ----------
    scene, corners, box
        The scene, the corners to choose from, and the box of their part.
    anchor
        The place that is held already.
    free
        The free motions, rows of coefficients of `modes`.
    """
    kinematics, axes = scene.kinematics, scene.kinematics.axes
    n_turns = kinematics.rotations
    rows = corners.rows(kinematics, box)
    away = (corners.x - anchor) / (box.size / 2)
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
        free = without(free, modes(corners.place(vertex)[None], a, kinematics, box)[0])


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
    parts, state
        The displacement components and values of the mixed space, if the deformed positions count.

    Attributes
    ----------
    x
        Positions, dimensionless, shape (n, 3).
    """

    def __init__(
        self, device: Device, part: FreePart,
        parts: Sequence[Component] = (), state: np.ndarray | None = None,
    ) -> None:  # fmt: skip
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
        self._X = mesh.geometry.x[nodes]
        self._numbers = np.asarray(mesh.geometry.input_global_indices)[nodes]
        self.x = self._X.copy()
        for a, component in enumerate(parts if state is not None else ()):
            layout = component.space.dofmap.dof_layout
            at = [layout.entity_dofs(0, i)[0] for i in range(count)]
            dofs = component.dofs[component.space.dofmap.list[part.cells][:, at].ravel()[which]]
            self.x[:, a] += state[dofs]  # type: ignore[index]

    def rows(self, kinematics: Kinematics, box: Box) -> np.ndarray:
        """Each component of each rigid motion at each corner: (corners, axes, motions)."""
        components = range(len(kinematics.axes))
        return np.stack([modes(self.x, a, kinematics, box) for a in components], axis=1)

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
