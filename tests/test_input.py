"""Bad input: one clear sentence, a non-zero exit, before the solve, and nothing on disk harmed."""

from __future__ import annotations

import re

import numpy as np
import pytest
from conftest import ROOT, block
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer

CUBE = ROOT / "demos" / "cube.py"
HDEA = ROOT / "demos" / "hdea_two_turn.py"
FILM = ROOT / "demos" / "stiffened_membrane.py"
RUBBER = dea.Material(dea.NeoHookean(50e3), dea.IdealDielectric(3.0))
HELD = (dea.Clamp("bottom"),)
DRIVEN = (dea.Electrode("top", 100.0), dea.Ground("bottom"))


@pytest.fixture(scope="module")
def device():
    return block((1, 1, 1))


@pytest.fixture(scope="module")
def layered():
    """Two layers, film and cap."""
    geometry = BoxStack(1e-3, 1e-3, [Layer("film", 1e-3), Layer("cap", 1e-4)], divisions=(1, 1))
    return dea.read_gmsh(geometry, MPI.COMM_SELF)


def material(elastic=None, electric=None, bulk=None):
    return {"film": dea.Material(elastic or dea.NeoHookean(5e4), electric, bulk)}


SCENES = {
    "unknown region": (
        dict(materials={"flim": RUBBER}), "no region named 'flim'; did you mean 'film'"),
    "not a material": (dict(materials={"film": dea.NeoHookean(1e4)}), "needs a Material"),
    "negative modulus": (dict(materials=material(dea.NeoHookean(-5.0))), "mu is -5.0"),
    "NaN modulus": (dict(materials=material(dea.NeoHookean(float("nan")))), "mu is nan"),
    "modulus as text": (dict(materials=material(dea.NeoHookean("soft"))), "mu is 'soft'"),  # type: ignore[arg-type]
    "zero Jm": (dict(materials=material(dea.Gent(5e4, 0.0))), "Jm is 0.0"),
    "permittivity below 1": (
        dict(materials=material(electric=dea.IdealDielectric(0.3))), "eps_r is 0.3"),
    "bulk modulus too small": (dict(materials=material(bulk=1e3)), "bulk_modulus is 1000"),
    "unknown electrode": (
        dict(electrodes=[dea.Electrode("topp", 1.0)]), "named 'topp'; did you mean 'top'"),
    "electrode twice": (
        dict(electrodes=[dea.Electrode("top", 1.0), dea.Ground("top")]), "electrode twice"),
    "NaN voltage": (dict(electrodes=[dea.Electrode("top", float("nan"))]), "is nan"),
    "voltage as text": (dict(electrodes=[dea.Electrode("top", "2 kV")]), "is '2 kV'"),  # type: ignore[arg-type]
    "electrodes touch": (
        dict(electrodes=[dea.Electrode("top", 5.0), dea.Ground("x_min")]), "touch"),
    "electrode on a dielectric region": (
        dict(electrodes=[dea.Electrode("film", 1.0)]), "does not conduct"),
    "no dielectric": (dict(materials=material()), "no dielectric"),
    "unknown support": (dict(supports=[dea.Clamp("floor")]), "no facet group named 'floor'"),
    "no supports": (dict(supports=[]), "no supports"),
    "wrong axis": (dict(supports=[dea.Fix("bottom", "r")]), "axes 'r'"),
    "zero stretch": (dict(prescribed=[dea.Stretch("top", "z", 0.0)]), "must be > 0"),
    "load with two components": (dict(loads=[dea.DeadLoad("top", (1.0, 2.0))]), "2 components"),
    "infinite load": (dict(loads=[dea.DeadPressure("top", float("inf"))]), "is inf"),
    "2-D kinematics on a 3-D mesh": (dict(kinematics=dea.PlaneStrain()), "2 dimensions"),
    "unknown pressure element": (
        dict(elements=dea.Discretisation(pressure="bubbly")), "'bubbly'"),
}  # fmt: skip


def one_sentence(message: str) -> None:
    """One sentence: a capital or a quote first, a full stop last, no line break."""
    assert "\n" not in message.strip()
    assert message.strip().endswith(".")
    assert len(message) < 400


@pytest.mark.parametrize("case", SCENES)
def test_scene_refuses(device, case):
    change, words = SCENES[case]
    arguments = dict(materials={"film": RUBBER}, electrodes=DRIVEN, supports=HELD) | change
    with pytest.raises(dea.InputError, match=re.escape(words)) as caught:
        scene = dea.Scene(device, **arguments)
        dea.solve(scene, dea.Ramp(steps=1), quiet=True)
    one_sentence(str(caught.value))


