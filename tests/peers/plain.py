"""The scenes as a plain FEniCSx script: mixed space, LU by MUMPS in each Newton step, -O2."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.support.compat import PETSc, basix, create_vector, dolfinx
from tests.peers.scenes import EPSILON_0, Case


def solve(case: Case) -> dict[str, Any]:
    device = dea.read_gmsh(case.geometry, MPI.COMM_WORLD)
    mesh, dim, length = device.mesh, device.dim, device.length
    cell = mesh.topology.cell_name()
    mu0 = min(m.mu for m in case.materials.values())
    eps0 = max(m.eps_r or 0.0 for m in case.materials.values()) * EPSILON_0
    volt = length * np.sqrt(mu0 / eps0)
    element = basix.ufl.mixed_element([
        basix.ufl.element("Lagrange", cell, 2, shape=(dim,)),
        basix.ufl.element("Lagrange", cell, 1),
        basix.ufl.element("Lagrange", cell, 2),
    ])  # fmt: skip
    W = dolfinx.fem.functionspace(mesh, element)
    w, test = dolfinx.fem.Function(W), ufl.TestFunction(W)
    u, p, phi = ufl.split(w)
    grad = ufl.grad(u)
    x = ufl.SpatialCoordinate(mesh)
    hoop = u[0] / x[0] if case.axisymmetric else 0
    weight = 2 * ufl.pi * x[0] if case.axisymmetric else 1
    if dim == 2:
        grad = ufl.as_matrix([[grad[0, 0], grad[0, 1], 0], [grad[1, 0], grad[1, 1], 0],
                              [0, 0, hoop]])  # fmt: skip
    F = ufl.Identity(3) + grad
    J, C = ufl.det(F), F.T * F
    E = -ufl.grad(phi)
    E = ufl.as_vector([E[0], E[1], 0]) if dim == 2 else E
    pulled = ufl.dot(ufl.inv(F).T, E)
    dx = ufl.Measure("dx", mesh, subdomain_data=[
        (k, device.cells_of(name)[device.cells_of(name) < device.owned_cells()])
        for k, name in enumerate(case.materials)
    ], metadata={"quadrature_degree": 4})  # fmt: skip
    energy: Any = 0
    for k, m in enumerate(case.materials.values()):
        mu = dolfinx.fem.Constant(mesh, m.mu / mu0)
        I1 = ufl.tr(C) - 3
        W_e = mu / 2 * I1 if m.Jm is None else -mu * m.Jm / 2 * ufl.ln(1 - I1 / m.Jm)
        W_e += p * (J - 1) - mu * ufl.ln(J)
        if m.eps_r:
            W_e -= m.eps_r * EPSILON_0 / eps0 / 2 * J * ufl.dot(pulled, pulled)
        energy += W_e * weight * dx(k)
    residual = ufl.derivative(energy, w, test)
    form = dolfinx.fem.form(residual)
    tangent = dolfinx.fem.form(ufl.derivative(residual, w, ufl.TrialFunction(W)))

    fixed, volts = _fixed(case, device, W)
    bound, rate = dolfinx.fem.Function(W), dolfinx.fem.Function(W)
    rate.x.array[fixed] = volts / volt
    bcs, rates = ([dolfinx.fem.dirichletbc(f, fixed)] for f in (bound, rate))
    A, b = dolfinx.fem.petsc.create_matrix(tangent), create_vector(form)
    ksp = PETSc.KSP().create(mesh.comm)
    ksp.setOperators(A)
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    ksp.getPC().setFactorSolverType("mumps")
    ds = ufl.Measure("ds", mesh, subdomain_data=[(0, _sides(device, case.seen))],
                     metadata={"quadrature_degree": 4})  # fmt: skip
    one = dolfinx.fem.Constant(mesh, 1.0)
    moved, area = (dolfinx.fem.form(f * weight * ds(0)) for f in (u[case.axis], one))
    per_area = length / dolfinx.fem.assemble_scalar(area)
    pick = create_vector(form)  # the displacement seen, by all unknowns
    dolfinx.fem.petsc.assemble_vector(
        pick, dolfinx.fem.form(ufl.derivative(u[case.axis] * weight * ds(0), w, test))
    )
    step_, sideways = b.duplicate(), b.duplicate()
    factor, newton, spent = 0.0, 0, {"assembly_s": 0.0, "solve_s": 0.0}
    for wanted, distance in case.held():
        factor = factor if wanted is None else wanted
        for _ in range(40):
            bound.x.array[fixed] = factor * volts / volt
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
            ksp.solve(b, step_)
            if distance is not None:  # and the factor that moves what is seen to its place
                with b.localForm() as local:
                    local.set(0.0)
                dolfinx.fem.petsc.apply_lifting(b, [tangent], bcs=[rates])
                dolfinx.fem.petsc.set_bc(b, rates)
                ksp.solve(b, sideways)
                missing = distance / per_area - pick.dot(w.x.petsc_vec) + pick.dot(step_)
                change = missing / pick.dot(sideways)
                factor += change
                step_.axpy(-change, sideways)
            spent["solve_s"] += time.perf_counter() - now
            w.x.petsc_vec.axpy(-1.0, step_)
            w.x.scatter_forward()
            newton += 1
            if step_.norm() < 1e-9 * w.x.petsc_vec.norm():
                break
        else:
            raise RuntimeError(f"no convergence, {wanted=}, {distance=}")
    return {
        "value": float(dolfinx.fem.assemble_scalar(moved) * per_area),
        "unknowns": W.dofmap.index_map.size_global - len(fixed),
        "newton": newton, "krylov": 0, "factorisations": newton, **spent,
    }  # fmt: skip


def _fixed(case: Case, device: Any, W: Any) -> tuple[np.ndarray, np.ndarray]:
    """Fixed degrees of freedom and their potentials in V: clamp, electrodes, no dielectric."""
    mesh, dim = device.mesh, device.dim
    locate = dolfinx.fem.locate_dofs_topological
    values = np.full(W.dofmap.index_map.size_local + W.dofmap.index_map.num_ghosts, np.nan)
    free = np.concatenate([locate(W.sub(2), dim, device.cells_of(n)) for n in case.dielectrics])
    for name in case.materials:
        values[locate(W.sub(2), dim, device.cells_of(name))] = 0.0
    values[free] = np.nan
    for name, volts in case.electrodes.items():
        whole = name in case.materials
        entities = device.cells_of(name) if whole else device.facets_of(name)
        values[locate(W.sub(2), dim if whole else dim - 1, entities)] = volts
    mesh.topology.create_connectivity(dim - 1, dim)
    if case.clamped:
        values[locate(W.sub(0), dim - 1, device.facets_of(case.clamped))] = 0.0
    for name, axis in case.slides.items():
        values[locate(W.sub(0).sub(axis), dim - 1, device.facets_of(name))] = 0.0
    fixed = np.flatnonzero(~np.isnan(values)).astype(np.int32)
    return fixed, values[fixed]


def _sides(device: Any, name: str) -> np.ndarray:
    """A facet group as (cell, local facet) pairs."""
    mesh, dim = device.mesh, device.dim
    mesh.topology.create_connectivity(dim - 1, dim)
    mesh.topology.create_connectivity(dim, dim - 1)
    cells, facets = (mesh.topology.connectivity(*d) for d in ((dim - 1, dim), (dim, dim - 1)))
    pairs = []
    for facet in device.facets_of(name):
        cell = cells.links(facet)[0]
        pairs += [cell, int(np.flatnonzero(facets.links(cell) == facet)[0])]
    return np.array(pairs, dtype=np.int32)
