"""The writer of fields: cells of both degrees, surfaces as grids of their own, and the time."""

from __future__ import annotations

import dataclasses
import shutil
from functools import partial
from types import SimpleNamespace

import basix
import basix.ufl
import h5py
import numpy as np
import pytest
from conftest import block, numbers_of_ranks
from mpi4py import MPI
from stopped_runs import HEIGHT, Stop, scene
from test_energy_observables import Cylinder

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.model import problem as problem_module
from dea_fenicsx.model.fields import Role, declared_fields
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.results import xdmf
from dea_fenicsx.results.fields import FieldWriter
from dea_fenicsx.results.folder import Folder
from dea_fenicsx.results.grids import Grid, surface_grid
from dea_fenicsx.results.history import field_times
from dea_fenicsx.results.surface_names import surface_document
from dea_fenicsx.run import session
from dea_fenicsx.support.cell_types import BY_DEGREE, CORNERS

pytestmark = pytest.mark.usefixtures("quick_compile")
FILM = dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(3.0), bulk_modulus=2e5)
L = 1e-3


def make_problem(device, elements=None):
    """A clamped block with a field; its unknowns are for the test to set."""
    kinematics = dea.ThreeD() if device.dim == 3 else dea.PlaneStrain()
    return Problem(dea.Scene(
        device, dict.fromkeys(device.regions, FILM),
        [dea.Electrode("bottom", 10.0), dea.Ground("top")], [dea.Clamp("bottom")],
        kinematics=kinematics, elements=elements or dea.Discretisation(),
    ))  # fmt: skip


def with_degree(monkeypatch, degree):
    """Give the displacement another degree in what follows."""

    def declared(scene):
        cell = scene.device.mesh.topology.cell_name()
        shape = (scene.device.dim,)
        element = basix.ufl.element("Lagrange", cell, degree, shape=shape)
        return [
            dataclasses.replace(field, element=element) if field.role is Role.MOTION else field
            for field in declared_fields(scene)
        ]

    monkeypatch.setattr(problem_module, "declared_fields", declared)


def put(problem, displacement, potential=None):
    """Set the displacement to functions of the dimensionless positions, shape (n, 3)."""
    for function, part in zip(displacement, problem.displacement, strict=False):
        x = part.space.tabulate_dof_coordinates()
        problem.w.x.array[part.dofs] = function(x)
    if potential is not None:
        part = problem.potential
        problem.w.x.array[part.dofs] = potential(part.space.tabulate_dof_coordinates())


def size_of(points, cells, kind, degree):
    """Length, area or volume of a grid by quadrature of the map from the reference cell."""
    cell = basix.CellType.interval if kind == "line" else getattr(basix.CellType, kind)
    variant = basix.LagrangeVariant.gll_warped
    element = basix.create_element(basix.ElementFamily.P, cell, degree, variant)
    places, weights = basix.make_quadrature(cell, 16)
    table = element.tabulate(1, places)[1:, :, :, 0]
    order = np.argsort(BY_DEGREE[degree][kind].vtk_order)  # back to basix's
    slopes = np.einsum("dqn,cnx->cqdx", table, points[cells[:, order]])
    metric = np.einsum("cqdx,cqex->cqde", slopes, slopes)
    return float((np.sqrt(np.linalg.det(metric)) @ weights).sum())


# --------------------------------------------------------------------------------- facets of a cell


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("kind", ["triangle", "quadrilateral", "tetrahedron", "hexahedron"])
def test_each_facet_of_a_cell(kind, degree):
    """Each facet of the reference cell has its own size, in the order of VTK."""
    cell = getattr(basix.CellType, kind)
    variant = basix.LagrangeVariant.gll_warped
    nodes = basix.create_element(basix.ElementFamily.P, cell, degree, variant).points
    points = np.zeros((len(nodes), 3))
    points[:, : nodes.shape[1]] = nodes
    table = np.arange(len(nodes))[None, :]
    order = BY_DEGREE[degree][kind].vtk_order
    grid = Grid(points, table[:, order], kind, np.array([7]), degree)
    sizes = basix.cell.facet_reference_volumes(cell)
    half = np.sqrt(3) / 2  # the slanted facet of a tetrahedron is larger than its reference
    slanted = {"triangle": np.sqrt(2), "tetrahedron": half}.get(kind, 1)
    facets = basix.topology(cell)[-2]
    for number, corners in enumerate(facets):
        surface = surface_grid(grid, table, np.array([[0, number]]))
        found = size_of(surface.points, surface.cells, surface.kind, degree)
        exact = slanted if kind in ("triangle", "tetrahedron") and number == 0 else sizes[number]
        if kind in ("triangle", "tetrahedron") and number:
            exact = 1.0 if kind == "triangle" else 0.5
        assert found == pytest.approx(exact, rel=1e-12)
        assert set(surface.nodes[surface.cells[0, : len(corners)]]) == set(corners)
        assert surface.regions.tolist() == [7] and surface.parents.tolist() == [0]
    everything = surface_grid(grid, table, np.array([[0, n] for n in range(len(facets))] * 2))
    assert len(everything.cells) == len(facets)


