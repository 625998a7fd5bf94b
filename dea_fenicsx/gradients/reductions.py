"""What elements of one degree more add to functions on a cell, as a whole and along each axis.

With local values z of a field on a cell the part that the lower degree cannot hold is z - P z,
where P interpolates.  In quadrilaterals and hexahedra the same is done along one axis of the cell
alone; the parts along all axes tell in which directions a cell is too long.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import basix
import numpy as np
from numpy.polynomial import legendre

from dea_fenicsx.model.unknowns import Unknowns
from dea_fenicsx.support.cell_types import SIMPLICES

INTERVAL_CELL = basix.CellType.interval


def added_parts(base: Unknowns, richer: Unknowns, cell: str, dim: int) -> list[np.ndarray]:
    """Matrices for the local values of all unknowns of a cell: its added parts.

    Parameters
    ----------
    base, richer
        The unknowns, and those of one degree more.
    cell, dim
        Type of the cells and its dimension.

    Returns
    -------
    list of ndarray, shape (n, n)
        One along each axis, and one for the whole; on simplices the whole alone.
    """
    axes = [] if cell in SIMPLICES else list(range(dim))
    found: list[list[np.ndarray]] = [[] for _ in range(len(axes) + 1)]
    for old, new in zip(base.fields, richer.fields, strict=True):
        lower, upper = _scalar(old.element), _scalar(new.element)
        size = new.element.block_size
        for k, axis in enumerate([*axes, None]):
            one = _added(lower, upper, axis)
            found[k].append(np.kron(one, np.eye(size)))
    return [_diagonal(blocks) for blocks in found]


def raising(base: Unknowns, richer: Unknowns) -> np.ndarray:
    """The matrix from the local values of all unknowns of a cell to those of one degree more."""
    blocks = []
    for old, new in zip(base.fields, richer.fields, strict=True):
        lower, upper = _scalar(old.element), _scalar(new.element)
        up = np.eye(upper.dim)
        if lower != upper:
            up = basix.compute_interpolation_operator(lower, upper)
        blocks.append(np.kron(up, np.eye(new.element.block_size)))
    return _diagonal(blocks)


def _scalar(element: Any) -> Any:
    """The basix element of one component."""
    return (element.sub_elements[0] if element.block_size > 1 else element).basix_element


def _added(lower: Any, upper: Any, axis: int | None) -> np.ndarray:
    if lower == upper:
        return np.zeros((upper.dim, upper.dim))
    if axis is not None and upper.discontinuous:
        return _modes_along(upper, axis)
    if axis is not None:
        return np.eye(upper.dim) - _lowered_along(lower.degree, upper, axis)
    up = basix.compute_interpolation_operator(lower, upper)
    down = basix.compute_interpolation_operator(upper, lower)
    return np.eye(upper.dim) - up @ down


def _lowered_along(degree: int, upper: Any, axis: int) -> np.ndarray:
    """Interpolation of a lower degree along one axis, of an element of nodal values."""
    line = basix.create_element(
        basix.ElementFamily.P, INTERVAL_CELL, degree, basix.LagrangeVariant.gll_warped
    )
    nodes, places = line.points[:, 0], upper.points
    weights = line.tabulate(0, places[:, [axis]])[0][:, :, 0]
    found = np.zeros((len(places), upper.dim))
    for k, node in enumerate(nodes):
        moved = places.copy()
        moved[:, axis] = node
        found += weights[:, [k]] * upper.tabulate(0, moved)[0][:, :, 0]
    return upper.interpolation_matrix @ found


def _modes_along(upper: Any, axis: int) -> np.ndarray:
    """The modes of highest degree of a discontinuous element, by the share of an axis in each."""
    dim, degree = upper.points.shape[1], upper.degree
    powers = np.array([p for p in product(range(degree + 1), repeat=dim) if sum(p) <= degree])
    line = legendre.leggauss(degree + 1)[0]
    places = (1 + np.array(list(product(line, repeat=dim)))) / 2
    values = upper.tabulate(0, places)[0][:, :, 0]
    modes = np.prod(
        [legendre.legvander(2 * places[:, a] - 1, degree)[:, powers[:, a]] for a in range(dim)],
        axis=0,
    )
    share = np.where(powers.sum(axis=1) == degree, powers[:, axis] / max(degree, 1), 0.0)
    change = np.linalg.lstsq(modes, values, rcond=None)[0]
    return np.linalg.lstsq(values, modes @ (share[:, None] * change), rcond=None)[0]


def _diagonal(blocks: list[np.ndarray]) -> np.ndarray:
    """A matrix with these blocks along its diagonal."""
    rows, columns = (sum(block.shape[k] for block in blocks) for k in (0, 1))
    found, row, column = np.zeros((rows, columns)), 0, 0
    for block in blocks:
        found[row : row + block.shape[0], column : column + block.shape[1]] = block
        row, column = row + block.shape[0], column + block.shape[1]
    return found
