"""A run that was killed and resumed has the same steps as one that was not, whenever it was killed.

A step is predicted and judged by the states before it, so that these belong to the checkpoint.  A
trace also goes straight on from points some steps back where another branch almost crosses it.
"""

from __future__ import annotations

import shutil

import numpy as np
import pytest

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, HollowSphere, Layer
from dea_fenicsx.path.trace_memory import TraceMemory

pytestmark = pytest.mark.usefixtures("quick_compile")

EFFORT = {"wall_s", "factorisations", "krylov_iterations", "residual", "volume_error"}
"""Columns of errors and of work, which may differ after a start without a factor."""

RECORD = {"Q": dea.Charge("top"), "w": dea.LargestDisplacement("top", "z")}


def scene() -> dea.Scene:
    """An axisymmetric film under pressure and voltage."""
    film = dea.Material(dea.NeoHookean(50e3), dea.IdealDielectric(2.86))
    strip = BoxStack(1e-3, None, [Layer("film", 1e-4, divisions=2)], divisions=(6,))
    return dea.Scene(
        dea.device(strip), {"film": film}, kinematics=dea.Axisymmetric(),
        electrodes=[dea.Electrode("top", 2500.0), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "r"), dea.Clamp("x_max")],
        loads=[dea.FollowerPressure("bottom", 20.0)],
    )  # fmt: skip


PATH = [dea.Ramp("load", steps=4), dea.Ramp("voltage", steps=6),
        dea.Trace("load", first=0.2, steps=6)]  # fmt: skip


def solve(out, **options) -> dea.Run:
    return dea.solve(
        scene(), PATH, RECORD, out=out, quiet=True, stability="every", **options
    )


COUNTS = {"inertia", "inertia_is_of_this_step", "negative_modes"}
"""Where negative eigenvalues are not asked for, these are of any factor that there is."""


def alike(solve, tmp_path, monkeypatch, least=0, but=frozenset()) -> dea.Run:
    """Kill a run at each step from the least one on, resume it, and compare; the whole run."""
    from dea_fenicsx.results import folder as results

    copies, write = [], results.Folder.write_step

    def keep(self, step, *others):
        write(self, step, *others)
        if step >= least:
            copies.append(shutil.copytree(self.path, tmp_path / f"at_{step}"))

    with monkeypatch.context() as patch:
        patch.setattr(results.Folder, "write_step", keep)
        whole = solve(tmp_path / "whole")
    assert len(copies) == len(whole.history) - least
    for copy in copies[:-1]:
        resumed = solve(copy, resume=True)
        assert len(resumed.history) == len(whole.history), copy
        for name in whole.history[0].keys() - EFFORT - but:
            mine, theirs = (np.array([r[name] for r in run.history]) for run in (resumed, whole))
            if theirs.dtype.kind not in "fi":
                assert list(mine) == list(theirs), (copy, name)
                continue
            size = np.max(np.abs(theirs), initial=0.0)
            assert np.allclose(mine, theirs, rtol=0, atol=1e-8 * size, equal_nan=True), (copy, name)
    return whole


def test_the_steps_are_the_same_wherever_a_run_was_killed(tmp_path, monkeypatch):
    """Its ramps halve two steps, and its trace follows the cubic through the points before."""
    whole = alike(solve, tmp_path, monkeypatch)
    assert sum(row["retries"] for row in whole.history) > 0


def test_a_trace_goes_straight_on_wherever_it_was_killed(tmp_path, monkeypatch):
    """Twice it passes a lopsided branch of a thick sphere from points some steps back."""
    wall = dea.Material(dea.NeoHookean(1e5), dea.IdealDielectric(4.0))
    ball = dea.exact.RoundBalloon(1e-3, 1.2e-3, wall)
    scene = dea.Scene(
        dea.device(HollowSphere(1e-3, 1.2e-3, "half", 1, 6)), {"wall": wall},
        electrodes=[dea.Electrode("inner", ball.limits(2e-3)[0].volts), dea.Ground("outer")],
        supports=[dea.Fix("equator", "z"), dea.Fix("axis", "r")], kinematics=dea.Axisymmetric(),
    )  # fmt: skip
    record = {"equator": dea.AtPoint((1e-3, 0), "displacement", "r"),
              "pole": dea.AtPoint((0, 1e-3), "displacement", "z")}  # fmt: skip
    path = dea.Trace("voltage", steps=30, until=("equator_m", 1.1e-3))

    def solve(out, **options) -> dea.Run:
        return dea.solve(
            scene, path, record, out=out, quiet=True, stability="never",
            options=dea.NewtonOptions(tolerance=1e-12), **options
        )

    # Near the crossing the tangent is almost singular.  Errors of states are larger there, and a
    # start with a new factor may take one Newton iteration more or less than with a kept one.
    but = COUNTS | {"newton_iterations"}
    whole = alike(solve, tmp_path, monkeypatch, least=10, but=but)
    log = (tmp_path / "whole" / "run.log").read_text("utf-8")
    assert log.count("went straight on") == 2
    assert whole["pole_m"] == pytest.approx(whole["equator_m"], rel=1e-4)


MEMORY = {"signs": [1.0, -1], "before": 1, "trail": [2, -1, 1, 0], "anchors": [[0, 1], [1, 2]],
          "turned": -1, "pace": {"arc": 0.5, "short": 2, "fourth": None}}  # fmt: skip


@pytest.mark.parametrize("change", [
    {"signs": [1.0]}, {"signs": [1.0, 2.0]}, {"signs": [1.0, "1"]}, {"trail": [3]},
    {"before": 0.5}, {"before": -2}, {"anchors": [[0]]}, {"anchors": [0, 1]}, {"turned": None},
    {"pace": {"arc": float("inf")}}, {"pace": {"arc": "1"}}, {"pace": [1.0]}, {"more": 1},
    {"pace": {"arc": 10**400}},
])  # fmt: skip
def test_what_a_checkpoint_tells_of_a_trace_is_checked(change):
    assert TraceMemory.read(MEMORY, 2).before == 1
    with pytest.raises(ValueError, match=r"."):
        TraceMemory.read(MEMORY | change, 2)
