"""Finds parts that touch in the drawing, but share no nodes in the mesh.

If two bodies touch in the drawing and are meshed separately, they have duplicate nodes at their
interface, or nodes at different places.  Then the two bodies are not connected, and the run gives
the motion of loose sheets.  Such an interface is found by geometry alone: an exterior face of one
cell lies on an exterior face of another cell.

An intended gap may be thin, but it must be wider than `CONTACT_SHARE` of the faces beside it.
On curved surfaces the flat faces of two touching bodies are some distance apart.  This distance is
estimated from the curvature and allowed for.
"""

from __future__ import annotations

import numpy as np

from dea_fenicsx.mesh.foreign.arrays import Ints, PlainMesh, element_type, point
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.later import Later

spatial = Later("scipy.spatial")

CONTACT_SHARE = 1e-5
"""Two faces touch if their distance is below this share of the size of the smaller one."""

CONTACT_EXTENT = 2e-7
"""Two faces also touch if their distance is below this share of the extent of the mesh.

Mesh files often have only seven digits.
"""

SMALLEST_OVERLAP = 0.05
"""Smallest overlap of two faces, as a share of the smaller one's size, that is not rounding."""

CURVATURE_COSINE = np.cos(np.radians(30))
"""Cosine of the largest angle between neighbouring faces of one curved surface (30 degrees)."""


class Exterior:
    """The exterior faces of a mesh, all with four corners: a triangle has its last one twice.

    Attributes
    ----------
    corners : numbers of the corners, shape (faces, 2 or 4)
    x : their coordinates, shape (faces, corners, 3)
    normal : unit normals that point outwards, shape (faces, 3)
    middle, size : middle of each face, and its longest edge or diagonal
    inside : middle of the cell behind it
    region : index of the region of the cell behind
    smooth : cosine of the angle between neighbouring faces up to which it comes from curvature
    bulge : how far the true surface may be away from the flat face
    """

    def __init__(self, mesh: PlainMesh, smooth: float = CURVATURE_COSINE) -> None:
        self.smooth = smooth
        blocks = mesh.faces()
        keys = [mesh.keys(corners) for _, _, corners in blocks]
        _, inverse, counts = np.unique(
            np.concatenate(keys), return_inverse=True, return_counts=True
        )
        single = np.split(counts[inverse.reshape(-1)] == 1, np.cumsum([len(k) for k in keys])[:-1])
        corners, region, inside = [], [], []
        for (number, cells, nodes), alone in zip(blocks, single, strict=True):
            mine = nodes[alone]
            if mesh.dim == 3 and mine.shape[1] == 3:
                mine = mine[:, [0, 1, 2, 2]]
            corners.append(mine)
            region.append(mesh.region[number][cells[alone]])
            table = mesh.cells[number][cells[alone], : element_type(number).corners]
            inside.append(mesh.points[table].mean(axis=1))
        self.corners = np.concatenate(corners)
        self.region = np.concatenate(region)
        self.x = mesh.points[self.corners]
        self.middle = self.x.mean(axis=1)
        ends = self.x[:, :, None] - self.x[:, None, :]
        self.size = np.linalg.norm(ends, axis=3).max(axis=(1, 2))
        self.inside = np.concatenate(inside)
        self.normal = self._normals(mesh.dim)
        self.bulge = self._bulges()

    def _normals(self, dim: int) -> np.ndarray:
        x = self.x
        if dim == 2:
            edge = x[:, 1] - x[:, 0]
            normal = np.column_stack([-edge[:, 1], edge[:, 0], np.zeros(len(edge))])
        else:
            normal = np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
            flat = (self.corners[:, 2] == self.corners[:, 3])[:, None]
            normal = np.where(flat, np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), normal)
        normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
        outwards = np.einsum("fi,fi->f", self.middle - self.inside, normal) >= 0
        return np.where(outwards[:, None], normal, -normal)

    def _bulges(self) -> np.ndarray:
        """Height of an arc over a face, from the turn of the surface's normal along its edges.

        An arc over a chord h that turns by the angle a in all rises by h a/8.
        """
        faces, width = self.corners.shape
        normals = self._corner_normals()
        rise = np.zeros(faces)
        for i in range(width):
            for k in range(i):
                cosine = np.einsum("fi,fi->f", normals[:, i], normals[:, k])
                angle = np.arccos(np.clip(cosine, -1, 1))
                angle[angle < 1e-6] = 0.0  # rounding of the normals
                length = np.linalg.norm(self.x[:, i] - self.x[:, k], axis=1)
                rise = np.maximum(rise, length * angle / 8)
        return rise

    def _corner_normals(self) -> np.ndarray:
        """Normal of the surface at each corner of each face, shape (faces, corners, 3).

        The mean over those faces at the corner that are no turn round an edge of the body.
        """
        faces, width = self.corners.shape
        corner = self.corners.ravel()
        face = np.repeat(np.arange(faces), width)
        order = np.argsort(corner, kind="stable")
        _, start, count = np.unique(corner[order], return_index=True, return_counts=True)
        rank_of = np.repeat(np.arange(len(count)), count)
        total = np.zeros((faces * width, 3))
        for k in range(int(count.max(initial=0))):
            # each face at a corner takes the k-th face there, if there are as many
            has = count > k
            other = face[order[start[has] + k]]
            own = order[has[rank_of]]
            other = np.repeat(other, count[has])
            smooth = np.einsum("pi,pi->p", self.normal[face[own]], self.normal[other]) > self.smooth
            total[own[smooth]] += self.normal[other[smooth]]
        # a face without area, of a cell with a repeated corner, has no normal
        total /= np.maximum(np.linalg.norm(total, axis=1), 1e-300)[:, None]
        return total.reshape(faces, width, 3)


