"""Finds parts that lie in one another without common nodes.

Bodies that were drawn over each other and meshed one by one fill the same place twice.  The run
would count the material there twice, and nothing would hold one body to the other.

Each exterior face of a body is probed at a few points that lie a little inside the body behind it.
No other body may have a cell at such a point.  Bodies that only touch pass, because the points have
left the common surface.  On a curved surface flat faces of touching bodies cut into each other by
their bulge, so the points must also be in the other body after a further step of that length.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dea_fenicsx.mesh.foreign.arrays import (
    HEX,
    QUAD,
    TET,
    TRIANGLE,
    Ints,
    PlainMesh,
    element_type,
    point,
)
from dea_fenicsx.mesh.foreign.joining import (
    CONTACT_EXTENT,
    CONTACT_SHARE,
    CURVATURE_COSINE,
    Exterior,
)
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.later import Later

csgraph = Later("scipy.sparse.csgraph")
sparse = Later("scipy.sparse")
spatial = Later("scipy.spatial")

PIECES = {
    TRIANGLE: ((0, 1, 2),),
    QUAD: ((0, 1, 2), (0, 2, 3)),
    TET: ((0, 1, 2, 3),),
    HEX: ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6)),
}  # fmt: skip
"""Corners of the simplices that fill a cell."""

CURVATURE_COSINE_APART = np.cos(np.radians(46))
"""The same if parts may touch (46 degrees): eight chords around a circle are one curve.

