"""Errors in scripts on several ranks: all ranks end, within seconds, with one message."""

from __future__ import annotations

import time

import pytest

HEAD = """
import sys
import dea_fenicsx as dea
from dea_fenicsx.support import errors
from mpi4py import MPI
errors.GRACE_S = errors.EXIT_GRACE_S = 0.5
dea.Parser("From here on an error ends all ranks.", "out")
rank, everyone = MPI.COMM_WORLD.rank, MPI.COMM_WORLD
"""
RECORDED = """
from dea_fenicsx.geometry import BoxStack, Layer
class Mine:
    unit = ""
    def bind(self, problem):
        return self.measure
    calls = 0
    def measure(self):
        self.calls += 1
        if self.calls == 3 and rank == 1:
            raise ValueError("no such thing")
        return 0.0
rubber = dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(3.0))
strip = dea.read_gmsh(BoxStack(1e-3, None, [Layer("film", 1e-3)], divisions=(4,)))
scene = dea.Scene(strip, {"film": rubber}, [dea.Electrode("top", 100.0), dea.Ground("bottom")],
                  [dea.Clamp("bottom")], kinematics=dea.PlaneStrain())
dea.solve(scene, dea.Ramp(steps=4), {"x": Mine()}, out=sys.argv[1], quiet=True)
"""
SOLVING = RECORDED.replace("{\"x\": Mine()}", "{}").replace("strip = ", "AT_READING\nstrip = ", 1)
SOLVING = SOLVING.replace("dea.solve", "AT_SOLVING\ndea.solve", 1)


def solving(reading="", at_solving=""):
    """A script that reads a mesh and solves, with a line before each of the two."""
    return SOLVING.replace("AT_READING", reading).replace("AT_SOLVING", at_solving)


LEFT = "Error: Rank 1 has ended its script, so the others cannot go on."
LATE = "import time\nif rank == 1: time.sleep(1); "
# script, ranks, exit status, the one message, whether there is a traceback
SCRIPTS = {
    "bad input on all ranks": (
        "raise dea.InputError('Wrong.')", 2, 2, "Error: Wrong.", 0),
    "bad input on one rank": (
        "if rank == 1: raise dea.InputError('Wrong.')\neveryone.barrier()", 2, 2,
        "Error on rank 1 alone: Wrong.", 0),
    "bad input on rank 0": (
        "if rank == 0: raise dea.InputError('Wrong.')\neveryone.barrier()", 2, 2,
        "Error on rank 0 alone: Wrong.", 0),
    "bad input on two of three": (
        "if rank > 0: raise dea.InputError('Wrong.')\neveryone.barrier()", 3, 2,
        "Error on rank 1 alone: Wrong.", 0),
    "different errors": (
        "raise dea.InputError('Wrong.') if rank else dea.SolverError('Failed.')", 2, None,
        "Error: Failed.", 0),
    "a slip on all ranks": ("1 / 0", 2, 1, "ZeroDivisionError: division by zero", 1),
    "a slip on one rank": (
        "if rank == 1: 1 / 0\neveryone.allreduce(rank)", 2, 1,
        "ZeroDivisionError: division by zero", 1),
    "a slip on one of three": (
        "if rank == 2: 1 / 0\neveryone.bcast(rank, root=2)", 3, 1,
        "ZeroDivisionError: division by zero", 1),
    "a slip in what is recorded, on one rank": (RECORDED, 2, 1, "ValueError: no such thing", 1),
    "interrupted on all ranks": ("raise KeyboardInterrupt", 2, 130, "Interrupted.", 0),
    "interrupted on one rank": (
        "if rank == 1: raise KeyboardInterrupt\neveryone.barrier()", 2, 130, "Interrupted.", 0),
    "sys.exit on one rank": (
        "if rank == 1: sys.exit(7)\neveryone.barrier()", 2, 7,
        "Error on rank 1 alone: the script has ended by sys.exit; all ranks are ended.", 0),
    "sys.exit on all ranks": ("sys.exit('Error: no more.')", 1, 1, "Error: no more.", 0),
    "sys.exit on both ranks": (
        "if rank == 0: print('Error: enough', file=sys.stderr)\nsys.exit(7)", 2, 7,
        "Error: enough", 0),
    "sys.exit without an error on one rank": (
        "import time\nif rank == 1: sys.exit(0)\ntime.sleep(2)\n"
        "print('Error: at the end', file=sys.stderr)", 2, 0, "Error: at the end", 0),
    "sys.exit(0) on one rank before a mesh is read": (
        solving(reading="if rank == 1: sys.exit(0)"), 2, 1, LEFT, 0),
    "sys.exit() on one rank, the others wait in solve": (
        solving(at_solving=f"{LATE}sys.exit()"), 2, 1, LEFT, 0),
    "quit() on one of three": (solving(at_solving="if rank == 1: quit()"), 3, 1, LEFT, 0),
    "sys.exit(0) in what is recorded, on one rank": (
        RECORDED.replace('raise ValueError("no such thing")', "sys.exit(0)"), 2, 1, LEFT, 0),
    "sys.exit(0) on one rank, the other solves alone": (
        solving("", "if rank == 1: sys.exit(0)").replace(
            "divisions=(4,))", "divisions=(4,)), MPI.COMM_SELF")
        + "print('Error: at the end', file=sys.stderr)", 2, 0, "Error: at the end", 0),
    "sys.exit(0) on both ranks after a solution": (
        solving() + "if rank == 0: print('Error: at the end', file=sys.stderr)\nsys.exit(0)",
        2, 0, "Error: at the end", 0),
    "SystemExit raised on one rank": (
        "if rank == 1: raise SystemExit(256)\neveryone.barrier()", 2, 1,
        "Error on rank 1 alone: the script has ended by sys.exit; all ranks are ended.", 0),
    "sys.exit with words on one rank, PETSc loaded": (
        "from dea_fenicsx.support.compat import PETSc\nif rank == 0: sys.exit('Nothing to do.')\n"
        "everyone.barrier()", 2, 1, "Nothing to do.", 0),
    "sys.exit that is caught": (
        "import time\ntry:\n    if rank == 1: sys.exit(7)\nexcept SystemExit: pass\n"
        "if rank == 0:\n    time.sleep(2)\n    print('Error: at the end', file=sys.stderr)",
        2, 0, "Error: at the end", 0),
    "bad input, to be debugged": (
        "sys.argv.append('--debug')\nraise dea.InputError('Wrong.')", 2, 2,
        "dea_fenicsx.support.errors.InputError: Wrong.", 1),
}  # fmt: skip


