"""The scenes in time as a plain FEniCSx script of the usual kind.

Displacement and potential of degree 2, a penalty for the change of volume, viscous strains at the
quadrature points with backward Euler, fixed steps, LU by MUMPS in each Newton step.  It ends where
a step does not converge.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.support.compat import PETSc, basix, create_vector, dolfinx
from tests.peers.time_scenes import BRANCHES, LIMIT, G, TimeCase

PENALTY = 1000.0
"""Bulk modulus over G."""

DEGREE = 4
"""Of the quadrature."""


def solve(case: TimeCase, budget_s: float = math.inf) -> dict[str, Any]:
    """Step until the field is there, a step does not converge, or so much CPU time is spent."""
    begin = time.process_time()
    # the mesh with its groups alone; coordinates are in units of `length`
    device = dea.read_gmsh(case.geometry, MPI.COMM_WORLD)
    mesh, length = device.mesh, device.length
    cell = mesh.topology.cell_name()
    W = dolfinx.fem.functionspace(mesh, basix.ufl.mixed_element([
        basix.ufl.element("Lagrange", cell, 2, shape=(3,)), basix.ufl.element("Lagrange", cell, 2),
    ]))  # fmt: skip
    w = dolfinx.fem.Function(W)
    u, phi = ufl.split(w)
    F = ufl.Identity(3) + ufl.grad(u)
    J, C = ufl.det(F), F.T * F
    Cbar = J ** (-2 / 3) * C
    element = basix.ufl.quadrature_element(cell, value_shape=(3, 3), degree=DEGREE)
    Q = dolfinx.fem.functionspace(mesh, element)
    past = [dolfinx.fem.Function(Q) for _ in BRANCHES]
    dt = dolfinx.fem.Constant(mesh, case.field / case.rate / case.steps)  # no form of its own
    new = []
    # network of Arruda and Boyce in Cohen's form, by its energy
    z = ufl.sqrt(ufl.tr(Cbar) / 3) / LIMIT
    energy = LIMIT**2 * (z**2 / 2 - ufl.ln(1 - z**2)) + PENALTY / 2 * (J - 1) ** 2
    for (mu, tau), old in zip(BRANCHES, past, strict=True):
        moved = old + dt / tau * Cbar
        new.append(ufl.det(moved) ** (-1 / 3) * moved)
        energy += 3 * mu / (2 * G) * tau / dt * ufl.det(moved) ** (1 / 3)
    pulled = ufl.dot(ufl.inv(F).T, ufl.grad(phi))
    energy -= J / 2 * ufl.dot(pulled, pulled)
    dx = ufl.dx(metadata={"quadrature_degree": DEGREE})
    residual = ufl.derivative(energy * dx, w, ufl.TestFunction(W))
    form = dolfinx.fem.form(residual)
    tangent = dolfinx.fem.form(ufl.derivative(residual, w, ufl.TrialFunction(W)))

    points = basix.make_quadrature(getattr(basix.CellType, cell), DEGREE)[0]
    updates = [dolfinx.fem.Expression(c, points) for c in new]
    cells = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
    for function in past:
        function.x.array.reshape(-1, 9)[:] = np.eye(3).ravel()
    fixed, raised = _fixed(case, device, W)
    bound = dolfinx.fem.Function(W)
    bcs = [dolfinx.fem.dirichletbc(bound, fixed)]
    A, b = dolfinx.fem.petsc.create_matrix(tangent), create_vector(form)
    ksp = PETSc.KSP().create(mesh.comm)
    ksp.setOperators(A)
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    ksp.getPC().setFactorSolverType("mumps")
    step_, spent, newton = b.duplicate(), {"assembly_s": 0.0, "solve_s": 0.0}, 0
    seen, done, field, kept = _dof_at(W, np.array(case.seen) / length), 0, 0.0, 0.0
    # the potential's unit is the one in which the energy is in units of G
    nominal = case.thickness / length
    end = "the field asked for"
    for k in range(1, case.steps + 1):
        bound.x.array[fixed] = raised * case.field * k / case.steps * nominal
        taken = _newton(w, b, A, ksp, step_, (form, tangent, bcs), spent)
        newton += taken
        if taken == 0 or not np.all(np.isfinite(w.x.array)):
            end = ""
            break
        values = [e.eval(mesh, cells) for e in updates]
        for function, value in zip(past, values, strict=True):
            function.x.array[:] = np.asarray(value).ravel()
        done, field, kept = k, case.field * k / case.steps, float(w.x.array[seen] * length)
        if time.process_time() - begin > budget_s:
            end = "the time allowed"
            break
    return {
        "field": field, "value": kept,
        "end": end or f"Newton's method failed in step {done + 1}",
        "unknowns": W.dofmap.index_map.size_global * W.dofmap.index_map_bs - len(fixed),
        "steps": done, "newton": newton, "factorisations": newton, **spent,
    }  # fmt: skip


def _newton(w: Any, b: Any, A: Any, ksp: Any, step: Any, forms: Any, spent: dict) -> int:
    """Newton's method with full steps; the number of iterations, or 0 if it fails."""
    form, tangent, bcs = forms
    before = w.x.array.copy()
    for taken in range(1, 26):
        start = time.perf_counter()
        A.zeroEntries()
        dolfinx.fem.petsc.assemble_matrix(A, tangent, bcs=bcs)
        A.assemble()
        with b.localForm() as local:
            local.set(0.0)
        dolfinx.fem.petsc.assemble_vector(b, form)
        dolfinx.fem.petsc.apply_lifting(b, [tangent], bcs=[bcs], x0=[w.x.petsc_vec], alpha=-1.0)
        b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        dolfinx.fem.petsc.set_bc(b, bcs, w.x.petsc_vec, -1.0)
        now = time.perf_counter()
        spent["assembly_s"] += now - start
        ksp.solve(b, step)
        spent["solve_s"] += time.perf_counter() - now
        size = step.norm()
        if not np.isfinite(size):
            break
        w.x.petsc_vec.axpy(-1.0, step)
        w.x.scatter_forward()
        if size < 1e-8 * max(w.x.petsc_vec.norm(), 1e-12):
            return taken
    w.x.array[:] = before
    return 0


def _fixed(case: TimeCase, device: Any, W: Any) -> tuple[np.ndarray, np.ndarray]:
    """Fixed degrees of freedom, and which of them carry the voltage."""
    mesh = device.mesh
    mesh.topology.create_connectivity(2, 3)
    locate = dolfinx.fem.locate_dofs_topological
    values = np.full(W.dofmap.index_map.size_local * W.dofmap.index_map_bs, np.nan)
    for name, volts in (("bottom", 0.0), (case.driven, 1.0)):
        values[locate(W.sub(1), 2, device.facets_of(name))] = volts
    for name in case.clamped:
        values[locate(W.sub(0), 2, device.facets_of(name))] = 0.0
    for name, axis in case.slides.items():
        values[locate(W.sub(0).sub(axis), 2, device.facets_of(name))] = 0.0
    fixed = np.flatnonzero(~np.isnan(values)).astype(np.int32)
    return fixed, values[fixed]


def _dof_at(W: Any, point: np.ndarray) -> int:
    """The degree of freedom of the displacement along z at a node."""
    V, _ = W.sub(0).sub(2).collapse()
    found = dolfinx.fem.locate_dofs_geometrical(
        (W.sub(0).sub(2), V), lambda x: np.linalg.norm(x.T - point, axis=1) < 1e-9
    )
    return int(found[0][0])
