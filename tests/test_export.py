"""Results and meshes in the files of others, read back by pyvista and meshio."""

from __future__ import annotations

import csv
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI
from test_field_writer import size_of

import dea_fenicsx as dea
from dea_fenicsx.cli import main
from dea_fenicsx.geometry import BoxStack, HollowSphere, Layer
from dea_fenicsx.mesh.named_mesh import NamedMesh, serendipity
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.results.abaqus import ABAQUS_FACES, element, input_file, names_for
from dea_fenicsx.results.fields import FieldWriter
from dea_fenicsx.results.reading import read_frame

pyvista = pytest.importorskip("pyvista")
L = 1e-3
SOFT = dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(3.0))


def meshio():
    return pytest.importorskip("meshio")


@pytest.fixture(scope="module")
def run(tmp_path_factory, small_compile):
    """An incompressible film under a compressible one; Abaqus does not take all names."""
    layers = [Layer("film, 1", 0.5 * L), Layer("cover", 0.5 * L)]
    device = dea.read_gmsh(BoxStack(2 * L, L, layers, (2, 1)), MPI.COMM_SELF)
    cover = dea.Material(dea.NeoHookean(1e5), dea.IdealDielectric(3.0), bulk_modulus=1e6)
    scene = dea.Scene(
        device, {"film, 1": SOFT, "cover": cover},
        [dea.Electrode("interface_1", 3e3), dea.Ground("bottom")], [dea.Clamp("x_min")],
    )  # fmt: skip
    out = tmp_path_factory.mktemp("export") / "run"
    return dea.solve(scene, dea.Ramp(steps=1), out=out, quiet=True, stability="never").out


def volume(points, cells, vtk):
    """Volume by VTK's own shape functions and three Gauss points an axis."""
    import vtkmodules.vtkCommonDataModel as model

    cell = {25: model.vtkQuadraticHexahedron, 29: model.vtkTriQuadraticHexahedron}[vtk]()
    x, w = np.polynomial.legendre.leggauss(3)
    total = 0.0
    for i, j, k in np.ndindex(3, 3, 3):
        derivatives = [0.0] * (3 * cells.shape[1])
        cell.InterpolateDerivs([(x[n] + 1) / 2 for n in (i, j, k)], derivatives)
        gradient = np.array(derivatives).reshape(3, -1)
        jacobian = np.einsum("an,cnb->cab", gradient, points[cells])
        total += w[i] * w[j] * w[k] / 8 * np.linalg.det(jacobian).sum()
    return total


# ----------------------------------------------------------------------------------------- VTU


def test_vtu_in_pyvista_and_meshio(run, tmp_path, capsys):
    assert main(["export", str(run), "--vtu", "--all"]) == 0
    files = [run / "export" / f"step_0000{k}.vtu" for k in (0, 1)]
    assert capsys.readouterr().out.split() == [str(file) for file in files]
    frame = read_frame(run).grid
    read = pyvista.read(files[1])
    moved = np.asarray(frame.point_data["displacement_m"])
    assert np.array_equal(read.point_data["displacement_m"], moved) and np.abs(moved).max() > 1e-6
    cells = read.cells_dict[29]
    assert volume(np.asarray(read.points), cells, 29) == pytest.approx(2 * L**3, rel=1e-12)
    assert read.cell_data["region film, 1"].tolist() == [1, 1, 0, 0]
    top = np.flatnonzero(read.point_data["surface top"])
    assert np.asarray(read.points)[top, 2] == pytest.approx(L) and len(top) == 15
    stress = read.GetCellData().GetArray("cauchy_stress_Pa")
    assert [stress.GetComponentName(k) for k in (0, 1, 8)] == ["xx", "xy", "zz"]
    other = meshio().read(files[1])
    assert other.cells[0].type == "hexahedron27"
    assert np.array_equal(other.point_data["displacement_m"], moved)
    assert other.point_data["surface top"].sum() == 15
    assert other.cell_data["region cover"][0].tolist() == [0, 0, 1, 1]


