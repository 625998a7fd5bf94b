"""The result files as VTK and ParaView read them, and the same files from 1 and 2 ranks."""

from __future__ import annotations

import csv
import importlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import clean_environment, needed_mpirun

pyvista = pytest.importorskip("pyvista")

from dea_fenicsx.results.reading import read_frame  # noqa: E402
from dea_fenicsx.support.cell_types import QUADRATIC  # noqa: E402

LENGTH, WIDTH, HEIGHT, VOLTS = 2e-3, 1.5e-3, 5e-4, 4e3
NODAL = {"displacement_m", "potential_V"}
CELLWISE = {
    "region", "J", "cauchy_stress_Pa", "pressure_Pa", "electric_field_V_per_m",
    "field_strength_V_per_m", "field_strength_MV_per_m",
}  # fmt: skip
SCRIPT = f"""
import sys
import dea_fenicsx as dea
from mpi4py import MPI
from dea_fenicsx.geometry import BoxStack, Layer
box = BoxStack({LENGTH}, {WIDTH}, [Layer("elastomer", {HEIGHT})], (2, 2))
device = dea.read_gmsh(box, MPI.COMM_WORLD)
silicone = dea.Material(dea.NeoHookean(73.7e3), dea.IdealDielectric(4.7))
rollers = [dea.Fix("bottom", "z"), dea.Fix("x_min", "x"), dea.Fix("y_min", "y")]
supports = rollers if "free" in sys.argv else [dea.Clamp("bottom")]
scene = dea.Scene(device, {{"elastomer": silicone}},
                  [dea.Electrode("top", {VOLTS}), dea.Ground("bottom")], supports)
record = {{"top": dea.LargestDisplacement("top", "z"), "mean": dea.MeanDisplacement("top", "z")}}
dea.solve(scene, dea.Ramp("voltage", steps=3), record, out=sys.argv[1], quiet=True)
"""


