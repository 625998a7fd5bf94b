"""A helix is made in parts, and they are the mesh that gmsh is given as a whole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import numbers_of_ranks
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import HDEA, _gmsh
from dea_fenicsx.mesh import device
from dea_fenicsx.mesh.device import one_sided

pytestmark = pytest.mark.usefixtures("quick_compile")

DEVICES = {
    "helix": HDEA(turns=3, angular=5, rim=2, through_electrode=2),
    "ideal": HDEA(turns=2, electrode=0.0, inset=0.0),
    "sectors": HDEA(sectors=((-60, 60), (90, 120)), angular=9),
    "named": HDEA(electrode=0.0, sectors={"left": (30, 150), "right": (210, 360)}, strands=2),
    "flat": HDEA(turns=1, ends="flat", angular=7),
    "flat sectors": HDEA(ends="flat", sectors={"a": (-60, 60), "b": (90, 180)}, angular=8),
    "caps": HDEA(ends="flat", cap=1e-3, through_cap=3, strands=2, angular=6),
    "caps, ideal": HDEA(turns=1, ends="flat", cap=1e-3, electrode=0.0, sectors=((0, 180),)),
    "least": HDEA(turns=1, ends="flat", cap=1e-3, angular=3, radial=1, inset=0.0),
}


def corners_of(here):
    """Numbers of the corners of all cells."""
    return here.mesh.topology.connectivity(3, 0).array


def rows(nodes):
    """Facets as sorted rows of nodes."""
    flat = np.sort(nodes.reshape(len(nodes), -1), axis=1)
    return flat[np.lexsort(flat.T)]


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("name", DEVICES)
def test_parts_of_a_helix_make_the_whole(name, order):
    """Cells, points and groups of the parts are those of the whole mesh, in its order."""
    helix = replace(DEVICES[name], order=order)
    mesh = helix.mesh()
    mesh.check()
    assert len(np.unique(mesh.cells)) == len(mesh.points)
    assert len(np.unique(np.round(mesh.points, 9), axis=0)) == len(mesh.points)
    wanted = np.concatenate(list(mesh.regions.values()))
    of = np.repeat(list(mesh.regions), [len(cells) for cells in mesh.regions.values()])
    for count in (1, 2, 3, 7, len(wanted) + 3 if len(wanted) < 300 else 11):
        parts = [helix.mesh_part(k, count) for k in range(count)]
        assert max(len(s.cells) for s in parts) <= len(wanted) // count + 1
        assert max(len(s.points) for s in parts) <= len(mesh.points) // count + 1
        assert np.array_equal(np.concatenate([s.cells for s in parts]), mesh.cells[wanted])
        assert np.array_equal(np.concatenate([s.points for s in parts]), mesh.points)
        found = []
        for part in parts:
            names = np.empty(len(part.cells), of.dtype)
            for region, cells in part.regions.items():
                names[cells] = region
            found.append(names)
        assert np.array_equal(np.concatenate(found), of)
        for group, facets in mesh.facets.items():
            there = [s.facets[group] for s in parts if group in s.facets]
            assert np.array_equal(rows(np.concatenate(there)), rows(facets)), group
        assert {group for s in parts for group in s.facets} == set(mesh.facets)


@pytest.mark.parametrize("name", DEVICES)
def test_groups_and_quality_without_the_mesh(name):
    """Names in their order, and gmsh's quality of all cells from a few of them."""
    for helix in (DEVICES[name], replace(DEVICES[name], order=1), DEVICES[name].refine(2)):
        assert list(helix.groups_of_parts().items()) == list(helix.groups().items())
        with _gmsh.temporary_model(helix.mesh(), "whole") as model:
            wanted = _gmsh.quality(model)
        assert helix.cell_shape() == pytest.approx(tuple(wanted.values()), rel=1e-8)