def test_vtkhdf_in_vtks_own_reader(run, tmp_path, capsys):
    """All steps with their times, the same numbers as in nodal.xdmf, and the names."""
    if pyvista.vtk_version_info < (9, 4):
        pytest.skip("VTK reads these files from 9.4 on")
    target = tmp_path / "film.vtkhdf"
    assert main(["export", str(run), "--vtkhdf", "--out", str(target)]) == 0
    assert capsys.readouterr().out.strip() == str(target)
    from vtkmodules.vtkIOHDF import vtkHDFReader

    reader = vtkHDFReader()
    reader.SetFileName(str(target))
    reader.UpdateInformation()
    assert reader.GetNumberOfSteps() == 2
    for step in (0, 1):
        reader.SetStep(step)
        reader.Update()
        assert reader.GetTimeValue() == pytest.approx(float(step))
        read, frame = pyvista.wrap(reader.GetOutput()), read_frame(run, step, nodal=True).grid
        moved = np.asarray(frame.point_data["displacement_m"])
        assert np.asarray(read.point_data["displacement_m"]) == pytest.approx(moved, rel=1e-6)
        assert np.array_equal(read.points, frame.points)
    assert np.abs(moved).max() > 1e-6
    assert volume(np.asarray(read.points), read.cells_dict[29], 29) == pytest.approx(2 * L**3)
    assert read.cell_data["region film, 1"].tolist() == [1, 1, 0, 0]
    top = np.flatnonzero(read.point_data["surface top"])
    assert np.asarray(read.points)[top, 2] == pytest.approx(L) and len(top) == 15


# -------------------------------------------------------------------------------------- Abaqus


def test_abaqus_of_results(run, tmp_path):
    target = tmp_path / "film.inp"
    assert main(["export", str(run), "--inp", "--out", str(target)]) == 0
    text = target.read_text()
    assert "*ELEMENT, TYPE=C3D20H, ELSET=film__1\n" in text  # incompressible
    assert "*ELEMENT, TYPE=C3D20, ELSET=cover\n" in text  # compressible
    assert "** film__1 is film, 1\n" in text
    assert max(len(line.split(",")) for line in text.splitlines() if line[0].isdigit()) <= 17
    mesh = meshio().read(target)
    assert [block.type for block in mesh.cells] == ["hexahedron20"] * 2
    cells = np.vstack([block.data for block in mesh.cells])
    assert volume(mesh.points, cells, 25) == pytest.approx(2 * L**3, rel=1e-12)
    assert {"top", "bottom", "x_min", "interface_1"} <= set(mesh.point_sets)
    assert mesh.points[mesh.point_sets["top"], 2] == pytest.approx(L)
    assert len(mesh.point_sets["top"]) == 13  # two faces of eight nodes
    # the numbers are those of the table and of fields.xdmf
    numbers = [int(line.split(",")[0]) for line in text.split("*NODE\n")[1].split("*")[0].split()
               if line.endswith(",") and line[:-1].isdigit()]  # fmt: skip
    places = np.asarray(read_frame(run).grid.points)[np.array(numbers) - 1]
    assert mesh.points == pytest.approx(places)
    # faces by the numbers of Abaqus
    sides = text.split("*SURFACE, NAME=top, TYPE=ELEMENT\n")[1].split("*")[0].split("\n")[:-1]
    for side in sides:
        row, face = side.split(", S")
        corners = cells[int(row) - 1][list(ABAQUS_FACES["hexahedron"][int(face) - 1])]
        assert mesh.points[corners, 2] == pytest.approx(L)
    assert len(sides) == 2


def test_cells_that_curve_in_two_directions():
    """27 nodes become 20: the volume of a spherical wall stays to 1e-4."""
    device = dea.read_gmsh(HollowSphere(1e-3, 1.2e-3, "octant", 1, 4), MPI.COMM_SELF)
    grid = FieldWriter(Problem(dea.Scene(
        device, {"wall": SOFT}, supports=[dea.Clamp("x_min")]
    ))).grid  # fmt: skip
    mesh = NamedMesh(grid.points, grid.cells, grid.kind)
    whole = size_of(grid.points, grid.cells, grid.kind, 2)
    assert whole == pytest.approx(np.pi / 6 * (1.2**3 - 1) * 1e-9, rel=2e-3)
    assert volume(grid.points, grid.cells, 29) == pytest.approx(whole, rel=1e-9)
    assert volume(grid.points, serendipity(mesh), 25) == pytest.approx(whole, rel=1e-4)


