"""Air: capacitances with fringes, contact through air, attraction, the count, and refusals.

Closed forms stand at each test.  All lengths are in m.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import ufl
from mpi4py import MPI
from scipy.optimize import minimize_scalar

import dea_fenicsx as dea
from dea_fenicsx.exact import disc_capacitance, plate_capacitance
from dea_fenicsx.geometry import BoxStack, DiscCapacitor, Layer
from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.terms.air import energy_of_shape, stress_of_shape
from dea_fenicsx.scene.strain import cofactor

MU, KAPPA = 1e5, 5e5
FOAM = dea.Material(dea.NeoHookean(MU), bulk_modulus=KAPPA)
RUBBER = dea.Material(dea.NeoHookean(MU))
LOVE = {2.0: 5.55210894, 0.5: 10.71829922, 0.1: 36.93232194}
"""C/(eps0 a) of two discs at the distance d/a, to nine digits."""


def strip(*layers, length=1e-3, divisions=2, comm=MPI.COMM_SELF):
    return dea.read_gmsh(BoxStack(length, None, layers, divisions=divisions, order=1), comm)


# ------------------------------------------------------------------------------- capacitance


@pytest.mark.parametrize(("distance", "known"), LOVE.items())
def test_love(distance, known):
    assert disc_capacitance(distance) == pytest.approx(known, abs=6e-9)
    assert plate_capacitance(distance) == pytest.approx(np.pi / distance)


def test_discs_far_apart_and_refused():
    """Two discs far apart are in series, 8 eps0 a each, with the first order of their influence."""
    assert disc_capacitance(1e4) == pytest.approx(4 / (1 - 2e-4 / np.pi), rel=1e-7)
    with pytest.raises(dea.InputError, match="distance of the discs"):
        disc_capacitance(0.0)


def capacitance(distance, box=10.0, mesh=1, comm=MPI.COMM_SELF, charge=1e-12, radius=1e-3):
    discs = DiscCapacitor(radius, distance * radius, box * radius).refine(mesh)
    scene = dea.Scene(
        dea.read_gmsh(discs, comm),
        materials={"air": dea.Air()},
        electrodes=[dea.Ground("lower_disc"), dea.ChargedElectrode("upper_disc", charge)],
        kinematics=dea.Axisymmetric(),
    )
    run = dea.solve(
        scene, dea.Ramp("charge", steps=1), quiet=True,
        record={"phi": dea.Potential("upper_disc"), "other": dea.Charge("lower_disc")},
    )  # fmt: skip
    assert run["other_C"] == pytest.approx(-charge, rel=1e-7)
    assert run["min_J"] == 1
    return charge / run["phi_V"] / EPSILON_0 / radius


@pytest.mark.parametrize("distance", LOVE)
def test_capacitance_of_discs(distance):
    assert capacitance(distance) == pytest.approx(LOVE[distance], rel=5e-3)


def test_capacitance_converges_with_the_box():
    """The image of the discs' dipole in the walls falls with the cube of the box."""
    C = [capacitance(2.0, box, mesh=2) for box in (5.0, 10.0, 20.0)]
    steps = np.diff(C)
    assert np.all(steps > 0)
    assert steps[0] / steps[1] == pytest.approx(8, rel=0.15)
    assert C[-1] + steps[1] / 7 == pytest.approx(LOVE[2.0], rel=1e-3)


# ----------------------------------------------------------------------- the shape of the air


def numbers(F):
    F = ufl.as_matrix(F.tolist())
    A, J = cofactor(F)
    return SimpleNamespace(F=F, cofactor=A, J=J)


def test_stress_is_the_derivative_of_the_energy():
    rng = np.random.default_rng(1)
    for size in (0.0, 0.2, 0.4):
        F = np.eye(3) + size * rng.uniform(-1, 1, (3, 3))
        found = stress_of_shape(numbers(F))
        for i, j in np.ndindex(3, 3):
            change = np.zeros((3, 3))
            change[i, j] = 1e-6
            slope = (
                energy_of_shape(numbers(F + change))(()) - energy_of_shape(numbers(F - change))(())
            ) / 2e-6
            assert found[i, j](()) == pytest.approx(slope, abs=1e-7 * (1 + abs(slope)))
    assert energy_of_shape(numbers(np.eye(3)))(()) == pytest.approx(0, abs=1e-15)


