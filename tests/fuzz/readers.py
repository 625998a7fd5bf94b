"""Everything that reads files, with files that are damaged or made up, by the thousand.

    python -m tests.fuzz.readers --count 50000 --seed 1 --jobs 2

Each trial damages one file of a whole results folder, or a mesh, and reads it in a forked process
that has imported everything already.  It must succeed, or end in one sentence (a `DeaError`); it
must not be ended by a signal, take longer than some seconds, write outside of its folder, run a
command, print what tells a terminal what to do, or leave its process changed.  A run that is
resumed must end as the whole one did.  Prints the seed, a count of what came out, and each fault
with the number of its trial: ``--only NUMBER`` repeats it.  Exit status: the number of faults, at
most 99.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import io
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx import cli
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.pictures.paraview import write as write_view
from dea_fenicsx.results import reading
from dea_fenicsx.support import subprocesses
from dea_fenicsx.support.form_cache import cache_dir
from tests.fuzz.damaged_results import (
    in_checkpoint,
    in_file,
    in_hdf5,
    in_mesh,
    in_summary,
    in_xdmf,
)
from tests.fuzz.forked import Fault, all_of

FILM = dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(3.0))
STEPS = 4


@dataclass(frozen=True)
class Trial:
    """What is damaged, and what reads it.

    Attributes
    ----------
    share : how often it is tried
    damage : changes a copy of the good folder
    read : reads it; returns what it printed
    """

    share: float
    damage: Callable[[Path, random.Random], None]
    read: Callable[[Path, random.Random], str]


# ------------------------------------------------------------------------------ what is read


def scene() -> dea.Scene:
    geometry = BoxStack(1e-3, None, [Layer("film", 1e-3)], divisions=(2,))
    device = dea.read_gmsh(geometry, MPI.COMM_SELF)
    return dea.Scene(
        device, {"film": FILM}, kinematics=dea.PlaneStrain(1e-3), supports=[dea.Clamp("bottom")],
        electrodes=[dea.Electrode("top", 3e3), dea.Ground("bottom")],
    )  # fmt: skip


SCENE: list[dea.Scene] = []
PATH = [dea.Ramp(steps=STEPS), dea.Trace("voltage", first=0.05, steps=3)]


def solved(out: Path, resume: bool = False, stop: bool = False) -> Any:
    """The run of these trials: whole, interrupted, or carried on."""
    count = iter(range(1000))

    class Height(dea.MeanStretch):
        def bind(self, problem: Any) -> Any:
            measure = super().bind(problem)

            def stopping() -> float:
                if stop and next(count) == 2:
                    signal.raise_signal(signal.SIGINT)
                return measure()

            return stopping

    record = {"h": Height(("bottom", "top"), "y")}
    return dea.solve(SCENE[0], PATH, record, out, resume=resume, quiet=True, stability="never")


def good_folders(place: Path) -> dict[str, float]:
    """Make what the trials damage; returns the end of the whole run."""
    SCENE.append(scene())
    run = solved(place / "whole")
    with contextlib.suppress(dea.Interrupted):
        solved(place / "cut", stop=True)
    (place / "mesh").mkdir()
    geometry = BoxStack(1e-3, None, [Layer("film", 1e-3)], divisions=(2,))
    import gmsh

    geometry.build()
    for kind, binary in (("ascii", 0), ("binary", 1)):
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.write(str(place / "mesh" / f"{kind}.msh"))
    gmsh.finalize()
    return {"steps": len(run.history), "h": run["h"]}


def printed(*words: str) -> str:
    """What a command of ``dea`` prints; its status must be one that is documented."""
    out, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
        status = cli.main(list(words))
    if status not in (0, 1, 2):
        raise Fault(f"dea {words[0]} ends with status {status}: {errors.getvalue()[-200:]}")
    told = errors.getvalue()
    if "--debug shows where" in told:
        raise Fault(f"dea {words[0]}: {told.strip()}")
    return out.getvalue() + told


def tables(folder: Path, rng: random.Random) -> str:
    here, good = str(folder / "whole"), str(folder / "good")
    text = printed("show", here, "--text")
    text += printed("compare", good, here) + printed("compare", here, good)
    if rng.random() < 0.03:
        text += printed("show", here, "--format", "svg")
    if rng.random() < 0.1:
        text += printed("show", here, "--paraview")
    reading.read_history(here)
    reading.read_summary(here)
    return text


def frames(folder: Path, rng: random.Random) -> str:
    here = folder / "whole"
    text = printed("show", str(here), "--text")
    if rng.random() < 0.3:
        write_view(here)
        compile((here / "view.py").read_text("utf-8"), "view.py", "exec")
    reading.field_names(here)
    for step in range(len(reading.frame_times(here))):
        reading.read_frame(here, step)
    return text


WANTED: dict[str, float] = {}


def carried_on(folder: Path, rng: random.Random) -> str:
    run = solved(folder / "cut", resume=True)
    if run.summary["status"] != "completed" or len(run.history) != WANTED["steps"]:
        raise Fault(f"resumed to {len(run.history)} steps, {run.summary['status']}")
    if not abs(run["h"] - WANTED["h"]) < 1e-7:
        raise Fault(f"resumed to h = {run['h']} instead of {WANTED['h']}")
    return ""


def mesh(folder: Path, rng: random.Random) -> str:
    for file in (folder / "mesh").iterdir():
        dea.read_gmsh(file, MPI.COMM_SELF)
    return ""


TRIALS = {
    "history": Trial(0.27, in_file("whole/history.csv"), tables),
    "summary": Trial(0.25, in_summary, tables),
    "xdmf": Trial(0.20, in_xdmf, frames),
    "hdf5": Trial(0.15, in_hdf5, frames),
    "checkpoint": Trial(0.10, in_checkpoint, carried_on),
    "mesh": Trial(0.02, in_mesh("ascii"), mesh),
    "binary mesh": Trial(0.01, in_mesh("binary"), mesh),
}


def kind_of(seed: int, number: int) -> str:
    rng = random.Random(f"{seed} {number}")
    return rng.choices(list(TRIALS), [trial.share for trial in TRIALS.values()])[0]


# -------------------------------------------------------------------------------- one trial


WANTED_BY = {"tables": "whole", "frames": "whole", "carried_on": "cut", "mesh": "mesh"}
"""Which of the good folders each function reads."""


def tried(good: Path, seed: int, number: int, scratch: Path) -> str:
    """Make and read one damaged file, in this process; returns what came out."""
    rng = random.Random(f"{seed} {number}, damage")
    trial = TRIALS[kind_of(seed, number)]
    place = scratch / f"{number}"
    outcome = read_one(good, place, trial.read, trial.damage, rng)
    os.chdir(scratch)
    shutil.rmtree(place)
    return outcome


def read_one(
    good: Path,
    place: Path,
    read: Callable[[Path, random.Random], str],
    damage: Callable[[Path, random.Random], None],
    rng: random.Random,
) -> str:
    """Read a damaged copy of a good folder in a new folder, and check what this leaves there."""
    folder = place / "results"
    place.mkdir()
    (place / "canary").write_text("alive")
    name = WANTED_BY[read.__name__]
    shutil.copytree(good / name, folder / name)
    if read is tables:
        (folder / "good").symlink_to(good / "whole")
    damage(folder, rng)
    os.chdir(folder)
    try:
        text = read(folder, rng)
        outcome = "read"
    except dea.DeaError as error:
        text, outcome = str(error), "refused"
        if "\n" in text or not text.endswith(".") or len(text) > 3000:
            raise Fault(f"not one sentence: {text[:300]!r}") from error
    strange = [c for c in text if not c.isprintable() and c != "\n"]
    if strange:
        raise Fault(f"it prints {strange[0]!r}")
    if Path.cwd() != folder:
        raise Fault(f"it leaves another working directory, {Path.cwd()}")
    known = {"canary", "results"}
    here = {p.name for p in place.iterdir()} | ({"pwned"} if list(place.rglob("pwned")) else set())
    if here != known or (place / "canary").read_text() != "alive":
        raise Fault(f"it leaves {sorted(here - known)} outside of its folder")
    return outcome


# ------------------------------------------------------------------------------- all of them


SHARED_MEMORY = Path("/dev/shm")
MEMORY = 2 << 30
"""Bytes that must be free in memory for the trials to lie there and not on a disk."""

TELL = 60.0
"""Seconds between two lines that tell how far it is."""


class _Lowest(random.Random):
    """Random numbers of which each is the smallest, so that whatever has a chance happens."""

    def random(self) -> float:
        return 0.0


def fast_folder() -> str | None:
    """A folder that lies in memory, or None for the usual one of temporary files.

    Libraries are loaded from it, which some systems forbid in memory.
    """
    with contextlib.suppress(OSError):
        forbidden = os.statvfs(SHARED_MEMORY).f_flag & os.ST_NOEXEC
        room = shutil.disk_usage(SHARED_MEMORY).free > MEMORY
        if room and not forbidden and os.access(SHARED_MEMORY, os.W_OK):
            return str(SHARED_MEMORY)
    return None


def own_cache(folder: Path) -> None:
    """Use a cache of compiled forms that holds only those which this process has loaded.

    Each form that is loaded costs a listing of the whole cache, which may hold thousands.
    """
    old = cache_dir()
    lines = Path("/proc/self/maps").read_text().splitlines()
    loaded = {Path(line.split(maxsplit=5)[5]) for line in lines if line.count(" /")}
    os.environ["XDG_CACHE_HOME"] = str(folder)
    cache_dir().mkdir(parents=True)
    for library in loaded:
        if library.parent == old:
            for file in old.glob(f"{library.name.split('.')[0]}.*"):
                shutil.copy2(file, cache_dir())


def warmed(good: Path, scratch: Path) -> None:
    """Read each good folder once in this process, so that what it imports is there in all others.

    Raises
    ------
    Fault
        If one cannot be read.
    """
    for read in (tables, frames, carried_on, mesh):
        place = scratch / read.__name__
        outcome = read_one(good, place, read, lambda *_: None, _Lowest())
        if outcome != "read":
            raise Fault(f"the good folder is {outcome} by {read.__name__}")
        os.chdir(scratch)
        shutil.rmtree(place)
    gc.collect()
    gc.freeze()  # otherwise each process would walk through all of this again and again


def run(
    count: int, seed: int, only: int | None = None, kinds: list[str] | None = None,
    say: Callable[[str], object] = print, jobs: int = 1, size: int = 200,
) -> tuple[Counter[str], list[str]]:  # fmt: skip
    """Try so many damaged files; returns counts of what came out, and the faults.

    Parameters
    ----------
    count, seed
        How many, and from which seed.
    only
        Number of the one trial to repeat.
    kinds
        Names in `TRIALS`; by default all, each as often as it says.
    say
        Called with each fault, and now and then with how far it is.
    jobs
        Processes at a time.
    size
        Trials of one process.
    """
    numbers = range(count) if only is None else range(only, only + 1)
    wanted = [n for n in numbers if not kinds or kind_of(seed, n) in kinds]
    counts: Counter[str] = Counter()
    faults = []
    with tempfile.TemporaryDirectory(prefix="fuzz_readers_", dir=fast_folder()) as name:
        place = Path(name).resolve()
        good, scratch = place / "good", place / "scratch"
        good.mkdir()
        scratch.mkdir()
        WANTED.update(good_folders(good))
        own_cache(place / "cache")
        warmed(good, scratch)
        begun = told = time.monotonic()
        for ended in all_of(partial(tried, good, seed), wanted, scratch, jobs, size):
            kind = kind_of(seed, ended.number)
            counts[f"{kind}: {ended.outcome}"] += 1
            if ended.outcome == "fault":
                faults.append(f"trial {ended.number} of seed {seed} ({kind}): {ended.why}")
                say(faults[-1])
            if (now := time.monotonic()) - told > TELL:
                told = now
                say(f"{counts.total()} of {len(wanted)} trials, {now - begun:.0f} s")
        os.chdir("/")
    return counts, faults


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--only", type=int, help="repeat the trial of this number alone")
    parser.add_argument("--kind", action="append", choices=list(TRIALS), help="of this kind only")
    parser.add_argument("--jobs", type=int, default=1, help="processes at a time")
    options = parser.parse_args()
    os.environ |= subprocesses.environment()
    print(f"seed {options.seed}", flush=True)
    begun = time.monotonic()
    counts, faults = run(
        options.count, options.seed, options.only, options.kind,
        partial(print, flush=True), options.jobs,
    )  # fmt: skip
    for outcome, number in sorted(counts.items()):
        print(f"{outcome:25} {number}")
    used = sum(os.times()[:4])
    print(
        f"{sum(counts.values())} trials, {len(faults)} faults, {time.monotonic() - begun:.0f} s, "
        f"{used:.0f} s of the processors"
    )
    return min(len(faults), 99)


if __name__ == "__main__":
    sys.exit(main())
