"""The axes about which dead loads turn a free body.  Dead loads keep their direction in space."""

from __future__ import annotations

import numpy as np

from dea_fenicsx.model.rigid_motions import FreePart, translations
from dea_fenicsx.scene.scene import Scene

PARALLEL_TOLERANCE = 1e-9
"""Squared share of the loads across a common direction, up to which all loads are parallel."""


def split_turns(scene: Scene, part: FreePart) -> tuple[np.ndarray, frozenset[str]]:
    """The free motions of a part that are to be held, and the ramps that turn it.

    If dead loads turn the part, only its translations are held; otherwise all motions are held.

    Returns
    -------
    held : ndarray of shape (n, number of rigid motions)
        Rows of motions to be held.
    turns : frozenset
        Ramps of the dead loads; empty if all motions are to be held.
    """
    if not len(felt_axes(scene, part)):
        return part.motions, frozenset()
    held = translations(part.motions, scene.kinematics.rotations)
    return held, frozenset(ramp for ramp, _ in _dead_loads(scene))


def felt_axes(scene: Scene, part: FreePart | None) -> np.ndarray:
    """Orthonormal axes about which dead loads turn a part of the device, shape (n, 3).

    The part must be free to turn without strain, by any angle: free in the plane or in space, or
    free along a plane and about its normal, as half of a body by symmetry.  About an axis along
    which all dead loads point they have no moment, whatever its orientation.
    """
    loads = _dead_loads(scene)
    if part is None or not loads or not scene.kinematics.cartesian:
        return np.empty((0, 3))
    axes = _turning_axes(part.motions, scene.kinematics.rotations)
    if not len(axes) or scene.device.dim == 2:
        return axes
    return _felt(axes, _directions([load for _, load in loads]))


def _dead_loads(scene: Scene) -> list[tuple[str, tuple[float, ...]]]:
    """Ramp and direction of the loads that turn a free body."""
    told = [work for _, work in scene.declared.surface_works]
    return [(work.ramp, work.direction) for work in told if work.direction is not None]


def _turning_axes(motions: np.ndarray, n_turns: int) -> np.ndarray:
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


def _directions(loads: list[tuple[float, ...]]) -> np.ndarray:
    """Sum over loads of t t^T with t their unit directions, shape (3, 3)."""
    total = np.zeros((3, 3))
    for load in loads:
        t = np.array(load, dtype=float) / np.linalg.norm(load)
        total += np.outer(t, t)
    return total
