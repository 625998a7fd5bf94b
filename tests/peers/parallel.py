"""What a second rank gains, part by part, beside what a second core gains in memory bandwidth.

    python -m tests.peers.parallel [--scenes NAME ...] [--size SIZE] [--ranks N] [--out CSV]

The bandwidth is that of the triad a = b + s c [McCalpin 1995, IEEE TCCA Newsletter], by one process
and by several at once.  Each run of a scene is in processes of its own, writes results, and appends
a line to the CSV file.  Factorisations compute, and can gain more than the bandwidth; products,
assembled matrices and Krylov iterations read memory.  Run it on an idle machine.
"""

from __future__ import annotations

import argparse
import multiprocessing
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import dea_fenicsx as dea
from dea_fenicsx.geometry import HDEA
from tests.peers.apart import append, ask, tell
from tests.peers.large import block
from tests.peers.scenes import Case

PARTS = ["mesh_s", "set_up_s", "assembly_s", "factor_s", "krylov_s", "output_s", "rest_s"]
COLUMNS = ["scene", "size", "ranks", "unknowns", "wall_s", "cpu_s", *PARTS, "memory_GB", "newton",
           "krylov", "factorisations", "value"]  # fmt: skip

ROWS = 10_000_000
"""Numbers of each array of the triad: 80 MB, far more than a cache holds."""


def helix(turns: float) -> Case:
    """The helix of `demos/hdea_ten_layer.py` on its finest mesh, which is free."""
    geometry = HDEA(turns=round(turns), angular=16, radial=8, rim=2, through=2)
    return Case(geometry, {}, {}, "", "top", 2, 2)


SCENES: dict[str, tuple[Callable[[float], Case], float, str]] = {
    "block": (block, 22, "multigrid"),
    "helix": (helix, 10, "auto"),
}
"""Builder of a scene's case, the size that gives 400 000 unknowns, and the factor."""


def triad(turn: Any, seconds: float = 2.0) -> float:
    """Passes of the triad per second, counted while all processes are at work."""
    b, c = np.ones(ROWS), np.ones(ROWS)
    a = np.full(ROWS, 1.0)  # its pages are there before the clock runs
    turn.wait()
    passes, end = 0, time.perf_counter() + seconds
    while time.perf_counter() < end:
        np.multiply(c, 3.0, out=a)
        np.add(a, b, out=a)
        passes += 1
    return passes / seconds


def _worker(turn: Any, found: Any) -> None:
    found.put(triad(turn))


def bandwidth(processes: int) -> float:
    """Passes of the triad per second of several processes together."""
    context = multiprocessing.get_context("spawn")
    turn, found = context.Barrier(processes), context.Queue()
    workers = [context.Process(target=_worker, args=(turn, found)) for _ in range(processes)]
    for worker in workers:
        worker.start()
    total = sum(found.get() for _ in workers)
    for worker in workers:
        worker.join()
    return total


def child(name: str, size: float) -> None:
    """Solve one case with results on disk, and print what each part took on the slowest rank."""
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    factor = SCENES[name][2]

    def solve(case: Case) -> dict[str, Any]:
        with tempfile.TemporaryDirectory() as folder:
            out = comm.bcast(folder, root=0)
            found = _solved(name, case, factor, Path(out) / "run")
            comm.barrier()
        most = {key: comm.allreduce(found[key], op=MPI.MAX) for key in PARTS[:-1]}
        return found | most

    tell(solve, SCENES[name][0](size), MPI.SUM)


