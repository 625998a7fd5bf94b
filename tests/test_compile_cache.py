"""The cache of compiled forms: where it lies, and what happens to damaged, locked and full ones."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest
import ufl
from conftest import clean_environment
from ffcx.codegeneration import jit
from mpi4py import MPI

from dea_fenicsx.cli import child, doctor
from dea_fenicsx.support import compat, compiling_ahead, form_cache

LENGTH = """
import resource, sys
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
import ufl
from mpi4py import MPI
from dea_fenicsx.support import compat
from dea_fenicsx.support.errors import install_hook
install_hook()
{before}
mesh = compat.dolfinx.mesh.create_interval(MPI.COMM_WORLD, 5, (0.0, 2.0))
one = compat.dolfinx.fem.Constant(mesh, 3.0)
form = compat.compile_form(one * ufl.dx(domain=mesh))
value = compat.dolfinx.fem.assemble_scalar(form)
print("length", MPI.COMM_WORLD.allreduce(value) / 3)
"""


def script(where, before="", **environment):
    """A script that compiles one small form and prints the length of a line of 2 m."""
    environment = {"DEA_FENICSX_CFLAGS": "-O0", "HOME": str(where)} | environment
    return subprocess.Popen(
        [sys.executable, "-c", LENGTH.format(before=before)], cwd=where, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=clean_environment() | environment,
    )  # fmt: skip


def right(process):
    out, errors = process.communicate(timeout=100)
    assert process.returncode == 0, errors
    assert float(out.split()[-1]) == pytest.approx(2, rel=1e-14)


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """A home with a compiled form in its cache: the home, and the form's files by their ending."""
    home = tmp_path_factory.mktemp("home")
    right(script(home, XDG_CACHE_HOME=""))
    (library,) = home.glob(".cache/dea_fenicsx/*/*.so")
    return home, library


@pytest.mark.parametrize("given", [None, "", "cache", "~/cache", "./"])
def test_where_the_cache_lies(monkeypatch, tmp_path, given):
    """Only an absolute path counts, as the XDG Base Directory Specification says."""
    monkeypatch.setenv("HOME", "/somewhere")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    if given is not None:
        monkeypatch.setenv("XDG_CACHE_HOME", given)
    assert form_cache.cache_dir().parent == Path("/somewhere/.cache/dea_fenicsx")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert form_cache.cache_dir().parent == tmp_path / "dea_fenicsx"


def test_nothing_is_made_where_one_stands(cache):
    assert [f.name for f in cache[0].iterdir()] == [".cache"]


def cut(share):
    return lambda f: os.truncate(f, int(share * f.stat().st_size))