def check_joined(mesh: PlainMesh, unit: float) -> None:
    """Raise InputError if parts touch without being joined.

    Parameters
    ----------
    mesh
        The mesh; its cells may be of several shapes.
    unit
        Its unit of length in m, for the message.
    """
    faces = Exterior(mesh)
    first, second = _touching(faces, np.ptp(mesh.points, axis=0).max())
    if not len(first):
        return
    names = list(mesh.regions)
    pairs = np.sort(np.column_stack([faces.region[first], faces.region[second]]), axis=1)
    pairs, counts = np.unique(pairs, axis=0, return_counts=True)
    one, two = pairs[int(np.argmax(counts))]
    low, high = np.sort(faces.region[[first, second]], axis=0)
    k = int(np.flatnonzero((low == one) & (high == two))[0])
    count = len(np.unique(np.concatenate([first, second])))
    place = point(faces.middle[first[k]] * unit, mesh.dim)
    same = np.einsum("i,i->", faces.normal[first[k]], faces.normal[second[k]]) > 0
    how = "lie in one another" if same else "touch, but are not joined"
    leave = "" if same else ", or pass apart=True if they are to move apart"
    what = f"regions {names[one]!r} and {names[two]!r}" if one != two else (
        f"two faces of region {names[one]!r}")  # fmt: skip
    raise InputError(
        f"{mesh.label}: {what} {how}, first at {place} ({count} facets lie on facets of other "
        "nodes): join them in gmsh before meshing (BooleanFragments, or Coherence)"
        f"{leave}."
    )


