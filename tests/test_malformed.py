"""Malformed input by the hundred: one sentence each, on all ranks, and nothing on disk harmed.

Three tables.  What can never be right is tried in every field of every class.  What has the right
type and a wrong value is listed by hand, and is tried on two ranks as well.  Files are damaged at
random, and scenes put together at random.
"""

from __future__ import annotations

import functools
import inspect
import random
import subprocess
import sys
import time
from dataclasses import is_dataclass

import pytest
from conftest import ROOT, clean_environment, needed_mpirun
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from malformed_fields import FIELDS, RUBBER, scene, solve
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx import materials

NAN, INF = float("nan"), float("inf")
FLAGS = "-O1 -g0"  # those of the fixture quick_compile


def refused(make, words=""):
    """It raises InputError with one sentence, at once."""
    begun = time.monotonic()
    with pytest.raises(dea.InputError) as caught:
        make()
    text = str(caught.value)
    assert words in text
    assert text.endswith(".") and "\n" not in text and 10 < len(text) < 400, text
    assert time.monotonic() - begun < 10


# ---------------------------------------------------------- what is right in no field of any class

NEVER = (object, 1 + 2j, b"x", [None], 10**400, print)


def wrong_fields(kind):
    """Every field of a class with everything that is right in none, beside right ones."""
    make, right = FIELDS[kind]
    right = {} if kind is dea.Scene else right
    for name in inspect.signature(kind).parameters:
        for value in NEVER:
            yield name, functools.partial(make, **(right | {name: value}))


@pytest.mark.parametrize("kind", FIELDS, ids=lambda kind: kind.__name__)
def test_what_is_never_right(kind):
    for name, make in wrong_fields(kind):
        refused(make, name.removesuffix("s"))


def test_no_class_is_left_out():
    classes = {x for x in (getattr(dea, name) for name in dea.__all__) if inspect.isclass(x)}
    given = {c for c in classes if is_dataclass(c) and inspect.signature(c).parameters}
    # made by this package alone
    made = {dea.Device, dea.Run, dea.Modes, dea.FrequencyResponse, dea.Gradient, dea.Study,
            dea.Diagram, dea.Equilibrium, dea.KnockDown, dea.LawCheck, dea.DiscretisationError,
            dea.Plan}
    assert given - set(FIELDS) <= made


def test_there_are_hundreds():
    assert sum(1 for kind in FIELDS for _ in wrong_fields(kind)) > 1000
    assert len(VALUES) >= 60


# ------------------------------------------------------------------- right types and wrong values

