"""Damaged files by the hundred: each is read, or refused in one sentence."""

from __future__ import annotations

import subprocess
import sys

import pytest
from conftest import ROOT, clean_environment

COUNT, SEED = 500, 20

pytest.importorskip("pyvista")


def test_damaged_files():
    """In a process of its own, for it forks, and must have nothing else running."""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-m", "tests.fuzz.readers", f"--count={COUNT}",
         f"--seed={SEED}"],
        cwd=ROOT, env=clean_environment() | {"DEA_FENICSX_CFLAGS": "-O1 -g0"}, text=True,
        capture_output=True, stdin=subprocess.DEVNULL, timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{COUNT} trials, 0 faults" in done.stdout
    # each kind of file was tried, and neither all nor none of them could be read
    for kind in ("history", "summary", "xdmf", "hdf5", "checkpoint"):
        for outcome in ("read", "refused"):
            assert f"{kind}: {outcome}" in done.stdout
