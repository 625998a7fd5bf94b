"""Check this machine: a line for each finding, with what to do where it is not well."""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from importlib.machinery import PathFinder
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from dea_fenicsx import __version__
from dea_fenicsx.cli.child import start
from dea_fenicsx.support import subprocesses
from dea_fenicsx.support.free_memory import free_bytes

HELP = "is this machine set up, and if not, how to mend it"

OK, WARN, BAD = "ok", "warn", "bad"
SUPPORTED = ((0, 9), (0, 11))
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS")
SLOW_BLAS_GFLOPS = 8.0
"""Speed in Gflop/s on one thread below which a BLAS is slow.

On one machine the reference BLAS had 6 and OpenBLAS 50.
"""

# in what mpirun writes: a word, what it means, what to do
MPI_TROUBLES = (
    ("run as root", "Open MPI does not run for root", "Work as another user, or `export "
     "OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1`; `make env` sees to it."),
    ("not enough slots", "Open MPI finds fewer than 2 cores",
     "`export PRTE_MCA_rmaps_default_mapping_policy=:oversubscribe`; `make env` sees to it."),
)  # fmt: skip


@dataclass(frozen=True)
class Finding:
    """One line: how bad, about what, what was found, what to do."""

    level: str
    what: str
    text: str
    mend: str = ""


def add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seconds", type=float, default=60.0, metavar="S",
                        help="time limit of each trial (default %(default)g)")  # fmt: skip


def run(options: argparse.Namespace) -> int:
    worst = OK
    for found in examine(max(options.seconds, 1.0)):
        print(f"{found.level:5} {found.what:14} {found.text}", flush=True)
        if found.mend:
            print(f"{'':20} -> {found.mend}", flush=True)
        worst = max(worst, found.level, key=(OK, WARN, BAD).index)
    print({OK: "\nall is well", WARN: "\nusable; see the warnings", BAD: "\nnot usable yet"}[worst])
    return 1 if worst == BAD else 0


def examine(seconds: float) -> Iterator[Finding]:
    """All findings, each as soon as it is known."""
    yield from packages()
    yield from machine()
    yield from threads()
    yield from ranks(seconds)
    yield from solver(seconds)
    yield from drawing(seconds)


def packages() -> Iterator[Finding]:
    """Versions, from the installed packages' own records."""
    level = OK if sys.version_info >= (3, 12) else BAD
    yield Finding(level, "python", f"{platform.python_version()}, {sys.executable}",
                  "" if level == OK else "Python 3.12 or newer is needed.")  # fmt: skip
    here = Path(__file__).resolve().parents[1]
    try:
        version("dea_fenicsx")  # raises where the package is not installed
        yield Finding(OK, "dea_fenicsx", f"{__version__}, {here}")
    except PackageNotFoundError:
        yield Finding(WARN, "dea_fenicsx", f"{__version__}, not installed, used from {here}",
                      "`make env` in the repository installs it.")  # fmt: skip
    hidden = hiding_folder(Path.cwd(), here)
    if hidden:
        yield Finding(WARN, "dea_fenicsx", f"the folder {hidden} hides the package from scripts "
                      "that lie beside it", "Give the folder another name; or install the package "
                      "anew (`make env`), so that it is found first.")  # fmt: skip
    needed = {"numpy": True, "scipy": True, "h5py": True, "gmsh": True, "mpi4py": True,
              "matplotlib": False, "pyvista": False, "pint": False}  # fmt: skip
    for name, must in needed.items():
        if find_spec(name) is None:
            level = BAD if must else WARN if name != "pint" else OK
            why = {"matplotlib": "no pictures", "pyvista": "no export as VTU",
                   "pint": "no quantities with units"}.get(name, "needed")  # fmt: skip
            mend = f"pip install {name}" if level != OK else ""
            yield Finding(level, name, f"not installed: {why}", mend)
        else:
            yield Finding(OK, name, _version(name))


def hiding_folder(place: Path, package: Path) -> Path | None:
    """A folder in `place` that Python takes for the package of a script there, or None.

    Python takes any folder of the name for a namespace package, unless it finds the real one on its
    search path; an import hook, by which some editable installs work, is asked last.
    """
    folder = place / package.name
    if not folder.is_dir() or folder.samefile(package):
        return None
    others = [p for p in sys.path if p and Path(p).resolve() != place.resolve()]
    found = PathFinder.find_spec(package.name, others)
    regular = found is not None and found.origin is not None
    return None if regular and not (folder / "__init__.py").exists() else folder