def test_a_squeezed_layer_of_air_grows_as_the_square():
    """It does so without pressing outwards at its sides, and its initial shear modulus is 1."""
    thin = [energy_of_shape(numbers(np.diag([1.0, l, 1.0])))(()) for l in (1e-3, 1e-4)]
    assert thin[1] / thin[0] == pytest.approx(100, rel=1e-4)
    stress = [stress_of_shape(numbers(np.diag([1.0, 1e-4, 1.0])))[k, k](()) for k in range(3)]
    assert abs(stress[0]) < 1e-3 * abs(stress[1])
    shear = np.eye(3)
    shear[0, 1] = 1e-4
    assert stress_of_shape(numbers(shear))[0, 1](()) == pytest.approx(1e-4, rel=1e-6)


# ------------------------------------------------------------------------------------ contact


def pressed(material, sides, stiffness, comm=MPI.COMM_SELF):
    """Two equal blocks with a gap of a tenth of their height, pressed by twice the gap."""
    device = strip(
        Layer("lower", 1e-3), Layer("gap", 1e-4, 2), Layer("upper", 1e-3), comm=comm
    )
    scene = dea.Scene(
        device,
        {"lower": material, "upper": material, "gap": dea.Air(stiffness=stiffness)},
        supports=[dea.Fix("bottom", "y"), *(dea.Fix(side, "x") for side in sides)],
        prescribed=[dea.Stretch("top", "y", 1 - 2e-4 / 2.1e-3)],
        kinematics=dea.PlaneStrain(1e-3),
    )
    return dea.solve(scene, dea.Ramp(steps=4), quiet=True, record={
        "force": dea.Reaction("top", "y"), "air": dea.Energy("air"),
        "all": dea.Energy("elastic"), "of_region": dea.Energy("elastic", regions="gap"),
    })  # fmt: skip


STRETCH = 0.95
"""Both blocks shorten by half of U - g."""

BESIDE_WALLS = MU / 2 * (4 / 3 * STRETCH ** (1 / 3) - 4 / 3 * STRETCH ** (-5 / 3)) + KAPPA * (
    STRETCH - 1
)
"""Nominal stress between walls: d/dl of mu/2 (l^(4/3) + 2 l^(-2/3)) + kappa/2 (l - 1)^2."""

FREE = MU * (STRETCH - STRETCH**-3)


@pytest.mark.parametrize(("material", "sides", "exact"), [
    (FOAM, ("x_min", "x_max"), BESIDE_WALLS), (RUBBER, ("x_min",), FREE),
])  # fmt: skip
def test_two_blocks_meet(material, sides, exact):
    """The gap that is left, (a mu/(2 p))^(1/3) g with the stiffness a, is all of the error."""
    run = pressed(material, sides, 1e-11)
    assert run["force_N"] / 1e-6 == pytest.approx(exact, rel=1e-3)
    left = (1e-11 * MU / 2 / -exact) ** (1 / 3)
    assert run["force_N"] / 1e-6 / exact - 1 == pytest.approx(left, rel=0.1)
    assert 0 < run["air_J"] < 1e-3 * run["all_J"]
    assert run["of_region_J"] == pytest.approx(run["air_J"], rel=1e-9)
    assert run["min_J"] > 0.9 and run["inertia"] == 0


def on_all_ranks(comm):
    pressed_by = pressed(FOAM, ("x_min", "x_max"), 1e-9, comm)["force_N"]
    return capacitance(0.5, comm=comm), pressed_by


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_air_on_ranks(on_ranks, ranks):
    found = on_ranks("test_air", "on_all_ranks", ranks)
    assert found == pytest.approx(on_all_ranks(MPI.COMM_SELF), rel=1e-7)


# --------------------------------------------------------------------- attraction and the count


