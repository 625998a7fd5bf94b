"""Runs: resumed, on several ranks, in bad folders; and settings that must be refused."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from conftest import ROOT, clean_environment

import dea_fenicsx as dea
from dea_fenicsx.support import subprocesses
from hard.films import run
from hard.table import (
    COMPLETED,
    LIMIT,
    LOST,
    MU,
    REFUSED,
    RUBBER,
    UNIT,
    Z,
    case,
    close,
    film,
    strip,
)


@case("resuming a finished run")
def finished():
    with tempfile.TemporaryDirectory() as out:
        first = run(film(volts=0.9 * LIMIT), dea.Ramp(steps=2), out=out)
        again = run(film(volts=0.9 * LIMIT), dea.Ramp(steps=2), out=out, resume=True)
        assert again.history == first.history, "the history has changed"
        assert dea.read_summary(out)["status"] == "completed"
    return close(again["z"], first["z"], 1e-15, "stretch")


@case("resuming after pull-in", LOST)
def after_pull_in():
    """It ends once more, at the same load, with nothing added."""
    with tempfile.TemporaryDirectory() as out:
        try:
            run(film(volts=1.25 * LIMIT), dea.Ramp(steps=6), out=out)
        except dea.EquilibriumLost as error:
            steps = len(error.run.history)
        try:
            run(film(volts=1.25 * LIMIT), dea.Ramp(steps=6), out=out, resume=True)
        except dea.EquilibriumLost as error:
            assert 0 <= len(error.run.history) - steps <= 2
            reached = error.run.history[-1]["voltage_V"]
            assert 0.99 * LIMIT < reached < LIMIT * (1 + 1e-6), f"{reached:.6g} V is accepted"
            assert dea.read_summary(out)["status"] == "equilibrium lost"
            raise


@case("resuming with another material", REFUSED, "its materials is not this script's", 0)
@case("resuming with other loads", REFUSED, "its loads is not this script's", 1)
@case("resuming with other supports", REFUSED, "its supports is not this script's", 2)
def other(which):
    changed = [
        film(dea.NeoHookean(2 * MU), 100.0),
        film(volts=100.0, load=1.0),
        film(volts=100.0, supports=[dea.Fix("bottom", "z"), dea.Fix("x_min", "r")]),
    ][which]
    with tempfile.TemporaryDirectory() as out:
        run(film(volts=100.0), dea.Ramp(steps=1), out=out)
        run(changed, dea.Ramp(steps=1), out=out, resume=True)


@case("resuming from a broken checkpoint", REFUSED, "is no checkpoint of this package")
def broken():
    with tempfile.TemporaryDirectory() as out:
        run(film(volts=100.0), dea.Ramp(steps=1), out=out)
        file = Path(out) / "checkpoint.npz"
        file.write_bytes(file.read_bytes()[:-200])
        run(film(volts=100.0), dea.Ramp(steps=1), out=out, resume=True)


@case("a results folder that is a file", REFUSED, "cannot be written")
def folder():
    with tempfile.NamedTemporaryFile() as file:
        run(film(volts=100.0), dea.Ramp(steps=1), out=file.name)


SPLIT = """
import sys
import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
film = dea.Material(dea.NeoHookean(50e3), dea.IdealDielectric(2.86))
device = dea.read_gmsh(BoxStack(1e-3, None, [Layer("film", 1e-3)], divisions=({cells},)))
scene = dea.Scene(device, {{"film": film}}, kinematics=dea.Axisymmetric(),
    electrodes=[dea.Electrode("top", {volts!r}), dea.Ground("bottom")],
    supports=[dea.Fix("x_min", "r"), dea.Fix("bottom", "z")],
    loads=[dea.DeadLoad("x_max", (0.0, 0.0))])
run = dea.solve(scene, dea.Ramp(steps=3), {{"z": dea.MeanStretch(("bottom", "top"), "z")}},
    quiet=True)
if device.comm.rank == 0:
    print(repr(run["z"]))
"""


@case("3 ranks, two of them empty", COMPLETED, "", 1, 3)
@case("3 ranks, one of them empty", COMPLETED, "", 2, 3)
def ranks(cells, count):
    volts = 0.97 * LIMIT
    alone = run(film(volts=volts, device=strip((cells, 1))), dea.Ramp(steps=3))["z"]
    mpirun = subprocesses.mpirun()
    assert mpirun, "there is no mpirun"
    done = subprocess.run(
        [mpirun, "-n", str(count), sys.executable, "-c",
         SPLIT.format(cells=cells, volts=float(volts))],
        capture_output=True, text=True, cwd=ROOT, env=clean_environment(),
        stdin=subprocess.DEVNULL, timeout=100,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-300:]
    return close(float(done.stdout), alone, 1e-9, "stretch")


for _label, _words, _make in (
    ("NaN voltage", "is nan", lambda: film(volts=np.nan)),
    ("lock-up of 0", "Jm is 0", lambda: film(dea.Gent(MU, 0.0), 1.0)),
    ("bulk modulus below 2/3 of shear", "bulk_modulus is", lambda: film(volts=1.0, bulk=MU / 2)),
    ("augmentation 100000", "augmentation is",
     lambda: film(volts=1.0, elements=dea.Discretisation(augmentation=1e5))),
    ("no electrode without a charge", "add a Ground",
     lambda: film(electrodes=[dea.ChargedElectrode("top", 1e-9)])),
    ("a support on an axis that is not there", "names the axes 'x'",
     lambda: film(volts=1.0, supports=[dea.Fix("bottom", "x")])),
):  # fmt: skip

    @case(f"input: {_label}", REFUSED, _words, _make)
    def refused(make):
        run(make(), dea.Ramp(steps=1))


@case("input: a trace without a first step", REFUSED, "first step other than 0")
def still():
    run(film(RUBBER, UNIT), dea.Trace("voltage", first=0.0))


@case("input: a ramp to NaN", REFUSED, "is nan")
def ramp_to_nan():
    run(film(RUBBER, UNIT), dea.Ramp(to=float("nan")), Z)
