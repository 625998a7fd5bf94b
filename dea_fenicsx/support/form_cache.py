"""The folder of compiled forms: its place, and how damaged files in it are found and replaced.

A form is kept there as C code (``NAME.c``), as a shared library (``NAME.*.so``) and with a mark
(``NAME.c.cached``) that says that both are complete.  A full disk, a power failure or a copy that
was broken off can leave a library that is empty or cut short although the mark is there.  To load
such a library ends the process by a bus error, so each library is checked before it is loaded.
"""

from __future__ import annotations

import fcntl
import hashlib
import importlib.machinery
import importlib.util
import os
import platform
import struct
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import IO, Any

from mpi4py import MPI

from dea_fenicsx.support.agreement import together
from dea_fenicsx.support.errors import MachineError

READY = ".c.cached"
"""Ending of the mark of a compiled form."""


def cache_dir() -> Path:
    """Folder of the compiled forms, one for each kind of processor.

    Kernels are compiled for the machine at hand; on a cluster with a shared home directory a
    kernel of another node's processor would end in an illegal instruction.  It lies in
    XDG_CACHE_HOME, unless that is empty or no absolute path: then, as the XDG Base Directory
    Specification demands, it counts as not set.
    """
    return _cache_dir(os.environ.get("XDG_CACHE_HOME", ""), os.environ.get("HOME"))


@cache
def _cache_dir(given: str, _: str | None) -> Path:
    """The same for two variables of the environment, which say where the home is."""
    root = Path(given) if os.path.isabs(given) else Path.home() / ".cache"
    return root / "dea_fenicsx" / _processor()


@cache
def _processor() -> str:
    """A short name of this kind of processor."""
    cpu = platform.machine()
    with suppress(OSError), open("/proc/cpuinfo") as f:
        cpu += "".join(line for line in f if line.startswith(("flags", "model name")))[:4096]
    return hashlib.sha1(cpu.encode()).hexdigest()[:12]


@contextmanager
def compiling(jit: Any, comm: MPI.Comm) -> Iterator[None]:
    """Compile forms: clean the cache before, and tell in one sentence why it cannot be done.

    Collective on `comm`.

    FFCx leaves the C code without a mark in the cache while it compiles.  If a run is killed
    meanwhile, all later ones would wait in vain for the mark, so a process that finds itself alone
    removes such files.

    Parameters
    ----------
    jit
        FFCx's module for compiling; while this context lasts it loads no damaged library.

    Raises
    ------
    MachineError
        If the folder cannot be used, by one rank or by all, or the C compiler fails.
    """
    folder, lock = together(comm, _open, "The cache of compiled forms")
    get = jit.get_cached_module
    try:
        with lock:
            with suppress(OSError):
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                _sweep(folder)
            with suppress(OSError):  # some file systems have no locks
                fcntl.flock(lock, fcntl.LOCK_SH)
            jit.get_cached_module = _only_sound(get)
            yield
    except OSError as error:
        raise _unusable(folder, error) from error
    except Exception as error:
        if not _is_of_the_compiler(error):
            raise
        raise MachineError(
            "A form could not be compiled; `dea doctor` tells what the compiler lacks "
            f"({' '.join(str(error).split())[:160]})."
        ) from error
    finally:
        jit.get_cached_module = get


def _open() -> tuple[Path, IO[str]]:
    """The folder of compiled forms, which is made if there is none, and its lock file, opened."""
    folder = Path()
    try:
        folder = cache_dir()
        folder.mkdir(parents=True, exist_ok=True)
        return folder, open(folder / "lock", "a")
    except (OSError, RuntimeError) as error:  # Python raises the latter if it finds no home
        raise _unusable(folder, error) from error


def _unusable(folder: Path, error: Exception) -> MachineError:
    reason = getattr(error, "strerror", None) or str(error).rstrip(".")
    return MachineError(
        f"The cache of compiled forms in {folder} cannot be used ({reason}); set XDG_CACHE_HOME to "
        "the absolute path of a folder that can be written."
    )


_swept: dict[Path, int] = {}
"""When each folder that was swept had last changed, in ns."""


def _sweep(folder: Path) -> None:
    """Remove the marks of killed compilations, and what they left half done."""
    if folder.stat().st_mtime_ns == _swept.get(folder):
        return  # thousands of files, and every form comes by here
    names = set(os.listdir(folder))
    for name in names:
        ready = name.endswith(READY)
        other = name.removesuffix(".cached") if ready else f"{name}.cached"
        if (ready or name.endswith(".c")) and other not in names:
            (folder / name).unlink()
    _swept[folder] = folder.stat().st_mtime_ns


