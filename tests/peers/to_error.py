"""What an error of 0.1 % and of 0.01 % costs here and in NGSolve, each by its own best choice.

    python -m tests.peers.to_error [--full] [--scenes NAME ...] [--limit SECONDS] [--out CSV]

Both codes choose the degree of their elements, the mesh and the number of steps.  All of setting up
is counted: meshing, spaces, forms.  Code that was compiled before is there, and modules are loaded;
the table also tells what a process takes from its start to its end.  NGSolve takes orders 2 to 5,
eliminates the unknowns inside of cells, and stops iterating early (`ngsolve_best`).  The errors are
those of a displacement against converged values, which `error_scenes` keeps.

By default only the choices are run that were among the fastest (`QUICK`).  With ``--full`` all
degrees, meshes and steps are tried.  A time is the least of several in one process, on one core.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from tests.peers.apart import MARK, write
from tests.peers.error_scenes import QUICK, SCENES, Choice, unrolled_for
from tests.peers.scenes import Case

ASKED = (1e-3, 1e-4)

STEPS = (1, 2, 4, 8)

CODES = ("ours", "ngsolve")

LONGEST_REPEATED_S = 1.0
"""Seconds for which a run is repeated, to take the shortest one; at most seven times."""

COLUMNS = [
    "scene", "code", "degree", "mesh", "steps", "unknowns", "newton", "value", "wall_s", "error",
]  # fmt: skip


# ------------------------------------------------------------------------- in the child


def solver(scene: str, code: str) -> Callable[[Case, int], dict[str, Any]]:
    """A function that solves a case with elements of a degree."""
    if code == "ours":
        import dea_fenicsx as dea
        from tests.peers import ours

        # as NGSolve's, the last iteration leaves an error far below the one asked
        loose = dea.NewtonOptions(tolerance=1e-7)
        return lambda case, degree: ours.solve(case, True, loose, degree)
    from tests.peers import ngsolve_best

    curved = unrolled_for(scene)
    return lambda case, degree: ngsolve_best.solve(case, degree, curved)


def timed(solve: Callable[[Case, int], dict[str, Any]], scene: str, choice: Choice) -> dict:
    """What a choice finds, and the shortest time that it takes."""
    build = SCENES[scene].build
    least, spent, times = float("inf"), 0.0, 0
    while not times or (spent < LONGEST_REPEATED_S and times < 7):
        start = time.perf_counter()
        found = solve(build(choice.mesh, choice.steps), choice.degree)
        taken = time.perf_counter() - start
        least, spent, times = min(least, taken), spent + taken, times + 1
    error = abs(found["value"] / SCENES[scene].value - 1)
    return {
        "choice": choice.told(), "wall_s": least, "error": error,
        **{name: found[name] for name in ("value", "unknowns", "newton")},
    }  # fmt: skip


def each(solve: Any, scene: str, choices: Sequence[Choice]) -> Iterator[dict[str, Any]]:
    """All choices that converge; a code may not do so in few steps."""
    for choice in choices:
        try:
            yield timed(solve, scene, choice)
        except Exception as error:
            print(f"{scene}, {choice.told()}: {type(error).__name__}, {error}", file=sys.stderr)


def walked(solve: Any, scene: str, degree: int, limit: float) -> Iterator[dict[str, Any]]:
    """All meshes of a degree, coarse to fine, each with the steps that are fastest on the first."""
    first, *others = SCENES[scene].meshes[degree]
    tried = list(each(solve, scene, [Choice(degree, first, steps) for steps in STEPS]))
    yield from tried
    quickest = sorted(tried, key=lambda row: row["wall_s"])[:2]
    close = [row for row in quickest if row["wall_s"] < 1.1 * quickest[0]["wall_s"]]
    for mesh in others:
        steps = [Choice.read(one["choice"]).steps for one in close]
        rows = list(each(solve, scene, [Choice(degree, mesh, k) for k in steps]))
        yield from rows
        if any(row["error"] < ASKED[-1] / 3 or row["wall_s"] > limit for row in rows):
            return


def child(scene: str, code: str, what: str, limit: float) -> None:
    """Solve cases, and print a line for each; `what` is a degree, choices, or one that is alone."""
    solve = solver(scene, code)
    build = SCENES[scene].build
    alone = what.startswith("alone:")
    choices = [Choice.read(text) for text in what.removeprefix("alone:").split()]
    if alone:
        solve(build(choices[0].mesh, choices[0].steps), choices[0].degree)
        return
    single = len(choices) == 1 and choices[0].steps == 0
    for degree in {choice.degree for choice in choices}:
        mesh = SCENES[scene].meshes[degree][0]
        solve(build(mesh, 1).small(), degree)  # compiles, which is not counted
    rows = (
        walked(solve, scene, choices[0].degree, limit) if single
        else each(solve, scene, choices)
    )  # fmt: skip
    for row in rows:
        print(MARK + json.dumps(row), flush=True)


# ------------------------------------------------------------------------- in the parent


def run(scene: str, code: str, what: str, limit: float) -> tuple[list[dict[str, Any]], float]:
    """The rows of a child, and the seconds that it took from its start to its end."""
    command = [sys.executable, "-m", "tests.peers.to_error", "--child", scene, code, what]
    # NGSolve starts threads of its own, which wait for work by spinning
    alone = os.environ | {"NGS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    start = time.perf_counter()
    done = subprocess.run(
        [*command, "--limit", str(limit)], capture_output=True, text=True, env=alone
    )
    taken = time.perf_counter() - start
    if done.returncode or done.stderr:
        print(f"{scene}, {code}, {what}:\n{done.stderr[-1500:]}", file=sys.stderr)
    told = [x.removeprefix(MARK) for x in done.stdout.splitlines() if x.startswith(MARK)]
    return [json.loads(line) for line in told], taken


def of_scene(scene: str, full: bool, limit: float) -> list[dict[str, Any]]:
    """Run the choices of a scene, and print what the errors asked cost."""
    rows: list[dict[str, Any]] = []
    for code in CODES:
        whats = [" ".join(choice.told() for choice in QUICK[scene][code])]
        if full:
            degrees = [d for d in SCENES[scene].meshes if code == "ngsolve" or d < 5]
            whats = [Choice(degree, (0,), 0).told() for degree in degrees]
        for what in whats:
            for row in run(scene, code, what, limit)[0]:
                choice = Choice.read(row.pop("choice"))
                row |= {"scene": scene, "code": code, "degree": choice.degree,
                        "mesh": "x".join(map(str, choice.mesh)), "steps": choice.steps}  # fmt: skip
                rows.append(row | {"told": choice.told()})
                print(f"{scene:8} {code:8} {choice.told():12} {row['unknowns']:7d} unknowns "
                      f"{row['value']:.9e} m, error {row['error']:.1e} {row['newton']:3d} "
                      f"iterations {row['wall_s']:8.4f} s", flush=True)  # fmt: skip
    for asked in ASKED:
        compare(scene, asked, rows, limit)
    return rows


def compare(scene: str, asked: float, rows: list[dict[str, Any]], limit: float) -> None:
    """Print what an error costs in both codes, each by its best choice."""
    told, best, whole = [], {}, {}
    for code in CODES:
        good = [row for row in rows if row["code"] == code and row["error"] < asked]
        if not good:
            print(f"{scene}: {code} does not come to {asked:.2%}")
            return
        best[code] = min(good, key=lambda row: row["wall_s"])
        choice = best[code]["told"]
        whole[code] = min(run(scene, code, f"alone:{choice}", limit)[1] for _ in range(2))
        told.append(
            f"{code} {best[code]['wall_s']:.4f} s ({choice}; process {whole[code]:.2f} s)"
        )
    ratio = best["ngsolve"]["wall_s"] / best["ours"]["wall_s"]
    print(f"{scene}: to {asked:.2%}: {', '.join(told)}: ratio {ratio:.2f}, of processes "
          f"{whole['ngsolve'] / whole['ours']:.2f}", flush=True)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", nargs="*", default=list(SCENES), choices=list(SCENES))
    parser.add_argument("--full", action="store_true", help="try all choices, half an hour")
    parser.add_argument("--limit", type=float, default=20.0, help="longest run of a choice in s")
    parser.add_argument("--out", default="to_error.csv")
    parser.add_argument("--child", nargs=3, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.child:
        child(*args.child, args.limit)
        return
    rows = [row for scene in args.scenes for row in of_scene(scene, args.full, args.limit)]
    write(args.out, COLUMNS, [{name: row[name] for name in COLUMNS} for row in rows])


if __name__ == "__main__":
    main()
