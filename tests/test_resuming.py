"""A run is carried on by the same run only, and from a checkpoint that is whole only."""

from __future__ import annotations

import json
import shutil
import time
import zipfile
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import pytest
from conftest import ROOT
from numpy.lib import format as npy
from stopped_runs import HEIGHT, Stop, contents, refused, reseal, scene, solve

import dea_fenicsx as dea
from dea_fenicsx.results import checkpoint, checkpoint_contents, columns

pytestmark = pytest.mark.usefixtures("quick_compile")


@pytest.fixture(scope="module")
def stopped(tmp_path_factory):
    """A run that was interrupted at its third step of five."""
    out = tmp_path_factory.mktemp("stopped") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DEA_FENICSX_CFLAGS", "-O1 -g0")
        with pytest.raises(dea.Interrupted):
            solve(out, record=HEIGHT | {"s": Stop()})
    return out


@pytest.fixture(scope="module")
def whole(stopped):
    """The same run, not interrupted."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DEA_FENICSX_CFLAGS", "-O1 -g0")
        return solve(None)


@pytest.fixture
def cut(stopped, tmp_path):
    return shutil.copytree(stopped, tmp_path / "cut")


def test_resumed_by_the_same_run(cut, whole):
    """With numbers of other kinds, too: they are the same numbers."""
    same = scene(
        electrodes=[dea.Electrode("top", np.int64(3000)), dea.Ground("bottom")],
        kinematics=dea.PlaneStrain(Fraction(1, 1000)),
    )
    run = solve(cut, same, path=dea.Ramp(steps=np.int32(4)), resume=True)
    assert run.summary["status"] == "completed" and len(run.history) == 5
    assert run["h"] == pytest.approx(whole["h"], rel=1e-9)


@dataclass(frozen=True)
class Twice:
    """An observable of the user's: twice the displacement of a surface."""

    where: str
    unit = "m"

    def bind(self, problem):
        one = dea.MeanDisplacement(self.where, "y").bind(problem)
        return lambda: 2 * one()


class Plain:
    """The same without declared fields."""

    unit = ""

    def __init__(self, factor):
        self.factor = factor

    def bind(self, problem):
        one = HEIGHT["h"].bind(problem)
        return lambda: self.factor * one()


OTHERS = {
    "a larger mesh": (dict(given=lambda: scene(length=5e-3)), "its mesh is not"),
    "a finer mesh": (dict(given=lambda: scene(cells=3)), "its mesh is not"),
    "other volts": (
        dict(given=lambda: scene(electrodes=[dea.Electrode("top", 2e3), dea.Ground("bottom")])),
        "its electrodes is not"),
    "another depth": (
        dict(given=lambda: scene(kinematics=dea.PlaneStrain(2e-3))), "its kinematics is not"),
    "another modulus": (
        dict(given=lambda: scene(film=dea.Material(dea.NeoHookean(5e4 * (1 + 1e-9)),
                                                   dea.IdealDielectric(3.0)))),
        "its materials is not"),
    "another path": (dict(path=dea.Ramp(steps=5)), "its path is not"),
    "another failure": (dict(failures=[dea.StretchLimit(3.0)]), "its failures is not"),
    "one more record": (
        dict(record=HEIGHT | {"s": Stop(-1), "q": dea.Charge("top")}), "'q_C'"),
    "one record less": (dict(record=HEIGHT), "'s'"),
    "a record of other surfaces": (
        dict(record={"h": dea.MeanStretch(("x_min", "x_max"), "x"), "s": Stop(-1)}), "'h'"),
    "a record of another class": (
        dict(record={"h": dea.Contraction(("bottom", "top"), "y"), "s": Stop(-1)}), "'h'"),
    "a record with another unit": (dict(record={"h": Twice("top"), "s": Stop(-1)}), "'h_m'"),
    "a record of the user's": (dict(record={"h": Plain(1.0), "s": Stop(-1)}), "'h'"),
}  # fmt: skip


@pytest.mark.parametrize("other", OTHERS)
def test_another_run_is_not_resumed(cut, other):
    changes, words = OTHERS[other]
    before = contents(cut)
    changes = dict(changes)
    given = changes.pop("given", scene)()
    told = refused(lambda: solve(cut, given, resume=True, **changes), words)
    assert "cannot be resumed" in told
    assert contents(cut) == before
    assert dea.read_summary(cut)["status"] == "interrupted"


def test_a_plain_class_is_known_by_what_it_measures(tmp_path):
    """Nothing declares its attributes, so its value on the last state is compared."""
    with pytest.raises(dea.Interrupted):
        solve(tmp_path, record={"x": Plain(2.0), "s": Stop()})
    refused(lambda: solve(tmp_path, resume=True, record={"x": Plain(3.0), "s": Stop(-1)}), "'x'")
    again = solve(tmp_path, resume=True, record={"x": Plain(2.0), "s": Stop(-1)})
    assert again.summary["status"] == "completed"


class Clock(Stop):
    """Measures something else than the state, and says so."""

    of_the_state = False

    def bind(self, problem):
        stop = super().bind(problem)
        return lambda: stop() + time.monotonic()


