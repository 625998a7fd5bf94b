"""The state in which a motion starts: its acceleration, pressure and potential.

Displacement u and velocity v are given, and the load may have jumped.  What follows them at once is

    M a + f(u, p, phi) + M d v = 0      the equation of motion, with drag d,
    B a + (d2/ds2) g(u + s v) = 0       the second time derivative of det F = 1,
    the electric equations at u         and p = kappa (J - 1) in a region with a bulk modulus,

linear in a, p and phi.  Without the second equation, an acceleration that does not keep the volume
would start an oscillation of the pressure.

Two more conditions bind places alone: a point that is pressed stays on its obstacle (and sticks, if
its friction suffices), and the cells of the air follow the body.  Their rows take the acceleration
in the same way, B a = 0.  What their own curvature adds along a velocity is left out there.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.motion import MOTION, Motion
from dea_fenicsx.model.state import State
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.tangent import scalar_masses
from dea_fenicsx.solvers.unsymmetric import by_lu
from dea_fenicsx.support.compat import PETSc, dolfinx
from dea_fenicsx.support.errors import SolverError
from dea_fenicsx.support.exchange import Exchange

START_COMPRESSIBILITY = 1e-12
"""Compressibility mu/kappa that determines a pressure which nothing else does."""

BOUND_SOFTNESS = 1e-6
"""Softness of the rows that bind accelerations, as a share of one over the density.

