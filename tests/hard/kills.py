"""Kill a small run with SIGKILL at random moments and resume it: the end must be the same.

Half of the kills strike at a random time after a random step.  The other half strike while
something is written: the run kills itself at a random one of its writes, before it, when half of
the new file is on disk, or right after it; writes are those of a step, of the final fields and the
removal of the parts.

    python tests/hard/run.py --only "random kill"
    python tests/hard/kills.py --scene march --kills 10 --seed 4000

The second command tells the largest difference of all histories.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ET
from contextlib import suppress
from pathlib import Path

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).parents[k]) for k in (1, 2)]

import h5py
import numpy as np
from conftest import ROOT, clean_environment

import dea_fenicsx as dea
from dea_fenicsx.support import subprocesses

PHASES = ("before", "half", "after")

# What work was done, errors at the size of rounding, and the place of the largest field: among
# equal fields rounding chooses.
LEFT_OUT = {"wall_s", "newton_iterations", "krylov_iterations", "factorisations", "retries",
            "residual", "volume_error", "min_J",
            "max_field_x_m", "max_field_y_m", "max_field_z_m"}  # fmt: skip

STEPS = 15

SEED = 4000
"""Of the random moments, unless another one is given; each kill adds its number."""

RANKS = {
    "film": ((1, 1), (2, 1), (1, 1), (1, 3), (1, 1)),
    "march": ((1, 1), (1, 2), (2, 3), (3, 1), (2, 2), (1, 3), (3, 2), (2, 1), (3, 3)),
}
"""Ranks of a run that is killed, and of the one that resumes it, in turn."""

SCRIPT = '''
import os, shutil, signal, sys
import dea_fenicsx as dea
import dea_fenicsx.results.folder as results
from dea_fenicsx.geometry import BoxStack, Layer

# the write at which to die, and in which phase of it
when, phase = int(os.environ.get("DIE_AT", "-1")), os.environ.get("DIE_PHASE", "")
writes = 0

def die():
    os.kill(os.getpid(), signal.SIGKILL)

whole, remove = results.replace_file, shutil.rmtree

def replace_file(path, write):
    global writes
    writes += 1
    mine = writes - 1 == when
    if mine and phase == "before":
        die()
    if mine and phase == "half":
        half = path.with_name(f".{path.name}.new")
        write(half)
        os.truncate(half, half.stat().st_size // 2)
        die()
    whole(path, write)
    if mine:
        die()

def rmtree(path, **options):
    global writes
    writes += 1
    if writes - 1 == when:
        for name in sorted(os.listdir(path))[: {"before": 0, "half": 3, "after": 99}[phase]]:
            os.unlink(os.path.join(path, name))
        die()
    remove(path, **options)

results.replace_file, results.shutil.rmtree = replace_file, rmtree

%sdea.solve(scene, path, {"Q": dea.Charge("top"), "w": dea.LargestDisplacement("top", "z")},
    out=sys.argv[1], resume="--resume" in sys.argv, quiet=True, stability="every")
if os.environ.get("COUNT_WRITES") and scene.device.comm.rank == 0:
    print(writes)
'''

SCENES = {
    "film": '''
film = dea.Material(dea.NeoHookean(50e3), dea.IdealDielectric(2.86))
strip = BoxStack(1e-3, None, [Layer("film", 1e-4, divisions=2)], divisions=(6,))
scene = dea.Scene(dea.read_gmsh(strip), {"film": film}, kinematics=dea.Axisymmetric(),
    electrodes=[dea.Electrode("top", 2500.0), dea.Ground("bottom")],
    supports=[dea.Fix("x_min", "r"), dea.Clamp("x_max")],
    loads=[dea.FollowerPressure("bottom", 20.0)])
path = [dea.Ramp("load", steps=4), dea.Ramp("voltage", steps=6),
        dea.Trace("load", first=0.2, steps=4)]
''',
    "march": '''
electric = dea.IdealDielectric(2.86, conductivity=2.5e-13)
film = dea.Material(dea.NeoHookean(50e3), electric, viscous=[dea.Maxwell(50e3, 1.0)])
strip = BoxStack(1e-3, None, [Layer("film", 1e-4, divisions=2)], divisions=(6,))
scene = dea.Scene(dea.read_gmsh(strip), {"film": film}, kinematics=dea.Axisymmetric(),
    electrodes=[dea.Source("top", 2000.0, ohms=1e11), dea.Ground("bottom")],
    supports=[dea.Fix("x_min", "r"), dea.Fix("bottom", "z")])
path = [dea.March(2.0, {"voltage": dea.Step(1.0, at=0.5)}, tolerance=1e-2, at=(1.0,)),
        dea.Open("top"), dea.March(2.0, steps=4)]
''',
}
"""What is killed: a film under pressure and voltage, and one that creeps, charges and leaks."""


def start(script: Path, out: Path, ranks: int, resume: bool, **environment: str):
    """Start the run; it is the leader of a session of its own."""
    command = [sys.executable, str(script), str(out), *(["--resume"] if resume else [])]
    if ranks > 1:
        mpirun = subprocesses.mpirun()
        assert mpirun, "there is no mpirun"
        command = [mpirun, "-n", str(ranks), *command]
    return subprocess.Popen(
        command, cwd=ROOT, env=clean_environment() | environment, start_new_session=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip


def kill(process: subprocess.Popen, script: Path) -> None:
    """SIGKILL for all processes of a run, found by its script's unique path."""
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with suppress(OSError):
                words = (entry / "cmdline").read_bytes().decode(errors="replace").split("\0")
                if str(script) in words and int(entry.name) != os.getpid():
                    os.kill(int(entry.name), signal.SIGKILL)
    with suppress(OSError):
        process.kill()
    process.communicate(timeout=60)


