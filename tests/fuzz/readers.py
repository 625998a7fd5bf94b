"""Everything that reads files, with files that are damaged or made up, by the thousand.

    python -m tests.fuzz.readers --count 50000 --seed 1

Each trial damages one file of a whole results folder, or a mesh, and reads it in a forked process
that has imported everything already.  It must succeed, or end in one sentence (a `DeaError`); it
must not be ended by a signal, take longer than some seconds, write outside of its folder, run a
command, or print what tells a terminal what to do.  A run that is resumed must end as the whole
one did.  Prints the seed, a count of what came out, and each fault with the number of its trial:
``--only NUMBER`` repeats it.  Exit status: the number of faults, at most 99.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import random
import resource
import select
import shutil
import signal
import sys
import tempfile
import time
import traceback
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx import cli
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.pictures.paraview import write as write_view
from dea_fenicsx.results import reading
from dea_fenicsx.results.checkpoint import digest
from dea_fenicsx.support import subprocesses
from tests.fuzz.damage import NUMBERS, TEXTS, damaged, other_value

SECONDS = 20.0
ROOM = 3 << 30
"""Bytes of address space that a trial may take beside what its process has already."""

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


class Fault(Exception):
    """Something that must not happen in a trial."""


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


# ---------------------------------------------------------------------------- how it is damaged


def in_file(*names: str) -> Callable[[Path, random.Random], None]:
    def damage(folder: Path, rng: random.Random) -> None:
        file = folder / rng.choice(names)
        file.write_bytes(damaged(file.read_bytes(), rng))

    return damage


def in_summary(folder: Path, rng: random.Random) -> None:
    file = folder / "whole" / "summary.json"
    if rng.random() < 0.3:
        return in_file("whole/summary.json")(folder, rng)
    told = json.loads(file.read_text())
    for _ in range(rng.choice((1, 2, 5, 30))):
        told = other_value(told, rng)
    file.write_text(json.dumps(told))


def in_xdmf(folder: Path, rng: random.Random) -> None:
    """Bytes, or well-formed XML with another attribute, text or element."""
    if rng.random() < 0.3:
        return in_file("whole/fields.xdmf")(folder, rng)
    file = folder / "whole" / "fields.xdmf"
    tree = ET.parse(file)
    elements = list(tree.getroot().iter())
    for _ in range(rng.choice((1, 1, 3))):
        one, other = rng.choice(elements), rng.choice(elements)
        new = "".join(c for c in rng.choice((*TEXTS, *NUMBERS)) if c >= " ")
        kind = rng.randrange(5)
        if kind == 0 and one.attrib:
            one.set(rng.choice(sorted(one.attrib)), new)
        elif kind == 1 and one.attrib:
            del one.attrib[rng.choice(sorted(one.attrib))]
        elif kind == 2:
            one.text = other.text
        elif kind == 3 and len(one):
            one.remove(one[rng.randrange(len(one))])
        else:
            name, _, where = (one.text or "").strip().partition(":")
            one.text = rng.choice((f"{new}:{where}", f"{name}:{new}", new, f"../{name}:{where}"))
    tree.write(file)
    return None


def in_hdf5(folder: Path, rng: random.Random) -> None:
    """Bytes, or a good file that holds something else under one of its names."""
    file = folder / "whole" / "fields.h5"
    if rng.random() < 0.3:
        return in_file("whole/fields.h5")(folder, rng)
    if rng.random() < 0.5:  # few bits only, so that more of it is read
        raw = bytearray(file.read_bytes())
        for _ in range(rng.choice((1, 3))):
            raw[rng.randrange(len(raw))] ^= 1 << rng.randrange(8)
        file.write_bytes(raw)
        return None
    with h5py.File(file, "a") as h5:
        names: list[str] = []
        h5.visit(names.append)
        name = rng.choice(names)
        old = h5[name][()] if isinstance(h5[name], h5py.Dataset) else np.zeros((3, 3))
        del h5[name]
        kind = rng.randrange(8)
        if kind == 0:
            h5[name] = h5py.ExternalLink("/etc/passwd", "/")
        elif kind == 1:
            h5[name] = h5py.SoftLink("/" + rng.choice(names))
        elif kind == 2:
            h5.create_dataset(name, (1 << 20, 1 << 10), "f8", chunks=(1024, 1024), fillvalue=1.0)
        elif kind == 3:
            h5.create_dataset(name, (64,), "f8", external=[("/etc/hostname", 0, 512)])
        elif kind == 4:
            h5[name] = rng.choice(("text", [b"a", b"b"], 7, np.zeros((0, 3)), np.zeros(3)))
        elif kind == 5:
            h5[name] = (old * rng.choice((-1, 1e9, np.nan))).astype(old.dtype)
        elif kind == 6:
            h5[name] = rng.choice((old[:-1], old[..., :-1], old.ravel(), old.astype("c16")))
        elif kind == 7:
            h5.create_dataset(name, (10**15,), "f8", chunks=(1024,), compression="gzip")
    return None


def in_checkpoint(folder: Path, rng: random.Random) -> None:
    """Bytes, or a well-formed file that tells something else, sealed anew or not."""
    if rng.random() < 0.2:
        return in_file("cut/checkpoint.npz")(folder, rng)
    file = folder / "cut" / "checkpoint.npz"
    with np.load(file) as data:
        state, told = data["state"], json.loads(str(data["told"]))
    if rng.random() < 0.15:
        state = state.copy()
        state.flat[rng.randrange(state.size)] *= rng.choice((0.9, 2, -1, np.nan, np.inf))
    elif rng.random() < 0.1:
        state = rng.choice((state[:-1], state.astype("f4"), state.ravel(), state.astype("c16")))
    else:
        for _ in range(rng.choice((1, 1, 3))):
            told = other_value(told, rng)
    text = json.dumps(told)
    more = {}
    if rng.random() < 0.8:
        with contextlib.suppress(TypeError, ValueError):
            more["digest"] = digest(state, text)
    with contextlib.suppress(UnicodeEncodeError):
        np.savez(file, state=state, told=text, **more)
    return None


def in_mesh(kind: str) -> Callable[[Path, random.Random], None]:
    def damage(folder: Path, rng: random.Random) -> None:
        other = {"ascii": "binary", "binary": "ascii"}[kind]
        (folder / "mesh" / f"{other}.msh").unlink()
        in_file(f"mesh/{kind}.msh")(folder, rng)

    return damage


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


def tried(good: Path, scratch: Path, seed: int, number: int) -> str:
    """Make and read one damaged file, in this process; returns what came out."""
    rng = random.Random(f"{seed} {number}, damage")
    kind = kind_of(seed, number)
    trial = TRIALS[kind]
    place = scratch / f"{number}"
    folder = place / "results"
    place.mkdir()
    (place / "canary").write_text("alive")
    wanted = {"tables": ("whole",), "frames": ("whole",), "carried_on": ("cut",), "mesh": ("mesh",)}
    for name in wanted[trial.read.__name__]:
        shutil.copytree(good / name, folder / name)
    if trial.read is tables:
        (folder / "good").symlink_to(good / "whole")
    trial.damage(folder, rng)
    os.chdir(folder)
    try:
        text = trial.read(folder, rng)
        outcome = "read"
    except dea.DeaError as error:
        text, outcome = str(error), "refused"
        if "\n" in text or not text.endswith(".") or len(text) > 3000:
            raise Fault(f"not one sentence: {text[:300]!r}") from error
    strange = [c for c in text if not c.isprintable() and c != "\n"]
    if strange:
        raise Fault(f"it prints {strange[0]!r}")
    known = {"canary", "results"}
    here = {p.name for p in place.iterdir()} | ({"pwned"} if list(place.rglob("pwned")) else set())
    if here != known or (place / "canary").read_text() != "alive":
        raise Fault(f"it leaves {sorted(here - known)} outside of its folder")
    os.chdir(scratch)
    shutil.rmtree(place)
    return outcome


def child(good: Path, scratch: Path, seed: int, numbers: list[int], tell: int) -> None:
    """Try some numbers, and tell the parent of each as it begins and ends."""
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + ROOM, size + ROOM))
    resource.setrlimit(resource.RLIMIT_FSIZE, (200 << 20, 200 << 20))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    null = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        os.dup2(null, descriptor)
    for number in numbers:
        os.write(tell, f"{number}\tbegins\t\n".encode())
        try:
            outcome, why = tried(good, scratch, seed, number), ""
        except Fault as error:
            outcome, why = "fault", str(error)
        except BaseException as error:
            where = traceback.extract_tb(error.__traceback__)[-1]
            outcome = "fault"
            why = f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})"
        why = " ".join(why.split())[:400]
        os.write(tell, f"{number}\t{outcome}\t{why}\n".encode("utf-8", "replace"))
    os._exit(0)


# ------------------------------------------------------------------------------- all of them


def batch(good: Path, scratch: Path, seed: int, numbers: list[int]) -> dict[int, tuple[str, str]]:
    """What came out of some trials, in a forked process that may die or hang."""
    found: dict[int, tuple[str, str]] = {}
    hear, tell = os.pipe()
    process = os.fork()
    if process == 0:
        os.close(hear)
        os.setsid()
        try:
            child(good, scratch, seed, numbers, tell)
        finally:
            os._exit(1)
    os.close(tell)
    at, text, late = None, b"", False
    end = time.monotonic() + SECONDS
    while True:
        if not select.select([hear], [], [], max(end - time.monotonic(), 0))[0]:
            late = True
            break
        piece = os.read(hear, 65536)
        if not piece:
            break
        *lines, text = (text + piece).split(b"\n")
        for line in lines:
            number, outcome, why = line.decode("utf-8", "replace").split("\t", 2)
            at = int(number) if outcome == "begins" else None
            if outcome != "begins":
                found[int(number)] = (outcome, why)
            end = time.monotonic() + SECONDS
    if late:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process, signal.SIGKILL)
    os.close(hear)
    _, status = os.waitpid(process, 0)
    if at is not None:
        code = os.waitstatus_to_exitcode(status)
        why = f"no end within {SECONDS:g} s" if late else f"the process ends with status {code}"
        found[at] = ("fault", why)
    return found


def run(
    count: int, seed: int, only: int | None = None, kinds: list[str] | None = None,
    say: Callable[[str], object] = print, size: int = 50,
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
        Called with each fault.
    size
        Trials of one process.
    """
    numbers = range(count) if only is None else range(only, only + 1)
    left = [n for n in numbers if not kinds or kind_of(seed, n) in kinds]
    counts: Counter[str] = Counter()
    faults = []
    with tempfile.TemporaryDirectory(prefix="fuzz_readers_") as name:
        place = Path(name)
        good, scratch = place / "good", place / "scratch"
        good.mkdir()
        scratch.mkdir()
        WANTED.update(good_folders(good))
        while left:
            found = batch(good, scratch, seed, left[:size])
            for number, (outcome, why) in sorted(found.items()):
                kind = kind_of(seed, number)
                counts[f"{kind}: {outcome}"] += 1
                if outcome == "fault":
                    faults.append(f"trial {number} of seed {seed} ({kind}): {why}")
                    say(faults[-1])
            if not found:
                faults.append(f"trials {left[:size]} of seed {seed}: no process")
                break
            left = [n for n in left if n not in found]
    return counts, faults


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--only", type=int, help="repeat the trial of this number alone")
    parser.add_argument("--kind", action="append", choices=list(TRIALS), help="of this kind only")
    options = parser.parse_args()
    os.environ |= subprocesses.environment()
    print(f"seed {options.seed}", flush=True)
    begun = time.monotonic()
    counts, faults = run(options.count, options.seed, options.only, options.kind)
    for outcome, number in sorted(counts.items()):
        print(f"{outcome:25} {number}")
    print(f"{sum(counts.values())} trials, {len(faults)} faults, {time.monotonic() - begun:.0f} s")
    return min(len(faults), 99)


if __name__ == "__main__":
    sys.exit(main())
