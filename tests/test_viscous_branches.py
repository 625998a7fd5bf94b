"""Branches with any spring and with flow laws: against Maxwell branches, and equations of films."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import block
from mpi4py import MPI
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import dea_fenicsx as dea
from dea_fenicsx.exact import Dead, Film, Held, instantaneous, march, relaxed
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.terms.viscous import Viscous
from dea_fenicsx.support.errors import EquilibriumLost

pytestmark = pytest.mark.usefixtures("quick_compile")

MU, SIDE, EPS = 10e3, 1e-3, 3.0
UNIT = SIDE * math.sqrt(MU / (EPS * dea.materials.EPSILON_0))
"""Voltage in V at which the nominal field is sqrt(mu/eps)."""

GENT = dea.ViscousBranch(dea.Gent(20e3, 3.0), 0.5)
LAW = dea.KumarLopezPamies(10e3, 500.0, K1=3e3, K2=1e-8, beta1=1.852, beta2=0.6)
THINNING = dea.ViscousBranch(dea.Gent(20e3, 6.0), flow=LAW)


def material(*branches, **more):
    return dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(EPS), viscous=branches, **more)


SIDES = {
    "Axisymmetric": ("z", {"x_min": "r"}), "PlaneStrain": ("y", {"x_min": "x"}),
    "ThreeD": ("z", {"x_min": "x", "y_min": "y"}),
}  # fmt: skip
"""For each kinematics the direction of the thickness, and planes of symmetry."""


def film(*branches, cells=(1, 1), kinematics=None, volts=UNIT, device=None, **more):
    """A free film under a voltage: a disc unless other kinematics are named."""
    kinematics = kinematics or dea.Axisymmetric()
    thickness, sides = SIDES[type(kinematics).__name__]
    return dea.Scene(
        device or block(cells), {"film": material(*branches, **more)},
        [dea.Electrode("top", volts), dea.Ground("bottom")],
        supports=[dea.Fix("bottom", thickness), *(dea.Fix(s, a) for s, a in sides.items())],
        kinematics=kinematics,
    )  # fmt: skip


THICKNESS = {"lam": dea.MeanStretch(("bottom", "top"), "z"), "heat": dea.Dissipation()}
SINE = dea.Sine(0.5, 0.5)


def solve(scene, path, record, **more):
    return dea.solve(scene, path, record, quiet=True, **{"stability": "never"} | more)


# ---------------------------------------------------------------- the same as a Maxwell branch


@pytest.mark.parametrize("kappa", [None, 1e6])
def test_a_neo_hookean_spring_is_that_of_a_maxwell_branch(kappa):
    closed = [dea.Maxwell(26e3, 0.6), dea.Maxwell(10e3, 5.0), dea.Maxwell(1e3, math.inf)]
    solved = [dea.ViscousBranch(dea.NeoHookean(b.mu), b.tau) for b in closed]
    record = THICKNESS | {"spring": dea.Energy("viscous")}
    path = dea.March(1.0, {"voltage": SINE}, steps=8)
    runs = [
        solve(film(*branches, bulk_modulus=kappa), path, record)
        for branches in (closed, solved, [closed[0], *solved[1:]])
    ]
    for run in runs[1:]:
        for name in ("lam", "heat_W", "spring_J"):
            due = runs[0].column(name)
            assert run.column(name) == pytest.approx(due, rel=1e-8, abs=1e-8 * np.abs(due).max())
        assert np.all(run.column("newton_iterations") == runs[0].column("newton_iterations"))


# ---------------------------------------------------------------- an equation of its own


def uniaxial(branch, wave, at):
    """Stretches of a bar under a dead stress, by its ordinary differential equation.

    The viscous strain has the principal values exp(a), exp(-a/2), exp(-a/2), and da/dt is the
    first stress deviator over the viscosity.
    """

    def stresses(e):
        mu, Jm = branch.spring.mu, branch.spring.Jm
        x, y = np.exp(2 * e), np.exp(-e)
        stiff = mu / (1 - (x + 2 * y - 3) / Jm)
        return stiff * x, stiff * y

    def viscosity(a, J2):
        if branch.flow is None:
            return branch.spring.mu * branch.tau
        grown = LAW.eta_0 - LAW.eta_inf
        trace_v = np.exp(a) + 2 * np.exp(-a / 2)
        grown += LAW.K1 * (trace_v**LAW.beta1 - 3**LAW.beta1)
        return LAW.eta_inf + grown / (1 + (LAW.K2 * J2) ** LAW.beta2)

    def stretch(t, a):
        def force(lam):
            first, second = stresses(np.log(lam) - a / 2)
            return MU * (lam**2 - 1 / lam) + first - second - wave(t) * lam

        high = np.exp(a / 2)
        while force(high) < 0:
            high *= 1.002
        return brentq(force, high / 1.002 if high > np.exp(a / 2) else 0.5 * high, high,
                      xtol=1e-15, rtol=1e-14)  # fmt: skip

    def rate(t, u):
        first, second = stresses(np.log(stretch(t, u[0])) - u[0] / 2)
        return [2 / 3 * (first - second) / viscosity(u[0], (first - second) ** 2 / 3)]

    found = solve_ivp(
        rate, (0, at[-1]), [0.0], method="DOP853", rtol=1e-11, atol=1e-13, t_eval=at
    )
    return np.array([stretch(t, a) for t, a in zip(at, found.y[0], strict=True)])


AT = np.array([0.25, 0.5, 0.75, 1.0])


@pytest.mark.parametrize("branch", [GENT, THINNING], ids=["spring", "flow law"])
def test_a_bar_is_of_second_order_and_its_exact_course_is_exact(branch):
    wave = dea.Rise(20e3, 1.0)
    due = uniaxial(branch, wave, AT)
    course = march(Film(material(branch), SIDE, Dead(0.0)), 1.0, sides=(wave, None))
    assert course.stretch(AT) == pytest.approx(due, rel=1e-10)
    assert np.abs(course.balance().gap).max() < 1e-8 * course.at(1.0).dissipated[0]
    errors = []
    for steps in (20, 40, 80):
        scene = dea.Scene(
            block((1, 1)), {"film": material(branch)},
            [dea.Electrode("top", 1.0), dea.Ground("bottom")],
            supports=[dea.Fix("bottom", "z"), dea.Fix("x_min", "r")],
            loads=[dea.DeadLoad("top", (0.0, 20e3))], kinematics=dea.Axisymmetric(),
        )  # fmt: skip
        path = dea.March(1.0, {"load": dea.Rise(1.0, 1.0)}, steps=steps)
        run = solve(scene, path, THICKNESS)
        # the first quarter holds the steps of another rule, whose error is smaller
        at = [round(t * steps) for t in AT[1:]]
        errors.append(np.abs(run.column("lam")[at] - due[1:]))
        assert np.all(run.column("heat_W") >= 0)
    slopes = -np.polyfit(np.log([20, 40, 80]), np.log(errors), 1)[0]
    assert slopes == pytest.approx(2.0, abs=0.15)


@pytest.mark.parametrize("branch", [GENT, THINNING], ids=["spring", "flow law"])
def test_a_film_in_other_kinematics(branch):
    """Plane strain is a film held in one direction; three dimensions are free in both."""
    places = [
        ((1, 1), dea.PlaneStrain(), "y", Film(material(branch), SIDE, Dead(0.0), Held(1.0))),
        ((1, 1, 1), dea.ThreeD(), "z", Film(material(branch), SIDE)),
    ][: 2 if branch is GENT else 1]
    for cells, kinematics, axis, exact in places:
        run = solve(
            film(branch, cells=cells, kinematics=kinematics, volts=0.5 * UNIT),
            dea.March(1.0, {"voltage": SINE}, steps=20),
            {"lam": dea.MeanStretch(("bottom", "top"), axis)},
        )
        time = run.column("time_s")
        due = march(exact, 1.0, voltage=dea.Sine(0.5, 0.25 * UNIT)).stretch(time, 2)
        assert run.column("lam") == pytest.approx(due, abs=2e-4)


# ---------------------------------------------------------------- relaxation, energy, long steps


@pytest.mark.parametrize("branch", [GENT, THINNING], ids=["spring", "flow law"])
def test_relaxation_at_a_held_stretch(branch):
    """The reaction is that of the equation da/dt = dev t/eta at a constant stretch."""
    scene = dea.Scene(
        block((1, 1)), {"film": material(branch)},
        [dea.Electrode("top", 1.0), dea.Ground("bottom")],
        supports=[dea.Fix("bottom", "z"), dea.Fix("x_min", "r")],
        prescribed=[dea.Stretch("top", "z", 1.5)], kinematics=dea.Axisymmetric(),
    )  # fmt: skip
    path = dea.March(2.0, {"stretch": 1.0}, tolerance=5e-4, at=(0.1, 0.5))
    run = solve(scene, path, {"force": dea.Reaction("top", "z"), "heat": dea.Dissipation()})
    course = march(Film(material(branch), SIDE, Held(1.5)), 2.0)
    force, time = run.column("force_N")[1:], run.column("time_s")[1:]
    area = math.pi * SIDE**2
    assert force / area == pytest.approx(course.at(time).stress[0], rel=5e-3)
    assert force[0] > 2 * force[-1]
    assert np.all(run.column("heat_W") >= 0)


def test_energy_balances_with_second_order():
    record = {
        "heat": dea.Dissipation(), "spring": dea.Energy("viscous"),
        "elastic": dea.Energy("elastic"), "field": dea.Energy("electric"), "q": dea.Charge("top"),
    }  # fmt: skip
    gaps = []
    for steps in (20, 40):
        path = dea.March(2.0, {"voltage": SINE}, steps=steps)
        rows = solve(film(GENT, THINNING), path, record).history
        volts, charge, time = rows["voltage_V"], rows["q_C"], rows["time_s"]
        heat = rows["heat_W"]
        assert np.all(heat >= 0)
        work = np.sum((volts[1:] + volts[:-1]) / 2 * np.diff(charge))
        lost = np.sum((heat[1:] + heat[:-1]) / 2 * np.diff(time))
        stored = rows["spring_J"] + rows["elastic_J"] + rows["field_J"]
        gaps.append(abs(work - lost - (stored[-1] - stored[0])) / lost)
    assert gaps[1] < 0.35 * gaps[0]
    assert gaps[1] < 5e-2


@pytest.mark.parametrize("branch", [GENT, THINNING], ids=["spring", "flow law"])
def test_long_steps_and_named_responses(branch):
    """After steps of a million relaxation times, and relaxed, the branch bears nothing."""
    exact = Film(material(branch), SIDE)
    alone, stiff = (
        march(limit(exact), 1.0, voltage=0.5 * UNIT).stretch(1.0, 2)
        for limit in (relaxed, instantaneous)
    )
    for path in (
        dea.March(1e6, {"voltage": dea.Rise(0.5, 0.5e6)}, steps=4),
        dea.Ramp("voltage", 0.5, steps=2, response="relaxed"),
    ):
        assert solve(film(branch), path, THICKNESS).column("lam")[-1] == pytest.approx(
            alone, abs=1e-6 if isinstance(path, dea.March) else 1e-8
        )
    quick = solve(
        film(branch), dea.Ramp("voltage", 0.5, steps=2, response="instantaneous"), THICKNESS
    )
    assert quick.column("lam")[-1] == pytest.approx(stiff, abs=1e-8)


def test_pull_in_is_located_in_time():
    branch = dea.ViscousBranch(dea.Gent(20e3, 80.0), 0.5)
    course = march(Film(material(branch), SIDE), 5.0, voltage=0.9 * UNIT)
    with pytest.raises(EquilibriumLost) as lost:
        solve(film(branch), dea.March(5.0, {"voltage": 0.9}, tolerance=1e-3), THICKNESS)
    assert lost.value.run.history[-1]["time_s"] == pytest.approx(course.pull_in.time, rel=1e-2)



# ---------------------------------------------------------------- on ranks, resumed, in results


def on_any_ranks(comm):
    """A march of two cells with both kinds of branches."""
    geometry = BoxStack(SIDE, None, [Layer("film", SIDE, divisions=1)], divisions=(2,), order=2)
    scene = film(GENT, THINNING, dea.Maxwell(5e3, 0.2), device=dea.read_gmsh(geometry, comm))
    run = solve(scene, dea.March(0.5, {"voltage": SINE}, steps=3), THICKNESS)
    return [run.column("lam").tolist(), run.column("heat_W").tolist()]


@pytest.fixture(scope="module")
def alone():
    return on_any_ranks(MPI.COMM_SELF)


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_on_ranks(on_ranks, alone, ranks):
    """Also where there are more ranks than cells."""
    found = on_ranks("test_viscous_branches", "on_any_ranks", ranks)
    assert found[0] == pytest.approx(alone[0], rel=1e-9)
    assert found[1] == pytest.approx(alone[1], rel=1e-6, abs=1e-15)


class Stopper:
    """An observable that interrupts the run when it is measured for a given time."""

    unit, of_the_state = "", False

    def __init__(self, last):
        self.last, self.count = last, 0

    def bind(self, problem):
        def value():
            self.count += 1
            if self.count == self.last:
                raise KeyboardInterrupt
            return 0.0

        return value


def test_a_march_goes_on_after_it_was_killed(tmp_path):
    path = dea.March(0.5, {"voltage": SINE}, steps=6)
    scene = [film(THINNING, GENT) for _ in range(3)]
    whole = solve(scene[0], path, THICKNESS | {"stop": Stopper(0)})
    with pytest.raises(KeyboardInterrupt):
        solve(scene[1], path, THICKNESS | {"stop": Stopper(5)}, out=tmp_path / "out")
    again = solve(
        scene[2], path, THICKNESS | {"stop": Stopper(0)}, out=tmp_path / "out", resume=True
    )
    assert again.column("lam") == pytest.approx(whole.column("lam"), rel=1e-9)


def test_true_stresses_contain_those_of_the_branches():
    """A bar under a dead stress has the true stress that its load gives."""
    scene = dea.Scene(
        block((1, 1)), {"film": dea.Material(dea.NeoHookean(MU), viscous=[GENT])},
        supports=[dea.Fix("bottom", "z"), dea.Fix("x_min", "r")],
        loads=[dea.DeadLoad("top", (0.0, 20e3))], kinematics=dea.Axisymmetric(),
    )  # fmt: skip
    record = {
        "lam": dea.MeanStretch(("bottom", "top"), "z"),
        "stress": dea.AtPoint((0.3e-3, 0.4e-3), "stress", "zz"),
    }
    run = solve(scene, dea.March(1.0, {"load": dea.Rise(1.0, 1.0)}, steps=5), record)
    row = run.history[-1]
    column = next(name for name in row if name.startswith("stress"))
    assert row[column] == pytest.approx(20e3 * row["lam"], rel=1e-8)


@pytest.mark.parametrize("kappa", [None, 20 * MU])
def test_the_work_of_branches_is_the_variation_of_their_energy(monkeypatch, kappa):
    branches = [dea.Maxwell(10e3, 0.5), dea.Maxwell(3e3, 20.0)]

    def residual():
        problem = Problem(film(*branches, cells=(2, 2), bulk_modulus=kappa))
        values = np.random.default_rng(0).standard_normal(problem.size)
        for part in problem.displacement:
            problem.w.x.array[part.dofs] = 2e-3 * values[part.dofs]
        return problem.residual()

    own = residual()
    monkeypatch.setattr(Viscous, "work", lambda *_: None)
    assert np.linalg.norm(own - residual()) < 1e-13 * np.linalg.norm(own)