def finish(script: Path, out: Path, ranks: int, resume: bool, **environment: str) -> str:
    process = start(script, out, ranks, resume, **environment)
    output, _ = process.communicate(timeout=120)
    assert process.returncode == 0, f"status {process.returncode}: {output[-300:]}"
    return output


def readable(out: Path) -> int:
    """Open all that is in a folder; returns the number of steps in fields.xdmf."""
    if (out / "summary.json").exists():
        ended = ("running", "completed", "interrupted", "machine failed")
        assert dea.read_summary(out)["status"] in ended
    if (out / "history.csv").exists():
        assert len(dea.read_history(out)["step"])
    if (out / "checkpoint.npz").exists():
        with np.load(out / "checkpoint.npz") as data:
            assert np.isfinite(data["state"]).all() and json.loads(str(data["told"]))
    steps = 0
    if (out / "fields.xdmf").exists():
        grids = ET.parse(out / "fields.xdmf").getroot().findall("./Domain/Grid/Grid")
        for item in [i for grid in grids for i in grid.iter("DataItem")]:
            name, where = (item.text or "").split(":", 1)
            with h5py.File(out / name) as h5:
                assert np.isfinite(h5[where][()]).all()
        steps = len(grids)
    return steps


def difference(found: Path, wanted: Path) -> float:
    """Largest difference of two histories, relative to the column's largest value."""
    a, b = dea.read_history(found), dea.read_history(wanted)
    assert list(a) == list(b) and len(a["step"]) == len(b["step"]), "other steps"
    worst = 0.0
    for name in set(a) - LEFT_OUT:
        if a[name].dtype.kind == "f" and not np.isnan(b[name]).all():
            scale = np.nanmax(np.abs(b[name])) or 1.0
            worst = max(worst, float(np.nanmax(np.abs(a[name] - b[name])) / scale))
    return worst


