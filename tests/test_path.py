"""The path: exact landings, retries, a clean end past pull-in, kill and resume."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from conftest import ROOT, block, clean_environment, needed_mpirun, numbers_of_ranks
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.path.events import Sentinel
from dea_fenicsx.path.evidence import MOST_NEWTON_WITHOUT_PROOF, Evidence
from dea_fenicsx.path.predictor import Predictor

MU, EPS_R, T = 50e3, 2.86, 1e-3
LIMIT = 0.68736 * T * np.sqrt(MU / (EPS_R * EPSILON_0))  # phi^2 = lam^-2 - lam^-8
CUBE = ROOT / "demos" / "cube.py"
HDEA = ROOT / "demos" / "hdea_two_turn.py"


def free_film(volts, device=None, elastic=None):
    return dea.Scene(
        device or block((1, 1, 1)),
        {"film": dea.Material(elastic or dea.NeoHookean(MU), dea.IdealDielectric(EPS_R))},
        electrodes=[dea.Electrode("top", volts), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
    )


STRETCH = {"stretch": dea.MeanStretch(("bottom", "top"), "z")}


def test_equal_steps_land_exactly():
    run = dea.solve(free_film(1000.0), dea.Ramp(steps=7), quiet=True)
    assert run.column("voltage_V") == pytest.approx(np.arange(8) * 1000 / 7, rel=1e-15)
    assert run["voltage_V"] == 1000.0


def test_requested_loads_are_landed_on():
    ramp = dea.Ramp(steps=20, at=(0.3, 0.777))
    volts = dea.solve(free_film(1000.0), ramp, quiet=True).column("voltage_V")
    for wanted in (300.0, 777.0, 1000.0):
        assert np.min(np.abs(volts - wanted)) < 1e-9
    assert len(volts) < 21  # the steps grew


def test_ramp_down_again():
    path = [dea.Ramp("voltage", steps=4), dea.Ramp("voltage", to=0.0, steps=4)]
    run = dea.solve(free_film(0.9 * LIMIT), path, STRETCH, quiet=True)
    assert run["stretch"] == pytest.approx(1, abs=1e-9)
    assert run.column("stretch")[4] < 0.9


def test_first_step_far_too_long_is_cut():
    """A single step to 99.9 % of pull-in is halved until it succeeds."""
    run = dea.solve(free_film(0.999 * LIMIT), dea.Ramp(steps=1), STRETCH, quiet=True)
    assert run["voltage_V"] == pytest.approx(0.999 * LIMIT)
    assert 0.63 < run["stretch"] < 0.68


def bender(steps, volts):
    """A bilayer, 20 mm long; at 5 kV its tip has moved by 3.8 mm."""
    layers = [Layer("passive", 0.5e-3), Layer("active", 0.5e-3)]
    device = dea.read_gmsh(BoxStack(20e-3, None, layers, 20), MPI.COMM_SELF)
    scene = dea.Scene(
        device,
        {"passive": dea.Material(dea.NeoHookean(MU)),
         "active": dea.Material(dea.Gent(MU, 90.0), dea.IdealDielectric(EPS_R))},
        electrodes=[dea.Electrode("top", volts), dea.Ground("interface_1")],
        supports=[dea.Clamp("x_min")],
        kinematics=dea.PlaneStrain(),
    )  # fmt: skip
    seen = {"tip": dea.MeanDisplacement("x_max", "y")}
    return dea.solve(scene, dea.Ramp(steps=steps), seen, quiet=True)


def test_one_large_step_is_trusted_if_a_path_leads_there():
    once, slowly = bender(1, 5000.0), bender(20, 5000.0)
    assert once["tip_m"] == pytest.approx(slowly["tip_m"], rel=1e-8)
    assert once["tip_m"] == pytest.approx(-3.8585e-3, rel=1e-3)  # own value
    assert len(once.history) == 2
    assert MOST_NEWTON_WITHOUT_PROOF + 1 < once.summary["newton_iterations"] < 20


def test_one_large_step_beyond_the_maximum_is_refused():
    """There a Gent film has an equilibrium at a large stretch, but no path to it."""
    film = free_film(1.2 * LIMIT, elastic=dea.Gent(MU, 20.0))
    with pytest.raises(dea.EquilibriumLost):
        dea.solve(film, dea.Ramp(steps=1), STRETCH, quiet=True)


def test_no_path_leads_over_a_snap(monkeypatch):
    """At 0.9 of its maximum a Gent film is thick or, after a snap, thin: seen from rest, a jump."""
    film = free_film(LIMIT, elastic=dea.Gent(MU, 20.0))
    add, led = Predictor.add, []

    def judged(self, end):
        if end.factors["voltage"] == 0.9:
            rest = end.with_factors({"voltage": 0.0}).with_values(0 * end.values)
            from_rest = Predictor(self.solver, ("voltage",))
            add(from_rest, rest)
            evidence = Evidence(self.solver, from_rest, Sentinel(self.solver))
            led.append(evidence.leads_to(end))
            assert self.problem.state == end
        add(self, end)

    monkeypatch.setattr(Predictor, "add", judged)
    path = [dea.Ramp(to=0.9, steps=9), dea.Ramp(to=1.1, steps=2, snap=True),
            dea.Ramp(to=0.9, steps=2)]  # fmt: skip
    run = dea.solve(film, path, STRETCH, quiet=True)
    # the thick state was added twice: as the first ramp's last one and the second's first one
    assert led == [True, True, False]
    assert run["stretch"] == pytest.approx(0.1193, rel=1e-3)


@pytest.mark.parametrize("elastic", [dea.NeoHookean(MU), dea.Gent(MU, 175.0)], ids=str)
def test_past_pull_in_the_last_states_are_kept(tmp_path, elastic):
    """The interval named holds the closed form's limit point; nothing beyond it is accepted."""
    limit = LIMIT if isinstance(elastic, dea.NeoHookean) else 0.6885 / 0.68736 * LIMIT
    with pytest.raises(dea.EquilibriumLost) as caught:
        dea.solve(free_film(1.45 * limit, elastic=elastic), dea.Ramp(steps=6), STRETCH, tmp_path,
                  quiet=True)  # fmt: skip
    error = caught.value
    low, high = (1.45 * limit * f["voltage"] for f in (error.reached, error.failed))
    assert low < limit < high < 1.02 * limit
    assert f"{low:.6g} V" in str(error)
    history = dea.read_history(tmp_path)
    assert history["voltage_V"][-1] == pytest.approx(low)
    assert np.all(np.diff(history["stretch"]) < 0)
    assert np.all(history["stretch"] > 0.62)
    assert dea.read_summary(tmp_path)["status"] == "equilibrium lost"


