"""The regions beside the facets of named groups, and the places of the groups.

Every rank holds the cells on both sides of each facet of its own cells, so that what is asked of
owned cells is complete there.  All functions are collective.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import basix
import numpy as np
from mpi4py import MPI

from dea_fenicsx.mesh.device import Device
from dea_fenicsx.support import compat


def regions_beside(device: Device, names: Iterable[str]) -> set[str]:
    """Names of the regions that share a facet with the groups.

    A region that is itself among `names` counts only if another one of them lies beside it.
    """
    facets, cells = _incidences(device)
    tags = _tags(device)
    names = list(names)
    found: set[int] = set()
    for name in names:
        if name in device.surfaces:
            here = np.isin(facets, device.facets_by_surface[name])
            found |= set(tags[cells[here]].tolist())
        else:
            tag = device.regions[name]
            around = np.unique(facets[tags[cells] == tag])
            beside = tags[cells[np.isin(facets, around)]]
            found |= set(beside[beside != tag].tolist())
    everywhere = set().union(*device.comm.allgather(found))
    return {name for name, tag in device.regions.items() if tag in everywhere}


def places(device: Device, names: Iterable[str]) -> np.ndarray:
    """Undeformed corners and middles of this rank's facets or cells of the groups, in m.

    Returns
    -------
    ndarray of shape (n, 3)
    """
    corners = compat.geometry_dofmap(device.mesh)
    x = device.mesh.geometry.x * device.length
    topology = _topology(device)
    found = [np.empty((0, 3))]
    for name in names:
        if name in device.regions:
            groups = [x[corners[device.cells_of(name)][:, : len(topology[0])]]]
        else:
            local = _local_facets(device)
            chosen = np.isin(local, device.facets_by_surface[name])
            groups = [
                x[corners[: len(local)][chosen[:, k]][:, corner]]
                for k, corner in enumerate(topology[device.dim - 1])
            ]
        for group in groups:
            found += [group.reshape(-1, 3), group.mean(axis=1)]
    return np.concatenate(found)


def extent(device: Device, values: np.ndarray) -> tuple[float, float]:
    """Least and largest of values that are spread over the ranks."""
    low = device.comm.allreduce(float(np.min(values, initial=np.inf)), op=MPI.MIN)
    return low, device.comm.allreduce(float(np.max(values, initial=-np.inf)), op=MPI.MAX)


def region_extent(device: Device, names: Iterable[str], axis: int) -> tuple[float, float]:
    """Least and largest undeformed coordinate of all nodes of the regions, in m."""
    cells = np.concatenate([device.cells_of(name) for name in names])
    nodes = compat.geometry_dofmap(device.mesh)[cells]
    return extent(device, device.mesh.geometry.x[nodes.ravel(), axis] * device.length)


def share_off_planes(
    device: Device, kinds: dict[str, float], axis: int, on_plane: Callable[[np.ndarray], np.ndarray]
) -> float:
    """Share of the boundary of regions, as seen along an axis, that lies off given planes.

    Parameters
    ----------
    device
        The device.
    kinds
        Names of the regions that are taken together, each with a number.  A facet between two of
        them belongs to the boundary where the numbers differ.
    axis
        Number of the axis.  A facet counts by its area projected along it, so that one parallel to
        the axis does not count.
    on_plane
        Tells of coordinates along the axis in m, shape (facets, corners), which facets lie on one
        of the planes.
    """
    topology = _topology(device)
    of_cell = np.full(len(_tags(device)), np.nan)
    for name, value in kinds.items():
        of_cell[device.cells_of(name)] = value
    local, owned = _local_facets(device), device.owned_cells()
    boundary = _boundary(device, of_cell)
    x = device.mesh.geometry.x[compat.geometry_dofmap(device.mesh)] * device.length
    sums = np.zeros(2)
    for k, corner in enumerate(topology[device.dim - 1]):
        chosen = np.flatnonzero(~np.isnan(of_cell[:owned]) & boundary[local[:owned, k]])
        corners = x[chosen][:, corner]
        area = _projected_area(corners, axis, device.dim)
        sums += [area.sum(), area[~on_plane(corners[:, :, axis])].sum()]
    total, off = device.comm.allreduce(sums, op=MPI.SUM)
    return float(off / total) if total > 0 else 0.0


def _boundary(device: Device, of_cell: np.ndarray) -> np.ndarray:
    """Mask of the local facets whose two sides differ; outside of all regions is NaN."""
    facets, cells = _incidences(device)
    count = int(np.max(facets, initial=-1)) + 1
    # NaN means outside of all regions.  It is replaced by a number, because NaN equals nothing.
    value = np.where(np.isnan(of_cell), -1.0, of_cell)[cells]
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, facets, value)
    np.maximum.at(high, facets, value)
    sides = np.bincount(facets, minlength=count)
    return (sides == 1) | (low != high)


def _projected_area(corners: np.ndarray, axis: int, dim: int) -> np.ndarray:
    """Area of facets in projection along an axis, from their corners, shape (n, corners, 3)."""
    if dim == 2:
        return np.abs(corners[:, 1, 1 - axis] - corners[:, 0, 1 - axis])
    if corners.shape[1] == 3:
        a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    else:  # a quadrilateral by its diagonals
        a, b = corners[:, 3] - corners[:, 0], corners[:, 2] - corners[:, 1]
    return np.abs(np.cross(a, b)[:, axis]) / 2


def _topology(device: Device) -> list:
    """For each dimension the corners of each of the reference cell's entities."""
    return basix.topology(getattr(basix.CellType, device.mesh.topology.cell_name()))


def _local_facets(device: Device) -> np.ndarray:
    """Local facets of each local cell, shape (cells, facets of a cell)."""
    device.mesh.topology.create_connectivity(device.dim, device.dim - 1)
    links = device.mesh.topology.connectivity(device.dim, device.dim - 1)
    return links.array.reshape(-1, len(_topology(device)[device.dim - 1]))


def _incidences(device: Device) -> tuple[np.ndarray, np.ndarray]:
    """All local pairs of a facet and a cell beside it."""
    device.mesh.topology.create_connectivity(device.dim - 1, device.dim)
    links = device.mesh.topology.connectivity(device.dim - 1, device.dim)
    sides = np.diff(links.offsets)
    return np.repeat(np.arange(len(sides)), sides), np.asarray(links.array)


def _tags(device: Device) -> np.ndarray:
    """Tag of the region of each local cell."""
    index_map = device.mesh.topology.index_map(device.dim)
    tags = np.zeros(index_map.size_local + index_map.num_ghosts, dtype=np.int64)
    tags[device.cells.indices] = device.cells.values
    return tags
