"""Meshes that others have made: names, cells and joints as they come, or one sentence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import gmsh
import numpy as np
import pytest
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx import cli
from dea_fenicsx.geometry import (
    HDEA,
    BoxStack,
    DEAHinge,
    DiskStack,
    HelicalCell,
    KreslingCell,
    Layer,
    MembraneDisc,
)
from dea_fenicsx.geometry._gmsh import start


@pytest.fixture(autouse=True)
def own_gmsh():
    """gmsh runs for each test, with the options it starts with."""
    mine = start()
    gmsh.option.restoreDefaults()
    gmsh.option.setNumber("General.Terminal", 0)
    yield
    gmsh.clear()
    if mine:
        gmsh.finalize()


def written(path: Path, build: Callable, dim: int, order: int = 1, **options) -> Path:
    """Mesh what `build` adds to a new model, and write it to a file."""
    gmsh.model.add(path.stem)
    build(gmsh.model)
    for key, value in options.items():
        gmsh.option.setNumber(key.replace("_", "."), value)
    gmsh.model.mesh.generate(dim)
    if order > 1:
        gmsh.model.mesh.setOrder(order)
    gmsh.write(str(path))
    gmsh.model.remove()
    return path


def facets(device) -> dict[str, int]:
    return {name: len(device.facets_of(name)) for name in device.surfaces}


def refused(path, *words: str, **options) -> str:
    """It is refused in one sentence that holds some words."""
    before = gmsh.model.list()
    with pytest.raises(dea.InputError) as caught:
        dea.read_gmsh(path, MPI.COMM_SELF, **options)
    text = str(caught.value)
    assert text.endswith(".") and "\n" not in text and len(text) < 420, text
    assert all(word in text for word in words), text
    assert gmsh.model.list() == before
    return text


# ----------------------------------------------------------------------- parts that are not joined


def layers(low: int, high: int, gap: float = 0.0, recombine: bool = True) -> Callable:
    """Two rectangles of 10 by 0.5 on each other, meshed one by one."""
    def build(model):
        occ = model.occ
        for k, n in ((0, low), (1, high)):
            occ.addRectangle(0, k * (0.5 + gap), 0, 10, 0.5)
            occ.synchronize()
            for _, tag in model.getBoundary([(2, k + 1)], oriented=False):
                x = occ.getCenterOfMass(1, tag)[0]
                model.mesh.setTransfiniteCurve(tag, n + 1 if abs(x - 5) < 1e-9 else 3)
            model.mesh.setTransfiniteSurface(k + 1)
            if recombine:
                model.mesh.setRecombine(2, k + 1)
            model.addPhysicalGroup(2, [k + 1], name=("passive", "active")[k])
        left = [t for _, t in model.getEntities(1) if abs(occ.getCenterOfMass(1, t)[0]) < 1e-9]
        model.addPhysicalGroup(1, left, name="left")

    return build


@pytest.mark.parametrize(
    ("low", "high", "recombine"), [(20, 20, True), (20, 7, True), (4, 90, False), (8, 8, False)]
)
def test_layers_that_are_not_joined_are_told(tmp_path, low, high, recombine):
    """Doubled nodes, nodes that do not fit, cells of very different size: the place is between."""
    path = written(tmp_path / "loose.msh", layers(low, high, recombine=recombine), 2)
    text = refused(path, "'passive' and 'active' touch", "BooleanFragments", unit=1e-3)
    assert ", 0.0005) m" in text
    device = dea.read_gmsh(path, MPI.COMM_SELF, apart=True)
    assert facets(device) == {"left": 4}


@pytest.mark.parametrize("gap", [1e-3, 1e-2])
def test_a_thin_gap_is_no_contact(tmp_path, gap):
    path = written(tmp_path / "gap.msh", layers(20, 13, gap), 2)
    assert dea.read_gmsh(path, MPI.COMM_SELF).length == pytest.approx(10)


def boxes(curved: bool, recombine: bool = False) -> Callable:
    """A box on a box, or a tube around a rod, each meshed for itself."""
    def build(model):
        occ = model.occ
        if curved:
            occ.addCylinder(0, 0, 0, 0, 0, 1, 1)
            hole = occ.addCylinder(0, 0, 0, 0, 0, 1, 1)
            occ.cut([(3, occ.addCylinder(0, 0, 0, 0, 0, 1, 2))], [(3, hole)])
        else:
            occ.addBox(0, 0, 0, 1, 1, 1)
            occ.addBox(0.25, 0.25, 1, 0.5, 0.5, 0.3)
        occ.synchronize()
        for k, (_, tag) in enumerate(model.getEntities(3)):
            model.addPhysicalGroup(3, [tag], name=("lower", "upper")[k])

    return build


@pytest.mark.parametrize(("curved", "order"), [(False, 1), (False, 2), (True, 1), (True, 2)])
def test_solids_that_are_not_joined_are_told(tmp_path, curved, order):
    path = written(tmp_path / "two.msh", boxes(curved), 3, order, Mesh_MeshSizeMax=0.35)
    refused(path, "'lower' and 'upper' touch, but are not joined")


def test_a_crack_inside_one_region_is_told(tmp_path):
    def build(model):
        model.occ.addRectangle(0, 0, 0, 2, 1)
        line = model.occ.addLine(model.occ.addPoint(0.5, 0.5, 0), model.occ.addPoint(1.5, 0.5, 0))
        model.occ.fragment([(2, 1)], [(1, line)])
        model.occ.synchronize()
        model.addPhysicalGroup(2, [1], name="film")
        crack = [t for _, t in model.getEntities(1) if model.getBoundingBox(1, t)[1] > 0.4
                 and model.getBoundingBox(1, t)[4] < 0.6]  # fmt: skip
        model.addPhysicalGroup(1, crack, tag=9, name="crack")

    gmsh.model.add("crack")
    build(gmsh.model)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.2)
    gmsh.model.mesh.generate(2)
    gmsh.plugin.setNumber("Crack", "Dimension", 1)
    gmsh.plugin.setNumber("Crack", "PhysicalGroup", 9)
    gmsh.plugin.run("Crack")
    gmsh.write(str(tmp_path / "crack.msh"))
    gmsh.model.remove()
    refused(tmp_path / "crack.msh", "two faces of region 'film' touch")
    dea.read_gmsh(tmp_path / "crack.msh", MPI.COMM_SELF, apart=True)


def test_a_part_that_is_there_twice_is_told(tmp_path):
    def build(model):
        for k in (1, 2):
            model.occ.addBox(0, 0, 0, 1, 1, 1)
            model.occ.synchronize()
            model.addPhysicalGroup(3, [k], name=f"film_{k}")

    path = written(tmp_path / "twice.msh", build, 3, Mesh_MeshSizeMax=0.5)
    refused(path, "'film_1' and 'film_2' lie in one another")


FAMILIES = [
    BoxStack(1e-2, 1e-2, [Layer("a", 1e-4), Layer("b", 2e-6)], divisions=(3, 3)),
    BoxStack(1e-2, 1e-2, [Layer("thin", 2e-8)], divisions=(3, 3)),
    BoxStack(1e-2, None, [Layer("thin", 2e-8)], divisions=(3,)),
    DiskStack(7e-3, [Layer("a", 5e-4), Layer("c", 5e-5)], inset=3e-4, inner_radius=2e-3),
    HDEA(turns=3, angular=8, order=1),
    HDEA(ends="flat", cap=1e-3, through_cap=2, strands=2),
    HelicalCell(),
    MembraneDisc(12e-3, 4e-3, 1e-3, taper=1e-4, angular=16, layers=2),
    KreslingCell(0.1, 0.08, 0.9, 1e-3, 6e-3, relief=0.2, sides=6, tip=2),
    DEAHinge(),
]


@pytest.mark.parametrize("k", range(len(FAMILIES)))
def test_files_of_the_families_are_read_without_alarm(tmp_path, k):
    """Their surfaces come close to each other and do not touch."""
    shape = FAMILIES[k]
    shape.write(tmp_path / "own.msh")
    read, made = (dea.read_gmsh(s, MPI.COMM_SELF) for s in (tmp_path / "own.msh", shape))
    assert read.owned_cells() == made.owned_cells()
    assert facets(read) == facets(made)
    assert read.length == pytest.approx(made.length, rel=1e-12)


# -------------------------------------------------------------------------------- groups and names

PLATE = """SetFactory("OpenCASCADE"); Rectangle(1) = {0, 0, 0, 10, 1};
Physical Surface("film") = {1}; Physical Curve("left") = {4}; Physical Curve("ends") = {2, 4};
Physical Curve("all") = {1, 2, 3, 4}; Physical Point("left") = {1, 4}; Mesh.MeshSizeMax = 0.5;
"""
COUNTS = {"left": 2, "ends": 4, "all": 44}


@pytest.mark.parametrize("form", ["geo", "4.1", "4.0", "2.2", "2.2 binary", "4.1 binary", "med"])
def test_groups_that_overlap_are_whole(tmp_path, form):
    path = tmp_path / "plate.geo"
    path.write_text(PLATE)
    if form != "geo":
        gmsh.merge(str(path))
        gmsh.model.mesh.generate(2)
        if form != "med":
            gmsh.option.setNumber("Mesh.MshFileVersion", float(form.split()[0]))
            gmsh.option.setNumber("Mesh.Binary", "binary" in form)
        path = path.with_suffix(".med" if form == "med" else ".msh")
        gmsh.write(str(path))
        gmsh.clear()
        if not path.exists():
            pytest.skip("this gmsh is built without the library of .med files")
    device = dea.read_gmsh(path, MPI.COMM_SELF)
    assert facets(device) == COUNTS
    assert set(device.regions) == {"film"}
    assert set(device.facets_of("left")) < set(device.facets_of("ends"))
    assert set(device.facets_of("ends")) < set(device.facets_of("all"))


MSH2 = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
4
1 1 "left"
1 2 "right"
2 3 "soft"
2 4 "hard   "
$EndPhysicalNames
$Nodes
6
10 0 0 0
20 1 0 0
30 2 0 0
40 0 1 0
50 1 1 0
60 2 1 0
$EndNodes
$Elements
4
1 1 2 1 1 10 40
2 1 2 2 1 30 60
3 3 2 3 1 10 20 50 40
4 3 2 4 1 20 30 60 50
$EndElements
"""


