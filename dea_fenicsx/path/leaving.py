"""Where a trace leaves its branch, and along which combination of shapes.

Where several modes are neutral at once, their null vectors span a space, and a branch may leave
along any direction in it.  A computed basis of such a space is arbitrary.  We choose the vectors
that also diagonalise

    int w v_i . C v_j dX,   w = 1/(1 + 2 x^2 + 0.7 y^2 + 0.3 z^2),   C = diag(1, 0.8, 0.6),

with places x, y, z from the centre of the device, in halves of its largest extent.  These weights
are mirrored at the planes of the axes, so a symmetric body has shapes that are symmetric or
antisymmetric each, and they tell the axes apart.  The basis then depends neither on the number of
ranks nor on rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import accumulate
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.state import State
from dea_fenicsx.path.arclength import TracedBranch
from dea_fenicsx.path.cubic import Point
from dea_fenicsx.path.items import MOST_SHAPES, Trace
from dea_fenicsx.path.soft_shapes import SoftShapes
from dea_fenicsx.path.stability import CriticalEigenvalue
from dea_fenicsx.support.agreement import together
from dea_fenicsx.support.errors import InputError, SolverError

BASIS_WEIGHTS = (2.0, 0.7, 0.3)
"""Factors of the squares of x, y and z in the weight that makes a basis definite."""

COMPONENTS = (1.0, 0.8, 0.6)
"""Factors C of the components of the shapes."""

NEUTRAL = 1e-6
"""Largest eigenvalue of a null vector, as a share of the largest one among the softest shapes."""

MODE_SOLVE_TOLERANCE = 1e-10
"""Relative tolerance of their linear solves."""


def null_shapes(branch: TracedBranch, state: State) -> np.ndarray:
    """The null vectors of a critical state on a branch.  Collective.

    Returns
    -------
    ndarray
        They in the free unknowns (owned), in the order of their weights, the largest first; shape
        (n, k).  Their largest displacement is 1.
    """
    problem = branch.problem
    softest = SoftShapes(branch, MOST_SHAPES, MODE_SOLVE_TOLERANCE)
    with problem.at(state):
        branch.solver.refresh_inertia()
        found = softest.here()
    if found is None:
        raise SolverError("The null vectors of a bifurcation could not be computed.")
    vectors, sizes = found[0], softest.sizes
    vectors = vectors[:, sizes <= NEUTRAL * sizes.max()] if len(sizes) > 1 else vectors
    if vectors.shape[1] > 1:
        vectors = _definite(branch, vectors)
    spectrum = CriticalEigenvalue(branch.solver)
    shapes = [spectrum.as_values(v)[problem.free] for v in vectors.T]
    return np.stack(shapes, axis=1)


def _definite(branch: TracedBranch, vectors: np.ndarray) -> np.ndarray:
    """The basis of the space of some vectors that diagonalises the weight."""
    problem = branch.problem
    weight = np.zeros(problem.size)
    places = [part.space.tabulate_dof_coordinates() for part in problem.displacement]
    every = np.concatenate(places) if places else np.zeros((0, 3))
    low, high = np.empty(3), np.empty(3)
    problem.comm.Allreduce(every.min(axis=0, initial=np.inf), low, op=MPI.MIN)
    problem.comm.Allreduce(every.max(axis=0, initial=-np.inf), high, op=MPI.MAX)
    half = np.max(high - low) / 2
    for part, place, share in zip(problem.displacement, places, COMPONENTS, strict=False):
        away = (place - (low + high) / 2) / half
        weight[part.dofs] = share / (1 + away**2 @ BASIS_WEIGHTS)
    weighed = np.stack([branch.products.times(v) for v in vectors.T], axis=1)
    mine = vectors.T @ (weight[problem.free][:, None] * weighed)
    products = np.asarray(problem.comm.allreduce(mine, op=MPI.SUM))
    turn = np.linalg.eigh((products + products.T) / 2)[1][:, ::-1]
    return np.asarray(vectors @ turn)


class Exits:
    """The bifurcations at which a trace leaves its branch.

    Parameters
    ----------
    branch, item
        The branch and the trace.
    passed
        Number of bifurcations that the trace has met before.
    """

    def __init__(self, branch: TracedBranch, item: Trace, passed: int) -> None:
        self.branch, self.item, self.passed = branch, item, passed
        self._numbers = list(accumulate(item.exits))

    def taken(self, state: State, mode: np.ndarray) -> Point | None:
        """The first point of the branch that the trace takes here; None where it stays.

        Parameters
        ----------
        state, mode
            The bifurcation, and the null vector with which it was located.
        """
        self.passed += 1
        if self.passed not in self._numbers:
            return None
        last = self.passed == self._numbers[-1]
        if self.item.along is not None and last:
            mode = self._combined(state)
        return self.branch.aside(state, np.sign(self.item.switch) * mode)

    def _combined(self, state: State) -> np.ndarray:
        """The combination of null vectors that the trace is to leave along, laid out like a state.

        Collective.
        """
        problem, along = self.branch.problem, self.item.along
        shapes = null_shapes(self.branch, state)
        many = shapes.shape[1]
        if callable(along):
            shares = self._shares(along, shapes)
        else:
            shares = np.array(along, dtype=float)
        if len(shares) > many:
            raise InputError(
                f"along= of the trace in {self.item.what} has {len(shares)} shares, but only "
                f"{many} shape{' is' if many == 1 else 's are'} neutral at this bifurcation."
            )
        found = np.zeros(problem.size)
        found[problem.free] = shapes[:, : len(shares)] @ shares
        return found

    def _shares(self, along: Callable[[Any], Any], shapes: np.ndarray) -> np.ndarray:
        """The shares of null vectors in the shape that the trace is given as a function."""
        problem, products = self.branch.problem, self.branch.products
        given = np.zeros(problem.size)

        def displacements() -> None:
            for axis, part in enumerate(problem.displacement):
                places = problem.scales.length * part.space.tabulate_dof_coordinates().T
                values = np.asarray(along(places), dtype=np.float64)
                if values.ndim != 2 or values.shape[1] != places.shape[1] or axis >= len(values):
                    raise InputError(
                        f"along= of the trace in {self.item.what} gives numbers of shape "
                        f"{values.shape}, but must give one for each axis and place, shape "
                        "(axes, n)."
                    )
                given[part.dofs] = values[axis]

        together(problem.comm, displacements, f"along= of the trace in {self.item.what}")
        motion = problem.roles.free(Role.MOTION)
        like = np.zeros(len(problem.free))
        like[motion] = given[problem.free[motion]]
        weighed = np.stack([products.times(v) for v in shapes.T], axis=1)
        sums = np.column_stack([weighed.T @ shapes, weighed.T @ like])
        system = np.asarray(problem.comm.allreduce(sums, op=MPI.SUM))
        shares = np.linalg.solve(system[:, :-1], system[:, -1])
        if not np.any(np.abs(shares) > 1e-9 * np.max(np.abs(given), initial=1e-300)):
            raise InputError(
                f"along= of the trace in {self.item.what} has no part in the null vectors of the "
                "bifurcation where the trace is to leave; give another shape."
            )
        return np.asarray(shares)