@pytest.mark.parametrize("name", ["helix", "named", "flat sectors", "caps"])
def test_helices_are_meshed_as_by_gmsh(name, monkeypatch):
    """Nodes, cells, tags, names and quality of the device, and the order of nodes and cells."""
    quick = dea.device(DEVICES[name], MPI.COMM_SELF)
    monkeypatch.setattr(device, "comes_in_parts", lambda *given: False)
    slow = dea.device(DEVICES[name], MPI.COMM_SELF)
    for found, told in (
        (quick.mesh.geometry.x, slow.mesh.geometry.x),
        (corners_of(quick), corners_of(slow)),
        (quick.mesh.topology.original_cell_index, slow.mesh.topology.original_cell_index),
        (quick.mesh.geometry.input_global_indices, slow.mesh.geometry.input_global_indices),
        (quick.cells.values, slow.cells.values), (quick.cells.indices, slow.cells.indices),
        (quick.facets.values, slow.facets.values), (quick.facets.indices, slow.facets.indices),
    ):  # fmt: skip
        assert np.array_equal(found, told)
    assert (quick.regions, quick.surfaces) == (slow.regions, slow.surfaces)
    assert (quick.source, quick.length) == (slow.source, slow.length)
    assert quick.quality == pytest.approx(slow.quality, rel=1e-9)


def measured(comm):
    """What a small helix does under voltage, and what its mesh has."""
    here = dea.device(HDEA(turns=2, angular=4, radial=1, ends="flat"), comm)
    metal = dea.Material(dea.NeoHookean(73.7e3), dea.Conductor())
    rubber = dea.Material(dea.NeoHookean(73.7e3), dea.IdealDielectric(4.7))
    scene = dea.Scene(
        here,
        {name: metal if "electrode" in name else rubber for name in here.regions},
        [dea.Electrode("electrode_a", 2e3), dea.Ground("electrode_b")],
        [dea.FreeBody()],
    )
    record = {
        "contraction": dea.Contraction(("bottom", "top"), "z"),
        "charge": dea.Charge("electrode_a"),
    }
    run = dea.solve(scene, dea.Ramp("voltage", steps=1), record, quiet=True, stability="never")
    values = [float(run["contraction"]), float(run["charge_C"]), float(run.summary["volume_m3"])]
    return {"values": values, "counts": counts(here), "quality": here.quality}


def counts(here):
    """Of the nodes, of the cells of each region and of the facets of each surface."""
    sizes = [here.mesh.geometry.index_map().size_global]
    owned = here.owned_cells()
    regions = [np.count_nonzero(here.cells_of(name) < owned) for name in here.regions]
    surfaces = [len(one_sided(here, name)) for name in here.surfaces]
    return sizes + [int(here.comm.allreduce(k)) for k in (*regions, *surfaces)]


@pytest.fixture(scope="module")
def alone():
    """What one rank finds on the mesh that gmsh is given as a whole."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DEA_FENICSX_CFLAGS", "-O1 -g0")
        patch.setattr(device, "comes_in_parts", lambda *given: False)
        return measured(MPI.COMM_SELF)


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [1, *numbers_of_ranks()])
def test_a_helix_is_the_same_on_any_number_of_ranks(alone, on_ranks, ranks):
    """Contraction, charge and volume, sizes of all groups and quality, as by gmsh on one rank."""
    found = on_ranks("test_helix_parts", "measured", ranks)
    assert found["values"] == pytest.approx(alone["values"], rel=1e-10)
    assert found["counts"] == alone["counts"]
    assert found["quality"] == pytest.approx(alone["quality"], rel=1e-9)


def tiny(comm):
    """Sizes of a helix of six cells."""
    helix = HDEA(turns=1, angular=3, radial=1, inset=0.0, electrode=0.0)
    here = dea.device(helix, comm)
    return [comm.size, *counts(here), here.mesh.topology.index_map(3).size_global]


@pytest.mark.mpi
@pytest.mark.slow
def test_more_ranks_than_cells(on_ranks):
    """Seven ranks share six cells, so that one makes none and owns none."""
    assert on_ranks("test_helix_parts", "tiny", 7) == [7, *tiny(MPI.COMM_SELF)[1:]]