def end_of_zeros(f):
    """What a file system leaves that had no time to write the last blocks."""
    size = f.stat().st_size
    os.truncate(f, size // 2)
    os.truncate(f, size)


DAMAGES = {
    "empty": cut(0), "a header alone": lambda f: os.truncate(f, 64), "half": cut(0.5),
    "without its last byte": lambda f: os.truncate(f, f.stat().st_size - 1),
    "zeros at its end": end_of_zeros, "zeros": lambda f: f.write_bytes(bytes(20_000)),
    "no library": lambda f: f.write_text("not a library"), "gone": lambda f: f.unlink(),
}  # fmt: skip


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_library_is_seen(cache, tmp_path, damage):
    _, library = cache
    name = library.name.split(".")[0]
    copy = tmp_path / library.name
    copy.write_bytes(library.read_bytes())
    assert not form_cache.damaged(tmp_path, name)  # without a mark it is still being compiled
    (tmp_path / f"{name}.c.cached").touch()
    assert not form_cache.damaged(tmp_path, name)
    DAMAGES[damage](copy)
    assert form_cache.damaged(tmp_path, name)
    assert form_cache.all_damaged(tmp_path) == [name]


@pytest.mark.parametrize("damage", ["empty", "half", "gone"])
def test_a_damaged_library_is_compiled_again(cache, damage):
    """By two processes at once, too: both get the right form."""
    home, library = cache
    DAMAGES[damage](library)
    for process in [script(home, XDG_CACHE_HOME="") for _ in range(2)]:
        right(process)
    assert form_cache.is_complete(library)


def test_code_that_is_cut_short(cache):
    """C code without a mark is what a killed compilation leaves; with one it is not read again."""
    home, library = cache
    code = library.with_name(library.name.split(".")[0] + ".c")
    os.truncate(code, 10)
    right(script(home, XDG_CACHE_HOME=""))
    code.with_name(f"{code.name}.cached").unlink()
    right(script(home, XDG_CACHE_HOME=""))
    assert code.stat().st_size > 1000


def test_the_doctor_sees_damage(monkeypatch):
    told = {"dolfinx": {"dolfinx": "0.11.0", "petsc": "3", "scalar": "float64"},
            "cache": {"cache": "/home/x", "damaged": ["form_a", "form_b"]}}  # fmt: skip
    done = child.Done(told, "")
    monkeypatch.setattr(doctor, "start", lambda *a, **k: done)
    (found,) = [f for f in doctor.solver(1.0) if f.what == "form cache"]
    assert (found.level, "2 damaged" in found.text, "form_a" in found.text) == ("warn", True, True)


def test_a_folder_that_cannot_be_used(tmp_path):
    """A file in its place, or a disk without room: one sentence, and the status of the machine."""
    (tmp_path / "file").touch()
    full = "resource.setrlimit(resource.RLIMIT_FSIZE, (500, resource.RLIM_INFINITY))"
    for before, where, words in (
        ("", tmp_path / "file", "Not a directory"),
        (full, tmp_path, "cannot be used (File too large)"),
    ):
        done = script(tmp_path, before, XDG_CACHE_HOME=str(where))
        _, errors = done.communicate(timeout=100)
        assert done.returncode == 5, errors
        assert errors.count("\n") == 1 and words in errors
    assert resource.getrlimit(resource.RLIMIT_FSIZE)[0] != 500


def two_forms(k):
    """A form and another one that only the tests of `compile_together` compile."""
    mesh = compat.dolfinx.mesh.create_interval(MPI.COMM_SELF, 3, (0.0, 2.0))
    x = ufl.SpatialCoordinate(mesh)[0]
    return [x**k * ufl.dx, x ** (k + 1) * ufl.dx]


@pytest.fixture
def forks(monkeypatch, tmp_path):
    """An empty cache on two cores: the numbers of the processes that are started."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(compiling_ahead, "cores", lambda: 2)
    found, fork = [], os.fork
    monkeypatch.setattr(os, "fork", lambda: found.append(fork()) or found[-1])
    return found


@pytest.mark.parametrize("broken", [False, True])
def test_forms_are_compiled_side_by_side(monkeypatch, tmp_path, forks, broken):
    """What fails in a process of its own is compiled in this one."""
    first, second = two_forms(5 + 2 * broken)
    if broken:  # in the copies alone: the first of them is this process's own
        here, make = os.getpid(), jit._compile_objects
        monkeypatch.setattr(
            jit, "_compile_objects", lambda *a, **k: make(*a, **k) if os.getpid() == here else 1 / 0
        )
    compat.compile_together(first, lambda: [second])
    assert len(forks) == 2
    marks = len(list(tmp_path.rglob(f"*{form_cache.READY}")))
    assert marks == (0 if broken else 2)
    with pytest.raises(ChildProcessError):
        os.waitpid(forks[0], os.WNOHANG)
    for form, power in ((first, 5 + 2 * broken), (second, 6 + 2 * broken)):
        value = compat.dolfinx.fem.assemble_scalar(compat.compile_form(form))
        assert value == pytest.approx(2 ** (power + 1) / (power + 1), rel=1e-12)
    compat.compile_together(first, lambda: pytest.fail("the first form is in the cache"))
    assert len(forks) == 2


@pytest.mark.mpi
def test_a_folder_that_one_rank_cannot_use(start, tmp_path):
    """All ranks end, with one sentence."""
    before = "import os\nif MPI.COMM_WORLD.rank: os.environ['XDG_CACHE_HOME'] = '/proc/none'"
    (tmp_path / "script.py").write_text(LENGTH.format(before=before))
    done = start(tmp_path / "script.py", ranks=2, timeout=60)
    told = [line for line in done.stderr.splitlines() if line.startswith("Error")]
    assert done.returncode == 5
    assert len(told) == 1 and "/proc/none" in told[0]
