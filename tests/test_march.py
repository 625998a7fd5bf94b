"""Marches: viscous branches, error control, loss of equilibrium in time, drives, resuming."""

import math

import numpy as np
import pytest
from conftest import block

import dea_fenicsx as dea
from dea_fenicsx.support.errors import EquilibriumLost, InputError

G, LIMIT, SIDE = 15.36e3, 5.99, 1e-3
BRANCHES = [dea.Maxwell(26.06e3, 0.6074), dea.Maxwell(26.53e3, 6.56), dea.Maxwell(10.83e3, 61.25)]
EQUILIBRIUM = dea.ArrudaBoyce(G, LIMIT, form="pade")
VHB = dea.Material(EQUILIBRIUM, dea.IdealDielectric(4.8), viscous=BRANCHES)
ELASTIC = dea.Material(EQUILIBRIUM, dea.IdealDielectric(4.8))
UNIT = SIDE * math.sqrt(G / (4.8 * 8.8541878188e-12))
"""Voltage in V of the nominal field 1, in units of sqrt(G/eps)."""

STRETCH = {"u": dea.MeanDisplacement("x_max", "x")}


def film(volts=UNIT, material=VHB, **more):
    return dea.Scene(
        block((1, 1, 1)), {"film": material}, [dea.Electrode("top", volts), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")], **more,
    )  # fmt: skip


def stretch(run, row=-1):
    return 1 + run.history[row]["u_m"] / SIDE


def solve(scene, path, record=STRETCH, **more):
    return dea.solve(scene, path, record, quiet=True, **{"stability": "never"} | more)


# ---------------------------------------------------------------- loss of equilibrium in time


def test_creep_ends_in_a_pull_in_whose_time_converges():
    """Field 0.9: stretch 1.0309709 at first, pull-in after 75.208 s at stretch 1.707944."""
    errors = []
    for tolerance in (1e-4, 1e-5):
        with pytest.raises(EquilibriumLost, match="s after the beginning of the march") as lost:
            solve(film(0.9 * UNIT), dea.March(200, {"voltage": 1.0}, tolerance=tolerance))
        run = lost.value.run
        assert stretch(run, 1) == pytest.approx(1.0309709, abs=5e-8)
        errors.append(abs(run.history[-1]["time_s"] - 75.208))
    assert errors[0] < 0.1
    assert errors[1] < 0.25 * errors[0]
    assert stretch(run) == pytest.approx(1.707944, abs=5e-5)
    failure = run.summary["failures"][0]
    assert failure["mode"] == "pull-in"
    assert failure["time_s"] == run.history[-1]["time_s"]
    assert run.summary["status"] == "equilibrium lost"


def test_pull_in_of_a_ramp_in_time_lies_between_its_limits():
    """Rate 1.6 /s: field 1.508249, stretch 1.282547."""
    march = dea.March(1.25, {"voltage": dea.Rise(2.0, 1.25)}, tolerance=1e-5)
    with pytest.raises(EquilibriumLost) as lost:
        solve(film(), march)
    run = lost.value.run
    assert run.history[-1]["voltage_V"] / UNIT == pytest.approx(1.508249, abs=3e-4)
    assert stretch(run) == pytest.approx(1.282547, abs=3e-4)


def test_a_few_long_steps_are_no_verdict():
    """With 4 steps the discrete film would be lost long before; the steps are halved instead."""
    march = dea.March(1.25, {"voltage": dea.Rise(2.0, 1.25)}, steps=4)
    with pytest.raises(EquilibriumLost) as lost:
        solve(film(), march)
    assert lost.value.run.history[-1]["voltage_V"] / UNIT == pytest.approx(1.508249, abs=6e-3)


# ---------------------------------------------------------------- named responses


@pytest.mark.parametrize(
    ("response", "field"), [("relaxed", 0.69519), ("instantaneous", 1.56015)]
)
def test_named_responses_have_the_pull_in_of_their_energy(response, field):
    with pytest.raises(EquilibriumLost) as lost:
        solve(film(), dea.Ramp("voltage", 2.0, steps=10, response=response))
    low, high = (dict(factors)["voltage"] for factors in (lost.value.reached, lost.value.failed))
    assert low - 1e-9 <= field <= high + 1e-9 or abs(low - field) < 5e-4


def test_relaxed_states_are_those_of_the_equilibrium_alone():
    path = dea.Ramp("voltage", 0.6, steps=3)
    exact = solve(film(material=ELASTIC), path)
    relaxed = solve(film(), dea.Ramp("voltage", 0.6, steps=3, response="relaxed"))
    assert stretch(relaxed) == pytest.approx(stretch(exact), rel=1e-9)


def test_a_relaxed_ramp_after_a_march_relaxes_first():
    path = [
        dea.March(2.0, {"voltage": dea.Rise(0.4, 1.0)}, tolerance=1e-3),
        dea.Ramp("voltage", 0.6, steps=2, response="relaxed"),
    ]
    run = solve(film(), path)
    exact = solve(film(material=ELASTIC), dea.Ramp("voltage", 0.6, steps=3))
    assert stretch(run) == pytest.approx(stretch(exact), rel=1e-9)
    assert run.history[-1]["time_s"] == 2.0


def test_a_march_of_an_elastic_body_follows_its_drive():
    run = solve(
        film(material=ELASTIC), dea.March(2.0, {"voltage": dea.Sine(1.0, 0.5)}, at=(0.25,))
    )
    static = solve(film(material=ELASTIC), dea.Ramp("voltage", 0.5))
    row = next(k for k, row in enumerate(run.history) if row["time_s"] == 0.25)
    assert stretch(run, row) == pytest.approx(stretch(static), rel=1e-9)
    assert run.history[-1]["time_s"] == 2.0
    assert abs(stretch(run) - 1) < 1e-9


# ---------------------------------------------------------------- relaxation, energy


def test_a_small_held_strain_relaxes_exponentially():
    """sigma(t)/sigma(0) = (G + sum G_k exp(-t/tau_k)) / (G + sum G_k) for small strain."""
    neo = dea.Material(dea.NeoHookean(10e3), viscous=[dea.Maxwell(20e3, 0.5), dea.Maxwell(5e3, 8)])
    scene = dea.Scene(
        block((1, 1, 1)), {"film": neo},
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
        prescribed=[dea.Stretch("x_max", "x", 1.0001)],
    )  # fmt: skip
    record = {"force": dea.Reaction("x_max", "x"), "heat": dea.Dissipation()}
    march = dea.March(3.0, {"stretch": 1.0}, tolerance=1e-9, at=(0.5, 1.0))
    run = solve(scene, march, record)
    force, time = run.history["force_N"][1:], run.history["time_s"][1:]
    exact = (10 + 20 * np.exp(-time / 0.5) + 5 * np.exp(-time / 8)) / 35
    # The closed form is that of an infinitesimal strain, and the strain is 1e-4.
    assert force / force[0] == pytest.approx(exact, abs=1e-4)
    assert {0.5, 1.0, 3.0} <= set(time)
    assert np.all(run.history["heat_W"] >= 0)


def test_energy_balances_with_second_order():
    """Electric work in = change of what is stored + what is dissipated, over one cycle."""
    record = {
        "heat": dea.Dissipation(), "spring": dea.Energy("viscous"),
        "elastic": dea.Energy("elastic"), "field": dea.Energy("electric"), "q": dea.Charge("top"),
    }  # fmt: skip
    gaps = []
    for steps in (80, 160):
        march = dea.March(2.0, {"voltage": dea.Sine(0.5, 0.5)}, steps=steps)
        rows = solve(film(), march, record).history
        volts, charge, time = rows["voltage_V"], rows["q_C"], rows["time_s"]
        work = np.sum((volts[1:] + volts[:-1]) / 2 * np.diff(charge))
        heat = np.sum((rows["heat_W"][1:] + rows["heat_W"][:-1]) / 2 * np.diff(time))
        stored = rows["spring_J"] + rows["elastic_J"] + rows["field_J"]
        assert np.all(rows["heat_W"] >= 0)
        assert heat > 0
        gaps.append(abs(work - heat - (stored[-1] - stored[0])) / heat)
    assert gaps[1] < 0.3 * gaps[0]
    assert gaps[1] < 2e-2


def test_constants_of_branches_are_those_of_the_present_scene():
    """A problem that is used again takes moduli and relaxation times of the new scene."""
    path = dea.March(1.0, {"voltage": 0.4}, steps=10)
    other = dea.Material(
        EQUILIBRIUM, dea.IdealDielectric(4.8),
        viscous=[dea.Maxwell(20e3, 0.3), dea.Maxwell(30e3, 2.0), dea.Maxwell(10e3, 20.0)],
    )  # fmt: skip
    alone = stretch(solve(film(material=other), path))
    first = solve(film(), path)
    assert stretch(first) != pytest.approx(alone, rel=1e-4)
    del first
    assert stretch(solve(film(material=other), path)) == pytest.approx(alone, rel=1e-12)


# ---------------------------------------------------------------- drives


def test_a_jump_is_instantaneous_and_lands_on_its_time():
    run = solve(film(), dea.March(2.0, {"voltage": dea.Step(0.5, at=1.0)}, tolerance=1e-3))
    rows = [row for row in run.history if row["time_s"] == 1.0]
    assert [row["voltage_V"] for row in rows] == pytest.approx([0.0, 0.5 * UNIT])
    quick = solve(film(), dea.Ramp("voltage", 0.5, steps=1, response="instantaneous"))
    assert rows[-1]["u_m"] == pytest.approx(quick.history[-1]["u_m"], rel=1e-8)
    assert run.history[-1]["u_m"] > rows[-1]["u_m"]


@pytest.mark.parametrize("kind", ["viscous", "elastic", "moving"])
def test_a_fast_drive_after_a_long_rest_is_that_without_the_rest(kind):
    """An hour is rounded to 5e-13 s, which is no jump of the drive and no time left to the end."""
    branches = BRANCHES if kind == "viscous" else ()
    material = dea.Material(EQUILIBRIUM, VHB.electric, viscous=branches, density=1e3)
    drive = {"voltage": dea.Rise(0.4, 1e-3)}
    pulse = dea.March(1e-3, drive, steps=10, inertia=kind == "moving")
    at_once = solve(film(material=material), pulse).history
    rested = solve(film(material=material), [dea.March(3600.0, steps=1), pulse]).history
    assert (len(at_once), len(rested)) == (11, 12)
    assert rested[-1]["u_m"] == pytest.approx(at_once[-1]["u_m"], rel=1e-6)


def test_waves_know_their_corners():
    assert dea.Triangle(0.5).corners(0, 4) == (0.5, 1.5, 2.5, 3.5)
    assert dea.Square(1.0).corners(0, 2) == (0.5, 1.0, 1.5)
    square = dea.Square(1.0, amplitude=2.0, mean=1.0)
    assert (square.before(0.5), square(0.5)) == (3.0, -1.0)
    table = dea.Table([0, 1, 1, 2], [0, 1, 3, 3])
    assert (table.before(1.0), table(1.0), table(0.5)) == (1.0, 3.0, 0.5)
    assert dea.Rise(2.0, 4.0)(1.0) == 0.5
    chirp = dea.Chirp(1.0, 3.0, 2.0)
    assert chirp(2.0) == pytest.approx(math.sin(2 * math.pi * 4.0), abs=1e-12)


@pytest.mark.parametrize(
    ("path", "words"),
    [
        (dea.Ramp("voltage"), "response="),
        (dea.March(-1.0), "> 0 in s"),
        (dea.March(2.0, {"voltage": dea.Table([0, 1], [0, 1])}), "ends at 1 s"),
        (dea.March(2.0, {"voltage": dea.Table([0, 2, 1, 3], [0, 1, 2, 3])}), "run backwards"),
        (dea.March(2.0, {"volt": dea.Sine(1.0)}), "ramp in the scene"),
        (dea.March(2.0, {"voltage": dea.Sine(-1.0)}), "frequency"),
        (dea.March(2.0, {"voltage": lambda t: float("nan")}), "finite number"),
        (dea.March(2.0, at=(3.0,)), "land on 3 s"),
        (dea.March(2.0, order=4), "1, 2 or 3"),
        (dea.March(2.0, steps=0), "whole number"),
        (dea.Ramp("voltage", response="slow"), "slow"),
    ],
)
def test_bad_paths_get_one_sentence(path, words):
    with pytest.raises(InputError, match=words):
        solve(film(), path)


@pytest.mark.parametrize("branch", [dea.Maxwell(-1.0, 1.0), dea.Maxwell(1.0, 0.0)])
def test_unphysical_branches_are_refused(branch):
    bad = dea.Material(EQUILIBRIUM, dea.IdealDielectric(4.8), viscous=[branch])
    with pytest.raises(InputError, match="viscous branch"):
        solve(film(material=bad), dea.March(1.0))


# ---------------------------------------------------------------- resuming


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


@pytest.mark.parametrize("last", [4, 12])
def test_a_march_goes_on_after_it_was_killed(tmp_path, last):
    path = [
        dea.Ramp("voltage", 0.3, steps=2, response="instantaneous"),
        dea.March(0.9, {"voltage": dea.Square(1.0, 0.1, 0.4)}, tolerance=1e-2, at=(0.7,)),
    ]
    whole = solve(film(), path, {**STRETCH, "stop": Stopper(0)})
    with pytest.raises(KeyboardInterrupt):
        solve(film(), path, {**STRETCH, "stop": Stopper(last)}, out=tmp_path / "out")
    again = solve(
        film(), path, {**STRETCH, "stop": Stopper(0)}, out=tmp_path / "out", resume=True
    )
    for time in (0.5, 0.7, 0.9):
        mine, other = (
            [row["u_m"] for row in run.history if row["time_s"] == time] for run in (whole, again)
        )
        assert mine == pytest.approx(other, rel=1e-8)
        assert mine


def test_another_drive_of_the_same_name_is_not_resumed(tmp_path):
    def path(factor):
        return dea.March(0.4, {"voltage": lambda t: factor * t}, steps=4)

    with pytest.raises(KeyboardInterrupt):
        solve(film(), path(0.5), {**STRETCH, "stop": Stopper(3)}, out=tmp_path / "out")
    again = {**STRETCH, "stop": Stopper(0)}
    with pytest.raises(InputError, match="its drives is not this script's"):
        solve(film(), path(0.6), again, out=tmp_path / "out", resume=True)
    assert solve(film(), path(0.5), again, out=tmp_path / "out", resume=True).history


def test_a_corner_of_the_drive_keeps_the_tolerance():
    """The slope of a triangle jumps; a finer tolerance brings the end closer to the exact one."""
    wave = dea.Triangle(0.25, amplitude=0.6)
    ends = [
        stretch(solve(film(), dea.March(4.5, {"voltage": wave}, tolerance=tolerance)))
        for tolerance in (1e-4, 1e-5, 1e-7)
    ]
    assert abs(ends[0] - ends[2]) < 3e-4
    assert abs(ends[1] - ends[2]) < 3e-5
