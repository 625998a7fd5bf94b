"""Where a function of the place is 0 within a box: triangles in space, and lines in a plane."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dea_fenicsx.pictures.section import TETRAHEDRA, cut

FINE_IN_SPACE, FINE_IN_PLANE = 40, 160
"""Cubes along the longest side of a box, and squares along that of a rectangle."""

PLANES_OF_NET, FINE_IN_NET = 13, 48
"""Planes of a net along each axis, and squares along the longest side of each of them."""


def surface(
    function: Callable[[np.ndarray], np.ndarray], low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Corners of triangles of the surface on which a function is 0, shape (n, 3, 3).

    Parameters
    ----------
    function
        Its value at points of shape (n, 3).
    low, high
        Corners of the box.
    """
    points, numbers = _grid(low, high, FINE_IN_SPACE)
    values = function(points)
    size = [n - 1 for n in numbers.shape]
    corners = np.stack([
        numbers[i : i + size[0], j : j + size[1], k : k + size[2]].ravel()
        for i, j, k in ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0),
                        (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
    ], axis=1)  # fmt: skip
    above = values[corners] > 0
    corners = corners[above.any(axis=1) & ~above.all(axis=1)]
    tets = corners[:, np.array(TETRAHEDRA[12])].reshape(-1, 4)
    ends, share, _ = cut(tets, np.arange(len(tets)), values)
    first, second = points[ends[..., 0]], points[ends[..., 1]]
    return np.asarray(first + share[..., None] * (second - first))


def lines(
    function: Callable[[np.ndarray], np.ndarray], low: np.ndarray, high: np.ndarray, normal: int,
    fine: int = FINE_IN_PLANE,
) -> np.ndarray:  # fmt: skip
    """Both ends of lines on which a function is 0 in a plane, shape (n, 2, 3).

    Parameters
    ----------
    function
        Its value at points of shape (n, 3).
    low, high
        Corners of a rectangle, which have the same coordinate along the axis `normal`.
    normal
        The axis to which the rectangle is normal: 0, 1 or 2.
    fine
        Squares along the longest side.
    """
    points, numbers = _grid(low, high, fine)
    numbers = np.take(numbers, 0, axis=normal)
    values = function(points)
    a, b, c, d = (n.ravel() for n in (numbers[:-1, :-1], numbers[1:, :-1], numbers[1:, 1:],
                                      numbers[:-1, 1:]))  # fmt: skip
    triangles = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    above = values[triangles] > 0
    parts = [np.empty((0, 2, 2), np.int64)]
    for k in range(3):
        one, two = (k + 1) % 3, (k + 2) % 3
        mine = (above[:, one] == above[:, two]) & (above[:, one] != above[:, k])
        some = triangles[mine]
        parts.append(np.stack([some[:, [k, one]], some[:, [k, two]]], axis=1))
    ends = np.concatenate(parts)
    first, second = points[ends[..., 0]], points[ends[..., 1]]
    at_first = values[ends[..., 0]]
    share = at_first / (at_first - values[ends[..., 1]])
    return np.asarray(first + share[..., None] * (second - first))


def net(
    function: Callable[[np.ndarray], np.ndarray], low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Lines in which planes normal to the axes cut the surface on which a function is 0.

    Parameters and result are as of `lines`; a flat box gives the lines in its plane alone.
    """
    flat = np.flatnonzero(high == low)
    parts = []
    for axis in flat if len(flat) else range(3):
        for place in np.linspace(low[axis], high[axis], 1 if len(flat) else PLANES_OF_NET):
            first, last = low.copy(), high.copy()
            first[axis] = last[axis] = place
            parts.append(lines(function, first, last, int(axis), FINE_IN_NET))
    return np.concatenate(parts)


def _grid(low: np.ndarray, high: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Points of a box in a grid, shape (n, 3), and their numbers by their places in the grid.

    There is one point along a side without length.
    """
    sides = high - low
    counts = [1 if side == 0 else max(int(np.ceil(most * side / sides.max())), 1) + 1
              for side in sides]  # fmt: skip
    along = [np.linspace(a, b, n) for a, b, n in zip(low, high, counts, strict=True)]
    points = np.stack(np.meshgrid(*along, indexing="ij"), axis=-1).reshape(-1, 3)
    return points, np.arange(len(points)).reshape(counts)