def _version(name: str) -> str:
    with suppress(PackageNotFoundError):
        return version(name)
    return "there"  # Debian's gmsh leaves no record


def machine() -> Iterator[Finding]:
    """Cores and memory that this process may use."""
    cores = len(os.sched_getaffinity(0))
    quota = _first_number("/sys/fs/cgroup/cpu.max", 2)
    if quota:
        cores = min(cores, max(1, int(quota[0] / quota[1])))
    yield Finding(OK, "cores", f"{cores}; up to {cores} ranks make sense")
    found = free_bytes()
    free = 0.0 if found is None else found / 1e9
    if found is None:
        yield Finding(WARN, "memory", "unknown")
    elif free < 1.5:
        yield Finding(WARN, "memory", f"{free:.1f} GB free",
                      "The demos need 1 to 3 GB; end what else uses memory.")  # fmt: skip
    else:
        yield Finding(OK, "memory", f"{free:.1f} GB free")


def _first_number(file: str, count: int) -> list[float] | None:
    """The first numbers of a file of the kernel; None if it is not there or says "max"."""
    try:
        return [float(x) for x in Path(file).read_text().split()[:count]]
    except (OSError, ValueError):
        return None


def threads() -> Iterator[Finding]:
    """Threads that each rank's BLAS may start; measured in `solver`."""
    given = {n: os.environ[n] for n in THREADS if n in os.environ}
    text = ", ".join(f"{k}={v}" for k, v in given.items()) or "OMP_NUM_THREADS is not set"
    if os.environ.get("OMP_NUM_THREADS") == "1" and set(given.values()) == {"1"}:
        yield Finding(OK, "threads", text)
    else:
        yield Finding(WARN, "threads", text, "`export OMP_NUM_THREADS=1`: ranks share the cores, "
                      "and threads of their own make them slower.")  # fmt: skip


def ranks(seconds: float) -> Iterator[Finding]:
    """Start mpirun -n 2: hello, and a reduction."""
    mpirun = subprocesses.mpirun()
    if mpirun is None:
        yield Finding(BAD, "mpi", "there is no mpirun",
                      "Install that of this MPI (Debian: openmpi-bin), or `make env`.")  # fmt: skip
        return
    done = start("ranks", seconds, before=[mpirun, "-n", "2"])
    facts = done.facts.get("size", {"size": None, "total": None})
    size, total = facts["size"], facts["total"]
    if (size, total) == (2, 3):
        yield Finding(OK, "mpi", f"{facts['library']}, 2 ranks by {mpirun}")
    elif size == 1:
        yield Finding(BAD, "mpi", f"{mpirun} starts single processes: it is of another MPI than "
                      f"mpi4py's ({facts['library']})",
                      "Put the mpirun of that MPI first on the PATH (`make env` puts one into "
                      ".venv/bin).")  # fmt: skip
    else:
        reason, mend = done.reason, "On a virtual machine UCX_TLS=self,sm,tcp may help."
        for word, why, what in MPI_TROUBLES:
            if word in done.errors:
                reason, mend = why, what
        yield Finding(BAD, "mpi", f"{mpirun} -n 2 failed: {reason}", mend)


