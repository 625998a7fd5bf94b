"""What a run says while it lasts, on a terminal, into a pipe and into its log."""

from __future__ import annotations

import io
import os
import pty
import re
import subprocess
import sys

import pytest
from conftest import clean_environment, needed_mpirun
from hard.table import LIMIT, Z, film

import dea_fenicsx as dea
from dea_fenicsx.support import progress
from dea_fenicsx.support.progress import Progress, on_terminal

pytestmark = pytest.mark.usefixtures("quick_compile")


class Terminal(io.StringIO):
    def isatty(self):
        return True


def terminal(monkeypatch):
    """Standard output becomes a terminal of 60 columns."""
    screen = Terminal()
    monkeypatch.setattr(sys, "stdout", screen)
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.setattr(progress, "_RENEW_S", -1.0)
    return screen


def solve(**options):
    return dea.solve(film(volts=0.8 * LIMIT, loads=()), dea.Ramp(steps=4), Z, **options)


def test_plain_lines(tmp_path, capsys):
    """Load and its change, what is recorded, Newton, share and time left; the log has the same."""
    solve(out=tmp_path)
    printed = capsys.readouterr().out
    assert "\r" not in printed
    lines = printed.splitlines()
    assert len(lines) == 1 + 5 + 1
    volts = 0.8 * LIMIT / 4
    by = re.escape(f"({volts:+.5g})")
    assert re.fullmatch(
        rf"step   2  voltage {2 * volts:.6g} V {by}  z 0\.\d+  Newton \d+  Krylov \d+  "
        r"\d+\.\d s  50 %, \d+ s left", lines[3],
    )  # fmt: skip
    assert lines[-2].endswith("  100 %")
    assert re.fullmatch(r"completed: 4 steps, \d+\.\d s", lines[-1])
    logged = (tmp_path / "run.log").read_text().splitlines()
    assert [line[21:] for line in logged] == lines
    assert all(re.match(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d  ", line) for line in logged)


def test_a_trace_tells_the_way_to_its_goal(capsys):
    """Of the 200 steps that it may take it needs few, so their share tells nothing."""
    dea.solve(film(volts=0.8 * LIMIT, loads=()), dea.Trace("voltage", until=("z", 0.95)), Z)
    rows = re.findall(r"  z (0\.\d+).*  (\d+) %", capsys.readouterr().out)
    assert len(rows) > 2 and rows[-1][1] == "100"
    for z, told in rows[:-1]:
        assert int(told) == pytest.approx(100 * (1 - float(z)) / 0.05, abs=2)


def test_quiet_and_verbose(tmp_path, capsys):
    solve(out=tmp_path, quiet=True)
    assert capsys.readouterr().out == ""
    assert "completed: 4 steps" in (tmp_path / "run.log").read_text()
    solve(verbose=True)
    lines = capsys.readouterr().out.splitlines()
    newton = [line for line in lines if re.fullmatch(r"    Newton \d+: residual \d\.\de-\d+", line)]
    steps = [int(found[1]) for line in lines if (found := re.search(r"  Newton (\d+)  ", line))]
    assert len(newton) == sum(steps) > 4
    assert "    factorising" in lines


def test_verbose_by_the_command_line(monkeypatch):
    monkeypatch.setattr(progress, "verbose_by_default", False)
    parser = dea.Parser("film", out="out")
    parser.parse_args(["--verbose"])
    assert Progress(True, False).verbose
    parser.parse_args([])
    assert not Progress(True, False).verbose


def test_one_line_on_a_terminal(monkeypatch, tmp_path):
    """It is renewed with each stage and never wider than the terminal; the last step stays."""
    screen = terminal(monkeypatch)
    solve(out=tmp_path)
    head, *rest, step, end, nothing = screen.getvalue().split("\n")
    assert rest == [] and nothing == ""
    shown = step.split("\r\x1b[K")
    assert all(len(text) < 60 for text in shown[:-1])
    assert {"assembling", "factorising", "solving"} <= {w for text in shown for w in text.split()}
    assert any(re.match(r"50 %, \d+ s left  Newton 1: residual", text) for text in shown)
    assert shown[-1].startswith("step   4  voltage")
    assert end.startswith("\r\x1b[Kcompleted: 4 steps")
    logged = (tmp_path / "run.log").read_text().splitlines()
    assert sum("  step  " in line for line in logged) == 5


def test_retries_stay_on_a_terminal(monkeypatch):
    screen = terminal(monkeypatch)
    with pytest.raises(dea.EquilibriumLost):
        dea.solve(film(volts=1.05 * LIMIT), dea.Ramp(steps=2), Z)
    lines = screen.getvalue().split("\n")
    assert sum("step halved" in line for line in lines) > 3
    assert lines[-2].startswith("\r\x1b[Kequilibrium lost: ")


def test_a_reader_that_has_gone_does_not_stop_a_run(monkeypatch):
    class Full(io.StringIO):
        def write(self, text):
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(sys, "stdout", Full())
    assert solve().summary["status"] == "completed"


def test_other_ranks_are_silent(capsys, tmp_path):
    silent = Progress(False, False, True)
    silent.log = tmp_path / "run.log"
    silent.say("a")
    silent.step("b", 0.5)
    silent.stage("Newton 1: residual 1")
    silent.end("c")
    assert capsys.readouterr().out == ""
    assert not silent.log.exists()


def test_time_left(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    told = Progress(True, True)
    told.begin(0.5)  # resumed half-way
    now[0] = 60.0
    assert told.left(0.5) == "50 %"
    assert told.left(0.75) == "75 %, 60 s left"
    assert told.left(0.6) == "60 %, 4 min left"
    assert told.left(0.501) == "50 %, 8.3 h left"
    assert told.left(1.0) == "100 %"


@pytest.mark.mpi
def test_a_terminal_is_found_through_mpirun():
    """mpirun's ranks write into a pipe, which it passes on to its own terminal, or file."""
    mpirun = needed_mpirun()
    code = "from dea_fenicsx.support.progress import on_terminal; print('terminal', on_terminal())"
    command = [mpirun, "-n", "1", sys.executable, "-c", code]
    main, its = pty.openpty()
    options = {"env": clean_environment(), "stdin": subprocess.DEVNULL, "timeout": 60}
    subprocess.run(command, stdout=its, check=True, **options)
    os.close(its)
    assert b"terminal True" in os.read(main, 1000)
    os.close(main)
    piped = subprocess.run(command, stdout=subprocess.PIPE, check=True, **options)
    assert b"terminal False" in piped.stdout
    assert not on_terminal() or sys.stdout.isatty()
