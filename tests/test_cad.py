"""Drawings: .geo scripts and STEP files, their names, and one sentence for what is wrong."""

from __future__ import annotations

from pathlib import Path

import gmsh
import numpy as np
import pytest
from conftest import ROOT
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx import cli
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.geometry._gmsh import start
from dea_fenicsx.mesh.cad import groups_of, open_file

CLOVER = ROOT / "demos" / "own_geometry_data"
# union of three circles of radius 4 about the corners of a triangle with the sides 4 sqrt(3)
AREA = 16 * (3 * np.pi - 3 * (np.pi / 3 - 3**0.5 / 2))


@pytest.fixture(scope="module")
def two_layers(tmp_path_factory) -> Path:
    """A STEP file in mm as CAD writes it: two solids that touch, each with a name and six faces."""
    path = tmp_path_factory.mktemp("step") / "two.step"
    start()
    gmsh.model.add("two")
    for z in (0.0, 0.5):
        gmsh.model.occ.addBox(0, 0, z, 20, 5, 0.5)
    gmsh.model.occ.synchronize()
    gmsh.write(str(path))
    gmsh.model.remove()
    text = path.read_text()
    marker = text[text.index("PRODUCT('") + 9 :].split("'")[0]
    for k, name in ((1, "passive"), (2, "active")):
        text = text.replace(f"{marker}.{k}", name)
    assert "passive" in text and "active" in text
    path.write_text(text)
    return path


def read(path: Path, **options) -> dict:
    model = open_file(path, **options)
    try:
        return {g.name: g for g in groups_of(model, str(path))}
    finally:
        model.remove()


def test_geo_is_meshed_with_its_names():
    """Exact area by curved cells, to what quadratic arcs of that length leave."""
    found = read(CLOVER / "clover.geo", size=2.0)
    assert list(found) == ["film", "bottom", "top", "edge"]
    assert found["top"].measure == pytest.approx(AREA, rel=1e-4)
    assert found["film"].measure == pytest.approx(0.5 * AREA, rel=1e-4)
    assert [found[n].dim for n in found] == [3, 2, 2, 2]
    finer = read(CLOVER / "clover.geo", size=1.0)
    assert finer["film"].elements > 3 * found["film"].elements
    assert abs(finer["top"].measure - AREA) < abs(found["top"].measure - AREA) / 4


def test_step_keeps_names_and_joins_solids(two_layers):
    """Eleven faces, not twelve: the solids share the one between them."""
    found = read(two_layers, size=2.0)
    assert {n for n, g in found.items() if g.dim == 3} == {"passive", "active"}
    assert {n for n, g in found.items() if g.dim == 2} == {f"surface_{k}" for k in range(1, 12)}
    assert found["active"].measure == pytest.approx(50.0, rel=1e-12)
    names = {"root": ["surface_1", "surface_7"], "middle": "surface_6", "lower": "passive"}
    named = read(two_layers, size=2.0, names=names)
    assert {"root", "middle", "lower", "active", "surface_2"} < set(named)
    assert not {"surface_1", "surface_6", "surface_7", "passive"} & set(named)
    assert named["root"].measure == pytest.approx(5.0, rel=1e-12)
    assert named["middle"].low[2] == named["middle"].high[2] == pytest.approx(0.5)


def test_step_is_read_in_its_own_unit(two_layers, tmp_path):
    """The same numbers in a file in mm and in one in m, both as lengths in m."""
    metres = tmp_path / "metres.step"
    text = two_layers.read_text()
    assert "SI_UNIT(.MILLI.,.METRE.)" in text
    metres.write_text(text.replace("SI_UNIT(.MILLI.,.METRE.)", "SI_UNIT($,.METRE.)"))
    for path, length in ((two_layers, 20e-3), (metres, 20.0)):
        device = dea.read_gmsh(path, MPI.COMM_SELF, size=length / 5)
        assert device.length == pytest.approx(length, rel=1e-9)


def test_flat_drawings(tmp_path):
    """Sheets in STEP and .geo: regions are surfaces, and what they need is named by curves."""
    start()
    gmsh.model.add("flat")
    for y in (0.0, 0.5):
        gmsh.model.occ.addRectangle(0, y, 0, 20, 0.5)
    gmsh.model.occ.synchronize()
    gmsh.write(str(tmp_path / "flat.step"))
    gmsh.model.remove()
    found = read(tmp_path / "flat.step", size=1.0, names={"root": ["curve_4", "curve_7"]})
    sides = {f"curve_{k}" for k in (1, 2, 3, 5, 6)}
    assert set(found) == {"surface_1", "surface_2", "root"} | sides
    assert found["root"].measure == pytest.approx(1.0, rel=1e-12)
    (tmp_path / "flat.geo").write_text(
        'SetFactory("OpenCASCADE");\nRectangle(1) = {0, 0, 0, 20, 0.5};\n'
        'Physical Surface("film") = {1};\nPhysical Curve("root") = {4};\n'
    )
    device = dea.read_gmsh(tmp_path / "flat.geo", MPI.COMM_SELF, unit=1e-3, size=1e-3)
    assert (device.dim, set(device.regions), set(device.surfaces)) == (2, {"film"}, {"root"})