E, G = dea.Electrode, dea.Ground
VALUES = {
    "no electrode's name": (lambda c: scene(c, electrodes=[E((), 1.0), G("bottom")]), "no group"),
    "one electrode, no list": (lambda c: scene(c, electrodes=E("top", 1.0)), "electrodes is"),
    "a ground alone, as text": (lambda c: scene(c, electrodes=["bottom"]), "electrodes is"),
    "volts as truth": (lambda c: scene(c, electrodes=[E("top", True), G("bottom")]), "is True"),
    "volts infinite": (lambda c: scene(c, electrodes=[E("top", INF), G("bottom")]), "is inf"),
    "an unnamed ramp": (
        lambda c: scene(c, electrodes=[E("top", 1.0, ramp=""), G("bottom")]), "empty name"),
    "charges only": (
        lambda c: scene(c, electrodes=[dea.ChargedElectrode("top", 1e-12)]), "add a Ground"),
    "a charge of NaN": (lambda c: scene(
        c, electrodes=[dea.ChargedElectrode("top", NAN), G("bottom")]), "is nan"),
    "a taper without width": (
        lambda c: scene(c, electrodes=[E("top", 1.0, taper=dea.Taper(0.0, 0.0, "x"))]), "two diff"),
    "a taper along z": (
        lambda c: scene(c, electrodes=[E("top", 1.0, taper=dea.Taper(0.0, 1.0, "z"))]), "one of"),
    "a thin film that is none": (
        lambda c: scene(c, electrodes=[dea.ThinFilm("top", 1.0, end=1e-3)]), "dielectric region"),
    "a thin film of no thickness": (
        lambda c: scene(c, electrodes=[dea.ThinFilm("film", 1.0, along="y")]), "two different"),
    "no materials": (lambda c: scene(c, materials={}), "no material"),
    "materials by number": (lambda c: scene(c, materials={1: RUBBER, "x": RUBBER}), "by name"),
    "materials in a list": (lambda c: scene(c, materials=[RUBBER]), "materials is"),
    "a conductor that drives": (lambda c: scene(c, materials={"film": dea.Material(
        dea.NeoHookean(5e4), dea.Conductor())}), "conducts, but is no electrode"),
    "a material without elasticity": (
        lambda c: scene(c, materials={"film": dea.Material(dea.IdealDielectric(3.0))}), "elastic"),
    "modulus zero": (
        lambda c: scene(c, materials={"film": dea.Material(dea.NeoHookean(0.0))}), "mu is 0.0"),
    "lock-up below 1": (lambda c: scene(
        c, materials={"film": dea.Material(dea.ArrudaBoyce(5e4, 0.5))}), "lam_m is 0.5"),
    "Ogden's terms do not pair": (lambda c: scene(
        c, materials={"film": dea.Material(dea.Ogden((1e4, 2e4), (2.0,)))}), "2 moduli and 1"),
    "Ogden without terms": (
        lambda c: scene(c, materials={"film": dea.Material(dea.Ogden((), ()))}), "Ogden"),
    "a negative breakdown field": (lambda c: scene(c, materials={"film": dea.Material(
        dea.NeoHookean(5e4), dea.IdealDielectric(3.0, -1.0))}), "breakdown"),
    "supports as text": (lambda c: scene(c, supports="bottom"), "supports is"),
    "a load as support": (lambda c: scene(c, supports=[dea.DeadPressure("top", 1.0)]), "supports"),
    "a support on a region": (lambda c: scene(c, supports=[dea.Clamp("film")]), "facet group"),
    "no axes": (lambda c: scene(c, supports=[dea.Fix("bottom", "")]), "names the axes ''"),
    "a stretch about too many points": (
        lambda c: scene(c, prescribed=[dea.Stretch("top", "y", 1.1, about=(0.0, 1.0))]), "one for"),
    "a stretch about nowhere": (
        lambda c: scene(c, prescribed=[dea.Stretch("top", "y", 1.1, about=NAN)]), "about="),
    "stretch below 0": (
        lambda c: scene(c, prescribed=[dea.Stretch("top", "y", -1.0)]), "must be > 0"),
    "stretch along z": (
        lambda c: scene(c, prescribed=[dea.Stretch("top", "z", 1.1)]), "axes 'z'"),
    "displacement infinite": (
        lambda c: scene(c, prescribed=[dea.Displacement("top", "y", -INF)]), "is -inf"),
    "a twist in the plane": (lambda c: scene(c, prescribed=[dea.Twist(1.0)]), "helical cells"),
    "a torque in the plane": (lambda c: scene(c, loads=[dea.Torque(1.0)]), "helical cells"),
    "an axial stretch in the plane": (
        lambda c: scene(c, prescribed=[dea.AxialStretch(1.1)]), "generalised plane strain"),
    "a load with three components": (
        lambda c: scene(c, loads=[dea.DeadLoad("top", (0.0, 1.0, 2.0))]), "3 components"),
    "a load with a NaN": (
        lambda c: scene(c, loads=[dea.DeadLoad("top", (0.0, NAN))]), "is nan"),
    "pressure on no such region": (
        lambda c: scene(c, loads=[dea.DeadPressure("top", 1.0, on="flim")]), "did you mean 'film'"),
    "kinematics of space": (lambda c: scene(c, kinematics=dea.ThreeD()), "3 dimensions"),
    "a helix in the plane": (lambda c: scene(c, kinematics=dea.Helical(1e-3)), "needs a hole"),
    "depth zero": (lambda c: scene(c, kinematics=dea.PlaneStrain(0.0)), "depth"),
    "kinematics as a class": (lambda c: scene(c, kinematics=dea.PlaneStrain), "kinematics is"),
    "a cubic potential": (
        lambda c: scene(c, elements=dea.Discretisation(potential_degree=3)), "must be 1 or 2"),
    "quadrature of degree 99": (
        lambda c: scene(c, elements=dea.Discretisation(quadrature_degree=99)), "between 2 and 12"),
    "a negative augmentation": (
        lambda c: scene(c, elements=dea.Discretisation(augmentation=-1.0)), "between 0"),
    "a device as a path": (lambda c: scene(c, device="strip.msh"), "device is"),
    "no path": (lambda c: solve(c, []), "empty"),
    "a path of numbers": (lambda c: solve(c, [1.0]), "path holds"),
    "a million and one steps": (lambda c: solve(c, dea.Ramp(steps=1_000_001)), "from 1 to"),
    "steps below 0": (lambda c: solve(c, dea.Ramp(steps=-1)), "from 1 to"),
    "a ramp to infinity": (lambda c: solve(c, dea.Ramp(to=INF)), "is inf"),
    "a landing at NaN": (lambda c: solve(c, dea.Ramp(at=(0.5, NAN))), "is nan"),
    "a ramp of another name": (lambda c: solve(c, dea.Ramp("voltag")), "did you mean 'voltage'"),
    "a trace that starts far out": (
        lambda c: solve(c, dea.Trace("voltage", first=1e300)), "first step"),
    "a trace of no steps": (lambda c: solve(c, dea.Trace("voltage", steps=0)), "first step"),
    "a trace that must know its stability": (
        lambda c: solve(c, dea.Trace("voltage", switch=0.1)), "stability"),
    "stability at whim": (lambda c: solve(c, stability="sometimes"), "must be one of"),
    "a tolerance of zero": (
        lambda c: solve(c, options=dea.NewtonOptions(tolerance=0.0)), "must lie between"),
    "three Newton iterations": (
        lambda c: solve(c, options=dea.NewtonOptions(max_iterations=3)), "at least 4"),
    "out without a name": (lambda c: solve(c, out=""), "empty name"),
    "out is a number": (lambda c: solve(c, out=3), "needs a path"),
    "resume as text": (lambda c: solve(c, out="x", resume="no"), "True or False"),
    "record as a list": (lambda c: solve(c, record=[dea.Charge("top")]), "dictionary"),
    "record without a name": (lambda c: solve(c, record={"": dea.Charge("top")}), "must be text"),
    "record of a class": (lambda c: solve(c, record={"Q": dea.Charge}), "such as Charge"),
    "charge of a ground": (lambda c: solve(c, record={"C": dea.Capacitance("bottom")}), "grounded"),
    "an axis of two letters": (
        lambda c: solve(c, record={"u": dea.MeanDisplacement("top", "xy")}), "axis is 'xy'"),
    "an axis of none": (
        lambda c: solve(c, record={"u": dea.LargestDisplacement("top", "")}), "axis is ''"),
    "tension across nothing": (
        lambda c: solve(c, failures=[dea.LossOfTension("")]), "one of the axes"),
    "a stretch limit of 1": (lambda c: solve(c, failures=[dea.StretchLimit(1.0)]), "> 1"),
    "a failure by name": (lambda c: solve(c, failures=["pull-in"]), "LossOfTension"),
    "breakdown of nothing": (
        lambda c: solve(c, failures=[dea.ElectricalBreakdown()]), "breakdown field"),
    "a scene that is none": (lambda c: dea.solve("scene", dea.Ramp()), "needs a Scene"),
    "a mesh that is not there": (lambda c: dea.read_gmsh("no/such.msh", c), "no mesh file"),
    "a mesh in negative units": (lambda c: dea.read_gmsh("x.msh", c, unit=-1.0), "mesh unit"),
}  # fmt: skip


