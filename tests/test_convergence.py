"""Convergence on an inhomogeneous state with a closed form: a tube with a radial field.

A long tube, undeformed radii A < B, held in length, has a voltage V between its inner and outer
face.  Incompressible: r^2 = R^2 + k.  With e = V/(r ln(b/a)) and neo-Hookean rubber

    sigma_r = mu (R^2/r^2 - 1) + p + eps e^2/2,   sigma_h = mu (r^2/R^2 - 1) + p - eps e^2/2,

equilibrium, d sigma_r/dr = (sigma_h - sigma_r)/r with sigma_r = 0 at a and b, determines k and p.
"""

from __future__ import annotations

import dolfinx
import gmsh
import numpy as np
import pytest
import ufl
from mpi4py import MPI
from scipy.optimize import brentq

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0

MU, EPS_R, A, B, HEIGHT = 50e3, 3.0, 1e-3, 2e-3, 0.5e-3
EPS = EPS_R * EPSILON_0
PHI2 = 0.25  # eps V^2 / (mu (B - A)^2)
VOLTS = float(np.sqrt(PHI2 * MU / EPS)) * (B - A)


def work_integral(r, k, log):
    """int (sigma_h - sigma_r)/r dr, an antiderivative; `log` is ln(b/a)."""
    elastic = MU * (0.5 * np.log(r**2 - k) - np.log(r) - k / (2 * r**2))
    return elastic + EPS * VOLTS**2 / (2 * log**2 * r**2)


def solve_tube():
    """k and ln(b/a) of the exact state."""

    def total(k):
        a, b = np.sqrt(A**2 + k), np.sqrt(B**2 + k)
        log = np.log(b / a)
        return work_integral(b, k, log) - work_integral(a, k, log)

    k = brentq(total, 1e-3 * A**2, 2.0 * A**2, xtol=1e-22)
    return k, float(np.log(np.sqrt(B**2 + k) / np.sqrt(A**2 + k)))


def exact(R, length, k, log):
    """Dimensionless u_r, p/mu and phi/unit as expressions in the dimensionless radius R."""
    unit = length * np.sqrt(MU / EPS)
    k_, V = k / length**2, VOLTS / unit
    a = float(np.sqrt(A**2 / length**2 + k_))
    r = ufl.sqrt(R**2 + k_)

    def integral(r, ln=ufl.ln):
        return 0.5 * ln(r**2 - k_) - ln(r) - k_ / (2 * r**2) + V**2 / (2 * log**2 * r**2)

    sigma_r = integral(r) - float(integral(a, np.log))
    e = V / (r * log)
    p = sigma_r - (R**2 / r**2 - 1) - e**2 / 2
    phi = V * (1 - ufl.ln(r / a) / log)
    return r - R, p, phi


def errors(run, radius, direction, quadrature=8):
    """L2 errors of u, grad u, p and phi against the exact state."""
    problem = run.problem
    u, p, phi = ufl.split(problem.w)
    k, log = solve_tube()
    u_r, p_exact, phi_exact = exact(radius, problem.scales.length, k, log)
    du = u - u_r * direction
    dx = ufl.Measure("dx", domain=problem.mesh, metadata={"quadrature_degree": quadrature})
    weight = problem.scene.kinematics.weight(ufl.SpatialCoordinate(problem.mesh))

    def norm(x):
        return float(np.sqrt(dolfinx.fem.assemble_scalar(
            dolfinx.fem.form(ufl.inner(x, x) * weight * dx))))  # fmt: skip

    return np.array([norm(du), norm(ufl.grad(du)), norm(p - p_exact), norm(phi - phi_exact)])


def scene(device, kinematics, faces, supports, pressure="auto"):
    return dea.Scene(
        device,
        {"wall": dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(EPS_R))},
        electrodes=[dea.Electrode(faces[0], VOLTS), dea.Ground(faces[1])],
        supports=supports,
        kinematics=kinematics,
        elements=dea.Discretisation(pressure=pressure),
    )


def run_axisymmetric(device, pressure):
    s = scene(device, dea.Axisymmetric(), ("x_min", "x_max"),
              [dea.Fix("bottom", "z"), dea.Fix("top", "z")], pressure)  # fmt: skip
    run = dea.solve(s, dea.Ramp(steps=4), quiet=True, stability="never",
                    options=dea.NewtonOptions(tolerance=1e-12))  # fmt: skip
    x = ufl.SpatialCoordinate(run.problem.mesh)
    return errors(run, x[0], ufl.as_vector([1, 0]))


