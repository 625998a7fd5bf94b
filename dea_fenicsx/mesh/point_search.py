"""Which cell holds a point, the same one on any number of ranks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dea_fenicsx.mesh.device import Device
from dea_fenicsx.support import compat
from dea_fenicsx.support.cell_types import SIMPLICES

REFERENCE_TOLERANCE = 1e-9
"""A point is inside of a cell if its reference coordinates lie outside by no more than this."""

MOST_NEAR_CELLS = 64
"""Each rank computes the distance of a point from this number of its cells, the nearest by
boxes.
"""

INTERVALS_OF_CELL = 6
"""Number of intervals along each axis of the lattice of points that is laid into a cell."""

LATTICE_REFINEMENTS = 30
"""The lattice shrinks this number of times about its point nearest to the given one, each time to a
third of its size.
"""

NEWTON_OF_POINT = 30
"""Largest number of iterations for the reference coordinates of a point in a curved cell."""


@dataclass(frozen=True)
class PointInMesh:
    """Where a point lies in a mesh; the same on all ranks, but for the cell.

    Attributes
    ----------
    rank
        The rank that owns the cell.
    cell
        The cell's local number on that rank; -1 on all others.
    reference
        The reference coordinates in the cell, shape (dim,).
    distance
        Distance in m between the point and the cell; 0 if the cell holds it.
    """

    rank: int
    cell: int
    reference: np.ndarray
    distance: float


def place_of(device: Device, point: np.ndarray, cells: np.ndarray) -> PointInMesh | None:
    """The cell that holds a point, or else the nearest one.  Collective.

    Of several cells at the same distance it is the one that comes first in the mesh file, whatever
    the number of ranks.

    Parameters
    ----------
    device
        The device.
    point
        Coordinates of the undeformed mesh in m, shape (dim,).
    cells
        The owned cells of this rank that come into question.

    Returns
    -------
    PointInMesh or None
        None if no rank has such cells.
    """
    mine = _nearest_of_rank(device, np.asarray(point, dtype=float) / device.length, cells)
    everyone = device.comm.allgather(mine)
    known = [(found[:2], rank) for rank, found in enumerate(everyone) if found is not None]
    if not known:
        return None
    _, rank = min(known)
    distance, _, cell, reference = everyone[rank]
    here = cell if rank == device.comm.rank else -1
    return PointInMesh(rank, here, np.array(reference), distance * device.length)


def _nearest_of_rank(
    device: Device, point: np.ndarray, cells: np.ndarray
) -> tuple[float, int, int, list[float]] | None:
    """Distance, number in the file, local number and reference coordinates of the best cell."""
    if len(cells) == 0:
        return None
    mesh = device.mesh
    shape = _Shape(mesh)
    nodes = mesh.geometry.x[:, : len(point)][compat.geometry_dofmap(mesh)[cells]]
    low, high = nodes.min(axis=1), nodes.max(axis=1)
    # an edge of a curved cell may bulge beyond its nodes, by less than half of the cell's size
    bulge = 0.5 * (high - low) if shape.is_curved else 0.0
    gap = np.maximum(0, np.maximum(low - bulge - point, point - high - bulge))
    gaps = np.linalg.norm(gap, axis=1)
    numbers = np.asarray(mesh.topology.original_cell_index)[cells]
    order = np.lexsort((numbers, gaps))
    # all cells whose box holds the point, which may be many about a node, and some of the others
    order = order[: max(MOST_NEAR_CELLS, int(np.count_nonzero(gaps <= REFERENCE_TOLERANCE)))]
    best = None
    for k in order:
        if best is not None and gaps[k] > best[0] + REFERENCE_TOLERANCE:
            continue
        X = shape.reference_coordinates(nodes[k], point)
        distance = 0.0
        if X is None:
            X, distance = shape.nearest(nodes[k], point)
        found = (distance, int(numbers[k]), int(cells[k]), [float(c) for c in X])
        best = found if best is None else min(best, found)
    return best


class _Shape:
    """The map from the reference cell of a mesh to its cells."""

    def __init__(self, mesh: Any) -> None:
        self._element = compat.coordinate_element(mesh)
        self.is_curved = self._element.degree > 1
        self._simplex = mesh.topology.cell_name() in SIMPLICES
        self._dim = dim = mesh.topology.dim
        axis = np.linspace(0, 1, INTERVALS_OF_CELL + 1)
        self._lattice = np.stack(np.meshgrid(*[axis] * dim, indexing="ij"), -1).reshape(-1, dim)

    def _put(self, X: np.ndarray) -> np.ndarray:
        """Points moved into the reference cell, shape (n, dim)."""
        X = np.clip(X, 0, 1)
        return X / np.maximum(1, X.sum(axis=1))[:, None] if self._simplex else X

    def reference_coordinates(self, nodes: np.ndarray, point: np.ndarray) -> np.ndarray | None:
        """Reference coordinates of a point by Newton's method; None if the cell has it not."""
        X = np.full(self._dim, 1 / (self._dim + 1) if self._simplex else 0.5)
        for _ in range(NEWTON_OF_POINT):
            table = self._element.tabulate(1, X[None, :])[:, 0, :, 0]
            jacobian = (table[1:] @ nodes).T
            try:
                step = self._step(jacobian, point - table[0] @ nodes)
            except np.linalg.LinAlgError:
                return None
            X = X + step
            if not np.all(np.abs(X) < 10):
                return None
            if np.max(np.abs(step)) < 1e-13:
                break
        else:
            # near the end rounding may keep the steps above the bound
            if np.max(np.abs(step)) > REFERENCE_TOLERANCE:
                return None
        inside = self._put(X[None, :])[0]
        if len(point) > self._dim:  # the nearest point of a surface need not be the point itself
            x = self._element.tabulate(0, X[None, :])[0, 0, :, 0] @ nodes
            if np.linalg.norm(x - point) > REFERENCE_TOLERANCE:
                return None
        return inside if np.max(np.abs(inside - X)) <= REFERENCE_TOLERANCE else None

    def _step(self, jacobian: np.ndarray, missing: np.ndarray) -> np.ndarray:
        """The step of Newton's method, on a surface that of Gauss and Newton."""
        if len(missing) == self._dim:
            return np.linalg.solve(jacobian, missing)
        return np.linalg.lstsq(jacobian, missing, rcond=None)[0]

    def nearest(self, nodes: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, float]:
        """Reference coordinates of the cell's point that is nearest to a point, and the distance.

        The nearest point of a lattice, which then shrinks about it.
        """
        best, size = np.full(self._dim, 0.5), 1.0
        distance = np.inf
        for _ in range(LATTICE_REFINEMENTS):
            X = self._put(best + size * (self._lattice - 0.5))
            x = self._element.tabulate(0, X)[0, :, :, 0] @ nodes
            apart = np.linalg.norm(x - point, axis=1)
            k = int(np.argmin(apart))
            best, distance = X[k], float(apart[k])
            size *= 0.4
        return best, distance
