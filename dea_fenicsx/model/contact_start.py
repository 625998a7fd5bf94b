"""How deep the undeformed device lies in its obstacles, and whether that can be mended."""

from __future__ import annotations

from typing import Any

import basix
import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.mesh.point_search import place_of
from dea_fenicsx.model.contact import Contact, Contacts
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.scene.shapes import Cylinder, Sphere
from dea_fenicsx.support import compat
from dea_fenicsx.support.errors import InputError

INTERVALS_OF_EDGE = 4
"""Gaps are computed at the points of a lattice with this number of intervals along each edge."""

SAME_DEPTH = 1e-9
"""Depths in units of the device's length that differ by less are equal but for rounding."""

AXIS_POINTS = 21
"""Number of points of the axis of a cylinder in space of which none may lie in the device."""


def depths(scene: Scene, contacts: Contacts) -> list[float]:
    """How deep each surface lies in its obstacle, dimensionless; 0 where it does not.  Collective.

    The problem must be in its undeformed state.

    Raises
    ------
    InputError
        If an obstacle lies inside the device, so that moving its surface cannot free it.
    """
    return [_depth(scene, contact) for contact in contacts]


def _depth(scene: Scene, contact: Contact) -> float:
    device, name = scene.device, contact.told.surface
    kind = getattr(basix.CellType, device.mesh.topology.cell_name())
    lattice = basix.create_lattice(kind, INTERVALS_OF_EDGE, basix.LatticeType.equispaced, True)
    facets = [_on_facet(kind, k) for k in range(len(basix.cell.facet_outward_normals(kind)))]
    evaluate = compat.expression(ufl.as_vector([contact.gap]), np.vstack([lattice, *facets]))
    cells = np.arange(device.owned_cells(), dtype=np.int32)
    gaps = evaluate(device.mesh, cells)[..., 0]
    whole, sides = gaps[:, : len(lattice)], gaps[:, len(lattice) :]
    sides = sides.reshape(len(cells), len(facets), len(facets[0]))
    mine = sides[contact.facets[:, 0], contact.facets[:, 1]]
    lows = [-float(np.min(values, initial=np.inf)) for values in (whole, mine)]
    deepest, on_surface = (device.comm.allreduce(low, op=MPI.MAX) for low in lows)
    if contact.told.lies_between:
        return max(on_surface, 0.0)
    if max(deepest, 0.0) > max(on_surface, 0.0) + SAME_DEPTH:
        raise InputError(
            f"The obstacle at {name!r} lies inside the device: a point that is not on {name!r} is "
            f"{deepest * device.length:.3g} m deep in it; move the obstacle away, or turn its "
            "normal."
        )
    for point in _deep_points(scene, contact):
        found = place_of(device, point, cells)
        if found is not None and found.distance == 0:
            raise InputError(
                f"The obstacle at {name!r} lies inside the device, which holds the point "
                f"({', '.join(f'{x:.6g}' for x in point)}) m of it; move the obstacle away."
            )
    return max(on_surface, 0.0)


def _on_facet(kind: Any, facet: int) -> np.ndarray:
    """The lattice's points on a facet of the reference cell."""
    corners = basix.cell.geometry(kind)[basix.cell.topology(kind)[-2][facet]]
    side = basix.cell.subentity_types(kind)[-2][facet]
    points = basix.create_lattice(side, INTERVALS_OF_EDGE, basix.LatticeType.equispaced, True)
    edges = corners[1 : points.shape[1] + 1] - corners[0]
    return np.asarray(corners[0] + points @ edges)


def _deep_points(scene: Scene, contact: Contact) -> list[np.ndarray]:
    """Points deep in an obstacle, in m and in the coordinates of the mesh.  Collective."""
    shape, along = contact.told.shape, list(contact.told.along)
    if not isinstance(shape, Sphere | Cylinder) or shape.hollow:
        return []
    middle = np.array(shape.point)
    if isinstance(shape, Sphere):
        return [middle[along]]
    if scene.kinematics.dim == 2:
        return [] if scene.kinematics.axis_of_rotation else [middle[along]]
    assert shape.axis is not None
    device = scene.device
    x = device.mesh.geometry.x * device.length
    axis = np.array(shape.axis) / np.linalg.norm(shape.axis)
    rise = (x - middle) @ axis
    low = device.comm.allreduce(float(np.min(rise, initial=np.inf)), op=MPI.MIN)
    high = device.comm.allreduce(float(np.max(rise, initial=-np.inf)), op=MPI.MAX)
    return [middle + s * axis for s in np.linspace(low, high, AXIS_POINTS)]
