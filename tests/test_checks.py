"""No step is accepted that fails a check: faults are put in where a solver could let them pass."""

from __future__ import annotations

import json

import numpy as np
import pytest
from conftest import block
from test_path import MU, STRETCH, free_film

import dea_fenicsx as dea
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.run.step_checks import check_step
from dea_fenicsx.solvers.newton import NewtonSolver


@pytest.fixture
def solver(cube):
    """A film in equilibrium at 500 V."""
    run = dea.solve(free_film(500.0, cube), dea.Ramp(steps=2), quiet=True, stability="never")
    solver = NewtonSolver(run.problem)
    check_step(solver, 2, {})
    return solver


def moved(problem, name, by):
    values = problem.state.values.copy()
    values[problem.free[problem.roles.of_group(name)[1]][:1]] += by
    problem.commit(problem.state.with_values(values))


FAULTS = {
    "moved": (lambda p: moved(p, "u", 1e-6), "residual .* is above"),
    "pressure": (lambda p: moved(p, "p", 1e-5), "residual .* is above"),
    "potential": (lambda p: moved(p, "phi", 1e-5), "residual .* is above"),
    "NaN": (lambda p: moved(p, "u", np.nan), "residual inf is above"),
    "NaN pressure": (lambda p: moved(p, "p", np.nan), "residual inf is above"),
    "NaN potential": (lambda p: moved(p, "phi", np.nan), "residual inf is above"),
    "inside out": (lambda p: moved(p, "u", 5.0), "residual .* is above"),
    "another load": (lambda p: p.commit(p.imposed(p.under(p.state, {"voltage": 1.1}))), "residual"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_faulty_state_is_not_accepted(solver, fault):
    break_it, words = FAULTS[fault]
    break_it(solver.problem)
    with pytest.raises(dea.SolverError, match=f"Step 7 is not accepted: .*{words}"):
        check_step(solver, 7, {})


def test_volume_and_admissibility_are_checked_on_their_own(solver, monkeypatch):
    """Even where the residual says nothing."""
    monkeypatch.setattr(NewtonSolver, "residual_of", lambda self, r, anew=False: 0.0)
    keep = solver.problem.state
    moved(solver.problem, "u", 1e-6)
    with pytest.raises(dea.SolverError, match=r"volume error .* is above"):
        check_step(solver, 1, {})
    solver.problem.commit(keep)
    moved(solver.problem, "u", 5.0)
    with pytest.raises(dea.SolverError, match="det F falls to -"):
        check_step(solver, 1, {})


def test_observables_must_be_finite(solver):
    with pytest.raises(dea.SolverError, match="tip_m is inf"):
        check_step(solver, 1, {"tip_m": float("inf")})


def test_the_volume_bound_holds_and_is_sharp(solver):
    """A residual at the tolerance makes a volume error below the bound, and not far below."""
    problem = solver.problem
    tolerance = solver.options.tolerance
    state = problem.state
    direction = np.random.default_rng(3).standard_normal(len(problem.roles.free(Role.MOTION)))
    dofs = problem.free[problem.roles.free(Role.MOTION)]

    def rows(size):
        moved = state.values.copy()
        moved[dofs] += size * direction
        problem.commit(state.with_values(moved))
        return solver.references.norms(problem.residual())["p"]

    size = 1e-10 * tolerance / rows(1e-10)
    assert rows(size) == pytest.approx(tolerance, rel=1e-3)
    from dea_fenicsx.run.step_checks import volume

    _, error, bound = volume(problem, tolerance * solver.references.volume)
    assert bound / 50 < error < bound < 10 * tolerance


def test_a_failed_trial_does_not_loosen_later_tests(solver):
    """The reactions of a trial state far off leave the references as they were."""
    problem = solver.problem
    before, state = dict(solver.references.sizes), problem.state
    problem.commit(problem.moved(problem.state, 0.1 * np.ones(len(problem.free))))
    solver.references.norms(problem.residual())
    assert solver.references.sizes == before
    problem.commit(state)
    check_step(solver, 1, {})


def test_a_given_charge_out_of_balance_is_seen():
    """With no charge in the state at all there is nothing to measure it by."""
    scene = dea.Scene(
        block((2, 2)),
        {"film": dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(3.0))},
        electrodes=[dea.ChargedElectrode("top", 1e-9), dea.Ground("bottom")],
        supports=[dea.Clamp("bottom")],
        loads=[dea.FollowerPressure("top", 0.0)],
        kinematics=dea.PlaneStrain(),
    )
    problem = Problem(scene)
    problem.commit(problem.under(problem.state, {"charge": 1.0, "load": 0.0}))
    assert NewtonSolver(problem).residual_of(problem.residual()) == np.inf


class Broken:
    """An observable that is not a number at the second step."""

    unit = ""

    def bind(self, problem):
        count = iter([1.0, 2.0, float("nan")])
        return lambda: next(count)


def test_a_step_with_a_bad_observable_is_not_written(cube, tmp_path):
    with pytest.raises(dea.SolverError, match="Step 2 is not accepted: broken is nan") as caught:
        dea.solve(free_film(500.0, cube), dea.Ramp(steps=3), {"broken": Broken()}, tmp_path,
                  quiet=True)  # fmt: skip
    assert [row["step"] for row in caught.value.run.history] == [0, 1]
    assert list(dea.read_history(tmp_path)["step"]) == [0, 1]
    assert dea.read_summary(tmp_path)["status"] == "solver failed"


def test_every_step_tells_its_own_residual(cube):
    """Limit points as well: the residual in the history is that of the state in that row."""
    run = dea.solve(
        free_film(1000.0, cube), dea.Trace("voltage", first=0.2, until=("stretch", 0.5)), STRETCH,
        quiet=True, stability="every",
    )  # fmt: skip
    assert any(row["event"] for row in run.history)
    for row in run.history:
        assert row["residual"] <= 1e-10 and row["min_J"] > 0.99 and row["volume_error"] < 1e-8
        assert row["inertia"] is not None and row["inertia_is_of_this_step"] == 1


def test_inertia_of_a_newton_iterate_is_not_taken_for_the_step_s(cube):
    run = dea.solve(free_film(500.0, cube), dea.Ramp(steps=2), quiet=True, stability="never")
    assert [row["inertia_is_of_this_step"] for row in run.history] == [0, 0, 0]


RESUMES = {
    "supports": dict(supports=[dea.Clamp("bottom")]),
    "loads": dict(loads=[dea.DeadLoad("top", (0.0, 0.0, 1.0), ramp="voltage")]),
    "elements": dict(elements=dea.Discretisation(augmentation=9.0)),
}


@pytest.mark.parametrize("what", RESUMES)
def test_resume_refuses_another_scene(cube, tmp_path, what):
    from dataclasses import replace

    scene = free_film(500.0, cube)
    dea.solve(scene, dea.Ramp(steps=2), out=tmp_path, quiet=True)
    with pytest.raises(dea.InputError, match=f"cannot be resumed: its {what}"):
        dea.solve(replace(scene, **RESUMES[what]), dea.Ramp(steps=2), out=tmp_path, quiet=True,
                  resume=True)  # fmt: skip


def test_a_state_that_is_no_equilibrium_is_not_resumed(cube, tmp_path):
    scene = free_film(500.0, cube)
    dea.solve(scene, dea.Ramp(steps=2), out=tmp_path, quiet=True)
    file = tmp_path / "checkpoint.npz"
    with np.load(file) as data:
        arrays = dict(data)
    assert json.loads(str(arrays["told"]))["references"]
    np.savez(file, **arrays | {"state": arrays["state"] + 1e-4})
    with pytest.raises(dea.InputError, match="is no equilibrium of this scene"):
        dea.solve(scene, dea.Ramp(steps=2), out=tmp_path, quiet=True, resume=True)
