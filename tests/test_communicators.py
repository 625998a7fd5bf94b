"""Scenes that are solved one after another leave no MPI communicators, and no memory, behind."""

from __future__ import annotations

import gc
from typing import Any

import pytest
import rank_scenes
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.run import reuse

MOST_HELD = 40
"""What one problem holds, 33 at most; on a busy machine MPICH may give it back a moment later.

If each of the scenes kept what it holds, some 200 would be missing."""

MOST_COUNTED = 3000
"""More than the 2048 communicators of MPICH."""

counts = pytest.mark.skipif(
    MPI.get_vendor()[0] not in ("MPICH", "Intel MPI"),
    reason="only MPICH has so few communicators that those in use can be counted",
)


def free_communicators() -> int:
    """How many communicators this rank could make."""
    made = []
    try:
        while len(made) < MOST_COUNTED:
            made.append(MPI.COMM_SELF.Dup())
    except MPI.Exception:
        pass  # there is no other one
    for comm in made:
        comm.Free()
    return len(made)


def film(comm, **changes):
    """A film in plane strain, at a voltage far beyond its limit point."""
    given = {
        "electrodes": [dea.Electrode("top", 60e3), dea.Ground("bottom")],
        "supports": [dea.Fix("x_min", "x"), dea.Fix("bottom", "y")],
        "kinematics": dea.PlaneStrain(1e-3),
    }
    return dea.Scene(rank_scenes.strip(comm), {"film": rank_scenes.FILM}, **(given | changes))


def lost(comm):
    return film(comm), dea.Ramp(steps=2), {}, {}


def refused(comm):
    """An electrode that floats in the plane is refused after its device has been made."""
    return film(comm, supports=[dea.Fix("bottom", "y")]), dea.Ramp(steps=2), {}, {}


class Faulty:
    """A user's observable with a mistake in it."""

    unit = ""

    def bind(self, problem):
        def measure():
            raise ZeroDivisionError("a mistake of the script's")

        return measure


def faulty(comm):
    return film(comm), dea.Ramp(steps=2), {"mine": Faulty()}, {}


FEW = [rank_scenes.charge, refused, faulty]
"""Three ranks take long where there are two processors."""

SCENES = [
    *FEW, rank_scenes.hexahedron, rank_scenes.split_factor, rank_scenes.slice_free,
    rank_scenes.helix, rank_scenes.traced, lost,
]  # fmt: skip


def solved(make, comm) -> str:
    """How a scene ends; nothing of it is left when this returns, if nothing keeps it."""
    try:
        scene, path, record, options = make(comm)
        return dea.solve(scene, path, record, quiet=True, **options).summary["status"]
    except (dea.DeaError, ZeroDivisionError) as error:
        return type(error).__name__


def after_rounds(comm) -> dict[str, Any]:
    """Communicators that are free on each rank after each of two rounds over all scenes.

    Python does not look for cycles of references meanwhile: it does so on each rank at a time of
    its own, and so late that all communicators may be used up before.
    """
    free: list[list[int]] = []
    gc.disable()
    try:
        for _ in range(2):
            scenes = SCENES if comm.size < 3 else FEW
            ends = {make.__name__: solved(make, comm) for make in scenes}
            reuse.clear()
            free.append(comm.allgather(free_communicators()))
    finally:
        gc.enable()
    return {"ends": ends, "free": free}


@counts
@pytest.mark.slow
@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [1, 2, 3])
def test_scenes_that_are_gone_hold_no_communicators(on_ranks, ranks):
    """On two ranks each solve once kept some 20 for good, and its problem with them.

    What the last scene has left may wait for the next one, so the first round is not compared.
    """
    found = on_ranks("test_communicators", "after_rounds", ranks)
    ends = found["ends"]
    assert ends.pop("refused") == "InputError"
    assert ends.pop("lost", "EquilibriumLost") == "EquilibriumLost"
    assert ends.pop("faulty") not in ("completed", "InputError")
    assert set(ends.values()) == {"completed"}
    first, second = found["free"]
    assert all(a - b <= MOST_HELD for a, b in zip(first, second, strict=True)), found["free"]
    assert min(first) > 2000  # of 2048


def kept_by_one(comm) -> list[list[int]]:
    """Free communicators while rank 0 alone still has its runs, and when they are gone."""

    def solve():
        scene, path, record, options = rank_scenes.triangles(comm)
        return dea.solve(scene, path, record, quiet=True, **options)

    def free() -> list[int]:
        solve()  # what is gone on all ranks is destroyed when new objects are made
        reuse.clear()
        return comm.allgather(free_communicators())

    before = free()
    runs = [solve() for _ in range(3)]
    if comm.rank > 0:
        runs.clear()
    during = free()
    runs.clear()
    return [before, during, free()]


@counts
@pytest.mark.mpi
def test_ranks_may_let_go_of_a_run_at_different_times(on_ranks):
    """To destroy what the ranks share is collective: it has to wait for the last of them."""
    before, during, after = on_ranks("test_communicators", "kept_by_one", 2)
    assert during[0] < before[0] - 2 * MOST_HELD
    assert all(b - a <= MOST_HELD for a, b in zip(after, before, strict=True))


def one_rank_ahead(comm) -> dict[str, Any]:
    """Solve two scenes of one device again, after rank 0 has solved another one alone."""
    if comm.rank == 0:
        solved(rank_scenes.triangles, MPI.COMM_SELF)
    shared, alone = rank_scenes.strip(comm), rank_scenes.strip(MPI.COMM_SELF)

    def solve(mu, device=shared):
        scene = dea.Scene(
            device, {"film": dea.Material(dea.NeoHookean(mu))}, supports=[dea.Clamp("bottom")],
            loads=[dea.DeadLoad("top", (0.0, 2e3))], kinematics=dea.PlaneStrain(1e-3),
        )  # fmt: skip
        return dea.solve(scene, dea.Ramp(steps=1), {"up": dea.MeanDisplacement("top", "y")},
                         quiet=True)  # fmt: skip

    problems = []
    build = Problem.__init__

    def noted(self, scene, *options):
        problems.append(1)
        build(self, scene, *options)

    Problem.__init__ = noted
    runs = [solve(5e4), solve(6e4)]
    runs.clear()
    found = [solve(mu)["up_m"] for mu in (7e4, 8e4)]
    Problem.__init__ = build
    reuse.clear()
    right = [solve(mu, alone)["up_m"] for mu in (7e4, 8e4)]
    return {"found": found, "right": right, "problems": comm.allgather(len(problems))}


@pytest.mark.mpi
def test_ranks_use_the_same_kept_problem_again(on_ranks):
    """A rank that has solved more scenes than the others takes the same problem as they."""
    found = on_ranks("test_communicators", "one_rank_ahead", 2)
    assert found["problems"] == [2, 2]  # the third and fourth scene need no new one
    assert found["found"] == pytest.approx(found["right"], rel=1e-8)
