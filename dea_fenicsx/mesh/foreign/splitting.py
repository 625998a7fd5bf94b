"""Prisms, pyramids and mixed cells are divided into tetrahedra, or in the plane into triangles.

DOLFINx 0.9 and 0.11 integrate over facets of one shape only.  Each cell is divided from its corner
with the smallest number: the faces that do not hold this corner are divided likewise, each from its
own corner with the smallest number, and each triangle makes a tetrahedron with the corner
(Dompierre et al., How to subdivide pyramids, prisms and hexahedra into tetrahedra, 1999).
Two cells that share a face divide it alike, so the result is conforming.

Cells of second order keep their curved shape: a diagonal of a face takes the node in the middle of
the face, and one of a brick the node in the middle of the brick.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dea_fenicsx.mesh.foreign.arrays import CELL_FACES, Ints, PlainMesh, element_type
from dea_fenicsx.support.errors import InputError

SIMPLEX = {(1, 1): 1, (1, 2): 8, (2, 1): 2, (2, 2): 9, (3, 1): 4, (3, 2): 11}
"""gmsh's number of the line, triangle and tetrahedron by (dimension, order)."""

DOLFINX_TYPES = {2, 3, 4, 5, 9, 10, 11, 12, 21, 29, 36, 92}
"""Types that DOLFINx reads: triangles, quadrilaterals, tetrahedra and bricks up to order 3."""


def to_one_shape(mesh: PlainMesh) -> None:
    """Divide the cells in place unless they are all of one shape that can be computed on.

    Raises
    ------
    InputError
        Naming the type of cells that cannot be divided.
    """
    kinds = [element_type(number) for number in mesh.cells]
    orders = {kind.order for kind in kinds}
    if len(orders) > 1:
        raise InputError(
            f"{mesh.label} has cells of orders {' and '.join(map(str, sorted(orders)))}; mesh it "
            "with one order."
        )
    if len(kinds) == 1 and kinds[0].number in DOLFINX_TYPES:
        return
    bad = [k.name for k in kinds if k.order > 2 or k.shape not in CELL_FACES or (
        k.order == 2 and len(k.local) != _nodes_of_second_order(k.number))]  # fmt: skip
    if bad:
        raise InputError(
            f"{mesh.label} has cells of gmsh's type {', '.join(map(repr, bad))}, which cannot be "
            "computed on; mesh it with Mesh.ElementOrder 1 or 2, as triangles, quadrilaterals, "
            "tetrahedra, hexahedra or prisms."
        )
    order = orders.pop()
    new = SIMPLEX[mesh.dim, order]
    pieces = {number: _divided(number, nodes) for number, nodes in mesh.cells.items()}
    mesh.region = {new: np.concatenate([mesh.region[n][of] for n, (_, of) in pieces.items()])}
    mesh.cells = {new: np.concatenate([table for table, _ in pieces.values()])}
    if mesh.dim == 3:
        low = SIMPLEX[2, order]
        for name, blocks in mesh.facets.items():
            parts = [_divided(n, nodes)[0] for n, nodes in blocks.items()]
            mesh.facets[name] = {low: np.concatenate(parts)} if parts else {}
    shapes = " and ".join(sorted({_plural(k.shape) for k in kinds}))
    into = "tetrahedra" if mesh.dim == 3 else "triangles"
    mesh.notes.append(f"{shapes} divided into {into}")


def _plural(shape: str) -> str:
    return shape[:-2] + "a" if shape.endswith("hedron") else shape + "s"


def _nodes_of_second_order(number: int) -> int:
    """Nodes of a complete element of second order; 0 for types that are not known here."""
    return {9: 6, 10: 9, 11: 10, 12: 27, 13: 18, 14: 14}.get(number, 0)


def _divided(number: int, nodes: Ints) -> tuple[Ints, Ints]:
    """The simplices of some elements, and the element of each."""
    kind = element_type(number)
    simplex = element_type(SIMPLEX[kind.dim, kind.order])
    corners = nodes[:, : kind.corners]
    tables, owners = [], []
    for members, pieces in _alike(kind.shape, corners):
        for piece in pieces:
            a = kind.local[list(piece)]
            if np.linalg.det(a[1:] - a[0]) < 0:
                piece = (piece[1], piece[0], *piece[2:])
            # each node of a simplex lies at one of its corners or between two of them
            between = [_ends(simplex.local, simplex.corners, k) for k in range(len(simplex.local))]
            local = [kind.node_at(tuple(piece[e] for e in ends)) for ends in between]
            assert None not in local
            tables.append(nodes[members][:, local])
            owners.append(members)
    order = np.argsort(np.concatenate(owners), kind="stable")
    return np.concatenate(tables)[order], np.concatenate(owners)[order]


def _ends(local: np.ndarray, corners: int, k: int) -> tuple[int, ...]:
    """The corner at which a node of a simplex lies, or the two between which it lies."""
    for a in range(corners):
        for b in range(a, corners):
            if np.abs(local[[a, b]].mean(axis=0) - local[k]).max() < 1e-9:
                return (a,) if a == b else (a, b)
    raise AssertionError("a node of a simplex lies on none of its edges")


def _alike(shape: str, corners: Ints) -> Iterator[tuple[Ints, list[tuple[int, ...]]]]:
    """Groups of cells that are divided alike: their numbers, and the corners of their pieces."""
    faces = CELL_FACES[shape]
    start = corners.argmin(axis=1)
    code = start.copy()
    for face in faces:
        if len(face) == 4:
            code = 4 * code + corners[:, list(face)].argmin(axis=1)
    for value in np.unique(code):
        members = np.flatnonzero(code == value)
        one = corners[members[0]]
        top = int(start[members[0]])
        pieces: list[tuple[int, ...]] = []
        for face in faces:
            if top in face:
                continue
            turn = int(one[list(face)].argmin()) if len(face) == 4 else 0
            ring = face[turn:] + face[:turn]
            if len(face) == 2:
                pieces.append((top, *face))
            else:
                pieces += [(top, ring[0], ring[i], ring[i + 1]) for i in range(1, len(ring) - 1)]
        yield members, pieces
