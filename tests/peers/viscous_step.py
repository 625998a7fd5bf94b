"""Time one viscous step with three branches beside one elastic step, on a block in space.

    python -m tests.peers.viscous_step [--cells N] [--steps N] [--repeat N]

Both films take the same voltages in equal steps: in the viscous one a step is one of BDF2 in time,
in the elastic one it is a step of a ramp.  The first steps are left out, since a march begins with
steps that solve twice.  Each film is solved `repeat` times, in turn, and the least CPU times count.
18 cells along the block give 50 731 unknowns.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from tests.peers.time_scenes import BRANCHES, TimeCase, blister, block

LEFT_OUT = 4
"""First steps that do not count."""

WORK = {
    "assembly": (("model/problem.py", "residual"), ("solvers/linear.py", "_assemble")),
    "factors": (("solvers/factors.py", "make"),),
    "products": (("solvers/tangent.py", "_along_times"),),
    "solves": (("solvers/linear.py", "apply"),),
    "update": (("path/time_stepping.py", "settled"), ("path/time_stepping.py", "error"),
               ("path/time_stepping.py", "ahead")),
}  # fmt: skip
"""Functions that do the work: residuals and matrices, factors of these, products with the tangent,
solves with the factors, and the viscous strains."""


@dataclass(frozen=True)
class Clock:
    """CPU time of the process in s: an observable that is read at each accepted step."""

    unit = "s"

    def bind(self, problem: Any) -> Callable[[], float]:
        return time.process_time


def solve(case: TimeCase, viscous: bool) -> dict[str, Any]:
    """March over the case's steps; returns what one step has taken."""
    film = blister.VHB if viscous else replace(blister.VHB, viscous=())
    scene = dea.Scene(
        dea.device(case.geometry, MPI.COMM_WORLD), {"film": film},
        electrodes=[dea.Electrode(case.driven, case.unit), dea.Ground("bottom")],
        supports=[dea.Clamp(name) for name in case.clamped],
    )  # fmt: skip
    seconds = case.field / case.rate
    wave = dea.Rise(case.field, seconds)
    path = [dea.March(seconds, {"voltage": wave}, steps=case.steps)]
    profile = cProfile.Profile(time.process_time)
    with profile:
        run = dea.solve(scene, path, {"cpu": Clock()}, quiet=True, stability="never")
    cpu = np.diff(run.column("cpu_s"))
    newton = run.column("newton_iterations")[1:]
    keep = slice(LEFT_OUT, None)
    return {
        "unknowns": run.summary["unknowns"],
        "steps": len(cpu[keep]), "cpu_s": float(cpu[keep].sum()),
        "newton": float(newton[keep].sum()), "work": work_of(profile),
    }  # fmt: skip


def work_of(profile: cProfile.Profile) -> dict[str, float]:
    """CPU time in s of each kind of work over a whole run, and of the march."""
    spent = {
        (file, name): row[3]
        for (file, _, name), row in pstats.Stats(profile).stats.items()  # type: ignore[attr-defined]
    }

    def of(place: tuple[str, str]) -> float:
        return sum(
            s for (file, name), s in spent.items()
            if file.endswith(place[0]) and name == place[1]
        )  # fmt: skip

    found = {kind: sum(map(of, places)) for kind, places in WORK.items()}
    return found | {"march": of(("run/session.py", "_follow"))}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--cells", type=int, default=18)
    parser.add_argument("--steps", type=int, default=20)
    parser.add_argument("--repeat", type=int, default=2)
    args = parser.parse_args()
    case = block(args.cells, 4)
    case = replace(case, field=case.field * args.steps / case.steps, steps=args.steps)
    for viscous in (False, True):
        solve(replace(block(2, 1), steps=LEFT_OUT + 2), viscous)  # compiles
    best: dict[bool, dict[str, Any]] = {}
    for _ in range(args.repeat):
        for viscous in (False, True):
            found = solve(case, viscous)
            if viscous not in best or found["cpu_s"] < best[viscous]["cpu_s"]:
                best[viscous] = found
    for viscous, name in ((False, "elastic"), (True, f"{len(BRANCHES)} branches")):
        print(line_of(name, best[viscous]), flush=True)
    one, other = best[True], best[False]
    steps = (one["cpu_s"] / one["steps"]) / (other["cpu_s"] / other["steps"])
    newton = (one["cpu_s"] / one["newton"]) / (other["cpu_s"] / other["newton"])
    print(f"a viscous step over an elastic one: {steps:.2f}; for each Newton iteration: "
          f"{newton:.2f}")  # fmt: skip


def line_of(name: str, found: dict[str, Any]) -> str:
    """What is printed of a film: its steps, and the profile of its whole run."""
    work = "  ".join(f"{name} {s:.2f} s" for name, s in found["work"].items())
    return (
        f"{name:10} {found['unknowns']} unknowns  {found['cpu_s'] / found['steps']:.3f} s of CPU "
        f"for a step, {found['newton'] / found['steps']:.2f} Newton iterations;  whole run: {work}"
    )


if __name__ == "__main__":
    main()
