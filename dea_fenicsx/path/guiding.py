"""Soft shapes held while a step passes states at which they are neutral.

Where a symmetric body bifurcates, the tangent has null vectors that are orthogonal to the branch:
the shapes along which other branches leave.  Near such states the equilibrium hardly determines the
amplitudes of these shapes, and a small error of the mesh makes them large.  So we hold them: with
the shapes as columns of C, a matrix M of the products of motions, and guiding forces g as further
unknowns,

    R(x, f) + M C g = 0,     C^T M (x - x_start) = 0.

This system is regular at the bifurcation.  On a branch whose symmetry excludes the shapes, g is 0.
A mesh that has not quite this symmetry leaves forces g of the size of its error.  Behind the
bifurcations the forces are taken away, and Newton's method must find an equilibrium nearby.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.mass import in_free_unknowns, products_of_motions
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import State
from dea_fenicsx.path.cubic import Followed, Point
from dea_fenicsx.solvers.eigenpairs import eigenpairs
from dea_fenicsx.support.errors import SolverError
from dea_fenicsx.support.petsc_objects import PetscObjects

GUIDED_SOLVE_TOLERANCE = 1e-8
"""Relative tolerance of the linear solves for the responses to the guiding forces."""


class Products:
    """The matrix M of int u . v dX in the free unknowns, which weighs shapes.  Collective.

    It has the symmetries of the body, which a sum over nodes has not.

    Parameters
    ----------
    problem
        The problem.
    """

    def __init__(self, problem: Problem) -> None:
        self._petsc = PetscObjects(problem.comm)
        whole = products_of_motions(problem.scene, problem.space)
        self.matrix = in_free_unknowns(whole, problem.free, problem.expansion)
        whole.destroy()
        self._petsc.keep("products", self.matrix)

    def times(self, vector: np.ndarray) -> np.ndarray:
        """M times a vector of the free unknowns (owned).  Collective."""
        x, y = self.matrix.createVecs()
        x.array[:] = vector
        self.matrix.mult(x, y)
        found = np.asarray(y.array_r.copy())
        x.destroy()
        y.destroy()
        return found


class Guide:
    """Holds some shapes of the motion at the amplitudes that they have at a point of a branch.

    Parameters
    ----------
    branch
        The branch.
    start
        The point.
    shapes
        Shapes v in the free unknowns (owned), of shape (n, k), with v . M v = 1.
    weighed
        M times these shapes.  The guiding forces are multiples of these vectors.
    """

    def __init__(
        self, branch: Followed, start: Point, shapes: np.ndarray, weighed: np.ndarray
    ) -> None:
        self.branch, self.problem = branch, branch.problem
        self.shapes, self.weighed = shapes, weighed
        self.start = start
        self.release()

    @classmethod
    def across(cls, branch: Followed, back: Point, start: Point, count: int) -> Guide | None:
        """Hold the softest shapes at a point, but not the branch's own direction.  Collective.

        That direction is the chord from an earlier point.  The tangent at the point itself may have
        turned towards another branch.  (Each soft shape by itself may be a mixture, where
        eigenvalues are close.)

        Parameters
        ----------
        branch, back, start
            The branch, the earlier point, and the point.
        count
            How many eigenpairs of the tangent are looked at.

        Returns
        -------
        Guide or None
            None if there are no such shapes, or if they cannot be found.
        """
        problem, products = branch.problem, branch.products
        with problem.at(start.state):
            try:
                pairs = eigenpairs(branch.solver, count, products.matrix)
            except SolverError:
                return None
        if not pairs:
            return None
        shapes = np.stack([pair.vector for pair in pairs], axis=1)
        weighed = np.stack([products.times(shape) for shape in shapes.T], axis=1)
        guide = cls.beside(branch, back, start, shapes, weighed)
        straight = None if guide is None else branch.point(start.state, start, guide=guide)
        if guide is None or straight is None:
            return None
        guide.start = straight
        return guide

    @classmethod
    def beside(
        cls, branch: Followed, back: Point, start: Point, shapes: np.ndarray, weighed: np.ndarray
    ) -> Guide | None:
        """Hold given shapes at a point, but not the direction of the chord from an earlier one.

        None if the chord has no part along them, or if there is one shape only.  Collective.
        """
        chord = (start.state.values - back.state.values)[branch.problem.free]
        along = np.asarray(branch.problem.comm.allreduce(weighed.T @ chord, op=MPI.SUM))
        size = np.linalg.norm(along)
        if size == 0 or shapes.shape[1] == 1:
            return None
        # The first row of the orthogonal matrix lies along the chord, the others across it.
        across = np.linalg.svd(along[None] / size)[2][1:].T
        return cls(branch, start, shapes @ across, weighed @ across)

    def release(self) -> None:
        """Begin a new solve, without guiding forces."""
        self.forces = np.zeros(self.shapes.shape[1])

    def held(self, state: State) -> State:
        """A state with the amplitudes of the start.  Collective."""
        return self.problem.moved(state, -(self.shapes @ self.amplitudes(state)))

    def others(self, moved: np.ndarray) -> np.ndarray:
        """A motion in the free unknowns without the held shapes.  Collective."""
        return moved - self.part(moved)

    def part(self, moved: np.ndarray) -> np.ndarray:
        """The part of a motion in the free unknowns along the held shapes.  Collective."""
        return np.asarray(self.shapes @ self._sum(self.weighed.T @ moved))

    def amplitudes(self, state: State) -> np.ndarray:
        """Changes of the amplitudes from the start to a state, shape (k,).  Collective."""
        moved = (state.values - self.start.state.values)[self.problem.free]
        return self._sum(self.weighed.T @ moved)

    def balanced(self, residual: np.ndarray) -> np.ndarray:
        """The residual at all owned degrees of freedom, with the guiding forces."""
        found = residual.copy()
        found[self.problem.free] += self.weighed @ self.forces
        return found

    def unbalanced(self, rows: np.ndarray) -> np.ndarray:
        """Unbalanced forces in the free rows, with the guiding forces."""
        return rows + self.weighed @ self.forces

    def responses(self) -> np.ndarray | None:
        """Answers of the free unknowns to a unit of each guiding force; None if a solve fails."""
        columns = []
        for force in self.weighed.T:
            found = self.branch.solver.linear_solve(force, GUIDED_SOLVE_TOLERANCE)
            if found is None:
                return None
            columns.append(found)
        return np.stack(columns, axis=1)

    def along(self, response: np.ndarray, answers: np.ndarray) -> np.ndarray:
        """A response dx/df while the shapes are held."""
        system = self._sum(self.weighed.T @ np.column_stack([answers, response]))
        return response - answers @ np.linalg.solve(system[:, :-1], system[:, -1])

    def increment(
        self, r: np.ndarray, b: np.ndarray, answers: np.ndarray, plane: Point
    ) -> tuple[np.ndarray, float]:
        """Newton's increment of the free unknowns and of the load, normal to a point's tangent.

        Parameters
        ----------
        r
            Response to the unbalanced forces, those of the guides among them.
        b
            Response to the load.
        answers
            As of `responses`.
        plane
            The point.
        """
        branch, k = self.branch, self.shapes.shape[1]
        # Column by column: the guiding forces, the load, and what is known.
        columns = np.column_stack([-answers, b, -r])
        loads = np.zeros(k + 2)
        loads[k] = 1.0
        system = np.empty((k + 1, k + 2))
        system[:k] = self._sum(self.weighed.T @ columns)
        for j, (column, load) in enumerate(zip(columns.T, loads, strict=True)):
            system[k, j] = branch.dot(column, load, plane.direction, plane.slope)
        found = np.linalg.solve(system[:, :-1], system[:, -1])
        self.forces = self.forces + found[:k]
        return r + columns[:, : k + 1] @ found, float(found[k])

    def _sum(self, values: np.ndarray) -> np.ndarray:
        return np.asarray(
            self.problem.comm.allreduce(np.ascontiguousarray(values), op=MPI.SUM)
        )
