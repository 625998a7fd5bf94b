"""Checks that the cells of a mesh are valid: none is folded, none overlaps its neighbour.

A folded cell gives finite numbers and a wrong answer, since integrals take the size of the
Jacobian's determinant; so it is told before anything is solved.
"""

from __future__ import annotations

import hashlib
from typing import Any

import basix
import numpy as np
from mpi4py import MPI

from dea_fenicsx.mesh.device import Device
from dea_fenicsx.mesh.foreign.arrays import point
from dea_fenicsx.support import compat
from dea_fenicsx.support.errors import InputError

SMALLEST_DETERMINANT = 1e-12
"""Smallest determinant of a valid cell, as a share of the product of its edges."""

CORNER_TOLERANCE = 1e-6
"""Largest negative determinant in a corner, in the same units, that may be a rounding error."""


def check_cells(device: Device, degree: int) -> None:
    """Raise InputError if cells are folded, flat, or overlap a neighbour.  Collective.

    The cells of many scenes on one device are looked at once, unless nodes have been moved since.

    Parameters
    ----------
    device
        The meshed device.
    degree
        Degree of exactness of the quadrature at whose points the Jacobian is looked at.

    Raises
    ------
    InputError
        Naming how many cells, and where the first one lies.
    """
    nodes = digest_of_nodes(device)
    valid = device.checked_cells.get(degree) == nodes
    if device.comm.allreduce(valid, op=MPI.LAND):
        return
    owned = device.owned_cells()
    bad = _folded(device, degree)[:owned]
    _refuse(device, bad, "folded or flat (the Jacobian changes sign or vanishes inside)")
    _refuse(device, _overlapping(device)[:owned], "inverted (on the same side as a neighbour)")
    device.checked_cells[degree] = nodes


def digest_of_nodes(device: Device) -> str:
    """A digest of the coordinates of this rank's nodes, which a script may have moved."""
    return hashlib.sha1(device.mesh.geometry.x.tobytes()).hexdigest()


def _refuse(device: Device, bad: np.ndarray, how: str) -> None:
    """Raise on all ranks if any rank marks a cell as bad."""
    comm, mesh = device.comm, device.mesh
    count = comm.allreduce(int(np.count_nonzero(bad)), op=MPI.SUM)
    if not count:
        return
    here = np.flatnonzero(bad)
    first = (np.iinfo(np.int64).max, "")
    if len(here):
        original = np.asarray(mesh.topology.original_cell_index)[here]
        k = int(np.argmin(original))
        middle = mesh.geometry.x[compat.geometry_dofmap(mesh)[here[k]]].mean(axis=0)
        first = (int(original[k]), point(middle * device.length, device.dim))
    total = comm.allreduce(device.owned_cells(), op=MPI.SUM)
    _, place = min(comm.allgather(first))
    verb = "are" if count > 1 else "is"
    raise InputError(
        f"{count} of {total} cells of {device.source or 'the mesh'} {verb} {how}, the first at "
        f"{place}; mesh the geometry anew, with smaller or straight cells there."
    )


