"""Ramps that go on in motion where equilibrium is lost: where the body comes to rest."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from conftest import block, on_demand
from motion_scenes import rubber, sphere
from mpi4py import MPI
from scipy.integrate import quad
from scipy.optimize import brentq
from stopped_runs import Stop

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.path import ramping

LIMIT, THICKNESS = 8.0, 0.1
STRETCH = {"x": dea.MeanDisplacement("x_max", "x")}
DRAGGED = dea.InMotion(dea.Inertia(0.0, 1e-4, drag=6.0))
TOP = 0.74


def film(comm=MPI.COMM_SELF, elastic=None, viscous=(), **changes):
    """A free square film of a Gent rubber that stiffens early, so that its snap is a small one."""
    mesh = BoxStack(1.0, 1.0, [Layer("film", THICKNESS)], divisions=1)
    given = {
        "materials": {"film": rubber(viscous, elastic=elastic or dea.Gent(1.0, LIMIT))},
        "electrodes": [dea.Electrode("top", THICKNESS), dea.Ground("bottom")],
        "supports": [dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
    }
    return dea.Scene(dea.read_gmsh(mesh, comm), **(given | changes))


def ramped(at_loss=DRAGGED, scene=None, record=STRETCH, response=None, to=TOP, **options):
    ramp = dea.Ramp("voltage", to, 9, at_loss=at_loss, response=response)
    return dea.solve(scene or film(), ramp, record, quiet=True, **options)


@functools.cache
def moved():
    return ramped()


@functools.cache
def static():
    return ramped("snap")


def field(stretch):
    """Nominal field of the film in equilibrium, by the exact curve."""
    mu = LIMIT / (LIMIT - (2 * stretch**2 + stretch**-4 - 3))
    return np.sqrt(mu * (stretch**-2 - stretch**-8))


def landings(run):
    return [row for row in run.history if row["event"] == "snap"]


def test_a_film_comes_to_rest_where_it_snaps_statically():
    run, near = moved(), np.linspace(1.3, 1.45, 200001)
    top = field(near).max()
    exact = brentq(lambda s: field(s) - top, 1.6, 2.0) - 1
    (rest,), (snapped,) = landings(run), landings(static())
    assert rest["x_m"] == pytest.approx(exact, rel=1e-6)
    assert rest["x_m"] == pytest.approx(snapped["x_m"], rel=1e-9)
    assert rest["inertia"] == 0 and rest["residual"] <= 1.001e-10
    assert run["x_m"] == pytest.approx(static()["x_m"], rel=1e-9)
    assert run["voltage_V"] == pytest.approx(TOP * THICKNESS)
    events = run.summary["events"]
    assert [e["event"] for e in events] == ["maximum", "snap"]
    assert events[1]["static_difference_m"] < 1e-7
    assert events[1]["seconds"] == pytest.approx(rest["time_s"])


def test_the_motion_is_in_the_history():
    run = moved()
    way = [row for row in run.history if row["event"] == "motion"]
    time = [row["time_s"] for row in way]
    assert len(way) > 20 and np.all(np.diff(time) > 0)
    (rest,) = landings(run)
    assert {row["voltage_V"] for row in way} == {rest["voltage_V"]}
    assert np.all(np.diff([row["x_m"] for row in way]) > -1e-4)  # the damping is above critical
    after = run.history[run.history.index(rest) :]
    assert {row["time_s"] for row in after} == {rest["time_s"]}


def test_viscous_branches_bring_it_to_rest():
    """They flow on the way, and carry no stress where it rests."""
    scene = film(viscous=[dea.Maxwell(1.0, 1.0)])
    (rest,) = landings(ramped("motion", scene, response="relaxed", to=0.725))
    assert rest["x_m"] == pytest.approx(landings(static())[0]["x_m"], rel=1e-6)


def gent_sphere(volts):
    return sphere(volts, elastic=dea.Gent(1.0, 10.0), cells=(1, 3))


def test_a_sphere_comes_to_rest_where_the_exact_balance_says():
    """Its radius a: P(a) = eps V^2/2 (a^-4 - b^-4)/(1/a - 1/b)^2, with P of the stresses."""

    def outer(a):
        return (a**3 + 1.2**3 - 1) ** (1 / 3)

    def volts(a):
        def part(s):
            mu = 10.0 / (10.0 - (2 * s**2 + s**-4 - 3))
            return mu * 2 * (s**2 - s**-4) / (s * (s**3 - 1))

        b = outer(a)
        return np.sqrt(2 * quad(part, b / 1.2, a)[0] / (a**-4 - b**-4)) * (1 / a - 1 / b)

    record = {"x": dea.AtPoint((1.0, 0.0), "displacement", "r")}
    (rest,) = landings(ramped(scene=gent_sphere(0.145), record=record, to=1.0))
    volt = rest["voltage_V"]
    exact = brentq(lambda a: volts(a) - volt, 1.9, 2.2) - 1
    # three cells over a right angle; the elements snap at a slightly lower voltage of their own
    assert rest["x_m"] == pytest.approx(exact, rel=2e-3)
    (snapped,) = landings(ramped("snap", gent_sphere(0.145), record, to=1.0))
    assert rest["x_m"] == pytest.approx(snapped["x_m"], rel=1e-6)


def test_a_difference_from_the_static_landing_is_told(monkeypatch, capsys):
    """Here the static landing is taken to be the limit point."""
    found = ramping.over_the_limit

    def wrong(*given, **named):
        passage = found(*given, **named)
        return passage._replace(landing=passage.limit.state)

    monkeypatch.setattr(ramping, "over_the_limit", wrong)
    ramp = dea.Ramp("voltage", 0.725, 4, at_loss=DRAGGED)
    run = dea.solve(film(), ramp, STRETCH, verbose=True)
    assert run.summary["events"][1]["static_difference_m"] > 0.3
    told = "".join(capsys.readouterr())
    assert "rests elsewhere than where it snaps statically" in told


def test_a_body_that_does_not_come_to_rest():
    short = dea.InMotion(dea.Inertia(drag=6.0), seconds=3.0, compare=False)
    with pytest.raises(dea.EquilibriumLost, match="after 3 s it still moves") as error:
        ramped(short)
    run = error.value.run
    assert run.summary["status"] == "equilibrium lost"
    assert run.history[-1]["event"] == "motion" and run["time_s"] == pytest.approx(3.0)


def test_a_run_that_was_stopped_in_motion_is_resumed(tmp_path):
    """It goes on from the last state at rest, and does the motion again."""
    with pytest.raises(dea.Interrupted):
        ramped(record=STRETCH | {"s": Stop(40)}, out=tmp_path)
    run = ramped(record=STRETCH | {"s": Stop(-1)}, out=tmp_path, resume=True)
    assert run["x_m"] == pytest.approx(moved()["x_m"], rel=1e-9)
    assert [e["event"] for e in run.summary["events"]] == ["maximum", "snap"]
    assert run.summary["events"][1]["static_difference_m"] < 1e-7
    steps = [row["step"] for row in run.history]
    assert steps == list(range(len(steps)))


def test_what_is_refused():
    heavy = rubber(elastic=dea.Gent(1.0, LIMIT))
    for ramp, words in (
        (dea.Ramp(at_loss="motion"), "nothing brings the body to rest"),
        (dea.Ramp(at_loss="jump"), "at_loss"),
        (dea.Ramp(at_loss=DRAGGED, snap=True), "give one of them"),
        (dea.Ramp(at_loss=dea.InMotion(dea.Inertia(drag=-1.0))), "at least 0"),
        (dea.Ramp(at_loss=dea.InMotion(DRAGGED.inertia, seconds=0.0)), "time > 0"),
        (dea.Ramp(at_loss=dea.InMotion(DRAGGED.inertia, rest=1.0)), "below 1"),
        (dea.Ramp(at_loss=dea.InMotion(dea.Inertia(drag=1.0, velocity=(0.0,) * 3))), "velocity"),
    ):
        with pytest.raises(dea.InputError, match=words):
            dea.solve(film(), ramp, quiet=True)
    light = film(materials={"film": rubber(elastic=dea.Gent(1.0, LIMIT), density=None)})
    with pytest.raises(dea.InputError, match="'film' has no density"):
        ramped(scene=light)
    free = dea.Scene(block(), {"film": heavy}, supports=[dea.FreeBody()],
                     electrodes=[dea.Electrode("top", 1e-4), dea.Ground("bottom")])  # fmt: skip
    with pytest.raises(dea.InputError, match="FreeBody"):
        ramped(scene=free)


def test_snap_is_the_same_as_before():
    run = dea.solve(film(), dea.Ramp("voltage", TOP, 9, snap=True), STRETCH, quiet=True)
    assert run["x_m"] == static()["x_m"]
    assert "time_s" not in run.history.columns
    assert run.summary["newton_iterations"] == static().summary["newton_iterations"]


def on_some(comm):
    quick = dea.InMotion(dea.Inertia(0.0, 1e-3, drag=6.0), compare=False)
    run = ramped(quick, film(comm), to=0.725)
    return [row["x_m"] for row in landings(run)] + [run["x_m"]]


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, pytest.param(3, marks=on_demand)])
def test_on_several_ranks(ranks, on_ranks):
    found = on_ranks("test_snap_in_motion", "on_some", ranks)
    assert found == pytest.approx(on_some(MPI.COMM_SELF), rel=1e-7)
