"""A path begins in a stored state of another run on the same mesh, at the loads it had there."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from conftest import ROOT
from stopped_runs import HEIGHT, Stop, contents, refused, reseal, solve
from stopped_runs import scene as quiet_scene

import dea_fenicsx as dea
from dea_fenicsx.cli.show import summary
from dea_fenicsx.scene.amounts import amounts_of, carried

pytestmark = pytest.mark.usefixtures("quick_compile")

SOFT = dea.Material(dea.NeoHookean(4e4), dea.IdealDielectric(3.0))


VOLTS = 2e4
"""At factor 1 [V]: the film becomes thinner by some per cent."""


def electrodes(volts, ramp="voltage"):
    return [dea.Electrode("top", volts, ramp), dea.Ground("bottom")]


def scene(*args, **changes):
    return quiet_scene(*args, **({"electrodes": electrodes(VOLTS)} | changes))


def run(given, to=1.0, steps=2, out=None, path=None, record=HEIGHT, **options):
    path = path or dea.Ramp("voltage", to=to, steps=steps)
    return solve(out, given, path, record, **options)


@pytest.fixture(scope="module")
def half(tmp_path_factory):
    """A run to half of the voltage, with its folder."""
    out = tmp_path_factory.mktemp("half") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DEA_FENICSX_CFLAGS", "-O1 -g0")
        return run(scene(), to=0.5, out=out)


@pytest.fixture(scope="module")
def whole(half):
    """The same scene at the whole voltage in one run."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DEA_FENICSX_CFLAGS", "-O1 -g0")
        return run(scene(), steps=4)


@pytest.mark.parametrize("start", ["folder", "run", "state"])
def test_a_longer_path(half, whole, start, tmp_path):
    """The first step is the stored state itself, and the end that of one run."""
    given = {"folder": half.out, "run": half, "state": half.problem.state}[start]
    before = contents(half.out)
    longer = run(scene(), out=tmp_path / "x", start=given)
    assert longer.history["voltage_V"] == pytest.approx([1e4, 1.5e4, 2e4], rel=1e-15)
    assert longer.history["newton_iterations"][0] == 0
    assert longer.history["h"][0] == pytest.approx(half["h"], rel=1e-12)
    assert longer["h"] == pytest.approx(whole["h"], rel=1e-9)
    told = dea.read_summary(tmp_path / "x")["start"]
    assert told["voltage_V"] == pytest.approx(1e4)
    assert abs(whole["h"] - half["h"]) > 0.01  # else the comparison would say little
    assert told["step"] == (None if start == "state" else 2)
    shown = summary(tmp_path / "x", dea.read_history(tmp_path / "x"))
    assert ("started from step 2 of" in shown) == (start != "state")
    assert contents(half.out) == before


def test_volts_stay_volts(half, whole):
    """Factor 1 is 40 kV here, so that the path begins at factor 1/4, and at= counts from there."""
    double = scene(electrodes=electrodes(2 * VOLTS))
    path = dea.Ramp("voltage", to=0.5, at=(0.3, 0.4))
    found = run(double, path=path, start=half.out)
    assert found.history["voltage_V"][0] == pytest.approx(1e4, rel=1e-12)
    assert {1.2e4, 1.6e4} <= set(np.round(found.history["voltage_V"], 6))
    assert found["h"] == pytest.approx(whole["h"], rel=1e-9)
    refused(lambda: run(double, path=dea.Ramp("voltage", to=0.5, at=(0.2,)), start=half.out),
            "it goes from 0.25 to 0.5")  # fmt: skip


def test_a_trace_begins_there(half, whole):
    trace = dea.Trace("voltage", first=0.1, until=("voltage_V", VOLTS))
    assert run(scene(), path=trace, start=half.out)["h"] == pytest.approx(whole["h"], rel=1e-6)


