"""Large tables of results stay spread over the ranks; what is written is the same."""

from __future__ import annotations

import tempfile
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import numbers_of_ranks
from mpi4py import MPI
from stopped_runs import StopAtState, scene

import dea_fenicsx as dea
from dea_fenicsx.geometry import (
    BoxStack,
    DiscCapacitor,
    DiskStack,
    FingerStack,
    HollowSphere,
    Layer,
    MembraneDisc,
    Roll,
    TabbedStack,
    Tube,
)
from dea_fenicsx.geometry._check import HigherOrder
from dea_fenicsx.mesh import device, sheets
from dea_fenicsx.results import checkpoint, fields, spread
from dea_fenicsx.results.file_order import FileOrder, by_first_appearance
from dea_fenicsx.support import compat

pytestmark = pytest.mark.usefixtures("quick_compile")


def written(comm):
    """What a run leaves, and how another one goes on from its memory and from its folder.

    On several ranks all tables are spread, and pieces have a few rows.
    """
    if comm.size > 1:
        fields.MOST_WHOLE, spread.PIECE = 0, 200
    out = Path(comm.bcast(tempfile.mkdtemp() if comm.rank == 0 else None, root=0))
    path = dea.Ramp("voltage", steps=2)
    first = dea.solve(scene(comm), path, out=out, quiet=True, keep_states=True)
    more = dea.Ramp("voltage", to=1.1, steps=1)
    ends = [
        dict(dea.solve(scene(comm), more, start=start, quiet=True).history[-1])
        for start in (first, dea.StoredStep(out, 2))
    ]
    if comm.rank:
        return None
    found = {"heights": [end["residual"] < 1e-6 and end["min_J"] for end in ends]}

    def keep(name, data):
        if isinstance(data, h5py.Dataset):
            values = np.asarray(data, dtype=float)
            found[name] = [*values.shape, *np.nan_to_num(values).ravel().tolist()]

    with h5py.File(out / "fields.h5") as h5:
        h5.visititems(keep)
    told, states = checkpoint.read(out / "checkpoint.npz")
    assert told["digest_agrees"]
    with np.load(out / "states" / "step_00002.npz") as stored:
        assert np.array_equal(stored["state"], states[0])
    found["states"] = [len(states), *np.concatenate(states).ravel().tolist()]
    found["mesh"] = told["fingerprint"]["mesh"]["shape"]
    found["connections"] = told["fingerprint"]["mesh"]["connections"]
    return found


@pytest.mark.mpi
def test_spread_tables_on_ranks(on_ranks):
    """Three ranks write with spread tables what one rank writes as a whole."""
    alone, three = written(MPI.COMM_SELF), on_ranks("test_spread_tables", "written", 3)
    assert alone.keys() == three.keys() and alone["connections"] == three["connections"]
    for name in alone.keys() - {"connections"}:
        a, b = np.array(alone[name], float), np.array(three[name], float)
        assert a.shape == b.shape, name
        assert np.max(np.abs(a - b), initial=0.0) <= 1e-8 * np.max(np.abs(a), initial=1e-30), name


def test_rows_by_the_order_of_the_file():
    """On one rank: rows by their numbers, also with gaps, and nodes by their first appearance."""
    original = np.array([7, 3, 9, 5])
    order = FileOrder(MPI.COMM_SELF, original)
    assert order.places.tolist() == [2, 0, 3, 1] and order.count == 4
    block = order.rows(original[:, None] * [1.0, 2.0])
    assert block[:, 0].tolist() == [3, 5, 7, 9]
    assert np.array_equal(order.back(block)[:, 1], 2.0 * original)
    numbers, first = by_first_appearance(MPI.COMM_SELF, np.array([[40, 10], [10, 99], [5, 40]]), 0)
    assert numbers.tolist() == [[0, 1], [1, 2], [3, 0]] and first.tolist() == [0, 1, 3, 4]


def with_gaps(comm):
    """Places of cells whose numbers have gaps; the first rank has none of them if others have."""
    numbers = np.random.default_rng(3).permutation(40)[:17] + 100
    mine = numbers[np.arange(17) % max(comm.size - 1, 1) + (comm.size > 1) == comm.rank]
    order = FileOrder(comm, mine)
    pairs = comm.gather(list(zip(mine.tolist(), order.places.tolist(), strict=True)), root=0)
    back = order.back(order.rows(1.0 * mine))
    assert np.array_equal(back, mine) and order.count == 17
    return sorted([number, place] for part in pairs or () for number, place in part)


@pytest.mark.mpi
def test_numbers_with_gaps_on_ranks(on_ranks):
    alone = with_gaps(MPI.COMM_SELF)
    assert [place for _, place in alone] == list(range(17))
    for ranks in numbers_of_ranks():
        assert on_ranks("test_spread_tables", "with_gaps", ranks) == alone


