"""Rigid parts that bodies are attached to, in vibration and in motion, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from motion_scenes import rubber, sphere, strip
from mpi4py import MPI
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer

pytestmark = pytest.mark.usefixtures("quick_compile")

MASS, MOMENT = 3.0, 2.0
PLANE = {
    "x": dea.PartDisplacement("x_max", "x"), "y": dea.PartDisplacement("x_max", "y"),
    "a": dea.PartRotation("x_max"),
}  # fmt: skip
COLUMNS = ("x_m", "y_m", "a_rad")


def bar(loads=(), comm=MPI.COMM_SELF, base=None, density=1e-6, prescribed=(), **attached):
    """A light strip with a rigid end, to which a body may be attached."""
    supports = [dea.Clamp("x_min")] if base is None else [dea.Fix("x_min", "y")]
    moved = [] if base is None else [dea.Displacement("x_min", "x", base, "base")]
    return strip(
        cells=(2, 1), length=4.0, comm=comm, materials={"film": rubber(density=density)},
        supports=[*supports, dea.Rigid("x_max", **attached)], loads=list(loads),
        prescribed=[*moved, *prescribed],
    )  # fmt: skip


def solve(scene, path, record=PLANE, **options):
    return dea.solve(scene, path, record, quiet=True, **options)


@pytest.fixture(scope="module")
def compliance():
    """Displacements and angle of the end by unit forces and a unit moment."""
    small, columns = 1e-6, []
    for load in (
        dea.Force("x_max", (small, 0.0)), dea.Force("x_max", (0.0, small)),
        dea.Moment("x_max", small),
    ):  # fmt: skip
        run = solve(bar([load]), dea.Ramp("load", steps=1))
        columns.append([run[name] / small for name in COLUMNS])
    return np.array(columns)


# ------------------------------------------------------------------ vibration


@pytest.mark.parametrize("moments", [None, MOMENT])
def test_modes_of_a_heavy_end(compliance, moments):
    """K v = omega^2 diag(m, m, I) v; a point mass has no moment of inertia."""
    scene = bar(kilograms=MASS, moments=moments)
    run = solve(scene, dea.March(1.0, steps=1))
    found = 2 * np.pi * np.array(dea.modes(run, 3).frequencies)
    n = 2 if moments is None else 3
    stiffness = np.linalg.inv(((compliance + compliance.T) / 2)[:n, :n])
    due = np.sqrt(eigh(stiffness, np.diag([MASS, MASS, MOMENT][:n]))[0])
    assert found[:n] == pytest.approx(due, rel=1e-5)


def test_frequency_response_of_a_heavy_end(compliance):
    """1/(k - m omega^2) along the bar."""
    scene = bar([dea.Force("x_max", (1e-6, 0.0))], kilograms=MASS)
    hertz = np.array([0.0, 0.03, 0.15])
    run = solve(scene, dea.Ramp("load", 0.0, steps=1))
    answer = dea.frequency_response(run, hertz, "load", record=PLANE)["x_m"]
    due = 1e-6 / (1 / compliance[0, 0] - MASS * (2 * np.pi * hertz) ** 2)
    assert answer.real == pytest.approx(due, rel=1e-5)


def test_a_ring_of_given_mass():
    """Axisymmetry: the mass of the full circle, and its weight."""
    scene = sphere(density=1e-6, cells=(1, 1))
    supports = [dea.Fix("axis", "r"), dea.Fix("equator", "z"), dea.Rigid("inner", kilograms=MASS)]
    run = solve(
        dea.Scene(
            scene.device, scene.materials, supports=supports, kinematics=dea.Axisymmetric(),
            loads=[dea.Gravity((0.0, -10.0))],
        ),
        dea.Ramp("load", 1e-9, steps=1),
        {"F": dea.PartForce("inner", "z"), "R": dea.Reaction("equator", "z")},
    )  # fmt: skip
    assert run["R_N"] == pytest.approx(1e-8 * MASS, rel=1e-3)


# ------------------------------------------------------------------ motion


def test_a_base_that_moves(compliance):
    """x'' = omega_0^2 (y - x) with y = Y sin(omega t), from rest."""
    base, hertz, steps = 1e-4, 0.05, 60
    omega, omega_0 = 2 * np.pi * hertz, np.sqrt(1 / compliance[0, 0] / MASS)
    march = dea.March(20.0, {"base": dea.Sine(hertz)}, steps=steps, inertia=True)
    run = solve(bar(base=base, kilograms=MASS), march)
    t = run.column("time_s")
    due = omega_0 * (omega_0 * np.sin(omega * t) - omega * np.sin(omega_0 * t))
    due *= base / (omega_0**2 - omega**2)
    assert run.column("x_m") == pytest.approx(due, abs=0.02 * np.abs(due).max())


def test_a_stretch_that_is_switched_on(compliance):
    """A region shrinks at once by a pre-stretch: the end swings about its new place.

    x = x_1 (1 - cos(omega_0 t)), with the place x_1 of rest.
    """
    shrink = dea.PreStretch("film", x=1.001, y=1.0, ramp="shrink")
    scene = bar(prescribed=[shrink], kilograms=MASS)
    rest = solve(scene, dea.Ramp("shrink", steps=1))["x_m"]
    omega_0 = np.sqrt(1 / compliance[0, 0] / MASS)
    march = dea.March(2 * np.pi / omega_0, {"shrink": 1.0}, steps=60, inertia=True)
    run = solve(scene, march)
    due = rest * (1 - np.cos(omega_0 * run.column("time_s")))
    assert rest < -1e-4
    assert run.column("x_m") == pytest.approx(due, abs=0.01 * abs(rest))


def test_weight_of_an_attached_body(compliance):
    scene = bar([dea.Gravity((2e-7, 0.0))], kilograms=MASS)
    run = solve(scene, dea.Ramp("load", steps=1))
    assert run["x_m"] == pytest.approx(2e-7 * MASS * compliance[0, 0], rel=1e-3)


# ------------------------------------------------------------------ free flight in space

SPIN = np.array([0.1, 2.0, 0.05])
BRICK = 6.0 / 12 * np.array([2**2 + 1, 3**2 + 1, 3**2 + 2**2])
MORE = np.array([2.0, 3.0, 1.5])


def brick(comm=MPI.COMM_SELF, density=1.0, **attached):
    """A rigid brick of 3 x 2 x 1 that nothing holds."""
    mesh = dea.read_gmsh(BoxStack(3.0, 2.0, [Layer("film", 1.0)], divisions=(1, 1)), comm)
    return dea.Scene(
        mesh, {"film": rubber(density=density)}, kinematics=dea.ThreeD(),
        supports=[dea.FreeBody(), dea.Rigid("film", **attached)],
    )  # fmt: skip


def spinning(x):
    return np.cross(SPIN, x.T - [1.5, 1.0, 0.5]).T + np.array([[0.3], [0.0], [0.0]])


def euler(moments, seconds):
    """The rotation of a free body by Euler's equations, in its own axes."""

    def rate(_, y):
        (x, y_, z, s), w = y[:4], y[4:]
        turn = [
            s * w[0] + y_ * w[2] - z * w[1], s * w[1] + z * w[0] - x * w[2],
            s * w[2] + x * w[1] - y_ * w[0], -x * w[0] - y_ * w[1] - z * w[2],
        ]  # fmt: skip
        return np.concatenate([np.array(turn) / 2, -np.cross(w, moments * w) / moments])

    found = solve_ivp(rate, (0, seconds), [0, 0, 0, 1, *SPIN], rtol=1e-11, atol=1e-12)
    return Rotation.from_quat(found.y[:4, -1]).as_matrix()