@pytest.mark.parametrize(("kind", "nodes", "kinematics", "hybrid", "name"), [
    ("tetrahedron", 10, "", True, "C3D10H"), ("tetrahedron", 4, "", False, "C3D4"),
    ("hexahedron", 8, "", True, "C3D8H"), ("quadrilateral", 8, "PlaneStrain", True, "CPE8H"),
    ("triangle", 6, "Axisymmetric", True, "CAX6H"), ("triangle", 3, "Axisymmetric", False, "CAX3"),
    ("quadrilateral", 8, "PlaneStress", True, "CPS8"),
])  # fmt: skip
def test_names_of_elements(kind, nodes, kinematics, hybrid, name):
    assert element(kind, nodes, kinematics, hybrid) == name


def test_names_of_sets_are_safe_and_different():
    found = names_for(["Top", "top", "1st", "a\n*STEP", "ä" * 200])
    assert found["Top"] == "Top" and found["top"] == "top_2" and found["1st"] == "N1st"
    assert found["a\n*STEP"] == "a__STEP" and len(found["ä" * 200]) <= 80
    grid = SimpleNamespace(points=np.eye(4, 3), cells=np.array([[3, 0, 1, 2]]))
    mesh = NamedMesh(grid.points, grid.cells, "tetrahedron", {"a\n*STEP": np.array([0])},
                     {"f": np.array([[0, 1, 2]])}, {"f": np.array([0, 1, 2])})  # fmt: skip
    text = input_file(mesh, title="*STEP\n*END")
    assert "\n*STEP" not in text and "\n*END" not in text
    assert "*SURFACE, NAME=f, TYPE=ELEMENT\n1, S3\n" in text


@pytest.mark.parametrize(("width", "kind"), [(L, "hexahedron20"), (None, None)])
def test_abaqus_of_a_mesh(tmp_path, capsys, width, kind):
    file, target = tmp_path / "stack.msh", tmp_path / "stack.inp"
    BoxStack(2 * L, width, [Layer("a", L), Layer("b", L)], 2).write(file)
    assert main(["export", str(file), "--inp"]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == str(target)
    text = target.read_text()
    if kind is None:
        assert "*ELEMENT, TYPE=CPE8H, ELSET=a\n" in text
    else:
        mesh = meshio().read(target)
        cells = np.vstack([block.data for block in mesh.cells if block.type == kind])
        assert volume(mesh.points, cells, 25) == pytest.approx(4 * L**3, rel=1e-9)
        assert mesh.points[mesh.point_sets["interface_1"], 2] == pytest.approx(L)
        assert {"a", "b"} <= set(mesh.cell_sets)
    assert main(["export", str(file), "--inp"]) == 2 and target.read_text() == text
    assert "exists already" in capsys.readouterr().err


# ----------------------------------------------------------------------------- tables, refusals


def test_table_of_nodes(run, tmp_path):
    target = tmp_path / "nodes.csv"
    assert main(["export", str(run), "--csv", "--out", str(target)]) == 0
    with open(target, newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(set(rows[0])) == len(rows[0])
    frame = read_frame(run).grid
    moved = np.asarray(frame.point_data["displacement_m"])
    for row in rows:
        place = int(row["node"]) - 1
        assert float(row["x_m"]) == pytest.approx(frame.points[place, 0], abs=1e-12)
        assert float(row["displacement_z_m"]) == pytest.approx(moved[place, 2], abs=1e-10)
    both = [r["region"] for r in rows if abs(float(r["z_m"]) - 0.5 * L) < 1e-9]
    assert sorted(set(both)) == ["cover", "film, 1"] and len(both) == 30


@pytest.mark.parametrize(("options", "words"), [
    ([], "--vtu, --vtkhdf, --inp or --csv"),
    (["--vtu", "--csv", "--out", "x"], "several are asked for"),
    (["--vtu", "--step", "9"], "Step 9 is not in"),
])  # fmt: skip
def test_refusals(run, capsys, options, words):
    assert main(["export", str(run), *options]) == 2
    assert words in capsys.readouterr().err