def test_region_without_material(layered):
    with pytest.raises(dea.InputError, match="Region 'cap' has no material") as caught:
        dea.Scene(layered, {"film": RUBBER}, electrodes=DRIVEN, supports=HELD)
    one_sentence(str(caught.value))


def test_conductor_that_is_no_electrode(layered):
    cap = dea.Material(dea.NeoHookean(1e5), dea.Conductor())
    with pytest.raises(dea.InputError, match="'cap' conducts, but is no electrode"):
        dea.Scene(layered, {"film": RUBBER, "cap": cap}, electrodes=DRIVEN, supports=HELD)


def test_pressure_between_two_dielectrics_needs_a_side(layered):
    loads = [dea.DeadPressure("interface_1", 10.0)]
    scene = dea.Scene(layered, {"film": RUBBER, "cap": RUBBER}, supports=HELD, loads=loads)
    with pytest.raises(dea.InputError, match="which side"):
        dea.solve(scene, dea.Ramp(steps=1), quiet=True)


def test_electrode_without_facets(tmp_path):
    """A physical group that is named in the file, but holds nothing."""
    file = tmp_path / "film.msh"
    BoxStack(1e-3, 1e-3, [Layer("film", 1e-3)], divisions=(1, 1)).write(file)
    device = dea.read_gmsh(file, MPI.COMM_SELF)
    device.surfaces["ghost"] = 99
    with pytest.raises(dea.InputError, match="Electrode 'ghost' has no facets"):
        dea.Scene(device, {"film": RUBBER}, supports=HELD,
                  electrodes=[dea.Electrode("ghost", 1.0), dea.Ground("bottom")])  # fmt: skip


@pytest.mark.parametrize(
    ("ramp", "words"),
    [
        (dea.Ramp(steps=0), "0 steps"),
        (dea.Ramp(steps=2.5), "steps is 2.5"),  # type: ignore[arg-type]
        (dea.Ramp(to=float("nan")), "is nan"),
        (dea.Ramp("volts"), "no ramp in the scene named 'volts'"),
        ([], "path is empty"),
    ],
)
def test_path_refuses(device, ramp, words):
    scene = dea.Scene(device, {"film": RUBBER}, electrodes=DRIVEN, supports=HELD)
    with pytest.raises(dea.InputError, match=re.escape(words)):
        dea.solve(scene, ramp, quiet=True)


@pytest.mark.parametrize(
    ("observable", "words"),
    [
        (dea.MeanDisplacement("tip", "z"), "'tip'"),
        (dea.MeanDisplacement("top", "q"), "'q'"),
        (dea.Reaction("top", "z"), "not held along z"),
        (dea.Charge("side"), "no electrode named 'side'"),
        (dea.Capacitance("bottom"), "grounded"),
        (dea.Contraction(("top", "top"), "z"), "same z"),
    ],
)
def test_observable_refuses(device, observable, words):
    scene = dea.Scene(device, {"film": RUBBER}, electrodes=DRIVEN, supports=HELD)
    with pytest.raises(dea.InputError, match=re.escape(words)):
        dea.solve(scene, dea.Ramp(steps=1), {"x": observable}, quiet=True)


def test_mesh_files(tmp_path):
    missing, broken, empty = (tmp_path / f"{n}.msh" for n in ("missing", "broken", "empty"))
    broken.write_text("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 two three\n")
    empty.write_text("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n")
    for file in (missing, broken, empty):
        with pytest.raises(dea.InputError) as caught:
            dea.read_gmsh(file, MPI.COMM_SELF)
        assert file.name in str(caught.value)
    with pytest.raises(dea.InputError, match="mesh unit"):
        dea.read_gmsh(empty, MPI.COMM_SELF, unit=0.0)


def test_unnamed_mesh(tmp_path):
    """A mesh without physical groups says what to add."""
    import gmsh

    if not gmsh.isInitialized():
        gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add("unnamed")
    gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.model.mesh.generate(3)
    gmsh.write(str(tmp_path / "unnamed.msh"))
    gmsh.model.remove()
    with pytest.raises(dea.InputError, match="names no region"):
        dea.read_gmsh(tmp_path / "unnamed.msh", MPI.COMM_SELF)


def test_unwritable_folder(device, tmp_path):
    """A file where the folder should be; it stays as it was."""
    file = tmp_path / "taken"
    file.write_text("mine")
    scene = dea.Scene(device, {"film": RUBBER}, electrodes=DRIVEN, supports=HELD)
    for out in (file, file / "below"):
        with pytest.raises(dea.InputError, match="cannot be written"):
            dea.solve(scene, dea.Ramp(steps=1), out=out, quiet=True)
    assert file.read_text() == "mine"


