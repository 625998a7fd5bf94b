"""Interrupts, a full disk, files in use: a clean end, every completed step readable, resumable."""

from __future__ import annotations

import errno
import os
import resource
import signal
import subprocess
import sys

import numpy as np
import pytest
from conftest import clean_environment
from hard.kills import difference, readable
from hard.table import LIMIT, Z, film
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.results import folder as folder_module
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.support.interruption import Interruption

pytestmark = pytest.mark.usefixtures("quick_compile")


def solve(out, **options):
    """A disc of film in six steps."""
    options = {"record": Z, "quiet": True, "stability": "every"} | options
    return dea.solve(film(volts=0.8 * LIMIT), dea.Ramp(steps=6), out=out, **options)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The same run, undisturbed."""
    out = tmp_path_factory.mktemp("whole")
    solve(out)
    return out


def carried_on(out, whole):
    """Resume; the end is that of the undisturbed run, and everything on disk is whole."""
    solve(out, resume=True)
    assert dea.read_summary(out)["status"] == "completed"
    assert readable(out) == 7
    assert difference(out, whole) < 1e-8
    assert not [f for f in out.rglob(".*") if f.name.endswith(".new")]


def one_sentence(error):
    text = str(error)
    assert text.endswith(".") and "\n" not in text and len(text) < 400
    return text


class Trouble:
    """An observable that makes trouble when it is read at a step."""

    unit = ""

    def __init__(self, step, make):
        self.step, self.make = step, make

    def bind(self, problem):
        steps = iter(range(100))

        def measure():
            if next(steps) == self.step:
                self.make()
            return 0.0

        return measure


PLACES = {
    "assembly": (NewtonSolver, "_assemble"),
    "factorisation": (NewtonSolver, "_factorise"),
    "solve": (NewtonSolver, "_krylov"),
    "write": (folder_module, "replace_file"),
}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("place", PLACES)
def test_interrupt(tmp_path, whole, monkeypatch, place, number):
    """The signal strikes inside; the run ends on its next occasion."""
    owner, name = PLACES[place]
    original = getattr(owner, name)
    calls = iter(range(1000))

    def struck(*arguments, **named):
        if next(calls) == (3 if place in ("assembly", "factorisation") else 9):
            signal.raise_signal(number)
        return original(*arguments, **named)

    before = signal.getsignal(number)
    with monkeypatch.context() as patch:
        patch.setattr(owner, name, struck)
        with pytest.raises(dea.Interrupted) as caught:
            solve(tmp_path)
    assert signal.getsignal(number) is before
    last = caught.value.run.history[-1]["step"]
    assert f"by {number.name}; the steps up to {last} are kept" in one_sentence(caught.value)
    assert caught.value.exit_status == 130
    assert dea.read_summary(tmp_path)["status"] == "interrupted"
    assert "Interrupted: the run ends" in (tmp_path / "run.log").read_text()
    assert readable(tmp_path) == last + 1 < 7
    carried_on(tmp_path, whole)


def test_a_signal_after_the_last_step_is_not_lost():
    with pytest.raises(KeyboardInterrupt), Interruption(MPI.COMM_SELF):
        signal.raise_signal(signal.SIGINT)


BUSY = """
from mpi4py import MPI
from dea_fenicsx.results import folder as folder_module
from dea_fenicsx.support.interruption import Interruption
with Interruption(MPI.COMM_SELF):
    print("busy", flush=True)
    sum(range(10**11))  # hours, in which Python looks at no signal
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_second_signal_ends_at_once(number):
    """Also where the first one cannot be noticed yet: within a factorisation, say."""
    process = subprocess.Popen([sys.executable, "-c", BUSY], stdout=subprocess.PIPE, text=True,
                               env=clean_environment())  # fmt: skip
    assert process.stdout.readline() == "busy\n"
    process.send_signal(number)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(timeout=0.5)
    process.send_signal(number)
    assert process.wait(timeout=10) == -number
    process.stdout.close()


INTERRUPTED = """
import os, signal, sys
sys.path.insert(0, {tests!r})
from test_interruption import *
from mpi4py import MPI
strip = dea.read_gmsh(BoxStack(1e-3, None, [Layer("film", 1e-3)], divisions=(4,)))
def strike():
    if MPI.COMM_WORLD.rank == 1:
        os.kill(os.getpid(), signal.SIGINT)
dea.solve(film(volts=0.8 * LIMIT, device=strip), dea.Ramp(steps=6),
          Z | {{"x": Trouble(3, strike)}}, out=sys.argv[1], stability="every")
"""


