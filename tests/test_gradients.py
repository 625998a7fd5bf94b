"""Derivatives of observables and of critical loads, against closed forms and solved neighbours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import block
from mpi4py import MPI
from rank_scenes import helix, hexahedron, ring, split_factor, triangles

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.gradients.variables import Coefficients, LoadVariable, variables
from dea_fenicsx.solvers.newton import NewtonSolver

pytestmark = pytest.mark.usefixtures("quick_compile")
TIGHT = dea.NewtonOptions(tolerance=1e-12)
MU, EPS_R, L, T, STRETCH = 5e4, 3.0, 1e-3, 5e-4, 1.5
FILM = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(EPS_R))
HELD = [dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")]


# --------------------------------------------------------------------------------- closed forms


def pulled_block():
    """A block pulled to a stretch: force mu (lam - 1/lam^2) L T, capacitance eps lam L^2/T."""
    scene = dea.Scene(
        block((2, 1, 1), L, T), {"film": FILM}, [dea.Electrode("top", 1e-3), dea.Ground("bottom")],
        HELD, [dea.Stretch("x_max", "x", STRETCH)],
    )  # fmt: skip
    record = {
        "force": dea.Reaction("x_max", "x"), "tip": dea.MeanDisplacement("x_max", "x"),
        "most": dea.LargestDisplacement("x_max", "x"), "v": dea.Potential("top"),
        "c": dea.Capacitance("top"), "at": dea.AtPoint((L / 2, L / 2, T), "displacement", "z"),
        "largest": dea.OverRegion("stress", "max", "xx"),
    }  # fmt: skip
    path = dea.Ramp(("stretch", "voltage"), steps=2)
    return dea.solve(scene, path, record, quiet=True, options=TIGHT)


@pytest.fixture(scope="module")
def pulled():
    return pulled_block()


def test_force_of_a_stretched_block(pulled):
    """The force is linear in mu and in each edge; by the ramp's factor it is (lam - 1) dF/dlam."""
    to = ["film.elastic.mu", "stretch", "thickness:film:z", "thickness:film:x"]
    found = pulled.sensitivity("force", to)
    force = MU * (STRETCH - STRETCH**-2) * L * T
    slope = MU * (1 + 2 * STRETCH**-3) * L * T
    exact = [force / MU, slope * (STRETCH - 1), force / T, 0.0]
    assert found.method == "adjoint" and found.value == pytest.approx(force, rel=1e-9)
    assert list(found.values()) == pytest.approx(exact, rel=1e-8, abs=1e-8 * force / L)


def test_a_modulus_of_a_body_that_is_pressed():
    """A larger modulus moves nothing, and forces grow with it; so the contact must be as stiff."""
    device = dea.read_gmsh(BoxStack(L, None, [Layer("film", T / 2)], 2), MPI.COMM_SELF)
    plate = dea.Obstacle("top", dea.Plane((0.0, T / 2), (0.0, -1.0)), (0.0, -0.12 * T))
    scene = dea.Scene(
        device, {"film": FILM}, supports=[dea.Clamp("bottom"), plate],
        kinematics=dea.PlaneStrain(L),
    )  # fmt: skip
    record = {"out": dea.MeanDisplacement("x_max", "x"), "force": dea.ContactForce("top", "y")}
    run = dea.solve(scene, dea.Ramp(steps=1), record, quiet=True, options=TIGHT)
    for name, power in (("out", 0), ("force", 1)):
        found = run.sensitivity(name, ["film.elastic.mu"])
        slope = MU * found["film.elastic.mu"]
        assert slope == pytest.approx(power * found.value, rel=1e-8, abs=1e-8 * abs(found.value))


def test_displacement_that_a_stretch_prescribes(pulled):
    """It is (lam - 1) times the length, which grows with the shape."""
    wider = dea.ShapeChange("length", lambda X: np.array([[x / L, 0, 0] for x in X[:, 0]]))
    found = pulled.sensitivity("tip", ["stretch", "film.elastic.mu", wider], step=1)
    assert found.value == pytest.approx((STRETCH - 1) / 2 * L)
    exact = [(STRETCH - 1) * L, 0.0, (STRETCH - 1) / 2]
    assert list(found.values()) == pytest.approx(exact, rel=1e-8, abs=1e-15)


def test_a_capacitance_and_a_voltage(pulled):
    """C = eps lam L^2/T: a stretch along x brings the faces together by lam^(-1/2)."""
    c = pulled.sensitivity("c", ["film.electric.eps_r", "thickness:film:z", "stretch", "voltage"])
    exact = [c.value / EPS_R, -c.value / T, c.value * (STRETCH - 1) / STRETCH, 0.0]
    # by the voltage two terms of the size C/V cancel
    assert list(c.values()) == pytest.approx(exact, rel=1e-7, abs=1e-9 * c.value / 1e-3)
    assert dict(pulled.sensitivity("v", "voltage")) == {"voltage": pytest.approx(1.0)}