# ----------------------------------------------------------------------------------------- degrees


@pytest.mark.parametrize("cells", [(2, 1, 2), (2, 2)], ids=["space", "plane"])
def test_linear_cells(monkeypatch, tmp_path, cells):
    """Geometry, displacement and potential of first degree are written in linear cells."""
    from dea_fenicsx.results.reading import read_frame

    with_degree(monkeypatch, 1)
    device = block(cells, L, order=1)
    problem = make_problem(device, dea.Discretisation(potential_degree=1))
    put(problem, [lambda x: 0.1 * x[:, 0] + 0.2 * x[:, 1], lambda x: 0.3 * x[:, 0]],
        lambda x: 5 * x[:, 1])  # fmt: skip
    writer = FieldWriter(problem, surfaces=("top",))
    grid, top = writer.grid, writer.surface_grids["top"]
    corners = CORNERS[grid.kind][1]
    assert grid.degree == 1 and grid.cells.shape == (np.prod(cells), corners)
    assert len(grid.points) == np.prod(np.array(cells) + 1)
    assert size_of(grid.points, grid.cells, grid.kind, 1) == pytest.approx(L ** len(cells))
    assert size_of(top.points, top.cells, top.kind, 1) == pytest.approx(L ** (len(cells) - 1))
    write(tmp_path, writer, [0.0])
    for name, one in ((None, grid), ("top", top)):
        frame = read_frame(tmp_path, surface=name)
        assert frame.flat == (len(cells) == 2)
        assert np.array_equal(frame.grid.points, one.points)
        assert np.array_equal(frame.grid.cells_dict.popitem()[1], one.cells)
        moved = frame.grid.point_data["displacement_m"]
        x = one.points
        assert moved[:, 0] == pytest.approx(0.1 * x[:, 0] + 0.2 * x[:, 1], abs=1e-18)
        assert moved[:, 1] == pytest.approx(0.3 * x[:, 0], abs=1e-18)
        volts = 5 * x[:, 1] / L * problem.scales.potential
        assert frame.grid.point_data["potential_V"] == pytest.approx(volts, rel=1e-12)
    whole = read_frame(tmp_path).grid.compute_cell_sizes()
    size = whole["Volume" if len(cells) == 3 else "Area"].sum()
    assert size == pytest.approx(L ** len(cells))


@pytest.mark.parametrize(("geometry", "displacement", "potential"),
                         [(1, 2, 1), (1, 1, 2), (2, 1, 1), (1, 3, 2)])  # fmt: skip
def test_quadratic_cells_of_other_elements(monkeypatch, geometry, displacement, potential):
    """One field of second degree or more is enough; all fields are exact at the nodes."""
    with_degree(monkeypatch, displacement)
    device = block((1, 2), L, order=geometry)
    problem = make_problem(device, dea.Discretisation(potential_degree=potential))
    power = displacement

    def u(x):
        return x[:, 0] ** power - 2 * x[:, 1] ** power

    put(problem, [u, u], lambda x: x[:, 1] ** potential)
    writer = FieldWriter(problem, surfaces="top")
    grid = writer.grid
    assert grid.degree == 2 and grid.cells.shape == (2, 9)
    fields = writer.node_fields()
    x = grid.points / L
    corners = np.unique(grid.cells[:, :4])  # between them a field of first degree is linear
    exact = u(x) if power > 1 else x[:, 0] - 2 * x[:, 1]
    assert fields["displacement_m"][:, 1] == pytest.approx(exact * L, abs=1e-15)
    volts = fields["potential_V"] / problem.scales.potential
    assert volts[corners] == pytest.approx(x[corners, 1] ** potential, abs=1e-12)
    assert size_of(grid.points, grid.cells, grid.kind, 2) == pytest.approx(L**2)


