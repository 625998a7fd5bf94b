"""What a run will take, told before it: the factor's size against MUMPS, and `dea plan`."""

from __future__ import annotations

import json

import numpy as np
import pytest
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.cli import main
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.model.fields import Role
from dea_fenicsx.solvers import factors
from dea_fenicsx.solvers.dissection import MORE_ENTRIES, Dissection, dissection_of
from dea_fenicsx.solvers.newton import NewtonSolver

pytestmark = pytest.mark.usefixtures("quick_compile")

FILM = dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(3.0))

SCRIPT = '''
import sys
from mpi4py import MPI
import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer

parser = dea.Parser("A film.", "out")
parser.add_argument("--cells", type=int, default=2)
given = parser.parse_args()
strip = BoxStack(4e-3, None, [Layer("film", 1e-3)], divisions=(given.cells,))
film = dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(3.0))
scene = dea.Scene(dea.device(strip), {"film": film}, [dea.Electrode("top", 100.0), dea.Ground("bottom")],
    supports=[dea.Clamp("x_min")], kinematics=dea.PlaneStrain(1e-2))
open("begun", "w").close()
dea.solve(scene, [dea.Ramp(steps=4), dea.March(1.0)], out="out")
open("ended", "w").close()
'''  # noqa: E501


def scene(cells, layers=1, kinematics=None, depth=None):
    """A film of a number of cells along its length, and as many across it if it has a depth."""
    divisions = (cells,) if depth is None else (cells, cells)
    film = BoxStack(4e-2, depth, [Layer("film", 1e-2, divisions=layers)], divisions=divisions)
    return dea.Scene(
        dea.device(film, MPI.COMM_SELF), {"film": FILM},
        [dea.Electrode("top", 100.0), dea.Ground("bottom")], supports=[dea.Clamp("x_min")],
        **{} if kinematics is None else {"kinematics": kinematics},
    )  # fmt: skip


@pytest.mark.parametrize(("given", "error"), [
    (dict(cells=48, layers=12, kinematics=dea.PlaneStrain(1e-2)), 0.15),
    (dict(cells=200, layers=1, kinematics=dea.PlaneStrain(1e-2)), 0.2),
    (dict(cells=7, layers=7, depth=1e-2), 0.15),
    (dict(cells=12, layers=2, depth=4e-2), 0.15),
])  # fmt: skip
def test_entries_of_the_factor_against_mumps(given, error, monkeypatch):
    """In a square, in a strip one cell thick, in a block and in a film."""
    monkeypatch.setattr(factors, "is_possible", lambda problem: False)  # small ones take MUMPS, too
    made = scene(**given)
    solver = NewtonSolver(dea.model.problem.Problem(made), dea.NewtonOptions(factor="whole"))
    problem = solver.problem
    assert solver.factor_kind == "whole"
    solver.refresh_inertia()
    counted = solver._whole._factor.pc.getFactorMatrix().getMumpsInfog(9)
    told = dissection_of(problem, problem.space.fields).size()
    assert told.unknowns == problem.unknowns
    assert told.entries == pytest.approx(counted, rel=error)
    motion = [field for field in problem.space.fields if field.role is Role.MOTION]
    less = dissection_of(problem, motion).size()
    assert less.entries < told.entries and less.operations < told.operations


def test_a_line_has_its_closed_form():
    """Cells in a row that share one unknown each: no separator has more than one."""
    n = 64
    cells = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    found = Dissection(cells, np.ones(n + 1), np.arange(n, dtype=float)[:, None]).size()
    assert found.unknowns == n + 1
    # Each unknown is eliminated alone, with at most two others that bound it.
    assert n + 1 <= found.entries / MORE_ENTRIES <= 3 * (n + 1)


def test_small_pieces_stand_for_their_neighbours(monkeypatch):
    """On a regular mesh, nothing is lost if only one half of each small piece is cut on."""
    from dea_fenicsx.solvers import dissection

    problem = dea.model.problem.Problem(scene(66, 18, dea.PlaneStrain(1e-2)))
    whole = dissection_of(problem, problem.space.fields).size()
    monkeypatch.setattr(dissection, "CELLS_OF_LARGE_MESH", 100)
    monkeypatch.setattr(dissection, "CELLS_WITH_ONE_HALF", 300)
    part = dissection_of(problem, problem.space.fields).size()
    assert part.entries == pytest.approx(whole.entries, rel=0.1)
    assert part.operations == pytest.approx(whole.operations, rel=0.1)


def test_a_plan_grows_with_its_model_and_shrinks_with_ranks():
    small, large = (dea.plan(scene(n, 2, depth=4e-2), dea.Ramp(steps=5)) for n in (4, 12))
    assert large.unknowns > 5 * small.unknowns and large.steps == small.steps == 5
    for name in ("entries", "operations", "memory_bytes", "factorisation_s", "step_s", "seconds"):
        assert getattr(large, name) > getattr(small, name), name
    shared = dea.plan(scene(12, 2, depth=4e-2), dea.Ramp(steps=5), ranks=4)
    assert shared.seconds < large.seconds
    assert shared.memory_bytes / 4 < large.memory_bytes < shared.memory_bytes
    assert dea.plan(scene(4, 2, depth=4e-2)).seconds is None
    cheap = dea.NewtonOptions(factor="split")
    assert dea.plan(scene(4, 2, depth=4e-2), options=cheap).entries < small.entries
    levels = dea.plan(scene(12, 2, depth=4e-2), options=dea.NewtonOptions(factor="multigrid"))
    assert levels.factor == "multigrid" and levels.memory_bytes < large.memory_bytes
    assert "entries" not in str(levels) and "count" not in str(levels)


def test_the_command_runs_a_script_up_to_its_solve(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "film.py").write_text(SCRIPT)
    assert main(["plan", "film.py", "--cells", "3", "--ranks", "2"]) == 0
    told = capsys.readouterr().out
    assert " 3 cells, 2 ranks" in told and "time of 104 steps" in told and "GB a rank" in told
    assert (tmp_path / "begun").exists() and not (tmp_path / "ended").exists()
    assert not (tmp_path / "out").exists()
    assert main(["plan", "--json", "film.py"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["cells"] == 2 and found["ranks"] == 1 and found["factor"] == "whole"
    assert dea.solve is dea.run.session.solve  # the front door is as before


@pytest.mark.parametrize(("words", "told"), [
    (["plan", "nothing.py"], "There is no script nothing.py"),
    (["plan", "empty.py"], "without a call of dea.solve"),
    (["plan", "film.py", "--ranks", "0"], "number of ranks"),
    (["plan", "film.py", "--ranks", "1000000"], "at most 100000 ranks"),
])  # fmt: skip
def test_what_cannot_be_planned_is_told(words, told, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "film.py").write_text(SCRIPT)
    (tmp_path / "empty.py").write_text("import dea_fenicsx as dea\n")
    assert main(words) == 2
    text = capsys.readouterr().err
    assert told in text and text.count("\n") == 1 and len(text) < 400
