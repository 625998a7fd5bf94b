"""A results folder belongs to one run at a time; names and numbers are what they say."""

from __future__ import annotations

import errno
import fcntl
import os
import signal
import stat
import subprocess
import sys
import time
from fractions import Fraction

import numpy as np
import pytest
from conftest import ROOT, clean_environment
from stopped_runs import HEIGHT, Stop, refused, scene, solve

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.results import columns
from dea_fenicsx.support import file_lock

pytestmark = pytest.mark.usefixtures("quick_compile")


# ------------------------------------------------------------------------------------- the lock


class Within:
    """Starts another run while the first one measures."""

    unit = ""

    def __init__(self, out):
        self.out, self.told = out, []

    def bind(self, problem):
        def measure():
            if not self.told:
                with pytest.raises(dea.InputError) as caught:
                    solve(self.out)
                self.told.append(str(caught.value))
            return 0.0

        return measure


@pytest.mark.parametrize("way", ["same", "link", "relative"])
def test_two_runs_at_once(tmp_path, monkeypatch, way):
    out = tmp_path / "out"
    out.mkdir()
    (tmp_path / "link").symlink_to(out)
    monkeypatch.chdir(tmp_path)
    other = {"same": out, "link": tmp_path / "link", "relative": "./out/../out"}[way]
    second = Within(other)
    run = solve(out, path=dea.Ramp(steps=2), record=HEIGHT | {"w": second})
    assert "Another run is writing into the results folder" in second.told[0]
    assert run.summary["status"] == dea.read_summary(out)["status"] == "completed"
    assert len(dea.read_history(out)["step"]) == 3
    assert not (out / "previous").exists() and not (out / ".lock").exists()


def test_a_lock_is_given_up_after_an_error(tmp_path):
    class Fails:
        unit = ""

        def bind(self, problem):
            return lambda: 1 / 0

    with pytest.raises(ZeroDivisionError) as caught:
        solve(tmp_path, record={"x": Fails()})
    told = dea.read_summary(tmp_path)
    assert told["status"] == "script failed" and "ZeroDivisionError" in told["message"]
    refused(lambda: solve(tmp_path, path=dea.Trace("voltage", until=("x", 1.0))), "no such column")
    assert solve(tmp_path).summary["status"] == "completed"
    del caught


HOLDS = """
import sys, time
from pathlib import Path
from dea_fenicsx.support.file_lock import FolderLock
held = FolderLock(Path(sys.argv[1]))
held.take()
print("held", flush=True)
time.sleep(60)
"""


def test_a_lock_ends_with_its_process(tmp_path):
    process = subprocess.Popen([sys.executable, "-c", HOLDS, str(tmp_path)], cwd=ROOT, text=True,
                               stdout=subprocess.PIPE, env=clean_environment())  # fmt: skip
    assert process.stdout.readline() == "held\n"
    mine = file_lock.FolderLock(tmp_path)
    refused(mine.take, "Another run")
    process.kill()
    process.wait()
    mine.take()
    assert mine.kept and not list(tmp_path.iterdir())
    mine.release()


@pytest.mark.filterwarnings("ignore:.*use of fork")
def test_a_forked_process_does_not_keep_the_lock(tmp_path):
    mine = file_lock.FolderLock(tmp_path)
    mine.take()
    child = os.fork()
    if child == 0:
        time.sleep(30)
        os._exit(0)
    try:
        time.sleep(0.2)
        mine.release()
        again = file_lock.FolderLock(tmp_path)
        again.take()
        again.release()
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


@pytest.mark.parametrize("kept", [True, False])
def test_where_folders_cannot_be_locked(tmp_path, monkeypatch, kept):
    """NFS locks files only; some file systems lock nothing."""
    flock = fcntl.flock

    def other(descriptor, operation):
        if not kept or stat.S_ISDIR(os.fstat(descriptor).st_mode):
            raise OSError(errno.EBADF, "no")
        flock(descriptor, operation)

    monkeypatch.setattr(fcntl, "flock", other)
    first, second = file_lock.FolderLock(tmp_path), file_lock.FolderLock(tmp_path)
    first.take()
    assert first.kept == kept
    if kept:
        refused(second.take, "Another run")
    first.release()
    second.take()
    second.release()
    assert [p.name for p in tmp_path.iterdir()] == [".lock"]


def test_a_later_run_keeps_its_summary(tmp_path):
    first = solve(tmp_path)
    first.add(found=1.0)
    assert dea.read_summary(tmp_path)["found"] == 1.0
    refused(lambda: first.add(status="perfect"), "'status'")
    solve(tmp_path)  # one after another is no conflict
    assert (tmp_path / "previous" / "history.csv").exists()
    refused(lambda: first.add(found=2.0), "holds another run by now")
    assert "found" not in dea.read_summary(tmp_path)


# ----------------------------------------------------------------------------------------- names


def test_every_column_of_the_package_is_known():
    """What `columns` lists are the columns that a run has."""
    failures = [dea.StretchLimit(3.0), dea.LossOfTension("y")]
    given = scene(loads=[dea.DeadLoad("top", (0.0, 0.0), ramp="pull")])
    run = solve(None, given, path=dea.Ramp(steps=1), failures=failures)
    record = HEIGHT | {"s": Stop(-1)}
    assert list(run.history[0]) == columns.names(given, record, failures, True)
    own = set(run.summary) - set(run.history[0])
    assert own == set(columns.SUMMARY)


