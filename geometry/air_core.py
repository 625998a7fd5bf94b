"""The air inside a Kresling storey."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown

from . import _check
from ._panel import ORDER
from ._structured import Floats, StructuredMesh, lattice_points, sweep
from .base import Geometry
from .grading import graded
from .kresling_cell import KreslingCell


@dataclass(frozen=True)
class AirCore(Geometry):
    """A `KreslingCell` and the air inside it, whose material is `Air`.

    The cells of the air run from the inner face of the panels and hinges towards the centre of the
    storey.  They end on ``core``, the inner face made smaller by a factor.  So panels that close on
    each other squeeze the air between them.

    Parameters
    ----------
    storey
        The storey.
    share
        Size of the core over that of the inner face.
    divisions
        Cells from the panels to the core.
    grading
        Largest over smallest of these cells; the small ones lie at the core.
    region
        Name of the air.

    Notes
    -----
    Groups: those of the storey, the volume of the air, and ``core``.  At the polygons and where
    creases are cut out, the air ends in faces without a name.

    Raises
    ------
    InputError
        A parameter is not usable, or a panel turns its inner face away from the centre.
    """

    storey: KreslingCell
    share: float = 0.05
    divisions: int = 2
    grading: float = 3.0
    region: str = "air"

    def __post_init__(self) -> None:
        if not isinstance(self.storey, KreslingCell):
            raise InputError(
                f"AirCore: storey is {shown(self.storey)}; it must be a KreslingCell."
            )
        if not 0 < _check.number("AirCore", "share", self.share) < 1:
            raise InputError(
                f"AirCore: share is {self.share:g}; it must be above 0 and below 1."
            )
        _check.count("AirCore", "divisions", self.divisions)
        _check.ratio("AirCore", "grading", self.grading)
        _check.group_name("AirCore", "region", self.region)
        if self.region in {*self.storey.measures(), "core"}:
            raise InputError(
                f"AirCore: region is {self.region!r}, the name of another group; call the air "
                "otherwise."
            )
        mesh = self.storey.mesh()
        if np.max(_pyramids(mesh.points[mesh.facets["inner"]] - self._centre)) >= 0:
            raise InputError(
                "AirCore: the inner face turns away from the centre of the storey somewhere; make "
                "the hinges narrower or the twist smaller."
            )

    @property
    def _centre(self) -> Floats:
        return np.array([0.0, 0.0, self.storey.height / 2])

    def measures(self) -> dict[str, float]:
        """Volume (m^3) of every region and area (m^2) of every facet group.

        Those of the storey are exact, that of the air is integrated over the faces of its mesh.
        """
        found = self.storey.measures()
        mesh = self.storey.mesh()
        inside = -float(np.sum(_pyramids(mesh.points[mesh.facets["inner"]] - self._centre)))
        found[self.region] = inside * (1 - self.share**3)
        found["core"] = found["inner"] * self.share**2
        return found

    def refine(self, factor: int) -> AirCore:
        """The same storey and air with all divisions multiplied by ``factor``."""
        k = _check.count("AirCore.refine", "factor", factor)
        return replace(self, storey=self.storey.refine(k), divisions=k * self.divisions)

    def mesh(self) -> StructuredMesh:
        """Nodes, cells and named parts as plain arrays."""
        solid = self.storey.mesh()
        inner = solid.facets["inner"]
        nodes, plane = np.unique(inner, return_inverse=True)
        plane = plane.reshape(inner.shape)
        cells, _, level = sweep(plane, self.divisions, ORDER)
        steps = 1 - (1 - self.share) * lattice_points(
            graded(self.divisions, self.grading, "end"), ORDER
        )
        arms = solid.points[nodes] - self._centre
        points = self._centre + steps[None, :, None] * arms[:, None]
        # The first level is the inner face itself, the others are new nodes.
        count, levels = len(solid.points), len(steps)
        number = count + np.arange(len(nodes) * (levels - 1)).reshape(len(nodes), levels - 1)
        number = np.column_stack([nodes, number])
        cells = number.ravel()[cells]
        mesh = StructuredMesh(
            np.concatenate([solid.points, points[:, 1:].reshape(-1, 3)]),
            np.concatenate([solid.cells, cells]), dict(solid.regions), dict(solid.facets),
        )  # fmt: skip
        first = len(solid.cells)
        mesh.add_region(self.region, first + np.arange(len(cells)))
        mesh.add_facets("core", first + np.flatnonzero(level == self.divisions - 1), 2, 1)
        return mesh


def _pyramids(faces: Floats) -> Floats:
    """Volumes between the origin and biquadratic faces, shape (K, 3, 3, 3); outwards positive."""
    at, weights = np.polynomial.legendre.leggauss(4)
    shape = np.stack([at * (at - 1) / 2, 1 - at**2, at * (at + 1) / 2])
    slope = np.stack([at - 0.5, -2 * at, at + 0.5])
    x = np.einsum("kija,ip,jq->kpqa", faces, shape, shape)
    first = np.einsum("kija,ip,jq->kpqa", faces, slope, shape)
    second = np.einsum("kija,ip,jq->kpqa", faces, shape, slope)
    density = np.sum(x * np.cross(first, second), axis=-1) / 3
    return np.asarray(np.einsum("kpq,p,q->k", density, weights, weights))