def solver(seconds: float) -> Iterator[Finding]:
    """DOLFINx, PETSc, BLAS, MUMPS and the compiler of forms."""
    done = start("solver", seconds)
    facts = done.facts
    if "dolfinx" not in facts:
        yield Finding(BAD, "dolfinx", f"cannot be loaded: {done.reason}", "`make env` sets it up.")
        return
    yield from _dolfinx(facts["dolfinx"])
    if "failed" in facts["dolfinx"]:
        return
    if "blas" in facts:
        yield from _blas(facts["blas"]["blas"])
    inertia = facts.get("inertia", {"inertia": None, "failed": done.reason})
    if inertia["inertia"] is None:
        yield Finding(BAD, "mumps", f"no L D L^T: {inertia['failed']}",
                      "PETSc must be built with MUMPS, as Debian's and the wheel's are.")
    elif inertia["inertia"][0] != inertia["inertia"][1]:
        yield Finding(BAD, "mumps", "counts {} negative pivots instead of {}".format(
            *inertia["inertia"]), "Stability cannot be judged with this MUMPS.")
    else:
        yield Finding(OK, "mumps", "L D L^T solves, inertia right")
    cache = facts.get("cache", {"cache": None, "folder": "?", "failed": done.reason})
    bad = cache.get("damaged")
    if bad:
        text = f"{len(bad)} damaged in {cache['cache']}, the first {bad[0]}"
        yield Finding(WARN, "form cache", text, "They are compiled again when they are needed; "
                      "was the disk full?")  # fmt: skip
    elif cache["cache"]:
        yield Finding(OK, "form cache", cache["cache"])
    else:
        yield Finding(BAD, "form cache", f"{cache['folder']} cannot be written: {cache['failed']}",
                      "Set XDG_CACHE_HOME to a folder that can.")
    form = facts.get("form", {"form": None, "failed": done.reason})
    if form["form"] is not None and abs(form["form"] - 1) < 1e-12:
        text = f"{_compiler()}, a small form in {form['seconds']:.1f} s"
        yield Finding(OK, "form compiler", text)
    else:
        yield Finding(BAD, "form compiler", f"fails ({_compiler()}): {form.get('failed', 'wrong')}",
                      "Debian: sudo apt install gcc libc6-dev python3-dev.")  # fmt: skip


def _compiler() -> str:
    import sysconfig

    name = (os.environ.get("CC") or sysconfig.get_config_var("CC") or "gcc").split()[0]
    return shutil.which(name) or f"there is no {name}"


def _dolfinx(found: dict[str, Any]) -> Iterator[Finding]:
    low, high = (".".join(map(str, v)) for v in SUPPORTED)
    number = found["dolfinx"]
    wanted = f"DOLFINx {low} to {high} is needed: `make env`, or python3-dolfinx on Debian 13."
    good = False
    if number:
        with suppress(ValueError):
            good = SUPPORTED[0] <= tuple(int(p) for p in number.split(".")[:2]) <= SUPPORTED[1]
    if "failed" in found:
        text = f"{number or 'not there'} ({' '.join(found['failed'].split())[:160]})"
        yield Finding(BAD, "dolfinx", text, wanted)
        return
    yield Finding(OK if good else BAD, "dolfinx", number, "" if good else wanted)
    if found["scalar"] == "float64":
        yield Finding(OK, "petsc", found["petsc"])
    else:
        yield Finding(BAD, "petsc", f"{found['petsc']} of {found['scalar']} numbers",
                      "A build with real numbers in double precision is needed (Debian: "
                      "PETSC_ARCH unset, python3-dolfinx-real).")  # fmt: skip


def _blas(found: dict[str, Any]) -> Iterator[Finding]:
    libraries = ", ".join(Path(f).name for f in found["libraries"]) or "linked in"
    rate = found["gigaflops"] / max(found["threads"], 1.0)
    text = f"{rate:.0f} Gflop/s a thread ({libraries})"
    if found["plain"] or rate < SLOW_BLAS_GFLOPS:
        why = "the reference BLAS" if found["plain"] else "a slow BLAS, or a busy machine"
        yield Finding(WARN, "blas", f"{text}: {why}",
                      "Debian: sudo apt install libopenblas0-pthread; the solver becomes several "
                      "times faster.")  # fmt: skip
    else:
        yield Finding(OK, "blas", text)
    if found["threads"] > 1.5:
        yield Finding(WARN, "blas threads", f"{found['threads']:.0f} in each rank",
                      "`export OMP_NUM_THREADS=1` before mpirun.")  # fmt: skip


def drawing(seconds: float) -> Iterator[Finding]:
    """Draw a picture, which needs matplotlib and neither a screen nor OpenGL."""
    if find_spec("matplotlib") is None:
        return
    done = start("draw", seconds)
    if done.facts.get("drawn", {}).get("drawn"):
        yield Finding(OK, "pictures", "drawn without a screen")
    else:
        yield Finding(WARN, "pictures", f"matplotlib cannot draw: {done.reason}",
                      "pip install --force-reinstall matplotlib; all else works "
                      "without.")  # fmt: skip
