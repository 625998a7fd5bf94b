"""How good the cells of structured meshes are, by the measures of gmsh but without it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from math import comb

import numpy as np

from ._structured import Floats


def least_and_aspect(places: Floats) -> tuple[float, float]:
    """Least scaled Jacobian, and largest ratio of the longest to the shortest edge of a cell.

    As gmsh has them: the scaled Jacobian is the determinant by its value in the middle of the
    straight cell with the same corners, and its least value in a cell is bounded from below by the
    least of its coefficients of Bernstein polynomials.

    Parameters
    ----------
    places
        Positions of the nodes of the cells, shape (K, q, q[, q], 3), at least one cell.
    """
    dim, order = places.ndim - 2, places.shape[1] - 1
    corners = places
    for axis in range(1, dim + 1):
        corners = np.take(corners, [0, -1], axis=axis)
    steps = [np.diff(corners, axis=axis) for axis in range(1, dim + 1)]
    lengths = np.concatenate(
        [np.linalg.norm(step, axis=-1).reshape(len(places), -1) for step in steps], axis=1
    )
    middle = np.stack([s.reshape(len(places), -1, 3).mean(axis=1) for s in steps], axis=-1)
    coefficients = _determinants(np.moveaxis(places[..., :dim], [-1, 0], [0, -1]), order)
    # two corners of a cell in one place make it infinitely long
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = coefficients.min(axis=0) / np.linalg.det(middle[:, :dim])
        aspect = lengths.max(axis=1) / lengths.min(axis=1)
    return float(scaled.min()), float(aspect.max())


def _determinants(places: Floats, order: int) -> Floats:
    """Bernstein coefficients of the Jacobian's determinant, shape (coefficients, K).

    ``places`` has the coordinates first, shape (dim, q, q[, q], K).
    """
    dim = len(places)
    values, slopes, to_bernstein = _tables(order, dim)
    columns = []
    for along in range(dim):
        found = places
        for axis in range(dim):
            found = _along(slopes if axis == along else values, found, axis + 1)
        columns.append(found)
    coefficients = _determinant(columns)
    for axis in range(dim):
        coefficients = _along(to_bernstein, coefficients, axis)
    return coefficients.reshape(-1, places.shape[-1])


def _determinant(columns: Sequence[Floats]) -> Floats:
    """Of matrices with some columns, each of shape (dim, ...); `numpy.linalg.det` is slower."""
    if len(columns) == 2:
        (a, b), (c, d) = columns
        return np.asarray(a * d - b * c)
    (a, b, c), u, v = columns
    return np.asarray(
        a * (u[1] * v[2] - u[2] * v[1])
        + b * (u[2] * v[0] - u[0] * v[2])
        + c * (u[0] * v[1] - u[1] * v[0])
    )


def _along(matrix: Floats, values: Floats, axis: int) -> Floats:
    """A matrix applied along one axis of an array."""
    shape = values.shape
    flat = values.reshape(-1, shape[axis], int(np.prod(shape[axis + 1 :])))
    return np.matmul(matrix, flat).reshape(*shape[:axis], len(matrix), *shape[axis + 1 :])


@cache
def _tables(order: int, dim: int) -> tuple[Floats, Floats, Floats]:
    """Along one direction, from nodes to the points at which the determinant is taken.

    The determinant has the degree ``order * dim - 1`` in each direction.

    Returns
    -------
    values, slopes : ndarray, shape (points, nodes)
        Of the Lagrange polynomials of the nodes.
    to_bernstein : ndarray, shape (points, points)
        From values at the points to coefficients of Bernstein polynomials.
    """
    degree = order * dim - 1
    nodes, points = np.arange(order + 1) / order, np.arange(degree + 1) / max(degree, 1)
    monomials = np.linalg.inv(np.vander(nodes, increasing=True))
    powers = np.arange(1, order + 1)
    values = np.vander(points, order + 1, increasing=True) @ monomials
    slopes = (np.vander(points, order, increasing=True) * powers) @ monomials[1:]
    k = np.arange(degree + 1)
    bernstein = [comb(degree, i) * points**i * (1 - points) ** (degree - i) for i in k]
    return values, slopes, np.linalg.inv(np.stack(bernstein, axis=-1))
