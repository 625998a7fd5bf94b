"""A small run, whole and interrupted, for the tests of what is on disk."""

from __future__ import annotations

import json
import signal

import numpy as np
import pytest
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.results import checkpoint

FILM = dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(3.0))
HEIGHT = {"h": dea.MeanStretch(("bottom", "top"), "y")}


def scene(comm=MPI.COMM_SELF, length=1e-3, film=FILM, cells=2, **changes):
    device = dea.read_gmsh(
        BoxStack(length, None, [Layer("film", length)], divisions=(cells,)), comm
    )
    given = dict(
        electrodes=[dea.Electrode("top", 3e3), dea.Ground("bottom")],
        supports=[dea.Clamp("bottom")], kinematics=dea.PlaneStrain(1e-3),
    )  # fmt: skip
    return dea.Scene(device, {"film": film}, **(given | changes))


class Stop:
    """Interrupts the run at a step, and measures nothing."""

    unit = ""

    def __init__(self, step=2):
        self.step = step

    def bind(self, problem):
        count = iter(range(1000))

        def measure():
            if next(count) == self.step:
                signal.raise_signal(signal.SIGINT)
            return 0.0

        return measure


class StopAtState:
    """Interrupts a run at its n-th state, without a signal, and measures nothing before."""

    unit = ""
    texts = "stop"

    def __init__(self, calls):
        self.left = calls

    def bind(self, problem):
        def value():
            self.left -= 1
            if self.left == 0:
                raise dea.Interrupted("stopped by the test")
            return 0.0

        return value


def solve(out, given=None, path=None, record=None, **options):
    path = path or dea.Ramp(steps=4)
    record = HEIGHT | {"s": Stop(-1)} if record is None else record
    return dea.solve(given or scene(), path, record, out, quiet=True, **options)


def reseal(file, change):
    """Change what a checkpoint holds, and seal it anew: `change` gets its arrays and its text."""
    with np.load(file) as data:
        arrays = {name: data[name] for name in data if name not in ("told", "digest")}
        told = json.loads(str(data["told"]))
    change(arrays, told)
    text = json.dumps(told)
    seal = checkpoint.digest(arrays["state"], text, arrays.get("earlier"))
    np.savez(file, **arrays, told=text, digest=seal)


def contents(folder):
    return {
        p.relative_to(folder): p.read_bytes() if p.is_file() else b""
        for p in sorted(folder.rglob("*"))
    }


def refused(make, words):
    with pytest.raises(dea.InputError) as caught:
        make()
    text = str(caught.value)
    assert words in text and text.endswith(".") and "\n" not in text and len(text) < 400, text
    return text
