"""Surfaces that are named by their places, in meshes of all kinds, alike on all ranks."""

from __future__ import annotations

import math

import gmsh
import numpy as np
import pytest
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, DiskStack, Layer
from dea_fenicsx.mesh.device import one_sided
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.support.compat import dolfinx

L = 1e-3
RUBBER = dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(3.0))


def stack(comm=MPI.COMM_SELF, width=None, **surfaces):
    """Two layers of half a millimetre each, along the last axis, with surfaces of their own."""
    layers = [Layer(name, L / 2, divisions=2) for name in ("low", "high")]
    divisions = (4,) if width is None else (4, 2)
    return dea.read_gmsh(BoxStack(L, width, layers, divisions=divisions), comm, surfaces=surfaces)


def facets(device, name):
    """Midpoints of a surface's facets in m, each once, sorted, on all ranks."""
    mesh = device.mesh
    found = []
    for facet in device.facets_of(name):
        nodes = dolfinx.mesh.entities_to_geometry(
            mesh, device.dim - 1, np.array([facet], dtype=np.int32)
        )[0]
        found.append(tuple(np.round(mesh.geometry.x[nodes].mean(axis=0) * device.length, 9)))
    everyone = set().union(*device.comm.allgather(set(found)))
    return sorted([float(c) for c in x] for x in everyone)


@pytest.mark.parametrize("where", [
    dea.OnPlane("x", 0.0),
    lambda x: x[0] < 1e-6,
    dea.InBox((-math.inf, -1.0), (0.0, 1.0)),
    ~dea.InBox((1e-7, -math.inf), (math.inf, math.inf)),
    [dea.OnPlane("x", 0.0) & dea.InBox((-1.0, 0.0), (1.0, L / 2)),
     dea.OnPlane("x", 0.0) & dea.InBox((-1.0, L / 2), (1.0, L))],
    dea.OnPlane("x", 1e-5, tolerance=2e-5),
])  # fmt: skip
def test_one_face_in_many_ways(where):
    device = stack(root=where)
    assert facets(device, "root") == facets(device, "x_min")
    assert len(facets(device, "root")) == 4


def test_places_in_space():
    device = stack(
        width=L,
        half=dea.OnPlane("z", L) & dea.InBox((0.0, 0.0, 0.0), (L / 2, L, L)),
        rest=dea.OnPlane("z", L) & ~dea.InBox((0.0, 0.0, 0.0), (L / 2, L, L)),
        both=dea.OnPlane("x", 0.0) | dea.OnPlane("x", L),
    )
    both = facets(device, "half") + facets(device, "rest")
    assert sorted(both) == facets(device, "top")
    assert len(facets(device, "half")) == len(facets(device, "rest")) == 4
    assert facets(device, "both") == sorted(facets(device, "x_min") + facets(device, "x_max"))


def test_cylinders():
    """The rim of a disc of curved cells; the patch on top within half of its radius."""
    device = dea.read_gmsh(
        DiskStack(L, [Layer("film", L / 10)]), MPI.COMM_SELF,
        surfaces={"rim": dea.OnCylinder(L), "patch": dea.OnPlane("z", L / 10)
                  & dea.InCylinder(L / 2)},
    )  # fmt: skip
    assert facets(device, "side") == facets(device, "rim")
    r = np.hypot(*np.array(facets(device, "patch"))[:, :2].T)
    assert 0 < len(r) < len(facets(device, "top")) and max(r) <= L / 2


def test_facets_inside_of_the_body():
    """The film between two layers, and a plane within one of them."""
    device = stack(
        film=dea.Interior(between=("high", "low")),
        plane=dea.Interior(dea.OnPlane("y", 0.75 * L)),
        whole=dea.Interior(between=("low", "low")),
    )
    assert [x[1] for x in facets(device, "film")] == [L / 2] * 4
    assert [x[1] for x in facets(device, "plane")] == [0.75 * L] * 4
    assert len(facets(device, "whole")) == 4 + 2 * 3
    with pytest.raises(dea.InputError, match="finds no facet on the boundary"):
        stack(film=dea.OnPlane("y", L / 2))


