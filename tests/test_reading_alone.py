"""A results folder needs this package no more: h5py, pandas and meshio read it, and JSON tells."""

from __future__ import annotations

import json
import subprocess
import sys

import h5py
import numpy as np
import pytest
from conftest import block

import dea_fenicsx as dea

pytestmark = pytest.mark.usefixtures("quick_compile")

VOLTS = 2000.0


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A cube of film, squeezed without restraint: displacement and field are known everywhere."""
    rubber = dea.Material(dea.NeoHookean(50e3), dea.IdealDielectric(3.0))
    held = [dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")]
    scene = dea.Scene(block((1, 1, 2)), {"film": rubber}, supports=held,
                      electrodes=[dea.Electrode("top", VOLTS), dea.Ground("bottom")])  # fmt: skip
    record = {"stretch": dea.MeanStretch(("bottom", "top"), "z"), "charge": dea.Charge("top")}
    return dea.solve(scene, dea.Ramp(steps=2), record, out=tmp_path_factory.mktemp("run"),
                     quiet=True)  # fmt: skip


def test_h5py(run):
    with h5py.File(run.out / "fields.h5") as h5:
        assert set(h5) == {"grid", "step_00000", "step_00001", "step_00002"}
        points, cells = h5["grid/points"][()], h5["grid/cells"][()]
        assert points.shape == (45, 3) and cells.shape == (2, 27)
        assert h5["grid"].attrs["cell"] == "hexahedron"
        step = h5["step_00002"]
        u = step["node/displacement_m"][()]
        assert u[:, 2] == pytest.approx((run["stretch"] - 1) * points[:, 2], abs=1e-15)
        assert step["node/potential_V"][()] == pytest.approx(VOLTS * points[:, 2] / 1e-3, abs=1e-6)
        field = VOLTS / (run["stretch"] * 1e-3)
        assert step["cell/field_strength_V_per_m"][()] == pytest.approx(field, rel=1e-9)
        assert set(h5["grid/regions"][()]) == {run.summary["settings"]["regions"]["film"]}


def test_pandas(run):
    pandas = pytest.importorskip("pandas")
    table = pandas.read_csv(run.out / "history.csv")
    assert list(table["step"]) == [0, 1, 2]
    assert list(table["voltage_V"]) == [0, VOLTS / 2, VOLTS]
    assert table["stretch"].to_numpy() == pytest.approx(run.column("stretch"), rel=1e-15)
    assert table["charge_C"].dtype == float
    assert table["event"].isna().all()
    flat = pandas.json_normalize(json.loads((run.out / "summary.json").read_text()))
    assert flat["settings.materials.film.elastic.mu"].item() == 50e3


def test_meshio(run):
    meshio = pytest.importorskip("meshio")
    with meshio.xdmf.TimeSeriesReader(run.out / "fields.xdmf") as reader:
        points, (cells,) = reader.read_points_cells()
        assert cells.type == "hexahedron27" and cells.data.shape == (2, 27)
        assert reader.num_steps == 3
        time, nodal, cellwise = reader.read_data(2)
    assert time == 1.0
    assert nodal["displacement_m"][:, 2] == pytest.approx(
        (run["stretch"] - 1) * points[:, 2], abs=1e-15
    )
    assert cellwise["J"][0] == pytest.approx(1, abs=1e-9)


def test_the_folder_describes_itself(run):
    """Script or command, settings with names, versions, state in git; and numbers in SI."""
    told = json.loads((run.out / "summary.json").read_text())
    assert told["status"] == "completed" and told["message"] == ""
    assert {"dolfinx", "petsc", "mpi", "dea_fenicsx", "numpy", "python"} <= set(told["versions"])
    assert {"script", "git", "host", "cores", "platform"} == set(told["origin"])
    settings = told["settings"]
    assert set(settings["surfaces"]) >= {"top", "bottom", "x_min"}
    assert settings["electrodes"][0]["type"] == "Electrode"
    assert settings["electrodes"][0]["volts"] == VOLTS
    assert settings["path"][0] | {"what": ["voltage"], "to": 1.0, "steps": 2} == settings["path"][0]
    assert np.isclose(told["volume_m3"], 1e-9)
    assert "completed: 2 steps" in (run.out / "run.log").read_text()


def test_neither_this_package_nor_dolfinx_is_needed(run):
    code = (
        "import sys, json, csv, h5py; f = h5py.File(sys.argv[1] + '/fields.h5');"
        "print(f['step_00002/node/displacement_m'].shape, len(list(csv.reader(open(sys.argv[1] + "
        "'/history.csv')))), [m for m in ('dea_fenicsx', 'dolfinx', 'mpi4py') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code, str(run.out)], capture_output=True,
                          text=True, timeout=60, check=True)  # fmt: skip
    assert done.stdout.strip().startswith("(45, 3) 4 [")
    assert "dea_fenicsx" not in done.stdout and "dolfinx" not in done.stdout
