"""A results folder says where it comes from, and a new run never loses an earlier one."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import block
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.results import provenance
from dea_fenicsx.results.folder import Folder


def scene(volts: float) -> dea.Scene:
    rubber = dea.Material(dea.NeoHookean(50e3), dea.IdealDielectric(3.0))
    held = [dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")]
    return dea.Scene(block(), {"film": rubber}, supports=held,
                     electrodes=[dea.Electrode("top", volts), dea.Ground("bottom")])  # fmt: skip


@pytest.fixture
def script(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A script of the user's, as if Python had been started with it."""
    file = tmp_path / "work" / "bender.py"
    file.parent.mkdir()
    file.write_text("# first\n")
    monkeypatch.setattr(sys, "argv", [str(file), "--steps", "2"])
    return file


def git(folder: Path, *words: str) -> str:
    done = subprocess.run(
        ["git", "-C", str(folder), "-c", "user.name=x", "-c", "user.email=x@y", *words],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return done.stdout.strip()


def test_three_runs_in_one_folder_are_all_kept(script, tmp_path):
    out = tmp_path / "out"
    for k in (1, 2, 3):
        script.write_text(f"# {k}\n")
        dea.solve(scene(100.0 * k), dea.Ramp(steps=1), out=out, quiet=True)
    for k, folder in ((1, out / "previous"), (2, out / "previous_2"), (3, out)):
        told = dea.read_summary(folder)
        assert told["voltage_V"] == 100.0 * k
        assert (folder / "script.py").read_text() == f"# {k}\n"
        assert told["origin"]["script"] == str(script)
        assert told["origin"]["cores"] >= 1
        assert {"h5py", "gmsh", "petsc", "mpi"} <= set(told["versions"])


def test_resumed_with_a_changed_script(script, tmp_path):
    for text in ("# begun\n", "# changed\n"):
        script.write_text(text)
        dea.solve(scene(100.0), dea.Ramp(steps=1), out=tmp_path, quiet=True, resume=True)
    assert (tmp_path / "script.py").read_text() == "# begun\n"
    assert (tmp_path / "script_resumed.py").read_text() == "# changed\n"


def test_a_script_that_writes_beside_itself_stays(tmp_path, monkeypatch):
    file = tmp_path / "script.py"
    file.write_text("# mine\n")
    monkeypatch.setattr(sys, "argv", [str(file)])
    for _ in range(2):
        folder = Folder(tmp_path, MPI.COMM_SELF)
        folder.start()
        folder.keep_origin()
        folder.write_summary({"a": 1})
    assert file.read_text() == "# mine\n"
    assert json.loads((tmp_path / "previous" / "summary.json").read_text()) == {"a": 1}


@pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")
def test_state_in_git(script):
    assert provenance.git_state(script) is None
    git(script.parent, "init", "-q")
    git(script.parent, "commit", "-q", "--allow-empty", "-m", "none")
    assert provenance.git_state(script)["dirty"] is True  # the script is not in git
    git(script.parent, "add", ".")
    git(script.parent, "commit", "-q", "-m", "one")
    state = provenance.origin()["git"]
    assert state == {"commit": git(script.parent, "rev-parse", "HEAD"), "dirty": False}
    script.write_text("# changed\n")
    assert provenance.git_state(script)["dirty"] is True


def test_without_git_or_script(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(sys, "argv", ["-c"])
    assert provenance.origin()["git"] is None
    assert provenance.origin()["script"] is None
    provenance.keep_script(tmp_path)
    assert not list(tmp_path.iterdir())