def test_groups_may_share_facets():
    """Each facet belongs to all of its groups, old and new ones."""
    device = stack(
        corner=lambda x: x[0] + x[1] < 0.2 * L,
        root=dea.OnPlane("x", 0.0),
        lower=dea.InBox((0.0, 0.0), (L, L / 4)),
    )
    before = stack()
    for name in before.surfaces:
        assert facets(device, name) == facets(before, name)
    root, corner, lower = (facets(device, n) for n in ("root", "corner", "lower"))
    assert root == facets(device, "x_min")
    assert len(corner) == 2 and all(c in lower for c in corner)
    assert [c in root for c in corner].count(True) == 1
    assert one_sided(device, "root").shape == (4, 2)


def test_a_scene_on_surfaces_by_place():
    """It gives what the same scene on the names of the geometry gives."""

    def tip(root, above, below):
        scene = dea.Scene(
            device, {"low": RUBBER, "high": RUBBER}, [dea.Electrode(above, 2e3), dea.Ground(below)],
            [dea.Clamp(root)], kinematics=dea.PlaneStrain(L),
        )  # fmt: skip
        record = {"tip": dea.MeanDisplacement("x_max", "x")}
        return dea.solve(scene, dea.Ramp(steps=1), record, quiet=True)["tip_m"]

    device = stack(root=dea.OnPlane("x", 0.0), up=lambda x: x[1] > 0.999 * L,
                   down=dea.OnPlane("y", 0.0))  # fmt: skip
    assert tip("root", "up", "down") == tip("x_min", "top", "bottom") != 0


@pytest.mark.parametrize(("given", "words"), [
    ({"a": dea.OnPlane("x", 1.1 * L)}, "nearest midpoint is 0.0001 m away from the OnPlane"),
    ({"a": lambda x: x[0] < -1}, "finds no facet on the boundary"),
    ({"a": [dea.OnPlane("x", 0.0), dea.OnPlane("x", 5.0)]}, "finds no facet"),
    ({"a": lambda x: x[0]}, r"returns float64 of shape \(16,\) for 16 midpoints"),
    ({"a": lambda x: True}, r"returns bool of shape \(\)"),
    ({"a": lambda x: x[7] < 1}, r"fails \(IndexError"),
    ({"a": lambda x: x[0] < x[0].mean()}, "depend on the number of ranks"),
    ({"top": dea.OnPlane("x", 0.0)}, "group named 'top' already"),
    ({"low": dea.OnPlane("x", 0.0)}, "group named 'low' already"),
    ({"a": "x = 0"}, "The surface 'a' is given as 'x = 0'"),
    ({"a": []}, r"The surface 'a' is given as \[\]"),
    ({"": dea.OnPlane("x", 0.0)}, "has the name ''"),
    ([dea.OnPlane("x", 0.0)], "must be a dictionary"),
    ({"a": dea.OnPlane("z", 0.0)}, "axis of OnPlane is 'z'"),
    ({"a": dea.OnPlane("x", math.nan)}, "coordinate of OnPlane"),
    ({"a": dea.OnPlane("x", 0.0, tolerance=0.0)}, "tolerance of OnPlane is 0.0"),
    ({"a": dea.InBox((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))}, "must be 2 coordinates"),
    ({"a": dea.InBox((1.0, 0.0), (0.0, 1.0))}, "must have the smaller coordinates"),
    ({"a": dea.OnCylinder(0.0)}, "radius of OnCylinder is 0.0"),
    ({"a": dea.InCylinder(1.0, "x")}, "axis of InCylinder is 'x'"),
    ({"a": dea.OnCylinder(1.0, through=(0.0, 0.0, math.inf))}, "through="),
    ({"a": dea.OnPlane("x", 0.0) & 3}, "second is 3, but must be"),
    ({"a": dea.Interior(between=("low", "middle"))}, "beside the surface 'a' named 'middle'"),
    ({"a": dea.Interior(dea.OnPlane("y", 0.3 * L))}, "inside of the body: the nearest"),
])  # fmt: skip
def test_bad_places_are_refused(given, words):
    layers = [Layer(name, L / 2, divisions=2) for name in ("low", "high")]
    with pytest.raises(dea.InputError, match=words):
        dea.read_gmsh(BoxStack(L, None, layers, divisions=(4,)), MPI.COMM_SELF, surfaces=given)


