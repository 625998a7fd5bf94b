"""The tutorial in a notebook, run from its first cell to its last one by nbconvert."""

from __future__ import annotations

import json
import os

import pytest
from conftest import ROOT

NOTEBOOK = ROOT / "demos" / "first_actuator.ipynb"


def test_it_is_kept_without_results():
    cells = json.loads(NOTEBOOK.read_text("utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert len(code) >= 5
    assert all(not cell["outputs"] and cell["execution_count"] is None for cell in code)


def test_nbconvert_runs_it(tmp_path, monkeypatch):
    """It prints what the script of the same name prints, and shows the table and the report."""
    for module in ("ipykernel", "plotly", "pyvista"):
        pytest.importorskip(module)
    preprocessors = pytest.importorskip("nbconvert.preprocessors")
    nbformat = pytest.importorskip("nbformat")
    path = [str(ROOT), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(p for p in path if p))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    run = preprocessors.ExecutePreprocessor(timeout=300, kernel_name="python3")
    run.preprocess(notebook, {"metadata": {"path": str(tmp_path)}})
    outputs = [out for cell in notebook.cells for out in cell.get("outputs", [])]
    printed = "".join(out["text"] for out in outputs if out["output_type"] == "stream"
                      and out["name"] == "stdout")  # fmt: skip
    assert "tip at 400 V: " in printed and "tip at 8000 V: -6.0" in printed
    pages = [out["data"]["text/html"] for out in outputs if "text/html" in out.get("data", {})]
    assert "<table" in pages[0] and "tip_m" in pages[0]
    assert pages[-1].startswith("<iframe srcdoc=")
    assert (tmp_path / "results" / "notebook" / "script.py").is_file()
