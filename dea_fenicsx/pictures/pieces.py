"""Curved faces and edges as flat triangles and straight lines, as fine as a picture needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dea_fenicsx.pictures.faces import Faces

FINEST, MOST_TRIANGLES = 8, 250_000
"""Pieces along the edge of a face at most, and triangles up to which faces are cut so finely."""


@dataclass(frozen=True)
class Triangles:
    """Triangles in place of faces.

    Attributes
    ----------
    weights : ndarray (p, nodes of a face) that lead to the points of a face from its nodes; None
        where the points are the nodes themselves
    nodes : ndarray (m, nodes of a face) of the faces
    corners : ndarray (t, 3), points of each triangle
    faces : ndarray (t,), number of the face of each triangle
    """

    weights: np.ndarray | None
    nodes: np.ndarray
    corners: np.ndarray
    faces: np.ndarray

    def at(self, values: np.ndarray) -> np.ndarray:
        """Values at the points, from those at the nodes."""
        if self.weights is None:
            return values
        found = np.einsum("pk,mk...->mp...", self.weights, values[self.nodes])
        return np.asarray(found).reshape(-1, *values.shape[1:])


def triangles_of(faces: Faces, rows: np.ndarray) -> Triangles:
    """Some faces as triangles: fine ones if there are few faces."""
    table, n = faces.nodes[rows], faces.corners
    each = 2 if n == 4 else 1
    pieces = 1
    if table.shape[1] > n:
        while pieces < FINEST and each * (2 * pieces) ** 2 * len(table) <= MOST_TRIANGLES:
            pieces *= 2
    places, local = (_square if n == 4 else _triangle)(pieces)
    numbers = np.repeat(rows.astype(np.int32), len(local))
    if pieces == 1:
        return Triangles(None, table, table[:, local].reshape(-1, 3), numbers)
    corners = local[None] + len(places) * np.arange(len(table))[:, None, None]
    return Triangles(_shapes(n, places), table, corners.reshape(-1, 3), numbers)


def _square(pieces: int) -> tuple[np.ndarray, np.ndarray]:
    """Places of the points of a square in -1 to 1, and its triangles; for 1 piece by corners."""
    if pieces == 1:
        return np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]), np.array([(0, 1, 2), (0, 2, 3)])
    s = np.linspace(-1, 1, pieces + 1)
    places = np.array([(a, b) for b in s for a in s])
    n = pieces + 1
    base = np.array([j * n + i for j in range(pieces) for i in range(pieces)])[:, None]
    two = np.array([0, 1, n + 1]), np.array([0, n + 1, n])
    local = np.stack([base + one for one in two], axis=1)
    return places, local.reshape(-1, 3)


def _triangle(pieces: int) -> tuple[np.ndarray, np.ndarray]:
    """The same of a triangle with the corners (0, 0), (1, 0) and (0, 1)."""
    if pieces == 1:
        return np.array([(0, 0), (1, 0), (0, 1)]), np.array([(0, 1, 2)])
    index: dict[tuple[int, int], int] = {}
    for j in range(pieces + 1):
        for i in range(pieces + 1 - j):
            index[i, j] = len(index)
    places = np.array(list(index), dtype=float) / pieces
    local = [(index[i, j], index[i + 1, j], index[i, j + 1])
             for i, j in index if i + j < pieces]  # fmt: skip
    local += [(index[i + 1, j], index[i + 1, j + 1], index[i, j + 1])
              for i, j in index if i + j < pieces - 1]  # fmt: skip
    return places, np.array(local)


def _shapes(corners: int, places: np.ndarray) -> np.ndarray:
    """Shape functions of second order in VTK's order of the nodes, shape (places, nodes)."""
    if corners == 3:
        s, t = places.T
        r = 1 - s - t
        return np.column_stack([
            r * (2 * r - 1), s * (2 * s - 1), t * (2 * t - 1), 4 * r * s, 4 * s * t, 4 * t * r
        ])  # fmt: skip

    def three(s: np.ndarray) -> np.ndarray:
        return np.array([s * (s - 1) / 2, 1 - s * s, s * (s + 1) / 2])

    a, b = three(places[:, 0]), three(places[:, 1])
    order = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1), (1, 1))
    return np.column_stack([a[i] * b[j] for i, j in order])


def lines_of(edges: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Both ends of straight lines in place of edges, shape (n, 2, 3).

    Parameters
    ----------
    edges
        Nodes of each: its ends, and its middle if there is one.
    points
        Positions of the nodes.
    """
    if edges.shape[1] == 2 or len(edges) > MOST_TRIANGLES:
        return points[edges[:, :2]]
    pieces = FINEST if len(edges) * FINEST <= MOST_TRIANGLES else 2
    s = np.linspace(-1, 1, pieces + 1)
    weights = np.column_stack([s * (s - 1) / 2, s * (s + 1) / 2, 1 - s * s])
    along = np.einsum("pk,mkd->mpd", weights, points[edges])
    return np.stack([along[:, :-1], along[:, 1:]], axis=2).reshape(-1, 2, 3)
