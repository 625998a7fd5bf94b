"""Features together: rigid parts, springs, contact, weight and inertia, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import block
from mpi4py import MPI
from test_cavity_closed import PLANES

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, HollowSphere, Layer
from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.run import reuse

pytestmark = pytest.mark.usefixtures("quick_compile")

MU, H, DEPTH, RHO = 5e4, 1e-3, 2e-3, 1200.0
MASS = RHO * H * H * DEPTH
TIGHT = dea.NewtonOptions(tolerance=1e-12)
PLANE = dea.PlaneStrain(DEPTH)


def film(modulus=MU, density=RHO):
    return dea.Material(dea.NeoHookean(modulus), density=density)


def scene(device, *supports, modulus=MU, **given):
    return dea.Scene(device, {"film": film(modulus)}, supports=supports, kinematics=PLANE, **given)


def solve(told, record, path=None, **options):
    chosen = {"options": TIGHT, "quiet": True} | options
    return dea.solve(told, dea.Ramp(steps=1) if path is None else path, record, **chosen)


# ------------------------------------------------------------------ one run after another


def test_a_function_that_reads_a_variable_is_read_again():
    """The force law is the same object in both runs, and its stiffness is another one."""
    device, stiffness = block((1, 1)), {"k": 30.0}
    law = lambda d: stiffness["k"] * d  # noqa: E731

    def force_and_place():
        told = scene(
            device, dea.Fix("x_min", "x"), dea.Fix("bottom", "y"), dea.Rigid("x_max", turns=""),
            dea.Spring("x_max", law, "x"), loads=[dea.Force("x_max", (0.05, 0.0))],
        )  # fmt: skip
        run = solve(told, {"u": dea.PartDisplacement("x_max", "x"),
                           "R": dea.Reaction("x_min", "x")})  # fmt: skip
        return float(run["R_N"]), float(run["u_m"])

    for k in (30.0, 60.0):
        stiffness["k"] = k
        force, place = force_and_place()
        assert force == pytest.approx(k * place - 0.05, rel=1e-10)


def test_a_contact_after_another_modulus():
    """The pressure of single points depends on the modulus, too, where the mesh is coarse."""
    device, found = block((2, 2)), []
    reuse.clear()
    for modulus in (4 * MU, MU, None, MU):
        if modulus is None:
            reuse.clear()
            continue
        obstacle = dea.Obstacle("top", dea.Cylinder((0, 1.5 * H), None, 0.49 * H),
                                displacement=(0, -0.05 * H), tolerance=H)  # fmt: skip
        told = scene(device, dea.Fix("x_min", "x"), dea.Clamp("bottom"), obstacle, modulus=modulus)
        run = solve(told, {"f": dea.ContactForce("top", "y")}, dea.Ramp("obstacle", steps=1))
        found.append(float(run["f_N"]))
    assert found[1] < 0
    assert found[1] == pytest.approx(found[2], rel=1e-9)


# ------------------------------------------------------------------ inertia

HERTZ = 100.0
OMEGA = 2 * np.pi * HERTZ


def swing(told, name, steps=10):
    march = dea.March(0.15 / HERTZ, {name: dea.Sine(HERTZ)}, steps=steps, inertia=dea.Inertia())
    run = solve(told, {"K": dea.KineticEnergy()}, march, options=None)
    return run.column("time_s")[1:], run.column("K_J")[1:]


@pytest.mark.parametrize("kind", ["turn", "shift"])
def test_a_rigid_region_that_is_moved_has_its_velocity_at_once(kind):
    """A sine has its largest velocity at the start: m v^2/2, or I w^2/2 with I = m h^2/6."""
    if kind == "turn":
        inertia, amount = MASS * H**2 / 6, 1.5
        told = scene(block((2, 2)), dea.Rigid("film", held="xy"),
                     prescribed=[dea.Turn("film", amount, "move")])  # fmt: skip
    else:
        inertia, amount = MASS, 0.1 * H
        told = scene(block((2, 2)), dea.Rigid("film", held="y", turns=""),
                     prescribed=[dea.Displacement("film", "x", amount, "move")])  # fmt: skip
    t, energy = swing(told, "move")
    exact = inertia / 2 * (amount * OMEGA * np.cos(OMEGA * t)) ** 2
    assert energy == pytest.approx(exact, rel=2e-2)


def test_a_body_follows_an_end_that_moves_at_once():
    """A block between rollers: x = l X and y = Y/l, nearly, for a slow motion.

    An end that starts with a velocity gives the whole body one that keeps the volume.
    """
    told = scene(
        block((2, 2)), dea.Fix("x_min", "x"), dea.Fix("bottom", "y"),
        prescribed=[dea.Displacement("x_max", "x", 0.1 * H, "move")],
    )  # fmt: skip
    t, energy = swing(told, "move")
    stretch, rate = 1 + 0.1 * np.sin(OMEGA * t), 0.1 * OMEGA * np.cos(OMEGA * t)
    exact = MASS * H**2 / 6 * (rate**2 + (rate / stretch**2) ** 2)
    assert energy == pytest.approx(exact, rel=0.35)


def test_modes_of_a_rigid_region():
    """A light film under a heavy rigid lid that a spring holds as well: omega^2 = k/m."""
    stack = BoxStack(H, None, [Layer("film", H), Layer("lid", H)], divisions=(2,))
    told = dea.Scene(
        dea.read_gmsh(stack, MPI.COMM_SELF), {"film": film(density=1e-3), "lid": film()},
        supports=[dea.Clamp("bottom"), dea.Rigid("lid", turns=""), dea.Spring("lid", 200.0, "x")],
        loads=[dea.Force("lid", (1e-3, 0.0))], kinematics=PLANE,
    )  # fmt: skip
    record = {"u": dea.PartDisplacement("lid", "x")}
    run = solve(told, record)
    answer = dea.frequency_response(run, [0.0, 20.0], record=record)["u_m"]
    k = 1e-3 / answer[0].real
    assert k > 200
    assert answer[1] == pytest.approx(1e-3 / (k - MASS * (40 * np.pi) ** 2), rel=1e-5)
    modes = dea.modes(run, 1)
    assert modes.frequencies[0] == pytest.approx(np.sqrt(k / MASS) / (2 * np.pi), rel=1e-5)
    assert modes.masses[0] == pytest.approx(MASS, rel=1e-5)


def test_a_motion_that_starts_pressed():
    """A rigid block on a plane is loaded further at once: it stays, and the plane bears all."""
    weight, more = 0.03, 0.02
    told = scene(
        block((2, 2)), dea.Rigid("film", turns="", held="x"), dea.Spring("film", 1.0, "y"),
        dea.Obstacle("bottom", dea.Plane((0, 0), (0, 1)), tolerance=H),
        loads=[dea.Force("film", (0.0, -weight)), dea.Force("film", (0.0, -more), ramp="jump")],
    )  # fmt: skip
    path = [dea.Ramp("load", steps=1),
            dea.March(1e-3, {"jump": lambda t: 1.0}, steps=4, inertia=dea.Inertia())]
    run = solve(told, {"f": dea.ContactForce("bottom", "y"), "K": dea.KineticEnergy()}, path,
                options=None)  # fmt: skip
    assert run.column("f_N")[-4:] == pytest.approx(weight + more, rel=1e-6)
    assert np.all(run.column("K_J")[-4:] < 1e-9 * weight * H)


# ------------------------------------------------------------------ held by springs


def test_a_spring_holds_a_device():
    told = scene(
        block((1, 1)), dea.Rigid("x_min", held="y", turns=""), dea.Spring("x_min", 30.0, "x"),
        loads=[dea.DeadLoad("x_max", (100.0, 0.0))],
    )  # fmt: skip
    run = solve(told, {"u": dea.PartDisplacement("x_min", "x")})
    assert run["u_m"] == pytest.approx(100 * H * DEPTH / 30, rel=1e-10)
    assert run["inertia"] == 0
    loose = scene(block((1, 1)), dea.Rigid("x_min", held="y", turns=""),
                  dea.Spring("x_min", dea.CubicLaw(0.0, 1e8), "x"))  # fmt: skip
    with pytest.raises(dea.InputError, match="freely: translation along x"):
        solve(loose, {}, dea.March(1.0, {}))


def test_a_foundation_holds_a_device_and_a_free_body():
    """On a bed the block sinks by p/k.  It overturns, as p h > k h^2/12.

    Where a bed holds one end of a pulled bar, this end does not move in the mean.
    """
    record = {"a": dea.MeanDisplacement("bottom", "y"), "b": dea.MeanDisplacement("x_min", "x")}
    bed = scene(block((1, 1)), dea.ElasticFoundation("bottom", 1e6),
                loads=[dea.DeadLoad("top", (0.0, -100.0))])  # fmt: skip
    run = solve(bed, record)
    assert run["a_m"] == pytest.approx(-100 / 1e6, rel=1e-9)
    assert run["inertia"] == 1
    pulled = scene(
        block((2, 2)), dea.FreeBody(), dea.ElasticFoundation("x_min", 1e7),
        loads=[dea.DeadLoad("x_max", (1e4, 0.0)), dea.DeadLoad("x_min", (-1e4, 0.0))],
    )  # fmt: skip
    assert abs(solve(pulled, record)["b_m"]) < 1e-12 * H


# ------------------------------------------------------------------ what supports bear


@pytest.mark.parametrize("part", ["half", "octant"])
def test_a_plane_of_symmetry_bears_the_pressure_of_a_cavity_on_the_wall(part):
    """It is that of a follower pressure: about p pi a^2, or a quarter of it."""
    a, kinematics = 1e-2, dea.Axisymmetric() if part == "half" else dea.ThreeD()
    device = dea.read_gmsh(HollowSphere(a, 1.2 * a, part, 1, 4), MPI.COMM_SELF)
    where = "equator" if part == "half" else "z_min"
    found = []
    for load in (dea.FollowerPressure("inner", 1e3), dea.Cavity("inner", pressure=1e3)):
        told = dea.Scene(device, {"wall": film(1e5)}, supports=PLANES[part], loads=[load],
                         kinematics=kinematics)  # fmt: skip
        found.append(float(solve(told, {"R": dea.Reaction(where, "z")})["R_N"]))
    assert found[1] == pytest.approx(found[0], rel=1e-9)
    share = 1.0 if part == "half" else 0.25
    assert found[1] == pytest.approx(-share * 1e3 * np.pi * a**2, rel=2e-2)


def test_a_rigid_cup_in_a_half_ball():
    """All that acts on the cup along z goes into the plane that cuts it: p pi a^2 exactly."""
    a = 1e-2
    device = dea.read_gmsh(HollowSphere(a, 1.2 * a, "half", 1, 4), MPI.COMM_SELF)
    told = dea.Scene(device, {"wall": film()}, supports=[*PLANES["half"], dea.Rigid("inner")],
                     loads=[dea.Cavity("inner", pressure=1e3)],
                     kinematics=dea.Axisymmetric())  # fmt: skip
    run = solve(told, {"R": dea.Reaction("equator", "z"), "F": dea.PartForce("inner", "z")})
    assert run["F_N"] == pytest.approx(-1e3 * np.pi * a**2, rel=1e-9)
    assert run["R_N"] == pytest.approx(run["F_N"], rel=1e-9)


def test_weight_contact_springs_and_a_cut_rigid_part_balance():
    """The plane of symmetry below bears what also acts on the rigid end that it cuts."""
    weight = 1000 * 9.81 * MASS
    told = scene(
        block((2, 2)), dea.Fix("x_min", "x"), dea.Fix("bottom", "y"),
        dea.Rigid("x_max", turns=""), dea.Spring("x_max", 30.0, "x"),
        dea.Obstacle("top", dea.Plane((0, H), (0, -1)), displacement=(0, -0.05 * H), tolerance=H),
        loads=[dea.Force("x_max", (0.02, 0.0)), dea.Gravity((0.0, -9810.0))],
    )  # fmt: skip
    run = solve(
        told,
        {"u": dea.PartDisplacement("x_max", "x"), "x": dea.Reaction("x_min", "x"),
         "y": dea.Reaction("bottom", "y"), "f": dea.ContactForce("top", "y")},
        [dea.Ramp(steps=1), dea.Ramp("obstacle", steps=1)],
    )  # fmt: skip
    assert run["f_N"] < 0
    assert run["y_N"] + run["f_N"] == pytest.approx(weight, rel=1e-9)
    assert run["x_N"] + 0.02 == pytest.approx(30 * run["u_m"], rel=1e-9)


# ------------------------------------------------------------------ air


def test_a_film_under_air_has_its_own_weight_and_centre():
    """Air without a density weighs nothing, and has no part in the centre of mass."""
    stack = BoxStack(H, None, [Layer("film", H), Layer("gap", H)], divisions=(2,))
    told = dea.Scene(
        dea.read_gmsh(stack, MPI.COMM_SELF), {"film": film(), "gap": dea.Air()},
        supports=[dea.Fix("bottom", "y"), dea.Fix("x_min", "x"), dea.Fix("x_max", "x")],
        loads=[dea.Gravity((0.0, -98.1))], kinematics=PLANE,
    )  # fmt: skip
    run = solve(told, {"R": dea.Reaction("bottom", "y"), "c": dea.CentreOfMass("y")})
    assert run["R_N"] == pytest.approx(98.1 * MASS, rel=1e-9)
    assert run["c_m"] == pytest.approx(H / 2, rel=1e-9)


def test_air_repeats_beside_a_film():
    """Film and air in series between held plates: C = eps0 l H b/(H/(3 l) + 2 H - H/l)."""
    stack = BoxStack(H, None, [Layer("film", H), Layer("gap", H)], divisions=(2,))
    rubber = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(3.0))
    told = dea.Scene(
        dea.read_gmsh(stack, MPI.COMM_SELF), {"film": rubber, "gap": dea.Air()},
        [dea.Electrode("top", 4e3), dea.Ground("bottom")], kinematics=PLANE,
        supports=[dea.Fix("bottom", "y"), dea.Fix("top", "y"), dea.Fix("x_min", "x"),
                  dea.Periodic("x_min", "x_max")],
    )  # fmt: skip
    run = solve(told, {"w": dea.MeanDisplacement("x_max", "x"), "Q": dea.Charge("top")},
                dea.Ramp("voltage", steps=1))  # fmt: skip
    stretch = 1 + run["w_m"] / H
    gap = H / (3 * stretch) + 2 * H - H / stretch
    capacitance = EPSILON_0 * stretch * H * DEPTH / gap
    assert stretch == pytest.approx(1.00013285, abs=1e-7)  # the smallest energy of both layers
    assert run["Q_C"] == pytest.approx(capacitance * 4e3, rel=1e-9)
