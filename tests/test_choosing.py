"""Multigrid is taken where a direct factor hardly fits into memory, and only where it can serve."""

from __future__ import annotations

from contextlib import contextmanager

import pytest
from conftest import on_demand
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.cli import main
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.run import choosing, costs
from dea_fenicsx.solvers import linear
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.support.free_memory import free_bytes

pytestmark = pytest.mark.usefixtures("quick_compile")

FILM = dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(3.0))
VOLTS = [dea.Electrode("top", 8e3), dea.Ground("bottom")]
RECORD = {"up": dea.MeanDisplacement("x_max", "z")}
TAKEN, NOT_TAKEN = "so that multigrid is taken", "Multigrid is not taken, because "


def film(comm=MPI.COMM_SELF, size=2e-3, cells=(2, 2), **parts):
    """A film in space that is clamped at one side."""
    device = dea.read_gmsh(BoxStack(size, size, [Layer("film", 1e-3, 2)], cells), comm)
    return dea.Scene(device, {"film": FILM}, **dict(
        electrodes=VOLTS, supports=[dea.Clamp("x_min")]) | parts)  # fmt: skip


def direct_bytes(problem, factor="whole"):
    """What a direct factor is estimated to need beside the processes."""
    own = problem.comm.size * costs.BYTES_OF_RANK
    return costs.with_factor(problem, factor, problem.comm.size).memory - own


@contextmanager
def free(share, problem):
    """A machine on which this share of what a direct factor needs is free.  Collective."""
    found = share * direct_bytes(problem)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(choosing, "free_bytes", lambda: found)
        patch.setattr(choosing, "BYTES_NOT_ASKED_FOR", 0.0)
        yield


def solved(scene, record=RECORD, **how):
    return dea.solve(scene, dea.Ramp(steps=2), record, quiet=True, **how)


def chosen(scene, path=(), stability="last", estimates=False, options=None):
    """The choice where a direct factor needs twice what is free."""
    solver = NewtonSolver(Problem(scene), options)
    with free(0.5, solver.problem):
        return choosing.choose(solver, choosing.Demands(path, stability, estimates))


def test_multigrid_is_taken_and_told(tmp_path):
    """The same state as with the factor, and one line that says why and what to do."""
    direct = solved(film(), out=tmp_path / "direct")
    assert direct.summary["preconditioner"] == "whole" and direct.summary["stable"]
    assert "multigrid" not in (tmp_path / "direct" / "run.log").read_text()
    with free(0.9, direct.problem):
        run = solved(film(), out=tmp_path / "levels")
    assert run.summary["preconditioner"] == "multigrid"
    assert run.summary["settings"]["newton"]["factor"] == "auto"
    assert run["up_m"] == pytest.approx(direct["up_m"], rel=1e-8)
    log = (tmp_path / "levels" / "run.log").read_text()
    line = next(line for line in log.splitlines() if "A direct factor needs about" in line)
    assert TAKEN in line and 'NewtonOptions(factor="whole") keeps the factor' in line
    assert run.summary["stable"] is None and "not counted with multigrid" in log
    assert "not counted with multigrid" in run.summary["message"]


def test_a_factor_that_fits_is_kept():
    """It is estimated to need 0.8 of what is free, but for a little more or less."""
    solver = NewtonSolver(Problem(film()))
    demands = choosing.Demands()
    with free(1.01 / choosing.MOST_SHARE_OF_FREE_MEMORY, solver.problem):
        assert choosing.choose(solver, demands) == choosing.Choice()
    with free(0.99 / choosing.MOST_SHARE_OF_FREE_MEMORY, solver.problem):
        assert choosing.choose(solver, demands).multigrid


def test_nothing_is_counted_where_much_is_free(monkeypatch):
    def never(*_):
        raise AssertionError("the entries are counted")

    monkeypatch.setattr(choosing, "size_kept", never)
    assert choosing.choose(NewtonSolver(Problem(film())), choosing.Demands()) == choosing.Choice()


def test_where_nothing_is_known_of_the_memory(monkeypatch):
    monkeypatch.setattr(choosing, "free_bytes", lambda: None)
    assert choosing.choose(NewtonSolver(Problem(film())), choosing.Demands()) == choosing.Choice()


