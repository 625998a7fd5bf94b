"""The softest shapes at points of a branch, carried from one point to the next.

They are the eigenvectors of K v = m M v with the smallest |m|, K the tangent and M a matrix of the
products of motions.  At each point an iteration

    Y = K^-1 M V,    V^T M Y z = z/m,    V_new = Y z

of the last ones makes them those of the new tangent.  The component along v_k grows by 1/m_k, so
that a shape which is nearly neutral stands out after a single iteration.  Where several are neutral
at once, all are found.  (A Krylov method, which looks for eigenvalues that are not 0 as well, is
slow where K is singular.)  Two pseudo-random vectors take part, for shapes that become soft on the
way.  The first time all vectors are pseudo-random.  The kept factor of the solver is used.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.fields import Role
from dea_fenicsx.path.cubic import Followed, Point

CARRIED_SOLVE_TOLERANCE = 1e-2
"""Relative tolerance of the linear solves of an iteration for shapes that are looked at only.

Their errors grow by 1/m_k only along the shapes themselves.  So shapes that are nearly neutral
exceed the error by the ratio of the eigenvalues.
"""

FRESH_VECTORS = 2
"""How many pseudo-random vectors take part in an iteration."""

FIRST_ITERATIONS, ITERATIONS_AFTERWARDS = 4, 3
"""Number of iterations at the first point, and the most at a later one."""

LEAST_KEPT = 0.9
"""Least share of a shape in the space of the shapes before; below it, they are iterated again."""

SOFTER = 0.1
"""Shapes must be kept whose |m| is at most this share of the largest |m| among the carried ones."""

INDEPENDENT = 1e-13
"""Least share of a vector that the earlier ones do not explain, for it to be one of its own."""


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
    tolerance
        Relative tolerance of the linear solves.

    Attributes
    ----------
    sizes
        The |m| of the shapes that were found last, in ascending order.
    """

    def __init__(
        self, branch: Followed, count: int, tolerance: float = CARRIED_SOLVE_TOLERANCE
    ) -> None:
        self.branch, self.count, self.tolerance = branch, count, tolerance
        self.sizes = np.zeros(0)
        self._block: np.ndarray | None = None

    def at(self, point: Point) -> tuple[np.ndarray, np.ndarray] | None:
        """Shapes V at a point in the free unknowns, and M V, both of shape (n, count).  Collective.

        V^T M V = 1.  None if a linear solve fails.
        """
        with self.branch.problem.at(point.state):
            return self.here()

    def here(self) -> tuple[np.ndarray, np.ndarray] | None:
        """The same at the present state of the problem.  Collective."""
        self._block = self._carried()
        return None if self._block is None else (self._block, self._weighed(self._block))

    def _carried(self) -> np.ndarray | None:
        """The shapes at the present state from those before; None if a solve fails."""
        block = self._block
        known = block is not None
        if block is None:
            block = self._orthonormal(self._motions(self.count, 0))
        for number in range(1, 1 + (ITERATIONS_AFTERWARDS if known else FIRST_ITERATIONS)):
            old = self._weighed(block)
            found = self._iterated(block, number)
            if found is None:
                return None
            block = found
            soft = self.sizes <= SOFTER * self.sizes.max()
            kept = np.linalg.norm(self._sum(old.T @ block[:, soft]), axis=0)
            if known and np.all(kept > LEAST_KEPT):
                break
        return block

    def _iterated(self, block: np.ndarray, number: int) -> np.ndarray | None:
        """The shapes after an iteration, the softest first; None if a solve fails."""
        fresh = self._motions(FRESH_VECTORS, number)
        forces = self._weighed(self._orthonormal(np.column_stack([block, fresh])))
        columns = []
        for force in forces.T:
            found = self.branch.solver.linear_solve(force, self.tolerance)
            if found is None:
                return None
            columns.append(found)
        answers = np.stack(columns, axis=1)
        flexibility = self._sum(forces.T @ answers)
        values, turn = np.linalg.eigh((flexibility + flexibility.T) / 2)
        first = np.argsort(-np.abs(values))[: self.count]
        self.sizes = 1 / np.maximum(np.abs(values[first]), 1e-300)
        return self._orthonormal(answers @ turn[:, first])

    def _orthonormal(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors V that span the same space with V^T M V = 1; those of rounding are left out.

        By Gram and Schmidt, twice, for shapes that are neutral are much larger than all others.
        """
        found: list[np.ndarray] = []
        weighed: list[np.ndarray] = []
        for vector in vectors.T:
            before = self._size(vector, self.branch.products.times(vector))
            for _ in range(2):
                for v, w in zip(found, weighed, strict=True):
                    vector = vector - float(self._sum(w @ vector)) * v
            weight = self.branch.products.times(vector)
            size = self._size(vector, weight)
            if size > INDEPENDENT * before:
                found.append(vector / size)
                weighed.append(weight / size)
        return np.stack(found, axis=1)

    def _size(self, vector: np.ndarray, weight: np.ndarray) -> float:
        return float(np.sqrt(max(float(self._sum(vector @ weight)), 0.0)))

    def _motions(self, count: int, number: int) -> np.ndarray:
        """Pseudo-random motions, so that no symmetry of the device is orthogonal to them."""
        problem = self.branch.problem
        rng = np.random.default_rng([problem.comm.rank + 1, number])
        motion = problem.roles.free(Role.MOTION)
        found = np.zeros((len(problem.free), count))
        found[motion] = rng.standard_normal((len(motion), count))
        return found

    def _weighed(self, columns: np.ndarray) -> np.ndarray:
        """M times some columns.  Collective."""
        return np.stack([self.branch.products.times(c) for c in columns.T], axis=1)

    def _sum(self, values: np.ndarray | float) -> np.ndarray:
        comm = self.branch.problem.comm
        return np.asarray(comm.allreduce(np.asarray(values, order="C"), op=MPI.SUM))