def _folded(device: Device, degree: int) -> np.ndarray:
    """Mask of local cells in which the Jacobian's determinant has no one sign.

    Looked at in the quadrature points, where it must not vanish either, and in the corners, where
    it may: the cells at the corners of a round core are flat there.
    """
    mesh = device.mesh
    table = compat.geometry_dofmap(mesh)
    kind = getattr(basix.CellType, mesh.topology.cell_name())
    points, _ = basix.make_quadrature(kind, degree)
    inside = len(points)
    points = np.vstack([points, basix.geometry(kind)])
    slopes = compat.coordinate_element(mesh).tabulate(1, points)[1:, :, :, 0]
    bad = np.zeros(len(table), dtype=bool)
    for part in np.array_split(np.arange(len(table)), len(table) // 5000 + 1):
        if not len(part):
            continue
        x = mesh.geometry.x[table[part]][:, :, : mesh.geometry.dim]
        J = np.einsum("dqn,cni->cqid", slopes, x, optimize=True)
        with np.errstate(all="ignore"):  # a lost node gives NaN, which is refused below
            edges = np.prod(np.linalg.norm(J, axis=2), axis=2).max(axis=1, keepdims=True)
            share = _determinant(J) / edges
        share *= np.sign(share[:, :1])
        bad[part] = ~(share[:, :inside].min(axis=1) > SMALLEST_DETERMINANT) | ~(
            share[:, inside:].min(axis=1) > -CORNER_TOLERANCE
        )
    return bad


def _determinant(J: np.ndarray) -> np.ndarray:
    """Determinant of Jacobians; of a surface's the area, with the sign of the first of its points.

    Parameters
    ----------
    J
        Shape (cells, points, coordinates, dimension of the cells).

    Returns
    -------
    ndarray of shape (cells, points)
        That of a surface is its projection on the normal of the cell's first point.
    """
    if J.shape[2] == J.shape[3]:
        return np.linalg.det(J)
    if J.shape[3] == 1:
        normal = J[..., 0]
    else:
        normal = np.cross(J[..., 0], J[..., 1])
    along = normal[:, :1] / np.linalg.norm(normal[:, :1], axis=-1, keepdims=True)
    return np.sum(normal * along, axis=-1)


def _overlapping(device: Device) -> np.ndarray:
    """Mask of local cells that lie on the same side of a shared facet as the neighbour.

    Of two such cells the one with more such facets is meant, or both.
    """
    mesh, d = device.mesh, device.dim
    if mesh.geometry.dim > d:  # the cells of a surface have no side that they share
        return np.zeros(len(compat.geometry_dofmap(mesh)), dtype=bool)
    mesh.topology.create_connectivity(d - 1, 0)
    nodes = _corner_nodes(mesh)
    x = mesh.geometry.x[:, :d]
    cells_of = mesh.topology.connectivity(d - 1, d)
    vertices_of = mesh.topology.connectivity(d - 1, 0)
    counts = np.diff(cells_of.offsets)
    inner = np.flatnonzero(counts == 2)
    wrong = np.zeros(len(compat.geometry_dofmap(mesh)))
    if not len(inner):
        return wrong > 0
    pair = cells_of.array.reshape(-1)[cells_of.offsets[inner][:, None] + np.arange(2)]
    per_facet = int(np.diff(vertices_of.offsets)[0])
    corners = vertices_of.array[vertices_of.offsets[inner][:, None] + np.arange(per_facet)]
    X = x[nodes[corners]]
    if d == 3:
        # the area vector of the diagonals, for quadrilaterals in tensor-product order
        last = X[:, 3] - X[:, 0] if per_facet == 4 else X[:, 2] - X[:, 0]
        other = X[:, 2] - X[:, 1] if per_facet == 4 else X[:, 1] - X[:, 0]
        normal = np.cross(last, other)
    else:
        edge = X[:, 1] - X[:, 0]
        normal = np.column_stack([-edge[:, 1], edge[:, 0]])
    middle = X.mean(axis=1)
    table = compat.geometry_dofmap(mesh)[:, : _corners_per_cell(mesh)]
    centre = x[table].mean(axis=1)
    side = np.einsum("fpi,fi->fp", centre[pair] - middle[:, None], normal)
    bad = side[:, 0] * side[:, 1] > 0
    for k in range(2):
        np.add.at(wrong, pair[bad, k], 1.0)
    # A valid neighbour of an inverted cell has one wrong facet; the inverted cell has several.
    worst = np.zeros(len(wrong))
    for a, b in ((0, 1), (1, 0)):
        np.maximum.at(worst, pair[bad, a], wrong[pair[bad, b]])
    return (wrong > 0) & (wrong >= worst)


def _corners_per_cell(mesh: Any) -> int:
    return len(basix.topology(getattr(basix.CellType, mesh.topology.cell_name()))[0])


def _corner_nodes(mesh: Any) -> np.ndarray:
    """Geometry node of each local vertex."""
    d = mesh.topology.dim
    mesh.topology.create_connectivity(d, 0)
    vertices = mesh.topology.connectivity(d, 0).array
    corners = compat.geometry_dofmap(mesh)[:, : _corners_per_cell(mesh)].ravel()
    found = np.zeros(int(vertices.max(initial=-1)) + 1, dtype=np.int64)
    found[vertices] = corners
    return found