def test_block_pulled_through_a_gap():
    """A block of height H that a bare plate pulls: P(l) = eps0/2 (V/g')^2, g' = g - H (l - 1)."""
    H, g = 1e-3, 2e-4
    # It is narrow, so that no wave of its surface comes before the uniform pull-in.
    device = strip(Layer("block", H), Layer("gap", g, 2), length=1e-4, divisions=1)

    def volts(stretch):
        stress = MU * 2 / 3 * (stretch ** (1 / 3) - stretch ** (-5 / 3)) + KAPPA * (stretch - 1)
        return (g - H * (stretch - 1)) * np.sqrt(2 * stress / EPSILON_0)

    top = minimize_scalar(lambda l: -volts(l), bounds=(1.001, 1.19), method="bounded")
    scene = dea.Scene(
        device, {"block": FOAM, "gap": dea.Air()},
        electrodes=[dea.Electrode("interface_1", 1.2 * -top.fun), dea.Ground("top")],
        supports=[dea.Fix("bottom", "y"), dea.Fix("x_min", "x"), dea.Fix("x_max", "x"),
                  dea.Clamp("top")],
        kinematics=dea.PlaneStrain(),
    )  # fmt: skip
    run = dea.solve(
        scene, dea.Trace("voltage", until=("stretch", 1.12)), quiet=True,
        record={"stretch": dea.MeanStretch(("bottom", "interface_1"), "y")},
    )  # fmt: skip
    stretch, found = run.column("stretch"), run.column("voltage_V")
    assert found == pytest.approx([volts(l) for l in stretch], rel=1e-5, abs=1e-3)
    assert found.max() == pytest.approx(-top.fun, rel=1e-4)
    stable = stretch < top.x - 1e-3
    inertia = run.column("inertia")
    assert np.all(inertia[stable][1:] == 0) and np.all(inertia[stretch > top.x + 1e-3] == 1)


def fringed(stiffness, volts=1.6e4):
    """A film, one half of which lies between bare electrodes, in a box of air."""
    layers = [Layer("below", 5e-4, 2), Layer("film", 5e-4, 2), Layer("above", 5e-4, 2)]
    device = strip(*layers, length=2e-3, divisions=4)
    film = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(3.0))
    air = dea.Air(stiffness=stiffness)
    scene = dea.Scene(
        device, {"film": film, "below": air, "above": air},
        electrodes=[dea.Electrode("interface_2", volts), dea.Ground("bottom")],
        supports=[dea.Clamp("x_min"), dea.Fix("x_max", "xy"), dea.Clamp("bottom"),
                  dea.Clamp("top")],
        kinematics=dea.PlaneStrain(),
    )  # fmt: skip
    return dea.solve(
        scene, dea.Ramp(steps=2), quiet=True, record={
            "move": dea.LargestDisplacement("interface_2", "y"),
            "charge": dea.Charge("interface_2"),
        },
    )  # fmt: skip


def test_air_has_no_modes_of_its_own():
    """Errors of the field's energy are many times the stiffness of the air, and do no harm."""
    soft, stiff = fringed(1e-13), fringed(1e-8)
    for run in (soft, stiff):
        assert np.all(run.column("inertia")[1:] == 0) and run["newton_iterations"] < 15
    assert soft["charge_C"] == pytest.approx(stiff["charge_C"], rel=1e-5)
    assert soft["move_m"] == pytest.approx(stiff["move_m"], rel=1e-3)


# ----------------------------------------------------------------------------- what air is not


