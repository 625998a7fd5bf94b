"""A device of another undeformed shape: the same mesh with its nodes moved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from mpi4py import MPI

from dea_fenicsx.mesh.device import Device
from dea_fenicsx.mesh.from_dolfinx import tags_alike
from dea_fenicsx.support import compat
from dea_fenicsx.support.agreement import together
from dea_fenicsx.support.errors import InputError

Shape = Callable[[np.ndarray], np.ndarray]
"""Takes positions in m, of shape (3, n), and gives displacements of shape (dim, n) in any unit."""


def moved(device: Device, shape: Shape, size: float) -> Device:
    """A device whose nodes are moved along a shape.  The given one stays as it is.  Collective.

    Parameters
    ----------
    device
        The device.
    shape
        The displacements of nodes, up to a factor.
    size
        The largest displacement in m; the sign chooses the side.

    Raises
    ------
    InputError
        If the shape is 0 everywhere, not finite, or of other dimensions.
    """
    mesh = compat.copied_mesh(device.mesh)
    dim = device.dim
    for d in (dim - 1, dim):
        mesh.topology.create_connectivity(d, dim)
    mesh.topology.create_connectivity(dim, dim - 1)
    x = mesh.geometry.x
    found = np.zeros((dim, len(x)))

    def displacements() -> None:
        values = np.asarray(shape(device.length * x.T), dtype=np.float64)
        if values.shape != found.shape or not np.isfinite(values).all():
            raise InputError(
                f"The shape of an imperfection gives numbers of shape {values.shape}, but must "
                f"give finite ones of shape ({dim}, n) at n = {len(x)} points."
            )
        found[:] = values

    together(device.comm, displacements, "The shape of an imperfection")
    largest = float(np.sqrt((found**2).sum(axis=0)).max(initial=0.0))
    largest = device.comm.allreduce(largest, op=MPI.MAX)
    if largest == 0:
        raise InputError("The shape of an imperfection is 0 at all nodes; give another one.")
    x[:, :dim] += size / largest / device.length * found.T
    facets = device.facets
    return replace(
        device, mesh=mesh, cells=tags_alike(mesh, device.cells, dim),
        facets=None if facets is None else tags_alike(mesh, facets, dim - 1),
        source=f"{device.source or 'device'} with an imperfection", checked_cells={},
        family=None, rebuilt=None,
    )  # fmt: skip
