"""Layers that bend: closed forms against one another, then finite elements against them."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import block
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.exact import Film, Laminate, Ply, stoney_curvature, timoshenko_curvature, trace
from dea_fenicsx.geometry import DEAHinge
from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.measure.rotation import Rotation
from dea_fenicsx.model.problem import Problem

MU, EPS_R, T = 73.7e3, 4.7, 50e-6
RUBBER = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(EPS_R))
PASSIVE = dea.Material(dea.NeoHookean(MU))
STIFF = dea.Material(dea.NeoHookean(3 * MU))
pytestmark = pytest.mark.usefixtures("quick_compile")


# ---- closed forms ------------------------------------------------------------------------------


@pytest.mark.parametrize("ratio", [0.1, 1.0, 4.0])
def test_two_layers_in_plane_strain_are_timoshenkos(ratio):
    """His beam has the moduli E = 3 mu; held across they are 4 mu, which leaves their ratio."""
    plies = [Ply(STIFF, ratio * T), Ply(RUBBER, T, driven=True)]
    strain = plies[1].push(100.0) / (4 * MU)
    exact = timoshenko_curvature(strain, (ratio * T, T), (12 * MU, 4 * MU))
    assert Laminate(plies).curvature(100.0) == pytest.approx(exact, rel=1e-12)


def test_layers_with_electrostriction_act_as_the_film_does():
    """An incompressible film acts as one of eps_r - a1/2 (Landau and Lifshitz)."""
    changing = dea.Material(dea.NeoHookean(MU), dea.Electrostriction(EPS_R, 1.2, 0.7))
    same = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(EPS_R - 0.6))
    found = [
        Laminate([Ply(STIFF, T), Ply(rubber, T, driven=True)], "free").curvature(200.0)
        for rubber in (changing, same)
    ]  # fmt: skip
    assert found[0] == pytest.approx(found[1], rel=1e-12)


def test_layers_that_saturate_push_with_the_displacement():
    """p = D E of the dielectric, which is less than eps E^2."""
    law = dea.SaturatingDielectric(EPS_R, 1e-3)
    ply = Ply(dea.Material(dea.NeoHookean(MU), law), T, driven=True)
    volts = np.array([100.0, 4e3])
    D = 1e-3 * np.tanh(EPS_R * EPSILON_0 * volts / T / 1e-3)
    assert ply.push(volts) == pytest.approx(D * volts / T, rel=1e-10)
    with pytest.raises(dea.InputError, match="take stress="):
        ply.push(100.0, "pressure")


@pytest.mark.parametrize("across, modulus", [("held", 4 * 3 * MU), ("free", 6 * 3 * MU)])
def test_a_thin_layer_is_stoneys(across, modulus):
    """To first order in the thickness ratio: E/(1 - nu^2) = 4 mu held, E/(1 - nu) = 6 mu free."""
    errors = []
    for ratio in (1e-3, 1e-4):
        layer = Ply(RUBBER, ratio * T, driven=True)
        found = Laminate([Ply(STIFF, T), layer], across).curvature(1.0)
        exact = stoney_curvature(layer.push(1.0) * ratio * T, T, modulus)
        errors.append(abs(found / exact - 1))
    assert errors[1] < 1e-3
    assert errors[1] == pytest.approx(errors[0] / 10, rel=0.1)


def test_a_symmetric_stack_does_not_bend():
    plies = [Ply(RUBBER, T, driven=True), Ply(STIFF, T / 5), Ply(RUBBER, T, driven=True)]
    for across in ("held", "uniform", "free"):
        strains = Laminate(plies, across).strains([50.0, 100.0])
        assert np.abs(strains[[1, 3]]).max() * T < 1e-12 * strains[0].max()
    assert strains[0, 1] == pytest.approx(4 * strains[0, 0], rel=1e-12)


@pytest.mark.parametrize("name", ["G-K", "C10-D1"])
@pytest.mark.parametrize("stress", ["field", "pressure"])
def test_one_layer_is_the_exact_film_at_small_voltage(name, stress):
    material = dea.materials.get(f"vhb-thesis-table-5-2-{name}")
    state, _ = trace(Film(material, T, stress=stress)).states_at(1.0)[0]
    strain = Laminate([Ply(material, T, driven=True)], "free", stress).strains(1.0)[0]
    # the strain itself is 1e-7: what rounding leaves of the exact stretch
    assert strain == pytest.approx(state.stretches[0] - 1, rel=1e-5)


def test_blocked_force():
    """Held across eps E^2 for each driven thickness; free across a half of it, as s_y is 0."""
    maxwell = EPS_R * EPSILON_0 * (300.0 / T) ** 2
    plies = [Ply(RUBBER, T, driven=True), Ply(RUBBER, T, driven=True)]
    force, moment = Laminate(plies).blocked(300.0)
    assert (force, moment) == pytest.approx((2 * T * maxwell, 2 * T * maxwell * T), rel=1e-12)
    assert Laminate(plies, "uniform").blocked(300.0)[0] == pytest.approx(force / 2, rel=1e-12)
    # what holds the strain and curvature is what undoes them
    two = Laminate([Ply(STIFF, T), Ply(RUBBER, T, driven=True)])
    _, kappa = two.strains(300.0)[:2]
    force, moment = two.blocked(300.0)
    K = two._stiffness()[:2, :2]
    neutral = K[0, 1] / K[0, 0]
    assert (moment - neutral * force) / kappa == pytest.approx(two.bending_stiffness, rel=1e-12)


@pytest.mark.parametrize("make, words", [
    (lambda: Laminate([]), "no plies"),
    (lambda: Laminate([Ply(RUBBER, T)], "loose"), "across is 'loose'"),
    (lambda: Laminate([Ply(RUBBER, T)], stress="force"), "stress is 'force'"),
    (lambda: Ply(RUBBER, -T), "must be positive"),
    (lambda: Ply(PASSIVE, T, driven=True), "must be dielectric"),
    (lambda: Ply(dea.Material(dea.NeoHookean(-1.0)), T), "mu"),
])  # fmt: skip
def test_refuses(make, words):
    with pytest.raises(dea.InputError, match=words) as caught:
        make()
    assert str(caught.value).endswith(".") and "\n" not in str(caught.value)


# ---- generalised plane strain and rotation in a plane ------------------------------------------


def slice_(volts=0.0, **more):
    """A slice of film: its axes x and z are alike."""
    return dea.Scene(
        block((2, 1), size=T), {"film": RUBBER},
        electrodes=[dea.Electrode("top", volts), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "x"), dea.Fix("bottom", "y")],
        kinematics=dea.GeneralisedPlaneStrain(2 * T), **more,
    )  # fmt: skip


WHOLE = {"across": dea.OverallStretch(), "force": dea.OverallForce(),
         "along": dea.MeanStretch(("x_min", "x_max"), "x")}  # fmt: skip


def test_a_slice_is_the_exact_film():
    """Both stretches in the plane are the same; held across, the force is s_z of a held film."""
    exact = trace(Film(RUBBER, T))
    volts = 0.9 * exact.event("pull-in").voltage
    run = dea.solve(slice_(volts), dea.Ramp(steps=6), WHOLE, quiet=True)
    state, _ = exact.states_at(volts)[0]
    assert (run["along"], run["across"]) == pytest.approx(state.stretches[:2], rel=1e-8)
    assert run.summary["stable"] is True
    assert abs(run["force_N"]) < 1e-9 * MU * T * T

    held = slice_(volts, prescribed=[dea.AxialStretch(1.1)])
    run = dea.solve(held, [dea.Ramp("stretch", steps=2), dea.Ramp("voltage", steps=4)], WHOLE,
                    quiet=True, stability="never")  # fmt: skip
    state, _ = trace(Film(RUBBER, T, second=dea.exact.Held(1.1))).states_at(volts)[0]
    assert run["along"] == pytest.approx(state.stretches[0], rel=1e-8)
    force = state.stress[1] * state.stretches[0] * state.stretches[2] * T * T
    assert run["force_N"] == pytest.approx(force, rel=1e-7)

    pulled = slice_(volts, loads=[dea.AxialForce(run["force_N"])])
    again = dea.solve(pulled, [dea.Ramp("load", steps=2), dea.Ramp("voltage", steps=4)], WHOLE,
                      quiet=True, stability="never")  # fmt: skip
    assert again["across"] == pytest.approx(1.1, rel=1e-7)


@pytest.mark.parametrize("angle", [1e-9, 0.3, 2.5])
def test_rigid_rotation_in_a_plane_is_exact(angle):
    scene = dea.Scene(block((1, 1)), {"film": PASSIVE}, supports=[dea.Clamp("bottom")],
                      kinematics=dea.PlaneStrain())  # fmt: skip
    problem = Problem(scene)
    c, s = np.cos(angle), np.sin(angle)
    for a, part in enumerate(problem.displacement):
        x = part.space.tabulate_dof_coordinates()[:, :2]
        problem.w.x.array[part.dofs] = (x @ np.array([[c, s], [-s, c]]) - x)[:, a] + 0.3
    for face in ("top", "x_max"):
        assert Rotation(face, "z").bind(problem)() == pytest.approx(angle, rel=1e-12)
        assert Rotation(face, "x").bind(problem)() == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("more, words", [
    (dict(prescribed=[dea.Twist(1.0)]), "helical cells"),
    (dict(loads=[dea.Torque(1.0)]), "helical cells"),
    (dict(loads=[dea.FollowerPressure("x_max", 1.0)]), "generalised plane strain"),
    (dict(prescribed=[dea.AxialStretch(0.0)]), "must be > 0"),
])  # fmt: skip
def test_a_slice_refuses(more, words):
    with pytest.raises(dea.InputError, match=words):
        slice_(**more)
    with pytest.raises(dea.InputError, match="depth of GeneralisedPlaneStrain"):
        dea.Scene(block((1, 1)), {"film": PASSIVE}, supports=[dea.Clamp("bottom")],
                  kinematics=dea.GeneralisedPlaneStrain(-1.0))  # fmt: skip
    with pytest.raises(dea.InputError, match="helical cells"):
        Problem(slice_(1.0)) and dea.OverallTwist().bind(Problem(slice_(1.0)))


# ---- the hinge ---------------------------------------------------------------------------------

PETG = dea.Material(dea.NeoHookean(1.9e9 / 2.76), None, 2.6e9)
SOFT = dea.Material(dea.NeoHookean(MU), dea.Conductor())


def hinge(volts=0.0, kinematics=None, shape=None, **more):
    """The thin region with short thick ends; films, electrodes and cover are equally soft."""
    shape = shape or DEAHinge(thick=0.5e-3, cells=(3, 3))
    layers = [f"electrode_{k}" for k in range(1, 5)]
    films = [f"film_{k}" for k in range(1, 4)]
    if volts:
        more["electrodes"] = [dea.Electrode(tuple(layers[1::2]), volts),
                              dea.Ground(tuple(layers[::2]))]  # fmt: skip
    return dea.Scene(
        dea.read_gmsh(shape, MPI.COMM_SELF),
        {"sheet": PETG, "cover": PASSIVE} | dict.fromkeys(layers, SOFT)
        | dict.fromkeys(films, RUBBER),
        supports=more.pop("supports", [dea.Clamp("x_min")]),
        kinematics=kinematics or dea.PlaneStrain(1e-2), **more,
    )  # fmt: skip


def layers_of_hinge(across="held", stress="field"):
    plies = [Ply(PETG, 10e-6), Ply(PASSIVE, 10e-6)]
    for _ in range(3):
        plies += [Ply(RUBBER, T, driven=True), Ply(PASSIVE, 10e-6)]
    return Laminate([*plies, Ply(PASSIVE, 15e-6)], across, stress)


MIDDLE = {"middle": dea.Rotation(("section_1", "section_3"), "z")}


@pytest.mark.parametrize("across, kinematics", [
    ("held", dea.PlaneStrain(1e-2)), ("uniform", dea.GeneralisedPlaneStrain(1e-2)),
])  # fmt: skip
def test_hinge_bends_as_the_layers_say(across, kinematics):
    """Curvature of the middle half of the thin region at small voltage: 0.02 % (1 % asked)."""
    run = dea.solve(hinge(30.0, kinematics), dea.Ramp(steps=1), MIDDLE, quiet=True)
    exact = float(layers_of_hinge(across).curvature(30.0))
    assert -run["middle_rad"] / 1e-3 == pytest.approx(exact, rel=1e-3)


def test_given_pressure_bends_the_hinge_as_the_layers_say():
    """The field's push is eps E^2; a live pressure on both faces of each film does the same."""
    p = EPS_R * EPSILON_0 * (30.0 / T) ** 2
    press = [dea.FollowerPressure(f"film_{k}_{face}", p, on=f"film_{k}")
             for k in (1, 2, 3) for face in ("bottom", "top")]  # fmt: skip
    run = dea.solve(hinge(loads=press), dea.Ramp(steps=1), MIDDLE, quiet=True)
    exact = float(layers_of_hinge(stress="pressure").curvature(30.0))
    # the resultant p t/R of the two faces adds a share p/p_buckling, about 0.4 %
    assert -run["middle_rad"] / 1e-3 == pytest.approx(exact, rel=8e-3)


