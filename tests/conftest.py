"""Shared by all tests: small devices, and scripts started under mpirun."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.solvers import linear
from dea_fenicsx.solvers.corotation import Corotation
from dea_fenicsx.support import subprocesses

ROOT = Path(__file__).resolve().parents[1]

# The flags of a user's runs are for large models.  With them, more than half of the suite's time
# would go into the compiler.  Other flags may be set from outside; "default" means those of a user.
if os.environ.setdefault("DEA_FENICSX_CFLAGS", "-O1 -g0") == "default":
    del os.environ["DEA_FENICSX_CFLAGS"]


ENGINES = {
    "whole": {"factor": "whole"},
    "cheap": {},
    "plain": {"factor": "whole", "keep_factor": False},
    "unturned": {},
}
"""Settings of the solver in place of the usual ones, for all tests of this process that name none.

No speed-up may change an answer, so the suite passes with each: ``pytest --engine plain``.  "cheap"
takes a split factor or one in single precision however small the problem.
"""


def pytest_addoption(parser):
    parser.addoption("--engine", choices=sorted(ENGINES), help="run with other solver settings")


def pytest_configure(config):
    engine = config.getoption("--engine")
    if engine is None:
        return
    changed = dea.NewtonOptions(**ENGINES[engine])
    names = dea.NewtonOptions.__dataclass_fields__
    dea.NewtonOptions.__init__.__defaults__ = tuple(getattr(changed, name) for name in names)
    if engine == "cheap":
        linear.UNKNOWNS_FOR_CHEAP_FACTOR = 0
    if engine == "unturned":
        Corotation.update = lambda self: None


AROUND = {
    # meshes and results of others, and what a user may do wrong with them
    "cad", "foreign_cells", "foreign_meshes", "foreign_overlap", "malformed", "strange_meshes",
    "results_of_strangers", "results_safety", "vtk", "geometry_cli", "report", "paraview",
    "export", "notebook",
    # what users look at, and their machine
    "cli", "demos", "docs", "pictures", "pictures_of_obstacles", "progress", "doctor",
    "compile_cache", "interruption", "site", "ending", "import_effects", "reading_alone",
    # whole devices and their closed forms
    "edges", "hdea", "helicoid", "kresling_cell", "laminate", "loadings", "origami", "stiffened",
    # closed forms, and laws one after another, of which other files ask the main ones
    "changing_permittivity", "elastic_laws", "exact", "exact_time", "geometry", "hertz",
    "round_balloon",
    # long paths and close looks: what `march`, `path` and `tracing` ask for in short
    "blister", "branches", "bridging", "charge_in_time", "crushing", "energy_conserving",
    "event_loads", "knock_down", "local_flow", "march_orders", "pull_in_time", "resumed_alike",
    "snap_in_motion", "viscous_branches", "evidence", "stability_count", "air",
    "obstacles", "energy_observables", "reuse", "temperature",
    # what stands on solved scenes: fits, designs, studies, derivatives in time
    "accuracy", "calibration", "density", "gradients_in_time", "improving", "nodal_fields", "place",
    "plan", "start_from", "study",
    # the package as a text
    "contributing", "homonyms", "markers", "structure",
    # very large problems
    "choosing", "multigrid",
    # searches, tables, and inputs at random
    "design", "fit_uncertainty", "fitting", "fuzz", "fuzz_readers", "hard", "ladder", "thesis",
}  # fmt: skip
"""Files (test_X.py) that are marked `around`.

