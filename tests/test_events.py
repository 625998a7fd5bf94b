"""Events between steps: bifurcations and both branches, snaps, the ways in which a device fails."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pytest
from conftest import ROOT, block
from scipy.optimize import brentq

import dea_fenicsx as dea
from dea_fenicsx.materials import EPSILON_0

MU, EPS_R, T, JM = 50e3, 4.7, 1e-3, 120.0
UNIT = T * np.sqrt(MU / (EPS_R * EPSILON_0))
STRETCH = {"stretch": dea.MeanStretch(("x_min", "x_max"), "x")}
STRIP = ROOT / "demos" / "buckling_strip.py"


def film(elastic, breakdown=None, **more):
    return dea.Scene(
        block((1, 1, 1)),
        {"film": dea.Material(elastic, dea.IdealDielectric(EPS_R, breakdown))},
        electrodes=[dea.Electrode("top", UNIT), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
        **more,
    )


def held(stretch, breakdown=None):
    """A film that is stretched equally along both axes and held so."""
    sides = [dea.Stretch("x_max", "x", stretch), dea.Stretch("y_max", "y", stretch)]
    return film(dea.NeoHookean(MU), breakdown, prescribed=sides)


def events(run):
    return {row["event"]: row for row in run.history if row["event"]}


def test_battery_goes_through_the_hysteresis():
    """Up, hold, down: the film snaps at the maximum and back at the minimum, at their voltages."""
    path = [dea.Ramp("voltage", to=0.75, steps=9, snap=True),
            dea.Ramp("voltage", to=0.75, steps=2),
            dea.Ramp("voltage", to=0.0, steps=9, snap=True)]  # fmt: skip
    run = dea.solve(film(dea.Gent(MU, JM)), path, STRETCH, quiet=True)

    def exact(lam):
        mu = MU * JM / (JM - 2 * lam**2 - lam**-4 + 3)
        return T * np.sqrt(mu * (lam**2 - lam**-4) / lam**4 / (EPS_R * EPSILON_0))

    # stationary: values from the exact curve on a fine grid around 1.263 and 5.545
    near = [np.linspace(a, b, 200001) for a, b in ((1.25, 1.28), (5.4, 5.7))]
    top, low = exact(near[0]).max(), exact(near[1]).min()
    edge = np.sqrt(JM / 2 + 1.5) * (1 - 1e-5)
    columns = ("event", "voltage_V", "stretch")
    kinds = [tuple(row[c] for c in columns) for row in run.history if row["event"]]
    assert [k[0] for k in kinds] == ["maximum", "snap", "minimum", "snap"]
    assert [k[1] for k in kinds] == pytest.approx([top, top, low, low], rel=1e-8)
    landings = [brentq(lambda x: exact(x) - top, 6, edge), brentq(lambda x: exact(x) - low, 1, 1.2)]
    assert [kinds[1][2], kinds[3][2]] == pytest.approx(landings, rel=1e-6)
    assert run["stretch"] == pytest.approx(1, abs=1e-9)
    for row in run.history[1:]:
        if row["voltage_V"] > 0 and not row["event"]:
            assert row["voltage_V"] == pytest.approx(exact(row["stretch"]), rel=1e-7)
    assert run.summary["failures"][0]["mode"] == "pull-in"


def test_loss_of_tension_at_its_voltage():
    """A held film goes slack where eps E^2 = mu (lam^2 - lam^-4), whatever the steps."""
    lam = 1.5
    path = [dea.Ramp("stretch", steps=2), dea.Ramp("voltage", steps=3)]
    run = dea.solve(held(lam), path, quiet=True, failures=[dea.LossOfTension("z")])
    exact = T / lam**2 * np.sqrt(MU * (lam**2 - lam**-4) / (EPS_R * EPSILON_0))
    entry = run.summary["failures"][0]
    assert entry["mode"] == "loss of tension"
    assert entry["region"] == "film"
    assert entry["voltage_V"] == pytest.approx(exact, rel=1e-7)
    row = events(run)["loss of tension"]
    assert row["tension_Pa"] == pytest.approx(0, abs=1e-6 * MU)
    before = run.history[2]
    assert before["tension_Pa"] == pytest.approx(MU * (lam**2 - lam**-4), rel=1e-8)


def test_breakdown_and_stretch_limit(tmp_path):
    """A breakdown field that grows with the stretch, and a limit on the stretch itself."""
    lam, field = 1.5, 20e6
    path = [dea.Ramp("stretch", steps=4), dea.Ramp("voltage", to=0.9, steps=3)]
    watched = [dea.ElectricalBreakdown(), dea.StretchLimit(1.2)]
    run = dea.solve(held(lam, dea.Breakdown(field, 1.13)), path, out=tmp_path, quiet=True,
                    failures=watched)  # fmt: skip
    stretch, breakdown = run.summary["failures"]
    assert stretch["mode"] == "stretch limit"
    assert stretch["stretch_factor"] == pytest.approx(0.2 / 0.5, rel=1e-8)
    assert breakdown["mode"] == "electrical breakdown"
    assert breakdown["voltage_V"] == pytest.approx(field * lam**1.13 * T / lam**2, rel=1e-7)
    told = json.loads((tmp_path / "summary.json").read_text())
    assert told["failures"] == run.summary["failures"]
    with h5py.File(tmp_path / "fields.h5") as h5:
        last = h5[f"step_{len(run.history) - 1:05d}/cell"]
        assert last["breakdown_ratio"][0] == pytest.approx(run["breakdown_ratio"])
        assert last["largest_stretch"][0] == pytest.approx(1.5)


@pytest.mark.slow
@pytest.mark.demo
@pytest.mark.mpi
def test_strip_buckles(start, tmp_path):
    """Euler's load within 1 % at L/h = 50, its mode, and both branches; on two ranks."""
    start(STRIP, "--out", tmp_path, "--quiet", ranks=2, check=True)
    summary = dea.read_summary(tmp_path)
    assert summary["critical_voltage_V"] == pytest.approx(
        summary["closed_form_voltage_V"], rel=0.01
    )
    assert summary["buckled_branch_is_stable"] and summary["flat_branch_is_unstable"]
    # slender: the surplus eps E^2 - eps E_c^2 = 4 mu e goes into the arch's length, e = (pi A/2L)^2
    volts, critical = summary["buckled_voltage_V"], summary["critical_voltage_V"]
    surplus = EPS_R * EPSILON_0 * (volts**2 - critical**2) / 0.1e-3**2
    arch = 2 * 5e-3 / np.pi * np.sqrt(surplus / (4 * MU))
    assert summary["buckled_deflection_m"] == pytest.approx(arch, rel=2e-3)
    critical = events(dea.Run(_rows(tmp_path), {}, None))["bifurcation"]
    with h5py.File(tmp_path / "modes" / f"mode_{int(critical['step']):05d}.h5") as h5:
        points, mode = h5["points"][:], h5["node/mode"][:]
        x, v = points[:, 0] / points[:, 0].max(), mode[:, 1]
        # Euler's mode of a clamped strip
        assert np.abs(v) == pytest.approx((1 - np.cos(2 * np.pi * x)) / 2, abs=0.01)


def _rows(folder):
    history = dea.read_history(folder)
    return [{k: history[k][i] for k in history} for i in range(len(history["step"]))]


@pytest.mark.parametrize(
    ("failure", "words"),
    [
        (dea.LossOfTension("q"), "normal is 'q'"),
        (dea.LossOfTension("z", ("skin",)), "no region named 'skin'"),
        (dea.StretchLimit(0.5), "a number > 1"),
        (dea.ElectricalBreakdown(), "No dielectric of the scene has a breakdown field"),
        (dea.ElectricalBreakdown(safety=0.0), "a number > 0"),
    ],
)
def test_failures_are_checked(failure, words):
    with pytest.raises(dea.InputError, match=words):
        dea.solve(held(1.5), dea.Ramp(steps=2), quiet=True, failures=[failure])


def test_switching_needs_the_inertia():
    with pytest.raises(dea.InputError, match='stability="every"'):
        dea.solve(held(1.5), dea.Trace("voltage", switch=0.1), quiet=True)