def test_another_modulus(half):
    """Brought to equilibrium at the stored load first, at the modulus of this scene."""
    direct = run(scene(film=SOFT))
    begun = run(scene(film=SOFT), start=half.out)
    at_half = run(scene(film=SOFT), to=0.5)
    assert begun.history["h"][0] == pytest.approx(at_half["h"], rel=1e-9)
    assert begun.history["newton_iterations"][0] > 0
    assert begun["h"] == pytest.approx(direct["h"], rel=1e-9)
    assert abs(at_half["h"] - run(scene(), to=0.5)["h"]) > 1e-3


def test_another_load(half):
    """A new ramp begins at 0."""
    loaded = scene(loads=[dea.DeadLoad("top", (0.0, -5e3))])
    path = [dea.Ramp("load", steps=2), dea.Ramp("voltage", steps=2)]
    begun = run(loaded, path=path, start=half.out)
    assert begun.history["load_factor"][0] == 0
    assert begun.history["voltage_V"][0] == pytest.approx(1e4)
    assert begun["h"] == pytest.approx(run(loaded, path=path)["h"], rel=1e-9)


def test_other_supports(half):
    """One side is held from here on, at its place in the mesh: it has to come back."""
    held = scene(supports=[dea.Clamp("bottom"), dea.Fix("x_min", "x")])
    assert run(held, start=half.out)["h"] == pytest.approx(run(held)["h"], rel=1e-9)


def test_a_prescribed_stretch(tmp_path):
    """Stretched by 20 %, then held there by a scene whose stretch is 50 % at factor 1."""

    def pulled(stretch, ramp="stretch"):
        return scene(
            electrodes=[], supports=[dea.Fix("x_min", "x"), dea.Fix("bottom", "y")],
            prescribed=[dea.Stretch("x_max", "x", stretch, ramp)],
        )  # fmt: skip

    ramp = dea.Ramp("stretch", steps=2)
    first = run(pulled(1.2), path=ramp, out=tmp_path)
    assert first["h"] == pytest.approx(1 / 1.2, rel=1e-8)  # constant volume in the plane
    further = run(pulled(1.5), path=ramp, start=first)
    assert further.history["stretch_factor"][0] == pytest.approx(0.4, rel=1e-12)
    assert further.history["h"][0] == pytest.approx(1 / 1.2, rel=1e-8)
    assert further["h"] == pytest.approx(1 / 1.5, rel=1e-8)
    assert further.history["newton_iterations"][0] == 0
    missing = refused(
        lambda: run(pulled(1.5, "pull"), path=dea.Ramp("pull"), start=tmp_path), "'stretch'"
    )
    assert "no such ramp" in missing


def test_a_started_run_is_resumed(half, whole, tmp_path):
    """From its own folder; the state that it began in is not read again."""
    again = shutil.copytree(half.out, tmp_path / "half")
    record = HEIGHT | {"s": Stop(1)}
    with pytest.raises(dea.Interrupted):
        run(scene(), out=tmp_path / "x", start=again, record=record)
    refused(lambda: run(scene(), out=tmp_path / "x", resume=True, record=record),
            "it began in another run")  # fmt: skip
    shutil.rmtree(again)
    record = HEIGHT | {"s": Stop(-1)}
    found = run(scene(), out=tmp_path / "x", start=again, resume=True, record=record)
    assert found["h"] == pytest.approx(whole["h"], rel=1e-9) and len(found.history) == 3
    assert found.summary["start"]["folder"] == str(again)


def test_into_the_same_folder(half, whole, tmp_path):
    """The run that is started from moves to previous/, as any earlier run does."""
    out = shutil.copytree(half.out, tmp_path / "out")
    assert run(scene(), out=out, start=out)["h"] == pytest.approx(whole["h"], rel=1e-9)
    assert dea.read_history(out / "previous")["h"][-1] == pytest.approx(half["h"])