@pytest.mark.mpi
@pytest.mark.parametrize("case", SCRIPTS)
def test_one_message_and_no_rank_left(quick_compile, start, tmp_path, case):
    text, ranks, status, message, tracebacks = SCRIPTS[case]
    script = tmp_path / "script.py"
    script.write_text(HEAD + text)
    begun = time.monotonic()
    done = start(script, tmp_path / "out", ranks=ranks, timeout=120)
    # most of it is Python's start, and the compiler of the one that solves something
    assert time.monotonic() - begun < (120 if "dea.solve" in text else 30)
    assert done.returncode == status or (status is None and done.returncode)
    told = done.stderr.splitlines()
    assert told.count(message) == 1, done.stderr
    assert done.stderr.count("Traceback (most recent call last)") == tracebacks
    assert sum(line.startswith(("Error", "Interrupted")) for line in told) == (
        1 if not tracebacks else int("one" in case)
    )
    if text is RECORDED:  # what was done before is on disk
        assert (tmp_path / "out" / "history.csv").read_text().count("\n") == 3


def test_alone_nothing_changes(start, tmp_path):
    """Without MPI: a sentence for bad input, Python's own traceback for a slip."""
    script = tmp_path / "script.py"
    head = "import dea_fenicsx as dea\ndea.Parser('A script.', 'out')\n"
    for text, status, words in (
        ("raise dea.InputError('Wrong.')", 2, "Error: Wrong.\n"),
        ("raise KeyboardInterrupt", 130, "Interrupted.\n"),
    ):
        script.write_text(f"{head}{text}\n")
        done = start(script)
        assert (done.returncode, done.stderr) == (status, words)
    script.write_text(f"{head}1 / 0\n")
    done = start(script)
    assert done.returncode == 1
    assert done.stderr.startswith("Traceback") and "line 3" in done.stderr