@pytest.fixture(scope="module")
def compiled():
    """The forms are in the cache: some names are looked up only when they are compiled."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DEA_FENICSX_CFLAGS", FLAGS)
        solve()


@pytest.mark.parametrize("case", VALUES)
def test_wrong_values(compiled, quick_compile, case):
    make, words = VALUES[case]
    refused(lambda: make(MPI.COMM_SELF), words)


ON_RANKS = """
import os, sys
sys.path.insert(0, sys.argv[1])
import dea_fenicsx as dea
from mpi4py import MPI
from test_malformed import VALUES
comm = MPI.COMM_WORLD
os.chdir(sys.argv[2])
for name, (make, words) in VALUES.items():
    try:
        make(comm)
        told = "nothing"
    except dea.InputError as error:
        told = str(error)
    all_told = comm.allgather(told)  # a rank that still waited elsewhere would never come here
    assert len(set(all_told)) == 1 and words in told, (name, all_told)
if comm.rank == 0:
    print("refused", len(VALUES))
"""


@pytest.mark.mpi
def test_wrong_values_on_two_ranks(compiled, quick_compile, start, tmp_path):
    """The same sentence on both ranks, and neither left waiting; nothing is written."""
    script, work = tmp_path / "malformed.py", tmp_path / "work"
    work.mkdir()
    script.write_text(ON_RANKS)
    done = start(script, ROOT / "tests", work, ranks=2, timeout=120, check=True)
    assert f"refused {len(VALUES)}" in done.stdout
    assert not list(work.iterdir())


# ------------------------------------------------------------------------------------ at random

NUMBERS = st.one_of(st.floats(), st.sampled_from([0, 1, -1, 10**400, "1 kV", None, True, [1.0]]))
NAMES = st.sampled_from(["top", "bottom", "film", "", "Top", None, 7, ("top", "x_max"), ()])
ITEMS = st.one_of(
    st.builds(dea.Electrode, NAMES, NUMBERS), st.builds(dea.Ground, NAMES),
    st.builds(dea.Clamp, NAMES), st.builds(dea.Fix, NAMES, st.sampled_from(["x", "xy", "z", ""])),
    st.builds(dea.Stretch, NAMES, st.just("x"), NUMBERS),
    st.builds(dea.DeadPressure, NAMES, NUMBERS), st.builds(dea.DeadLoad, NAMES, NUMBERS),
    NUMBERS,
)  # fmt: skip
MODELS = st.one_of(
    st.builds(dea.NeoHookean, NUMBERS), st.builds(dea.Gent, NUMBERS, NUMBERS), NUMBERS
)
PLACES = ("electrodes", "supports", "prescribed", "loads")


@settings(max_examples=150, deadline=None)
@given(st.dictionaries(st.sampled_from(PLACES), st.lists(ITEMS, max_size=3)), MODELS, NUMBERS)
def test_scenes_at_random(changes, model, eps_r):
    """Each is accepted or refused; nothing else comes out."""
    try:
        scene(**changes, materials={"film": dea.Material(model, dea.IdealDielectric(eps_r))})
    except dea.InputError as error:
        assert str(error).endswith(".") and "\n" not in str(error) and len(str(error)) < 400


@settings(max_examples=60, deadline=None,
          suppress_health_check=[HealthCheck.function_scoped_fixture])  # fmt: skip
@given(content=st.one_of(st.binary(max_size=60), st.text("01.,;-eE naif\n\t\"'", max_size=80).map(
    lambda text: text.encode())))  # fmt: skip
def test_tables_at_random(tmp_path, content):
    """Test data and histories: read, or refused in one sentence; the file stays as it was."""
    file = tmp_path / "history.csv"
    file.write_bytes(content)
    for read in (
        lambda: materials.read_data(file, "uniaxial", 0, 1, 1.0),
        lambda: materials.read_data(file, "uniaxial", 0, 1, 1.0, delimiter=";", decimal=","),
        lambda: dea.read_history(tmp_path),
    ):
        try:
            read()
        except dea.InputError as error:
            assert str(error).endswith(".") and "\n" not in str(error), str(error)
    assert file.read_bytes() == content


def damaged(raw, rng):
    """A mesh file that was cut short, or lost or changed some of its lines."""
    lines = raw.split("\n")
    k = rng.randrange(len(lines))
    kind = rng.randrange(4)
    if kind == 0:
        return raw[: rng.randrange(len(raw))]
    if kind == 1:
        return "\n".join(lines[:k] + lines[k + 1 :])
    if kind == 2:
        return "\n".join([*lines[:k], "7 x " + lines[k], *lines[k:]])
    return raw.replace("$End", "$Ned", rng.randrange(1, 4))


MESHES = """
import sys
import dea_fenicsx as dea
from mpi4py import MPI
from pathlib import Path
for file in sorted(Path(sys.argv[1]).glob("*.msh")):
    try:
        dea.read_gmsh(file)
        text = "read"
    except dea.InputError as error:
        text = f"refused {error}"
        assert text.endswith(".") and "\\n" not in text, text
    assert len(set(MPI.COMM_WORLD.allgather(text))) == 1
    if MPI.COMM_WORLD.rank == 0:
        print(text)