def one(
    script: Path, folder: Path, number: int, pace: float, writes: int, seed: int = SEED
) -> dict:
    """One kill and what came of it."""
    rng = random.Random(seed + number)
    pairs = RANKS[script.stem]
    ranks = pairs[number % len(pairs)]
    out = folder / f"run_{number}"
    begin = time.perf_counter()
    if number % 2:
        at, phase = rng.randrange(writes), rng.choice(PHASES)
        # the last writes bring all steps together: they are few, so one in three is there
        if number % 3 == 0:
            at = writes - 1 - rng.randrange(4)
        name = f"random kill {number + 1}: write {at + 1} of {writes}, {phase}"
        process = start(script, out, ranks[0], False, DIE_AT=str(at), DIE_PHASE=phase)
        with suppress(subprocess.TimeoutExpired):
            process.wait(timeout=60)
    else:
        step, delay = rng.randrange(STEPS), rng.uniform(0, 2 * pace)
        name = f"random kill {number + 1}: {delay * 1e3:.0f} ms after step {step}"
        process = start(script, out, ranks[0], False)
        while process.poll() is None and on_disk(out) <= step:
            time.sleep(0.002)
        time.sleep(delay)
    kill(process, script)
    row = {"case": f"{name} of a {script.stem}, {ranks[0]} then {ranks[1]} ranks",
           "expected": "same end to 1e-8"}  # fmt: skip
    try:
        steps = readable(out) if out.exists() else 0
        finish(script, out, ranks[1], True)
        readable(out)
        error = difference(out, folder / "whole")
        good = error < 1e-8 and not list(out.glob("parts/*"))
        verdict = "same end" if good else "another end"
        message = f"{steps} steps were on disk, difference {error:.0e}"
    except (AssertionError, OSError, ValueError, KeyError, ET.ParseError, dea.DeaError,
            subprocess.TimeoutExpired) as fault:  # fmt: skip
        good, verdict, message = False, "broken", f"{type(fault).__name__}: {fault}"
        error = np.inf
    return row | {"verdict": verdict, "message": " ".join(message.split())[:300], "passed": good,
                  "seconds": time.perf_counter() - begin, "difference": error}  # fmt: skip


def as_cases(kills: int = 20, scene: str = "film", seed: int = SEED):
    """Rows of the table of hard cases, one for each kill of a run of one of `SCENES`."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        script = folder / f"{scene}.py"
        script.write_text(SCRIPT % SCENES[scene])
        finish(script, folder / "first", 1, False)  # compiles
        writes = int(finish(script, folder / "first", 1, False, COUNT_WRITES="1").split()[-1])
        pace = rhythm(script, folder / "whole")
        for number in range(kills):
            yield one(script, folder, number, pace, writes, seed)


def on_disk(out: Path) -> int:
    """Number of steps in history.csv so far."""
    file = out / "history.csv"
    return file.read_bytes().count(b"\n") - 1 if file.exists() else 0


def rhythm(script: Path, out: Path) -> float:
    """Run undisturbed: the mean time between two steps in s."""
    process = start(script, out, 1, False)
    while process.poll() is None and not on_disk(out):
        time.sleep(0.002)
    begin = time.perf_counter()
    assert process.wait(timeout=120) == 0
    return (time.perf_counter() - begin) / STEPS


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scene", default="march", choices=sorted(SCENES))
    parser.add_argument("--kills", type=int, default=10, help="how many")
    parser.add_argument("--seed", type=int, default=SEED, help="of the random moments")
    args = parser.parse_args()
    print(f"seed {args.seed}", flush=True)
    rows = []
    for row in as_cases(args.kills, args.scene, args.seed):
        rows.append(row)
        print(f"{'  ' if row['passed'] else 'X '}{row['case']}: {row['verdict']} "
              f"({row['seconds']:.1f} s)  {row['message'][:90]}", flush=True)  # fmt: skip
    print(f"largest difference {max(row['difference'] for row in rows):.1e}")
    return 0 if all(row["passed"] for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
