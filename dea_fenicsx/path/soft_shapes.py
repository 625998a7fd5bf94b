"""The softest shapes along a branch, carried from one point to the next.

They are the eigenvectors of K v = m M v with the smallest |m|, K the tangent and M a matrix of the
products of motions.  At each point an iteration

    K V_new = M V

of the last ones, and the method of Rayleigh and Ritz in their space, make them those of the new
tangent.  The component along v_k grows by 1/m_k, so that a shape which is nearly neutral stands out
after a single iteration.  Two pseudo-random vectors take part, for shapes that become soft on the
way.  The first time all vectors are pseudo-random.  The kept factor of the solver is used, and the
solves are rough: their errors grow by 1/m_k only along the shapes themselves.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from dea_fenicsx.path.cubic import Followed, Point
from dea_fenicsx.solvers.eigenpairs import ritz_values

CARRIED_SOLVE_TOLERANCE = 1e-2
"""Relative tolerance of the linear solves of an iteration.

Shapes that are nearly neutral exceed the error by the ratio of the eigenvalues.
"""

FRESH_VECTORS = 2
"""How many pseudo-random vectors take part in an iteration."""

FIRST_ITERATIONS, ITERATIONS_AFTERWARDS = 4, 3
"""Number of iterations at the first point, and the most at a later one."""

LEAST_KEPT = 0.9
"""Least share of a shape in the space of the shapes before; below it, they are iterated again."""

SOFTER = 0.1
"""Shapes must be kept whose |m| is at most this share of the largest |m| among the carried ones."""


def size(branch: Followed, motion: np.ndarray) -> float:
    """Size of a motion in the free unknowns, in units of arc.  Collective."""
    return float(np.sqrt(branch.dot(motion, 0.0, motion, 0.0)))


def stiffness(branch: Followed, shapes: np.ndarray, point: Point) -> np.ndarray:
    """C^T K C with the tangent K at a point, of shapes C of shape (n, k).  Collective."""
    with branch.problem.at(point.state):
        carried = [branch.solver.tangent.times(shape) for shape in shapes.T]
    own = shapes.T @ np.stack(carried, axis=1)
    return np.asarray(branch.problem.comm.allreduce(own, op=MPI.SUM))


class SoftShapes:
    """The softest shapes at points of a branch.

    Parameters
    ----------
    branch
        The branch.
    count
        How many shapes are wanted.
    """

    def __init__(self, branch: Followed, count: int) -> None:
        self.branch, self.count = branch, count
        self._block: np.ndarray | None = None

    def at(self, point: Point) -> tuple[np.ndarray, np.ndarray] | None:
        """Shapes V at a point in the free unknowns, and M V, both of shape (n, count).  Collective.

        V^T M V = 1.  None if a linear solve fails.
        """
        with self.branch.problem.at(point.state):
            self._block = self._carried()
        return None if self._block is None else (self._block, self._weighed(self._block))

    def _carried(self) -> np.ndarray | None:
        """The shapes at the present state from those before; None if a solve fails."""
        known = self._block is not None
        block = self._block if self._block is not None else self._motions(self.count, 0)
        most = ITERATIONS_AFTERWARDS if known else FIRST_ITERATIONS
        for number in range(1, most + 1):
            old = self._weighed(block)
            found = self._iterated(block, old, number)
            if found is None:
                return None
            values, block = found
            soft = np.abs(values) <= SOFTER * np.abs(values).max()
            kept = np.linalg.norm(self._sum(old.T @ block[:, soft]), axis=0)
            if known and np.all(kept > LEAST_KEPT):
                break
        return block

    def _iterated(
        self, block: np.ndarray, weighed: np.ndarray, number: int
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Eigenvalues and shapes after an iteration, the softest first; None if a solve fails."""
        forces = np.column_stack([weighed, self._fresh(block, weighed, number)])
        columns = []
        for force in forces.T:
            found = self.branch.solver.linear_solve(force, CARRIED_SOLVE_TOLERANCE)
            if found is None:
                return None
            columns.append(found)
        new = np.stack(columns, axis=1)
        products = self._weighed(new)
        sizes = np.sqrt(self._sum(np.sum(new * products, axis=0)))
        new, products, forces = new / sizes, products / sizes, forces / sizes
        stiffness, weights = self._sum(new.T @ forces), self._sum(new.T @ products)
        values, turn = ritz_values((stiffness + stiffness.T) / 2, (weights + weights.T) / 2)
        first = np.argsort(np.abs(values))[: self.count]
        return values[first], new @ turn[:, first]

    def _fresh(self, block: np.ndarray, weighed: np.ndarray, number: int) -> np.ndarray:
        """M times pseudo-random motions that are orthogonal to the shapes."""
        motions = self._motions(FRESH_VECTORS, number)
        return self._weighed(motions - block @ self._sum(weighed.T @ motions))

    def _motions(self, count: int, number: int) -> np.ndarray:
        """Pseudo-random vectors, so that no symmetry of the device is orthogonal to them."""
        rng = np.random.default_rng([self.branch.problem.comm.rank + 1, number])
        return rng.standard_normal((len(self.branch.problem.free), count))

    def _weighed(self, columns: np.ndarray) -> np.ndarray:
        """M times some columns.  Collective."""
        return np.stack([self.branch.products.times(c) for c in columns.T], axis=1)

    def _sum(self, values: np.ndarray) -> np.ndarray:
        comm = self.branch.problem.comm
        return np.asarray(comm.allreduce(np.ascontiguousarray(values), op=MPI.SUM))
