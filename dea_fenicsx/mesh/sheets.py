"""Parts of a result by cells, summed over the sheets of cells of a structured mesh."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from dea_fenicsx.geometry._structured import StructuredMesh
from dea_fenicsx.geometry.bisected import sheets
from dea_fenicsx.mesh.device import Device
from dea_fenicsx.support import compat


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
    dim, owned = device.dim, device.owned_cells()
    places = device.mesh.geometry.x[compat.geometry_dofmap(device.mesh)[:owned, : 2**dim]]
    everyone = device.comm.allgather((device.length * places, parts[:, :dim]))
    places = np.concatenate([p for p, _ in everyone])
    parts = np.concatenate([p for _, p in everyone])
    cells = mesh.points[mesh.corners(mesh.cells)]
    _, own = cKDTree(cells.mean(axis=1)).query(places.mean(axis=1))
    theirs, mine = _axes(places, first_fastest=True), _axes(cells, first_fastest=False)[own]
    cosine = np.abs(np.einsum("nax,nbx->nab", theirs, mine))
    number = sheets(mesh)
    axis = np.argmax(cosine, axis=2)
    which = np.take_along_axis(number[own], axis, axis=1)
    sums = np.bincount(which.ravel(), parts.ravel(), minlength=int(number.max()) + 1)
    return np.asarray(sums)


def _axes(corners: np.ndarray, first_fastest: bool) -> np.ndarray:
    """Unit vectors between the middles of opposite sides, shape (cells, axes, 3)."""
    dim = int(np.log2(corners.shape[1]))
    bits = np.array([[k >> a & 1 for a in range(dim)] for k in range(2**dim)])
    if not first_fastest:
        bits = bits[:, ::-1]
    found = np.einsum("ka,nkx->nax", 2.0 * bits - 1, corners)
    return np.asarray(found / np.linalg.norm(found, axis=2, keepdims=True))
