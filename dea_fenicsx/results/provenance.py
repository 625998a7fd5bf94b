"""Where a result comes from: the script that made it, its state in git, versions and machine."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx import __version__
from dea_fenicsx.support.files import replace_file

COPY, RESUMED = "script.py", "script_resumed.py"
"""Copies of the script in the results folder: of the run's beginning, and, if it has been changed
since, of the last time it was resumed."""


def script() -> Path | None:
    """The file that Python was started with, if it is one."""
    given = Path(sys.argv[0]) if sys.argv and sys.argv[0] not in ("", "-", "-c", "-m") else None
    with suppress(OSError):
        if given is not None and given.suffix == ".py" and given.is_file():
            return given.resolve()
    return None


def notebook() -> str | None:
    """The cells that a notebook has run so far, as a script; None outside of one.

    There Python was started with the launcher of the kernel, which says nothing of the run.
    """
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    if shell is None or type(shell).__name__ == "TerminalInteractiveShell":
        return None
    cells = [str(cell).rstrip() for cell in getattr(shell, "user_ns", {}).get("In", ())]
    told = [f"# In [{k}]\n{cell}\n" for k, cell in enumerate(cells) if cell]
    return "\n".join(told) if told else None


def _kept() -> bytes | None:
    """What is kept as the script of a run."""
    cells, source = notebook(), script()
    if cells is not None:
        return cells.encode("utf-8", "replace")
    return source.read_bytes() if source is not None else None


def is_script(file: Path) -> bool:
    """Whether a file is the script itself: one that writes its results beside itself."""
    source = script()
    return source is not None and file.exists() and source.samefile(file)


def keep_script(folder: Path) -> None:
    """Copy the script into the results folder (rank 0).

    The copy of an earlier start of the same run stays; if the script has changed since, it is
    kept beside it.
    """
    with suppress(OSError):  # a copy that cannot be made is no reason to stop a run
        text = _kept()
        if text is None:
            return
        target = folder / COPY
        if is_script(target):
            return
        if target.exists() and target.read_bytes() != text:
            target = folder / RESUMED
        replace_file(target, lambda file: file.write_bytes(text))


def git_state(place: Path, seconds: float = 3.0) -> dict[str, Any] | None:
    """Commit of the repository that holds a script or folder, and whether it is dirty.

    Dirty means that a file in git has been changed, or that the script is not in git.  None
    without git or a repository, or if git takes longer than some seconds.
    """
    folder = place if place.is_dir() else place.parent

    def ask(*words: str) -> str:
        # Git must not lock the repository, because the user may be working in it.
        done = subprocess.run(
            ["git", "--no-optional-locks", "-C", str(folder), *words], capture_output=True,
            text=True, timeout=seconds, check=True, stdin=subprocess.DEVNULL,
        )  # fmt: skip
        return done.stdout.strip()

    try:
        commit = ask("rev-parse", "HEAD")
        changed = ask("status", "--porcelain", "--untracked-files=no")
        known = place.is_dir() or ask("ls-files", "--", place.name)
        return {"commit": commit, "dirty": bool(changed or not known)}
    except (OSError, subprocess.SubprocessError):
        return None


def origin() -> dict[str, Any]:
    """The script, its state in git, and the machine (rank 0; asks git, which may take a moment)."""
    in_notebook = notebook() is not None
    source = None if in_notebook else script()
    return {
        "script": "notebook" if in_notebook else str(source) if source else None,
        "git": git_state(source or Path.cwd()),
        "host": platform.node(),
        "cores": len(os.sched_getaffinity(0)),
        "platform": platform.platform(),
    }


@cache
def package_versions() -> dict[str, str]:
    """Versions of this package, numpy, h5py, gmsh and Python; found once, as they do not change."""
    found = {"dea_fenicsx": __version__}
    for name in ("h5py", "gmsh"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "unknown"
    return found | {"numpy": np.__version__, "python": platform.python_version()}
