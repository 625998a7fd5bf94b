"""One history, by rows and by columns: of a run at hand, and of a folder."""

from __future__ import annotations

import json
import pickle

import numpy as np
import pytest

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.results.history import Columns, History, columns_of

ROWS = [
    {"step": 0, "event": "", "stretch": 1.0, "cap_F": None},
    {"step": 1, "event": "maximum", "stretch": 1.25, "cap_F": 2e-9},
    {"step": 2, "event": "", "stretch": 1.5, "cap_F": 3e-9},
]


def test_it_is_a_list_of_rows():
    history = History(ROWS)
    assert history == ROWS and len(history) == 3 and isinstance(history, list)
    assert [row["step"] for row in history] == [0, 1, 2]
    assert history[-1]["stretch"] == 1.5 and ROWS[1] in history
    assert json.loads(json.dumps(history)) == ROWS and pickle.loads(pickle.dumps(history)) == ROWS
    assert {row["event"]: row["step"] for row in history if row["event"]} == {"maximum": 1}


def test_it_gives_columns():
    history = History(ROWS)
    assert history.names == ["step", "event", "stretch", "cap_F"]
    assert history["stretch"].tolist() == [1.0, 1.25, 1.5]
    assert np.array_equal(history["cap_F"], [np.nan, 2e-9, 3e-9], equal_nan=True)
    assert history["event"].tolist() == ["", "maximum", ""]
    assert "stretch" in history and "length" not in history
    assert history.get("length") is None and history.get("step").tolist() == [0, 1, 2]
    assert history[1:]["stretch"].tolist() == [1.25, 1.5] and history[1:] == ROWS[1:]


def test_both_views_are_of_one_thing():
    columns = History(ROWS).columns
    assert isinstance(columns, dict) and list(columns) == ["step", "event", "stretch", "cap_F"]
    rows = columns.rows
    assert rows[1:] == ROWS[1:] and rows["event"].tolist() == ["", "maximum", ""]
    assert np.array_equal(rows["cap_F"], columns["cap_F"], equal_nan=True)


def test_a_column_of_texts_that_is_empty_throughout():
    columns = columns_of(["event", "x"], [{"event": "", "x": "1"}, {"event": "", "x": ""}])
    assert columns["event"].dtype.kind == "f"
    assert [row["event"] for row in columns.rows] == ["", ""]
    assert np.isnan(columns.rows[1]["x"])


@pytest.mark.parametrize(
    "history, told", [(History(), "no step yet"), (History(ROWS), "no column")]
)
def test_what_is_not_there_is_told(history, told):
    with pytest.raises(dea.InputError, match=told):
        history["length"]
    assert "length" not in history


def test_without_steps_there_are_no_columns():
    assert History().columns == {} and Columns().rows == []


def test_a_run_and_its_folder_agree(tmp_path):
    film = dea.Material(dea.NeoHookean(50e3), dea.IdealDielectric(2.8))
    device = dea.read_gmsh(BoxStack(1e-3, 1e-3, [Layer("film", 1e-3)], divisions=(1, 1)))
    scene = dea.Scene(
        device, {"film": film}, electrodes=[dea.Electrode("top", 500.0), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
    )  # fmt: skip
    record = {"stretch": dea.MeanStretch(("x_min", "x_max"), "x")}
    run = dea.solve(scene, dea.Ramp("voltage", steps=2), record, out=tmp_path, quiet=True)
    read = dea.read_history(tmp_path)
    assert [row["voltage_V"] for row in run.history] == [0.0, 250.0, 500.0]
    assert run["stretch"] == run.history["stretch"][-1] == read["stretch"][-1]
    assert list(read) == run.history.names and read.rows["stretch"].tolist() == [
        row["stretch"] for row in run.history
    ]
    for name in read:
        kept = read.rows.columns[name]
        assert np.array_equal(run.history[name], kept, equal_nan=kept.dtype.kind == "f"), name