def flown(scene, steps, seconds=4.0):
    record = {f"w{axis}": dea.PartRotation("film", axis) for axis in "xyz"} | {
        "K": dea.KineticEnergy(), "p": dea.Momentum("x"), "x": dea.PartDisplacement("film", "x")
    }
    inertia = dea.Inertia(velocity=spinning, spectral_radius=0.9)
    run = solve(scene, dea.March(seconds, steps=steps, inertia=inertia), record)
    turned = Rotation.from_rotvec([run[f"w{axis}_rad"] for axis in "xyz"]).as_matrix()
    return run, turned


def test_a_brick_that_tumbles():
    """It turns by more than a whole turn, with an error of second order; the momentum stays."""
    moments, errors = BRICK + MORE, []
    due = euler(moments, 4.0)
    for steps in (45, 90):
        run, turned = flown(brick(kilograms=5.0, moments=tuple(MORE)), steps)
        errors.append(np.abs(turned - due).max())
    assert errors[1] < 8e-3 and 3.5 < errors[0] / errors[1] < 4.6, errors
    assert run.column("p_Ns")[1:] == pytest.approx(0.3 * 11, rel=1e-9)
    assert run["x_m"] == pytest.approx(1.2, rel=1e-9)
    energy = SPIN @ (moments * SPIN) / 2 + 0.09 * 11 / 2
    assert run["K_J"] == pytest.approx(energy, rel=2e-4)


def test_an_attached_brick_is_a_meshed_brick():
    light = brick(density=1e-9, kilograms=6.0, moments=tuple(BRICK))
    found = [flown(scene, 10, 1.0)[1] for scene in (brick(), light)]
    assert found[1] == pytest.approx(found[0], abs=1e-7)


# ------------------------------------------------------------------ what is refused

WRONG = {
    "mass of Rigid on 'x_max' is -1 kg": dict(kilograms=-1.0),
    "must be at least 0": dict(kilograms=1.0, moments=-1.0),
    "must have one, about z": dict(kilograms=1.0, moments=(1.0, 1.0, 1.0)),
    "finite": dict(kilograms=float("nan")),
}


@pytest.mark.parametrize("words", WRONG)
def test_what_is_refused(words):
    with pytest.raises(dea.InputError, match=words):
        bar(**WRONG[words])


def test_what_no_body_has():
    with pytest.raises(dea.InputError, match="which no body has"):
        brick(kilograms=1.0, moments=(1.0, 1.0, 3.0))
    with pytest.raises(dea.InputError, match="marches with inertia alone"):
        solve(brick(), dea.March(1.0), {})
    with pytest.raises(dea.InputError, match="attached to 'x_max'"):
        bar([dea.Centrifugal(1.0)], kilograms=1.0)


def on_these_ranks(comm):
    """Two cells or one, so that ranks hold one or none each."""
    march = dea.March(2.0, steps=2, inertia=dea.Inertia(velocity=(0.1, 0.2)))
    run = solve(bar(comm=comm, kilograms=MASS, moments=MOMENT), march)
    free, turned = flown(brick(comm, kilograms=5.0, moments=tuple(MORE)), 2, 0.1)
    return [*(run[name] for name in COLUMNS), free["K_J"], *turned[0]]


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_ranks(on_ranks, ranks):
    alone = on_these_ranks(MPI.COMM_SELF)
    assert on_ranks("test_heavy_parts", "on_these_ranks", ranks) == pytest.approx(alone, rel=1e-8)