def test_scales_and_failures_leave_air_out():
    device = strip(Layer("film", 1e-3), Layer("gap", 1e-3), divisions=1)
    film = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(3.0, breakdown=5e7))
    scene = dea.Scene(
        device, {"film": film, "gap": dea.Air()}, supports=[dea.Clamp("bottom"), dea.Clamp("top")],
        electrodes=[dea.Electrode("interface_1", 100.0), dea.Ground("bottom")],
        kinematics=dea.PlaneStrain(),
    )  # fmt: skip
    problem = Problem(scene)
    assert problem.scales.stress == MU
    assert problem.scales.permittivity == pytest.approx(3 * EPSILON_0)
    assert dea.ElectricalBreakdown().regions_of(scene) == ("film",)
    assert dea.StretchLimit(2.0).regions_of(scene) == ("film",)
    assert dea.LossOfTension("x").regions_of(scene) == ("film",)
    with pytest.raises(dea.InputError, match="'gap', but this region is air"):
        dea.StretchLimit(2.0, ("gap",)).check(scene)
    pressure = problem.pressure.dofs[problem.pressure.space.dofmap.list]
    fixed = problem.conditions.fixed_values.fixed
    assert fixed[pressure[device.cells_of("gap")]].all()
    assert not fixed[pressure[device.cells_of("film")]].any()


def test_bare_electrodes_that_meet_are_a_short_circuit():
    device = strip(Layer("lower", 1e-3, 1), Layer("gap", 1e-4, 1), Layer("upper", 1e-3, 1))

    def run(volts):
        scene = dea.Scene(
            device, {"lower": FOAM, "upper": FOAM, "gap": dea.Air(stiffness=1e-8)},
            electrodes=[dea.Electrode("interface_1", volts, ramp="stretch"),
                        dea.Ground("interface_2")],
            supports=[dea.Fix("bottom", "y"), dea.Fix("x_min", "x"), dea.Fix("x_max", "x")],
            prescribed=[dea.Stretch("top", "y", 0.9)], kinematics=dea.PlaneStrain(),
        )  # fmt: skip
        return dea.solve(scene, dea.Ramp("stretch", steps=4), quiet=True)

    with pytest.raises(dea.SolverError, match="'interface_1' and 'interface_2' of different"):
        run(1e-3)
    assert run(0.0)["stretch_factor"] == 1


# --------------------------------------------------------------------------------- refusals


def refused(match, materials=None, layers=("film", "air"), **changes):
    device = strip(*(Layer(name, 1e-3, 1) for name in layers), divisions=1)
    given = dict(
        materials={"film": RUBBER, "air": dea.Air()}, supports=[dea.Clamp("bottom")],
        kinematics=dea.PlaneStrain(),
    )  # fmt: skip
    if materials is not None:
        given["materials"] = materials
    with pytest.raises(dea.InputError, match=match) as told:
        Problem(dea.Scene(device, **(given | changes)))
    assert len(str(told.value).split(". ")) == 1


def beside(**air):
    return dict(materials={"film": RUBBER, "air": dea.Air(**air)})


AIR = {"film": dea.Air(), "air": dea.Air()}


@pytest.mark.parametrize(("match", "changes"), [
    ("stiffness of the air is 0.0", beside(stiffness=0.0)),
    ("stiffness of the air is 1.0", beside(stiffness=1.0)),
    ("stiffness of the air is nan", beside(stiffness=float("nan"))),
    ("smoothing of the air is -1", beside(smoothing=-1)),
    ("acts on air alone", dict(loads=[dea.DeadLoad("top", (0.0, 1.0))])),
    ("acts on air alone", dict(loads=[dea.FollowerPressure("top", 1.0)])),
    ("this region is air", dict(prescribed=[dea.PreStretch("air", x=2.0, y=0.5)])),
    ("there is nothing to solve|there is no electrode", dict(materials=AIR, supports=[])),
    ("nothing moves", dict(
        materials=AIR, electrodes=[dea.Electrode("top", 1.0), dea.Ground("bottom")],
        prescribed=[dea.Stretch("top", "y", 0.9)])),
    ("can move freely", dict(supports=[dea.Clamp("top")])),
    ("free to move|can move freely", dict(supports=[dea.Fix("bottom", "y"), dea.Clamp("top")])),
])  # fmt: skip
def test_refusals(match, changes):
    refused(match, **changes)


def test_a_part_that_only_air_holds_is_named():
    refused(
        "region film.* can move freely|can move freely.*region film",
        materials={"base": RUBBER, "air": dea.Air(), "film": RUBBER},
        layers=("base", "air", "film"),
    )  # fmt: skip
