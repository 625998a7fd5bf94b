"""What one rank meets alone: each case is run under mpirun, and every rank tells how it ended."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import dea_fenicsx as dea
from dea_fenicsx.support import errors

from rank_scenes import FILM, L, strip  # isort: skip

errors.GRACE_S = 0.5


class Mine:
    """A user's observable."""

    unit = ""

    def __init__(self, measure):
        self.bind = lambda problem: measure


class Odd:
    """A geometry that fails where it is built."""

    def build(self):
        raise RuntimeError("no such shape")


class Limit(dea.StretchLimit):
    """A user's failure whose formula fails, on the ranks that have cells."""

    def values(self, problem, region, local):
        raise KeyError("no such region")


def scene(comm, volts=5e3, loads=(), turn=1):
    electrodes = [dea.Electrode("top", volts), dea.Ground("bottom")][::turn]
    return dea.Scene(strip(comm), {"film": FILM}, electrodes, [dea.Clamp("bottom")], loads=loads,
                     kinematics=dea.PlaneStrain(L))  # fmt: skip


def solve(comm, record, **options):
    return dea.solve(
        scene(comm), dea.Ramp(steps=1), record, quiet=True, stability="never", **options
    )


def on_rank_1(comm, there, elsewhere=1.0):
    """Measure one thing on rank 1 and another elsewhere; an exception is raised."""

    def measure():
        found = there if comm.rank == 1 else elsewhere
        if isinstance(found, Exception):
            raise found
        return found

    return lambda folder: solve(comm, {"mine": Mine(measure)}, out=folder)


def in_any_order(comm):
    """Nine ramps of loads: names in a set have another order on each rank."""
    loads = [dea.DeadLoad("top", (0.0, 200.0 * k), ramp=f"load{k}") for k in range(9)]
    run = dea.solve(scene(comm, loads=loads), dea.Ramp(steps=1), quiet=True, stability="never",
                    record={"u": dea.MeanDisplacement("top", "y")})  # fmt: skip
    return run["u_m"] > 0


def cases(comm):
    rank = comm.rank
    turn = 1 - 2 * rank
    charges = {name: dea.Charge(name) for name in ("top", "bottom")[::turn]}
    return {
        "nan on rank 1": on_rank_1(comm, float("nan")),
        "inf on rank 0": on_rank_1(comm, 1.0, float("inf")),
        "nan on both": on_rank_1(comm, float("nan"), float("nan")),
        "nothing": on_rank_1(comm, None),
        "a part of each": on_rank_1(comm, 2.0),
        "rounding": on_rank_1(comm, 1 + 1e-12),
        "bad input": on_rank_1(comm, dea.InputError("Not here.")),
        "a solver's error": on_rank_1(comm, dea.SolverError("Not here.")),
        "a slip": on_rank_1(comm, KeyError("x")),
        "a slip on both": on_rank_1(comm, KeyError("x"), KeyError("x")),
        "other volts": lambda folder: scene(comm, 5e3 + rank),
        "another order": lambda folder: scene(comm, turn=turn),
        "results on one": lambda folder: solve(comm, None, out=folder if rank == 0 else None),
        "another record": lambda folder: solve(comm, charges),
        "other steps": lambda folder: dea.solve(
            scene(comm), dea.Ramp(steps=1 + rank), quiet=True),
        "a geometry": lambda folder: dea.read_gmsh(Odd(), comm),
        "a failure": lambda folder: solve(comm, None, failures=[Limit(2.0)]),
        "ramps": lambda folder: in_any_order(comm),
    }  # fmt: skip


def differences(comm) -> dict[str, Any]:
    """For each case what every rank has met: the type of an error and its message, or a value."""
    folder = Path(comm.bcast(tempfile.mkdtemp() if comm.rank == 0 else None, root=0))
    found: dict[str, Any] = {}
    for name, case in cases(comm).items():
        out = folder / name.replace(" ", "_")
        try:
            result = case(out)
            mine = result["mine"] if hasattr(result, "history") else bool(result)
        except Exception as error:
            mine = [type(error).__name__, str(error)]
        found[name] = comm.gather(mine)
        if comm.rank == 0 and (out / "summary.json").exists():
            found[name].append(dea.read_summary(out)["status"])
    return found