@pytest.mark.parametrize("kind", ["msh", "geo"])
def test_a_mesh_and_a_drawing_without_names(tmp_path, kind):
    """All cells are the region "body"; without surfaces= the file is refused as before."""
    drawing = tmp_path / "bar.geo"
    drawing.write_text('SetFactory("OpenCASCADE"); Rectangle(1) = {0, 0, 0, 4, 1};\n')
    if kind == "msh":
        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(drawing))
        gmsh.model.mesh.generate(2)
        gmsh.write(str(tmp_path / "bar.msh"))
        gmsh.finalize()
    given = dict(comm=MPI.COMM_SELF, dim=2, unit=1e-3)
    file = tmp_path / f"bar.{kind}"
    device = dea.read_gmsh(
        file, surfaces={"root": dea.OnPlane("x", 0.0), "end": dea.OnPlane("x", 4e-3)}, **given
    )
    assert list(device.regions) == ["body"] and set(device.surfaces) == {"root", "end"}
    assert {x[0] for x in facets(device, "end")} == {4e-3}
    with pytest.raises(dea.InputError, match="names no region"):
        dea.read_gmsh(file, **given)


# ------------------------------------------------------------------------------- DOLFINx's meshes


def rectangle(comm, ghosts=dolfinx.mesh.GhostMode.shared_facet):
    """2 mm x 1 mm in mm, 8 x 4 quadrilaterals."""
    return dolfinx.mesh.create_rectangle(
        comm, [[0.0, 0.0], [2.0, 1.0]], [8, 4], dolfinx.mesh.CellType.quadrilateral,
        ghost_mode=ghosts,
    )  # fmt: skip


def tags(mesh, dim, value, owned_alone=True):
    """Tags of cells or facets of which a function of the midpoints gives the values."""
    mesh.topology.create_entities(dim)
    mesh.topology.create_connectivity(dim, mesh.topology.dim)
    imap = mesh.topology.index_map(dim)
    count = imap.size_local + (0 if owned_alone else imap.num_ghosts)
    local = np.arange(count, dtype=np.int32)
    values = value(dolfinx.mesh.compute_midpoints(mesh, dim, local)).astype(np.int32)
    return dolfinx.mesh.meshtags(mesh, dim, local, values)


def of_rectangle(comm, owned_alone=True):
    """A device of two layers, with surfaces by tag and by place."""
    mesh = rectangle(comm)
    layer = tags(mesh, 2, lambda x: np.where(x[:, 1] < 0.5, 5, 7), owned_alone)
    face = tags(mesh, 1, lambda x: np.where(x[:, 1] > 1 - 1e-9, 3, 0), owned_alone)
    return dea.from_dolfinx(
        mesh, layer, face, regions={"low": 5, "high": 7}, unit=1e-3,
        surfaces={"top": 3, "bottom": dea.OnPlane("y", 0.0), "root": lambda x: x[0] < 1e-9,
                  "middle": dea.Interior(between=("low", "high"))},
    )  # fmt: skip


def summary(comm):
    """What is found on the surfaces, and a solution on them."""
    found = []
    for owned_alone in (True, False):
        device = of_rectangle(comm, owned_alone)
        names = ("top", "bottom", "root", "middle")
        found += [facets(device, name) for name in names]
    scene = dea.Scene(
        device, {"low": RUBBER, "high": RUBBER}, [dea.Electrode("top", 1e3), dea.Ground("middle")],
        [dea.Clamp("root")], kinematics=dea.PlaneStrain(L),
    )  # fmt: skip
    record = {"tip": dea.AtPoint((2e-3, 1e-3), "displacement", "y"), "q": dea.Charge("top")}
    run = dea.solve(scene, dea.Ramp(steps=1), record, quiet=True)
    return [found, float(run["tip_m"]), float(run["q_C"])]


