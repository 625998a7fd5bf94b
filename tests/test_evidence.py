"""The end of a path does not depend on its steps, and what ends it is told by its right name."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.results.summary import count_changes, unlocated
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.outcome import Attempt, Outcome

RUBBER = dea.NeoHookean(5e4)
FILM = dea.Material(RUBBER, dea.IdealDielectric(3.0))


def box(*layers, length=1e-3, width=None, **options):
    stack = BoxStack(length, width, [Layer(*layer) for layer in layers], **options)
    return dea.read_gmsh(stack, MPI.COMM_SELF)


def sheet(steps, uneven):
    """A free Mooney-Rivlin sheet under two dead loads (Treloar's and Kearsley's instability)."""
    loads = [dea.DeadLoad("x_max", (4e5, 0, 0)), dea.DeadLoad("y_max", (0, 4e5 * (1 + uneven), 0))]
    scene = dea.Scene(
        box(("film", 1e-4), width=1e-3, divisions=(1, 1)),
        {"film": dea.Material(dea.MooneyRivlin(4e4, 1.2e4))}, loads=loads,
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
    )  # fmt: skip
    seen = {"x": dea.MeanStretch(("x_min", "x_max"), "x"),
            "y": dea.MeanStretch(("y_min", "y_max"), "y")}  # fmt: skip
    return dea.solve(scene, dea.Ramp(steps=steps), seen, quiet=True)


@pytest.mark.parametrize("steps", [1, 2, 5, 7, 10, 20, 33])
def test_uneven_sheet_ends_at_one_state(steps):
    """Continuation of the closed form from zero load: 0.954453, 3.948580, stable."""
    run = sheet(steps, 1e-3)
    assert (run["x"], run["y"]) == pytest.approx((0.954453, 3.948580), abs=1e-6)
    assert run.summary["stable"] is True and run.summary["status"] == "completed"


@pytest.mark.parametrize("steps", [3, 10])
@pytest.mark.parametrize("uneven", [-1e-5, 1e-5])
def test_sheet_goes_to_the_side_that_its_loads_choose(steps, uneven):
    run = sheet(steps, uneven)
    assert (run["y"] > run["x"]) == (uneven > 0)
    assert run.summary["stable"] is True


@pytest.mark.parametrize("steps", [1, 10, 23])
def test_even_sheet_stays_even_and_says_that_it_does_not_rest(steps):
    """Equal loads: there is no one end; the run stays on the symmetric branch.

    There the stretch l of both sides obeys s = 2 (C10 + C01 l^2) (l - l^-5) (nominal stress).
    """
    run = sheet(steps, 0.0)
    stretch = float(run["x"])
    assert run["y"] == pytest.approx(stretch, rel=1e-9)
    stress = 2 * (4e4 + 1.2e4 * stretch**2) * (stretch - stretch**-5)
    assert stress == pytest.approx(4e5, rel=1e-8)
    assert run.summary["stable"] is False
    assert run.summary["status"] == "completed, unstable"
    # two uneven modes of the one element lose stability behind the homogeneous one
    assert "3 negative eigenvalues" in run.summary["message"]
    changes = run.summary["count_changes"]
    assert (changes[0]["from"], changes[-1]["to"]) == (0, 3)
    assert not any(change["located"] for change in changes)
    if steps > 1:  # a long first step is halved
        assert len(run.history) == steps + 1  # the place is searched without steps of its own


@pytest.mark.parametrize("steps", [1, 4, 13])
def test_strip_with_a_side_load_buckles(steps):
    """Own value on this mesh, the same with 30 steps: 3.2048 mm."""
    scene = dea.Scene(
        box(("film", 1e-3), length=24e-3, divisions=(24,)), {"film": FILM},
        supports=[dea.Clamp("x_min"), dea.Fix("x_max", "y")],
        prescribed=[dea.Displacement("x_max", "x", -1.2e-3)],
        loads=[dea.DeadLoad("bottom", (0.0, 1.0), ramp="q")], kinematics=dea.PlaneStrain(1e-3),
    )  # fmt: skip
    path = [dea.Ramp("q", steps=1), dea.Ramp("stretch", steps=steps)]
    run = dea.solve(scene, path, {"v": dea.LargestDisplacement("top", "y")}, quiet=True)
    assert abs(run["v_m"]) == pytest.approx(3.2048e-3, abs=1e-7)


def disc(electrodes):
    return dea.Scene(
        box(("film", 1e-3), length=4e-3, divisions=(2,)), {"film": FILM}, electrodes=electrodes,
        supports=[dea.Fix("x_min", "r"), dea.Fix("bottom", "z")], kinematics=dea.Axisymmetric(),
    )  # fmt: skip


def test_pull_in_of_joint_ramps_is_recorded():
    """The maximum of a free neo-Hookean film: 0.687365 T sqrt(mu/eps) between the electrodes."""
    ends = [dea.Electrode("top", 3e4, ramp="left"), dea.Electrode("bottom", -3e4, ramp="right")]
    limit = 0.687365 * 1e-3 * np.sqrt(5e4 / (3 * dea.materials.EPSILON_0))
    with pytest.raises(dea.EquilibriumLost, match="pull-in") as caught:
        dea.solve(disc(ends), dea.Ramp(("left", "right"), steps=20), quiet=True)
    failure, = caught.value.run.summary["failures"]
    assert failure["mode"] == "pull-in"
    assert 2 * failure["left_V"] <= limit * (1 + 1e-6)
    assert limit < -2 * failure["right_above_V"] * (1 + 1e-6)


def test_joint_ramps_are_led_by_one_that_moves():
    """The first ramp is where it is to be already; the other one moves alone."""
    ends = [dea.Electrode("top", 1e3, ramp="left"), dea.Electrode("bottom", -4e3, ramp="right")]
    path = [dea.Ramp("left", steps=1), dea.Ramp(("left", "right"), steps=5)]
    seen = {"lam": dea.MeanStretch(("bottom", "top"), "z")}
    joint = dea.solve(disc(ends), path, seen, quiet=True)
    once = dea.solve(disc(ends), dea.Ramp(steps=3), seen, quiet=True)
    assert joint["lam"] == pytest.approx(once["lam"], rel=1e-10)
    assert joint.summary["newton_iterations"] < 25  # extrapolated, not begun anew at each step


def block():
    return dea.Scene(
        box(("film", 1e-3), divisions=(2,)), {"film": FILM},
        electrodes=[dea.Electrode("top", 5e3), dea.Ground("bottom")],
        supports=[dea.Clamp("bottom")], kinematics=dea.PlaneStrain(1e-3),
    )  # fmt: skip


def test_trace_that_does_not_reach_its_value_is_told():
    height = {"h": dea.MeanStretch(("bottom", "top"), "y")}
    with pytest.raises(dea.NotReached, match=r"3 steps at h = .*before h = 0\.5") as caught:
        dea.solve(block(), dea.Trace("voltage", steps=3, until=("h", 0.5)), height, quiet=True)
    assert caught.value.exit_status == 6
    assert caught.value.run.summary["status"] == "not reached"
    assert len(caught.value.run.history) == 4


@pytest.mark.parametrize("path, words", [
    (dea.Ramp(to=0.5, at=(0.25, 0.75)), "0.75"),
    (dea.Ramp(at=(-0.1, 0.5)), "-0.1"),
    ([dea.Ramp(to=0.6), dea.Ramp(to=1.0, at=(0.5, 0.8))], "0.5"),
])  # fmt: skip
def test_landing_outside_of_a_ramp_is_refused(path, words):
    with pytest.raises(dea.InputError, match=words):
        dea.solve(block(), path, quiet=True)


def test_failure_of_the_method_is_no_pull_in(monkeypatch):
    """Newton's method that fails beyond half of the load, where no limit point is near."""
    solve = NewtonSolver.solve

    def failing(self, start, factors=None, *arguments, **options):
        if (factors or start.factors)["voltage"] > 0.5:
            return Attempt(Outcome.SLOW, 15, 1e-3)
        return solve(self, start, factors, *arguments, **options)

    monkeypatch.setattr(NewtonSolver, "solve", failing)
    with pytest.raises(dea.SolverError, match="no limit point") as caught:
        dea.solve(block(), dea.Ramp(steps=3), quiet=True)
    assert not caught.value.run.summary["failures"]


