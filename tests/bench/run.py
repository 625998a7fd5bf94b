"""Run the fixed scenes on one core and write what each took.

    python -m tests.bench.run [--scenes NAME ...] --out build/bench.json

Forms are compiled beforehand, by a run on a few cells that is not counted; the seconds are those of
the mesh and of the whole solve.

Exit status: 0 if all scenes ran, 1 if one failed, 2 for bad input.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import dea_fenicsx as dea
from tests.bench.files import COUNTS, BadFile, write
from tests.bench.scenes import SCENES


def count(name: str) -> tuple[dict[str, Any], dict[str, str]]:
    """Run one scene; returns its counts, status, value and seconds, and the versions used."""
    _solved(name, fine=False)
    start = time.perf_counter()
    run, value = _solved(name, fine=True)
    seconds = time.perf_counter() - start
    told = {key: int(run.summary[key]) for key in COUNTS}
    told |= {"status": run.summary["status"], "value": float(f"{value:.12g}")}
    return told | {"seconds": round(seconds, 3)}, run.summary["versions"]


def _solved(name: str, fine: bool) -> tuple[Any, float]:
    case = SCENES[name](fine)
    run = dea.solve(case.scene, case.path, case.record, quiet=True, **case.options)
    return run, run[case.value]


def machine() -> str:
    """The processor, and how many cores this process may use."""
    name = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
        name = next(x.partition(":")[2].strip() for x in lines if x.startswith("model name"))
    except (OSError, StopIteration):
        pass  # not Linux, or a processor that does not tell its name
    return f"{name}, {os.cpu_count()} cores"


def bench(names: Iterable[str]) -> tuple[dict[str, Any], list[str]]:
    """Run scenes in turn; returns the file's content and the names of those that failed."""
    found: dict[str, Any] = {"versions": {}, "machine": machine(), "scenes": {}}
    failed = []
    for name in names:
        try:
            told, found["versions"] = count(name)
        except dea.DeaError as error:
            failed.append(name)
            print(f"{name:26} failed: {' '.join(str(error).split())}", flush=True)
            continue
        found["scenes"][name] = told
        print(f"{name:26} {told['unknowns']:7d} unknowns  {told['steps']:3d} steps  "
              f"Newton {told['newton_iterations']:4d}  Krylov {told['krylov_iterations']:5d}  "
              f"factors {told['factorisations']:3d}  {told['seconds']:6.2f} s  "
              f"{told['value']:.11e}  {told['status']}", flush=True)  # fmt: skip
    return found, failed


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", nargs="+", default=list(SCENES), choices=list(SCENES),
                        metavar="NAME", help="some of the scenes only")  # fmt: skip
    parser.add_argument("--out", default="build/bench.json", help="the JSON file")
    args = parser.parse_args(arguments)
    if MPI.COMM_WORLD.size > 1:
        print("The counts are those of one rank: start this without mpirun.", file=sys.stderr)
        return 2
    found, failed = bench(args.scenes)
    if found["scenes"]:
        try:
            write(args.out, found)
        except BadFile as error:
            print(error, file=sys.stderr)
            return 2
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