def _touching(faces: Exterior, extent: float) -> tuple[Ints, Ints]:
    """Pairs of faces that lie on each other: numbers of the smaller and of the larger one."""
    found: list[tuple[Ints, Ints]] = []
    level = np.floor(np.log2(np.maximum(faces.size, 1e-12 * extent) / extent)).astype(int)
    groups = {k: np.flatnonzero(level == k) for k in np.unique(level)}
    trees = {k: spatial.cKDTree(faces.middle[members]) for k, members in groups.items()}
    for low, small in groups.items():
        for high, large in groups.items():
            if high < low:
                continue
            # faces that overlap have their middles within the sum of their half sizes
            reach = (faces.size[small] + faces.size[large].max()) / 2
            for part in np.array_split(np.arange(len(small)), len(small) // 20_000 + 1):
                near = trees[high].query_ball_point(
                    faces.middle[small[part]], reach[part], return_sorted=False
                )
                lengths = np.fromiter(map(len, near), dtype=np.int64, count=len(near))
                if not lengths.sum():
                    continue
                a = np.repeat(small[part], lengths)
                b = large[np.concatenate([np.asarray(n, dtype=np.int64) for n in near])]
                keep = a < b if high == low else a != b
                a, b = a[keep], b[keep]
                on = _coplanar(faces, a, b, extent)
                a, b = a[on], b[on]
                on = _overlap(faces, a, b)
                found.append((a[on], b[on]))
    if not found:
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    return np.concatenate([a for a, _ in found]), np.concatenate([b for _, b in found])


def _coplanar(faces: Exterior, a: Ints, b: Ints, extent: float) -> np.ndarray:
    """Whether faces are parallel, and their planes as near as faces that touch.

    Faces on one curved surface leave each other by their bulge, and more at one corner than at
    another.  Faces on both sides of a gap are as far from each other everywhere.  The two faces of
    a very thin film have its cells between them, and each looks away from the other one's cell.
    """
    cosine = np.einsum("pi,pi->p", faces.normal[a], faces.normal[b])
    sides = [np.einsum("pi,pi->p", faces.inside[j] - faces.middle[i], faces.normal[i]) > 0
             for i, j in ((a, b), (b, a))]  # fmt: skip
    parallel = (cosine > 0.9) | ((cosine < -0.9) & sides[0] & sides[1])
    smaller = np.minimum(faces.size[a], faces.size[b])
    allowed = CONTACT_SHARE * smaller + CONTACT_EXTENT * extent
    bulge = faces.bulge[a] + faces.bulge[b]
    normal, origin = faces.normal[b], faces.middle[b]
    middle = np.abs(np.einsum("pi,pi->p", faces.middle[a] - origin, normal))
    signed = np.einsum("pki,pi->pk", faces.x[a] - origin[:, None], normal)
    near, far = np.abs(signed).min(axis=1), np.abs(signed).max(axis=1)
    # Two crossing chords of one arc have the same distance at both ends.  Then the middle of each
    # chord lies near the plane of the other one.  This is not so for chords of two different arcs
    # with a gap between them.
    one_side = (signed > 0).all(axis=1) | (signed < 0).all(axis=1)
    back = np.abs(np.einsum("pi,pi->p", origin - faces.middle[a], faces.normal[a]))
    crossing = ~one_side & (middle <= allowed + bulge / 3) & (back <= allowed + bulge)
    gap = ~crossing & (far > allowed) & (near > far / 2)
    return parallel & ~gap & (middle <= allowed + bulge) & (far <= allowed + 4 * bulge)


def _overlap(faces: Exterior, a: Ints, b: Ints) -> np.ndarray:
    """Whether faces overlap when they are seen along the normal of the second.

    Two convex polygons overlap unless some line along an edge of one of them separates them.
    """
    least = np.full(len(a), np.inf)
    for own in (a, b):
        x = faces.x[own]
        count = x.shape[1]
        for k in range(1 if count == 2 else count):
            edge = x[:, (k + 1) % count] - x[:, k]
            along = edge if count == 2 else np.cross(edge, faces.normal[b])
            length = np.linalg.norm(along, axis=1)
            good = length > 1e-12 * faces.size[own]
            along = along / np.where(good, length, 1.0)[:, None]
            one = np.einsum("pki,pi->pk", faces.x[a], along)
            two = np.einsum("pki,pi->pk", faces.x[b], along)
            shared = np.minimum(one.max(axis=1), two.max(axis=1)) - np.maximum(
                one.min(axis=1), two.min(axis=1)
            )
            narrow = np.minimum(np.ptp(one, axis=1), np.ptp(two, axis=1))
            least = np.where(good, np.minimum(least, shared - SMALLEST_OVERLAP * narrow), least)
    return least > 0