@pytest.mark.mpi
def test_one_rank_interrupted_ends_all(start, tmp_path):
    """Rank 1 alone is sent the signal; one sentence, and what was done is kept."""
    script = tmp_path / "film.py"
    script.write_text(INTERRUPTED.format(tests=os.path.dirname(__file__)).replace(
        "from mpi4py", "from dea_fenicsx.geometry import BoxStack, Layer\nfrom mpi4py"))
    done = start(script, tmp_path / "out", ranks=2, timeout=100)
    assert done.returncode == 130, done.stderr
    told = [x for x in done.stderr.splitlines() if x.startswith("Error: ")]
    assert len(told) == 1 and "by SIGINT; the steps up to 3 are kept in" in told[0]
    assert "Traceback" not in done.stderr
    assert readable(tmp_path / "out") == 4
    assert "interrupted: 3 steps" in done.stdout.splitlines()[-1]


# ------------------------------------------------------------------------------- disk


def no_larger_than(size):
    """From now on no file of this process can grow beyond a size: what a full disk does."""
    _, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, most))


@pytest.mark.parametrize(("size", "step"), [(0, 0), (0, 3), (3000, 2), (10_000, 4)])
def test_no_room(tmp_path, whole, size, step):
    """Checkpoint, fields or history cannot be written; what stands stays."""
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        with pytest.raises(dea.MachineError) as caught:
            solve(tmp_path, record=Z | {"x": Trouble(step, lambda: no_larger_than(size))})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert f"cannot be written any more ({os.strerror(errno.EFBIG)})" in one_sentence(caught.value)
    kept = len(caught.value.run.history)
    assert step <= kept < 7
    assert readable(tmp_path) >= kept
    assert not kept or (tmp_path / "checkpoint.npz").exists()
    # the other observable was one of that run's columns only
    solve(tmp_path, resume=True, record=Z | {"x": Trouble(-1, None)})
    assert readable(tmp_path) == 7
    found, wanted = dea.read_history(tmp_path), dea.read_history(whole)
    assert np.allclose(found["z"], wanted["z"], rtol=1e-8)


def test_no_room_for_one_file_only(tmp_path, whole):
    """All steps fit, but not all in one file: they stay where they are, and the run is whole."""
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    largest = max(f.stat().st_size for f in whole.iterdir() if f.name != "fields.h5")
    assert largest < 0.8 * (whole / "fields.h5").stat().st_size
    try:
        no_larger_than(largest + 2000)
        run = solve(tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert run.summary["status"] == "completed"
    assert (tmp_path / "parts").is_dir() and not (tmp_path / "fields.h5").exists()
    assert "no room for one fields.h5" in (tmp_path / "run.log").read_text()
    assert readable(tmp_path) == 7
    carried_on(tmp_path, whole)


def test_a_folder_taken_away(tmp_path):
    """The results folder vanishes under the run."""
    out = tmp_path / "out"
    with pytest.raises(dea.MachineError, match="No such file or directory") as caught:
        solve(out, record={"x": Trouble(2, lambda: out.rename(tmp_path / "moved"))})
    one_sentence(caught.value)
    assert readable(tmp_path / "moved") == 2


def test_files_that_another_program_holds(tmp_path, whole):
    """A step's file is open for writing elsewhere, and locked: the run goes on."""
    hold = "import h5py, sys; f = h5py.File(sys.argv[1], 'r+'); print(1, flush=True); input()"
    held = []

    def take():
        held.append(subprocess.Popen(
            [sys.executable, "-c", hold, str(tmp_path / "parts" / "step_00001.h5")],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        ))  # fmt: skip
        assert held[0].stdout.readline() == "1\n"

    try:
        run = solve(tmp_path, record=Z | {"x": Trouble(3, take)})
        assert held[0].poll() is None
    finally:
        held[0].communicate("\n", timeout=20)
    assert run.summary["status"] == "completed"
    assert readable(tmp_path) == 7
    assert np.allclose(run.column("z"), dea.read_history(whole)["z"], rtol=1e-8)