@pytest.mark.parametrize(("how", "why"), [
    ({"stability": "every"}, 'stability="every" counts negative eigenvalues.'),
    ({"path": [dea.Ramp(), dea.Trace("voltage")]}, "a trace counts negative eigenvalues."),
    ({"path": [dea.Ramp(snap=True)]}, "a ramp that goes on at a limit point counts"),
    ({"path": [dea.March(1.0, inertia=True)]}, "it cannot solve for a motion with inertia."),
    ({"estimates": True}, "an estimate of errors makes a factor all the same."),
])  # fmt: skip
def test_what_a_run_asks_for_keeps_the_factor(how, why):
    found = chosen(film(), **how)
    assert not found.multigrid and NOT_TAKEN + why in found.told
    assert "it may not fit" in found.told and len(found.told) < 400


@pytest.mark.parametrize(("changes", "why"), [
    ({"electrodes": [dea.ChargedElectrode("top", 1e-9), dea.Ground("bottom")]}, "nothing is tied"),
    ({"supports": [dea.FreeBody()], "electrodes": []}, "needs a device that is held"),
    ({"size": 2e-2, "cells": (2, 2)}, "cells are too slender for it."),
])  # fmt: skip
def test_scenes_that_do_not_suit_keep_the_factor(changes, why):
    found = chosen(film(**changes))
    assert not found.multigrid and NOT_TAKEN in found.told and why in found.told


def test_a_plane_keeps_the_factor(tmp_path):
    """In the plane, too, a run says that its factor may not fit."""
    strip = dea.read_gmsh(BoxStack(1e-3, None, [Layer("film", 1e-3)], 2), MPI.COMM_SELF)
    scene = dea.Scene(strip, {"film": FILM}, VOLTS, [dea.Clamp("x_min")],
                      kinematics=dea.PlaneStrain(1e-3))  # fmt: skip
    with free(0.5, Problem(scene)):
        run = solved(scene, None, out=tmp_path)
    assert run.summary["preconditioner"] == "whole" and run.summary["stable"]
    assert NOT_TAKEN + "it needs a device in space" in (tmp_path / "run.log").read_text()


@pytest.mark.parametrize("name", ["whole", "single", "split", "precise"])
def test_what_is_named_is_kept(name):
    assert chosen(film(), options=dea.NewtonOptions(factor=name)) == choosing.Choice()


def test_a_resumed_run_keeps_what_it_has_chosen(tmp_path):
    """Whatever is free then; but what is named is taken, and what was named is no choice."""
    first = solved(film(), out=tmp_path)
    with free(0.5, first.problem):
        again = solved(film(), out=tmp_path, resume=True)
        assert again.summary["preconditioner"] == "whole"
        assert solved(film(), out=tmp_path).summary["preconditioner"] == "multigrid"
    again = solved(film(), out=tmp_path, resume=True)
    assert again.summary["preconditioner"] == "multigrid"
    log = (tmp_path / "run.log").read_text()
    assert "Multigrid is taken, as in the run that is resumed." in log
    assert "resumed after step 2" in log
    named = dea.NewtonOptions(factor="whole")
    again = solved(film(), out=tmp_path, resume=True, options=named)
    assert again.summary["preconditioner"] == "whole"
    with free(0.5, first.problem):
        again = solved(film(), out=tmp_path, resume=True)
    assert again.summary["preconditioner"] == "multigrid"


def test_the_next_run_of_a_scene_chooses_anew():
    """Small problems are used again, but not with the levels of multigrid."""
    scene = film()
    with free(0.5, Problem(scene)):
        assert solved(scene).summary["preconditioner"] == "multigrid"
        every = solved(scene, stability="every")
    assert every.summary["preconditioner"] == "whole" and every.summary["stable"]
    assert solved(scene).summary["preconditioner"] == "whole"


def test_an_error_says_that_multigrid_was_chosen(monkeypatch):
    """GMRES, which does not converge, is no fault of the user then."""
    problem = Problem(film())
    monkeypatch.setattr(linear, "MOST_UNKNOWNS_RESCUED", 0)
    monkeypatch.setattr(linear.LinearSolver, "_krylov", lambda *_, **__: (None, 1))
    with free(0.5, problem), pytest.raises(dea.SolverError, match="chosen for want of memory"):
        solved(film())
    named = dea.NewtonOptions(factor="multigrid")
    with pytest.raises(dea.SolverError) as told:
        solved(film(), options=named)
    assert "chosen" not in str(told.value)


SCRIPT = """
import dea_fenicsx as dea
from test_choosing import film
dea.solve(film(), dea.Ramp(steps=4), stability={!r})
"""