def start(folder: Path, *options: str, ranks: int = 1) -> Path:
    """Run the script in a process of its own."""
    command = [sys.executable, "-c", SCRIPT, str(folder), *options]
    if ranks > 1:
        mpirun = needed_mpirun()
        command = [mpirun, "-n", str(ranks), *command]
    done = subprocess.run(
        command, env=clean_environment(), capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.fixture(scope="module")
def clamped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Clamped at its bottom, so that the deformed cells are curved."""
    return start(tmp_path_factory.mktemp("vtk") / "clamped")


@pytest.fixture(scope="module")
def free(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """On rollers, so that the deformation is homogeneous."""
    return start(tmp_path_factory.mktemp("vtk") / "free", "free")


def rows(folder: Path) -> list[dict[str, str]]:
    with open(folder / "history.csv", newline="") as f:
        return list(csv.DictReader(f))


def gauss() -> tuple[np.ndarray, np.ndarray]:
    """Three Gauss points an axis on the unit cube: exact for the volume of a hexahedron of 27."""
    x, w = np.polynomial.legendre.leggauss(3)
    x, w = (x + 1) / 2, w / 2
    points = np.stack(np.meshgrid(x, x, x, indexing="ij"), -1).reshape(-1, 3)
    return points, np.einsum("i,j,k->ijk", w, w, w).ravel()


def jacobians(grid, points: np.ndarray) -> np.ndarray:
    """det dx/dxi by VTK's own shape functions, shape (cells, points)."""
    nodes = np.asarray(grid.points, dtype=float)[grid.cells_dict[29]]
    found = []
    for point in points:
        derivatives = [0.0] * 81
        grid.GetCell(0).InterpolateDerivs(list(point), derivatives)
        gradient = np.array(derivatives).reshape(3, 27)
        found.append(np.linalg.det(np.einsum("an,cnb->cab", gradient, nodes)))
    return np.array(found).T


def volume(grid) -> float:
    points, weights = gauss()
    return float((jacobians(grid, points) @ weights).sum())


def warp(grid):
    """The deformed grid, in double precision."""
    moved = grid.copy()
    moved.points = np.asarray(grid.points) + np.asarray(grid.point_data["displacement_m"])
    return moved


def xdmf_frames(folder: Path) -> list:
    """Every step through VTK's XDMF reader."""
    try:
        importlib.import_module("vtkmodules.vtkIOXdmf2")
    except ImportError:
        pytest.skip("this VTK was built without its XDMF reader")
    reader = pyvista.get_reader(str(folder / "fields.xdmf"))
    grids = []
    for time in reader.time_values:
        reader.set_active_time_value(time)
        grids.append((time, reader.read()))
    return grids


# ------------------------------------------------------------------- node order


@pytest.mark.parametrize(
    ("kind", "name"),
    [("triangle", "vtkQuadraticTriangle"), ("quadrilateral", "vtkBiQuadraticQuad"),
     ("tetrahedron", "vtkQuadraticTetra"), ("hexahedron", "vtkTriQuadraticHexahedron")],
)  # fmt: skip
def test_node_order_is_vtks(kind: str, name: str) -> None:
    importlib.import_module("dea_fenicsx.support.compat")  # before DOLFINx itself
    basix = importlib.import_module("basix")
    model = importlib.import_module("vtkmodules.vtkCommonDataModel")
    cell = getattr(model, name)()
    element = basix.create_element(
        basix.ElementFamily.P, getattr(basix.CellType, kind), 2, basix.LagrangeVariant.gll_warped
    )
    ours = element.points[list(QUADRATIC[kind].vtk_order)]
    n = cell.GetNumberOfPoints()
    assert len(ours) == n
    for k, point in enumerate(ours):
        values = [0.0] * n
        cell.InterpolateFunctions([*point, 0.0][:3], values)
        assert np.allclose(values, np.eye(n)[k], atol=1e-13)


# ---------------------------------------------------------------------- reading


def test_xdmf_reader_finds_every_field_at_every_time(clamped: Path) -> None:
    frames = xdmf_frames(clamped)
    history = rows(clamped)
    assert len(frames) == len(history) == 4
    assert [t for t, _ in frames] == pytest.approx([float(r["time"]) for r in history])
    for k, (_, grid) in enumerate(frames):
        assert isinstance(grid, pyvista.UnstructuredGrid)
        assert set(grid.point_data) == NODAL
        assert set(grid.cell_data) == CELLWISE
        assert (grid.n_cells, grid.n_points) == (4, 75)
        own = read_frame(clamped, k).grid
        assert np.array_equal(grid.cells_dict[29], own.cells_dict[29])
        assert np.array_equal(grid.points, own.points)
        for field in NODAL:
            assert np.array_equal(grid.point_data[field], own.point_data[field])
        for field in CELLWISE:
            assert np.array_equal(grid.cell_data[field], own.cell_data[field])


def test_values_agree_with_the_history(clamped: Path) -> None:
    for k, row in enumerate(rows(clamped)):
        grid = read_frame(clamped, k).grid
        assert set(grid.point_data) == NODAL
        assert set(grid.cell_data) == CELLWISE
        top = np.isclose(grid.points[:, 2], HEIGHT)
        u = grid.point_data["displacement_m"][top, 2]
        assert top.sum() == 25
        assert u[np.abs(u).argmax()] == pytest.approx(float(row["top_m"]), rel=1e-12, abs=1e-20)
        potential = grid.point_data["potential_V"]
        assert potential.max() == pytest.approx(float(row["voltage_V"]), rel=1e-9)
        assert potential.min() == pytest.approx(0, abs=1e-9)
        peak, strength = float(row["max_field_V_per_m"]), grid.cell_data["field_strength_V_per_m"]
        assert 0.5 * peak <= strength.max() <= peak * (1 + 1e-9)
        assert np.abs(grid.cell_data["J"] - 1).max() < 0.05


def test_deformed_cells_keep_their_volume_by_vtks_shape_functions(clamped: Path) -> None:
    frame = read_frame(clamped)
    reference = LENGTH * WIDTH * HEIGHT
    moved = warp(frame.grid)
    assert volume(frame.grid) == pytest.approx(reference, rel=1e-12)
    assert volume(moved) == pytest.approx(reference, rel=1e-6)
    nodes = np.reshape(moved.GetCell(0).GetParametricCoords(), (-1, 3))
    assert jacobians(moved, np.vstack([gauss()[0], nodes])).min() > 0
    # the cells are curved: the volume between their corners is another one
    corners = np.asarray(moved.points)[moved.cells_dict[29][:, :8]]
    hexahedra = pyvista.UnstructuredGrid(
        {pyvista.CellType.HEXAHEDRON: np.arange(32).reshape(4, 8)}, corners.reshape(-1, 3)
    )
    assert abs(hexahedra.volume / reference - 1) > 1e-4


def test_homogeneous_state_point_by_point(free: Path) -> None:
    row = rows(free)[-1]
    grid = read_frame(free).grid
    stretch = 1 + float(row["mean_m"]) / HEIGHT
    assert 0.8 < stretch < 0.99
    z = grid.points[:, 2]
    across = stretch**-0.5
    expected = grid.points * [across - 1, across - 1, stretch - 1]
    assert np.abs(grid.point_data["displacement_m"] - expected).max() < 1e-9 * HEIGHT
    assert np.allclose(grid.point_data["potential_V"], VOLTS * z / HEIGHT, atol=1e-7 * VOLTS)
    assert np.allclose(grid.cell_data["J"], 1, atol=1e-9)
    field = VOLTS / (HEIGHT * stretch)
    assert np.allclose(grid.cell_data["field_strength_V_per_m"], field, rtol=1e-9)
    assert np.allclose(grid.cell_data["electric_field_V_per_m"], [0, 0, -field], atol=1e-8 * field)
    stress = grid.cell_data["cauchy_stress_Pa"].reshape(-1, 3, 3)
    assert np.allclose(stress, stress.transpose(0, 2, 1))
    assert np.allclose(grid.cell_data["pressure_Pa"], -np.trace(stress, axis1=1, axis2=2) / 3)


@pytest.mark.mpi
def test_grid_and_fields_are_the_same_on_two_ranks(
    clamped: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    two = start(tmp_path_factory.mktemp("vtk") / "two", ranks=2)
    assert json.loads((two / "summary.json").read_text())["ranks"] == 2
    for k in range(4):
        a, b = read_frame(clamped, k).grid, read_frame(two, k).grid
        assert np.array_equal(a.cells_dict[29], b.cells_dict[29])
        assert np.abs(a.points - b.points).max() < 1e-15 * LENGTH
        for data in ("point_data", "cell_data"):
            one, other = getattr(a, data), getattr(b, data)
            assert set(one) == set(other)
            for name in one:
                size = np.abs(one[name]).max()
                assert np.abs(one[name] - other[name]).max() <= 1e-8 * size, name