def test_what_is_not_of_the_state_is_not_compared(tmp_path):
    with pytest.raises(dea.Interrupted):
        solve(tmp_path, record={"s": Clock()})
    assert solve(tmp_path, resume=True, record={"s": Clock(-1)}).summary["status"] == "completed"


def test_surfaces_that_changed_their_names(cut):
    given = scene()
    names = given.device.surfaces
    names["x_min"], names["x_max"] = names["x_max"], names["x_min"]
    refused(lambda: solve(cut, given, resume=True), "its mesh is not")


RANKS = """
import sys
sys.path.insert(0, sys.argv[1])
from mpi4py import MPI
from stopped_runs import HEIGHT, Stop, dea, scene
comm = MPI.COMM_WORLD
given = scene(comm)
run = dea.solve(given, dea.Ramp(steps=4), HEIGHT | {"s": Stop(-1)}, sys.argv[2], resume=True,
                quiet=True)
if comm.rank == 0:
    print(len(run.history), repr(run["h"]))
"""


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_resumed_on_other_ranks(cut, whole, start, tmp_path, ranks):
    """The mesh is the same however it is distributed, with more ranks than cells, too."""
    script = tmp_path / "script.py"
    script.write_text(RANKS)
    done = start(script, ROOT / "tests", cut, ranks=ranks, check=True)
    steps, height = done.stdout.split()[-2:]
    assert int(steps) == 5
    assert float(height) == pytest.approx(whole["h"], rel=1e-8)


# ------------------------------------------------------------------------- checkpoints, made up


def cursor(**changed):
    return lambda state, told: told["cursor"].update(changed)


def load(factors):
    return lambda state, told: told.update(factors=factors)


def row(number, **changed):
    return lambda state, told: told["history"][number].update(changed)


def finished(state, told):
    """Two steps are said to have ended the path, wherever that is told."""
    told["cursor"]["position"] = told["history"][-1]["time"] = 1.0
    told["factors"] = {"voltage": 1.0}
    told["history"][-1]["voltage_V"] = 3e3


MADE_UP = {
    "no cursor": lambda state, told: told.pop("cursor"),
    "no history": lambda state, told: told.pop("history"),
    "no references": lambda state, told: told.pop("references"),
    "no failures": lambda state, told: told.pop("failures"),
    "no seconds": lambda state, told: told.pop("wall_s"),
    "ramp 99": cursor(ramp=99),
    "ramp -1": cursor(ramp=-1),
    "ramp 0.5": cursor(ramp=0.5),
    "position NaN": cursor(position=float("nan")),
    "position 1": cursor(position=1.0),
    "position text": cursor(position="0.5"),
    "size infinite": cursor(size=float("inf")),
    "no factors": load({}),
    "other factors": load({"voltage": 0.75}),
    "factors of another ramp": load({"volts": 0.5}),
    "factors of text": load({"voltage": "x"}),
    "another start": cursor(start={"voltage": 0.25}),
    "a step further": cursor(step=4),
    "one thing more": cursor(more=1),
    "a memory of text": cursor(memory="x"),
    "a memory without names": cursor(memory={}),
    "an empty history": lambda state, told: told["history"].clear(),
    "a row less": lambda state, told: told["history"].pop(0),
    "a row of nothing": lambda state, told: told["history"].insert(1, None),
    "a column less": lambda state, told: told["history"][1].pop("min_J"),
    "a column of lists": row(1, min_J=[1.0]),
    "a text for a number": row(1, h="x"),
    "no number of iterations": row(1, newton_iterations=None),
    "iterations of NaN": row(1, krylov_iterations=float("nan")),
    "factors without end": row(1, factorisations=float("inf")),
    "half an iteration": row(1, newton_iterations=0.5),
    "iterations below 0": row(1, newton_iterations=-1),
    "steps that fall": row(1, step=2),
    "times that fall": row(1, time=-1.0),
    "other volts": row(-1, voltage_V=1.0),
    "references below 0": lambda state, told: told["references"].update(u=-1.0),
    "references of nothing": lambda state, told: told["references"].update(x=1.0),
}
MADE_UP_STATES = {
    "position 1": cursor(position=1.0),
    "no fingerprint": lambda state, told: told.pop("fingerprint"),
    "no format": lambda state, told: told.pop("format"),
    "another height": row(-1, h=0.5),
    "done already": finished,
    "a state of zeros": lambda state, told: state.fill(0.0),
    "a state of NaN": lambda state, told: state.fill(np.nan),
    "a state that is off": lambda state, told: np.multiply(state, 1 + 1e-5, out=state),
}


def test_checkpoints_made_up(stopped, whole):
    """What does not agree with itself and with the path is not usable."""
    told, _ = checkpoint.read(stopped / "checkpoint.npz")
    record = HEIGHT | {"s": Stop(-1)}
    known = columns.names(whole.problem.scene, record, [], True)
    arguments = (whole.problem.scene, [dea.Ramp(steps=4)], known, ["u", "p", "phi"])
    assert checkpoint_contents.cursor_of(told, *arguments).step == 2
    for what, change in MADE_UP.items():
        other = json.loads(json.dumps(told))
        change(None, other)
        with pytest.raises(checkpoint_contents.Unusable):
            checkpoint_contents.cursor_of(other, *arguments)
            pytest.fail(what)


