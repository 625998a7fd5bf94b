"""Weight, a given force per volume and the centrifugal force, against statics and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import block
from mpi4py import MPI
from stopped_runs import refused

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer

pytestmark = pytest.mark.usefixtures("quick_compile")

MU, H, RHO, G = 5e4, 1e-2, 1200.0, 9.81
RUBBER = dea.Material(dea.NeoHookean(MU), density=RHO)
TIGHT = dea.NewtonOptions(tolerance=1e-12)
DOWN = {"xyz": (0.0, 0.0, -G), "xy": (0.0, -G), "rz": (0.0, -G)}
WHOLE = {"xyz": H**3, "xy": H**2 * 0.02, "rz": np.pi * H**3}


@pytest.mark.parametrize("kinematics", [
    dea.ThreeD(), dea.PlaneStrain(0.02), dea.GeneralisedPlaneStrain(0.02), dea.Axisymmetric(),
])  # fmt: skip
def test_a_hanging_bar(kinematics):
    """The support bears the weight, to 1e-10; at half the ramp half of it."""
    axes = kinematics.axes
    device = block((2, 2, 2) if axes == "xyz" else (2, 2), size=H)
    weight = RHO * G * WHOLE[axes]
    held = [dea.Clamp("top")]
    scene = dea.Scene(device, {"film": RUBBER}, supports=held, loads=[dea.Gravity(DOWN[axes])],
                      kinematics=kinematics)  # fmt: skip
    record = {"R": dea.Reaction("top", axes[-1]), "A": dea.Energy("loads"),
              "u": dea.MeanDisplacement("bottom", axes[-1])}  # fmt: skip
    run = dea.solve(scene, dea.Ramp(steps=2), record, quiet=True, options=TIGHT)
    assert run["R_N"] == pytest.approx(weight, rel=1e-10)
    assert run.column("R_N") == pytest.approx(weight * run.column("load_factor"), abs=1e-12)
    assert run["u_m"] < 0 < run["A_J"]
    even = tuple(RHO * a for a in DOWN[axes])
    same = dea.Scene(device, {"film": dea.Material(dea.NeoHookean(MU))}, supports=held,
                     loads=[dea.BodyForce("film", even)], kinematics=kinematics)  # fmt: skip
    again = dea.solve(same, dea.Ramp(steps=2), record, quiet=True, options=TIGHT)
    assert again["u_m"] == pytest.approx(run["u_m"], rel=1e-9)
    assert again["R_N"] == pytest.approx(weight, rel=1e-10)


def test_a_column_by_its_own_weight():
    """Between frictionless walls nothing moves, and the pressure is that of the depth.

    Reaction of a wall: rho g H^2/2 by its width.
    """
    scene = dea.Scene(
        block((2, 2, 2), size=H), {"film": RUBBER}, loads=[dea.Gravity((0.0, 0.0, -G))],
        supports=[dea.Fix(w, "x") for w in ("x_min", "x_max")]
        + [dea.Fix(w, "y") for w in ("y_min", "y_max")] + [dea.Fix("bottom", "z")],
    )  # fmt: skip
    record = {"x": dea.Reaction("x_min", "x"), "z": dea.Reaction("bottom", "z"),
              "u": dea.LargestDisplacement("top", "z")}  # fmt: skip
    run = dea.solve(scene, dea.Ramp(steps=1), record, quiet=True, options=TIGHT)
    assert run["x_N"] == pytest.approx(RHO * G * H**3 / 2, rel=1e-8)
    assert run["z_N"] == pytest.approx(RHO * G * H**3, rel=1e-10)
    assert abs(run["u_m"]) < 1e-9 * H


def test_two_densities():
    """A light film under a heavy lid: each region has its own mass."""
    stack = BoxStack(H, H, [Layer("film", H), Layer("lid", H)], divisions=(1, 1))
    lid = dea.Material(dea.NeoHookean(MU), density=4 * RHO)
    scene = dea.Scene(dea.read_gmsh(stack, MPI.COMM_SELF), {"film": RUBBER, "lid": lid},
                      supports=[dea.Clamp("bottom")],
                      loads=[dea.Gravity((0.0, 0.0, -G))])  # fmt: skip
    run = dea.solve(scene, dea.Ramp(steps=1), {"R": dea.Reaction("bottom", "z")}, quiet=True,
                    options=TIGHT)  # fmt: skip
    assert run["R_N"] == pytest.approx(5 * RHO * G * H**3, rel=1e-10)


def test_a_spinning_rod():
    """A bar from the axis to L, free across: s(X) = rho w^2 (L^2 - X^2)/2 at small strain.

    So its end moves by rho w^2 L^3/(3 E), and the axis holds rho w^2 L^2/2 by the section.
    """
    w, L = 2.0, 10 * H
    geometry = BoxStack(L, H, [Layer("film", H)], divisions=(5, 1))
    scene = dea.Scene(
        dea.read_gmsh(geometry, MPI.COMM_SELF), {"film": RUBBER},
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
        loads=[dea.Centrifugal(w, about="y")],
    )  # fmt: skip
    record = {"R": dea.Reaction("x_min", "x"), "u": dea.MeanDisplacement("x_max", "x")}
    run = dea.solve(scene, dea.Ramp(steps=1), record, quiet=True, options=TIGHT)
    assert run["R_N"] == pytest.approx(-RHO * w**2 * L**2 / 2 * H**2, rel=5e-3)
    assert run["u_m"] == pytest.approx(RHO * w**2 * L**3 / (9 * MU), rel=2e-2)
    refused(lambda: dea.Energy("loads").bind(run.problem), "depends on the path")


def test_a_spinning_disc_and_its_tangent():
    """A free disc: s_r at the middle rho w^2 R^2 (3 + nu)/8, and Newton converges quadratically."""
    w = 40.0
    scene = dea.Scene(
        block((6, 1), size=H, thickness=H / 10), {"film": RUBBER},
        supports=[dea.Fix("x_min", "r"), dea.Fix("bottom", "z")],
        loads=[dea.Centrifugal(w)], kinematics=dea.Axisymmetric(),
    )  # fmt: skip
    run = dea.solve(scene, dea.Ramp(steps=1), {"u": dea.MeanDisplacement("x_max", "r")},
                    quiet=True, options=TIGHT)  # fmt: skip
    small = RHO * w**2 * H**3 * (1 - 0.5) / (4 * 3 * MU)
    assert run["u_m"] == pytest.approx(small, rel=2e-2)
    assert run["newton_iterations"] <= 5


FILM = {"film": RUBBER}
WRONG = {
    "has none": dict(materials={"film": dea.Material(dea.NeoHookean(MU))},
                     loads=[dea.Gravity((0.0, 0.0, -G))]),
    "has 2 components": dict(materials=FILM, loads=[dea.Gravity((0.0, -G))]),
    "finite": dict(materials=FILM, loads=[dea.Gravity((0.0, 0.0, np.nan))]),
    "no region named": dict(materials=FILM, loads=[dea.BodyForce("flim", (0.0, 0.0, 1.0))]),
    "about x or y or z": dict(materials=FILM, loads=[dea.Centrifugal(1.0, about="r")]),
    "radial component": dict(materials=FILM, loads=[dea.Gravity((G, 0.0))],
                             kinematics=dea.Axisymmetric()),
    "the density is": dict(materials={"film": dea.Material(dea.NeoHookean(MU), density=-1.0)}),
}  # fmt: skip


@pytest.mark.parametrize("words", WRONG)
def test_what_is_refused(words):
    given = dict(WRONG[words])
    device = block((1, 1) if "kinematics" in given else (1, 1, 1))
    refused(lambda: dea.Scene(device, supports=[dea.Clamp("top")], **given), words)


def test_a_weight_that_nothing_bears():
    scene = dea.Scene(block((1, 1, 1)), FILM, supports=[dea.FreeBody()],
                      loads=[dea.Gravity((0.0, 0.0, -G))])  # fmt: skip
    refused(lambda: dea.solve(scene, dea.Ramp(steps=1), quiet=True), "nothing bears")


def on_these_ranks(comm):
    stack = BoxStack(H, H, [Layer("film", H)], divisions=(2, 1))
    scene = dea.Scene(dea.read_gmsh(stack, comm), FILM, supports=[dea.Clamp("bottom")],
                      loads=[dea.Gravity((0.0, 3.0, -G))])  # fmt: skip
    run = dea.solve(scene, dea.Ramp(steps=1), {"R": dea.Reaction("bottom", "y")}, quiet=True)
    return [run["R_N"], run["newton_iterations"]]


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_ranks(on_ranks, ranks):
    alone = on_these_ranks(MPI.COMM_SELF)
    assert on_ranks("test_body_forces", "on_these_ranks", ranks) == pytest.approx(alone, rel=1e-8)
