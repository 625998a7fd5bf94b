"""Values within cells of expressions that may depend on the history at quadrature points."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from dea_fenicsx.model.kernels import Kernel
from dea_fenicsx.support import compat


def evaluated_at(
    expression: Any, kernel: Kernel, at: np.ndarray, quadrature: np.ndarray
) -> Callable[[Any, np.ndarray], np.ndarray]:
    """How to evaluate a vector-valued expression of a kernel at one point of each cell.

    The history of viscous branches and of damage is known at the quadrature points alone.  With one
    the expression is evaluated there, and the polynomial of degree 1 that fits these values best
    gives the value at the point, with an error of the second order in the cell's size.

    Parameters
    ----------
    expression
        What is evaluated.
    kernel
        The regions on which it lives.
    at
        The point in the reference cell, of shape (dim,).
    quadrature
        Quadrature points of the reference cell, of shape (points, dim).

    Returns
    -------
    callable
        Takes the mesh and local cells; gives values of shape (cells, numbers).
    """
    numbers = expression.ufl_shape[0]
    if not kernel.has_history:
        found = compat.expression(expression, at[None, :])
        return lambda mesh, cells: np.asarray(found(mesh, cells)).reshape(len(cells), numbers)
    everywhere = compat.expression(expression, quadrature)
    terms = np.hstack([np.ones((len(quadrature), 1)), quadrature - at])
    weights = np.linalg.pinv(terms)[0]

    def value(mesh: Any, cells: np.ndarray) -> np.ndarray:
        if len(cells) == 0:
            return np.zeros((0, numbers))
        return np.einsum("q,cqn->cn", weights, everywhere(mesh, cells))

    return value


def evaluated_within(
    expression: Any, kernel: Kernel, middle: np.ndarray, points: np.ndarray, quadrature: np.ndarray
) -> Callable[[Any, np.ndarray], np.ndarray]:
    """How to evaluate a vector-valued expression of a kernel at the middle and at other points.

    All points are compiled at once.  For viscous branches the middle follows the rule of
    `evaluated_at`.  The other points get the values of the polynomial of `linear_terms` that fits
    those at the quadrature points best.

    Parameters
    ----------
    expression, kernel, quadrature
        As in `evaluated_at`.
    middle
        The middle of the reference cell, of shape (dim,).
    points
        The other points, of shape (n, dim).

    Returns
    -------
    callable
        Takes the mesh and local cells; gives values of shape (cells, 1 + n, numbers).
    """
    numbers = expression.ufl_shape[0]
    if not kernel.has_history:
        return compat.expression(expression, np.vstack([middle[None, :], points]))
    everywhere = compat.expression(expression, quadrature)
    terms = np.hstack([np.ones((len(quadrature), 1)), quadrature - middle])
    tensor = len(points) == 2 ** points.shape[1]
    fit = linear_terms(points, tensor) @ np.linalg.pinv(linear_terms(quadrature, tensor))
    weights = np.vstack([np.linalg.pinv(terms)[0], fit])

    def values(mesh: Any, cells: np.ndarray) -> np.ndarray:
        if len(cells) == 0:
            return np.zeros((0, len(weights), numbers))
        return np.einsum("pq,cqn->cpn", weights, everywhere(mesh, cells))

    return values


def linear_terms(places: np.ndarray, tensor: bool) -> np.ndarray:
    """The terms of a polynomial of degree 1 at some places of a reference cell.

    Parameters
    ----------
    places
        The places, of shape (n, dim).
    tensor
        Whether the polynomial has degree 1 in each direction, as on quadrilaterals and hexahedra,
        with terms such as x y; else it has degree 1 in all directions together.

    Returns
    -------
    ndarray of shape (n, terms)
    """
    if not tensor:
        return np.hstack([np.ones((len(places), 1)), places])
    found = np.ones((len(places), 1))
    for x in places.T:
        found = np.hstack([found, found * x[:, None]])
    return found


def evaluated_at_each(
    expression: Any, kernel: Kernel, points: np.ndarray, quadrature: np.ndarray
) -> Callable[[Any, np.ndarray, np.ndarray], np.ndarray]:
    """How to evaluate a vector-valued expression of a kernel at one of several points of each cell.

    All points are compiled at once.  For viscous branches the rule of `evaluated_at` holds.

    Parameters
    ----------
    expression, kernel, quadrature
        As in `evaluated_at`.
    points
        The points in the reference cell, of shape (n, dim).

    Returns
    -------
    callable
        Takes the mesh, local cells, and for each cell the number of its point; gives values of
        shape (cells, numbers).
    """
    numbers = expression.ufl_shape[0]
    if not kernel.has_history:
        found = compat.expression(expression, points)

        def at_once(mesh: Any, cells: np.ndarray, which: np.ndarray) -> np.ndarray:
            return found(mesh, cells)[np.arange(len(cells)), which].reshape(len(cells), numbers)

        return at_once
    everywhere = compat.expression(expression, quadrature)
    terms = (np.hstack([np.ones((len(quadrature), 1)), quadrature - at]) for at in points)
    weights = np.array([np.linalg.pinv(one)[0] for one in terms])

    def fitted(mesh: Any, cells: np.ndarray, which: np.ndarray) -> np.ndarray:
        return np.einsum("cq,cqn->cn", weights[which], everywhere(mesh, cells))

    return fitted
