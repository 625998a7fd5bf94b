"""Diagrams of all branches that a trace meets, and branches left at a later bifurcation."""

import json
import shutil

import numpy as np
import pytest

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.pictures.diagram import _runs
from dea_fenicsx.results.stable_parts import multiplicity, stability_intervals
from dea_fenicsx.run import branches

MU, EPS_R, H, SLENDER = 5e4, 4.7, 1e-4, 20.0
EULER = H * np.sqrt(4 * np.pi**2 / 3 * MU / (EPS_R * EPSILON_0)) / SLENDER
"""Voltage at which a slender clamped strip buckles; its second one is 1.4303 times as high."""

DEFLECTION = {
    "middle": dea.AtPoint((SLENDER * H / 2, H / 2), "displacement", "y"),
    "quarter": dea.AtPoint((SLENDER * H / 4, H / 2), "displacement", "y"),
}


def strip():
    mesh = BoxStack(SLENDER * H, None, [Layer("strip", H)], divisions=16)
    return dea.Scene(
        dea.read_gmsh(mesh),
        {"strip": dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(EPS_R))},
        electrodes=[dea.Electrode("top", EULER), dea.Ground("bottom")],
        supports=[dea.Clamp("x_min"), dea.Clamp("x_max")],
        kinematics=dea.PlaneStrain(),
    )


TRACE = dea.Trace("voltage", first=0.4, until=("voltage_V", 1.6 * EULER), steps=60)


def test_all_branches_of_a_strip(tmp_path):
    found = dea.branches(
        strip(), TRACE, DEFLECTION, tmp_path / "strip", most=2, both=True, quiet=True
    )
    names = ["first", "branch_1", "branch_1_back", "branch_2", "branch_2_back"]
    assert [branch.name for branch in found.branches] == names
    assert not any(branch.end for branch in found.branches)
    first = found["first"]
    assert [part["negative_modes"] for part in first.intervals] == [0, 1, 2]
    loads = [part["to"] for part in first.intervals]
    assert loads[0] == pytest.approx(EULER, rel=0.02)
    assert loads[1] / loads[0] == pytest.approx(1.43, rel=0.03)
    assert [count for _, count in first.bifurcations] == [1, 1]
    # arches, mirrored at the strip, which are stable; S shapes, mirrored as well
    up, down = (found[name].column("middle_m") for name in names[1:3])
    assert up == pytest.approx(-down, rel=1e-6, abs=1e-12)
    assert abs(up[-1]) > H / 2
    assert [part["negative_modes"] for part in found["branch_1"].intervals] == [0]
    s = found["branch_2"]
    assert s.column("voltage_V")[0] == pytest.approx(loads[1], rel=1e-6)
    assert abs(s.column("middle_m")).max() < 1e-3 * abs(s.column("quarter_m")).max()
    assert s.intervals[0]["negative_modes"] == 1
    told = json.loads((tmp_path / "strip" / "diagram.json").read_text("utf-8"))
    assert [branch["name"] for branch in told["branches"]] == names
    assert found.lost == told["lost"] == {}
    # any point is the start of another run, and each branch is a folder to resume
    state = found["branch_1"].state(-2)
    again = dea.solve(strip(), dea.Ramp("voltage", to=1.6, steps=1), DEFLECTION, start=state,
                      quiet=True)  # fmt: skip
    assert again["middle_m"] == pytest.approx(up[-1], rel=1e-6)
    resumed = dea.branches(strip(), TRACE, DEFLECTION, tmp_path / "strip", most=1, quiet=True,
                           resume=True)  # fmt: skip
    assert resumed["branch_1"].column("middle_m") == pytest.approx(up, rel=1e-12)
    shutil.copytree(tmp_path / "strip" / "branch_1", tmp_path / "strip" / "branch_9")
    pictures = found.draw("middle_m")
    assert {p.name for p in pictures} == {"middle_voltage.png", "middle_voltage.svg"}
    told = [branch.name for branch in resumed.branches]
    assert [place.name for place in _runs(tmp_path / "strip")] == told  # no other diagram's


def row(inertia, event="", load=0.0):
    return {"inertia": inertia, "event": event, "V": load, "inertia_is_of_this_step": not event}


def test_parts_meet_where_the_tangent_is_singular():
    rows = [row(0), row(0, "", 1.0), row(1, "maximum", 1.1), row(1, "", 1.0),
            row(3, "bifurcation", 0.5), row(3, "", 0.4)]  # fmt: skip
    parts = stability_intervals(rows, "V")
    assert [(p["negative_modes"], p["from"], p["to"]) for p in parts] == [
        (0, 0.0, 1.1), (1, 1.1, 0.5), (3, 0.5, 0.4),
    ]  # fmt: skip
    assert multiplicity(rows, 4) == 2
    both = [row(0), row(2, "bifurcation", 1.0), row(2, "bifurcation", 2.0), row(3, "", 2.5)]
    parts = stability_intervals(both, "V")
    assert [(p["negative_modes"], p["to"]) for p in parts] == [(0, 1.0), (1, 2.0), (3, 2.5)]
    assert multiplicity(rows[:4] + rows[4:5], 4) is None


def test_a_branch_that_cannot_be_begun_is_named(monkeypatch):
    """Its run ends before the bifurcation at which it leaves the first branch."""
    solve, calls = branches.solve, []

    def shorter(scene, items, *rest, **options):
        calls.append(scene)
        if len(calls) > 1:
            items = [dea.Trace("voltage", first=0.1, steps=1)]
        return solve(scene, items, *rest, **options)

    monkeypatch.setattr(branches, "solve", shorter)
    path = dea.Trace("voltage", first=0.4, until=("voltage_V", 1.1 * EULER), steps=60)
    found = dea.branches(strip(), path, DEFLECTION, most=1, quiet=True)
    assert [branch.name for branch in found.branches] == ["first"]
    assert list(found.lost) == ["branch_1"] and "fewer bifurcations" in found.lost["branch_1"]


@pytest.mark.parametrize("text", ["[]", "3", "{"])
def test_a_broken_file_of_a_diagram_is_refused(tmp_path, text):
    (tmp_path / "first").mkdir()
    (tmp_path / "first" / "history.csv").write_text("step,time\n0,0\n", "utf-8")
    (tmp_path / "diagram.json").write_text(text, "utf-8")
    with pytest.raises(dea.InputError, match="JSON"):
        _runs(tmp_path)


@pytest.mark.parametrize(
    ("path", "more", "words"),
    [
        (dea.Ramp("voltage"), {}, "must end by a Trace without switch="),
        (dea.Trace("voltage", switch=0.1), {}, "must end by a Trace without switch="),
        (TRACE, {"most": -1}, "a whole number of at least 0"),
        (TRACE, {"aside": -0.1}, "a length of arc above 0"),
        (TRACE, {"both": "no"}, "must be True or False"),
        (TRACE, {"most": "12"}, "a whole number of at least 0"),
        (TRACE, {"stability": "never"}, 'needs stability="every"'),
        (dea.Trace("voltage", leave=0), {}, "a whole number of at least 1"),
    ],
)
def test_wrong_diagrams_are_refused(path, more, words):
    with pytest.raises(dea.InputError, match=words):
        dea.branches(strip(), path, quiet=True, **more)
