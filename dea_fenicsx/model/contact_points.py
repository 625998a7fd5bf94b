"""Gap, force and pressure of a contact at the points of integration on its surface."""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import basix
import numpy as np
import ufl

from dea_fenicsx.support import compat

QUADRATURE_OF_CONTACT = 6
"""Degree of exactness of the quadrature on surfaces that may touch an obstacle."""


class PointValues(NamedTuple):
    """Values at the points of integration of this rank, each of shape (facets, points).

    Attributes
    ----------
    gap
        The gap in units of the device's length.
    pushed
        p - r g in units of stress: the nominal contact pressure where it is positive.
    area
        Deformed area per undeformed area.
    """

    gap: np.ndarray
    pushed: np.ndarray
    area: np.ndarray


class ContactPoints:
    """Evaluates a contact at the points of integration.

    Parameters
    ----------
    mesh
        The mesh.
    contact
        A `Contact`.
    """

    def __init__(self, mesh: Any, contact: Any) -> None:
        self._mesh, self._contact = mesh, contact
        self._facets = contact.facets

    @cached_property
    def _evaluate(self) -> tuple[Any, tuple[int, int, int]]:
        """What evaluates all points of a cell's facets, and the shape of its result.  Collective.

        The area depends on the facet's normal, so each facet of the reference cell has its own.
        """
        contact = self._contact
        cell = getattr(basix.CellType, self._mesh.topology.cell_name())
        normals = basix.cell.facet_outward_normals(cell)
        points = [facet_points(cell, k) for k in range(len(normals))]
        inverse = ufl.JacobianInverse(self._mesh)
        areas = []
        for normal in normals:
            outward = ufl.dot(ufl.transpose(inverse), ufl.as_vector([float(n) for n in normal]))
            areas.append(contact.area(outward) / ufl.sqrt(ufl.dot(outward, outward)))
        slope = ufl.sqrt(ufl.dot(contact.direction, contact.direction))
        entries = [contact.gap, contact.pushed * slope, *areas]
        evaluate = compat.expression(ufl.as_vector(entries), np.vstack(points))
        return evaluate, (len(points), len(points[0]), len(entries))

    def values(self) -> PointValues:
        """The values in the problem's present state.  Collective at the first call."""
        evaluate, shape = self._evaluate
        cells, place = self._facets[:, 0].astype(np.int32), self._facets[:, 1]
        found = evaluate(self._mesh, cells).reshape(len(cells), *shape)
        mine = found[np.arange(len(cells)), place]
        areas = np.take_along_axis(mine[..., 2:], place[:, None, None], axis=2)[..., 0]
        return PointValues(mine[..., 0], mine[..., 1], areas)

    def pressures(self) -> np.ndarray:
        """Contact force over deformed area of each facet of this rank, in units of stress.

        Collective at the first call.
        """
        values, kind = self.values(), getattr(basix.CellType, self._mesh.topology.cell_name())
        facet = basix.cell.subentity_types(kind)[-2][0]
        _, weights = basix.make_quadrature(facet, QUADRATURE_OF_CONTACT)
        pushed = np.maximum(values.pushed, 0.0) @ weights
        return np.asarray(pushed / (values.area @ weights))


def facet_points(cell: Any, facet: int) -> np.ndarray:
    """Quadrature points of a facet of the reference cell, in its coordinates."""
    corners = basix.cell.geometry(cell)[basix.cell.topology(cell)[-2][facet]]
    kind = basix.cell.subentity_types(cell)[-2][facet]
    points, _ = basix.make_quadrature(kind, QUADRATURE_OF_CONTACT)
    edges = corners[1 : points.shape[1] + 1] - corners[0]
    return np.asarray(corners[0] + points @ edges)