def test_no_equilibrium_there(half, tmp_path):
    """A film so soft that half of the voltage pulls it in."""
    weak = scene(film=dea.Material(dea.NeoHookean(500.0), dea.IdealDielectric(3.0)))
    with pytest.raises(dea.SolverError, match="No equilibrium of this scene was found") as caught:
        run(weak, out=tmp_path, start=half.out)
    assert str(caught.value).count("\n") == 0
    told = dea.read_summary(tmp_path)
    assert told["status"] == "solver failed" and told["steps"] == 0
    assert caught.value.run.history == []


# ------------------------------------------------------------------------------- what is refused

OTHERS = {
    "a finer mesh": (dict(cells=3), "is on another mesh"),
    "a larger mesh": (dict(length=2e-3), "is on another mesh"),
    "no potential": (
        dict(electrodes=[], loads=[dea.DeadLoad("top", (0.0, 1.0), "voltage")]),
        "which differ in phi"),
    "another pressure": (
        dict(elements=dea.Discretisation(pressure="continuous")), "which differ in p"),
    "one field more": (
        dict(kinematics=dea.GeneralisedPlaneStrain(1e-3)), "which differ in global"),
    "no such ramp": (
        dict(electrodes=electrodes(VOLTS, "drive")),
        "no such ramp"),
    "another quantity": (
        dict(electrodes=electrodes(VOLTS, "v"),
             loads=[dea.DeadLoad("top", (0.0, 1.0), "voltage")]),
        "factor 0.5 of 20000 volts in the run to start from, but drives 1 pascal here"),
}  # fmt: skip


@pytest.mark.parametrize("other", OTHERS)
def test_what_does_not_fit_is_refused(half, tmp_path, other):
    """And what is in the folder of this run stays as it is."""
    changes, words = OTHERS[other]
    shutil.copytree(half.out, tmp_path / "out")
    before = contents(tmp_path / "out")
    given = scene(**changes)
    path = dea.Ramp(given.ramps)
    refused(lambda: run(given, path=path, out=tmp_path / "out", start=half.out), words)
    assert contents(tmp_path / "out") == before


MADE_UP = {
    "no factors": lambda state, told: told.pop("factors"),
    "factors of text": lambda state, told: told.update(factors={"voltage": "1"}),
    "factors that are infinite": lambda state, told: told.update(factors={"voltage": 1e999}),
    "another ramp": lambda state, told: told.update(factors={"volts": 0.5}),
    "an earlier version": lambda state, told: told.pop("about"),
    "no units": lambda state, told: told["about"].pop("units"),
    "units of nothing": lambda state, told: told["about"]["units"].update(p=0.0),
    "units of text": lambda state, told: told["about"]["units"].update(p="x"),
    "amounts of text": lambda state, told: told["about"]["amounts"]["voltage"].update(volts="x"),
    "no amounts": lambda state, told: told["about"]["amounts"]["voltage"].update(volts=[]),
    "fields of text": lambda state, told: told["about"].update(fields="u, p, phi"),
    "no step": lambda state, told: told["cursor"].update(step="2"),
    "no fingerprint": lambda state, told: told.update(fingerprint=None),
    "a mesh of numbers": lambda state, told: told["fingerprint"].update(mesh=3),
}


@pytest.mark.parametrize("what", MADE_UP)
def test_a_checkpoint_that_was_made_up(half, tmp_path, what):
    out = shutil.copytree(half.out, tmp_path / "out")
    reseal(out / "checkpoint.npz", lambda arrays, told: MADE_UP[what](arrays["state"], told))
    refused(lambda: run(scene(), start=out), "")


