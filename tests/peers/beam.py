"""Time the bilayer beam of demos/beam_in_motion.py, here and as a plain FEniCSx script, in one run.

    python -m tests.peers.beam [--steps N] [--seconds S] [--mesh NAME]

The plain script is of the usual kind: tetrahedra (20 x 1 x 6 boxes) with quadratic displacement and
potential and linear pressure, trapezoidal Newmark, backward Euler for the viscous strains, LU by
MUMPS in each Newton iteration.  Each code marches twice: over two steps, which compiles its forms,
and then the steps that are timed, in CPU seconds of this process.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.support.compat import PETSc, basix, create_vector, dolfinx

sys.path.append(str(Path(__file__).parents[2] / "demos"))
import beam_in_motion as beam

G, LIMIT, EPS, DENSITY = 15.36e3, 5.99, 4.8 * EPSILON_0, 1000.0
BOXES = (20, 1, 6)
UNIT = 1e-3
"""Length in m in whose units the plain script computes; its unit of stress is G."""

DEGREE = 4
"""Of the plain script's quadrature."""


def ours(seconds: float, steps: int, mesh: str) -> dict[str, Any]:
    """The beam on hexahedra of this package."""
    march = dea.March(seconds, {"voltage": beam.drive}, steps=steps, inertia=True)
    tip = {"tip": dea.AtPoint((beam.LENGTH, beam.SIDE / 2, beam.SIDE / 2), "displacement", "z")}
    run = dea.solve(beam.scene(mesh), march, tip, quiet=True, stability="never")
    told = run.summary
    return {
        "time": run.column("time_s"), "tip": run.column("tip_m"), "unknowns": told["unknowns"],
        "newton": told["newton_iterations"], "factorisations": told["factorisations"],
    }  # fmt: skip


def plain(seconds: float, steps: int) -> dict[str, Any]:
    """The beam as a plain script."""
    size = np.array([beam.LENGTH, beam.SIDE, beam.SIDE]) / UNIT
    mesh = dolfinx.mesh.create_box(
        MPI.COMM_SELF, [np.zeros(3), size], list(BOXES), dolfinx.mesh.CellType.tetrahedron
    )
    W = dolfinx.fem.functionspace(mesh, basix.ufl.mixed_element([
        basix.ufl.element("Lagrange", "tetrahedron", 2, shape=(3,)),
        basix.ufl.element("Lagrange", "tetrahedron", 1),
        basix.ufl.element("Lagrange", "tetrahedron", 2),
    ]))  # fmt: skip
    V, to_w = W.sub(0).collapse()
    w = dolfinx.fem.Function(W)
    before, velocity, acceleration = (dolfinx.fem.Function(V) for _ in range(3))
    residual, past, new = _equations(mesh, W, w, (before, velocity, acceleration), seconds / steps)
    fixed, raised = _fixed(W, size)
    bound = dolfinx.fem.Function(W)
    bcs = [dolfinx.fem.dirichletbc(bound, fixed)]
    forms = dolfinx.fem.form(residual), dolfinx.fem.form(
        ufl.derivative(residual, w, ufl.TrialFunction(W))
    )
    points = basix.make_quadrature(basix.CellType.tetrahedron, DEGREE)[0]
    updates = [dolfinx.fem.Expression(c, points) for c in new]
    cells = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
    for function in past:
        function.x.array.reshape(-1, 9)[:] = np.eye(3).ravel()
    U, _ = W.sub(0).sub(2).collapse()
    seen = dolfinx.fem.locate_dofs_geometrical(
        (W.sub(0).sub(2), U),
        lambda x: np.linalg.norm(x.T - size * (1, 0.5, 0.5), axis=1) < 1e-9,
    )[0][0]
    solver, h, newton = _Solver(forms, bcs), seconds / steps, 0
    time_, tip = [0.0], [0.0]
    volts = beam.VOLTS / (UNIT * np.sqrt(G / EPS))
    for k in range(1, steps + 1):
        bound.x.array[fixed] = raised * volts * beam.drive(k * h)
        newton += solver.newton(w)
        for function, expression in zip(past, updates, strict=True):
            function.x.array[:] = np.asarray(expression.eval(mesh, cells)).ravel()
        u, a = w.x.array[to_w], acceleration.x.array
        moved = (u - before.x.array - h * velocity.x.array) * 4 / h**2 - a
        velocity.x.array[:] += h / 2 * (a + moved)
        acceleration.x.array[:] = moved
        before.x.array[:] = u
        time_.append(k * h)
        tip.append(float(w.x.array[seen]) * UNIT)
    return {
        "time": np.array(time_), "tip": np.array(tip),
        "unknowns": len(w.x.array) - len(fixed), "newton": newton, "factorisations": newton,
    }  # fmt: skip