"""


@pytest.mark.mpi
def test_meshes_damaged_at_random(tmp_path):
    """Each is read or refused in one sentence, on two ranks."""
    mpirun = needed_mpirun()
    whole = tmp_path / "whole.msh"
    code = (
        "import gmsh, sys; gmsh.initialize(); gmsh.option.setNumber('General.Terminal', 0);"
        "gmsh.model.occ.addRectangle(0, 0, 0, 1, 1); gmsh.model.occ.synchronize();"
        "gmsh.model.addPhysicalGroup(2, [1], name='film'); gmsh.model.mesh.generate(2);"
        "gmsh.write(sys.argv[1])"
    )
    subprocess.run([sys.executable, "-c", code, str(whole)], check=True, timeout=60)
    raw, rng = whole.read_text(), random.Random(20)
    folder = tmp_path / "damaged"
    folder.mkdir()
    for k in range(40):
        (folder / f"{k:02}.msh").write_text(damaged(raw, rng))
    before = {f: f.read_bytes() for f in folder.iterdir()}
    done = subprocess.run(
        [mpirun, "-n", "2", sys.executable, "-c", MESHES, str(folder)], capture_output=True,
        text=True, timeout=120, env=clean_environment(), stdin=subprocess.DEVNULL,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    told = done.stdout.splitlines()
    assert sum(line.startswith(("read", "refused")) for line in told) == 40
    assert sum(line.startswith("refused") for line in told) > 20
    assert {f: f.read_bytes() for f in folder.iterdir()} == before