# ----------------------------------------------------------------------------------------- surfaces


def write(folder, writer, times):
    """Write the present state at some times, as a run does."""
    out = Folder(folder, MPI.COMM_SELF)
    out.write_grid(writer.grid, writer.surface_grids)
    history = []
    for step, time in enumerate(times):
        history.append({"step": step, "time": time})
        nodes, cells = writer.node_fields(), writer.cell_fields()
        surfaces = writer.surface_fields(nodes, cells)
        out.write_step(step, None, history, nodes, cells, [], surfaces)
    return out, history


def test_area_of_a_curved_surface():
    """The upper face z = 1 + 0.3 x^2 of quadratic cells is a parabola exactly."""
    device = block((3, 2, 1), L, order=2)
    x = device.mesh.geometry.x
    x[:, 2] += 0.3 * x[:, 0] ** 2
    writer = FieldWriter(make_problem(device), surfaces=("top", "x_max", "top"))
    a = 0.6
    arc = (np.sqrt(1 + a**2) + np.arcsinh(a) / a) / 2
    top, side = writer.surface_grids["top"], writer.surface_grids["x_max"]
    assert list(writer.surface_grids) == ["top", "x_max"]
    assert size_of(top.points, top.cells, top.kind, 2) == pytest.approx(arc * L**2, rel=1e-9)
    assert size_of(side.points, side.cells, side.kind, 2) == pytest.approx(L**2, rel=1e-12)
    assert np.array_equal(writer.grid.points[top.nodes], top.points)
    nodes, cells = writer.node_fields(), writer.cell_fields()
    on_nodes, on_cells = writer.surface_fields(nodes, cells)["top"]
    assert np.array_equal(on_nodes["potential_V"], nodes["potential_V"][top.nodes])
    assert np.array_equal(on_cells["J"], cells["J"][top.parents])


def test_surfaces_of_tetrahedra():
    """Curved triangles: two discs and a side of a cylinder, whose area and volume add up."""
    writer = FieldWriter(make_problem(dea.read_gmsh(Cylinder(), MPI.COMM_SELF)),
                         surfaces=("top", "bottom", "side"))  # fmt: skip
    grid = writer.grid
    assert size_of(grid.points, grid.cells, grid.kind, 2) == pytest.approx(np.pi * L**3, rel=1e-3)
    for name, area in (("top", np.pi), ("bottom", np.pi), ("side", 2 * np.pi)):
        surface = writer.surface_grids[name]
        found = size_of(surface.points, surface.cells, surface.kind, 2)
        assert found == pytest.approx(area * L**2, rel=1e-3)