class TriangleStrip:
    """The tube's wall as an unstructured triangle mesh, with names, through gmsh."""

    def __init__(self, cells):
        self.cells = cells

    def build(self):
        if not gmsh.isInitialized():
            gmsh.initialize(interruptible=False)
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("tube")
        gmsh.model.occ.addRectangle(A, 0, 0, B - A, HEIGHT)
        gmsh.model.occ.synchronize()
        for k, name in enumerate(["bottom", "x_max", "top", "x_min"], start=1):
            gmsh.model.addPhysicalGroup(1, [k], name=name)
        gmsh.model.addPhysicalGroup(2, [1], name="wall")
        gmsh.option.setNumber("Mesh.MeshSizeMax", HEIGHT / self.cells)
        gmsh.option.setNumber("Mesh.MeshSizeMin", HEIGHT / self.cells)
        gmsh.model.mesh.generate(2)
        gmsh.option.restoreDefaults()
        return gmsh.model


def quads(n):
    return BoxStack(B - A, None, [Layer("wall", HEIGHT, divisions=n)], divisions=(2 * n,), x0=A)


def rates(levels, found):
    """Fitted slopes of log error over log h."""
    h = -np.log(np.array(levels, dtype=float))
    return np.array([np.polyfit(h, np.log(column), 1)[0] for column in np.array(found).T])


@pytest.mark.parametrize(
    ("make", "pressure"),
    [(quads, "discontinuous"), (quads, "continuous"), (TriangleStrip, "continuous")],
    ids=["quadrilateral Q2-P1", "quadrilateral Q2-Q1", "triangle P2-P1"],
)
def test_rates_in_the_axisymmetric_tube(make, pressure):
    """u: 3 in L2, 2 in H1; p: 2; phi: 3, each within 0.2."""
    levels = (2, 4, 8) if make is quads else (3, 6, 12)
    found = [run_axisymmetric(dea.read_gmsh(make(n), MPI.COMM_SELF, dim=2), pressure)
             for n in levels]  # fmt: skip
    slope = rates(levels, found)
    theory = np.array([3, 2, 2, 3])
    assert np.all(slope > theory - 0.2), slope


class QuarterRing:
    """A quarter of the tube as curved hexahedra, by gmsh's own transfinite sweep."""

    def __init__(self, n):
        self.n = n

    def build(self):
        if not gmsh.isInitialized():
            gmsh.initialize(interruptible=False)
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("quarter ring")
        geo, n = gmsh.model.geo, self.n
        centre = geo.addPoint(0, 0, 0)
        corners = [geo.addPoint(x, y, 0) for x, y in ((A, 0), (B, 0), (0, B), (0, A))]
        lines = [
            geo.addLine(corners[0], corners[1]),
            geo.addCircleArc(corners[1], centre, corners[2]),
            geo.addLine(corners[2], corners[3]),
            geo.addCircleArc(corners[3], centre, corners[0]),
        ]
        face = geo.addPlaneSurface([geo.addCurveLoop(lines)])
        for line, cells in zip(lines, (2 * n, 2 * n, 2 * n, 2 * n), strict=True):
            geo.mesh.setTransfiniteCurve(line, cells + 1)
        geo.mesh.setTransfiniteSurface(face)
        geo.mesh.setRecombine(2, face)
        swept = geo.extrude([(2, face)], 0, 0, HEIGHT, numElements=[1], recombine=True)
        geo.synchronize()
        names = ["bottom", "top", "y_min", "outer", "x_min", "inner"]
        tags = [face, swept[0][1], *(tag for _, tag in swept[2:])]
        for name, tag in zip(names, tags, strict=True):
            gmsh.model.addPhysicalGroup(2, [tag], name=name)
        gmsh.model.addPhysicalGroup(3, [swept[1][1]], name="wall")
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        return gmsh.model


def test_rates_in_three_dimensions():
    """The same tube, a quarter of it, in curved hexahedra: u 3 and 2, p 2."""
    levels, found = (2, 4, 7), []
    for n in levels:
        device = dea.read_gmsh(QuarterRing(n), MPI.COMM_SELF)
        supports = [dea.Fix("bottom", "z"), dea.Fix("top", "z"), dea.Fix("x_min", "x"),
                    dea.Fix("y_min", "y")]  # fmt: skip
        s = scene(device, dea.ThreeD(), ("inner", "outer"), supports)
        run = dea.solve(s, dea.Ramp(steps=3), quiet=True, stability="never")
        x = ufl.SpatialCoordinate(run.problem.mesh)
        R = ufl.sqrt(x[0] ** 2 + x[1] ** 2)
        found.append(errors(run, R, ufl.as_vector([x[0] / R, x[1] / R, 0])))
    slope = rates(levels, found)
    assert np.all(slope[:3] > np.array([3, 2, 2]) - 0.2), slope

