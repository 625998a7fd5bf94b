"""Arc length through limit points, against closed forms of shared theory (Suo; Zhao and Suo)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import block

import dea_fenicsx as dea
from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.path.arclength import Cubic, TracedBranch
from dea_fenicsx.path.load_course import LoadCourse
from dea_fenicsx.solvers.newton import NewtonSolver

MU, EPS_R, T = 50e3, 4.7, 1e-3
UNIT = T * np.sqrt(MU / (EPS_R * EPSILON_0))
STRETCH = {"stretch": dea.MeanStretch(("x_min", "x_max"), "x")}


def film(elastic, loads=(), cells=(1, 1, 1)):
    """A free or dead-loaded film; ramp factor 1 is the dimensionless voltage 1."""
    return dea.Scene(
        block(cells),
        {"film": dea.Material(elastic, dea.IdealDielectric(EPS_R))},
        electrodes=[dea.Electrode("top", UNIT), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
        loads=loads,
    )


def events(run):
    return {row["event"]: row for row in run.history if row["event"]}


@pytest.mark.parametrize(
    ("load", "stretch", "phi"),
    [(0.5, 1.4267, 0.5107), (1.0, 1.7463, 0.3586), (2.0, 3.0160, 0.1921)],
)
def test_limit_points_under_dead_load(load, stretch, phi):
    """phi^2 = (lam - lam^-5 - s/mu)/lam^3, from mu (lam^2 - lam^-4) = eps E^2 + lam s.

    `stretch` and `phi` are its maximum to four digits.
    """
    s = load * MU
    loads = [dea.DeadLoad("x_max", (s, 0, 0)), dea.DeadLoad("y_max", (0, s, 0))]
    path = [dea.Ramp("load", steps=4),
            dea.Trace("voltage", first=0.05, until=("stretch", 1.3 * stretch))]  # fmt: skip
    run = dea.solve(film(dea.NeoHookean(MU), loads), path, STRETCH, quiet=True, stability="never")
    lam, volts = run.column("stretch")[5:], run.column("voltage_V")[5:]
    exact = np.sqrt((lam - lam**-5 - load) / lam**3)
    assert volts / UNIT == pytest.approx(exact, rel=1e-6)
    top = events(run)["maximum"]
    assert top["stretch"] == pytest.approx(stretch, abs=6e-5)
    assert top["voltage_V"] / UNIT == pytest.approx(phi, abs=6e-5)
    # the limit point itself to 1e-6: stationary value of the closed form near it
    near = np.linspace(top["stretch"] - 0.01, top["stretch"] + 0.01, 20001)
    assert top["voltage_V"] / UNIT == pytest.approx(
        np.sqrt(np.max((near - near**-5 - load) / near**3)), rel=1e-6
    )


def test_the_cubic_between_two_points_is_of_fourth_order():
    """Its load at half an arc, and where the load is largest, against the closed form.

    phi^2 = lam^-2 - lam^-8, from mu (lam^2 - lam^-4) = eps E^2 and E = lam^2 V/T; it is
    largest at lam = 4^(1/6).
    """
    solver = NewtonSolver(Problem(film(dea.NeoHookean(MU))))
    problem = solver.problem
    problem.commit(solver.solve(problem.state, {"voltage": 0.68}).found)
    branch = TracedBranch(solver, LoadCourse(solver, {"voltage": 1.0}, 0.68), 0.05)
    here = branch.point(problem.state, None, 1.0)
    x = problem.displacement[0]
    size = np.ptp(x.space.tabulate_dof_coordinates()[:, 0])

    def miss(state, factor):
        lam = 1 + np.max(state.values[x.dofs]) / size
        return abs(np.sqrt(lam**-2 - lam**-8) / factor - 1)

    errors = []
    for arc in (1.0, 0.5, 0.25):
        attempt, there = branch.advance(here, arc)
        assert attempt.converged
        cubic = Cubic.through(branch, here, there)
        assert cubic.arc == pytest.approx(arc, rel=1e-9)
        for s, point in ((0.0, here), (arc, there)):
            state, factor = cubic.guess(s)
            assert state.values == pytest.approx(point.state.values, rel=1e-12, abs=1e-14)
            assert factor == pytest.approx(point.factor, rel=1e-12)
        errors.append(miss(*cubic.guess(arc / 2)))
    assert errors[0] / errors[1] > 10
    assert errors[1] / errors[2] > 10
    attempt, there = branch.advance(here, 3.0)
    assert here.slope > 0 > there.slope
    cubic = Cubic.through(branch, here, there)
    largest = np.sqrt(4 ** (-1 / 3) - 4 ** (-4 / 3))
    assert cubic.guess(cubic.stationary)[1] == pytest.approx(largest, rel=1e-3)


def test_snap_through_and_stability():
    """Gent film: maximum, minimum, and a second branch that is stable again."""
    run = dea.solve(
        film(dea.Gent(MU, 120.0), cells=(2, 2, 2)),
        dea.Trace("voltage", first=0.1, until=("stretch", 6.2)),
        STRETCH, quiet=True, stability="every",
    )  # fmt: skip
    lam, volts = run.column("stretch")[1:], run.column("voltage_V")[1:]
    mu = 120.0 / (120.0 - 2 * lam**2 - lam**-4 + 3)
    assert volts / UNIT == pytest.approx(np.sqrt(mu * (lam**2 - lam**-4) / lam**4), rel=1e-6)
    found = events(run)
    # the exact branch of the film: 23.88 kV at 1.263, minimum at 5.545 (T = 1 mm, eps_r 4.7)
    assert found["maximum"]["voltage_V"] == pytest.approx(23.88e3, abs=5)
    assert found["maximum"]["stretch"] == pytest.approx(1.263, abs=5e-4)
    assert found["minimum"]["stretch"] == pytest.approx(5.545, abs=5e-4)
    # the film of eight cells has more modes than the equal stretch: those become stable again on
    # either side of the minimum, each at a bifurcation
    last = max(row["stretch"] for row in run.history if row["event"])
    assert last == pytest.approx(found["minimum"]["stretch"], rel=1e-3)
    for row in run.history:
        if not row["event"]:
            assert (row["inertia"] > 0) == (found["maximum"]["stretch"] < row["stretch"] < last)


def test_traces_in_dead_load_charge_and_pressure():
    """Closed forms of a neo-Hookean film; the dead load passes its maximum under a voltage."""
    pull = [dea.DeadLoad("x_max", (MU, 0, 0)), dea.DeadLoad("y_max", (0, MU, 0))]
    path = [dea.Ramp("voltage", to=0.3, steps=3),
            dea.Trace("load", first=0.1, until=("stretch", 3.0))]  # fmt: skip
    run = dea.solve(film(dea.NeoHookean(MU), pull), path, STRETCH, quiet=True, stability="never")
    lam, load = run.column("stretch")[4:], run.column("load_factor")[4:]
    assert load == pytest.approx(lam - lam**-5 - 0.09 * lam**3, rel=1e-8, abs=1e-8)
    x = np.linspace(1.9, 2.1, 200001)
    assert events(run)["maximum"]["load_factor"] == pytest.approx(
        np.max(x - x**-5 - 0.09 * x**3), rel=1e-9
    )

    charged = [dea.ChargedElectrode("top", EPS_R * EPSILON_0 * UNIT * T), dea.Ground("bottom")]
    scene = replace(film(dea.NeoHookean(MU)), electrodes=charged)
    trace = dea.Trace("charge", first=0.1, until=("stretch", 1.8))
    run = dea.solve(scene, trace, STRETCH, quiet=True, stability="never")
    lam, charge = run.column("stretch")[1:], run.column("charge_factor")[1:]
    assert charge == pytest.approx(np.sqrt((lam**2 - lam**-4) * lam**4), rel=1e-8)
    assert not events(run)

    pressure = [dea.FollowerPressure(side, -MU) for side in ("x_max", "y_max")]
    trace = dea.Trace("load", first=0.1, until=("stretch", 2.0))
    run = dea.solve(film(dea.NeoHookean(MU), pressure), trace, STRETCH, quiet=True,
                    stability="never")  # fmt: skip
    lam, load = run.column("stretch")[1:], run.column("load_factor")[1:]
    assert load == pytest.approx(lam**2 - lam**-4, rel=1e-8)


def test_load_derivative_is_exact():
    """dR/df against central differences, at a loaded state, voltage and dead load."""
    from dea_fenicsx.model.problem import Problem
    from dea_fenicsx.solvers.tangent import Tangent

    s = 20e3
    scene = film(dea.NeoHookean(MU), [dea.DeadLoad("x_max", (s, 0, 0))])
    problem = Problem(scene)
    tangent = Tangent(problem)
    factors = {"load": 0.7, "voltage": 0.4}
    problem.commit(problem.imposed(problem.under(problem.state, factors)))
    away = 0.01 * np.random.default_rng(1).standard_normal(len(problem.free))
    problem.commit(problem.moved(problem.state, away))
    for ramp in factors:
        problem.commit(problem.imposed(problem.under(problem.state, factors)))
        exact = tangent.by_load(ramp)
        sides = []
        for h in (1e-4, -1e-4):
            changed = factors | {ramp: factors[ramp] + h}
            problem.commit(problem.imposed(problem.under(problem.state, changed)))
            sides.append(problem.residual()[problem.free])
        difference = (sides[0] - sides[1]) / 2e-4
        assert difference == pytest.approx(exact, abs=1e-7 * np.abs(exact).max())


def test_free_film_limit_point(tmp_path):
    """Neo-Hookean: phi^2 = lam^-2 - lam^-8 is largest, 0.68736^2, at lam = 2^(1/3)."""
    scene = film(dea.NeoHookean(MU))
    first = dea.solve(scene, dea.Trace("voltage", steps=40, until=("stretch", 1.5)), STRETCH,
                      tmp_path, quiet=True, stability="never")  # fmt: skip
    assert first["stretch"] == pytest.approx(1.5, rel=1e-7)
    assert first["inertia_is_of_this_step"] == 0  # never asked
    assert events(first)["maximum"]["stretch"] == pytest.approx(2 ** (1 / 3), abs=1e-5)
    assert events(first)["maximum"]["voltage_V"] / UNIT == pytest.approx(0.68736, abs=5e-6)


@pytest.mark.parametrize("until", [("stretch", 1.2), ("voltage_V", 0.5 * UNIT)])
def test_a_trace_ends_on_its_value(until, tmp_path):
    """No later event of the same step is kept; the last step's eigenvalues are counted."""
    scene = film(dea.NeoHookean(MU))
    path = [dea.Trace("voltage", first=0.3, longest=8.0, until=until)]
    run = dea.solve(scene, path, STRETCH, tmp_path, quiet=True)
    assert run[until[0]] == pytest.approx(until[1], rel=1e-7)
    assert not events(run)
    assert run["inertia_is_of_this_step"] == 1
    steps = len(run.history)
    again = dea.solve(scene, path, STRETCH, tmp_path, resume=True, quiet=True)
    assert len(again.history) == steps


@pytest.mark.parametrize(
    ("trace", "words"),
    [
        (dea.Trace("volts"), "no ramp in the scene named 'volts'"),
        (dea.Trace("voltage", first=0.0), "first step other than 0"),
        (dea.Trace("voltage", until=("tip", 1.0)), "no such column"),
    ],
)
def test_trace_refuses(trace, words):
    with pytest.raises(dea.InputError, match=words):
        dea.solve(film(dea.NeoHookean(MU)), trace, STRETCH, quiet=True)