def test_surfaces_of_a_run(monkeypatch, tmp_path):
    """All files of the whole device are as without surfaces; the surface has the same values."""
    pytest.importorskip("pyvista")
    from dea_fenicsx.results.reading import frame_times, read_frame

    path = dea.Ramp("voltage", steps=2)
    dea.solve(scene(), path, out=tmp_path / "plain", quiet=True)
    monkeypatch.setattr(session, "FieldWriter", partial(FieldWriter, surfaces=("top",)))
    out = tmp_path / "run"
    dea.solve(scene(), path, out=out, quiet=True)
    assert not (out / "parts").exists()
    plain = (tmp_path / "plain" / "fields.xdmf").read_bytes()
    assert (out / "fields.xdmf").read_bytes() == plain
    assert not list((tmp_path / "plain").glob("fields_*"))
    with h5py.File(out / "fields.h5") as h5, h5py.File(tmp_path / "plain" / "fields.h5") as old:
        assert np.array_equal(h5["step_00002/node/displacement_m"],
                              old["step_00002/node/displacement_m"])  # fmt: skip
        assert "surfaces" not in old["grid"] and "degree" not in h5["grid"].attrs
    assert frame_times(out) == [0.0, 0.5, 1.0]
    whole, top = read_frame(out), read_frame(out, surface="top")
    assert top.grid.n_cells == 2 and (top.grid.celltypes == 21).all() and top.time == 1.0
    assert top.grid.compute_cell_sizes()["Length"].sum() == pytest.approx(L, rel=1e-12)
    names = {"displacement_m", "potential_V"}
    assert set(top.grid.point_data) == names and set(top.grid.cell_data) == set(
        whole.grid.cell_data
    )
    for point, value in zip(top.grid.points, top.grid.point_data["displacement_m"], strict=True):
        k = np.argmin(np.linalg.norm(whole.grid.points - point, axis=1))
        assert np.array_equal(whole.grid.point_data["displacement_m"][k], value)
    with pytest.raises(dea.InputError, match=r"fields_bottom\.xdmf"):
        read_frame(out, surface="bottom")
    # a run that comes later moves the document of the surface away with all else
    monkeypatch.undo()
    dea.solve(scene(), dea.Ramp("voltage", steps=1), out=out, quiet=True)
    assert (out / "previous" / "fields_top.xdmf").exists()
    assert not (out / "fields_top.xdmf").exists()
    old = read_frame(out / "previous", surface="top").grid
    assert np.array_equal(old.point_data["displacement_m"], top.grid.point_data["displacement_m"])


@pytest.mark.parametrize("before", [(), ("top",)])
@pytest.mark.parametrize("after", [(), ("bottom",), ("top", "bottom")])
def test_resumed_run_with_other_surfaces(monkeypatch, tmp_path, before, after):
    """Each surface has the steps at which it was asked for, and none of them is lost."""
    pytest.importorskip("pyvista")
    from dea_fenicsx.results.reading import read_frame, read_xml

    def run(surfaces, stop, **more):
        monkeypatch.setattr(session, "FieldWriter", partial(FieldWriter, surfaces=surfaces))
        record = HEIGHT | {"s": Stop(stop)}
        return dea.solve(scene(cells=1), dea.Ramp(steps=3), record, tmp_path, quiet=True, **more)

    with pytest.raises(dea.Interrupted):
        run(before, 1)
    run(after, -1, resume=True)
    assert not (tmp_path / "parts").exists()
    early, late = ["step 0", "step 1"], ["step 2", "step 3"]
    for name in ("top", "bottom"):
        steps = [*(early if name in before else []), *(late if name in after else [])]
        file = tmp_path / surface_document(name)
        assert file.exists() == bool(steps)
        if steps:
            grids = read_xml(file).findall("./Domain/Grid/Grid")
            assert [grid.attrib["Name"] for grid in grids] == steps
            for k in range(len(steps)):
                assert read_frame(tmp_path, k, name).grid.n_cells == 1
    assert len(read_xml(tmp_path / "fields.xdmf").findall("./Domain/Grid/Grid")) == 4


def test_vtk_reads_a_surface(tmp_path):
    """VTK's own reader finds the nodes, the cells and the times of a surface with an odd name."""
    pytest.importorskip("vtkmodules.vtkIOXdmf2")  # Debian's VTK has it not
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
    from vtkmodules.vtkIOXdmf2 import vtkXdmfReader

    problem = make_problem(block((2, 1, 1), L))
    put(problem, [lambda x: 0.5 * x[:, 0]])
    writer = FieldWriter(problem, surfaces=("top",))
    writer.surface_grids = {"a / b. %": writer.surface_grids["top"]}
    out, history = write(tmp_path, writer, [0.0, 0.25, 3.5])
    for whole in (False, True):
        if whole:
            out.consolidate(history)
        reader = vtkXdmfReader()
        reader.SetFileName(str(tmp_path / surface_document("a / b. %")))
        reader.UpdateInformation()
        info = reader.GetOutputInformation(0)
        assert info.Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS()) == (0.0, 0.25, 3.5)
        reader.Update()
        data = reader.GetOutputDataObject(0)
        assert (data.GetNumberOfPoints(), data.GetNumberOfCells()) == (15, 2)
        assert data.GetCellType(0) == 28
        moved = data.GetPointData().GetArray("displacement_m")
        assert max(moved.GetTuple3(k)[0] for k in range(15)) == pytest.approx(0.5e-3)


