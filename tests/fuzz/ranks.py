"""Sketches solved on two ranks and on one: the same verdict, and the same end.

    mpirun -n 2 python -m tests.fuzz.ranks SKETCHES RESULTS       (what `on_two_ranks` starts)

One mpirun solves many sketches, for its start takes longer than most of them.  It appends a line to
RESULTS for each, so that it is known which one a hang or a crash belongs to; it is then ended, and
started anew behind that one.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.support import subprocesses

from .checks import PLACE, TIGHT, path_of, solve
from .sketch import Sketch, read

SAME = 1e-6
"""Relative difference of sums on two ranks and on one; the order of sums leaves 1e-10 of it."""


def numbers(sketch: Sketch, comm: MPI.Comm, **options: Any) -> dict[str, Any]:
    """Verdict and sums over the device that do not depend on how it is shared.  Collective."""
    it = solve(sketch, path_of(sketch), comm=comm, **options)
    found: dict[str, Any] = {"status": it.status, "message": it.message, "time": it.time}
    if it.run is None:
        return found
    problem, record = it.problem, it.records[-1]
    sums = [
        float(np.sum(record.state[problem.roles.of_group(name)[0]] ** 2))
        for name in ("u", "phi") if name in problem.roles.groups
    ]  # fmt: skip
    squares = problem.comm.allreduce(np.array(sums), op=MPI.SUM)
    return found | {
        "squares": squares.tolist(), "energy": record.energy, "inertia": it.inertia,
        "charges": [it.run.history[-1][f"q{k}_C"] / problem.scales.charge
                    for k in range(len(sketch.electrodes))],
    }  # fmt: skip


def differ(one: dict[str, Any], two: dict[str, Any]) -> str:
    """In which way two results differ; empty if they are the same."""
    if one["status"] != two["status"]:
        said = f"({one['message']} {two['message']})"
        return f"{one['status']} on one rank, {two['status']} on two {said}"
    if one["status"] == "refused" and one["message"] != two["message"]:
        return f"one rank: {one['message']} two: {two['message']}"
    if abs(one["time"] - two["time"]) > PLACE:
        return f"{one['status']} at {one['time']:.6g} on one rank, at {two['time']:.6g} on two"
    if one["status"] != "completed":
        return ""
    for name in ("squares", "energy", "charges"):
        a, b = np.atleast_1d(one[name]), np.atleast_1d(two[name])
        # dimensionless, all of them; what is below a thousandth of its unit counts as nothing
        floor = 1e-3 if name == "charges" else 1e-6
        if np.any(np.abs(a - b) > SAME * (np.abs(a).max(initial=0.0) + floor)):
            return f"{name}: {a.tolist()} on one rank, {b.tolist()} on two"
    if one["inertia"] != two["inertia"]:
        return f"{one['inertia']} negative eigenvalues on one rank, {two['inertia']} on two"
    return ""


def on_two_ranks(
    sketches: dict[int, Sketch], limit: int, ranks: int = 2
) -> dict[int, list[tuple[str, str]]]:
    """What sketches find on several ranks that they do not find on one, by number."""
    mpirun = subprocesses.mpirun()
    if mpirun is None:
        return {k: [("no mpirun", "nothing runs on two ranks here")] for k in sketches}
    found: dict[int, list[tuple[str, str]]] = {k: [] for k in sketches}
    left = list(sketches)
    with tempfile.TemporaryDirectory() as folder:
        given, results = Path(folder) / "sketches", Path(folder) / "results"
        while left:
            given.write_text("".join(f"{k}\t{sketches[k].text}\n" for k in left))
            results.write_text("")
            fault = _watched([mpirun, "-n", str(ranks), sys.executable, "-m", __name__,
                              str(given), str(results)], results, limit)  # fmt: skip
            lines = [json.loads(line) for line in results.read_text().splitlines()]
            for k, two in lines:
                said = differ(numbers(sketches[k], MPI.COMM_SELF), two)
                if said and two["status"] == "completed":
                    # a soft device rests within Newton's tolerance, which may be more than `SAME`
                    said = differ(numbers(sketches[k], MPI.COMM_SELF, options=TIGHT), two)
                if said:
                    found[k].append((f"{ranks} ranks differ", said))
            left = left[len(lines) :]
            if left and fault:
                found[left[0]].append((f"{ranks} ranks: {fault[0]}", fault[1]))
                left = left[1:]
    return found


def _watched(command: list[str], results: Path, limit: int) -> tuple[str, str] | None:
    """Run a command as long as it adds to its results; says what went wrong, or None."""
    environment = subprocesses.environment() | {
        "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
    }  # fmt: skip
    with tempfile.TemporaryFile("w+") as said, subprocess.Popen(
        command, stdout=said, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, env=environment
    ) as process:  # fmt: skip
        size, since = -1, time.monotonic()
        while process.poll() is None:
            if results.stat().st_size != size:
                size, since = results.stat().st_size, time.monotonic()
            if time.monotonic() - since > limit:
                process.terminate()
                try:
                    process.wait(10)
                except subprocess.TimeoutExpired:
                    process.kill()
                return "hang", f"nothing came within {limit} s"
            time.sleep(0.1)
        if process.returncode:
            said.seek(0)
            return "crash", f"status {process.returncode}: {said.read()[-300:]}"
    return None


def main() -> None:
    comm = MPI.COMM_WORLD
    lines = comm.bcast(Path(sys.argv[1]).read_text().splitlines() if comm.rank == 0 else None)
    for line in lines:
        number, text = line.split("\t", 1)
        sketch = read(text)
        result = numbers(sketch, comm)
        if result["status"] == "completed":
            # on two ranks only the tighter tolerance is run, unless it cannot be reached
            tight = numbers(sketch, comm, options=TIGHT)
            result = tight if tight["status"] == "completed" else result
        everyone = comm.gather(result["status"])
        if comm.rank == 0:
            if len(set(everyone)) > 1:
                result = {"status": " and ".join(everyone), "message": "", "time": 0.0}
            with open(sys.argv[2], "a", encoding="utf-8") as file:
                file.write(json.dumps([int(number), result]) + "\n")


if __name__ == "__main__":
    # as on one rank, an exception of any kind is an outcome; what ends a rank ends them all
    try:
        main()
    except Exception:
        import traceback

        traceback.print_exc()
        MPI.COMM_WORLD.Abort(1)
