"""Runs in processes of their own, so that none leaves memory, threads or caches to the next."""

from __future__ import annotations

import csv
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from tests.peers.scenes import Case

MARK = "found "


def tell(
    solve: Callable[[Case], dict[str, Any]], case: Case, memory: Any = None, whole: bool = False
) -> None:
    """In the child: solve a case and print what it took; on several ranks, the one that took most.

    Forms are compiled beforehand, by a run on a few cells that is not counted; not where the time
    of the whole process is asked for.  `memory` is how MPI unites the memory of the ranks; without
    it that of the largest is told.
    """
    from mpi4py import MPI  # not in the parent, which may start mpirun

    if not whole:
        solve(case.small())
    start, busy = time.perf_counter(), time.process_time()
    found = solve(case)
    comm = MPI.COMM_WORLD
    spent = {
        "wall_s": time.perf_counter() - start, "cpu_s": time.process_time() - busy,
        "memory_GB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9,
    }  # fmt: skip
    unite = dict.fromkeys(spent, MPI.MAX) | ({"memory_GB": memory} if memory else {})
    found |= {name: comm.allreduce(value, op=unite[name]) for name, value in spent.items()}
    if comm.rank == 0:
        print(MARK + json.dumps(found), flush=True)


def ask(
    module: str, *child: object, limit: float | None = None, ranks: int = 1
) -> dict[str, Any] | None:
    """Run ``python -m module --child ...`` and return what it tells; None if it takes too long.

    ``process_s`` is the wall time from the start of the process to its end.  Ends the program if it
    fails.
    """
    command = [sys.executable, "-m", module, "--child", *map(str, child)]
    if ranks > 1:
        command = ["mpirun", "-n", str(ranks), *command]
    # NGSolve starts threads of its own, which wait for work by spinning
    alone = os.environ | {"NGS_NUM_THREADS": "1"}
    begun = time.perf_counter()
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=limit, env=alone)
    except subprocess.TimeoutExpired:
        return None
    line = next((x for x in done.stdout.splitlines() if x.startswith(MARK)), None)
    if line is None:
        raise SystemExit(f"{' '.join(command[2:])} failed:\n{done.stderr[-2000:]}")
    return json.loads(line.removeprefix(MARK)) | {"process_s": time.perf_counter() - begun}


def write(path: str, columns: Sequence[str], rows: list[dict[str, Any]]) -> None:
    """Write rows as CSV."""
    with open(path, "w", newline="") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)


def append(path: str, columns: Sequence[str], row: dict[str, Any]) -> None:
    """Append a row to a CSV file, which gets its heading with the first row."""
    new = not Path(path).exists()
    with open(path, "a", newline="") as file:
        writer = csv.DictWriter(file, columns)
        if new:
            writer.writeheader()
        writer.writerow(row)