def test_format_2_keeps_the_group_of_each_element(tmp_path):
    """One entity for all, as other programs write it; numbers of nodes with gaps; a padded name."""
    path = tmp_path / "old.msh"
    path.write_text(MSH2)
    device = dea.read_gmsh(path, MPI.COMM_SELF)
    assert facets(device) == {"left": 1, "right": 1}
    assert {name: len(device.cells_of(name)) for name in device.regions} == {"soft": 1, "hard": 1}


BAD_GROUPS = {
    "a cell in two regions": (
        'Physical Surface("film") = {1}; Physical Surface("cap") = {1};', "'film' and 'cap'"),
    "a cell in none": (
        'Rectangle(2) = {20, 0, 0, 1, 1}; Physical Surface("film") = {1};', "in no region"),
    "one name twice": (
        'Physical Surface("film") = {1}; Physical Curve("film") = {1};', "name 'film' for two"),
    "no region": ('Physical Curve("left") = {4};', "names no region"),
    "loose facets": (
        'Line(9) = {newp, newp}; Point(77) = {0, 5, 0}; Point(78) = {1, 5, 0}; Line(99) = {77, 78};'
        'Physical Surface("film") = {1}; Physical Curve("ends") = {4, 99};', "'ends'"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_GROUPS)
def test_groups_that_cannot_be_used_are_told(tmp_path, case):
    text, words = BAD_GROUPS[case]
    path = tmp_path / "bad.geo"
    text = text.replace("Line(9) = {newp, newp}; ", "")
    path.write_text(
        f'SetFactory("OpenCASCADE"); Rectangle(1) = {{0, 0, 0, 10, 1}}; {text}\n'
        "Mesh.MeshSizeMax = 1; Mesh.SaveAll = 1;\n"
    )
    refused(path, words)


def test_groups_without_a_name_are_measured(tmp_path, capsys):
    def build(model):
        model.occ.addBox(0, 0, 0, 1, 1, 1)
        model.occ.synchronize()
        model.addPhysicalGroup(3, [1], 7)
        model.addPhysicalGroup(2, [1, 2], 5)

    path = written(tmp_path / "nameless.msh", build, 3, Mesh_MeshSizeMax=0.5)
    assert cli.main(["mesh", str(path), "--unit", "1e-3"]) == 0
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines() if line}
    assert "1e-09 m3" in lines["group_3_7"] and "2e-06 m2" in lines["group_2_5"]
    device = dea.read_gmsh(path, MPI.COMM_SELF)
    assert set(device.regions) == {"group_3_7"} and set(device.surfaces) == {"group_2_5"}