@pytest.mark.demo
@pytest.mark.mpi
@pytest.mark.slow
def test_exit_status_past_pull_in(start, tmp_path):
    done = start(CUBE, "--voltage", 900, "--out", tmp_path, "--quiet", ranks=2)
    assert done.returncode == 3
    assert done.stderr.count("Equilibrium was lost between 866") == 1
    assert "Traceback" not in done.stderr
    volts = dea.read_history(tmp_path)["voltage_V"][-1]
    assert 866 < volts < 866.9


def test_too_large_a_stretch_in_one_step_is_cut():
    """Gent at 94 % of Jm in a single step: trial states past lock-up are refused."""
    limit = 20.0
    lam = 3.3
    scene = dea.Scene(
        block((1, 1, 1)),
        {"film": dea.Material(dea.Gent(MU, limit))},
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
        prescribed=[dea.Stretch("x_max", "x", lam), dea.Stretch("y_max", "y", lam)],
    )
    run = dea.solve(scene, dea.Ramp(steps=1),
                    {"R": dea.Reaction("x_max", "x"), **STRETCH}, quiet=True)  # fmt: skip
    I1 = 2 * lam**2 + lam**-4
    mu = MU * limit / (limit - I1 + 3)
    assert run["R_N"] == pytest.approx(T**2 * mu * (lam - lam**-5), rel=1e-8)


def test_beyond_lock_up_ends_cleanly():
    """Equi-biaxial 3.5 with Jm = 20 (limit 3.391) cannot be reached; the end says where."""
    scene = dea.Scene(
        block((1, 1, 1)),
        {"film": dea.Material(dea.Gent(MU, 20.0))},
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
        prescribed=[dea.Stretch("x_max", "x", 3.5), dea.Stretch("y_max", "y", 3.5)],
    )
    with pytest.raises(dea.EquilibriumLost) as caught:
        dea.solve(scene, dea.Ramp(steps=5), STRETCH, quiet=True)
    reached = 1 + 2.5 * caught.value.reached["stretch"]
    assert 3.3 < reached < 3.392