LAYERS = [Layer("a", 1.0, 2), Layer("b", 0.5), Layer("a", 1.0)]
SHEETS = [Layer("a", 1.0, 2), Layer("e", 0.5, electrode=True), Layer("a", 1.0), *LAYERS[1:]]
FAMILIES = [
    lambda order: BoxStack(3.0, 2.0, LAYERS, (3, 2), order=order, grading=(2.0, 1.0)),
    lambda order: BoxStack(3.0, None, LAYERS, 3, order=order),
    lambda order: Tube(1.0, 2.0, LAYERS, "section", axial=3, order=order),
    lambda order: Tube(1.0, 2.0, LAYERS, "quarter", angular=8, axial=2, order=order),
    lambda order: Tube(1.0, 2.0, LAYERS, "whole", angular=5, axial=1, order=order),
    lambda order: DiskStack(5.0, SHEETS, 1.0, "rim", angular=8, order=order),
    lambda order: DiskStack(5.0, SHEETS[:1], angular=4, radial=1, order=order),
    lambda order: DiskStack(
        5.0, SHEETS, 0.5, None, 1.0, 0.5, angular=3, rim=2, end_electrodes=True, order=order
    ),
    lambda order: FingerStack(LAYERS, 3, 0.5, 0.2, both=True, order=order),
    lambda order: FingerStack(LAYERS, 2, 0.5, 0.2, 0.1, width=1.0, order=order),
    lambda order: TabbedStack(4.0, LAYERS, 0.5, order=order),
    lambda order: TabbedStack(4.0, LAYERS, 0.5, 3.0, 1.0, order=order),
    lambda order: Roll(1.0, 2, LAYERS, angular=5, order=order),
    lambda order: Roll(1.0, 3, LAYERS, 2.0, angular=4, axial=2, order=order),
    lambda order: DiscCapacitor(1.0, 2.0, 3.0, (3, 2, 4), order=order),
    lambda order: MembraneDisc(2.0, 1.0, 0.1, cells=(2, 2, 1), order=order),
    lambda order: MembraneDisc(2.0, 1.0, 0.1, 0.2, (2, 2, 1), angular=8, order=order),
    lambda order: HollowSphere(1.0, 1.5, "half", order=order),
    lambda order: HollowSphere(1.0, 1.5, "whole", order=order),
    lambda order: HollowSphere(1.0, 1.5, "octant", cells=4, order=order),
]
"""By the degree of their geometry."""


def turned_to_one(facets):
    """Facets as sorted rows of their nodes, each once."""
    return np.unique(np.sort(facets.reshape(len(facets), -1), axis=1), axis=0)


@pytest.mark.parametrize("parts", [1, 2, 3, 7, 500])
@pytest.mark.parametrize("order", [1, 2, HigherOrder(4)])
@pytest.mark.parametrize("family", FAMILIES)
def test_parts_make_the_whole(family, order, parts):
    """Cells, points and groups of the parts are those of the whole mesh, in its order."""
    made = family(order)
    mesh, pieces = made.mesh(), [made.mesh_part(k, parts) for k in range(parts)]
    mesh.check()
    assert np.array_equal(np.unique(mesh.cells), np.arange(len(mesh.points)))
    assert len(np.unique(mesh.points.round(9), axis=0)) == len(mesh.points)
    rows = np.concatenate(list(mesh.regions.values()))
    assert np.array_equal(np.concatenate([s.cells for s in pieces]), mesh.cells[rows])
    assert np.array_equal(np.concatenate([s.points for s in pieces]), mesh.points)
    assert list(made.groups_of_parts().items()) == list(made.groups().items())
    for name, facets in mesh.facets.items():
        found = np.concatenate([s.facets[name] for s in pieces if name in s.facets])
        assert len(found) == len(facets)
        assert np.array_equal(turned_to_one(found), turned_to_one(facets))
    sizes = [sum(len(s.regions.get(n, ())) for s in pieces) for n in mesh.regions]
    assert sizes == [len(cells) for cells in mesh.regions.values()]
    if order > 2:  # no device has such cells, and Bernstein coefficients lose digits there
        return
    shapes = [made.cell_shape(k, parts) for k in range(parts)]
    whole = made.cell_shape()
    assert min(least for least, _ in shapes) == pytest.approx(whole[0], rel=1e-9)
    assert max(aspect for _, aspect in shapes) == pytest.approx(whole[1], rel=1e-9)