def test_device_of_a_step_file_is_solved(two_layers):
    """The names reach the scene: the bender's tip goes down, whatever the numbers of its faces."""
    names = {"root": ["surface_1", "surface_7"], "middle": "surface_6", "top": "surface_11",
             "end": "surface_8"}  # fmt: skip
    device = dea.read_gmsh(two_layers, MPI.COMM_SELF, size=4e-3, names=names)
    rubber = dea.Material(dea.NeoHookean(80e3), dea.IdealDielectric(2.8))
    scene = dea.Scene(
        device, {"active": rubber, "passive": rubber},
        [dea.Electrode("top", 500.0), dea.Ground("middle")], [dea.Clamp("root")],
    )  # fmt: skip
    run = dea.solve(scene, dea.Ramp(steps=1), {"tip": dea.MeanDisplacement("end", "z")}, quiet=True)
    # beam of two equal layers, free in its width too: e = eps (V/h)^2/(6 mu), kappa = 3/4 e/h
    e = rubber.electric.permittivity() * 1e12 / (6 * 80e3)
    beam = -0.75 * e / 0.5e-3 * 0.02**2 / 2
    assert run["tip_m"] == pytest.approx(beam, rel=0.1)


FAULTS = {
    "no file": ("none.geo", {}, "There is no mesh file"),
    "geo is empty": ("empty.geo", {}, "nothing to mesh"),
    "geo has no region": ("plain.geo", {}, "names no region"),
    "geo has no surface": ("point.geo", {}, "nothing to mesh"),
    "not STEP": ("bad.step", {}, "gmsh cannot read"),
    "overlap": ("overlap.step", {}, "two of its solids overlap"),
    "unit of STEP": ("two.step", {"unit": 1e-3}, "leave unit= out"),
    "no such part": ("two.step", {"names": {"a": "surface_99"}}, "no part named 'surface_99'"),
    "part twice": ("two.step", {"names": {"a": "surface_1", "b": "surface_1"}}, "twice"),
    "name taken": ("two.step", {"names": {"active": "surface_1"}}, "not taken"),
    "mixed": ("two.step", {"names": {"a": ["surface_1", "active"]}}, "solids, or to one or more"),
    "no parts": ("two.step", {"names": {"a": []}}, "not taken"),
    "size is text": ("two.step", {"size": "fine"}, "element size is 'fine'"),
    "size is zero": ("two.step", {"size": 0.0}, "element size is 0.0"),
    "size of a mesh": ("film.msh", {"size": 1e-3}, "meshed already"),
    "names of a mesh": ("film.msh", {"names": {"a": "top"}}, "for STEP files"),
    # last: gmsh's own reader trips over the file after one that it could not parse
    "geo does not parse": ("bad.geo", {}, "line 1"),
}


@pytest.fixture(scope="module")
def folder(two_layers) -> Path:
    place = two_layers.parent
    (place / "bad.geo").write_text("Point(1) = {0, 0, };\n")
    (place / "empty.geo").write_text("")
    (place / "point.geo").write_text("Point(1) = {0, 0, 0};\n")
    (place / "plain.geo").write_text('SetFactory("OpenCASCADE");\nBox(1) = {0, 0, 0, 1, 1, 1};\n')
    (place / "bad.step").write_text("no STEP\n")
    start()
    gmsh.model.add("overlap")
    for z in (0.0, 0.25):
        gmsh.model.occ.addBox(0, 0, z, 20, 5, 0.5)
    gmsh.model.occ.synchronize()
    gmsh.write(str(place / "overlap.step"))
    gmsh.model.remove()
    BoxStack(1e-3, 1e-3, [Layer("film", 1e-3)]).write(place / "film.msh")
    return place


@pytest.mark.parametrize("case", FAULTS)
def test_one_sentence(folder, case):
    file, options, words = FAULTS[case]
    before = gmsh.model.list()
    with pytest.raises(dea.InputError) as caught:
        dea.read_gmsh(folder / file, MPI.COMM_SELF, **options)
    told = str(caught.value)
    assert words in told
    assert told.endswith(".") and "\n" not in told
    assert gmsh.model.list() == before  # no half-read model is left behind


def test_options_of_a_geometry():
    with pytest.raises(dea.InputError, match="BoxStack has its own"):
        dea.read_gmsh(BoxStack(1e-3, 1e-3, [Layer("film", 1e-3)]), MPI.COMM_SELF, size=1e-3)


def test_scene_names_all_that_the_mesh_lacks(folder):
    device = dea.read_gmsh(folder / "film.msh", MPI.COMM_SELF)
    with pytest.raises(dea.InputError) as caught:
        rubber = dea.Material(dea.NeoHookean(1e5), dea.IdealDielectric(3.0))
        drive = [dea.Electrode("upper", 1.0), dea.Ground("bottom")]
        dea.Scene(device, {"film": rubber}, drive, [dea.Clamp("root")])
    told = str(caught.value)
    assert "needs 'root', 'upper', which the mesh lacks" in told
    assert "regions film" in told and "bottom, top, x_max" in told


