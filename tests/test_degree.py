"""Displacements of degree 3 and 4: orders, homogeneous states, counts, results, several ranks."""

from __future__ import annotations

import os

import numpy as np
import pytest
import ufl
from conftest import on_demand
from mpi4py import MPI
from scipy.optimize import brentq
from test_convergence import (
    EPS_R,
    HEIGHT,
    MU,
    VOLTS,
    A,
    B,
    TriangleStrip,
    errors,
    quads,
    rates,
)  # fmt: skip

import dea_fenicsx as dea
from dea_fenicsx.exact import RoundBalloon
from dea_fenicsx.geometry import BoxStack, HollowSphere, Layer, Tube
from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.results.reading import read_frame
from dea_fenicsx.support import compat

pytestmark = pytest.mark.usefixtures("quick_compile")
QUADRATURE = 12
"""Degree of the quadrature of errors; the points of a lower one may lie where errors vanish."""
ROOM = np.array([0.1, 0.1, 0.2, 0.2])
"""How far fitted orders of u in L2 and H1, of p and of phi may lie below those of theory."""
WALL = {"wall": dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(EPS_R))}


def tube(device, degree):
    """The tube with a radial field on the way to its exact state, with a count at each step."""
    scene = dea.Scene(
        device, WALL, [dea.Electrode("x_min", VOLTS), dea.Ground("x_max")],
        [dea.Fix("bottom", "z"), dea.Fix("top", "z")], kinematics=dea.Axisymmetric(),
        elements=dea.Discretisation(degree=degree),
    )  # fmt: skip
    options = dea.NewtonOptions(tolerance=1e-12)
    run = dea.solve(scene, dea.Ramp(steps=4), quiet=True, options=options)
    counts = [row["negative_modes"] for row in run.history]
    assert 0 in counts and set(counts) <= {0, None}  # where none was asked for
    radius = ufl.SpatialCoordinate(run.problem.mesh)[0]
    return errors(run, radius, ufl.as_vector([1, 0]), QUADRATURE)


@pytest.mark.parametrize(
    ("make", "degree", "levels"),
    [(quads, 3, (2, 4, 8)), (quads, 4, (2, 4, 6)), (TriangleStrip, 3, (3, 6, 12)),
     (TriangleStrip, 4, (3, 6, 9))],
    ids=["quadrilateral Q3-P2", "quadrilateral Q4-P3", "triangle P3-P2", "triangle P4-P3"],
)  # fmt: skip
def test_orders_in_the_axisymmetric_tube(make, degree, levels):
    """u: k + 1 in L2, k in H1; p: k; phi: k + 1; u within 0.1, the others within 0.2."""
    found = [tube(dea.read_gmsh(make(n), MPI.COMM_SELF, dim=2), degree) for n in levels]
    slope = rates(levels, found)
    assert np.all(slope > np.array([1, 0, 0, 1]) + degree - ROOM), slope


def film(comm, degree, divisions=(2, 1)):
    """A film in space under a dead load and a voltage, and its exact stretch."""
    block = BoxStack(1e-3, 1e-3, [Layer("film", 1e-3)], divisions=divisions)
    lam, volts, eps = 2.0, 8e3, 2.86 * EPSILON_0
    load = MU * (lam - lam**-5)
    scene = dea.Scene(
        dea.device(block, comm),
        {"film": dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(2.86))},
        [dea.Electrode("top", volts), dea.Ground("bottom")],
        [dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
        loads=[dea.DeadLoad("x_max", (load, 0, 0)), dea.DeadLoad("y_max", (0, load, 0))],
        elements=dea.Discretisation(degree=degree),
    )  # fmt: skip

    def unbalanced(x):
        return x * load + eps * (x**2 * volts / 1e-3) ** 2 - MU * (x**2 - x**-4)

    return scene, brentq(unbalanced, 2.0, 2.8, xtol=1e-13)


@on_demand
@pytest.mark.parametrize("degree", [3, 4])
def test_a_homogeneous_film_in_space(degree, tmp_path):
    """The stretch is exact to 1e-8, no negative eigenvalue is false, quadratic cells show it."""
    scene, exact = film(MPI.COMM_SELF, degree)
    path = [dea.Ramp("load", steps=2), dea.Ramp("voltage", steps=3)]
    record = {a: dea.MeanStretch((f"{a}_min", f"{a}_max"), a) for a in "xy"}
    run = dea.solve(scene, path, record, tmp_path / "film", quiet=True)
    assert [run["x"], run["y"]] == pytest.approx([exact] * 2, rel=1e-8)
    counts = [row["negative_modes"] for row in run.history]
    assert 0 in counts and set(counts) <= {0, None}  # where none was asked for
    grid = read_frame(tmp_path / "film").grid
    x, u = grid.points[:, 0], grid.point_data["displacement_m"][:, 0]
    assert u == pytest.approx((exact - 1) * x, rel=1e-7, abs=1e-12)


def quarter(n, degree):
    """Errors on a quarter of the tube in hexahedra that are as curved as the elements allow."""
    wall = [Layer("wall", B - A, divisions=2 * n)]
    device = dea.device(Tube(A, HEIGHT, wall, "quarter", 8 * n, 1), MPI.COMM_SELF)
    held = [dea.Fix(side, axis) for side, axis in
            (("bottom", "z"), ("top", "z"), ("x_min", "x"), ("y_min", "y"))]  # fmt: skip
    scene = dea.Scene(
        device, WALL, [dea.Electrode("inner", VOLTS), dea.Ground("outer")], held,
        elements=dea.Discretisation(degree=degree),
    )  # fmt: skip
    options = dea.NewtonOptions(tolerance=1e-12)
    run = dea.solve(scene, dea.Ramp(steps=3), quiet=True, stability="never", options=options)
    assert compat.coordinate_element(run.problem.mesh).degree == degree
    x = ufl.SpatialCoordinate(run.problem.mesh)
    R = ufl.sqrt(x[0] ** 2 + x[1] ** 2)
    return errors(run, R, ufl.as_vector([x[0] / R, x[1] / R, 0]), QUADRATURE)