def pressed(comm):
    """Observables of devices that are made in parts, and how many cells and nodes they have."""
    rubber = dea.Material(dea.NeoHookean(80e3), dea.IdealDielectric(2.8))
    film = [Layer("a", 0.2e-3), Layer("b", 0.2e-3)]
    tube = Tube(1e-3, 2e-3, film, "quarter", angular=8, axial=1)
    held = [dea.Fix(*side) for side in (("x_min", "x"), ("y_min", "y"), ("bottom", "z"))]
    disk = DiskStack(2e-3, film, angular=4, radial=1)
    scenes = [
        dea.Scene(
            dea.device(tube, comm), {"a": rubber, "b": rubber},
            [dea.Ground("inner"), dea.Electrode("interface_1", 1e3)], held,
        ),
        dea.Scene(
            dea.device(disk, comm), {"a": rubber, "b": rubber},
            [dea.Ground("bottom"), dea.Electrode("interface_1", 1e3)], [dea.Clamp("bottom")],
        ),
    ]  # fmt: skip
    found = []
    for one in scenes:
        tip = {"tip": dea.MeanDisplacement("top", "z")}
        options = dea.NewtonOptions(tolerance=1e-12)
        run = dea.solve(one, dea.Ramp(steps=1), tip, quiet=True, failures=(), options=options)
        mesh = one.device.mesh
        counts = mesh.topology.index_map(3).size_global, mesh.geometry.index_map().size_global
        found.append([float(run["tip_m"]), *counts, *one.device.quality.values()])
    few = dea.device(Tube(1.0, 1.0, [Layer("a", 1.0)], axial=1), comm)
    counts = [comm.allreduce(len(device.one_sided(few, name))) for name in sorted(few.surfaces)]
    return [*found, [few.length, few.mesh.topology.index_map(2).size_global, *counts]]


@pytest.mark.slow
@pytest.mark.mpi
def test_devices_of_parts_on_ranks(on_ranks, monkeypatch):
    """One rank and several give what the mesh of gmsh gives; more ranks than cells do, too."""
    alone = pressed(MPI.COMM_SELF)
    for ranks in numbers_of_ranks():
        several = on_ranks("test_spread_tables", "pressed", ranks)
        for found, wanted in zip(several, alone, strict=True):
            assert found == pytest.approx(wanted, rel=1e-10)
    monkeypatch.setattr(device, "comes_in_parts", lambda *given: False)
    for found, wanted in zip(pressed(MPI.COMM_SELF), alone, strict=True):
        assert found == pytest.approx(wanted, rel=1e-10)


def curved(comm):
    """Sums over the nodes of curved cells of degree 3, which each rank makes for its own cells."""
    found = []
    for family in (FAMILIES[4], FAMILIES[5], FAMILIES[13], FAMILIES[18], FAMILIES[19]):
        made = sheets.with_exact_shape(dea.device(family(2), comm), 3)
        assert compat.coordinate_element(made.mesh).degree == 3
        nodes = made.mesh.geometry.index_map()
        x = made.length * made.mesh.geometry.x[: nodes.size_local]
        sums = [float(comm.allreduce(np.sum(np.abs(x[:, k]) ** 3))) for k in range(3)]
        found.append([nodes.size_global, *sums])
    few = dea.device(HollowSphere(1.0, 1.2, layers=1, cells=1), comm)
    return [*found, [sheets.with_exact_shape(few).mesh.geometry.index_map().size_global]]


@pytest.mark.slow
@pytest.mark.mpi
def test_curved_cells_of_parts_on_ranks(on_ranks, monkeypatch):
    """One rank and several give what comes from the whole mesh of fourth order."""
    alone = curved(MPI.COMM_SELF)
    for ranks in numbers_of_ranks():
        several = on_ranks("test_spread_tables", "curved", ranks)
        for found, wanted in zip(several, alone, strict=True):
            assert found == pytest.approx(wanted, rel=1e-12)
    monkeypatch.setattr(sheets, "_own_cells", lambda *given: None)
    for found, wanted in zip(curved(MPI.COMM_SELF), alone, strict=True):
        assert found == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("family", [
    Tube(1e-3, 2e-3, [Layer("film", 0.2e-3)], "quarter", angular=8, axial=1),
    HollowSphere(1e-3, 1.2e-3, "octant", layers=1, cells=2),
])  # fmt: skip
def test_a_run_on_a_mesh_of_gmsh_goes_on_in_parts(family, tmp_path, monkeypatch):
    """A checkpoint knows cells by their order, which is the same in both ways."""

    def run(folder, calls=1000, **options):
        made = dea.device(family, MPI.COMM_SELF)
        rubber = dea.Material(dea.NeoHookean(80e3), dea.IdealDielectric(2.8))
        film = dea.Scene(
            made, dict.fromkeys(made.regions, rubber),
            [dea.Ground("inner"), dea.Electrode("outer", 1e3)], [dea.Clamp("x_min")],
        )  # fmt: skip
        wanted = {"tip": dea.MeanDisplacement("y_min", "x"), "s": StopAtState(calls)}
        return dea.solve(film, dea.Ramp(steps=3), wanted, folder, quiet=True, **options)

    whole = run(tmp_path / "whole")
    with monkeypatch.context() as patched, pytest.raises(dea.Interrupted):
        patched.setattr(device, "comes_in_parts", lambda *given: False)
        run(tmp_path / "cut", calls=3)
    again = run(tmp_path / "cut", resume=True)
    assert len(again.history) == len(whole.history) == 4
    assert float(again["tip_m"]) == pytest.approx(float(whole["tip_m"]), rel=1e-9)
