"""The rim of a surface: the edges that belong to one of its facets only.

An edge is named by the global numbers of its two vertices, so that all ranks agree about it.  In
two dimensions the facets are lines, and a point takes the place of an edge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import basix
import numpy as np
from mpi4py import MPI

from dea_fenicsx.mesh.device import Device
from dea_fenicsx.support import compat
from dea_fenicsx.support.errors import InputError


@dataclass(frozen=True)
class Rim:
    """The open edges of a surface, the same on all ranks.

    Attributes
    ----------
    edges
        Numbers of the edges, sorted, shape (n,); see `edges_of`.
    ends
        Undeformed positions of their two ends, shape (n, 2, 3), dimensionless.
    """

    edges: np.ndarray
    ends: np.ndarray

    def __len__(self) -> int:
        return len(self.edges)

    def place(self, length: float) -> str:
        """The first of the open edges by its coordinates, in words.

        Parameters
        ----------
        length
            The unit of length in m.
        """
        middles = np.round(self.ends.mean(axis=1), 9)
        first = self.ends[np.lexsort(middles.T)[0]] * length
        if np.allclose(first[0], first[1]):
            return f"the point {_point(first[0])}"
        low, high = first[np.lexsort(np.round(first, 12).T)]
        return f"the edge from {_point(low)} to {_point(high)}"

    def part(self, chosen: np.ndarray) -> Rim:
        """Some of its edges, chosen by a mask."""
        return Rim(self.edges[chosen], self.ends[chosen])


def _point(x: np.ndarray) -> str:
    return "(" + ", ".join(f"{value + 0.0:.6g}" for value in x) + ") m"


def outer_facets(device: Device, names: Sequence[str]) -> np.ndarray:
    """The facets of groups on the outside of a device, each seen from its cell.  Collective.

    Returns
    -------
    ndarray of shape (n, 2)
        Pairs (owned cell, number of the facet within it), each facet once over all ranks.

    Raises
    ------
    InputError
        If a facet lies between two cells.
    """
    topology, dim = device.mesh.topology, device.dim
    sides = np.diff(topology.connectivity(dim - 1, dim).offsets)
    found = []
    for name in names:
        pairs = _incidences(device, name)
        inside = sides[_local_facets(device)[pairs[:, 0], pairs[:, 1]]] > 1
        if device.comm.allreduce(bool(inside.any()), op=MPI.LOR):
            raise InputError(
                f"The surface {name!r} lies inside the device, between two cells, but the wall of "
                "a cavity must lie on its outside; leave the cavity out of the mesh."
            )
        found.append(pairs)
    return np.unique(np.concatenate(found), axis=0).astype(np.int32)


def rim_of(device: Device, facets: np.ndarray) -> Rim:
    """The rim of facets, each given once over all ranks as (cell, facet).  Collective."""
    edges, ends = edges_of(device, facets)
    # Only an edge that this rank has an odd number of times can be open.
    edges, first, count = np.unique(edges, return_index=True, return_counts=True)
    odd = count % 2 == 1
    shared = device.comm.allgather((edges[odd], ends[first[odd]]))
    edges = np.concatenate([e for e, _ in shared])
    ends = np.concatenate([x for _, x in shared])
    edges, first, count = np.unique(edges, return_index=True, return_counts=True)
    odd = count % 2 == 1
    return Rim(edges[odd], ends[first[odd]])


def on_surface(device: Device, rim: Rim, name: str) -> np.ndarray:
    """Mask of the edges of a rim that belong to a facet of a group.  Collective."""
    edges, _ = edges_of(device, _incidences(device, name))
    found = np.isin(rim.edges, edges)
    device.comm.Allreduce(MPI.IN_PLACE, found, op=MPI.LOR)
    return found


def edges_of(device: Device, facets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All edges of this rank's facets, with repetition.

    Parameters
    ----------
    device
        The device.
    facets
        Pairs (cell, number of the facet within it), shape (n, 2).

    Returns
    -------
    edges : ndarray of shape (m,)
        A number of each edge that is the same on all ranks.
    ends : ndarray of shape (m, 2, 3)
        Positions of its ends.
    """
    mesh, dim = device.mesh, device.dim
    shape = basix.topology(getattr(basix.CellType, mesh.topology.cell_name()))
    vertices = mesh.topology.connectivity(dim, 0)
    per_cell = len(shape[0])
    corners = vertices.array.reshape(-1, per_cell)
    nodes = compat.geometry_dofmap(mesh)
    numbering = mesh.topology.index_map(0)
    edges, ends = [np.empty(0, np.int64)], [np.empty((0, 2, 3))]
    for k, of_facet in enumerate(shape[dim - 1]):
        cells = facets[facets[:, 1] == k, 0]
        pairs = (
            [(v, v) for v in of_facet] if dim == 2
            else [e for e in shape[1] if set(e) <= set(of_facet)]
        )  # fmt: skip
        for pair in pairs:
            local = corners[cells][:, list(pair)]
            number = numbering.local_to_global(local.ravel().astype(np.int32)).reshape(-1, 2)
            number = np.sort(number, axis=1)
            edges.append(number[:, 0] * numbering.size_global + number[:, 1])
            ends.append(mesh.geometry.x[nodes[cells][:, list(pair)]])
    return np.concatenate(edges), np.concatenate(ends)


def _incidences(device: Device, name: str) -> np.ndarray:
    """Pairs (owned cell, number of the facet within it) of a facet group, shape (n, 2)."""
    local = _local_facets(device)[: device.owned_cells()]
    return np.argwhere(np.isin(local, device.facets_by_surface[name])).reshape(-1, 2)


def _local_facets(device: Device) -> np.ndarray:
    """Local facets of each local cell, shape (cells, facets of a cell)."""
    mesh, dim = device.mesh, device.dim
    shape = basix.topology(getattr(basix.CellType, mesh.topology.cell_name()))
    return mesh.topology.connectivity(dim, dim - 1).array.reshape(-1, len(shape[dim - 1]))
