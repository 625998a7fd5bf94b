"""Studies over parameters: points, rows, failures, and going on after an end."""

from __future__ import annotations

import csv
import os
import re
import sys
import tempfile

import numpy as np
import pytest

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.studies.samples import points

os.environ.setdefault("DEA_FENICSX_CFLAGS", "-O1 -g0")  # one cell: the kernels run a few times
L, VOLTS, EPS_R = 1e-3, 1e4, 3.0
RECORD = {"thin": dea.MeanStretch(("bottom", "top"), "z"), "q": dea.Charge("top")}
PATH = dea.Ramp(steps=2)
FAULTS: list[float] = []
"""Moduli at which `build` fails as a script with an error would."""


def build(comm, thickness, mu):
    """A round film, free in its plane."""
    if mu in FAULTS:
        raise RuntimeError("an error of the script")
    device = dea.read_gmsh(BoxStack(L, None, [Layer("film", thickness)]), comm)
    return dea.Scene(
        device, {"film": dea.Material(dea.NeoHookean(mu), dea.IdealDielectric(EPS_R))},
        [dea.Electrode("top", VOLTS), dea.Ground("bottom")],
        [dea.Fix("x_min", "r"), dea.Fix("bottom", "z")], kinematics=dea.Axisymmetric(),
    )  # fmt: skip


OVER = {"thickness": [3e-4, 1e-3], "mu": [5e4, 2e5, -1.0]}


def check_rows(rows):
    """(eps/mu)(V/T)^2 = (1/lam - lam^2) lam^2; pull-in at 0.687 T sqrt(mu/eps); a modulus < 0."""
    assert [(row["thickness"], row["mu"]) for row in rows] == [
        (t, mu) for t in OVER["thickness"] for mu in OVER["mu"]
    ]
    for row in rows:
        if row["mu"] < 0:
            assert row["status"] == "refused" and "mu is -1.0" in row["verdict"]
            continue
        unit = row["thickness"] * np.sqrt(row["mu"] / (EPS_R * EPSILON_0))
        if 0.687365 * unit < VOLTS:
            assert row["status"] == "equilibrium lost" and "Equilibrium was lost" in row["verdict"]
            continue
        lam = row["thin"]
        assert row["status"] == "completed" and row["stable"]
        assert (1 / lam - lam**2) * lam**2 == pytest.approx((VOLTS / unit) ** 2, rel=1e-6)
    assert {row["status"] for row in rows} == {"refused", "equilibrium lost", "completed"}


def test_a_study_goes_on_after_an_error_of_the_script(tmp_path, capsys):
    FAULTS[:] = [2e5]
    with pytest.raises(RuntimeError):
        dea.study(build, OVER, RECORD, PATH, tmp_path, quiet=True)
    FAULTS.clear()
    assert len(list(tmp_path.glob("runs/*/row.json"))) == 1
    assert capsys.readouterr().out == ""
    found = dea.study(build, OVER, RECORD, PATH, tmp_path)
    check_rows(found.rows)
    assert found.solved == 5
    told = capsys.readouterr().out.splitlines()
    assert len(told) == 5 + 1 and told[-1].startswith("study: 6 runs, 5 of them solved now in ")
    assert any(re.fullmatch(r"run \d of 6: .*mu -1: refused, \d+\.\d s", line) for line in told)
    again = dea.study(build, OVER, RECORD, PATH, tmp_path, quiet=True)
    assert again.rows == found.rows and again.solved == 0
    assert np.isnan(found.column("thin")).sum() == 2
    with (tmp_path / "table.csv").open() as f:
        table = list(csv.DictReader(f))
    assert [float(row["mu"]) for row in table] == [row["mu"] for row in found]
    assert table[-1]["status"] == "refused" and table[-1]["thin"] == ""
    assert (tmp_path / "study.png").stat().st_size > 5000
    parquet = pytest.importorskip("pyarrow.parquet")
    kept = parquet.read_table(found.to_parquet()).to_pylist()
    assert kept == [{name: row.get(name) for name in kept[0]} for row in found.rows]
    assert set(kept[0]) == {name for row in found for name in row}
    assert not list(tmp_path.glob("claims-*"))
    with pytest.raises(dea.InputError, match="a study with another path"):
        dea.study(build, OVER, RECORD, dea.Ramp(steps=3), tmp_path, quiet=True)
    more = {**OVER, "mu": [*OVER["mu"], 4e5]}
    assert dea.study(build, more, RECORD, PATH, tmp_path, quiet=True).solved == 2


@pytest.mark.parametrize("over, words", [
    ({}, "has no points"), ([], "has no points"), ({"mu": []}, "has no points"),
    ({"mu": 3.0}, "must be a list"), (3, "must be over lists"),
    ({"mu": [float("nan")]}, "must be a finite number"), ({"mu": [1, 1]}, "twice"),
    ([{"mu": 1}, {"nu": 1}], "the same ones"),
    (dea.LatinHypercube({"mu": (2.0, 1.0)}), "give the smaller first"),
    (dea.LatinHypercube({}), "has no ranges"),
])  # fmt: skip
def test_points_that_are_refused(over, words):
    with pytest.raises(dea.InputError, match=words):
        points(over)


def test_a_latin_hypercube_has_one_point_in_each_part():
    found = points(dea.LatinHypercube({"a": (0.0, 10.0), "b": (-1.0, 1.0)}, count=10, seed=3))
    assert sorted(int(p["a"]) for p in found) == list(range(10))
    assert sorted(int((p["b"] + 1) * 5) for p in found) == list(range(10))
    assert points(dea.LatinHypercube({"a": (0.0, 10.0), "b": (-1.0, 1.0)}, 10, 3)) == found


def test_what_is_no_scene_is_a_row(tmp_path):
    found = dea.study(lambda comm, x: x, {"x": [1]}, RECORD, PATH, tmp_path, quiet=True)
    assert found.rows[0]["status"] == "refused"
    with pytest.raises(dea.InputError, match="no column 'thin'"):
        found.column("thin")
    with pytest.raises(dea.InputError, match="must be a function"):
        dea.study(3, {"x": [1]}, RECORD, out=tmp_path)
    with pytest.raises(dea.InputError, match="did you mean 'ranks_per_run'"):
        dea.study(build, {"x": [1]}, RECORD, out=tmp_path, rank_per_run=2)


def test_parquet_needs_pyarrow(tmp_path, monkeypatch):
    found = dea.study(lambda comm, x: x, {"x": [1]}, RECORD, PATH, tmp_path, quiet=True)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(dea.InputError, match="needs pyarrow; install it with pip install pyarrow"):
        found.to_parquet()


def on_ranks_found(comm):
    folder = comm.bcast(tempfile.mkdtemp() if comm.rank == 0 else None, root=0)
    found = dea.study(build, OVER, RECORD, PATH, folder, quiet=True, ranks_per_run=2)
    everyone = comm.allgather(found.rows)
    return [everyone[0], all(rows == everyone[0] for rows in everyone), found.solved]


@pytest.mark.mpi
def test_three_ranks_in_two_groups(on_ranks):
    """One run on two ranks, another on one."""
    rows, alike, solved = on_ranks("test_study", "on_ranks_found", 3)
    check_rows(rows)
    assert alike and solved == 6
