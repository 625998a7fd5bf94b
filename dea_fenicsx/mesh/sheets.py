"""The cells of a device among those of the structured mesh of its family."""

from __future__ import annotations

import weakref
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.geometry._structured import StructuredMesh
from dea_fenicsx.geometry.base import OfLattice
from dea_fenicsx.geometry.bisected import Bisected, sheets
from dea_fenicsx.geometry.quartic import QUARTIC_ORDER, is_curved, lagrange, some_of_both
from dea_fenicsx.mesh.device import Device
from dea_fenicsx.mesh.from_dolfinx import tags_alike
from dea_fenicsx.support import compat
from dea_fenicsx.support.curved_mesh import mesh_of_degree
from dea_fenicsx.support.exchange import Exchange
from dea_fenicsx.support.later import Later

spatial = Later("scipy.spatial")

SAME_MIDDLE = 1e-9
"""Distance of the middles of two cells that are the same one, relative to the device."""


@dataclass(frozen=True)
class Matching:
    """Which cell of a structured mesh each local cell of a device is, and how it lies there.

    Attributes
    ----------
    cell : number of the structured cell, shape (cells,)
    axis : axis of the structured cell along each axis of DOLFINx's, shape (cells, dim)
    turned : whether it runs the other way
    """

    cell: np.ndarray
    axis: np.ndarray
    turned: np.ndarray


def matching(device: Device, mesh: StructuredMesh) -> Matching:
    """The cells of a device, ghosts included, among those of the mesh of its family."""
    nodes = compat.geometry_dofmap(device.mesh)[:, : 2**device.dim]
    places = device.length * device.mesh.geometry.x[nodes]
    cells = mesh.points[mesh.corners(mesh.cells)]
    _, own = spatial.cKDTree(cells.mean(axis=1)).query(places.mean(axis=1))
    theirs, mine = _axes(places, first_fastest=True), _axes(cells, first_fastest=False)[own]
    cosine = np.einsum("nax,nbx->nab", theirs, mine)
    axis = np.argmax(np.abs(cosine), axis=2)
    turned = np.take_along_axis(cosine, axis[:, :, None], axis=2)[:, :, 0] < 0
    return Matching(own, axis, turned)


def over_sheets(device: Device, mesh: StructuredMesh, parts: np.ndarray) -> np.ndarray:
    """Sums over the cells of each sheet, the same on all ranks.  Collective.

    Parameters
    ----------
    device
        The device whose cells are those of `mesh`.
    mesh
        The structured mesh of its family.
    parts
        A number for each owned cell and each of its axes, as DOLFINx orders both.

    Returns
    -------
    ndarray, shape (sheets,)
        By their numbers as in `geometry.bisected.sheets`.
    """
    found, owned = matching(device, mesh), device.owned_cells()
    cell, comm, number = found.cell[:owned], device.comm, sheets(mesh)
    which = np.take_along_axis(number[cell], found.axis[:owned], axis=1).ravel()
    to_sums = Exchange(comm, which % comm.size)
    cell, which, terms = (
        to_sums.forward(mine)
        for mine in (np.repeat(cell, device.dim), which, parts[:, : device.dim].ravel())
    )
    order = np.argsort(cell, kind="stable")  # so that sums do not depend on the ranks
    sums = np.bincount(which[order], terms[order], minlength=int(number.max()) + 1)
    return np.asarray(comm.allreduce(sums))  # all but one of the terms of each are 0


def with_exact_shape(device: Device, degree: int = QUARTIC_ORDER) -> Device:
    """The device with curved cells of a degree, if its family makes curved ones.  Collective.

    Cells, their order and their ranks stay the same, and the same device gives the same one again.
    A device with straight cells, one whose cells have this degree or a higher one, and one that is
    no family, is given back as it is.

    Parameters
    ----------
    device
        The device.
    degree
        Degree of the new cells, up to `QUARTIC_ORDER`.
    """
    made = _made.setdefault(device, {})
    if degree not in made:
        made[degree] = _raised(device, degree)
    return made[degree] or device