def _equations(mesh: Any, W: Any, w: Any, motion: Any, h: float) -> tuple[Any, Any, Any]:
    """The residual, the viscous strains, and their new values."""
    before, velocity, acceleration = motion
    step = dolfinx.fem.Constant(mesh, h)
    u, p, phi = ufl.split(w)
    F = ufl.Identity(3) + ufl.grad(u)
    J, C = ufl.det(F), F.T * F
    Cbar = J ** (-2 / 3) * C
    element = basix.ufl.quadrature_element("tetrahedron", value_shape=(3, 3), degree=DEGREE)
    Q = dolfinx.fem.functionspace(mesh, element)
    past, new = [dolfinx.fem.Function(Q) for _ in beam.BRANCHES], []
    z = ufl.sqrt(ufl.tr(Cbar) / 3) / LIMIT
    energy = LIMIT**2 * (z**2 / 2 - ufl.ln(1 - z**2)) + p * (J - 1)
    for (mu, tau), old in zip(beam.BRANCHES, past, strict=True):
        moved = old + step / tau * Cbar
        new.append(ufl.det(moved) ** (-1 / 3) * moved)
        energy += 3 * mu / (2 * G) * tau / step * ufl.det(moved) ** (1 / 3)
    pulled = ufl.dot(ufl.inv(F).T, ufl.grad(phi))
    energy -= J / 2 * ufl.dot(pulled, pulled)
    dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": DEGREE})
    test = ufl.TestFunction(W)
    a = 4 * (u - before - step * velocity) / step**2 - acceleration
    heavy = DENSITY * UNIT**2 / G
    residual = ufl.derivative(energy * dx, w, test)
    return residual + heavy * ufl.inner(a, ufl.split(test)[0]) * dx, past, new


def _fixed(W: Any, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fixed degrees of freedom, and which of them carry the voltage."""
    V, _ = W.sub(0).collapse()
    P, _ = W.sub(2).collapse()
    find = dolfinx.fem.locate_dofs_geometrical
    values = np.full(W.dofmap.index_map.size_local, np.nan)
    for height, volts in ((0.0, 0.0), (size[2] / 2, 0.0), (size[2], 1.0)):
        values[find((W.sub(2), P), lambda x, z=height: np.isclose(x[2], z))[0]] = volts
    values[find((W.sub(0), V), lambda x: np.isclose(x[0], 0.0))[0]] = 0.0
    fixed = np.flatnonzero(~np.isnan(values)).astype(np.int32)
    return fixed, values[fixed]


class _Solver:
    """Newton's method with full steps and MUMPS."""

    def __init__(self, forms: Any, bcs: Any) -> None:
        (self.form, self.tangent), self.bcs = forms, bcs
        self.A, self.b = dolfinx.fem.petsc.create_matrix(self.tangent), create_vector(self.form)
        self.step = self.b.duplicate()
        self.ksp = PETSc.KSP().create(MPI.COMM_SELF)
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
            petsc.set_bc(b, self.bcs, w.x.petsc_vec, -1.0)
            self.ksp.solve(b, self.step)
            w.x.petsc_vec.axpy(-1.0, self.step)
            size = self.step.norm()
            if not np.isfinite(size):
                break
            if size < 1e-8 * max(w.x.petsc_vec.norm(), 1e-12):
                return taken
        raise RuntimeError("Newton's method failed")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--steps", type=int, default=250)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--mesh", default="medium", choices=sorted(beam.MESHES))
    args = parser.parse_args()
    h, found, spent = args.seconds / args.steps, {}, {}
    for name, solve in (
        ("ours", lambda s, n: ours(s, n, args.mesh)), ("plain", plain)
    ):  # fmt: skip
        solve(2 * h, 2)
        start = time.process_time()
        found[name] = solve(args.seconds, args.steps)
        spent[name] = time.process_time() - start
        told = found[name]
        print(f"{name:6} {told['unknowns']:6d} unknowns  {args.steps} steps  Newton "
              f"{told['newton']}  factors {told['factorisations']}  {spent[name]:.1f} s of CPU  "
              f"tip {1e3 * told['tip'][-1]:.5f} mm", flush=True)  # fmt: skip
    mine = np.interp(found["plain"]["time"], found["ours"]["time"], found["ours"]["tip"])
    off = np.abs(mine - found["plain"]["tip"]).max() / np.abs(found["plain"]["tip"]).max()
    print(f"largest difference of the tips {100 * off:.2f} % of the largest; time of the plain "
          f"script {spent['plain'] / spent['ours']:.1f} of ours")  # fmt: skip


if __name__ == "__main__":
    main()