def test_meshio_reads_one_step(tmp_path):
    """A document of one grid is what meshio reads."""
    meshio = pytest.importorskip("meshio")
    problem = make_problem(block((2, 1), L))
    put(problem, [lambda x: 0.5 * x[:, 0]])
    write(tmp_path, FieldWriter(problem, surfaces=("top",)), [0.0])
    folder = tmp_path / "single"
    shutil.copytree(tmp_path / "parts", folder / "parts")
    for name, kind, count in (("fields", "quad9", 2), ("fields_top", "line3", 2)):
        text = (tmp_path / f"{name}.xdmf").read_text().splitlines(keepends=True)
        left_out = ('"Collection"', "  </Grid>", "    <Time")
        kept = [t for t in text if not t.startswith(left_out) and left_out[0] not in t]
        (folder / f"{name}.xdmf").write_text("".join(kept))
        mesh = meshio.read(folder / f"{name}.xdmf")
        assert mesh.cells[0].type == kind and len(mesh.cells[0].data) == count
        assert np.max(mesh.point_data["displacement_m"][:, 0]) == pytest.approx(0.5e-3)


@pytest.mark.parametrize(("names", "words"), [(("tip",), "'tip'"), ("tpo", "did you mean 'top'")])
def test_surfaces_that_are_not_there(names, words):
    with pytest.raises(dea.InputError, match=words):
        FieldWriter(make_problem(block((1, 1), L)), surfaces=names)


def interface(comm):
    """The grid between two layers, and the sums of a field on it."""
    stack = [Layer("a", L / 2), Layer("b", L / 2)]
    device = dea.read_gmsh(BoxStack(L, L, stack, (2, 2)), comm)
    problem = make_problem(device)
    put(problem, [lambda x: x[:, 0] ** 2], lambda x: x[:, 2])
    problem.w.x.scatter_forward()
    writer = FieldWriter(problem, surfaces=("interface_1", "x_max"))
    fields = writer.surface_fields(writer.node_fields(), writer.cell_fields())
    return [
        [grid.points.round(12).tolist(), grid.cells.tolist(), grid.parents.tolist(),
         grid.regions.tolist(), fields[name][0]["displacement_m"].round(12).tolist(),
         fields[name][1]["J"].round(9).tolist()]
        for name, grid in writer.surface_grids.items()
    ]  # fmt: skip


@pytest.mark.mpi
def test_surfaces_on_ranks(on_ranks):
    """A facet between two cells is there once, from the same side on any number of ranks."""
    alone = interface(MPI.COMM_SELF)
    between = alone[0]
    assert len(between[1]) == 4 and len(set(between[3])) == 1
    for ranks in numbers_of_ranks():
        assert on_ranks("test_field_writer", "interface", ranks) == alone


# --------------------------------------------------------------------------------------------- time


def test_times_in_files_for_paraview():
    """The place on a path without time, else the time in s, with states of a jump moved apart."""
    assert field_times({"time": [0, 0.5, 1]}) == [0.0, 0.5, 1.0]
    found = field_times({"time": [0, 1, 1, 2], "time_s": [0.0, 3.0, 3.0, 4.0]})
    assert found == pytest.approx([0.0, 3.0, 3.0, 4.0], abs=1e-6)
    assert found[2] > found[1]


def test_a_step_opens_no_files_of_earlier_steps(tmp_path, monkeypatch):
    """The document is written at each step; the time of a long run must not grow as its square."""
    opened = []

    def opening(file, **options):
        opened.append(file)
        return h5py.File(file, **options)

    monkeypatch.setattr(xdmf, "h5py", SimpleNamespace(File=opening))
    steps = 12
    device = block((1, 1, 1))
    scene = dea.Scene(
        device, {"film": FILM}, [dea.Electrode("bottom", 10.0), dea.Ground("top")],
        [dea.Clamp("bottom")],
    )  # fmt: skip
    run = dea.solve(scene, dea.Ramp("voltage", steps=steps), out=tmp_path / "run", quiet=True)
    # a step and its mesh once as it is accepted, and once more in the whole file at the end, for
    # each of the two documents of the device
    assert len(opened) <= 6 * (steps + 1)
    assert (run.out / "fields.xdmf").read_text("utf-8").count("<Time ") == steps + 1
