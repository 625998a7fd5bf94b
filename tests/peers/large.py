"""How cost grows with the mesh up to some million unknowns, with multigrid or with a factor.

    python -m tests.peers.large [--scenes NAME ...] [--ranks N] [--factor NAME]
        [--sizes SIZE ...] [--least UNKNOWNS] [--most UNKNOWNS] [--limit SECONDS] [--out CSV]

Each run is in a process of its own and appends one line to the CSV file: scene, unknowns, ranks,
factor, seconds, peak memory of all ranks together, Newton and Krylov iterations.  A scene ends with
the first run that takes longer than the limit.  The exponents are those of the best fit over all
meshes of block and stack.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace

import numpy as np

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from tests.peers.apart import append, ask, tell
from tests.peers.growth import stack, thin
from tests.peers.scenes import SILICONE, Case, Rubber

COLUMNS = ["scene", "size", "unknowns", "ranks", "factor", "wall_s", "cpu_s", "memory_GB",
           "newton", "krylov", "factorisations", "value"]  # fmt: skip


def block(n: float) -> Case:
    """A cube of 10 mm with n cells along each edge, on a rigid floor, under a voltage."""
    cube = BoxStack(10e-3, 10e-3, [Layer("film", 10e-3, round(n))], (round(n), round(n)), order=1)
    return Case(cube, {"film": SILICONE}, {"top": 40e3, "bottom": 0.0}, "bottom", "top", 2, 2)


def short(n: float) -> Case:
    """The stack of `growth` in two steps."""
    return replace(stack(n), steps=2)


def stiff(n: float) -> Case:
    """The same with a passive block 10 000 times as stiff as the active one."""
    case = short(n)
    return replace(case, materials=case.materials | {"passive": Rubber(1e4 * SILICONE.mu)})


def thinner(ratio: float) -> Case:
    """The strip of `growth` with layers `ratio` times thinner than wide, in two steps."""
    return replace(thin(ratio), steps=2)


SCENES: dict[str, tuple[Callable[[float], Case], tuple[float, ...]]] = {
    "block": (block, (9, 14, 24, 30, 38, 48)),
    "stack": (short, (2.5, 3.6, 6.2, 7.8, 9.8, 12.3)),
    "stiff": (stiff, (1, 2, 3, 3.6)),
    "thin": (thinner, (10, 30, 100)),
}
"""Builder of a scene's cases and its sizes; those of block and stack give 0.03 to 4 million."""

PER_SIZE = {"block": 36, "stack": 2100}
"""About how many unknowns there are for each cube of the size."""


def child(name: str, size: float, factor: str) -> None:
    """Solve one case and print what it took."""
    from mpi4py import MPI

    from tests.peers import ours

    options = dea.NewtonOptions(factor=factor)  # type: ignore[arg-type]

    def solve(case: Case) -> dict:
        return ours.solve(case, own_elements=True, options=options)

    tell(solve, SCENES[name][0](size), MPI.SUM)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", nargs="*", default=["block", "stack"], choices=list(SCENES))
    parser.add_argument("--ranks", type=int, default=2)
    parser.add_argument("--factor", default="multigrid")
    parser.add_argument("--sizes", nargs="*", type=float, help="in place of the scene's own")
    parser.add_argument("--least", type=float, default=9e4, help="unknowns of the smallest run")
    parser.add_argument("--most", type=float, default=4.2e6, help="unknowns of the largest run")
    parser.add_argument("--limit", type=float, help="most seconds of one run")
    parser.add_argument("--out", default="large.csv")
    parser.add_argument("--child", nargs=3, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.child:
        child(args.child[0], float(args.child[1]), args.child[2])
        return
    for name in args.scenes:
        rows = run_scene(name, args)
        if len(rows) > 1 and rows[-1]["unknowns"] > rows[0]["unknowns"]:
            n = np.log([row["unknowns"] for row in rows])
            time, memory = (np.polyfit(n, np.log([row[key] for row in rows]), 1)[0]
                            for key in ("wall_s", "memory_GB"))  # fmt: skip
            print(f"{name}: wall ~ unknowns^{time:.2f}, memory ~ unknowns^{memory:.2f}")


def run_scene(name: str, args: argparse.Namespace) -> list[dict]:
    """Run a scene on all meshes that are asked for; returns a row for each."""
    rows: list[dict] = []
    for size in args.sizes or SCENES[name][1]:
        chosen = args.sizes or name not in PER_SIZE
        if not chosen and not args.least <= PER_SIZE[name] * size**3 <= args.most:
            continue
        found = ask(
            "tests.peers.large", name, size, args.factor, limit=args.limit, ranks=args.ranks
        )
        if found is None:
            print(f"{name} {size:g}: stopped after {args.limit:g} s")
            break
        found |= {"scene": name, "size": size, "ranks": args.ranks, "factor": args.factor}
        rows.append({key: found[key] for key in COLUMNS})
        append(args.out, COLUMNS, rows[-1])
        print(f"{name:6} {size:5g} {found['unknowns']:8d} unknowns  Newton {found['newton']:2d}  "
              f"Krylov {found['krylov']:3d}  set up {found['factorisations']} times  "
              f"{found['wall_s']:7.1f} s  CPU {found['cpu_s']:7.1f} s  "
              f"{found['memory_GB']:6.2f} GB  {found['value']:.10e} m", flush=True)  # fmt: skip
    return rows



if __name__ == "__main__":
    main()
