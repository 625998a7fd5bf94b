"""Fields at the nodes: exact where the elements are, with jumps where the fields jump."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from conftest import block, numbers_of_ranks
from mpi4py import MPI
from rank_scenes import TETRAHEDRA, TRIANGLES

import dea_fenicsx as dea
from dea_fenicsx import pictures
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.results import hdf5
from dea_fenicsx.results.components import column_names, component
from dea_fenicsx.results.fields import FieldWriter
from dea_fenicsx.results.grids import facet_nodes
from dea_fenicsx.results.reading import check_field, frame_for, frame_times
from dea_fenicsx.results.split_grid import Block, split
from dea_fenicsx.support.errors import InputError

pytestmark = pytest.mark.usefixtures("quick_compile")
L, H, VOLTS = 5e-3, 0.5e-3, 100.0
SOFT = dea.NeoHookean(1e6)


def read_frame(*arguments, **options):
    """A step of a run, or a skip where pyvista is not installed."""
    pytest.importorskip("pyvista")
    return dea.results.reading.read_frame(*arguments, **options)


# ------------------------------------------------------------------------------- a bent film


@pytest.fixture(scope="module")
def bent(tmp_path_factory, small_compile):
    """A cantilever strip of one quadratic cell through its thickness, with a force at its end."""
    device = dea.device(BoxStack(L, None, [Layer("film", H)], 10))
    scene = dea.Scene(
        device, {"film": dea.Material(SOFT, dea.IdealDielectric(3.0))}, [], [dea.Clamp("x_min")],
        loads=[dea.DeadLoad("x_max", (0.0, -1.0))], kinematics=dea.PlaneStrain(1.0),
    )  # fmt: skip
    out = tmp_path_factory.mktemp("bent") / "run"
    return dea.solve(scene, dea.Ramp(steps=1), out=out, quiet=True, stability="never").out


def beam(x):
    """Stress at the upper face of a beam under 1 Pa of shear at its end, 6 F (L - x) / h^2."""
    return 6 * (1.0 * H) * (L - x) / H**2


def test_bending_stress_through_one_cell_in_the_file(bent):
    grid = read_frame(bent, nodal=True).grid
    x, stress = np.asarray(grid.points), np.asarray(grid.point_data["cauchy_stress_Pa"])[:, 0]
    away = (x[:, 0] > 1.4e-3) & (x[:, 0] < 3.6e-3)  # from the clamp and from the end
    for face, sign in ((H, 1), (0.0, -1)):
        chosen = away & np.isclose(x[:, 1], face)
        assert chosen.sum() == 9
        assert stress[chosen] == pytest.approx(sign * beam(x[chosen, 0]), rel=1e-3)
    middle = away & np.isclose(x[:, 1], H / 2)
    assert np.abs(stress[middle]).max() < 1e-3 * beam(0.0)


def test_bending_stress_in_the_picture(bent, tmp_path):
    matplotlib = pytest.importorskip("matplotlib")
    from matplotlib.image import imread

    grid = read_frame(bent, nodal=True).grid
    reasons: list[str] = []
    drawn = pictures.deformed(
        bent, "cauchy_stress_xx_Pa", warp=0.0, path=tmp_path / "xx.png", say=reasons.append
    )
    if drawn is None:  # nothing can be rendered here, as without a display; the reason says why
        pytest.skip(reasons[0])
    image = imread(drawn)[..., :3]
    image = image[:, : int(0.85 * image.shape[1])]  # without the scale of colours
    table = matplotlib.colormaps["viridis"](np.linspace(0, 1, 256))[:, :3]
    ends = np.asarray(grid.point_data["cauchy_stress_Pa"])[:, 0]
    coloured = np.ptp(image, axis=2) > 0.15
    rows, columns = np.nonzero(coloured)
    top, bottom, left, right = rows.min(), rows.max(), columns.min(), columns.max()
    for place in (0.3, 0.4, 0.5):
        column = round(left + place * (right - left))
        seen = image[top + 5 : bottom - 4, column]  # without the edges
        nearest = np.abs(table - seen[:, None]).sum(axis=2).argmin(axis=1)
        found = ends.min() + nearest / 255 * np.ptp(ends)
        slope = np.polyfit(np.arange(len(found)), found, 1)[0]
        assert -slope * (bottom + 1 - top) / 2 == pytest.approx(beam(place * L), rel=0.02)


def test_components_are_named_by_axes(bent):
    check_field(bent, "cauchy_stress_xy_Pa")
    check_field(bent, "displacement_y_m")
    with pytest.raises(InputError, match="no field 'cauchy_stress_hoop_Pa'"):
        check_field(bent, "cauchy_stress_hoop_Pa")
    axes = ("r", "z", "hoop")
    assert component("cauchy_stress_hoop_Pa", ["cauchy_stress_Pa"], axes) == ("cauchy_stress_Pa", 8)
    assert component("cauchy_stress_zz_Pa", ["cauchy_stress_Pa"], axes) == ("cauchy_stress_Pa", 4)
    assert component("cauchy_stress_r_hoop_Pa", ["cauchy_stress_Pa"], axes)[1] == 2
    assert component("displacement_z_m", ["J"], axes) is None
    assert column_names("cauchy_stress_Pa", axes)[0] == "rr"


def test_the_picture_of_a_running_run_and_of_an_earlier_one(bent, tmp_path):
    """A step without fields at nodes is drawn from fields.xdmf, and never another step."""
    pytest.importorskip("pyvista")
    assert frame_times(bent) == [0.0, 1.0]
    assert "J" in frame_for(bent, -1, "J").grid.point_data
    folder = tmp_path / "copy"
    shutil.copytree(bent, folder)
    text = (folder / "nodal.xdmf").read_text()
    (folder / "nodal.xdmf").write_text(text.replace('<Time Value="1"/>', '<Time Value="0.9"/>'))
    assert "J" in frame_for(folder, -1, "J").grid.cell_data
    assert "J" in frame_for(folder, 0, "J").grid.point_data
    (folder / "nodal.xdmf").write_text("<Xdmf")
    assert "J" in frame_for(folder, -1, "J").grid.cell_data


# ------------------------------------------------------------------------ all kinds of cells


def device_of(kind):
    """Two or more cells of a kind, about 1 mm large."""
    if kind in ("quadrilateral", "hexahedron"):
        return block((2, 2) if kind == "quadrilateral" else (2, 2, 2))
    return dea.device(TRIANGLES if kind == "triangle" else TETRAHEDRA)


@pytest.mark.parametrize(("kind", "viscous"), [
    ("triangle", False), ("quadrilateral", False), ("tetrahedron", False), ("hexahedron", False),
    ("triangle", True), ("quadrilateral", True),
])  # fmt: skip
def test_an_affine_motion_and_a_quadratic_potential(kind, viscous):
    """J and stress are the same at all nodes and middles; the field is linear and exact."""
    branches = [dea.Maxwell(1e4, 1.0)] if viscous else []
    device = device_of(kind)
    film = dea.Material(SOFT, dea.IdealDielectric(3.0), bulk_modulus=2e6, viscous=branches)
    kinematics = dea.PlaneStrain() if device.dim == 2 else dea.ThreeD()
    faces = sorted(device.surfaces)
    problem = Problem(dea.Scene(
        device, dict.fromkeys(device.regions, film), [dea.Electrode(faces[0], 1.0)],
        [dea.Clamp(faces[1])], kinematics=kinematics,
    ))  # fmt: skip
    x = problem.potential.space.tabulate_dof_coordinates()
    problem.w.x.array[problem.potential.dofs] = x[:, 0] ** 2
    for k, part in enumerate(problem.displacement):
        y = part.space.tabulate_dof_coordinates()
        problem.w.x.array[part.dofs] = 0.1 * (k + 1) * y[:, k]
    writer = FieldWriter(problem)
    assert writer.split().grid is writer.grid  # nothing to split
    nodes, cells = writer.node_fields(), writer.cell_fields()
    found = writer.nodal_fields()
    assert set(found) == {*nodes, *cells}
    assert found["J"] == pytest.approx(np.full(len(nodes["displacement_m"]), cells["J"][0]))
    places = writer.grid.points[:, 0] / problem.scales.length
    field = -2 * places / 1.1 * problem.scales.field
    size = np.abs(field).max()
    assert found["electric_field_V_per_m"][:, 0] == pytest.approx(field, abs=1e-6 * size)
    assert found["field_strength_MV_per_m"] * 1e6 == pytest.approx(np.abs(field), abs=1e-6 * size)


# --------------------------------------------------------------------------------------- jumps


def jumping(comm, divisions=2):
    """Fields at nodes of two films in series under an electrode, with one more film above it.

    The middle film and the upper one are one region; the outer faces are grounds.
    """
    layers = [Layer("a", H), Layer("b", H), Layer("b", H)]
    device = dea.device(BoxStack(2 * H, None, layers, divisions), comm)
    hard = dea.NeoHookean(1e12)
    problem = Problem(dea.Scene(
        device,
        {"a": dea.Material(hard, dea.IdealDielectric(2.0)),
         "b": dea.Material(hard, dea.IdealDielectric(6.0))},
        [dea.Electrode("interface_2", VOLTS), dea.Ground(("bottom", "top"))],
        [dea.Clamp("bottom")], kinematics=dea.PlaneStrain(1.0),
    ))  # fmt: skip
    part, scale = problem.potential, problem.scales
    y = part.space.tabulate_dof_coordinates()[:, 1] * scale.length / H
    values = np.interp(y, [0, 1, 2, 3], [0, 0.75, 1, 0])
    problem.w.x.array[part.dofs] = values * VOLTS / scale.potential
    writer = FieldWriter(problem)
    made = writer.split()
    found = writer.nodal_fields()
    if found is None:
        return None
    grid = made.grid
    places = np.round(grid.points / H, 6)
    return [
        places.tolist(), grid.cells.tolist(), made.origin.tolist(),
        (found["electric_field_V_per_m"][:, 1] * (H / VOLTS)).astype(float).round(5).tolist(),
    ]  # fmt: skip


def test_jumps_at_regions_and_at_electrodes():
    """Each side of a jump has its own node and its own value: V/H times -3/4, -1/4, and 1."""
    places, cells, origin, field = map(np.array, jumping(MPI.COMM_SELF))
    assert len(places) == 5 * 7 + 2 * 5 and len(np.unique(origin)) == 5 * 7
    middles = places[cells].mean(axis=1)[:, 1]
    for cell, y in zip(cells, middles, strict=True):
        value = {0: -0.75, 1: -0.25, 2: 1.0}[int(y)]
        assert field[cell] == pytest.approx(np.full(9, value), abs=1e-4)


@pytest.mark.mpi
def test_jumps_on_ranks(on_ranks):
    alone = jumping(MPI.COMM_SELF)
    for ranks in numbers_of_ranks():
        assert on_ranks("test_nodal_fields", "jumping", ranks) == alone


def scarce(comm):
    """The same with one cell in each film."""
    return jumping(comm, 1)


@pytest.mark.mpi
def test_jumps_on_more_ranks_than_cells(on_ranks):
    assert on_ranks("test_nodal_fields", "scarce", 5) == scarce(MPI.COMM_SELF)


def test_a_cut_that_ends_inside_of_a_region():
    """Nodes at the end of an inner surface stay one, those between its ends are two."""
    device = block((4, 2), 1e-3)
    film = dea.Material(SOFT)
    writer = FieldWriter(Problem(dea.Scene(
        device, {"film": film}, supports=[dea.Clamp("bottom")], kinematics=dea.PlaneStrain(1.0)
    )))  # fmt: skip
    grid, table = writer.grid, writer._connectivity
    x = grid.points / 1e-3

    def at(place):
        return int(np.linalg.norm(x[:, :2] - place, axis=1).argmin())

    cut = np.array([[at((k / 4, 0.5)), at((k / 4 + 0.125, 0.5)), at(((k + 1) / 4, 0.5))]
                    for k in (1, 2)])  # fmt: skip
    _, closure = facet_nodes(grid.kind, grid.degree)
    faces = np.sort(table[:, closure], axis=2)
    chosen = (faces[:, :, None] == np.sort(cut)).all(axis=3).any(axis=2)
    assert chosen.sum() == 4
    rows = Block(
        MPI.COMM_SELF, grid.kind, grid.degree, table, 0, grid.regions, len(grid.points)
    )  # fmt: skip
    chosen[np.flatnonzero(chosen.any(axis=1))[0]] = False  # one of the two cells is enough
    made = split(rows, chosen)
    assert made.split and len(made.origin) == len(grid.points) + 3  # all but the two ends
    doubled = np.flatnonzero(np.bincount(made.origin) == 2)
    assert sorted(x[doubled, 0]) == pytest.approx([0.375, 0.5, 0.625])
    assert np.array_equal(grid.points[made.origin][made.table], grid.points[table])


# ------------------------------------------------------------------------- what others read


def test_outer_faces_and_vtks_reader(tmp_path, monkeypatch):
    """Faces between regions are not drawn; VTK's own reader of XDMF reads the document."""
    pyvista = pytest.importorskip("pyvista")
    from dea_fenicsx.pictures.faces import faces_of
    from dea_fenicsx.pictures.pieces import triangles_of
    from dea_fenicsx.pictures.stored import stored_step

    monkeypatch.setattr(hdf5, "PACKED_FROM", 0)
    device = dea.device(BoxStack(H, H, [Layer("a", H), Layer("b", H)], 1))
    film = dea.Material(SOFT, dea.IdealDielectric(3.0))
    scene = dea.Scene(
        device, {"a": film, "b": film}, [dea.Electrode("top", VOLTS), dea.Ground("bottom")],
        [dea.Clamp("bottom")],
    )  # fmt: skip
    out = dea.solve(scene, dea.Ramp(steps=1), out=tmp_path / "run", quiet=True).out
    grid = read_frame(out, nodal=True).grid
    assert grid.n_points == 5 * 9 + 9
    stored = stored_step(out, -1, "field_strength_V_per_m", ("x", "y", "z"))
    assert stored.size == grid.n_points
    faces = faces_of(stored)
    assert faces.nodes[faces.seen].shape == (10, 9) and faces.inner.sum() == 1
    fine = triangles_of(faces, np.flatnonzero(faces.seen))
    a, b, c = (fine.at(faces.points)[fine.corners[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert area == pytest.approx(10 * H**2)
    assert faces.regions[faces.seen].tolist() == [1] * 5 + [2] * 5
    strength = np.asarray(grid.point_data["field_strength_V_per_m"])
    assert strength == pytest.approx(np.full(grid.n_points, VOLTS / (2 * H)), rel=1e-3)
    pytest.importorskip("vtkmodules.vtkIOXdmf2")
    reader = pyvista.get_reader(str(out / "nodal.xdmf"))
    reader.set_active_time_value(reader.time_values[-1])
    read = reader.read()
    assert read.n_points == grid.n_points
    for name, values in grid.point_data.items():
        assert np.asarray(read.point_data[name], float) == pytest.approx(
            np.asarray(values, float), rel=1e-6
        )
