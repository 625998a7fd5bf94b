"""The energy-conserving scheme: energy, momentum and angular momentum, and its order."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import on_demand
from motion_scenes import CLAMPED, rubber, sphere, strip
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0

pytestmark = pytest.mark.usefixtures("quick_compile")

SCHEME = "energy-conserving"
ENERGIES = {
    "K": dea.KineticEnergy(), "W": dea.Energy("elastic"), "E": dea.Energy("electric"),
}  # fmt: skip
MOMENTA = {
    "px": dea.Momentum("x"), "py": dea.Momentum("y"), "L": dea.AngularMomentum(),
}  # fmt: skip
SPACE = {f"L{axis}": dea.AngularMomentum(axis) for axis in "xy"}


def marched(scene, seconds, steps, record, drive=None, **inertia):
    """A march, whose first rows are the start and the jump of the voltage."""
    drive = ({"voltage": 1.0} if "voltage" in scene.ramps else {}) if drive is None else drive
    march = dea.March(seconds, drive, steps=steps, inertia=dea.Inertia(scheme=SCHEME, **inertia))
    return dea.solve(scene, march, record, quiet=True, stability="never", failures=())


def total(run):
    """Kinetic plus total potential energy at constant voltage, from the first moving state on."""
    found = run.column("K_J") + run.column("W_J") - run.column("E_J")
    return found[run.column("time_s") > 0]


PERIOD = 2 * np.pi / 3.03716946


@pytest.mark.parametrize("periods", [100, pytest.param(1000, marks=on_demand)])
def test_a_thick_sphere_at_a_constant_voltage(periods):
    """It breathes about its equilibrium at V = 0.05, which is switched on; the sum stays."""
    run = marched(sphere(0.05, cells=(1, 1)), periods * PERIOD, 6 * periods, ENERGIES)
    sums, t = total(run), run.column("time_s")[run.column("time_s") > 0]
    largest = run.column("K_J").max()
    assert largest > 1e-4
    trend = np.polyfit(t, sums, 1)[0] * t[-1]
    assert abs(trend) < 1e-8 * largest
    assert np.abs(sums - sums[0]).max() < 1e-7 * largest
    assert run.column("residual").max() < 1e-12
    assert run.column("newton_iterations").max() <= 6


def spin(x):
    """A slow flight, a rigid spin and a shear, so that the body is strained as it turns."""
    return np.stack([
        0.3 - 0.6 * (x[1] - 0.5) + 0.2 * (x[0] - 1), -0.2 + 0.6 * (x[0] - 1) - 0.2 * (x[1] - 0.5)
    ])  # fmt: skip


MATERIALS = {
    "incompressible": {},
    "compressible": {"bulk_modulus": 5.0},
    "chains": {"elastic": dea.Gent(1.0, 20.0)},
    "stretches": {"elastic": dea.Ogden((0.5, 0.1), (1.3, 5.0))},
}


def free_strip(kind="incompressible", comm=MPI.COMM_SELF):
    given = MATERIALS[kind]
    if "elastic" in given:
        film = dea.Material(given["elastic"], dea.IdealDielectric(1 / EPSILON_0), density=1.0)
    else:
        film = rubber(**given)
    return strip(0.3, cells=(2, 1), length=2.0, comm=comm, materials={"film": film})


@pytest.mark.parametrize("kind", MATERIALS)
def test_a_free_body_in_the_plane(kind):
    """It flies, spins and swings: momentum and angular momentum stay, as does the energy."""
    run = marched(free_strip(kind), 4.0, 20, ENERGIES | MOMENTA, velocity=spin)
    for name, due in (("px_Ns", 0.6), ("py_Ns", -0.4)):
        assert run.column(name)[2:] == pytest.approx(due, rel=1e-10)
    # m (x v_y - y v_x) of the middle, and I w of the spin
    moments = run.column("L_Nms")[2:]
    assert moments[0] == pytest.approx(2 * (-0.2 - 0.5 * 0.3) + 2 / 12 * (4 + 1) * 0.6, rel=1e-9)
    assert moments == pytest.approx(moments[0], rel=1e-10)
    assert np.ptp(total(run)) < 1e-8 * run.column("K_J").max()


def cube(comm=MPI.COMM_SELF):
    mesh = dea.read_gmsh(BoxStack(1.0, 1.0, [Layer("film", 1.0)], divisions=(1, 1)), comm)
    return dea.Scene(mesh, {"film": rubber()}, [dea.Electrode("top", 0.3), dea.Ground("bottom")],
                     supports=[dea.FreeBody()], kinematics=dea.ThreeD())  # fmt: skip


def tumbling(x):
    return np.cross([0.3, 1.0, 0.5], (x.T - 0.5)).T + np.array([[0.1], [0.0], [0.0]])


def test_a_free_body_in_space():
    run = marched(cube(), 2.0, 10, ENERGIES | MOMENTA | SPACE, velocity=tumbling)
    due = {"px_Ns": 0.1, "py_Ns": 0.0, "L_Nms": 0.5 / 6 - 0.05, "Lx_Nms": 0.05,
           "Ly_Nms": 1 / 6 + 0.05}  # fmt: skip
    for name, value in due.items():
        assert run.column(name)[2:] == pytest.approx(value, abs=1e-10), name
    assert np.ptp(total(run)) < 1e-9 * run.column("K_J").max()


def test_a_rigid_spin():
    """A square that spins for a whole turn."""
    rate = 0.1

    def turn(x):
        return np.stack([-rate * (x[1] - 0.5), rate * (x[0] - 0.5)])

    record = {
        "L": dea.AngularMomentum(), "K": dea.KineticEnergy(), "W": dea.Energy("elastic"),
        "x": dea.AtPoint((1.0, 0.5), "displacement", "x"),
    }  # fmt: skip
    run = marched(strip(cells=(1, 1), length=1.0), 2 * np.pi / rate, 60, record, velocity=turn)
    moments = run.column("L_Nms")[1:]
    assert moments == pytest.approx(rate / 6, rel=1e-9)
    assert np.ptp((run.column("K_J") + run.column("W_J"))[1:]) < 1e-9 * run["K_J"]
    assert run["x_m"] == pytest.approx(0.0, abs=0.02)


@pytest.fixture(scope="module")
def refined():
    """The thick sphere under a pressure that is switched on, with steps that are halved."""
    record = {
        "a": dea.AtPoint((1.0, 0.0), "displacement", "r"), "K": dea.KineticEnergy(),
        "p": dea.AtPoint((1.1, 0.0), "pressure"), "W": dea.Energy("elastic"),
    }  # fmt: skip
    scene = sphere(pressure=0.05, cells=(1, 2))
    return [marched(scene, 0.8, n, record, {"load": 1.0}) for n in (10, 20, 40)]


@pytest.mark.parametrize("column", ["a_m", "K_J", "p_Pa"])
def test_second_order_in_displacement_velocity_and_pressure(refined, column):
    coarse, middle, fine = (run[column] for run in refined)
    assert 3.3 < (coarse - middle) / (middle - fine) < 4.7


def test_the_pressure_does_not_oscillate(refined):
    p = refined[1].column("p_Pa")[2:]
    assert np.abs(np.diff(p, 3)).max() < 0.02 * np.ptp(p)


def test_the_sum_with_the_work_of_a_pressure(refined):
    """K + W = P (V - V_0) inside the wall, with V = 2/3 pi a^3 of the half sphere."""
    run = refined[0]
    a = 1 + run.column("a_m")[2:]
    sums = (run.column("K_J") + run.column("W_J"))[2:]
    work = 0.05 * 2 / 3 * np.pi * (a**3 - 1)
    # the inner surface is no exact sphere, and so is its volume
    assert sums == pytest.approx(work, rel=3e-3)


def test_steps_by_their_estimated_error():
    march = dea.March(1.2, {"load": 1.0}, inertia=dea.Inertia(scheme=SCHEME, tolerance=1e-6))
    record = {"a": dea.AtPoint((1.0, 0.0), "displacement", "r")}
    run = dea.solve(sphere(pressure=0.05, cells=(2, 4)), march, record, quiet=True)
    assert 1 + run.column("a_m").max() == pytest.approx(1.06723011, rel=1e-4)


def test_with_layers_of_both_kinds_and_a_drag():
    """Beside a compressible layer the energy stays, and a drag takes some in each step."""
    stack = BoxStack(4.0, None, [Layer("film", 0.5), Layer("foam", 0.5)], divisions=(2,))
    scene = dea.Scene(
        dea.read_gmsh(stack, MPI.COMM_SELF),
        {"film": rubber(), "foam": rubber(bulk_modulus=3.0)}, supports=[*CLAMPED],
        electrodes=[dea.Electrode("top", 0.1), dea.Ground("bottom")],
        kinematics=dea.PlaneStrain(),
    )  # fmt: skip
    run = marched(scene, 10.0, 20, ENERGIES)
    assert np.ptp(total(run)) < 1e-8 * run.column("K_J").max()
    run = marched(scene, 10.0, 20, ENERGIES, drag=0.3)
    assert np.all(np.diff(total(run)) < 0)


def test_carried_on():
    """A march that goes on from another run is the march that was never stopped."""
    scene, record = free_strip(), ENERGIES | MOMENTA
    whole = marched(scene, 2.0, 8, record, velocity=spin)
    first = marched(scene, 1.0, 4, record, velocity=spin)
    march = dea.March(1.0, {"voltage": 1.0}, steps=4, inertia=dea.Inertia(scheme=SCHEME))
    more = dea.solve(scene, march, record, quiet=True, start=first)
    assert more["W_J"] == pytest.approx(whole["W_J"], rel=1e-8)
    assert more["L_Nms"] == pytest.approx(whole["L_Nms"], rel=1e-9)


HEAVY = {"kilograms": 1.5, "moments": 0.4}


def with_rigid_end(comm=MPI.COMM_SELF, supports=(), **changes):
    """A short strip whose end is rigid and carries a body."""
    given = [*(supports or [dea.FreeBody()]), dea.Rigid("x_max", **HEAVY)]
    return strip(0.3, given, cells=(2, 1), length=2.0, comm=comm, **changes)


def test_a_free_body_with_a_rigid_end():
    """It flies, turns by several radians and swings; nothing of the three is lost."""
    run = marched(with_rigid_end(), 6.0, 60, ENERGIES | MOMENTA, velocity=spin)
    assert np.ptp(total(run)) < 1e-8 * run.column("K_J").max()
    for name in ("px_Ns", "py_Ns", "L_Nms"):
        found = run.column(name)[2:]
        assert found == pytest.approx(found[0], rel=1e-9), name
    assert run.column("newton_iterations").max() <= 10


def test_a_free_body_with_a_rigid_end_in_space():
    """It turns about all three axes, and the attached body has three different moments."""
    device = dea.device(BoxStack(2.0, 0.5, [Layer("film", 0.5)], divisions=(2, 1)), MPI.COMM_SELF)
    end = dea.Rigid("x_max", kilograms=0.6, moments=(0.2, 0.3, 0.25))
    scene = dea.Scene(device, {"film": rubber()}, supports=[dea.FreeBody(), end])

    def tumbling(x):
        shear = 0.2 * np.sin(x[0])
        return np.stack([
            0.1 + 0.4 * x[2] - 0.5 * x[1], 0.5 * x[0] - 0.3 * x[2], 0.3 * x[1] - 0.4 * x[0] + shear
        ])  # fmt: skip

    record = {"K": dea.KineticEnergy(), "W": dea.Energy("elastic"),
              **{f"L{axis}": dea.AngularMomentum(axis) for axis in "xyz"}}  # fmt: skip
    run = marched(scene, 4.0, 20, record, velocity=tumbling)
    energy = (run.column("K_J") + run.column("W_J"))[1:]
    assert np.ptp(energy) < 1e-10 * run.column("K_J").max()
    for axis in "xyz":
        found = run.column(f"L{axis}_Nms")[1:]
        assert np.ptp(found) < 1e-10 * np.abs(found).max(), axis


def test_a_rigid_end_beside_the_other_scheme():
    """Both schemes are of second order, so that they meet."""
    tip = {"a": dea.PartRotation("x_max"), "y": dea.PartDisplacement("x_max", "y")}
    scene = with_rigid_end(
        supports=[dea.Clamp("x_min")], loads=[dea.Force("x_max", (0.0, 0.02))]
    )
    found = []
    for steps in (20, 40):
        drive = {"voltage": 1.0, "load": dea.Rise(1.0, 2.0)}
        run = marched(scene, 8.0, steps, tip, drive=drive)
        found.append([run["a_rad"], run["y_m"]])
    fine = dea.March(8.0, drive, steps=160, inertia=dea.Inertia(0.9))
    run = dea.solve(scene, fine, tip, quiet=True, stability="never", failures=())
    known = np.array([run["a_rad"], run["y_m"]])
    off = [np.abs(np.array(f) - known).max() for f in found]
    assert off[1] < 0.35 * off[0] and off[1] < 0.02 * np.abs(known).max()


def test_what_is_refused():
    scene = strip(supports=[*CLAMPED], materials={"film": rubber((dea.Maxwell(1.0, 1.0),))})
    with pytest.raises(dea.InputError, match="not available with viscous branches"):
        marched(scene, 1.0, 2, {})
    turned = [dea.Moment("x_max", 1.0)]
    rigid = strip(supports=[dea.Clamp("x_min"), dea.Rigid("x_max")], loads=turned)
    with pytest.raises(dea.InputError, match="not available with moments on rigid parts"):
        marched(rigid, 1.0, 2, {})
    with pytest.raises(dea.InputError, match="one of generalised-alpha, energy-conserving"):
        dea.solve(rigid, dea.March(1.0, inertia=dea.Inertia(scheme="exact")), quiet=True)


def on_these_ranks(comm):
    """Two cells or one, so that ranks hold one or none each."""
    run = marched(free_strip(comm=comm), 1.0, 3, ENERGIES | MOMENTA, velocity=spin)
    part = marched(with_rigid_end(comm), 1.0, 3, ENERGIES | MOMENTA, velocity=spin)
    return [found[name] for found in (run, part) for name in ("K_J", "W_J", "px_Ns", "L_Nms")]


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_ranks(on_ranks, ranks):
    alone = on_these_ranks(MPI.COMM_SELF)
    assert on_ranks("test_energy_conserving", "on_these_ranks", ranks) == pytest.approx(
        alone, rel=1e-8
    )
