"""The scenes in motion as a plain FEniCSx script of the usual kind.

Displacement and potential of degree 2, a continuous pressure of degree 1 that keeps the volume,
trapezoidal Newmark, viscous strains at the quadrature points with backward Euler, fixed steps, LU
by MUMPS in each Newton step.

The energy is a function of C itself, and not of its isochoric part, as in this package.  On a
coarse mesh, where J is 1 in the mean alone, both differ.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.support.compat import PETSc, basix, create_vector, dolfinx
from tests.peers.motion_scenes import DEGREE, DENSITY, MotionCase, beam

G, LIMIT, EPS = 15.36e3, 5.99, 4.8 * EPSILON_0


def solve(case: MotionCase) -> dict[str, Any]:
    """March to the end, and tell the motion of the point that is seen."""
    device = case.device(MPI.COMM_WORLD)
    # the mesh with its groups alone; coordinates are in units of `length`, stresses in those of G
    mesh, length, h = device.mesh, device.length, case.seconds / case.steps
    cell = mesh.topology.cell_name()
    W = dolfinx.fem.functionspace(mesh, basix.ufl.mixed_element([
        basix.ufl.element("Lagrange", cell, 2, shape=(3,)),
        basix.ufl.element("Lagrange", cell, 1), basix.ufl.element("Lagrange", cell, 2),
    ]))  # fmt: skip
    V, to_w = W.sub(0).collapse()
    to_w = np.ravel(to_w)
    w = dolfinx.fem.Function(W)
    before, velocity, acceleration = (dolfinx.fem.Function(V) for _ in range(3))
    residual, past, new = _equations(W, w, (before, velocity, acceleration), h, length)
    fixed, raised = _fixed(case, device, W)
    bound = dolfinx.fem.Function(W)
    bcs = [dolfinx.fem.dirichletbc(bound, fixed)]
    points = basix.make_quadrature(getattr(basix.CellType, cell), DEGREE)[0]
    updates = [dolfinx.fem.Expression(c, points) for c in new]
    cells = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
    for function in past:
        function.x.array.reshape(-1, 9)[:] = np.eye(3).ravel()
    seen = _dof_at(W.sub(0).sub("xyz".index(case.axis)), np.array(case.seen) / length)
    solver, newton, time, value = _Solver(mesh.comm, residual, w, bcs), 0, [0.0], [0.0]
    volts = case.volts / (length * np.sqrt(G / EPS))
    for k in range(1, case.steps + 1):
        bound.x.array[fixed] = raised * volts * case.drive(k * h)
        newton += solver.newton(w)
        for function, expression in zip(past, updates, strict=True):
            found = np.asarray(expression.eval(mesh, cells)).ravel()
            function.x.array[: len(found)] = found
        u, a = w.x.array[to_w], acceleration.x.array
        moved = (u - before.x.array - h * velocity.x.array) * 4 / h**2 - a
        velocity.x.array[:] += h / 2 * (a + moved)
        acceleration.x.array[:] = moved
        before.x.array[:] = u
        there = float(w.x.array[seen[0]]) if len(seen) else -np.inf
        time.append(k * h)
        value.append(mesh.comm.allreduce(there, op=MPI.MAX) * length)
    index_map = W.dofmap.index_map
    held = mesh.comm.allreduce(int(np.count_nonzero(fixed < index_map.size_local)))
    return {
        "unknowns": index_map.size_global - held, "newton": newton, "factorisations": newton,
        "time": time, "history": value,
    }  # fmt: skip


def _equations(W: Any, w: Any, motion: Any, h: float, length: float) -> tuple[Any, Any, Any]:
    """The residual, the viscous strains, and their new values."""
    mesh, (before, velocity, acceleration) = W.mesh, motion
    step = dolfinx.fem.Constant(mesh, h)
    u, p, phi = ufl.split(w)
    F = ufl.Identity(3) + ufl.grad(u)
    J, C = ufl.det(F), F.T * F
    element = basix.ufl.quadrature_element(
        mesh.topology.cell_name(), value_shape=(3, 3), degree=DEGREE
    )
    Q = dolfinx.fem.functionspace(mesh, element)
    past, new = [dolfinx.fem.Function(Q) for _ in beam.BRANCHES], []
    # network of Arruda and Boyce in Cohen's form, by its energy
    z = ufl.sqrt(ufl.tr(C) / 3) / LIMIT
    energy = LIMIT**2 * (z**2 / 2 - ufl.ln(1 - z**2)) + p * (J - 1)
    # so that the undeformed body has no pressure
    rest = 1 / LIMIT**2
    energy -= ((3 - rest) / (3 * (1 - rest)) + sum(mu for mu, _ in beam.BRANCHES) / G) * ufl.ln(J)
    for (mu, tau), old in zip(beam.BRANCHES, past, strict=True):
        moved = old + step / tau * C
        new.append(ufl.det(moved) ** (-1 / 3) * moved)
        energy += 3 * mu / (2 * G) * tau / step * ufl.det(moved) ** (1 / 3)
    pulled = ufl.dot(ufl.inv(F).T, ufl.grad(phi))
    energy -= J / 2 * ufl.dot(pulled, pulled)
    dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": DEGREE})
    test = ufl.TestFunction(W)
    a = 4 * (u - before - step * velocity) / step**2 - acceleration
    heavy = dolfinx.fem.Constant(mesh, DENSITY * length**2 / G)
    residual = ufl.derivative(energy * dx, w, test)
    return residual + heavy * ufl.inner(a, ufl.split(test)[0]) * dx, past, new


def _fixed(case: MotionCase, device: dea.Device, W: Any) -> tuple[np.ndarray, np.ndarray]:
    """Fixed degrees of freedom, and which of them carry the voltage."""
    device.mesh.topology.create_connectivity(2, 3)
    index_map = W.dofmap.index_map
    values = np.full(index_map.size_local + index_map.num_ghosts, np.nan)

    def set_to(space: Any, name: str, value: float) -> None:
        values[dolfinx.fem.locate_dofs_topological(space, 2, device.facets_of(name))] = value

    for name in case.grounds:
        set_to(W.sub(2), name, 0.0)
    set_to(W.sub(2), case.driven, 1.0)
    set_to(W.sub(0), case.clamped, 0.0)
    fixed = np.flatnonzero(~np.isnan(values)).astype(np.int32)
    return fixed, values[fixed]


def _dof_at(space: Any, point: np.ndarray) -> np.ndarray:
    """The degree of freedom at a node, where this rank has it."""
    V, _ = space.collapse()
    return dolfinx.fem.locate_dofs_geometrical(
        (space, V), lambda x: np.linalg.norm(x.T - point, axis=1) < 1e-9
    )[0]


class _Solver:
    """Newton's method with full steps and MUMPS."""

    def __init__(self, comm: MPI.Comm, residual: Any, w: Any, bcs: Any) -> None:
        self.form, self.bcs = dolfinx.fem.form(residual), bcs
        trial = ufl.TrialFunction(w.function_space)
        self.tangent = dolfinx.fem.form(ufl.derivative(residual, w, trial))
        self.A, self.b = dolfinx.fem.petsc.create_matrix(self.tangent), create_vector(self.form)
        self.step = self.b.duplicate()
        self.ksp = PETSc.KSP().create(comm)
        self.ksp.setOperators(self.A)
        self.ksp.setType("preonly")
        self.ksp.getPC().setType("lu")
        self.ksp.getPC().setFactorSolverType("mumps")

    def newton(self, w: Any) -> int:
        """The number of iterations."""
        petsc, b = dolfinx.fem.petsc, self.b
        for taken in range(1, 26):
            self.A.zeroEntries()
            petsc.assemble_matrix(self.A, self.tangent, bcs=self.bcs)
            self.A.assemble()
            with b.localForm() as local:
                local.set(0.0)
            petsc.assemble_vector(b, self.form)
            petsc.apply_lifting(b, [self.tangent], bcs=[self.bcs], x0=[w.x.petsc_vec], alpha=-1.0)
            b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
            petsc.set_bc(b, self.bcs, w.x.petsc_vec, -1.0)
            self.ksp.solve(b, self.step)
            w.x.petsc_vec.axpy(-1.0, self.step)
            w.x.scatter_forward()
            size = self.step.norm()
            if not np.isfinite(size):
                break
            if size < 1e-8 * max(w.x.petsc_vec.norm(), 1e-12):
                return taken
        raise RuntimeError("Newton's method failed")