def row(step, event, count, own=1):
    return {"step": step, "event": event, "inertia": count, "inertia_is_of_this_step": own}


def test_changes_of_the_count_are_listed():
    rows = [row(0, "", 0), row(1, "", 0, 0), row(2, "", 1), row(3, "maximum", 7), row(4, "", 2)]
    assert count_changes(rows) == [
        {"from": 0, "to": 1, "after_step": 0, "step": 2, "limit_points": 0, "located": False},
        {"from": 1, "to": 2, "after_step": 2, "step": 4, "limit_points": 1, "located": True},
    ]


def test_loads_that_a_trace_does_not_pass_are_told(tmp_path):
    """Two steps come to 0.3 at most: 0.02 is landed on, the end of the ramp is where it begins."""
    path = [dea.Ramp(to=0.01, steps=1),
            dea.Trace("voltage", first=0.05, steps=3, at=(0.01, 0.02, 0.9, 1.7))]  # fmt: skip
    run = dea.solve(block(), path, out=tmp_path / "out", quiet=True)
    words = "The trace in voltage did not pass the loads 0.9, 1.7 of at=."
    assert run.summary["status"] == "completed"
    assert run.summary["message"] == words
    assert words in (tmp_path / "out" / "run.log").read_text()
    assert [e["voltage_V"] for e in run.summary["events"]] == pytest.approx([0.02 * 5e3])


def test_a_limit_point_explains_one_of_three():
    """The sentence names what was located, and what was not."""
    told = [(0, ""), (0, "maximum"), (3, "")]
    rows = [{"step": k, "inertia": count, "inertia_is_of_this_step": True, "event": event}
            for k, (count, event) in enumerate(told)]  # fmt: skip
    sentence = unlocated(rows)
    assert "from 0 to 3 between steps 0 and 2.  The limit point there" in sentence
    assert "nothing was located" not in sentence
    rows[1]["event"] = ""
    assert "where nothing was located" in unlocated([rows[0], rows[2]])
    rows[1]["event"], rows[2]["inertia"] = "maximum", 1
    assert unlocated(rows) is None
