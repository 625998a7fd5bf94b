"""Parts in one another or turned against each other, and cells that gmsh cannot describe."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import gmsh
import pytest
from mpi4py import MPI
from test_foreign_meshes import MSH2, own_gmsh, refused, written

import dea_fenicsx as dea
from dea_fenicsx import cli
from dea_fenicsx.mesh.foreign.splitting import _plural

__all__ = ["own_gmsh"]  # the fixture serves this module, too


def core(turn: float, gap: float = 0.0) -> Callable:
    """A disc of radius 1 - gap in a ring with a hole of radius 1, turned against it."""
    def build(model):
        occ = model.occ
        disc = occ.addDisk(0, 0, 0, 1 - gap, 1 - gap)
        hole = occ.addDisk(0, 0, 0, 1, 1)
        ring, _ = occ.cut([(2, occ.addDisk(0, 0, 0, 2, 2))], [(2, hole)])
        occ.rotate([(2, disc)], 0, 0, 0, 0, 0, 1, turn)
        occ.synchronize()
        model.addPhysicalGroup(2, [disc], name="core")
        model.addPhysicalGroup(2, [ring[0][1]], name="ring")

    return build


def pair(first: tuple, second: tuple, recombine: bool = False) -> Callable:
    """Two rectangles or boxes, each given by its corner and its edges, that are not joined."""
    dim = len(first) // 2

    def build(model):
        for k, numbers in enumerate((first, second)):
            if dim == 2:
                model.occ.addRectangle(*numbers[:2], 0, *numbers[2:])
            else:
                model.occ.addBox(*numbers)
            model.occ.synchronize()
            if recombine:
                model.mesh.setRecombine(2, k + 1)
            model.addPhysicalGroup(dim, [k + 1], name=("film", "fibre")[k])

    return build


@pytest.mark.parametrize("size", [0.4, 0.26, 0.13])
@pytest.mark.parametrize("turn", [0.005, 0.02, 0.05, 0.1])
def test_round_parts_that_are_turned_against_each_other_touch(tmp_path, turn, size):
    """The chords of one circle cross, and are equally far apart at both ends."""
    path = written(tmp_path / "turned.msh", core(turn), 2, Mesh_MeshSizeMax=size)
    refused(path, "'core' and 'ring' touch, but are not joined")
    # parts that touch cut into each other by the bulge of their chords, which is no overlap
    assert set(dea.read_gmsh(path, MPI.COMM_SELF, apart=True).regions) == {"core", "ring"}


@pytest.mark.parametrize("size", [0.785, 0.52])
def test_coarse_round_parts_may_move_apart(tmp_path, size):
    """Eight chords round the circle bulge by a tenth of their length; without apart it is told."""
    path = written(tmp_path / "coarse.msh", core(0.2), 2, Mesh_MeshSizeMax=size)
    refused(path, "regions 'core' and 'ring'")
    assert set(dea.read_gmsh(path, MPI.COMM_SELF, apart=True).regions) == {"core", "ring"}


@pytest.mark.parametrize("turn", [0.0, 0.05, 0.1])
@pytest.mark.parametrize("order", [1, 2])
def test_a_round_gap_is_no_contact(tmp_path, turn, order):
    path = written(tmp_path / "gap.msh", core(turn, 0.02), 2, order, Mesh_MeshSizeMax=0.2)
    assert set(dea.read_gmsh(path, MPI.COMM_SELF).regions) == {"core", "ring"}


OVERLAPS = {
    "pokes out": ((0, 0, 10, 1), (-1, 0.25, 10, 0.5)),
    "lies inside": ((0, 0, 10, 1), (2, 0.25, 5, 0.5)),
    "by a tenth": ((0, 0, 10, 1), (0, 0.9, 10, 1)),
    "thin fibre across": ((0, 0, 10, 1), (4, -1, 0.01, 3)),
    "the same": ((0, 0, 10, 1), (0, 0, 10, 1)),
    "solid pokes out": ((0, 0, 0, 4, 1, 1), (-0.5, 0.2, 0.3, 3, 0.5, 0.4)),
}


@pytest.mark.parametrize("case", OVERLAPS)
@pytest.mark.parametrize("apart", [False, True])
def test_parts_in_one_another_are_told(tmp_path, case, apart):
    """Also with apart=True, for two bodies never fill one place."""
    build = pair(*OVERLAPS[case], recombine=apart)
    dim = len(OVERLAPS[case][0]) // 2
    path = written(tmp_path / "in.msh", build, dim, Mesh_MeshSizeMax=0.4)
    text = refused(path, "'film' and 'fibre' lie in one another", "BooleanFragments", apart=apart)
    place = [float(v) for v in text.split("example at (")[1].split(")")[0].split(",")]
    for numbers in OVERLAPS[case]:  # the place lies in both parts
        for v, low, width in zip(place, numbers[:dim], numbers[dim:], strict=True):
            assert low - 1e-3 <= v <= low + width + 1e-3


SEPARATE = {
    "side by side": ((0, 0, 10, 1), (0, 2, 10, 1)),
    "beside a narrow gap": ((0, 0, 10, 1), (0, 1.001, 7, 1)),
    "solids corner to corner": ((0, 0, 0, 1, 1, 1), (1.01, 1.01, 1.01, 1, 1, 1)),
}


@pytest.mark.parametrize("case", SEPARATE)
def test_separate_parts_are_read(tmp_path, case):
    dim = len(SEPARATE[case][0]) // 2
    path = written(tmp_path / "two.msh", pair(*SEPARATE[case]), dim, Mesh_MeshSizeMax=0.4)
    assert set(dea.read_gmsh(path, MPI.COMM_SELF).regions) == {"film", "fibre"}


PRISMS = """SetFactory("OpenCASCADE"); Rectangle(1) = {0, 0, 0, 1, 1};
Extrude {0, 0, 0.4} { Surface{1}; Layers{1}; Recombine; }
Physical Volume("film") = {1}; Mesh.MeshSizeMax = 1;
"""


def test_a_drawing_of_cubic_prisms_does_not_end_the_process(start, tmp_path):
    """With gmsh as it begins, in a process of its own."""
    drawing, script = tmp_path / "prisms.geo", tmp_path / "read.py"
    drawing.write_text(PRISMS + "Mesh.ElementOrder = 3;\n")
    script.write_text(
        "import sys\nimport dea_fenicsx as dea\n"
        "try:\n    dea.read_gmsh(sys.argv[1])\nexcept dea.InputError as error:\n    print(error)\n"
    )
    assert "Prism of order 3" in start(script, drawing, check=True).stdout


@pytest.mark.parametrize("order", [3, 4])
def test_prisms_of_high_order_are_told(tmp_path, capsys, order):
    """Gmsh writes them, but cannot describe them: as a drawing, as a mesh and on the shell."""
    drawing, path = tmp_path / "prisms.geo", tmp_path / "prisms.msh"
    drawing.write_text(PRISMS + f"Mesh.ElementOrder = {order};\n")
    refused(drawing, f"Prism of order {order}")
    gmsh.clear()
    gmsh.option.setNumber("Mesh.ElementOrder", order)
    gmsh.merge(str(drawing))
    gmsh.model.mesh.generate(3)
    gmsh.write(str(path))
    gmsh.clear()
    refused(path, f"Prism of order {order}", "ElementOrder 1 or 2")
    assert cli.main(["mesh", str(path)]) == 2
    assert f"Prism of order {order}" in capsys.readouterr().err


def test_a_cell_with_a_repeated_corner_gives_no_raw_warning(tmp_path):
    path = tmp_path / "repeated.msh"
    path.write_text(MSH2.replace("3 3 2 3 1 10 20 50 40", "3 3 2 3 1 10 50 40 40"))
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        device = dea.read_gmsh(path, MPI.COMM_SELF)
    assert device.quality["largest_aspect"] == float("inf")


def test_plurals_of_shapes():
    shapes = {"tetrahedron": "tetrahedra", "hexahedron": "hexahedra", "prism": "prisms"}
    assert {shape: _plural(shape) for shape in shapes} == shapes
