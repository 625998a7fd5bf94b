"""Faces of a device's cells that can be seen, and their edges, by the nodes that they have."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dea_fenicsx.pictures.stored import Stored

MANY_FACES = 150_000
"""Faces beyond which only their corners are kept: a cell is then a few pixels wide."""

SHARP = 40.0
"""Angle in degrees between two faces from which on their edge is drawn."""

_HEX = ((0, 4, 7, 3, 16, 15, 19, 11, 20), (1, 2, 6, 5, 9, 18, 13, 17, 21),
        (0, 1, 5, 4, 8, 17, 12, 16, 22), (3, 7, 6, 2, 19, 14, 18, 10, 23),
        (0, 3, 2, 1, 11, 10, 9, 8, 24), (4, 5, 6, 7, 12, 13, 14, 15, 25))  # fmt: skip
_TET = ((0, 1, 3, 4, 8, 7), (1, 2, 3, 5, 9, 8), (2, 0, 3, 6, 7, 9), (0, 2, 1, 6, 5, 4))

DRAWN_FACES = {
    29: (28, 4, np.array(_HEX)), 12: (9, 4, np.array(_HEX)[:, :4]),
    24: (22, 3, np.array(_TET)), 10: (5, 3, np.array(_TET)[:, :3]),
}  # fmt: skip
"""Of each of VTK's cells in space: the kind of its faces, their corners, and their nodes."""

_MIX = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)


@dataclass(frozen=True)
class Faces:
    """Faces of cells.

    Attributes
    ----------
    nodes : ndarray (m, k), nodes of each face in VTK's order, or its corners alone
    corners : number of corners, 3 or 4
    parents : ndarray (m,), number of the cell behind each face
    regions : ndarray (m,), region of this cell
    inner : ndarray (m,), whether the face lies between two regions; such faces are not seen
    names : ndarray (n,), number of each node before nodes were doubled, by which edges are joined
    points, moves : ndarray (n, 3), position and displacement of each node, in m
    kept : ndarray (all nodes,), which nodes of the device these are
    """

    nodes: np.ndarray
    corners: int
    parents: np.ndarray
    regions: np.ndarray
    inner: np.ndarray
    names: np.ndarray
    points: np.ndarray
    moves: np.ndarray
    kept: np.ndarray

    @property
    def seen(self) -> np.ndarray:
        """Whether each face can be seen from outside."""
        return ~self.inner


def faces_of(stored: Stored) -> Faces:
    """The outer faces of a device in space and those between regions; the cells of a flat one."""
    origin, regions = stored.origin, stored.regions
    corners, local = _local(stored)
    if stored.cell.flat:
        chosen = np.arange(stored.count)
        inner = np.zeros(stored.count, dtype=bool)
    else:
        chosen, inner = _outer(stored, corners, local, origin, regions)
    if len(chosen) > MANY_FACES:
        local = local[:, :corners]
    parts = []
    per_cell = len(local)
    for begin, table in stored.tables():
        low, high = np.searchsorted(chosen, np.array([begin, begin + len(table)]) * per_cell)
        cell, face = np.divmod(chosen[low:high] - begin * per_cell, per_cell)
        parts.append(table[cell[:, None], local[face]].astype(np.int32))
    nodes = np.concatenate(parts)
    kept = np.zeros(stored.size, dtype=bool)
    kept[nodes] = True
    numbers = np.cumsum(kept, dtype=np.int32) - 1
    parents = chosen // per_cell
    names = np.flatnonzero(kept) if origin is None else origin[kept]
    # pixels of a picture need no more than single precision
    kind = np.float32 if len(chosen) > MANY_FACES else np.float64
    points, moves = stored.points(kept).astype(kind), stored.displacements(kept).astype(kind)
    return Faces(
        numbers[nodes], corners, parents, regions[parents], inner, names, points, moves, kept
    )


def _local(stored: Stored) -> tuple[int, np.ndarray]:
    """Corners of a face, and the nodes of each face of a cell; a flat cell is its own face."""
    if stored.cell.flat:
        return (4 if stored.cell.nodes in (4, 9) else 3), np.arange(stored.cell.nodes)[None]
    _, corners, local = DRAWN_FACES[stored.cell.vtk]
    return corners, local


