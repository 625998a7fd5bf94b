"""Large tables of results stay spread over the ranks; what is written is the same."""

from __future__ import annotations

import tempfile
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import numbers_of_ranks
from mpi4py import MPI
from stopped_runs import scene

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.results import checkpoint, fields, spread
from dea_fenicsx.results.file_order import FileOrder, by_first_appearance

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


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("width", [2.0, None])
def test_parts_of_a_stack_make_the_whole(order, width):
    """Cells, points and groups of the parts are those of the whole mesh, in its order."""
    layers = [Layer("a", 1.0, 2), Layer("b", 0.5), Layer("a", 1.0)]
    box = BoxStack(3.0, width, layers, (3, 2), order=order, grading=(2.0, 1.0))
    mesh, parts = box.mesh(), [box.mesh_part(k, 5) for k in range(5)]
    rows = np.concatenate(list(mesh.regions.values()))
    assert np.array_equal(np.concatenate([s.cells for s in parts]), mesh.cells[rows])
    assert np.array_equal(np.concatenate([s.points for s in parts]), mesh.points)
    assert list(box.groups_of_parts().items()) == list(box.groups().items())
    for name, facets in mesh.facets.items():
        found = np.concatenate([s.facets[name] for s in parts if name in s.facets])
        wanted, found = (np.sort(f.reshape(len(f), -1), axis=1) for f in (facets, found))
        assert np.array_equal(np.unique(found, axis=0), np.unique(wanted, axis=0))
    sizes = [sum(len(s.regions.get(n, ())) for s in parts) for n in mesh.regions]
    assert sizes == [len(cells) for cells in mesh.regions.values()]
    assert box.cell_shape()["least_scaled_jacobian"] == 1.0