def test_blocked_hinge_pushes_with_the_maxwell_stress():
    """eps E^2 times thickness and width: nothing moves, so it is exact (0.1 % asked)."""
    volts, ends = 500.0, [dea.Clamp("x_min"), dea.Clamp("x_max")]
    run = dea.solve(hinge(volts, supports=ends), dea.Ramp(steps=1),
                    {"push": dea.Reaction("x_max", "x")}, quiet=True,
                    # with a factor in single precision Newton leaves 1e-8 of the force at 1e-10
                    options=dea.NewtonOptions(tolerance=1e-12))  # fmt: skip
    exact = EPS_R * EPSILON_0 * (volts / T) ** 2 * 3 * T * 1e-2
    assert -run["push_N"] == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("make, words", [
    (lambda: DEAHinge(sheet_thick=10e-6), "sheet_thick"),
    (lambda: DEAHinge(thin=0.0), "thin is 0.0"),
    (lambda: DEAHinge(films=0), "films is 0"),
    (lambda: DEAHinge(cells=3), "two values"),
    (lambda: DEAHinge(width=-1.0), "width is -1.0"),
    (lambda: hinge(loads=[dea.FollowerPressure("film_1_top", 1.0, on="film")]), "film_1"),
])  # fmt: skip
def test_hinge_refuses(make, words):
    with pytest.raises(dea.InputError, match=words) as caught:
        make()
    assert str(caught.value).endswith(".") and "\n" not in str(caught.value)