Where a surface of an incompressible body is pressed and sticks, its pressures and tractions nearly
depend on each other.  With a smaller value rounding errors of the state then change the
acceleration.  Each further correction multiplies the error of this softness by about its own value.
"""

VOLUME_DIFFERENCE = 0.05
"""Largest displacement by which the second derivative of the volume is taken, over L."""

CORRECTION_TOLERANCE = 1e-12
"""The correction ends when pressure and potential, dimensionless, change by less than this."""

NO_ENTRY = 1e-11
"""Entries of a row below this share of its entries for displacements are rounding errors."""

MOST_CORRECTIONS = 3
"""Largest number of solves.  One is enough unless a dielectric is not linear in the field."""


class Start:
    """The start of a motion in the present displacement of a problem.

    Parameters
    ----------
    solver
        The solver.
    drag
        d in 1/s.
    """

    def __init__(self, solver: NewtonSolver, drag: float) -> None:
        self.solver, self.problem, self.drag = solver, solver.problem, drag
        self.mass = self.problem.massive()
        self.moves = self.mass.moving(self.problem.free, self.problem.expansion)

    def consistent(
        self, state: State, velocity: np.ndarray, driven: np.ndarray | None = None,
        corrected: bool = True,
    ) -> State:  # fmt: skip
        """The state with the acceleration, pressure and potential that follow.  Collective.

        Parameters
        ----------
        state
            Displacement, load and history; pressure and potential are a first guess.
        velocity
            Rates of all local values in 1/s, 0 but for the displacement.
        driven
            Acceleration in 1/s^2 that is known of all local values: at fixed displacements, and the
            known part of it at nodes of rigid parts.  None for 0.
        corrected
            Whether an impulse of the pressure corrects a velocity that does not keep the volume.
        """
        problem = self.problem
        still = {k: v for k, v in state.history.items() if k != MOTION}
        state = replace(problem.imposed(state), history=still)
        given = np.zeros(problem.size) if driven is None else driven
        with problem.at(state):
            matrix, kept = self._matrix()
        ksp = by_lu(matrix, kept)
        x, b = matrix.createVecs()
        if corrected:
            velocity = self._kept_volume(state, velocity, kept, (ksp, x, b))
        centripetal = self._second_volume(state, velocity)
        acceleration = np.zeros(problem.size)
        for _ in range(MOST_CORRECTIONS):
            with problem.at(state):
                unbalanced = problem.unbalanced(problem.residual())
                dragged = self.mass.times((given + self.drag * velocity)[: problem.owned])
                rows = -unbalanced - problem.restrict(dragged)
                carried = self.solver.tangent.times_values(given)
                rows[kept] = -(centripetal + carried)[kept]
                b.array[:] = rows
                ksp.solve(b, x)
                change = x.array_r.copy()
                acceleration, state = self._parted(state, change, given)
            if self._others(change) <= CORRECTION_TOLERANCE:
                break
        for thing in (ksp, x, b, matrix):
            thing.destroy()
        finite = bool(np.isfinite(acceleration).all())
        if not problem.comm.allreduce(finite, op=MPI.LAND):
            raise SolverError("The acceleration at the start of a motion cannot be found.")
        motion = Motion(velocity, acceleration, acceleration).settled(self.drag)
        return replace(state, history={**still, MOTION: motion})

    def _kept_volume(
        self, state: State, velocity: np.ndarray, kept: np.ndarray, system: tuple[Any, Any, Any]
    ) -> np.ndarray:
        """The velocity after the impulse of the pressure that lets it keep the volume.  Collective.

        M (v - v0) + B^T q = 0 and B v = 0, with the velocity v0 before.  Where a prescribed
        displacement starts with a velocity of its own, the body has to follow at once.
        """
        ksp, x, b = system
        with self.problem.at(state):
            b.array[:] = 0.0
            b.array[kept] = -self.solver.tangent.times_values(velocity)[kept]
        ksp.solve(b, x)
        moved, found = np.zeros(len(b.array_r)), self.problem.w.copy()
        moved[self.moves] = x.array_r[self.moves]
        with self.problem.at(state):
            self.problem.spread(moved, found)
        return np.asarray(velocity + found.x.array)

    def _parted(
        self, state: State, change: np.ndarray, given: np.ndarray
    ) -> tuple[np.ndarray, State]:
        """The acceleration, and the state with the changes of the other fields.  Collective."""
        problem = self.problem
        moved, others = np.zeros_like(change), change.copy()
        moved[self.moves] = change[self.moves]
        others[self.moves] = 0.0
        found = problem.w.copy()
        problem.spread(moved, found)
        return found.x.array + given, problem.moved(state, others)

    def _others(self, change: np.ndarray) -> float:
        """Largest change of the fields that do not move.  Collective."""
        largest = float(np.max(np.abs(np.delete(change, self.moves)), initial=0.0))
        return float(self.problem.comm.allreduce(largest, op=MPI.MAX))

    def _matrix(self) -> tuple[Any, np.ndarray]:
        """The matrix of the equations, and the rows that bind accelerations."""
        problem = self.problem
        self.mass.rest()
        stiff = self.solver.tangent.matrix()
        offsets, columns, values = stiff.getValuesCSR()
        values = values.copy()
        moving = self._moving(stiff, columns)
        row = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
        by_place = self._rows_by_place(row, np.abs(values), moving)
        kept = np.union1d(self._incompressible_rows(), by_place)
        holds = np.zeros(len(offsets) - 1, dtype=bool)
        holds[kept] = True
        values[moving & ~holds[row]] = 0.0
        n = (len(problem.free), None)
        matrix = PETSc.Mat().createAIJ((n, n), csr=(offsets, columns, values), comm=problem.comm)
        heavy = self.mass.reduced(problem.free, problem.expansion)
        matrix.axpy(1.0, heavy, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        diagonal = heavy.getDiagonal()
        heavy.destroy()
        diagonal.array[:] = -self._softness(kept, diagonal.max()[1])
        diagonal.array[self.moves] = 0.0
        matrix.setDiagonal(diagonal, PETSc.InsertMode.ADD)
        diagonal.destroy()
        self.solver.forget_factor()
        return matrix, kept

    def _moving(self, stiff: Any, columns: np.ndarray) -> np.ndarray:
        """Whether columns of the tangent are for displacements that move.  Collective.

        A column is asked for at the rank that owns its row.
        """
        ranges = np.asarray(stiff.getOwnershipRanges())
        first, last = stiff.getOwnershipRange()
        mine = np.zeros(last - first, dtype=bool)
        mine[self.moves] = True
        known, places = np.unique(columns, return_inverse=True)
        asked = Exchange(self.problem.comm, np.searchsorted(ranges, known, "right") - 1)
        return asked.answer(mine[asked.forward(known) - first])[places]

    def _softness(self, kept: np.ndarray, heaviest: float) -> np.ndarray:
        """What is added to the diagonal of the fields that do not move.  Collective.

        `heaviest` is the largest entry of the mass matrix on its diagonal.
        """
        volumes = scalar_masses(self.problem)
        mine = float(np.max(volumes, initial=0.0))
        largest = self.problem.comm.allreduce(mine, op=MPI.MAX)
        found = START_COMPRESSIBILITY * volumes
        fields = [name for contact in self.problem.forms.contacts for name in contact.fields]
        bound = np.concatenate([kept, *(self.problem.roles.of_group(f)[1] for f in fields)])
        if heaviest > 0:
            found[bound] = BOUND_SOFTNESS * largest / heaviest * volumes[bound]
        return np.asarray(found)

    def _rows_by_place(
        self, row: np.ndarray, sizes: np.ndarray, moving: np.ndarray
    ) -> np.ndarray:
        """Rows of internal fields that hold places alone, such as a gap that is closed.

        Parameters
        ----------
        row, sizes, moving
            For each entry of the tangent its row, its size, and whether it is for a displacement.
        """
        problem = self.problem
        owned = len(problem.free)
        moved = np.bincount(row[moving], sizes[moving], owned)
        other = np.bincount(row[~moving], sizes[~moving], owned)
        holds = (moved > 0) & (other <= NO_ENTRY * moved)
        places = problem.roles.free(Role.INTERNAL)
        return np.asarray(places[holds[places]])

    def _incompressible_rows(self) -> np.ndarray:
        """Places of pressures among the free unknowns that belong to no compressible cell."""
        problem, device = self.problem, self.problem.scene.device
        soft = np.zeros(problem.size)
        part = problem.pressure
        for name, material in problem.parameters.materials.items():
            if material.bulk_modulus is not None:
                dofs = part.dofs[part.space.dofmap.list[device.cells_of(name)]]
                soft[dofs.ravel()] = 1.0
        mine = problem.free[problem.roles.free(Role.MULTIPLIER)]
        rigid = problem.w.copy()
        rigid.x.array[:] = soft
        rigid.x.scatter_reverse(dolfinx.la.InsertMode.add)
        places = problem.roles.free(Role.MULTIPLIER)
        return np.asarray(places[rigid.x.array[mine] == 0])

    def _second_volume(self, state: State, velocity: np.ndarray) -> np.ndarray:
        """Second derivative of the rows of the volume along the velocity, in 1/s^2."""
        if not self.problem.comm.allreduce(bool(np.any(velocity)), op=MPI.LOR):
            return np.zeros(len(self.problem.free))
        problem = self.problem
        # J is a cubic polynomial of the displacement, so that the difference is exact.
        largest = problem.comm.allreduce(float(np.max(np.abs(velocity), initial=0.0)), op=MPI.MAX)
        step = VOLUME_DIFFERENCE / largest
        total = np.zeros(len(problem.free))
        for place, weight in ((1.0, 1.0), (0.0, -2.0), (-1.0, 1.0)):
            with problem.at(state):
                # Along a straight line, which nodes of rigid parts leave by their acceleration.
                problem.w.x.array[:] = state.values + place * step * velocity
                total += weight * problem.restrict(problem.residual())
        total[problem.roles.free(Role.INTERNAL)] = 0.0
        return total / step**2