# ------------------------------------------------------------------------------------------ planes


def square(ex, ey, at=(0, 0, 0), bent=0.0) -> Callable:
    def build(model):
        geo = model.geo
        corners = [np.array(at) + a * np.array(ex) + b * np.array(ey)
                   for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]  # fmt: skip
        corners[2] = corners[2] + bent * np.cross(ex, ey)
        p = [geo.addPoint(*c) for c in corners]
        lines = [geo.addLine(p[k], p[(k + 1) % 4]) for k in range(4)]
        loop = geo.addCurveLoop(lines)
        surface = geo.addSurfaceFilling([loop]) if bent else geo.addPlaneSurface([loop])
        geo.synchronize()
        model.addPhysicalGroup(2, [surface], name="film")
        model.addPhysicalGroup(1, [lines[0]], name="bottom")

    return build


PLANES = {
    "xz": (square((1, 0, 0), (0, 0, 1)), "plane of x and z"),
    "yz": (square((0, 1, 0), (0, 0, 1), (3, 0, 0)), "plane of y and z"),
    "tilted": (square((0.6, 0, 0.8), (0, 1, 0)), "tilted"),
    "bent": (square((1, 0, 0), (0, 1, 0), bent=0.1), "curved surface"),
}


@pytest.mark.parametrize("case", PLANES)
def test_a_flat_mesh_outside_its_plane_is_told(tmp_path, case):
    build, words = PLANES[case]
    refused(written(tmp_path / "sheet.msh", build, 2, Mesh_MeshSizeMax=0.5), words, "z = const")


def test_a_flat_mesh_may_lie_anywhere_along_z(tmp_path):
    path = written(tmp_path / "high.msh", square((1, 0, 0), (0, 1, 0), (2, 3, 5)), 2)
    device = dea.read_gmsh(path, MPI.COMM_SELF, dim=2)
    assert device.mesh.geometry.dim == 2 and device.length == pytest.approx(1)
    refused(path, "dim is 3", dim=3)
    for dim in (1, True, "2", 2.5, np.zeros(2)):
        refused(path, "must be 2 or 3", dim=dim)
    for option in ("curved", "apart", "programs"):
        refused(path, f"{option} is 'no'", **{option: "no"})


def test_dim_of_a_mesh_in_space(tmp_path):
    BoxStack(1e-3, 1e-3, [Layer("film", 1e-3)]).write(tmp_path / "box.msh")
    refused(tmp_path / "box.msh", "dimension 3, but dim is 2", dim=2)
