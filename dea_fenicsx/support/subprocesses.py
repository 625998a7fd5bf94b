"""What starting another Python process needs, from within an MPI job or outside of one."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

MPI_VARIABLES = ("PMI", "OMPI_COMM", "OMPI_APP", "OMPI_UNIVERSE", "OMPI_FILE", "PRTE_LAUNCHED",
                 "MPIR", "HYDI", "MPIEXEC")  # fmt: skip
"""Beginnings of the environment variables by which a process joins a running MPI job."""


def mpirun() -> str | None:
    """The mpirun that belongs to this interpreter: beside it, else on the PATH; or None."""
    beside = Path(sys.executable).with_name("mpirun")
    return str(beside) if beside.exists() else shutil.which("mpirun")


def environment(without: Sequence[str] = MPI_VARIABLES) -> dict[str, str]:
    """This process's environment and search path, without variables that begin so."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(tuple(without))}
    return kept | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
