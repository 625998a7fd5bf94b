"""Constants of a built problem, and its use for another run."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import block
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.run import reuse
from dea_fenicsx.solvers.newton import NewtonSolver

TIP = {"tip": dea.MeanDisplacement("x_max", "y")}
VOLTS = 4e3


@pytest.fixture(autouse=True)
def nothing_kept():
    reuse.clear()
    yield
    reuse.clear()


@pytest.fixture
def made(monkeypatch):
    """The scenes of which a problem is made."""
    scenes = []
    build = Problem.__init__

    def noted(self, scene, *options):
        scenes.append(scene)
        build(self, scene, *options)

    monkeypatch.setattr(Problem, "__init__", noted)
    return scenes


@pytest.fixture(scope="module")
def strip():
    layers = [Layer("passive", 0.5e-3), Layer("active", 0.5e-3)]
    return dea.read_gmsh(BoxStack(10e-3, None, layers, 8, ends="start"), MPI.COMM_SELF)


def bender(device, mu=80e3, eps_r=2.8, **changes):
    given = {
        "materials": {
            "active": dea.Material(dea.NeoHookean(mu), dea.IdealDielectric(eps_r)),
            "passive": dea.Material(dea.NeoHookean(80e3)),
        },
        "electrodes": [dea.Electrode("top", VOLTS), dea.Ground("interface_1")],
        "supports": [dea.Clamp("x_min")],
        "kinematics": dea.PlaneStrain(5e-3),
    }
    return dea.Scene(device, **(given | changes))


def solve(scene, **options):
    return dea.solve(scene, dea.Ramp(steps=2), TIP, quiet=True, **options)


def test_a_loop_over_moduli_gives_what_each_run_gives_alone(strip, made):
    moduli = [(80e3 * (1 + 0.3 * k), 2.8 + k) for k in range(5)]
    looped = []
    for mu, eps_r in moduli:
        run = solve(bender(strip, mu, eps_r))
        looped.append((run["tip_m"], run.summary["settings"]["materials"]["active"]))
    assert len(made) == 2  # the last run is still there while the next one begins
    for (mu, eps_r), (tip, told) in zip(moduli, looped, strict=True):
        reuse.clear()
        alone = solve(bender(strip, mu, eps_r))
        assert tip == pytest.approx(alone["tip_m"], rel=1e-9)
        assert told == alone.summary["settings"]["materials"]["active"]


def test_a_loop_over_voltages_gives_what_each_run_gives_alone(strip, made):
    """The second electrode has the smaller voltage on the ramp, which no load is told by."""
    def scene(top, bottom):
        film = dea.Material(dea.NeoHookean(80e3), dea.IdealDielectric(2.8))
        electrodes = [
            dea.Electrode("top", top), dea.Electrode("bottom", bottom), dea.Ground("interface_1"),
        ]  # fmt: skip
        return bender(strip, materials={"active": film, "passive": film}, electrodes=electrodes)

    pairs = [(4e3, 1e3), (4e3, 3e3), (-4e3, 3e3), (2e3, 3.5e3), (5e3, 0.0)]
    looped = []
    for top, bottom in pairs:
        run = solve(scene(top, bottom))
        looped.append((run["tip_m"], run.history[-1]["voltage_V"]))
    assert len(made) == 3  # of two at once; without a voltage the bottom has no ramp
    for (top, bottom), (tip, volts) in zip(pairs, looped, strict=True):
        reuse.clear()
        alone = solve(scene(top, bottom))
        assert tip == pytest.approx(alone["tip_m"], rel=1e-9)
        assert volts == alone.history[-1]["voltage_V"] == max(top, bottom, key=abs)


def test_voltages_that_cannot_be_are_refused_in_a_loop(strip):
    """Two electrodes that touch must have one potential."""
    def scene(volts):
        touching = [dea.Electrode("top", 4e3), dea.Electrode("x_max", volts)]
        film = dea.Material(dea.NeoHookean(80e3), dea.IdealDielectric(2.8))
        return bender(strip, materials={"active": film, "passive": film}, electrodes=touching)

    solve(scene(4e3))
    with pytest.raises(dea.InputError, match="touch, but have different potentials"):
        solve(scene(3e3))


def test_constants_that_make_sense_together_only_are_taken_together(cube):
    """A bulk modulus may not be below 2/3 of the shear modulus: both grow at once."""
    found = []
    for mu in (1e5, 1e7, 1e5):
        scene = dea.Scene(
            cube, {"film": dea.Material(dea.NeoHookean(mu), None, 2 * mu)},
            supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
            loads=[dea.DeadLoad("x_max", (mu, 0.0, 0.0))],
        )
        length = dea.MeanStretch(("x_min", "x_max"), "x")
        run = dea.solve(scene, dea.Ramp(steps=2), {"x": length}, quiet=True)
        found.append(run["x"])
    assert found[1:] == pytest.approx(found[:1] * 2, rel=1e-9)


def test_a_leak_and_a_lag_belong_to_the_problem(cube):
    """A charged film that is disconnected loses its voltage by the rates of its own dielectric."""
    late = dea.Debye(1.5, 2.0)
    kinds = [
        {}, {"conductivity": 1e-12}, {"conductivity": 2e-12}, {"relaxation": [late]},
        {"relaxation": [late, dea.Debye(0.5, 1.0)], "conductivity": 1e-12},
        {"relaxation": [dea.Debye(1.5, 5.0)], "conductivity": 1e-12},
    ]  # fmt: skip

    def voltage(kind):
        film = dea.Material(dea.NeoHookean(1e9), dea.IdealDielectric(3.0, **kind))
        scene = dea.Scene(
            cube, {"film": film}, [dea.Source("top", 100.0), dea.Ground("bottom")],
            supports=[dea.Clamp("bottom")],
        )  # fmt: skip
        path = [dea.Ramp(steps=1), dea.Open("top"), dea.March(6.0, steps=5)]
        return float(dea.solve(scene, path, {"v": dea.Potential("top")}, quiet=True)["v_V"])

    alone = []
    for kind in kinds:
        reuse.clear()
        alone.append(voltage(kind))
    assert len({round(volts, 3) for volts in alone}) == len(kinds)
    for second, kind in enumerate(kinds):
        for first in (kinds[second - 1], kinds[second - 2]):
            reuse.clear()
            voltage(first)
            assert voltage(kind) == pytest.approx(alone[second], rel=1e-9)


def test_a_problem_that_can_be_seen_is_left_alone(strip):
    first = solve(bender(strip))
    problem = first.problem
    state = problem.state
    del first
    second = solve(bender(strip, 200e3))
    third = solve(bender(strip, 300e3))
    assert second.problem is not problem is not third.problem
    assert second.problem is not third.problem
    assert problem.state == state


class Lasting:
    """An observable of a script that keeps the problem."""

    unit = "m"

    def bind(self, problem):
        self.problem = problem
        return lambda: float(np.max(np.abs(problem.w.x.array)))


def test_an_observable_of_a_script_may_keep_the_problem(strip):
    mine = Lasting()
    dea.solve(bender(strip), dea.Ramp(steps=1), {"mine": mine}, quiet=True)
    kept = mine.problem.state
    solve(bender(strip, 300e3))
    assert mine.problem.state == kept


@pytest.mark.parametrize("changes", [
    {"kinematics": dea.PlaneStrain(1e-3)},
    {"supports": [dea.Clamp("x_max")]},
    {"electrodes": [dea.Electrode("top", 2 * VOLTS), dea.Ground("interface_1")]},
    {"loads": [dea.DeadLoad("x_max", (0.0, 1.0), ramp="voltage")]},
    {"elements": dea.Discretisation(potential_degree=1)},
    {"materials": {"active": dea.Material(dea.Gent(80e3, 100.0), dea.IdealDielectric(2.8)),
                   "passive": dea.Material(dea.NeoHookean(80e3))}},
    {"materials": {"active": dea.Material(dea.NeoHookean(80e3), dea.IdealDielectric(2.8), 1e7),
                   "passive": dea.Material(dea.NeoHookean(80e3))}},
])  # fmt: skip
def test_another_scene_gets_a_problem_of_its_own(strip, changes):
    solve(bender(strip))
    other = bender(strip, **changes)
    before = dea.solve(other, dea.Ramp(steps=1), quiet=True).problem
    reuse.clear()
    after = dea.solve(other, dea.Ramp(steps=1), quiet=True).problem
    assert before.state.values == pytest.approx(after.state.values, rel=1e-9, abs=1e-12)


def test_nodes_that_a_script_has_moved_get_a_problem_of_their_own(strip, made):
    """The rest volumes and the reference forces of the kept problem belong to the old nodes."""
    x = strip.mesh.geometry.x
    before = x.copy()
    try:
        for stretch in (1.0, 1.05, 1.05, 1.05):
            x[:, 0] = stretch * before[:, 0]
            solve(bender(strip))
        assert len(made) == 2
    finally:
        x[:] = before


def test_other_settings_of_newton_get_a_solver_of_their_own(strip):
    solve(bender(strip))
    run = solve(bender(strip), options=dea.NewtonOptions(keep_factor=False))
    again = solve(bender(strip))
    assert run.summary["factorisations"] > again.summary["factorisations"]


def test_constants_are_read_and_set_by_name(cube):
    """A film that is pressed at given length and width: p = mu (lam^2 - lam^-4) at another mu."""
    scene = dea.Scene(
        cube, {"film": dea.Material(dea.Ogden((5e4, 1e3), (1.5, 5.0)), dea.IdealDielectric(3.0))},
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
        loads=[dea.DeadLoad("x_max", (3e4, 0.0, 0.0))],
    )
    problem = Problem(scene)
    names = set(problem.parameters)
    assert names == {"film.elastic.mu[0]", "film.elastic.mu[1]", "film.elastic.alpha[0]",
                     "film.elastic.alpha[1]"}  # fmt: skip
    assert problem.parameters["film.elastic.mu[1]"] == 1e3
    solver = NewtonSolver(problem)
    for mu in (1e3, 2e3, 4e3):
        problem.parameters["film.elastic.mu[1]"] = mu
        found = solver.solve(problem.state, {"load": 1.0}).found
        new = dea.Material(dea.Ogden((5e4, mu), (1.5, 5.0)), dea.IdealDielectric(3.0))
        direct = Problem(dea.Scene(cube, {"film": new}, supports=scene.supports, loads=scene.loads))
        there = NewtonSolver(direct).solve(direct.state, {"load": 1.0}).found
        dofs = problem.displacement[0].dofs
        assert found.values[dofs] == pytest.approx(there.values[dofs], abs=1e-9)


@pytest.mark.parametrize("name, value, words", [
    ("film.elastic.nu", 1.0, "no constant named 'film.elastic.nu'; did you mean 'film.elastic.mu'"),
    ("film.elastic.mu", -1.0, "Region 'film', NeoHookean"),
    ("film.elastic.mu", float("nan"), "must be a finite number"),
    ("film.electric.eps_r", 0.0, "Region 'film'"),
])  # fmt: skip
def test_a_bad_constant_is_told(name, value, words):
    scene = dea.Scene(
        block(), {"film": dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(3.0))},
        electrodes=[dea.Electrode("top", 1e3), dea.Ground("bottom")],
        supports=[dea.Clamp("bottom")],
    )
    parameters = Problem(scene).parameters
    with pytest.raises(dea.InputError, match=words):
        parameters[name] = value
    assert parameters["film.elastic.mu"] == 5e4
    assert parameters["film.electric.eps_r"] == 3.0


def loop_on_ranks(comm):
    """Moduli in a loop, where one rank alone keeps the first problem."""
    layers = [Layer("passive", 0.5e-3), Layer("active", 0.5e-3)]
    device = dea.read_gmsh(BoxStack(10e-3, None, layers, 4, ends="start"), comm)
    first = solve(bender(device))
    kept = first.problem if comm.rank == 0 else None
    del first
    found = [solve(bender(device, 80e3 * k))["tip_m"] for k in (1, 2, 3)]
    return [*found, kept is None]


@pytest.mark.mpi
def test_ranks_agree_on_what_is_used_again(on_ranks):
    alone = loop_on_ranks(MPI.COMM_SELF)
    assert on_ranks("test_reuse", "loop_on_ranks", 2)[:3] == pytest.approx(alone[:3], rel=1e-8)