def test_a_plan_says_it(tmp_path, monkeypatch, capsys):
    for name, stability in (("last", "last"), ("every", "every")):
        (tmp_path / f"{name}.py").write_text(SCRIPT.format(stability))
    with free(0.9, Problem(film())):
        assert main(["plan", str(tmp_path / "last.py")]) == 0
        told = capsys.readouterr().out
        assert "preconditioner: multigrid" in told and TAKEN in told
        assert "not counted with multigrid" in told
        assert main(["plan", str(tmp_path / "every.py")]) == 0
        told = capsys.readouterr().out
        assert "preconditioner: whole" in told and NOT_TAKEN in told
    assert main(["plan", str(tmp_path / "last.py")]) == 0
    assert "note" not in capsys.readouterr().out


def decided(comm):
    """Called on all ranks: size of the factor, and the choices where little or much is free."""
    scene = film(comm)
    problem = Problem(scene)
    size = costs.size_kept(problem, "split")
    found = {"entries": size.entries, "operations": size.operations, "unknowns": size.unknowns}
    few = Problem(film(comm, cells=(1, 1)))  # two cells, so that a third rank has none
    found["few"] = costs.size_kept(few, "whole").entries
    needed = direct_bytes(problem)  # of all ranks
    for name, share in (("little", 0.5), ("much", 2.0)):
        # rank 0 finds that nothing is free, but all ranks of a node have what the least has
        with pytest.MonkeyPatch.context() as patch:
            mine = share * needed * (1 + comm.rank)
            patch.setattr(choosing, "free_bytes", lambda mine=mine: mine)
            patch.setattr(choosing, "BYTES_NOT_ASKED_FOR", 0.0)
            run = solved(scene)
        seen = comm.allgather(run.summary["preconditioner"])
        assert len(set(seen)) == 1
        found[name] = [seen[0], float(run["up_m"])]
    return found


@pytest.mark.mpi
@pytest.mark.slow
@pytest.mark.parametrize("ranks", [2, 3])
def test_all_ranks_choose_alike(on_ranks, ranks):
    alone, found = decided(MPI.COMM_SELF), on_ranks("test_choosing", "decided", ranks)
    for name in ("entries", "operations", "unknowns", "few"):
        assert found[name] == pytest.approx(alone[name], rel=1e-12)
    for name, kind in (("little", "multigrid"), ("much", "whole")):
        assert found[name][0] == alone[name][0] == kind
        assert found[name][1] == pytest.approx(alone[name][1], rel=1e-8)


def machine(root, available, groups, of_group):
    """A folder that looks as the kernel's files do; sizes in bytes."""
    for name, text in {"proc/meminfo": f"MemTotal: 9 kB\nMemAvailable: {available // 1024} kB\n",
                       "proc/self/cgroup": groups, **of_group}.items():  # fmt: skip
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    return free_bytes(root)


def test_free_memory(tmp_path):
    """The machine's own, or what the tightest control group leaves, without what files hold."""
    assert free_bytes(tmp_path) is None
    kib = 1024
    assert machine(tmp_path / "a", 80 * kib, "0::/\n", {}) == 80 * kib
    job = "sys/fs/cgroup/job"
    limits = {f"{job}/step/memory.max": "max\n", f"{job}/step/memory.current": "5\n",
              f"{job}/memory.max": "60000\n", f"{job}/memory.current": "50000\n",
              f"{job}/memory.stat": "file 30000\ninactive_file 20000\n"}  # fmt: skip
    assert machine(tmp_path / "b", 80 * kib, "0::/job/step\n", limits) == 30000
    first = "sys/fs/cgroup/memory/job"
    limits = {f"{first}/memory.limit_in_bytes": "7000\n", f"{first}/memory.usage_in_bytes": "8000",
              "sys/fs/cgroup/memory/memory.limit_in_bytes": f"{2**63 - 4096}\n",
              "sys/fs/cgroup/memory/memory.usage_in_bytes": "8000\n"}  # fmt: skip
    groups = "3:cpu:/\n4:memory:/job\n0::/\n"
    assert machine(tmp_path / "c", 80 * kib, groups, limits) == 0
    assert 0 < free_bytes() < 1e15


@on_demand
def test_the_bound_of_the_entries():
    """A cube has more entries than any other body, and fewer than the bound."""
    for n in (2, 4, 8):
        cube = dea.read_gmsh(BoxStack(1e-2, 1e-2, [Layer("film", 1e-2, n)], n), MPI.COMM_SELF)
        problem = Problem(dea.Scene(cube, {"film": FILM}, VOLTS, [dea.Clamp("bottom")]))
        bound = choosing.MOST_ENTRIES * problem.unknowns ** (4 / 3)
        assert costs.size_kept(problem, "whole").entries < 0.5 * bound