def test_an_observable_that_is_no_integral_is_differenced(pulled):
    """The thickness goes as lam^(-1/2)."""
    found = pulled.sensitivity("at", ["stretch", "film.elastic.mu"])
    assert found.method == "direct"
    exact = [-T / 2 * STRETCH**-1.5 * (STRETCH - 1), 0.0]
    assert list(found.values()) == pytest.approx(exact, rel=1e-8, abs=1e-15)


def test_what_is_made_for_one_call_serves_the_next(pulled, monkeypatch):
    """At another step no form is compiled and no factor is made, so that a call costs solves."""
    to = ["film.elastic.mu", "film.electric.eps_r", "stretch", "thickness:film:z", "voltage"]
    pulled.sensitivity("force", to)
    solver, compiled = pulled._gradients.solver, []
    monkeypatch.setattr("dea_fenicsx.support.compat.compile_form", compiled.append)
    before = solver.counters.factorisations
    assert len(pulled.sensitivity("force", to, step=1)) == 5
    assert solver.counters.factorisations == before and not compiled


@pytest.mark.parametrize("name, to, words", [
    ("force", ["film.elastic.my"], "did you mean 'film.elastic.mu'"),
    ("force", ["voltag"], "did you mean 'voltage'"),
    ("forse", ["voltage"], "did you mean 'force'"),
    ("force", ["thickness:fill"], "did you mean 'film'"),
    ("force", [], "names no variable"),
    ("force", ["voltage", "voltage"], "more than once"),
    ("force", [3], "must hold names"),
    ("most", ["voltage"], "jumps from one node to another"),
    ("largest", ["voltage"], "the max changes from one place to another"),
    ("at", ["thickness:film:z"], "has no derivative by 'thickness:film:z'"),
    ("pull-in", ["voltage"], "use dea.Trace"),
])  # fmt: skip
def test_what_has_no_derivative_is_told(pulled, name, to, words):
    with pytest.raises(dea.InputError, match=words.replace("(", r"\(")):
        pulled.sensitivity(name, to)


def test_a_step_that_is_not_there(pulled):
    with pytest.raises(dea.InputError, match="step=7 is no row"):
        pulled.sensitivity("force", ["voltage"], step=7)


def test_pull_in_of_a_free_film():
    """V = 0.687365 H sqrt(mu/eps): dV/dmu = V/(2 mu), dV/deps = -V/(2 eps), dV/dH = V/H."""
    scene = dea.Scene(
        block((1, 1, 1), L, T), {"film": FILM}, [dea.Electrode("top", 5e3), dea.Ground("bottom")],
        HELD,
    )  # fmt: skip
    record = {"thin": dea.MeanStretch(("bottom", "top"), "z")}
    path = dea.Trace("voltage", first=0.5, until=("thin", 0.55))
    run = dea.solve(scene, path, record, quiet=True, options=TIGHT)
    found = run.sensitivity("pull-in", ["film.elastic.mu", "film.electric.eps_r", "thickness:film"])
    volts = found.value
    assert volts == pytest.approx(0.687364818 * T * np.sqrt(MU / (EPS_R * 8.8541878128e-12)))
    exact = [volts / (2 * MU), -volts / (2 * EPS_R), volts / T]
    assert list(found.values()) == pytest.approx(exact, rel=1e-8)


# --------------------------------------------------------------------- differences, all kinematics


CASES = {
    "space": (hexahedron, "c", ["film.elastic.mu", "load", "thickness:film:z"]),
    "pre-stretch": (split_factor, "hold", ["prestretch:film:x", "thickness:film:z"]),
    "plane": (triangles, "up", ["film.electric.eps_r", "voltage"]),
    "round": (ring, "out", ["film.bulk_modulus", "stretch", "thickness:film:r"]),
    "helical": (helix, "twist", ["film.elastic.mu", "voltage", "thickness:film:r"]),
}


def neighbour(run, path, name, observable, one, step):
    """The observable where a variable is larger by a step: solved for anew."""
    problem, scene = run._problem, run._problem.scene
    record, options = {name: observable}, {"quiet": True, "options": TIGHT}
    column = next(c for c in run.history.names if c.split("_")[0] == name)
    if isinstance(one, LoadVariable):
        factor = problem.factors[one.ramp] + step / one.unit
        state = NewtonSolver(problem, TIGHT).solve(problem.state, {one.ramp: factor}).found
        measure = observable.bind(problem)
        with problem.at(state):
            return measure()
    if one.name.startswith("prestretch"):
        pre = [replace(i, x=i.x + step) for i in scene.prescribed]
        return dea.solve(replace(scene, prescribed=pre), path, record, **options)[column]
    if isinstance(one, Coefficients):
        handle = problem.parameters._handles[one.name]
        changed = handle.changed(scene.materials["film"], one.value + step)
        other = replace(scene, materials={"film": changed})
        return dea.solve(other, path, record, **options)[column]
    x = scene.device.mesh.geometry.x
    rest = x.copy()
    x += step * one.velocity(x)
    try:
        return dea.solve(scene, path, record, **options)[column]
    finally:
        x[:] = rest