They test what lies around a problem's solution, or look closer at what other files test in short.
`make quick` leaves them out, so that it takes less than two minutes.
"""


RANKS = "RANKS"
"""Environment variable with numbers of ranks, "2" or "2 3": of the tests that are repeated on
several numbers of ranks, the others are left out.  CI runs 2 ranks on one platform and 3 on the
other."""

SHORT_SUITE = "SHORT_SUITE"
"""Environment variable: where it is set, tests that do not depend on the versions of DOLFINx and of
PETSc are left out, and so are slow ones that start no mpirun, and slow demos.  CI sets it in the
image, after the whole suite has run outside."""

ANY_VERSION = {
    "adding_a_material", "contributing", "design", "docs", "fit_uncertainty", "fitting",
    "fuzz_readers", "hard", "malformed", "markers", "origami", "results_of_strangers",
    "results_safety", "site", "strange_meshes", "structure", "study", "thesis",
}  # fmt: skip
"""Files (test_X.py) that ask for nothing which differs between versions of DOLFINx."""


def numbers_of_ranks() -> tuple[int, ...]:
    """Numbers of ranks, more than one, on which a test shall repeat what one rank has done."""
    return tuple(int(n) for n in os.environ.get(RANKS, "2 3").split() if int(n) > 1)


def group_of(item) -> str:
    """Name of the tests that follow one another in one process, where several processes share them.

    Tests that start mpirun follow one another, since each wants all cores.  The tests of a file
    share what its fixtures have made, and later pages of the documents what earlier ones have left.
    Demos share nothing.
    """
    file = item.path.stem
    if file == "test_demos":
        return item.name
    return "mpirun" if item.get_closest_marker("mpi") and file != "test_docs" else file


def is_wanted(item) -> bool:
    """Is a test part of what the two variables above ask for?"""
    ranks = getattr(item, "callspec", None) and item.callspec.params.get("ranks")
    if ranks and RANKS in os.environ and str(ranks) not in os.environ[RANKS].split():
        return False
    if SHORT_SUITE not in os.environ:
        return True
    if item.path.stem.removeprefix("test_") in ANY_VERSION:
        return False
    marks = {mark.name for mark in item.iter_markers()}
    return "slow" not in marks or ("mpi" in marks and "demo" not in marks)


@pytest.hookimpl(tryfirst=True)  # before pytest chooses by markers
def pytest_collection_modifyitems(config, items):
    left_out = [item for item in items if not is_wanted(item)]
    if left_out:
        items[:] = [item for item in items if is_wanted(item)]
        config.hook.pytest_deselected(items=left_out)
    for item in items:
        if item.path.stem.removeprefix("test_") in AROUND:
            item.add_marker(pytest.mark.around)
        item.add_marker(pytest.mark.xdist_group(group_of(item)))
    if config.getoption("--engine"):
        for item in items:
            if item.get_closest_marker("engine"):
                item.add_marker(pytest.mark.skip(reason="counts what the usual settings cost"))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config):
    """Workers of ``pytest -n auto``: one for each core, and at most 8, since each takes 1 GB."""
    return min(8, len(os.sched_getaffinity(0)))


SLOW = 10.0
"""CPU time of a test and its subprocesses [s] above which it is to be marked slow."""

TAKEN = "seconds of CPU time"
"""Name under which a test that takes long and is not marked tells its CPU time to pytest."""


def cpu_time() -> float:
    """CPU time [s] of this process and of all of its subprocesses that have ended."""
    return sum(os.times()[:4])


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    begin = cpu_time()
    try:
        return (yield)
    finally:
        taken = cpu_time() - begin
        if taken > SLOW and not item.get_closest_marker("slow"):
            item.user_properties.append((TAKEN, taken))


def pytest_terminal_summary(terminalreporter):
    """Name the tests that took long and are not marked: a hint only, for machines differ."""
    for report in terminalreporter.getreports("passed"):
        if taken := dict(report.user_properties).get(TAKEN):
            terminalreporter.write_line(
                f"{report.nodeid} took {taken:.0f} s of CPU time; if it does so with compiled "
                "forms at hand, mark it slow."
            )


def needed_mpirun() -> str:
    """mpirun; without one the test is skipped, for nothing runs on several ranks there."""
    return subprocesses.mpirun() or pytest.skip("there is no mpirun")


def clean_environment() -> dict[str, str]:
    """The environment for a new mpirun: without this process's own place in an MPI job."""
    return subprocesses.environment() | {
        "OMP_NUM_THREADS": "1",
        "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
    }  # fmt: skip


on_demand = pytest.mark.skipif("LONG_TESTS" not in os.environ, reason="LONG_TESTS=1 runs it")
"""Marks what takes minutes, and repeats at length what other tests show."""

PATIENCE = 3.0
"""Factor on the time limits of scripts: they are there to end what hangs, and several tests may run
side by side on few cores."""


@pytest.fixture
def start():
    """Start a Python script on some ranks; returns the finished process with its output."""

    def run(script, *arguments, ranks: int = 1, timeout: float = 300, check: bool = False):
        command = [sys.executable, str(script), *map(str, arguments)]
        if ranks > 1:
            command = [needed_mpirun(), "-n", str(ranks), *command]
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=PATIENCE * timeout, cwd=ROOT,
            env=clean_environment(), stdin=subprocess.DEVNULL,
        )  # fmt: skip
        if check:
            assert done.returncode == 0, done.stdout + done.stderr
        return done

    return run


@pytest.fixture
def on_ranks(start, tmp_path):
    """Call a test module's function on some ranks; returns what rank 0 has, as JSON keeps it."""

    def call(module: str, function: str, ranks: int) -> Any:
        script = tmp_path / "script.py"
        script.write_text(
            f"import json, sys\nsys.path.insert(0, {str(ROOT / 'tests')!r})\n"
            f"from mpi4py import MPI\nfrom {module} import {function}\n"
            f"found = {function}(MPI.COMM_WORLD)\n"
            "if MPI.COMM_WORLD.rank == 0:\n    print(json.dumps(found))\n"
        )
        return json.loads(start(script, ranks=ranks, check=True).stdout.splitlines()[-1])

    return call


def block(cells=(1, 1, 1), size=1e-3, thickness=None, order=2):
    """A box-shaped film with the usual names: 3-D, or 2-D if `cells` has two entries."""
    thickness = size if thickness is None else thickness
    film = [Layer("film", thickness, divisions=cells[-1])]
    width = size if len(cells) == 3 else None
    geometry = BoxStack(size, width, film, divisions=cells[:-1] or (1,), order=order)
    return dea.read_gmsh(geometry, MPI.COMM_SELF)


@pytest.fixture
def quick_compile(monkeypatch):
    """Compile with little optimisation: for large kernels that run on a few cells only."""
    monkeypatch.setenv("DEA_FENICSX_CFLAGS", "-O1 -g0")


@pytest.fixture(scope="module")
def small_compile():
    """The same for what is shared by the tests of a file."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DEA_FENICSX_CFLAGS", "-O1 -g0")
        yield


@pytest.fixture(scope="session")
def cube():
    """A unit cell of film: 2 x 2 x 1 hexahedra, edge 1 mm."""
    return block((2, 2, 1))