EARLIER = {
    "nothing told": lambda arrays, told: told.pop("earlier"),
    "told of nothing": lambda arrays, told: arrays.pop("earlier"),
    "one less": lambda arrays, told: told["earlier"].pop(),
    "text": lambda arrays, told: told.update(earlier="x"),
    "a list of text": lambda arrays, told: told.update(earlier=["x"] * len(told["earlier"])),
    "no load": lambda arrays, told: told["earlier"][0].pop("factors"),
    "another load": lambda arrays, told: told["earlier"][0].update(factors={"volts": 0.0}),
    "an infinite load": lambda arrays, told: told["earlier"][0].update(factors={"voltage": 1e999}),
    "no time": lambda arrays, told: told["earlier"][0].update(moment=3),
    "other cells": lambda arrays, told: arrays.update(earlier=arrays["earlier"][:, :-1]),
    "a single table": lambda arrays, told: arrays.update(earlier=arrays["earlier"][0]),
    "too many": lambda arrays, told: arrays.update(earlier=np.repeat(arrays["earlier"], 99, 0)),
    "no numbers": lambda arrays, told: arrays.update(earlier=arrays["earlier"] * 1j),
    "NaN": lambda arrays, told: arrays["earlier"].fill(np.nan),
}


@pytest.mark.parametrize("what", EARLIER)
def test_made_up_earlier_states(cut, what):
    reseal(cut / "checkpoint.npz", EARLIER[what])
    before = contents(cut)
    refused(lambda: solve(cut, resume=True), "")
    assert contents(cut) == before


@pytest.mark.parametrize("what", MADE_UP_STATES)
def test_a_made_up_checkpoint(cut, what):
    """All is sealed anew, so that it is what it says that counts."""
    reseal(cut / "checkpoint.npz", lambda arrays, told: MADE_UP_STATES[what](arrays["state"], told))
    before = contents(cut)
    refused(lambda: solve(cut, resume=True), "")
    assert contents(cut) == before


def test_a_checkpoint_of_an_earlier_version(cut, whole):
    """What a version has added, and the script leaves out, does not make it another run."""

    def older(arrays, told):
        for material in told["fingerprint"]["materials"].values():
            del material["thermal"], material["damage"]
        assert "degree" not in told["fingerprint"]["elements"]
        del arrays["earlier"], told["earlier"]

    reseal(cut / "checkpoint.npz", older)
    assert solve(cut, resume=True)["h"] == pytest.approx(whole["h"], rel=1e-12)


def test_a_checkpoint_that_was_changed(cut):
    """What no other check can see, the digest does."""
    file = cut / "checkpoint.npz"
    with np.load(file) as data:
        arrays, told = dict(data), json.loads(str(data["told"]))
    told["references"]["u"] *= 1e6
    np.savez(file, **arrays | {"told": json.dumps(told)})
    refused(lambda: solve(cut, resume=True), "was changed after it was written")


def test_states_of_other_sizes_and_kinds(cut):
    file = cut / "checkpoint.npz"
    with np.load(file) as data:
        state, text = data["state"], str(data["told"])
    for other in (state[:-1], state[:, :-1], state.ravel(), state.astype(complex), state[:0],
                  np.array([None, {}], dtype=object)):  # fmt: skip
        np.savez(file, state=other, told=text, digest="")
        refused(lambda: solve(cut, resume=True), "")


def test_a_checkpoint_larger_than_its_file(cut):
    """Neither a compressed one, which could be of any size, nor a head that promises more."""
    file = cut / "checkpoint.npz"
    with np.load(file) as data:
        text = str(data["told"])
    np.savez_compressed(file, state=np.zeros((10_000, 500)), told=text)
    assert file.stat().st_size < 100_000
    refused(lambda: solve(cut, resume=True), "is compressed")
    np.savez(file, told=text)
    with zipfile.ZipFile(file, "a") as archive, archive.open("state.npy", "w") as member:
        npy.write_array_header_1_0(
            member, {"descr": "<f8", "fortran_order": False, "shape": (10**12, 7)}
        )
    refused(lambda: solve(cut, resume=True), "is not as long as it says")


def test_links_in_a_folder_are_not_followed(cut, tmp_path):
    outside = tmp_path / "outside"
    outside.mkdir()
    victim = tmp_path / "victim"
    victim.write_text("mine")
    (cut / ".checkpoint.npz.new").symlink_to(victim)
    (cut / ".summary.json.new").symlink_to(victim)
    (cut / "run.log").unlink()
    (cut / "run.log").symlink_to(victim)
    assert solve(cut, resume=True).summary["status"] == "completed"
    assert victim.read_text() == "mine"
    (cut / "modes").symlink_to(outside)
    refused(lambda: solve(cut, resume=True), "is a link")
    assert not list(outside.iterdir())
