"""A storey as a solid: where its corners are and how far its creases are folded."""

from __future__ import annotations

from typing import Any

import numpy as np

from dea_fenicsx.origami.kresling import Kresling
from dea_fenicsx.support.errors import InputError


def vertices(storey: Kresling, twist: Any) -> np.ndarray:
    """Corners at a twist phi in rad, or at an array of them.

    Returns
    -------
    numpy.ndarray
        In m, shape (..., 2, n, 3): bottom and top polygon, the axis along z.  Corner i of the top
        stands above corner i of the bottom at no twist; the diagonal leads to corner i + 1.

    Raises
    ------
    InputError
        For the printed chords, or a twist that the storey cannot have.
    """
    if not storey.is_solid:
        raise InputError("vertices: the printed chords belong to no solid; take the right ones.")
    phi = np.asarray(twist, dtype=float)
    h = np.broadcast_to(storey.at_twist(phi).height, phi.shape)
    corner = storey.step * np.arange(storey.sides)
    angle = np.stack(np.broadcast_arrays(corner, phi[..., None] + corner), axis=-2)
    z = np.stack(np.broadcast_arrays(0.0 * corner, h[..., None] + 0.0 * corner), axis=-2)
    return np.stack([storey.radius * np.cos(angle), storey.radius * np.sin(angle), z], axis=-1)


def fold_angles(storey: Kresling, twist: Any) -> dict[str, Any]:
    """Angles in rad by which the creases are folded: mountains positive, valleys negative.

    ``diagonal``, ``edge``, and ``side``: the crease between two storeys alike.
    """
    v = vertices(storey, twist)
    b, t = v[..., 0, :, :], v[..., 1, :, :]
    upper = (b[..., 0, :], t[..., 1, :], t[..., 0, :])  # counterclockwise from outside
    lower = (b[..., 0, :], b[..., 1, :], t[..., 1, :])
    beside = (b[..., 1, :], t[..., 2, :], t[..., 1, :])
    return {
        "diagonal": _fold(lower, upper),
        "edge": _fold(lower, beside),
        "side": np.pi - 2 * storey.at_twist(twist).panel_angle,
    }


def _fold(first: tuple[Any, ...], second: tuple[Any, ...]) -> Any:
    """Angle between the outward normals of two triangles, negative if they open outwards."""
    n1, n2 = (np.cross(p[1] - p[0], p[2] - p[0]) for p in (first, second))
    size = np.arctan2(np.linalg.norm(np.cross(n1, n2), axis=-1), np.sum(n1 * n2, axis=-1))
    away = np.sum(n1 * (sum(second) - sum(first)), axis=-1)
    return np.where(away > 0, -size, size)[()]
