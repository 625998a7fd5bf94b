"""Cells of meshes that others have made: of all shapes, curved, and on several ranks."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import gmsh
import numpy as np
import pytest
from mpi4py import MPI
from scipy.optimize import brentq
from test_foreign_meshes import COUNTS, PLATE, layers, own_gmsh, refused, square, written

import dea_fenicsx as dea
from dea_fenicsx import cli
from dea_fenicsx.geometry._gmsh import measure
from dea_fenicsx.mesh.cad import read_names
from dea_fenicsx.mesh.cell_quality import check_cells
from dea_fenicsx.mesh.foreign.model import checked
from dea_fenicsx.support import compat

__all__ = ["own_gmsh"]  # the fixture serves this module, too

RUBBER = dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(3.0))


def name_faces(model, low, high, dim=3):
    """Name the faces of a box by axis and end, as in ``x0`` and ``z1``."""
    for _, tag in model.getEntities(dim - 1):
        box = np.reshape(model.getBoundingBox(dim - 1, tag), (2, 3))
        for k, axis in enumerate("xyz"[:dim]):
            for end, value in enumerate((low[k], high[k])):
                if np.abs(box[:, k] - value).max() < 1e-6:
                    model.addPhysicalGroup(dim - 1, [tag], name=f"{axis}{end}")


def extruded(part: str, curved: bool = False) -> Callable:
    """A layer of prisms, of prisms beside bricks, or of bricks; flat, or a quarter ring."""

    def build(model):
        occ = model.occ
        pieces = ["quads" if part == "bricks" else "triangles"]
        pieces += ["quads"] if part == "mixed" else []
        if curved:
            p = [occ.addPoint(*x, 0) for x in ((1, 0), (2, 0), (0, 2), (0, 1))]
            arcs = [occ.addCircle(0, 0, 0, r, angle1=0, angle2=np.pi / 2) for r in (1, 2)]
            lines = [occ.addLine(p[0], p[1]), occ.addLine(p[2], p[3])]
            occ.addPlaneSurface([occ.addCurveLoop([lines[0], arcs[1], lines[1], arcs[0]])])
        else:
            for k in range(len(pieces)):
                occ.addRectangle(k, 0, 0, 1, 1)
            if len(pieces) == 2:
                occ.fragment([(2, 1)], [(2, 2)])
        occ.synchronize()
        flat = [tag for _, tag in model.getEntities(2)]
        for tag, kind in zip(flat, pieces, strict=True):
            if kind == "quads":
                for _, curve in model.getBoundary([(2, tag)], oriented=False):
                    model.mesh.setTransfiniteCurve(curve, 4)
                model.mesh.setTransfiniteSurface(tag)
                model.mesh.setRecombine(2, tag)
        occ.extrude([(2, t) for t in flat], 0, 0, 0.4, numElements=[2], recombine=True)
        occ.synchronize()
        model.addPhysicalGroup(3, [t for _, t in model.getEntities(3)], name="film")
        name_faces(model, (0, 0, 0), (2 if len(pieces) == 2 else 1, 1, 0.4))

    return build


CELLS = {
    "prisms": ("prisms", False, 1, 0),
    "prisms of 18 nodes": ("prisms", False, 2, 0),
    "prisms of 15 nodes": ("prisms", False, 2, 1),
    "prisms beside bricks": ("mixed", False, 1, 0),
    "prisms beside bricks of second order": ("mixed", False, 2, 0),
    "prisms beside bricks, incomplete": ("mixed", False, 2, 1),
    "bricks of 20 nodes": ("bricks", False, 2, 1),
    "curved prisms of 18 nodes": ("prisms", True, 2, 0),
    "curved prisms of 15 nodes": ("prisms", True, 2, 1),
    "curved bricks of 20 nodes": ("bricks", True, 2, 1),
}


def before_and_after(path: Path) -> tuple[dict, dict, tuple[str, ...]]:
    """gmsh's own measures of all groups in a file, and in what is made of it."""
    gmsh.open(str(path))
    old = measure(gmsh.model)
    names, dim = read_names(gmsh.model, "it")
    found = checked(gmsh.model, names, dim, "it")
    new = measure(gmsh.model)
    gmsh.model.remove()
    return old, new, found.notes