TAKEN = (
    *columns.LEADING_COLUMNS, *columns.FIELD_COLUMNS, *columns.WORK, *columns.SUMMARY, "voltage_V",
    "pull_factor", "breakdown_ratio",
)  # fmt: skip


def test_a_record_named_like_a_column(tmp_path):
    given = scene(loads=[dea.DeadLoad("top", (0.0, 0.0), ramp="pull")])
    for name in TAKEN:
        record = {name: HEIGHT["h"]}
        refused(lambda record=record: solve(tmp_path / "out", given, record=record), repr(name))
    assert not (tmp_path / "out").exists()


def test_names_that_are_no_plain_words():
    given = scene()
    for name in ("a/b", "../a", "a\\b", "a,b", 'a"b', "a\nb", "a\x1b[31m", " a", "=a", ".a", "",
                 "a" * 101, "\u202ea"):  # fmt: skip
        record = {name: HEIGHT["h"]}
        refused(lambda record=record: solve(None, given, record=record), "name of an observable")


def test_two_records_of_one_column():
    record = {"a": dea.MeanDisplacement("top", "y"), "a_m": HEIGHT["h"]}
    refused(lambda: solve(None, record=record), "'a_m'")
    both = {"voltage": dea.Potential("top")}
    refused(lambda: solve(None, record=both), "the ramp 'voltage'")


# --------------------------------------------------------------------------------------- numbers


ONE = [np.float32(1), np.int64(1), np.array(1), Fraction(1)]


@pytest.mark.parametrize("one", ONE, ids=lambda one: f"{type(one).__name__}")
def test_numbers_of_every_kind(tmp_path, one):
    """In every place, with results on disk; the run is the same as with Python's own."""
    def given(one, count):
        return scene(
            electrodes=[dea.Electrode("top", 2000 * one), dea.Ground("bottom")],
            film=dea.Material(dea.Gent(50_000 * one, 100 * one), dea.IdealDielectric(3 * one)),
            loads=[dea.DeadLoad("top", (0 * one, 100 * one))],
            prescribed=[dea.Displacement("x_min", "x", 0 * one)],
            kinematics=dea.PlaneStrain(one / 1000),
            elements=dea.Discretisation(quadrature_degree=4 * count),
        )  # fmt: skip

    path = dea.Ramp(to=one, steps=2 * int(one), at=np.linspace(0.5, 1, 2))
    run = solve(tmp_path, given(one, int(one)), path)
    # 1/1000 in single precision is off by 5e-8, and so is the depth
    assert scene(kinematics=dea.PlaneStrain(one / 1000)).kinematics.depth == float(one / 1000)
    told = dea.read_summary(tmp_path)["settings"]
    assert told["electrodes"][0]["volts"] == 2000 and told["path"][0]["at"] == [0.5, 1.0]
    assert solve(tmp_path, given(one, int(one)), path, resume=True).history == run.history


def test_sequences_of_every_kind():
    for at in (np.array([0.5, 1.0]), [0.5, 1], (Fraction(1, 2), np.int8(1)), range(0, 2)):
        ramp = dea.Ramp(steps=1, at=at)
        assert all(type(value) in (int, float) for value in ramp.at)
        trace = dea.Trace("voltage", at=at, until=("h", np.float32(0.5)), steps=np.int64(3))
        assert type(trace.until[1]) is float and type(trace.steps) is int and trace.at == ramp.at
    assert dea.DeadLoad("top", np.array([1, 2])).pascal == (1, 2)
    assert dea.Ogden(np.array([1e4]), np.array([2])) == dea.Ogden((1e4,), (2,))
    assert BoxStack(np.float32(1), None, [Layer("a", np.array(1.0), np.int64(2))],
                    divisions=np.array([3])).divisions == (3,)  # fmt: skip


@pytest.mark.parametrize("wrong", [np.True_, True, np.array([1.0, 2.0]), 1j, np.complex128(1)])
def test_what_is_no_number(wrong):
    refused(lambda: scene(electrodes=[dea.Electrode("top", wrong), dea.Ground("bottom")]), "volts")


def test_text_columns():
    run = solve(None, path=dea.Ramp(steps=1))
    assert list(run.column("ramp")) == ["voltage"] * 2 and run["event"] == ""
    assert list(run.column("event")) == ["", ""]
    assert np.isnan(run.column("inertia")[0]) and run.column("inertia").dtype == float


class Gives:
    """Measures what it is given."""

    unit = ""

    def __init__(self, value):
        self.value = value

    def bind(self, problem):
        return lambda: self.value


def test_measurements_of_every_kind(tmp_path):
    kinds = (np.float32(0.5), np.array(0.5), Fraction(1, 2), np.longdouble(0.5))
    record = {f"x{k}": Gives(value) for k, value in enumerate(kinds)}
    record |= {"whole": Gives(np.int64(3)), "flag": Gives(np.True_)}
    run = solve(tmp_path, path=dea.Ramp(steps=1), record=record)
    wanted = {"x0": 0.5, "x1": 0.5, "x2": 0.5, "x3": 0.5, "whole": 3.0, "flag": 1.0}
    history = dea.read_history(tmp_path)
    assert {name: run[name] for name in wanted} == wanted
    assert {name: history[name][-1] for name in wanted} == wanted
    for wrong in (None, "0.5", [0.5, 0.5], 1j):  # an array of one entry is a number
        record = {"x": Gives(wrong)}
        with pytest.raises(dea.SolverError, match="must be a number"):
            solve(None, record=record)