_made: weakref.WeakKeyDictionary[Device, dict[int, Device | None]] = weakref.WeakKeyDictionary()
"""The curved cells of each device by their degree; None where the device stays as it is."""


def _raised(device: Device, degree: int) -> Device | None:
    """The device with curved cells of a degree, or None if it stays as it is.  Collective."""
    family = device.family
    if family is None or compat.coordinate_element(device.mesh).degree >= degree:
        return None
    meshes = _own_cells(device, family) if isinstance(family, OfLattice) else None
    coarse = family.mesh() if meshes is None else meshes[0]
    curved = coarse.order > 1 and is_curved(coarse, device.length)
    if not device.comm.allreduce(curved, op=MPI.LOR):
        return None
    if meshes is None:
        fine = (family if isinstance(family, Bisected) else Bisected(family)).fine
    else:
        fine = meshes[1]
    found = matching(device, coarse)

    def places(points: np.ndarray) -> np.ndarray:
        return _places(fine, found, points)[..., : device.mesh.geometry.dim] / device.length

    mesh = mesh_of_degree(device.mesh, degree, places)
    for dim in (device.dim - 1, device.dim):
        mesh.topology.create_connectivity(dim, device.dim)
    mesh.topology.create_connectivity(device.dim, device.dim - 1)
    facets: Any = device.facets
    return replace(
        device, mesh=mesh, cells=tags_alike(mesh, device.cells, device.dim),
        facets=None if facets is None else tags_alike(mesh, facets, device.dim - 1),
        checked_cells={},
    )  # fmt: skip


def _own_cells(device: Device, family: OfLattice) -> tuple[StructuredMesh, StructuredMesh] | None:
    """The local cells of a device as its family has them, and with fourth order.  Collective.

    None on all ranks if cells lie elsewhere, or those of fourth order have other nodes.
    """
    local = np.asarray(device.mesh.topology.original_cell_index, dtype=np.int64)
    nodes = compat.geometry_dofmap(device.mesh)
    found = some_of_both(family, local, device.length) if len(local) == len(nodes) else None
    if found is not None and len(local):
        there = device.length * device.mesh.geometry.x[nodes[:, : 2**device.dim]].mean(axis=1)
        off = found[0].points[found[0].corners(found[0].cells)].mean(axis=1) - there
        found = found if np.abs(off).max() < SAME_MIDDLE * device.length else None
    return found if device.comm.allreduce(found is not None, op=MPI.LAND) else None


def _places(mesh: StructuredMesh, found: Matching, points: np.ndarray) -> np.ndarray:
    """Positions in m of points of the reference cell in each local cell, shape (cells, n, 3)."""
    cells, dim = len(found.cell), points.shape[1]
    local = np.where(found.turned[:, None, :], 1 - points, points)
    along = np.empty((cells, len(points), dim))
    np.put_along_axis(along, np.broadcast_to(found.axis[:, None, :], along.shape), local, axis=2)
    values = [lagrange(QUARTIC_ORDER, along[..., a]) for a in range(dim)]
    letters = "abc"[:dim]
    terms = ",".join(f"np{letter}" for letter in letters)
    nodes = mesh.points[mesh.cells[found.cell]]
    return np.asarray(np.einsum(f"{terms},n{letters}x->npx", *values, nodes, optimize=True))


def _axes(corners: np.ndarray, first_fastest: bool) -> np.ndarray:
    """Unit vectors between the middles of opposite sides, shape (cells, axes, 3)."""
    dim = int(np.log2(corners.shape[1]))
    bits = np.array([[k >> a & 1 for a in range(dim)] for k in range(2**dim)])
    if not first_fastest:
        bits = bits[:, ::-1]
    found = np.einsum("ka,nkx->nax", 2.0 * bits - 1, corners)
    return np.asarray(found / np.linalg.norm(found, axis=2, keepdims=True))