@on_demand
@pytest.mark.parametrize(("degree", "levels"), [(3, (2, 4)), (4, (2, 3))])
def test_orders_on_curved_hexahedra(degree, levels):
    """u: k + 1 in L2, k in H1; p: k; phi: k + 1, as on straight cells."""
    slope = rates(levels, [quarter(n, degree) for n in levels])
    assert np.all(slope > np.array([1, 0, 0, 1]) + degree - ROOM), slope


def test_curved_cells_are_of_the_degree_of_the_elements(tmp_path):
    """Two cells of a sphere: its area, and what is drawn of it."""
    ball = RoundBalloon(1e-3, 1.2e-3, WALL["wall"])
    device = dea.device(HollowSphere(1e-3, 1.2e-3, "half", 1, 2), MPI.COMM_SELF)
    scene = dea.Scene(
        device, WALL, [dea.Electrode("inner", ball.at(1.15e-3).volts), dea.Ground("outer")],
        [dea.Fix("axis", "r"), dea.Fix("equator", "z")], kinematics=dea.Axisymmetric(),
        elements=dea.Discretisation(degree=3),
    )  # fmt: skip
    assert compat.coordinate_element(scene.device.mesh).degree == 3
    assert dea.Scene(  # another scene with this device has the same cells
        device, WALL, supports=scene.supports, kinematics=scene.kinematics, elements=scene.elements
    ).device is scene.device  # fmt: skip
    area = {"area": dea.Area("inner")}
    run = dea.solve(scene, dea.Ramp(steps=3), area, tmp_path / "ball", quiet=True)
    assert run["area_m2"] == pytest.approx(2 * np.pi * 1.15e-3**2, rel=1e-4)
    grid = read_frame(tmp_path / "ball").grid
    R = np.hypot(*grid.points[:, :2].T)
    assert grid.cells_dict.keys() == {28}  # VTK's quadrilateral of nine nodes, drawn curved
    assert np.all((R > 0.9997e-3) & (R < 1.2001e-3))  # cubic arcs of 45 degrees are off by 2e-4


def bender(comm):
    """A bender of twelve cells."""
    layers = [Layer("passive", 0.5e-3), Layer("active", 0.5e-3)]
    rubber = dea.NeoHookean(80e3)
    return dea.Scene(
        dea.device(BoxStack(10e-3, None, layers, 6, ends="start"), comm),
        {"active": dea.Material(rubber, dea.IdealDielectric(2.8)), "passive": dea.Material(rubber)},
        [dea.Electrode("top", 8e3), dea.Ground("interface_1")], [dea.Clamp("x_min")],
        kinematics=dea.PlaneStrain(5e-3), elements=dea.Discretisation(degree=3),
    )  # fmt: skip


TIP = {"tip": dea.MeanDisplacement("x_max", "y")}


def bent(comm):
    """Bend it, and leave the results in a folder."""
    run = dea.solve(bender(comm), dea.Ramp(steps=2), TIP, os.environ["BENT"], quiet=True)
    return [float(run["tip_m"]), run.summary["unknowns"]]


@pytest.mark.mpi
@pytest.mark.slow
def test_ranks_and_a_checkpoint(on_ranks, tmp_path, monkeypatch):
    """Three ranks find what one does, and one rank goes on from what three have kept."""
    bent_there = tmp_path / "bent"
    monkeypatch.setenv("BENT", str(bent_there))
    tip, unknowns = on_ranks("test_degree", "bent", 3)
    run = dea.solve(bender(MPI.COMM_SELF), dea.Ramp(steps=2), TIP, tmp_path / "one", quiet=True)
    assert [run["tip_m"], run.summary["unknowns"]] == [pytest.approx(tip, rel=1e-8), unknowns]
    again = dea.solve(bender(MPI.COMM_SELF), dea.Ramp(steps=1), TIP, quiet=True, start=bent_there)
    assert again.history[-1]["newton_iterations"] <= 1
    assert again["tip_m"] == pytest.approx(tip, rel=1e-8)
    shown = [read_frame(folder).grid for folder in (bent_there, tmp_path / "one")]
    assert shown[0].cells_dict.keys() == {28}  # VTK's quadrilateral of nine nodes
    fields = [grid.point_data["displacement_m"] for grid in shown]
    assert fields[0] == pytest.approx(fields[1], abs=1e-10)


@pytest.mark.parametrize(
    ("given", "words"),
    [({"degree": 5}, "2, 3 or 4"), ({"degree": 3, "potential_degree": 4}, "from 1 to 3"),
     ({"degree": 4, "quadrature_degree": 13}, "between 2 and 12")],
)  # fmt: skip
def test_degrees_that_do_not_exist(given, words):
    with pytest.raises(dea.InputError, match=words):
        scene = film(MPI.COMM_SELF, 2)[0]
        dea.Scene(
            scene.device, scene.materials, scene.electrodes, scene.supports,
            elements=dea.Discretisation(**given),
        )  # fmt: skip