Where parts must not touch, such coarse chords are refused here, for they do cut into each other.
"""

POINTS_PER_LOOKUP = 20_000
"""Number of points that are looked up together.  It limits the memory."""


def check_overlap(mesh: PlainMesh, unit: float, apart: bool = False) -> None:
    """Raise InputError if bodies that share no nodes lie in one another.

    Parameters
    ----------
    mesh
        The mesh, with cells of one shape: triangles, quadrilaterals, tetrahedra or hexahedra.
    unit
        Its unit of length in m, for the message.
    apart
        Whether parts may touch that are not joined.
    """
    ((number, nodes),) = mesh.cells.items()
    kind = element_type(number)
    corners = nodes[:, : kind.corners]
    body_of_node = _bodies(corners, len(mesh.points))
    if np.ptp(body_of_node[corners]) == 0:
        return
    cells = _Simplices(mesh, kind.shape, corners, body_of_node[corners[:, 0]])
    faces = Exterior(mesh, CURVATURE_COSINE_APART if apart else CURVATURE_COSINE)
    found = _first_overlap(mesh, faces, cells, body_of_node)
    if found is None:
        return
    names, (one, two, place) = list(mesh.regions), found
    what = f"regions {names[one]!r} and {names[two]!r}" if one != two else (
        f"two parts of region {names[one]!r}")  # fmt: skip
    raise InputError(
        f"{mesh.label}: {what} lie in one another, for example at {point(place * unit, mesh.dim)}: "
        "join them in gmsh before meshing (BooleanFragments, or Coherence), or draw them apart; if "
        "there is a narrow gap between them, mesh them finer."
    )


def _bodies(corners: Ints, nodes: int) -> Ints:
    """Number of the body that each corner of a cell belongs to; bodies have no common corners."""
    first = np.repeat(corners[:, 0], corners.shape[1] - 1)
    other = corners[:, 1:].ravel()
    ones = np.ones(len(first), dtype=np.int8)
    graph = sparse.coo_matrix((ones, (first, other)), shape=(nodes, nodes))
    return csgraph.connected_components(graph, directed=False)[1]


class _Simplices:
    """The simplices of all cells.

    Attributes
    ----------
    origin, inverse : a corner of each, and the matrix to barycentric coordinates from there
    low, high : the box around each, shape (simplices, dim)
    body, region : body and region of the cell of each
    """

    def __init__(self, mesh: PlainMesh, shape: str, corners: Ints, body: Ints) -> None:
        pieces = np.array(PIECES[shape])
        x = mesh.points[corners[:, pieces].reshape(-1, pieces.shape[1])][:, :, : mesh.dim]
        cell = np.repeat(np.arange(len(corners)), len(pieces))
        edges = np.swapaxes(x[:, 1:] - x[:, :1], 1, 2)
        longest = np.linalg.norm(edges, axis=1).max(axis=1)
        # a simplex without volume holds no point
        full = np.abs(np.linalg.det(edges)) > 1e-14 * longest**mesh.dim
        x, cell = x[full], cell[full]
        self.origin, self.inverse = x[:, 0], np.linalg.inv(edges[full])
        self.low, self.high = x.min(axis=1), x.max(axis=1)
        (region,) = mesh.region.values()
        self.body, self.region = body[cell], region[cell]

    def holders(self, members: Ints, x: np.ndarray) -> Ints:
        """A simplex among some of them that holds each point, or -1 where none does."""
        holder = np.full(len(x), -1)
        middle = (self.low[members] + self.high[members]) / 2
        radius = np.linalg.norm(self.high[members] - self.low[members], axis=1) / 2
        level = np.floor(np.log2(radius)).astype(int)
        for value in np.unique(level):
            group = members[level == value]
            tree = spatial.cKDTree(middle[level == value])
            reach = radius[level == value].max()
            for part in np.array_split(np.arange(len(x)), len(x) // POINTS_PER_LOOKUP + 1):
                near = tree.query_ball_point(x[part], reach, return_sorted=False)
                lengths = np.fromiter(map(len, near), dtype=np.int64, count=len(near))
                if not lengths.sum():
                    continue
                p = np.repeat(part, lengths)
                s = group[np.concatenate([np.asarray(n, dtype=np.int64) for n in near])]
                boxed = ((x[p] >= self.low[s]) & (x[p] <= self.high[s])).all(axis=1)
                p, s = p[boxed], s[boxed]
                share = np.einsum("pij,pj->pi", self.inverse[s], x[p] - self.origin[s])
                within = (share >= -1e-9).all(axis=1) & (share.sum(axis=1) <= 1 + 1e-9)
                holder[p[within]] = s[within]
        return holder


def _first_overlap(
    mesh: PlainMesh, faces: Exterior, cells: _Simplices, body_of_node: Ints
) -> tuple[int, int, np.ndarray] | None:
    """Two regions that lie in one another and a place, shape (3,); None if there are none."""
    body_of_face = body_of_node[faces.corners[:, 0]]
    tiny = CONTACT_SHARE * faces.size + CONTACT_EXTENT * np.ptp(mesh.points, axis=0).max()
    # the points stay in the cell behind the face, however thin it is
    height = np.abs(np.einsum("fi,fi->f", faces.middle - faces.inside, faces.normal))
    tiny = np.minimum(tiny, height / 2)
    for face, x in _probes(faces, tiny):
        for body in np.unique(cells.body):
            members = np.flatnonzero(cells.body == body)
            low, high = cells.low[members].min(axis=0), cells.high[members].max(axis=0)
            inside = ((x[:, : mesh.dim] >= low) & (x[:, : mesh.dim] <= high)).all(axis=1)
            tested = np.flatnonzero((body_of_face[face] != body) & inside)
            if not len(tested):
                continue
            holder = cells.holders(members, x[tested, : mesh.dim])
            tested, holder = tested[holder >= 0], holder[holder >= 0]
            if not len(tested):
                continue
            skin = np.flatnonzero(body_of_face == body)
            step = _bulge_beside(faces, skin, x[tested]) + 2 * faces.bulge[face[tested]]
            deep = x[tested] - step[:, None] * faces.normal[face[tested]]
            real = np.flatnonzero(cells.holders(members, deep[:, : mesh.dim]) >= 0)
            if len(real):
                k = real[0]
                one, two = sorted((faces.region[face[tested[k]]], cells.region[holder[k]]))
                return int(one), int(two), x[tested[k]]
    return None


def _probes(faces: Exterior, depth: np.ndarray) -> Iterator[tuple[Ints, np.ndarray]]:
    """Points behind the faces: their face and place, first the middles, then nearer to corners."""
    every = np.arange(len(faces.x))
    shift = depth[:, None] * faces.normal
    yield every, faces.middle - shift
    between = (faces.x + faces.middle[:, None]) / 2 - shift[:, None]
    yield np.repeat(every, between.shape[1]), between.reshape(-1, 3)


def _bulge_beside(faces: Exterior, skin: Ints, x: np.ndarray) -> np.ndarray:
    """Twice the largest bulge of the faces of a body that are nearest to each point."""
    _, near = spatial.cKDTree(faces.middle[skin]).query(x, k=min(4, len(skin)))
    return 2 * faces.bulge[skin[np.reshape(near, (len(x), -1))]].max(axis=1)