def test_a_mesh_of_dolfinx():
    device = of_rectangle(MPI.COMM_SELF)
    assert device.length == pytest.approx(2e-3, rel=1e-15)
    assert [x[1] for x in facets(device, "middle")] == [5e-4] * 8
    assert [x[1] for x in facets(device, "top")] == [1e-3] * 8
    assert len(facets(device, "root")) == 4
    scene = dea.Scene(device, {"low": RUBBER, "high": RUBBER}, supports=[dea.Clamp("root")],
                      kinematics=dea.PlaneStrain(L))  # fmt: skip
    volume = dea.OverRegion("J", "integral").bind(Problem(scene))
    assert volume() == pytest.approx(2e-3 * 1e-3 * L, rel=1e-12)


def test_the_mesh_itself_stays_as_it_is():
    mesh = rectangle(MPI.COMM_SELF)
    before = mesh.geometry.x.copy()
    first, second = (dea.from_dolfinx(mesh, unit=1e-3) for _ in range(2))
    assert np.array_equal(mesh.geometry.x, before)
    assert first.length == second.length == pytest.approx(2e-3, rel=1e-15)
    assert np.max(first.mesh.geometry.x) == 1


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_all_ranks_agree(on_ranks, ranks):
    found, *solved = on_ranks("test_places", "summary", ranks)
    exact, *values = summary(MPI.COMM_SELF)
    assert found == exact
    assert solved == pytest.approx(values, rel=1e-8)


def refusals(comm):
    """Messages that are told on several ranks alone."""
    found = []
    for make in (
        lambda: dea.from_dolfinx(rectangle(comm, dolfinx.mesh.GhostMode.none)),
        lambda: stack(comm, a=lambda x: x[0] < 1 if comm.rank else x[0]),
    ):
        try:
            make()
        except dea.InputError as error:
            found.append(str(error))
    return found


@pytest.mark.mpi
def test_what_fails_on_one_rank_is_told_by_all(on_ranks):
    ghosts, kind = on_ranks("test_places", "refusals", 2)
    assert "ghost_mode=dolfinx.mesh.GhostMode.shared_facet" in ghosts
    assert "must return as many truth values" in kind


@pytest.mark.parametrize(("change", "words"), [
    ({"mesh": "film.msh"}, "needs a dolfinx.mesh.Mesh"),
    ({"regions": {"low": 5}}, "the tag 7 lie in no named region"),
    ({"regions": {"low": 5, "high": 7, "more": 9}}, "region 'more' has the tag 9, which no cell"),
    ({"regions": {"low": 5, "high": 5}}, "names two regions"),
    ({"regions": {"low": "5"}}, "must be one name"),
    ({"regions": ""}, "must be one name"),
    ({"cell_tags": None}, "but no cell_tags"),
    ({"cell_tags": 3}, "cell_tags is 3"),
    ({"facet_tags": None}, "given no facet_tags"),
    ({"surfaces": {"top": 4}}, "has the tag 4, which no facet has"),
    ({"surfaces": {"low": 3}}, "group named 'low' already"),
    ({"surfaces": {"low": dea.OnPlane("x", 0.0)}}, "group named 'low' already"),
    ({"surfaces": {"top": 3.5}}, "The surface 'top' is given as 3.5"),
    ({"unit": 0.0}, "unit of from_dolfinx"),
])  # fmt: skip
def test_bad_meshes_are_refused(change, words):
    mesh = rectangle(MPI.COMM_SELF)
    given = dict(
        mesh=mesh, cell_tags=tags(mesh, 2, lambda x: np.where(x[:, 1] < 0.5, 5, 7)),
        facet_tags=tags(mesh, 1, lambda x: np.where(x[:, 1] > 1 - 1e-9, 3, 0)),
        regions={"low": 5, "high": 7}, surfaces={"top": 3},
    ) | change  # fmt: skip
    with pytest.raises(dea.InputError, match=words):
        dea.from_dolfinx(**given)


def test_other_cells_are_refused():
    line = dolfinx.mesh.create_interval(MPI.COMM_SELF, 3, [0.0, 1.0])
    with pytest.raises(dea.InputError, match="cells of the kind interval"):
        dea.from_dolfinx(line)
    single = dolfinx.mesh.create_rectangle(
        MPI.COMM_SELF, [[0.0, 0.0], [1.0, 1.0]], [1, 1], dtype=np.float32
    )
    with pytest.raises(dea.InputError, match="must be float64"):
        dea.from_dolfinx(single)