def test_states_that_are_damaged(half, tmp_path):
    out = shutil.copytree(half.out, tmp_path / "out")
    file = out / "checkpoint.npz"
    whole_file = file.read_bytes()
    for change in (lambda s: s[:-1], lambda s: s[:, :-1], lambda s: s * np.nan):

        def other(arrays, told, change=change):
            arrays["state"] = change(arrays["state"])
            arrays.pop("earlier")  # they would not be tables like that of the state

        reseal(file, other)
        refused(lambda: run(scene(), start=out), "holds no state of its own mesh")
        file.write_bytes(whole_file)
    with np.load(file) as data:
        state, told, seal = data["state"], str(data["told"]), str(data["digest"])
    np.savez(file, state=state * 1.001, told=told, digest=seal)
    refused(lambda: run(scene(), start=out), "changed after it was written")
    file.write_bytes(whole_file[: len(whole_file) // 2])
    refused(lambda: run(scene(), start=out), "is no checkpoint of this package")
    file.unlink()
    refused(lambda: run(scene(), start=out), "there is no such file")
    refused(lambda: run(scene(), start=tmp_path / "nowhere"), "is no folder of a run")
    refused(lambda: run(scene(), start=""), "an empty name")
    refused(lambda: run(scene(), start=3.0), "start= the folder of a run")
    refused(lambda: run(scene(cells=3), start=half.problem.state), "none of this scene")


def test_an_unknown_keyword():
    refused(lambda: run(scene(), begin="x"), "solve takes no keyword 'begin'")
    with pytest.raises(dea.InputError, match="did you mean 'resume'"):
        run(scene(), resumed=True)


# ------------------------------------------------------------------------------------ amounts


def test_amounts_of_ramps():
    given = scene(loads=[dea.DeadLoad("top", (1.0, -2e3)), dea.FollowerPressure("x_max", 5.0)],
                  prescribed=[dea.Displacement("x_min", "x", 1e-4, "push")])  # fmt: skip
    assert amounts_of(given) == {
        "push": {"metres": [1e-4]}, "load": {"pascal": [1.0, -2e3, 5.0]},
        "voltage": {"volts": [VOLTS]},
    }  # fmt: skip


def test_factors_that_are_carried():
    both = {"volts": [100.0], "pascal": [3.0, -6.0]}
    assert carried("r", 0.5, both, {"volts": [50.0], "pascal": [1.5, -3.0]}) == 1.0
    assert carried("r", 0.0, both, {"newtons": [1.0]}) == 0.0
    assert carried("r", 0.5, {}, {}) == 0.5
    for other in ({"volts": [50.0], "pascal": [3.0, -6.0]}, {"volts": [1.0]}, {},
                  {"volts": [0.0], "pascal": [0.0]}):  # fmt: skip
        with pytest.raises(dea.InputError):
            carried("r", 0.5, both, other)


# -------------------------------------------------------------------------------------- ranks

RANKS = """
import sys
sys.path.insert(0, sys.argv[1])
from mpi4py import MPI
from stopped_runs import HEIGHT, dea, scene
comm = MPI.COMM_WORLD
start, to, out = (None if a == "-" else a for a in sys.argv[2:])
given = scene(comm, electrodes=[dea.Electrode("top", 2e4), dea.Ground("bottom")])
run = dea.solve(given, dea.Ramp(to=float(to), steps=2), HEIGHT, out, start=start, quiet=True)
if comm.rank == 0:
    print(repr(run["h"]))
"""


@pytest.mark.mpi
@pytest.mark.parametrize(("before", "after"), [(2, 1), (1, 3)])
def test_on_other_ranks(half, whole, start, tmp_path, before, after):
    """The state goes from two ranks to one, and to more ranks than cells."""
    script = tmp_path / "script.py"
    script.write_text(RANKS)
    out = half.out
    if before > 1:
        out = tmp_path / "half"
        start(script, ROOT / "tests", "-", 0.5, out, ranks=before, check=True)
    done = start(script, ROOT / "tests", out, 1.0, tmp_path / "x", ranks=after, check=True)
    assert float(done.stdout.split()[-1]) == pytest.approx(whole["h"], rel=1e-9)


@pytest.mark.mpi
def test_refused_on_two_ranks(start, tmp_path):
    """With the status of wrong input, and one sentence."""
    script = tmp_path / "script.py"
    script.write_text(RANKS)
    done = start(script, ROOT / "tests", tmp_path / "nowhere", 1.0, "-", ranks=2)
    assert done.returncode == 2 and "is no folder of a run" in done.stdout + done.stderr
    assert "Traceback" not in done.stderr


