"""A gap of air on a flat face of any device."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import known

from . import _check
from ._structured import Floats, Ints, StructuredMesh, lattice_points
from .base import Geometry
from .grading import graded

FLAT = 1e-9
"""Largest sine of the angle, and distance over the size, by which a face may not be flat."""


@dataclass(frozen=True)
@in_si(thickness="m")
class AirGap(Geometry):
    """A device with a layer of air on one of its flat faces; the material of the layer is `Air`.

    Parameters
    ----------
    device
        Any geometry whose mesh has lines, squares or cubes: solids in space, and sections.
    face
        Name of the facet group, which lies in one plane.
    thickness
        Of the air in m.
    divisions
        Cells through the air.
    grading
        Largest over smallest of these cells; the small ones lie at the device.
    region
        Name of the air.

    Notes
    -----
    Groups: those of the device, the air, ``air_wall``, its far side, and ``air_sides``, what bounds
    it between the two; these begin with the name of the region.

    Raises
    ------
    InputError
        A parameter is not usable, or the face is not there or not flat.
    """

    device: Geometry
    face: str
    thickness: float
    divisions: int = 2
    grading: float = 1.0
    region: str = "air"

    def __post_init__(self) -> None:
        if not isinstance(self.device, Geometry):
            raise InputError(
                f"AirGap: device is {shown(self.device)}; it must be a geometry such as DiskStack."
            )
        _check.length("AirGap", "thickness", self.thickness)
        _check.count("AirGap", "divisions", self.divisions)
        _check.ratio("AirGap", "grading", self.grading)
        _check.group_name("AirGap", "region", self.region)
        mesh = self.device.mesh()
        if not isinstance(self.face, str):
            raise InputError(
                f"AirGap: face is {shown(self.face)}; it must be the name of a facet group."
            )
        known(self.face, mesh.facets, "facet group", "the device")
        for name in self._own:
            if name in {*mesh.regions, *mesh.facets}:
                raise InputError(
                    f"AirGap: region is {self.region!r}, but the device has a group {name!r}; call "
                    "the air otherwise."
                )
        self._normal(mesh)

    @property
    def dimension(self) -> int:
        return self.device.dimension

    @property
    def _own(self) -> tuple[str, str, str]:
        return self.region, f"{self.region}_wall", f"{self.region}_sides"

    def _normal(self, mesh: StructuredMesh) -> Floats:
        """The unit normal of the face, outwards."""
        faces = mesh.facets[self.face]
        dim = faces.ndim - 1
        x = mesh.points[faces]
        size = float(np.ptp(mesh.points, axis=0).max())
        if dim == 1:
            t = x[:, -1] - x[:, 0]
            normals = np.stack([t[:, 1], -t[:, 0], 0 * t[:, 0]], axis=1)[:, : x.shape[-1]]
        else:
            normals = np.cross(x[:, -1, 0] - x[:, 0, 0], x[:, 0, -1] - x[:, 0, 0])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        normal = np.asarray(normals[0])
        flat = np.ptp(x.reshape(-1, x.shape[-1]) @ normal) < FLAT * size
        if not flat or np.min(normals @ normal) < 1 - FLAT:
            raise InputError(
                f"AirGap: the face {self.face!r} does not lie in one plane; name a flat face."
            )
        return normal

    def measures(self) -> dict[str, float]:
        """Those of the device; the air's follow from that of the face, its sides' from the mesh."""
        found = self.device.measures()
        mesh = self.device.mesh()
        faces = mesh.facets[self.face]
        ends = _rim(faces)
        edges = [np.take(faces[mask], -1 if end else 0, axis=axis + 1)
                 for (axis, end), mask in ends.items()]  # fmt: skip
        around = sum(_lengths(mesh.points[e]) if faces.ndim == 3 else float(len(e)) for e in edges)
        air, wall, sides = self._own
        area = found[self.face]
        return found | {
            air: area * self.thickness, wall: area, sides: around * self.thickness
        }  # fmt: skip

    def refine(self, factor: int) -> AirGap:
        """The same with all divisions multiplied by ``factor``."""
        k = _check.count("AirGap.refine", "factor", factor)
        return replace(self, device=self.device.refine(k), divisions=k * self.divisions)

    def mesh(self) -> StructuredMesh:
        """Nodes, cells and named parts as plain arrays."""
        mesh = self.device.mesh()
        faces, order, normal = mesh.facets[self.face], mesh.order, self._normal(mesh)
        if faces.ndim == 2:  # along the line and then outwards is a right-handed frame
            faces = faces[:, ::-1]
        nodes, base = np.unique(faces, return_inverse=True)
        base = base.reshape(faces.shape)
        height = self.thickness * lattice_points(
            graded(self.divisions, self.grading, "start"), order
        )
        levels, count = len(height), len(mesh.points)
        above = mesh.points[nodes][:, None] + height[1:, None] * normal
        number = count + np.arange(len(nodes) * (levels - 1)).reshape(len(nodes), levels - 1)
        number = np.column_stack([nodes, number])
        k = order * np.arange(self.divisions)[:, None] + np.arange(order + 1)
        cells = np.stack([number[base][..., one] for one in k], axis=1)
        grown = StructuredMesh(
            np.concatenate([mesh.points, above.reshape(-1, mesh.points.shape[1])]),
            np.concatenate([mesh.cells, cells.reshape(-1, *cells.shape[2:])]),
            dict(mesh.regions), dict(mesh.facets),
        )  # fmt: skip
        first = len(mesh.cells)
        own = first + np.arange(len(faces) * self.divisions).reshape(len(faces), -1)
        air, wall, sides = self._own
        grown.add_region(air, own.ravel())
        grown.add_facets(wall, own[:, -1], faces.ndim - 1, 1)
        for (axis, end), mask in _rim(faces).items():
            grown.add_facets(sides, own[mask].ravel(), axis, end)
        return grown


def _rim(faces: Ints) -> dict[tuple[int, int], NDArray[np.bool_]]:
    """Which faces end at the rim of their group, by axis and end."""
    keys, places = [], []
    for axis in range(faces.ndim - 1):
        for end in (0, 1):
            side = np.take(faces, -1 if end else 0, axis=axis + 1)
            ends = side[:, None] if side.ndim == 1 else side[:, [0, -1]]
            keys.append(np.sort(ends, axis=1))
            places.append((axis, end))
    _, inverse, often = np.unique(
        np.concatenate(keys), axis=0, return_inverse=True, return_counts=True
    )
    once = (often[inverse.ravel()] == 1).reshape(len(places), -1)
    return dict(zip(places, once, strict=True))


def _lengths(edges: Floats) -> float:
    """Sum of the lengths of edges on lattices of nodes, shape (K, q, 3)."""
    q = edges.shape[1]
    at, weights = np.polynomial.legendre.leggauss(6)
    powers = np.arange(q)
    nodes = np.linspace(-1, 1, q)
    slopes = powers * np.power(at[:, None], np.maximum(powers - 1, 0))
    shape = slopes @ np.linalg.inv(np.power(nodes[:, None], powers))
    speed = np.linalg.norm(np.einsum("pq,kqa->kpa", shape, edges), axis=-1)
    return float(np.sum(speed @ weights))