def _outer(
    stored: Stored, corners: int, local: np.ndarray, origin: np.ndarray | None,
    regions: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Numbers of faces (of all faces of all cells), and whether each lies between two regions."""
    keys = np.empty(stored.count * len(local), dtype=np.uint64)
    for begin, table in stored.tables():
        table = table if origin is None else origin[table]
        found = key_of(table[:, local[:, :corners]]).ravel()
        keys[begin * len(local) : begin * len(local) + len(found)] = found
    order, same = _sorted(keys)
    del keys
    paired = np.zeros(len(order), dtype=bool)
    paired[:-1] |= same
    paired[1:] |= same
    alone = order[~paired]
    first, second = order[:-1][same], order[1:][same]
    apart = regions[first // len(local)] != regions[second // len(local)]
    between = first[apart]
    chosen = np.concatenate([alone, between])
    ordered = np.argsort(chosen)
    inner = np.repeat([False, True], [len(alone), len(between)])
    return chosen[ordered], inner[ordered]


def _sorted(keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """An order of keys, and whether each one in it equals the next one."""
    order = np.argsort(keys)
    ordered = keys[order]
    return order, ordered[1:] == ordered[:-1]


def key_of(numbers: np.ndarray) -> np.ndarray:
    """One number for each set of numbers in the last axis, whatever their order.

    Two different sets of a device get the same number with a probability of 1e-6 at most.
    """
    ordered = np.sort(numbers, axis=-1).astype(np.uint64)
    key = ordered[..., 0] + np.uint64(1)
    for k in range(1, ordered.shape[-1]):
        key = (key ^ (key >> np.uint64(29))) * _MIX[k - 1] + ordered[..., k]
    return np.asarray((key ^ (key >> np.uint64(32))) * _MIX[0])


def edges_of(faces: Faces, shapes: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Edges of the faces that are seen, without most of those that no picture draws.

    Parameters
    ----------
    faces
        The faces.
    shapes
        Unit normals of all faces, for each position of the nodes that is drawn.

    Returns
    -------
    edges, pairs
        Nodes of each edge that may be drawn, its ends and its middle if there is one; and the two
        faces that have it, of which the second is -1 for an edge of one face alone.  Edges between
        faces of two regions belong to one face alone.
    """
    n, seen = faces.corners, np.flatnonzero(faces.seen)
    numbers, marked = _marked(faces, seen, shapes)
    both = np.zeros((len(seen), n), dtype=bool)
    for k in range(n):
        both[:, k] = marked[numbers(faces.nodes[seen, k])]
    both &= np.roll(both, -1, axis=1)
    row, side = np.nonzero(both)
    rows = seen[row]
    table = faces.nodes[rows]
    place = np.arange(len(rows))
    found = [table[place, side], table[place, (side + 1) % n]]
    keys = key_of(faces.names[np.column_stack(found)])
    order, same = _sorted(keys)
    regions = faces.regions[rows[order]]
    same &= regions[1:] == regions[:-1]
    joined, later = np.append(same, False)[: len(order)], np.append(False, same)[: len(order)]
    first = np.flatnonzero(~later)
    last = np.minimum(first + 1, len(order) - 1)
    second = np.where(joined[first], rows[order[last]], -1)
    if table.shape[1] > n:
        found.append(table[place, n + side])
    edges = np.column_stack(found)[order[first]]
    return edges, np.column_stack([rows[order[first]], second]).astype(np.int32)


def _marked(
    faces: Faces, seen: np.ndarray, shapes: Sequence[np.ndarray]
) -> tuple[Callable[[np.ndarray], np.ndarray], np.ndarray]:
    """Numbers of nodes, with doubled ones joined, and which of them an edge may be drawn at.

    An edge of one face alone ends where the neighbours before and after, in the faces around a
    node, are not the same ones.  Of n unit normals of which two have the angle t, the square of
    the sum is at most n^2 - n (1 - cos t).
    """
    n = faces.corners
    if np.all(faces.names[1:] > faces.names[:-1]):
        def numbers(nodes: np.ndarray) -> np.ndarray:
            return nodes
        size = len(faces.names)
    else:
        joined = np.unique(faces.names, return_inverse=True)[1].astype(np.int32)
        size = int(joined.max(initial=-1)) + 1

        def numbers(nodes: np.ndarray) -> np.ndarray:
            return np.asarray(joined[nodes])

    def corner(k: int) -> np.ndarray:
        return numbers(faces.nodes[seen, k % n])

    def total(weights: Callable[[int], np.ndarray] | None) -> np.ndarray:
        found = np.zeros(size, dtype=np.float32 if weights is None else np.float64)
        for k in range(n):
            of = None if weights is None else weights(k)
            more = np.bincount(corner(k), of, minlength=size)
            np.add(found, more, out=found, casting="unsafe")
        return found

    marked = total(lambda k: corner(k + 1) - corner(k - 1)) != 0
    count = total(None)
    regions = faces.regions[seen]
    if regions.size and np.ptp(regions):
        # the variance of a few whole numbers is 0 to rounding, or at least 1/n
        mean, square = total(lambda k: regions), total(lambda k: regions.astype(float) ** 2)
        marked |= np.asarray(count * square - mean**2 > 0.5)
    least = 0.999 * (1 - np.cos(np.radians(SHARP)))
    for normal in shapes:
        short = count * (count - np.float32(least))
        for axis in range(3):
            along = normal[seen, axis]
            short -= total(lambda k, along=along: along) ** 2  # type: ignore[misc]
        marked |= np.asarray(short >= 0)
    return numbers, marked


def sharp(pairs: np.ndarray, normal: np.ndarray | None) -> np.ndarray:
    """Whether each edge is drawn: one face alone has it, or two at an angle.

    Parameters
    ----------
    pairs
        The two faces of each edge as told by `edges_of`.
    normal
        Unit normals of all faces; None if they lie in a plane.
    """
    drawn = pairs[:, 1] < 0
    if normal is not None and not drawn.all():
        both = pairs[~drawn]
        cosine = np.einsum("ni,ni->n", normal[both[:, 0]], normal[both[:, 1]])
        drawn[~drawn] = cosine < np.cos(np.radians(SHARP))
    return drawn


def normals(faces: Faces, points: np.ndarray) -> np.ndarray:
    """Unit normal of each face by its corners, outwards, in single precision."""
    found = np.empty((len(faces.nodes), 3), dtype=np.float32)
    for begin in range(0, len(found), MANY_FACES):
        nodes = faces.nodes[begin : begin + MANY_FACES]
        a, b, c = (points[nodes[:, k]].astype(np.float32) for k in range(3))
        if faces.corners == 4:
            d = points[nodes[:, 3]].astype(np.float32)
            cross = np.cross(c - a, d - b)
        else:
            cross = np.cross(b - a, c - a)
        size = np.maximum(np.linalg.norm(cross, axis=1), 1e-30)
        found[begin : begin + len(nodes)] = cross / size[:, None]
    return found