SLOW = ("space", "pre-stretch")
"""Cases whose forms in three dimensions take long to compile."""


@pytest.mark.parametrize(
    "case", [pytest.param(c, marks=pytest.mark.slow if c in SLOW else ()) for c in CASES]
)
def test_differences_converge_to_the_derivative(case):
    """A central difference is off by a term in the square of the step."""
    make, name, to = CASES[case]
    scene, path, record, _ = make(MPI.COMM_SELF)
    run = dea.solve(scene, path, record, quiet=True, options=TIGHT)
    found = run.sensitivity(name, to)
    assert found.method == "adjoint"
    for one in variables(run._problem, to):
        size = {LoadVariable: 1.0, Coefficients: getattr(one, "value", 0.0)}.get(type(one), L)
        if isinstance(one, LoadVariable):
            size = one.unit
        errors = []
        for share in (1e-2, 5e-3):
            steps = (share * size, -share * size)
            ends = [neighbour(run, path, name, record[name], one, step) for step in steps]
            errors.append((ends[0] - ends[1]) / (2 * share * size) / found[one.name] - 1)
        assert abs(errors[0]) < 1e-3
        rounding = 1e-8
        assert abs(errors[1]) < rounding or errors[0] / errors[1] == pytest.approx(4, rel=0.02)


def test_the_height_of_a_cell_of_rings_changes_nothing():
    """A tube without end is cut into cells of any height; forces count per height."""
    scene, path, record, _ = helix(MPI.COMM_SELF)
    free = replace(scene, loads=[], kinematics=dea.Helical(0.0))
    run = dea.solve(free, path[1:], record, quiet=True, options=TIGHT)
    found = run.sensitivity("along", ["thickness:film:z", "voltage"])
    assert abs(found["voltage"] * 3e3) > 1e-5 and abs(found["thickness:film:z"] * L) < 1e-12
    with pytest.raises(dea.InputError, match="OverallTorque has no derivative"):
        run.sensitivity("torque", ["thickness:film:z"])
    for other in (scene, replace(scene, kinematics=dea.Helical(0.0))):
        run = dea.solve(other, path, record, quiet=True)
        with pytest.raises(dea.InputError, match="has no derivative here"):
            run.sensitivity("along", ["thickness:film:z"])


def on_ranks_found(comm):
    scene, path, record, _ = ring(comm)
    run = dea.solve(scene, path, record, quiet=True, options=TIGHT)
    to = ["film.elastic.mu", "load", "stretch", "thickness:film:r"]
    return [list(run.sensitivity(name, to).values()) for name in ("out", "hold")]


@pytest.mark.mpi
def test_two_ranks_find_what_one_finds(on_ranks):
    alone = on_ranks_found(MPI.COMM_SELF)
    assert np.array(on_ranks("test_gradients", "on_ranks_found", 2)) == pytest.approx(
        np.array(alone), rel=1e-8
    )


# ------------------------------------------------------------------------------------ frequencies


def test_frequency_of_a_strip_under_voltage():
    """f = sqrt(mu/rho)/L g(eps V^2/(mu L^2)) gives its derivatives by all but one of the voltage.

    That one is compared with solved neighbours, and a central difference is off by the square of
    its step.
    """
    material = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(EPS_R), density=1000.0)
    scene = dea.Scene(
        block((4, 1), L, T), {"film": material},
        [dea.Electrode("top", 2e3), dea.Ground("bottom")], [dea.Clamp("x_min")],
        kinematics=dea.PlaneStrain(L),
    )  # fmt: skip
    record = {"f": dea.Frequency()}

    def solved(factor=1.0):
        path = dea.Ramp("voltage", to=factor, steps=2)
        return dea.solve(scene, path, record, quiet=True, options=TIGHT)

    run = solved()
    larger = dea.ShapeChange("size", lambda X: X / L)
    found = run.sensitivity("f", ["film.elastic.mu", "film.electric.eps_r", "voltage", larger])
    by_mu, by_eps, by_volts, by_size = found.values()
    f = run["f_Hz"]
    assert found.value == pytest.approx(f, rel=1e-8) and found.method == "adjoint"
    assert MU * by_mu + EPS_R * by_eps == pytest.approx(f / 2, rel=1e-7)
    assert 2e3 * by_volts == pytest.approx(2 * EPS_R * by_eps, rel=1e-7)
    assert L * by_size == pytest.approx(-f - 2e3 * by_volts, rel=1e-7)
    errors = [
        (solved(1 + h)["f_Hz"] - solved(1 - h)["f_Hz"]) / (2 * h * 2e3) / by_volts - 1
        for h in (4e-2, 2e-2)
    ]
    assert abs(errors[1]) < 1e-2 and errors[0] / errors[1] == pytest.approx(4, rel=0.02)
