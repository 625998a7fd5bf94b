"""Damaged files by the hundred: each is read, or refused in one sentence."""

from __future__ import annotations

import csv
import subprocess
import sys

import pytest
from conftest import ROOT, clean_environment

from dea_fenicsx import cli

COUNT, SEED = 500, 20


def test_damaged_files():
    """In a process of its own, for it forks, and must have nothing else running."""
    pytest.importorskip("pyvista")
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-m", "tests.fuzz.readers", f"--count={COUNT}",
         f"--seed={SEED}", "--jobs=2"],
        cwd=ROOT, env=clean_environment() | {"DEA_FENICSX_CFLAGS": "-O1 -g0"}, text=True,
        capture_output=True, stdin=subprocess.DEVNULL, timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{COUNT} trials, 0 faults" in done.stdout
    # each kind of file was tried, and neither all nor none of them could be read
    for kind in ("history", "summary", "xdmf", "hdf5", "checkpoint"):
        for outcome in ("read", "refused"):
            assert f"{kind}: {outcome}" in done.stdout


# ------------------------------------------------------------------- what the fuzzing itself finds

BAD = '''
import os, signal, sys, tempfile, time
from pathlib import Path
from tests.fuzz import forked

forked.SECONDS = 2.0
KEPT = []

def changing(): os.environ["OTHER"] = "1"
def handling(): signal.signal(signal.SIGINT, lambda *_: None)
def opening(): KEPT.append(open("/dev/null"))
def masking(): os.umask(0o77)
def leaving(): Path("left").write_text("")
def forgetting(): tempfile.mkdtemp()
def crashing(): os.kill(os.getpid(), signal.SIGSEGV)
def hanging(): time.sleep(60)
def eating(): bytearray(2 * forked.ROOM)
def writing(): Path("big").write_bytes(bytes(1)); os.truncate("big", 2 * forked.FILE)
def ending(): os._exit(3)
def raising(): raise KeyError("x")

BAD = [changing, handling, opening, masking, leaving, forgetting, crashing, hanging, eating,
       writing, ending, raising]

def trial(number, scratch):
    if number % 4 == 1:
        BAD[number // 4]()
    return "good"

with tempfile.TemporaryDirectory() as place:
    numbers = list(range(4 * len(BAD)))
    for ended in forked.all_of(trial, numbers, Path(place), int(sys.argv[1]), 10):
        print(ended.number, ended.outcome, ended.why, sep="|")
'''


@pytest.mark.parametrize("jobs", [1, 3])
def test_a_bad_trial_is_found_alone(jobs):
    """Of each four trials the second goes wrong: it is told as a fault, and no other one is."""
    done = subprocess.run(
        [sys.executable, "-c", BAD, str(jobs)], cwd=ROOT, env=clean_environment(), text=True,
        capture_output=True, stdin=subprocess.DEVNULL, timeout=100,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    told = {int(n): (outcome, why) for n, outcome, why in (
        line.split("|") for line in done.stdout.splitlines())}  # fmt: skip
    faults = [
        "environment", "handler", "open file", "mask", "left", "behind", "status -11",
        "no end within 2 s", "MemoryError", "File too large", "status 3", "KeyError",
    ]  # fmt: skip
    assert sorted(told) == list(range(4 * len(faults)))
    for number, (outcome, why) in told.items():
        if number % 4 == 1:
            assert outcome == "fault" and faults[number // 4] in why, (number, why)
        else:
            assert (outcome, why) == ("good", "")


@pytest.mark.parametrize("column", ["max_field_V_per_m", "voltage_V", "h", "time", "step", "min_J"])
def test_show_with_a_text_for_a_number(tmp_path, capsys, column):
    """A column that a damaged history turns into text is left out of the summary; no traceback."""
    names = ["step", "time", "ramp", "event", "voltage_V", "h", "max_field_V_per_m", "min_J"]
    rows = [
        {n: "" if n in ("ramp", "event") else "1.5" for n in names} | {"step": k, "time": k}
        for k in (0, 1)
    ]
    rows[1][column] = "372\0.56"
    with open(tmp_path / "history.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, names)
        writer.writeheader()
        writer.writerows(rows)
    xdmf = "<Xdmf><Domain><Grid><Grid><Time Value='1'/></Grid></Grid></Domain></Xdmf>"
    (tmp_path / "fields.xdmf").write_text(xdmf)
    assert cli.main(["show", str(tmp_path), "--text"]) == 0
    assert cli.main(["show", str(tmp_path), "--paraview"]) == 0
    told = capsys.readouterr()
    assert told.err == ""
    for name, words in (("max_field_V_per_m", "max field"), ("voltage_V", "voltage")):
        lines = [line for line in told.out.splitlines() if line.lstrip().startswith(words)]
        assert len(lines) == (0 if name == column else 2)
    compile((tmp_path / "view.py").read_text("utf-8"), "view.py", "exec")