def test_command(capsys, two_layers, folder):
    assert cli.main(["mesh", str(two_layers), "--size", "2e-3"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "regions (materials):"
    assert lines[1].split()[0] == "passive" and "5e-08 m3" in lines[1]
    assert len(lines) == 2 + 2 + 11 + 1
    assert lines[-1].startswith("least scaled Jacobian")
    assert cli.main(["mesh", str(folder / "film.msh")]) == 0
    assert "x 0 to 0.001" in capsys.readouterr().out
    assert cli.main(["mesh", str(folder / "bad.geo")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_damaged_binary_mesh_does_not_end_the_program(tmp_path):
    """gmsh dies of a wrong number of elements or nodes; of entities, it spoils the memory."""
    film = tmp_path / "film.msh"
    start()
    gmsh.model.add("film")
    gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.model.addPhysicalGroup(3, [1], name="film")
    gmsh.model.mesh.setSize(gmsh.model.getEntities(0), 1.0)
    gmsh.model.mesh.generate(3)
    gmsh.option.setNumber("Mesh.Binary", 1)
    gmsh.write(str(film))
    gmsh.option.setNumber("Mesh.Binary", 0)
    gmsh.model.remove()
    assert list(read(film)) == ["film"]
    good, refused = film.read_bytes(), []
    for section, byte in ((b"$Elements\n", 8), (b"$Nodes\n", 8), (b"$Entities\n", 24)):
        at = good.index(section) + len(section) + byte
        film.write_bytes(good[:at] + b"\x05" + good[at + 1 :])
        with pytest.raises(dea.InputError) as caught:
            read(film)
        refused.append(str(caught.value))
    assert all(text.startswith(f"gmsh cannot read {film} (") for text in refused)


def test_gmsh_with_other_options_still_says_what_is_wrong(tmp_path):
    """A script that has reset gmsh's options must not lose gmsh's messages."""
    bad = tmp_path / "bad.geo"
    bad.write_text("Point(1) = {0, 0\n")
    running = gmsh.isInitialized()
    if not running:
        gmsh.initialize([], readConfigFiles=False, interruptible=False)
    before = gmsh.option.getNumber("General.AbortOnError")
    try:
        gmsh.option.setNumber("General.AbortOnError", 0)
        with pytest.raises(dea.InputError, match="gmsh cannot read"):
            dea.read_gmsh(bad, MPI.COMM_SELF)
        assert gmsh.option.getNumber("General.AbortOnError") == 0
    finally:
        gmsh.option.setNumber("General.AbortOnError", before)
        if not running:
            gmsh.finalize()


def test_options_of_one_drawing_do_not_hold_for_the_next(tmp_path):
    """Where a script has gmsh running, a file's mesh does not depend on what was read before."""
    square = 'SetFactory("OpenCASCADE"); Rectangle(1) = {0, 0, 0, 4, 1};\n'
    square += 'Physical Surface("film") = {1};\n'
    (tmp_path / "plain.geo").write_text(square)
    (tmp_path / "fine.geo").write_text(
        square + "Mesh.MeshSizeMax = 0.3; Mesh.RecombineAll = 1; Mesh.ElementOrder = 3;\n"
        'Geometry.OCCTargetUnit = "CM";\n'
    )
    running = not start()

    def cells():
        return dea.read_gmsh(tmp_path / "plain.geo", MPI.COMM_SELF, dim=2).mesh.topology.index_map(
            2).size_local  # fmt: skip

    size = gmsh.option.getNumber("Mesh.MeshSizeMin")
    target = gmsh.option.getString("Geometry.OCCTargetUnit")
    try:
        gmsh.option.setNumber("Mesh.MeshSizeMin", 0.123456789012)  # the script's own
        before = cells()
        dea.read_gmsh(tmp_path / "fine.geo", MPI.COMM_SELF, dim=2)
        assert gmsh.option.getNumber("Mesh.ElementOrder") == 1
        assert gmsh.option.getString("Geometry.OCCTargetUnit") == target
        assert gmsh.option.getNumber("Mesh.MeshSizeMin") == 0.123456789012
        assert cells() == before
    finally:
        gmsh.option.setNumber("Mesh.MeshSizeMin", size)
        if not running:
            gmsh.finalize()


class Fine:
    """A geometry of the user's own that asks for small cells."""

    def build(self):
        start()
        gmsh.model.add("fine")
        gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [1], name="film")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.3)
        gmsh.model.mesh.generate(2)
        return gmsh.model


def test_options_of_a_geometry_of_ones_own_do_not_hold_either():
    start()
    size = gmsh.option.getNumber("Mesh.MeshSizeMax")
    dea.read_gmsh(Fine(), MPI.COMM_SELF, dim=2)
    assert gmsh.option.getNumber("Mesh.MeshSizeMax") == size > 0.3