@pytest.mark.parametrize("case", CELLS)
def test_cells_of_all_shapes_keep_their_body(tmp_path, case):
    part, curved, order, incomplete = CELLS[case]
    path = written(
        tmp_path / "cells.msh", extruded(part, curved), 3, order, Mesh_MeshSizeMax=0.5,
        Mesh_SecondOrderIncomplete=incomplete,
    )  # fmt: skip
    old, new, notes = before_and_after(path)
    assert set(old) == set(new) and {"film", "z0", "z1"} <= set(old)
    for name in old:
        # where curved cells are divided, the pieces of a curved face keep its nodes only
        exact = not (curved and part == "prisms")
        assert new[name][2] == pytest.approx(old[name][2], rel=1e-12 if exact else 1e-3), name
    assert notes
    device = dea.read_gmsh(path, MPI.COMM_SELF)
    assert notes[-1] in device.source
    assert device.quality["least_scaled_jacobian"] > 0.05
    assert device.mesh.topology.cell_name() == (
        "hexahedron" if part == "bricks" else "tetrahedron"
    )


@pytest.mark.parametrize(("order", "incomplete"), [(1, 0), (2, 0), (2, 1)])
def test_triangles_beside_quadrilaterals(tmp_path, order, incomplete):
    def build(model):
        model.occ.addRectangle(0, 0, 0, 1, 1)
        model.occ.addRectangle(1, 0, 0, 1, 1)
        model.occ.fragment([(2, 1)], [(2, 2)])
        model.occ.synchronize()
        model.mesh.setRecombine(2, 2)
        for k in (1, 2):
            model.addPhysicalGroup(2, [k], name=f"part_{k}")
        name_faces(model, (0, 0), (2, 1), 2)

    path = written(tmp_path / "mixed.msh", build, 2, order, Mesh_MeshSizeMax=0.4,
                   Mesh_SecondOrderIncomplete=incomplete)  # fmt: skip
    old, new, notes = before_and_after(path)
    assert {n: m[2] for n, m in new.items()} == pytest.approx({n: m[2] for n, m in old.items()})
    assert notes[-1] == "quadrilaterals and triangles divided into triangles"
    assert dea.read_gmsh(path, MPI.COMM_SELF).mesh.topology.cell_name() == "triangle"


def test_pyramids_between_bricks_and_tetrahedra(tmp_path):
    """A pyramid on a brick, and a tetrahedron beside it: 1, 1/3 and 1/6 in volume."""
    gmsh.model.add("pyramid")
    x = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1),
         (0, 0, 2), (1, 0, 2)]  # fmt: skip
    gmsh.model.addDiscreteEntity(3, 1)
    gmsh.model.mesh.addNodes(3, 1, range(1, 11), np.ravel(x))
    gmsh.model.mesh.addElements(
        3, 1, [5, 7, 4], [[1], [2], [3]],
        [[1, 2, 3, 4, 5, 6, 7, 8], [5, 6, 7, 8, 9], [6, 7, 9, 10]],
    )  # fmt: skip
    gmsh.model.addPhysicalGroup(3, [1], name="film")
    gmsh.model.addDiscreteEntity(2, 1)
    gmsh.model.mesh.addElements(2, 1, [3], [[4]], [[1, 2, 3, 4]])
    gmsh.model.addPhysicalGroup(2, [1], name="bottom")
    for order in (1, 2):
        if order == 2:
            gmsh.model.mesh.setOrder(2)
        path = tmp_path / f"pyramid_{order}.msh"
        gmsh.write(str(path))
        old, new, notes = before_and_after(path)
        assert new["film"][2] == pytest.approx(1.5, rel=1e-12)
        assert new["bottom"][1:] == pytest.approx((2, 1.0))
        assert "pyramids" in notes[0]
        gmsh.model.setCurrent("pyramid")


@pytest.mark.parametrize("order", [3, 4])
def test_cells_of_higher_order(tmp_path, order):
    """Cubic triangles are read; of order 4 none are, and prisms are told by name."""
    path = written(tmp_path / "high.msh", square((1, 0, 0), (0, 1, 0)), 2, order)
    if order == 3:
        assert compat.coordinate_element(dea.read_gmsh(path, MPI.COMM_SELF).mesh).degree == 3
    else:
        refused(path, "Triangle 15", "Mesh.ElementOrder 1 or 2")
    path = written(tmp_path / "prisms.msh", extruded("prisms"), 3, order, Mesh_MeshSizeMax=1)
    refused(path, "'Prism ", "Mesh.ElementOrder 1 or 2")


