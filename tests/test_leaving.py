"""Branches that are left along combinations of modes, and ramps that end where nothing rests."""

import numpy as np
import pytest
from conftest import on_demand
from leaving_scenes import bent, column, on_all_ranks
from mpi4py import MPI
from test_branches import DEFLECTION, EULER, TRACE, H, strip

import dea_fenicsx as dea


def test_a_square_column_bends_along_any_axis_of_its_symmetry():
    """Two modes are neutral at once; branches lie along both axes and along the diagonals."""
    (x, y), run = bent((1.0,))
    assert x > 0.1 and abs(y) < 1e-6 * x
    assert run["inertia"] == 0
    (other, bend), _ = bent(lambda X: np.array([0 * X[2], np.sin(300 * X[2]), 0 * X[2]]))
    assert bend == pytest.approx(x, rel=1e-4) and abs(other) < 1e-6 * x
    for side in (1.0, -1.0):
        (x, y), run = bent((1.0, side))
        assert x > 0.1 and y == pytest.approx(side * x, rel=1e-6)
        assert run["inertia"] == 1  # it would rather bend along an axis


def test_shares_must_fit_the_null_vectors():
    with pytest.raises(dea.InputError, match="has 3 shares, but only 2 shapes are neutral"):
        bent((1.0, 0.0, 1.0))
    scene = column()
    for options, words in (
        ({"along": (1.0,)}, "stays on its branch"),
        ({"along": (0.0, 0.0), "switch": 0.1}, "not all 0"),
        ({"along": "x", "switch": 0.1}, "A share in along="),
        ({"leave": (1, 0), "switch": 0.1}, "a whole number of at least 1"),
    ):
        with pytest.raises(dea.InputError, match=words):
            path = dea.Trace("stretch", **options)
            dea.solve(scene, path, quiet=True, stability="every")


def test_a_ramp_ends_where_nothing_rests():
    """At the bifurcation, whatever the steps; the default goes on and says where that was."""
    loads = []
    for steps in (2, 5):
        ramp = dea.Ramp("voltage", to=1.6, steps=steps, at_loss="unstable")
        with pytest.raises(dea.StabilityLost, match="no device rests on it") as end:
            dea.solve(strip(), ramp, stability="every", quiet=True)
        run = end.value.run
        assert run.summary["status"] == "stability lost"
        assert run.history[-1]["event"] == "bifurcation"
        assert not run.summary["failures"]  # it is no pull-in
        loads.append(run["voltage_V"])
    assert loads[0] == pytest.approx(loads[1], rel=1e-6)
    assert loads[0] == pytest.approx(EULER, rel=0.02)
    run = dea.solve(strip(), dea.Ramp("voltage", to=1.2, steps=2), stability="every", quiet=True)
    told = f"Nothing rests on this branch from voltage_V = {loads[0]:.5g}"
    assert told in run.summary["message"]
    run = dea.solve(strip(), dea.Ramp("voltage", to=1.2, steps=2), quiet=True)
    assert "Nothing rests on this branch from between voltage_V = " in run.summary["message"]
    with pytest.raises(dea.InputError, match='at_loss="unstable" needs stability="every"'):
        dea.solve(strip(), dea.Ramp("voltage", at_loss="unstable"), quiet=True)


def test_any_step_of_a_kept_run_is_a_start(tmp_path):
    out = tmp_path / "kept"
    path = dea.Trace("voltage", first=0.4, switch=0.05, until=("voltage_V", 1.3 * EULER), steps=60)
    run = dea.solve(strip(), path, DEFLECTION, out, stability="every", quiet=True,
                    keep_states=True)  # fmt: skip
    rows = [k for k, row in enumerate(run.history) if row["event"] == "bifurcation"] + [-2]
    for k in rows:  # an event, and a step on the arch
        row = run.history[k]
        again = dea.solve(strip(), dea.Ramp("voltage", to=row["voltage_V"] / EULER, steps=1),
                          DEFLECTION, start=dea.StoredStep(out, row["step"]), quiet=True,
                          stability="never")  # fmt: skip
        first = again.history[0]["middle_m"]
        assert first == pytest.approx(row["middle_m"], rel=1e-9, abs=1e-12 * H)
    with pytest.raises(dea.InputError, match="has no usable state of step 99"):
        dea.solve(strip(), TRACE, start=dea.StoredStep(out, 99), quiet=True)


@on_demand
@pytest.mark.mpi
def test_branches_on_three_ranks(on_ranks):
    here, there = on_all_ranks(MPI.COMM_SELF), on_ranks("leaving_scenes", "on_all_ranks", 3)
    assert here.pop("counts") == there.pop("counts") == [1, 0, 0]
    for name, values in here.items():
        assert there[name] == pytest.approx(values, rel=1e-6, abs=1e-6 * H), name