COMMANDS = {
    "negative modulus": (CUBE, ["--mu", "-5"]),
    "permittivity": (CUBE, ["--eps-r", "0.5"]),
    "NaN voltage": (CUBE, ["--voltage", "nan"]),
    "zero steps": (HDEA, ["--steps", "0"]),
    "unknown option": (HDEA, ["--volts", "3"]),
    "no such mesh": (HDEA, ["--mesh", "9"]),
    "zero turns": (HDEA, ["--turns", "0"]),
    "weights that hold no film": (FILM, ["--width", "loaded", "--model", "mooney-rivlin"]),
}


@pytest.mark.demo
@pytest.mark.mpi
@pytest.mark.parametrize("case", COMMANDS)
def test_command_line_refuses_on_two_ranks(start, tmp_path, case):
    """One sentence from rank 0, exit status 2, earlier results untouched."""
    script, arguments = COMMANDS[case]
    (tmp_path / "history.csv").write_text("earlier")
    done = start(script, *arguments, "--out", tmp_path, ranks=2, timeout=120)
    assert done.returncode == 2
    lines = [line for line in done.stderr.splitlines() if line.startswith("Error:")]
    assert len(lines) == 1, done.stderr
    one_sentence(lines[0])
    assert "Traceback" not in done.stderr
    assert (tmp_path / "history.csv").read_text() == "earlier"
    assert [f.name for f in tmp_path.iterdir()] == ["history.csv"]


@pytest.mark.mpi
def test_a_rank_that_fails_alone_ends_all(start, tmp_path):
    """Rank 1 raises; rank 0 waits in a collective call; all end at once."""
    script = tmp_path / "one_fails.py"
    script.write_text(
        "import dea_fenicsx\nfrom mpi4py import MPI\n"
        "dea_fenicsx.Parser('From here on an error ends all ranks.', 'out')\n"
        "if MPI.COMM_WORLD.rank == 1:\n    raise RuntimeError('alone')\n"
        "MPI.COMM_WORLD.barrier()\n"
    )
    done = start(script, ranks=2, timeout=60)
    assert done.returncode != 0
    assert done.stderr.count("RuntimeError: alone") == 1


def test_twenty_lines_are_enough():
    """The README's script has at most 20 lines."""
    text = (ROOT / "README.md").read_text("utf-8")
    scripts = re.findall(r"```python\n(.*?)```", text, flags=re.S)
    assert scripts
    assert all(len([x for x in s.splitlines() if x.strip()]) <= 20 for s in scripts)


def test_finite_numbers_only():
    from dea_fenicsx.scene.scene import finite

    for value in (np.nan, np.inf, None, "1"):
        with pytest.raises(dea.InputError, match="finite number"):
            finite(value, "The value")


class Recorded:
    """An observable of a user's that returns what it is given."""

    unit = ""

    def __init__(self, value):
        self.value = value

    def bind(self, problem):
        return lambda: self.value


@pytest.mark.parametrize("value, words", [
    (10**400, "is 1000"), (10**5000, "is of type int"), (np.ma.masked, "is masked"),
], ids=["400 digits", "5000 digits", "masked"])  # fmt: skip
def test_recorded_values_that_are_no_float(device, value, words):
    scene = dea.Scene(device, {"film": RUBBER}, electrodes=DRIVEN, supports=HELD)
    with pytest.raises(dea.SolverError, match=f"'odd' {words}.*, but must be a number"):
        dea.solve(scene, dea.Ramp(steps=1), {"odd": Recorded(value)}, quiet=True)


def test_a_masked_voltage_is_no_number(device):
    with pytest.raises(dea.InputError, match="masked, but must be"):
        dea.Scene(
            device, {"film": RUBBER}, supports=HELD, electrodes=[dea.Electrode("top", np.ma.masked)]
        )


@pytest.mark.parametrize("unit", [np.array([1e-3]), True, np.ma.masked, "mm", 10**400, -1.0])
def test_a_mesh_unit_is_one_number(unit):
    from dea_fenicsx.mesh.cad import lengths

    with pytest.raises(dea.InputError, match=r"mesh unit is .*, but must be a length in metres"):
        lengths("a.msh", unit, None)


def test_lists_are_taken_where_tuples_are():
    assert dea.Ogden([5e4], [2.0]) == dea.Ogden((5e4,), (2.0,))
    assert dea.Ramp(at=[0.5]).at == (0.5,)
    assert dea.DeadLoad("top", [0, 0, 1.0]) == dea.DeadLoad("top", (0, 0, 1.0))
    assert hash(dea.Electrode(["top", "bottom"], 1.0))
