"""Faces of a device's cells that can be seen, and their edges, by the nodes that they have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dea_fenicsx.pictures.stored import Stored
from dea_fenicsx.support.cell_types import BY_DEGREE, LINE
from dea_fenicsx.support.errors import InputError

MANY_FACES = 150_000
"""Faces beyond which only their corners are kept: a cell is then a few pixels wide."""

SHARP = 40.0
"""Angle in degrees between two faces from which on their edge is drawn."""

_HEX = ((0, 4, 7, 3, 16, 15, 19, 11, 20), (1, 2, 6, 5, 9, 18, 13, 17, 21),
        (0, 1, 5, 4, 8, 17, 12, 16, 22), (3, 7, 6, 2, 19, 14, 18, 10, 23),
        (0, 3, 2, 1, 11, 10, 9, 8, 24), (4, 5, 6, 7, 12, 13, 14, 15, 25))  # fmt: skip
_TET = ((0, 1, 3, 4, 8, 7), (1, 2, 3, 5, 9, 8), (2, 0, 3, 6, 7, 9), (0, 2, 1, 6, 5, 4))

FACES = {
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
    if stored.cell.nodes == 2 or stored.cell.vtk == BY_DEGREE[2][LINE].vtk:
        raise InputError(
            "The run is that of a line, the meridian of a membrane, which has no face to be drawn; "
            "open fields.xdmf in ParaView, or draw columns of history.csv."
        )
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
    return Faces(
        numbers[nodes], corners, parents, regions[parents], inner, names, stored.points(kept),
        stored.displacements(kept), kept,
    )  # fmt: skip


def _local(stored: Stored) -> tuple[int, np.ndarray]:
    """Corners of a face, and the nodes of each face of a cell; a flat cell is its own face."""
    if stored.cell.flat:
        return (4 if stored.cell.nodes in (4, 9) else 3), np.arange(stored.cell.nodes)[None]
    _, corners, local = FACES[stored.cell.vtk]
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


def edges_of(faces: Faces) -> tuple[np.ndarray, np.ndarray]:
    """Edges of the faces that are seen.

    Returns
    -------
    edges, pairs
        Nodes of each edge that may be drawn, its ends and its middle if there is one; and the two
        faces that have it, of which the second is -1 for an edge of one face alone.  Edges between
        faces of two regions belong to one face alone.
    """
    rows = np.flatnonzero(faces.seen)
    n, table = faces.corners, faces.nodes[rows]
    ends = np.array([(k, (k + 1) % n) for k in range(n)])
    keys = np.empty(len(rows) * n, dtype=np.uint64)
    for begin in range(0, len(rows), MANY_FACES):
        block = faces.names[table[begin : begin + MANY_FACES][:, ends]]
        keys[begin * n : (begin + len(block)) * n] = key_of(block).ravel()
    order, same = _sorted(keys)
    del keys
    regions = faces.regions[rows]
    for begin in range(0, len(same), MANY_FACES):
        here = regions[order[begin : begin + MANY_FACES + 1] // n]
        same[begin : begin + MANY_FACES] &= here[1:] == here[:-1]
    joined, later = np.append(same, False), np.append(False, same)
    first = np.flatnonzero(~later)
    last = np.minimum(first + 1, len(order) - 1)
    second = np.where(joined[first], rows[order[last] // n], -1).astype(np.int32)
    place, side = np.divmod(order[first].astype(np.int32), np.int32(n))
    del order, last, first
    columns = [ends[side, 0], ends[side, 1]]
    if faces.nodes.shape[1] > n:
        columns.append(n + side)
    edges = np.column_stack([table[place, column] for column in columns])
    return edges, np.column_stack([rows[place].astype(np.int32), second])


def sharp(faces: Faces, pairs: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Whether each edge is drawn: one face alone has it, or two at an angle.

    Parameters
    ----------
    faces, pairs
        The faces, and the two of each edge as told by `edges_of`.
    points
        Positions of the nodes, deformed or not.
    """
    drawn = pairs[:, 1] < 0
    if not drawn.all() and np.ptp(points[:, 2]) > 0:
        normal = normals(faces, points)
        both = pairs[~drawn]
        cosine = np.einsum("ni,ni->n", normal[both[:, 0]], normal[both[:, 1]])
        drawn[~drawn] = cosine < np.cos(np.radians(SHARP))
    return drawn


def normals(faces: Faces, points: np.ndarray) -> np.ndarray:
    """Unit normal of each face by its corners, outwards, in single precision."""
    a, b, c = (points[faces.nodes[:, k]].astype(np.float32) for k in range(3))
    if faces.corners == 4:
        d = points[faces.nodes[:, 3]].astype(np.float32)
        found = np.cross(c - a, d - b)
    else:
        found = np.cross(b - a, c - a)
    return found / np.maximum(np.linalg.norm(found, axis=1), 1e-30)[:, None]