def _solved(name: str, case: Case, factor: str, out: Path) -> dict[str, Any]:
    """One run, with the seconds of its parts on this rank."""
    from dea_fenicsx.run import session
    from dea_fenicsx.run.journal import Journal
    from tests.peers import ours

    spent = dict.fromkeys(PARTS, 0.0)

    def timed(part: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def run(*given: Any, **named: Any) -> Any:
            start = time.perf_counter()
            try:
                return call(*given, **named)
            finally:
                spent[part] += time.perf_counter() - start

        return run

    kept = session.solver_for, Journal._write
    session.solver_for, Journal._write = timed("set_up_s", kept[0]), timed("output_s", kept[1])
    start = time.perf_counter()
    try:
        device = timed("mesh_s", dea.device)(case.geometry)
        if name == "helix":
            rubber = dea.Material(dea.NeoHookean(73.7e3), dea.IdealDielectric(4.7))
            metal = dea.Material(dea.NeoHookean(73.7e3), dea.Conductor())
            materials = {n: metal if n.startswith("electrode") else rubber for n in device.regions}
            plates = [dea.Electrode("electrode_a", 6e3), dea.Ground("electrode_b")]
            scene = dea.Scene(device, materials, plates, [dea.FreeBody()])
        else:
            rubbers = {n: ours.material(m) for n, m in case.materials.items()}
            plates = [dea.Electrode("top", case.electrodes["top"]), dea.Ground("bottom")]
            scene = dea.Scene(device, rubbers, plates, [dea.Clamp(case.clamped)])
        run = dea.solve(
            scene, dea.Ramp("voltage", steps=2), {"c": dea.Contraction(("bottom", "top"), "z")},
            out=out, quiet=True, stability="never",
            options=dea.NewtonOptions(factor=factor),  # type: ignore[arg-type]
        )  # fmt: skip
    finally:
        session.solver_for, Journal._write = kept
    told, whole = run.summary, time.perf_counter() - start
    for part in ("assembly_s", "factor_s", "krylov_s"):
        spent[part] = told[part]
    spent["rest_s"] = whole - sum(spent[part] for part in PARTS[:-1])
    names = {"unknowns": "unknowns", "newton": "newton_iterations", "krylov": "krylov_iterations",
             "factorisations": "factorisations"}  # fmt: skip
    return spent | {k: told[v] for k, v in names.items()} | {"value": run.history[-1]["c"]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", nargs="*", default=list(SCENES), choices=list(SCENES))
    parser.add_argument("--size", type=float, help="in place of the scene's own")
    parser.add_argument("--ranks", type=int, default=2)
    parser.add_argument("--limit", type=float, help="most seconds of one run")
    parser.add_argument("--out", default="parallel.csv")
    parser.add_argument("--child", nargs=2, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.child:
        child(args.child[0], float(args.child[1]))
        return
    several, alone = (max(bandwidth(n) for _ in range(3)) for n in (args.ranks, 1))
    gain = several / alone
    print(f"bandwidth: {args.ranks} processes reach {gain:.2f} times that of one", flush=True)
    for name in args.scenes:
        size = args.size or SCENES[name][1]
        rows = []
        for ranks in (1, args.ranks):
            found = ask("tests.peers.parallel", name, size, limit=args.limit, ranks=ranks)
            if found is None:
                print(f"{name}: stopped after {args.limit:g} s")
                break
            rows.append({k: (found | {"scene": name, "size": size, "ranks": ranks})[k]
                         for k in COLUMNS})  # fmt: skip
            append(args.out, COLUMNS, rows[-1])
        if len(rows) == 2:
            _print(name, rows, gain)


def _print(name: str, rows: list[dict[str, Any]], gain: float) -> None:
    """A line for each part, with how many times faster it became."""
    one, more = rows
    print(f"{name}: {one['unknowns']} unknowns, 1 and {more['ranks']} ranks, Newton "
          f"{one['newton']} and {more['newton']}, Krylov "
          f"{one['krylov']} and {more['krylov']}")  # fmt: skip
    for part in ["wall_s", *PARTS]:
        ratio = one[part] / more[part] if more[part] > 0 else float("nan")
        print(f"  {part:11} {one[part]:8.2f} {more[part]:8.2f}   {ratio:5.2f} times, "
              f"{ratio / gain:5.2f} of the bandwidth's gain", flush=True)  # fmt: skip



if __name__ == "__main__":
    main()