def _is_of_the_compiler(error: Exception) -> bool:
    """Whether an exception comes from the C compiler and not from the form."""
    return type(error).__name__ in ("VerificationError", "CompileError", "LinkError") or (
        isinstance(error, RuntimeError) and "JIT" in str(error)
    )


# ------------------------------------------------------------------------- damaged libraries


def _nothing() -> None:
    """Nobody is to be told."""


on_compiling: Callable[[], None] = _nothing
"""Called on the rank that compiles, before each form that is not in the cache."""


@contextmanager
def telling(tell: Callable[[], None]) -> Iterator[None]:
    """Let somebody be told before each form that is compiled."""
    global on_compiling
    before, on_compiling = on_compiling, tell
    try:
        yield
    finally:
        on_compiling = before


_loaded: dict[tuple[str, str], Any] = {}
"""What this process has loaded, by folder and name of the module."""


def _only_sound(get: Callable[..., Any]) -> Callable[..., Any]:
    """FFCx's function that loads a compiled module, which first removes a damaged one.

    The form is then compiled again, as one that was never compiled.  A module that this process has
    loaded before is given again, and another one is loaded from its own file: Python would list the
    whole folder to find it, which takes 20 ms where there are ten thousand files.
    """

    def get_sound(module_name: str, object_names: Any, folder: Any, timeout: int) -> Any:
        key = (str(folder), module_name)
        if key in _loaded:
            return _loaded[key]
        if damaged(Path(folder), module_name):
            _remove(Path(folder), module_name)
        library = _library(Path(folder), module_name)
        if library and (Path(folder) / f"{module_name}{READY}").exists():
            module = _from_file(module_name, library)
            found = [getattr(module.lib, name) for name in object_names], module
        else:
            found = get(module_name, object_names, folder, timeout)
        if found[0] is not None:
            _loaded[key] = found
        else:
            on_compiling()  # FFCx compiles a form that it does not find
        return found

    return get_sound


def damaged(folder: Path, name: str) -> bool:
    """Whether a form is marked as compiled, but has no complete library."""
    if not (folder / f"{name}{READY}").exists():
        return False
    library = _library(folder, name)
    return library is None or not is_complete(library)


def _library(folder: Path, name: str) -> Path | None:
    """The shared library of a form that Python would load; None if there is none."""
    for suffix in importlib.machinery.EXTENSION_SUFFIXES:  # in the order in which Python looks
        library = folder / f"{name}{suffix}"
        if library.exists():
            return library
    return None


def _from_file(name: str, library: Path) -> Any:
    """The module of a form, loaded from its shared library."""
    spec = importlib.util.spec_from_file_location(name, library)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def all_damaged(folder: Path) -> list[str]:
    """Names of all damaged forms in a folder."""
    names = [n.removesuffix(READY) for n in os.listdir(folder) if n.endswith(READY)]
    return sorted(name for name in names if damaged(folder, name))


def is_complete(library: Path) -> bool:
    """Whether a shared library has the length that its own header tells.

    The table of sections, the last part of a library in ELF's format, must lie within the file, and
    the section that holds the names of all others must be there: a file system that was cut off may
    leave zeros in place of the end.  True for other formats than that of Linux on 64 bits.
    """
    if not sys.platform.startswith("linux"):
        return True
    with open(library, "rb") as file:
        size = os.fstat(file.fileno()).st_size
        head = file.read(64)
        if len(head) < 64 or head[:4] != b"\x7fELF":
            return False
        if head[4] != 2:
            return True
        order = "<" if head[5] == 1 else ">"
        start = struct.unpack_from(f"{order}Q", head, 40)[0]
        length, count, of_names = struct.unpack_from(f"{order}3H", head, 58)
        if not count or start + length * count > size:
            return False
        file.seek(start + length * of_names + 4)
        kind = file.read(4)
        return len(kind) == 4 and struct.unpack(f"{order}I", kind)[0] == 3  # a table of strings


def _remove(folder: Path, name: str) -> None:
    """Remove a damaged form.  Of several processes only the one that removes the mark goes on."""
    try:
        (folder / f"{name}{READY}").unlink()
    except FileNotFoundError:
        return
    for file in folder.glob(f"{name}.*"):
        file.unlink(missing_ok=True)