def kill_after(out, steps, script, *arguments, ranks=2):
    """Start a script and kill -9 all of it once `steps` steps are on disk."""
    mpirun = needed_mpirun()
    command = [mpirun, "-n", str(ranks), sys.executable, str(script), "--out", str(out), "--quiet",
               *map(str, arguments)]  # fmt: skip
    process = subprocess.Popen(command, cwd=ROOT, env=clean_environment(), start_new_session=True,
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                               stdin=subprocess.DEVNULL)  # fmt: skip
    deadline = time.time() + 240
    while time.time() < deadline and process.poll() is None:
        history = out / "history.csv"
        if history.exists() and len(history.read_text().splitlines()) > steps + 1:
            break
        time.sleep(0.05)
    assert process.poll() is None, "the run ended before it could be killed"
    children = subprocess.run(["pgrep", "-f", str(out)], capture_output=True, text=True).stdout
    for pid in children.split():
        if int(pid) != os.getpid():
            with contextlib.suppress(ProcessLookupError):
                os.kill(int(pid), signal.SIGKILL)
    process.wait(timeout=60)


@pytest.mark.demo
@pytest.mark.slow
@pytest.mark.mpi
def test_killed_and_resumed_on_another_number_of_ranks(start, tmp_path):
    """kill -9 in mid-ramp: all completed steps open; resuming gives the undisturbed result."""
    options = ("--mesh", 1, "--steps", 6, "--no-check")
    kill_after(tmp_path / "killed", 2, HDEA, *options)
    history = dea.read_history(tmp_path / "killed")
    assert 3 <= len(history["step"]) < 7
    xdmf = (tmp_path / "killed" / "fields.xdmf").read_text()
    assert xdmf.count("<Time") >= len(history["step"])
    for name in set(part.split(":")[0] for part in _references(xdmf)):
        assert (tmp_path / "killed" / name).exists()
    assert json.loads((tmp_path / "killed" / "summary.json").read_text())["status"] == "running"

    start(HDEA, *options, "--quiet", "--out", tmp_path / "whole", check=True)
    others = {1, *numbers_of_ranks()} - {2}  # it was started on two
    start(HDEA, *options, "--quiet", "--out", tmp_path / "killed", "--resume", ranks=max(others),
          check=True)  # fmt: skip
    whole, resumed = (dea.read_history(tmp_path / name) for name in ("whole", "killed"))
    for column in ("voltage_V", "contraction", "charge_C", "max_field_V_per_m"):
        assert resumed[column] == pytest.approx(whole[column], rel=1e-8, abs=1e-12), column


def _references(xdmf):
    import re

    return re.findall(r'Format="HDF">([^<]+)<', xdmf)


def test_resume_refuses_another_scene(tmp_path):
    dea.solve(free_film(500.0), dea.Ramp(steps=2), STRETCH, tmp_path, quiet=True)
    before = (tmp_path / "history.csv").read_bytes()
    with pytest.raises(dea.InputError, match="cannot be resumed: its electrodes"):
        dea.solve(free_film(600.0), dea.Ramp(steps=2), STRETCH, tmp_path, quiet=True, resume=True)
    assert (tmp_path / "history.csv").read_bytes() == before


def test_resume_of_a_finished_run_changes_nothing(tmp_path):
    first = dea.solve(free_film(500.0), dea.Ramp(steps=2), STRETCH, tmp_path, quiet=True)
    again = dea.solve(free_film(500.0), dea.Ramp(steps=2), STRETCH, tmp_path, quiet=True,
                      resume=True)  # fmt: skip
    assert again["stretch"] == first["stretch"]
    assert len(again.history) == 3


def test_an_earlier_run_is_kept_aside(tmp_path):
    dea.solve(free_film(500.0), dea.Ramp(steps=2), STRETCH, tmp_path, quiet=True)
    before = (tmp_path / "history.csv").read_bytes()
    dea.solve(free_film(400.0), dea.Ramp(steps=2), STRETCH, tmp_path, quiet=True)
    assert (tmp_path / "previous" / "history.csv").read_bytes() == before
