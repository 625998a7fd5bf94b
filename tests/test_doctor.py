"""dea doctor names each fault of a machine, with what to do."""

from __future__ import annotations

import importlib.util
import shutil
from pathlib import Path

import pytest
from conftest import clean_environment

from dea_fenicsx import cli
from dea_fenicsx.cli import child, doctor

SOLVER = {
    "dolfinx": {"dolfinx": "0.11.0", "petsc": "3.25", "scalar": "float64"},
    "blas": {"blas": {"gigaflops": 40.0, "threads": 1.0, "libraries": [], "plain": []}},
    "inertia": {"inertia": [2, 2]}, "cache": {"cache": "/home/x"},
    "form": {"form": 1.0, "seconds": 0.5},
}  # fmt: skip
FAULTS = {
    "wrong DOLFINx": ({"dolfinx": {"dolfinx": "0.8.0", "failed": "no module"}}, "bad", "0.8.0"),
    "newer DOLFINx": ({"dolfinx": SOLVER["dolfinx"] | {"dolfinx": "0.12.0"}}, "bad", "0.12.0"),
    "complex numbers": (
        {"dolfinx": SOLVER["dolfinx"] | {"scalar": "complex128"}}, "bad", "complex128"),
    "reference BLAS": (
        {"blas": {"blas": SOLVER["blas"]["blas"] | {"plain": ["/x/libblas.so.3"]}}},
        "warn", "reference BLAS"),
    "slow BLAS": (
        {"blas": {"blas": SOLVER["blas"]["blas"] | {"gigaflops": 2.0}}}, "warn", "slow BLAS"),
    "threads": ({"blas": {"blas": SOLVER["blas"]["blas"] | {"threads": 3.9}}}, "warn", "4 in each"),
    "no MUMPS": ({"inertia": {"inertia": None, "failed": "no package mumps"}}, "bad", "no package"),
    "wrong inertia": ({"inertia": {"inertia": [1, 2]}}, "bad", "1 negative pivots instead of 2"),
    "no cache": (
        {"cache": {"cache": None, "folder": "/x", "failed": "read-only"}}, "bad", "read-only"),
    "no compiler": ({"form": {"form": None, "failed": "no gcc"}}, "bad", "no gcc"),
}  # fmt: skip


@pytest.mark.parametrize("case", FAULTS)
def test_doctor_names(monkeypatch, case):
    change, level, words = FAULTS[case]
    done = child.Done(SOLVER | change, "no message")
    monkeypatch.setattr(doctor, "start", lambda *a, **k: done)
    found = [f for f in doctor.solver(1.0) if f.level != "ok"]
    assert [(f.level, words in f.text) for f in found] == [(level, True)]
    assert found[0].mend


@pytest.mark.parametrize(
    ("facts", "errors", "words"),
    [
        ({"size": {"size": 1, "total": 1, "library": "MPICH 5"}}, "", "of another MPI"),
        ({}, "attempt to run as root.", "does not run for root"),
        ({}, "there are not enough slots", "fewer than 2 cores"),
        ({}, "", "no answer within 1 s"),
    ],
)
def test_doctor_names_what_is_wrong_with_mpirun(monkeypatch, facts, errors, words):
    done = child.Done(facts, "no answer within 1 s", errors)
    monkeypatch.setattr(doctor, "start", lambda *a, **k: done)
    monkeypatch.setattr(shutil, "which", lambda name: f"/bin/{name}")
    (found,) = doctor.ranks(1.0)
    assert found.level == "bad"
    assert words in found.text


def test_doctor_judges_threads(monkeypatch):
    for name in doctor.THREADS:
        monkeypatch.delenv(name, raising=False)
    assert [f.level for f in doctor.threads()] == ["warn"]
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    assert [f.level for f in doctor.threads()] == ["ok"]
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "4")
    assert [f.level for f in doctor.threads()] == ["warn"]


@pytest.mark.mpi
def test_doctor_here(monkeypatch, capsys):
    """On this machine, as it is: the tests run, so nothing can be bad but what is left out."""
    for name, value in clean_environment().items():
        monkeypatch.setenv(name, value)
    status = cli.main(["doctor"])
    out = capsys.readouterr().out
    levels = {line.split()[1]: line.split()[0] for line in out.splitlines()
              if line.startswith(("ok", "warn", "bad"))}  # fmt: skip
    assert status == 0, out
    assert {"python", "mpi", "dolfinx", "petsc", "blas", "mumps", "form"} <= set(levels)


def test_a_trial_that_hangs_or_dies_is_told(monkeypatch, tmp_path):
    monkeypatch.setattr(child.sys, "executable", "/bin/sh")
    hangs, dies = tmp_path / "hangs", tmp_path / "dies"
    hangs.write_text("#!/bin/sh\necho '{\"a\": 1}'\nsleep 30\n")
    dies.write_text("#!/bin/sh\necho why >&2\nkill -ABRT $$\n")
    for script in (hangs, dies):
        script.chmod(0o755)
    done = child.start("x", 0.5, [str(hangs)])
    assert done.facts == {"a": {"a": 1}}
    assert done.reason == "no answer within 0.5 s"
    assert child.start("x", 5, [str(dies)]).reason == "ended by signal SIGABRT (why)"
    assert "No such file" in child.start("x", 5, [str(tmp_path / "none")]).reason


# ----------------------------------------------- the real thing, on a machine made worse on purpose


def faults(found):
    return {f.what: f for f in found if f.level != "ok"}


REFERENCE_BLAS = next(Path("/usr/lib").glob("*/blas/libblas.so.3"), None)


@pytest.mark.skipif(REFERENCE_BLAS is None, reason="there is no reference BLAS")
def test_with_the_reference_blas(monkeypatch):
    monkeypatch.setenv("LD_PRELOAD", str(REFERENCE_BLAS))
    found = faults(doctor.solver(60))["blas"]
    assert found.level == "warn"
    assert "the reference BLAS" in found.text and "libopenblas" in found.mend


def test_with_a_wrong_dolfinx(monkeypatch, tmp_path):
    (tmp_path / "dolfinx").mkdir()
    (tmp_path / "dolfinx" / "__init__.py").write_text('__version__ = "0.8.0"\n')
    monkeypatch.syspath_prepend(tmp_path)
    (found,) = doctor.solver(60)
    assert (found.level, found.what) == ("bad", "dolfinx")
    assert found.text.startswith("0.8.0 ") and "0.9 to 0.11 is needed" in found.mend


def test_without_a_compiler(monkeypatch, tmp_path):
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    found = faults(doctor.solver(60))
    assert list(found) == ["form compiler"] or "blas" in found  # a busy machine is slow as well
    assert found["form compiler"].level == "bad"
    assert "there is no" in found["form compiler"].text
    assert "apt install gcc" in found["form compiler"].mend


@pytest.mark.skipif(
    importlib.util.find_spec("matplotlib") is None, reason="matplotlib is not installed"
)
def test_pictures_that_cannot_be_drawn(monkeypatch, tmp_path):
    (found,) = doctor.drawing(60)
    assert (found.level, found.what) == ("ok", "pictures")
    (tmp_path / "matplotlib.py").write_text("import os; os.abort()")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
    (found,) = doctor.drawing(60)
    assert (found.level, found.what) == ("warn", "pictures")
    assert "matplotlib cannot draw: ended by signal" in found.text
    assert "\x1b" not in found.text