def test_a_film_of_prisms_has_its_exact_stretch(tmp_path, quick_compile):
    """Free film under voltage: mu (l^2 - l^-4) = eps (V/T)^2 l^4."""
    path = written(tmp_path / "film.msh", extruded("prisms"), 3, Mesh_MeshSizeMax=2)
    device = dea.read_gmsh(path, MPI.COMM_SELF, unit=1e-3)
    volts, mu = 7e3, 5e4
    field = RUBBER.electric.permittivity() * (volts / 0.4e-3) ** 2
    exact = brentq(lambda s: mu * (s**2 - s**-4) - field * s**4, 1, 1.2)
    scene = dea.Scene(
        device, {"film": RUBBER}, [dea.Electrode("z1", volts), dea.Ground("z0")],
        [dea.Fix("x0", "x"), dea.Fix("y0", "y"), dea.Fix("z0", "z")],
    )  # fmt: skip
    run = dea.solve(scene, dea.Ramp(steps=2), {
        "x": dea.MeanStretch(("x0", "x1"), "x"), "z": dea.MeanStretch(("z0", "z1"), "z"),
    }, quiet=True)  # fmt: skip
    assert run["x"] == pytest.approx(exact, rel=1e-8)
    assert run["z"] == pytest.approx(exact**-2, rel=1e-8)


# ----------------------------------------------------------------------- drawings with curved cells

HOLE = """SetFactory("OpenCASCADE");
Box(1) = {-2, -2, 0, 4, 4, 0.6}; Cylinder(2) = {0, 0, -1, 0, 0, 4, 1};
BooleanDifference(3) = { Volume{1}; Delete; }{ Volume{2}; Delete; };
e() = Curve In BoundingBox {-1.1, -1.1, -0.1, 1.1, 1.1, 0.1};
e() += Curve In BoundingBox {-1.1, -1.1, 0.5, 1.1, 1.1, 0.7};
Fillet{3}{e()}{0.1}
Physical Volume("film") = Volume{:}; Physical Surface("hull") = Surface{:};
"""


def test_fillets_do_not_invert_curved_cells(tmp_path, capsys):
    """A plate with a hole and two fillets, from .geo and from STEP: sound cells, exact volume."""
    drawing, step = tmp_path / "plate.geo", tmp_path / "plate.step"
    drawing.write_text(HOLE)
    gmsh.merge(str(drawing))
    exact = gmsh.model.occ.getMass(3, gmsh.model.getEntities(3)[0][1])
    gmsh.write(str(step))
    gmsh.option.setNumber("Mesh.MeshSizeMax", 2)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(2)
    tags = gmsh.model.mesh.getElementsByType(11)[0]
    assert np.min(gmsh.model.mesh.getElementQualities(tags, "minSJ")) < 0  # as gmsh leaves them
    gmsh.clear()
    for path, size in ((drawing, 2.0), (step, 2e-3)):
        device = dea.read_gmsh(path, MPI.COMM_SELF, size=size)
        assert device.quality["least_scaled_jacobian"] > 0.02
        check_cells(device, 4)
        straight = dea.read_gmsh(path, MPI.COMM_SELF, size=size, curved=False)
        assert straight.quality["least_scaled_jacobian"] == pytest.approx(1)
    capsys.readouterr()
    volumes = []
    for option in ([], ["--straight"]):
        assert cli.main(["mesh", str(step), "--size", "2e-3", *option]) == 0
        line = next(x for x in capsys.readouterr().out.splitlines() if " m3 " in x)
        volumes.append(float(line.split(" m3 ")[0].split()[-1]) / 1e-9)
    assert volumes[0] == pytest.approx(exact, rel=3e-4)
    assert abs(volumes[1] - exact) > 5 * abs(volumes[0] - exact)


def on_all_ranks(comm) -> list:
    """What each mesh comes to on some ranks: facets of its groups, or a sentence."""
    folder, found = Path(comm.bcast(os.environ["MESHES"], root=0)), []
    for name in ("plate.geo", "prisms.msh", "loose.msh", "script.msh"):
        try:
            device = dea.read_gmsh(folder / name, comm)
        except dea.InputError as error:
            found.append(str(error).replace(str(folder), ""))
            continue
        owned = device.mesh.topology.index_map(device.dim - 1).size_local
        counts = {n: int(np.sum(device.facets_of(n) < owned)) for n in sorted(device.surfaces)}
        found.append({n: comm.allreduce(c) for n, c in counts.items()})
    assert all(other == found for other in comm.allgather(found))
    return found


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_the_same_on_several_ranks(tmp_path, on_ranks, monkeypatch, ranks):
    (tmp_path / "plate.geo").write_text(PLATE)
    (tmp_path / "script.msh").write_text(PLATE)
    written(tmp_path / "prisms.msh", extruded("prisms"), 3, Mesh_MeshSizeMax=2)
    written(tmp_path / "loose.msh", layers(3, 3), 2)
    monkeypatch.setenv("MESHES", str(tmp_path))
    gmsh.option.restoreDefaults()
    alone = on_all_ranks(MPI.COMM_SELF)
    assert alone[0] == COUNTS and isinstance(alone[1], dict)
    assert "touch" in alone[2] and "$MeshFormat" in alone[3]
    assert on_ranks("test_foreign_cells", "on_all_ranks", ranks) == alone
