"""A gap of air on a flat face: its names, its sizes, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import AirGap, BoxStack, DiskStack, KreslingCell, Layer, MembraneDisc
from dea_fenicsx.geometry import _gmsh as to_gmsh
from dea_fenicsx.support.errors import InputError

gmsh = pytest.importorskip("gmsh")
STRIP = BoxStack(2e-3, None, [Layer("film", 1e-3)], divisions=(2,))
DEVICES = [
    STRIP, BoxStack(2e-3, 1e-3, [Layer("film", 1e-3)], divisions=(2, 1), order=1),
    DiskStack(1e-2, [Layer("film", 1e-3)]),
    MembraneDisc(12e-3, 4e-3, 1e-3, cells=(2, 1, 2)),
]  # fmt: skip


@pytest.fixture(autouse=True)
def clean_gmsh():
    """Every test ends with gmsh not running."""
    yield
    if gmsh.isInitialized():
        gmsh.finalize()


@pytest.mark.parametrize("device, face", [
    (one, face) for one in DEVICES for face in ("top", "bottom") if face in one.mesh().facets
])  # fmt: skip
def test_measures(device, face):
    """gmsh finds the sizes that are told; the parts of the device stay as they are."""
    gap = AirGap(device, face, 0.7e-3, divisions=2, grading=2.0)
    mesh = gap.mesh()
    mesh.check()
    found = to_gmsh.measure(gap.build())
    assert {name: dim for name, (dim, _, _) in found.items()} == gap.groups()
    sizes = {name: size for name, (_, _, size) in found.items()}
    alone = {name: size for name, (_, _, size) in to_gmsh.measure(device.build()).items()}
    assert {name: sizes[name] for name in alone} == pytest.approx(alone, rel=1e-9)
    assert sizes["air"] == pytest.approx(0.7e-3 * alone[face], rel=1e-9)
    told = gap.measures()
    assert {n: sizes[n] for n in ("air_wall", "air_sides")} == pytest.approx(
        {n: told[n] for n in ("air_wall", "air_sides")}, rel=2e-3)  # fmt: skip
    assert np.max(mesh.points[mesh.facets["air_wall"]][..., device.dimension - 1]) == pytest.approx(
        1.7e-3 if face == "top" else -0.7e-3, abs=1e-12)  # fmt: skip
    assert len(gap.refine(2).mesh().regions["air"]) > 2 * len(mesh.regions["air"])


def test_capacitance_of_a_gap():
    """Two plates with a film and air between: layers in series, in closed form."""
    device = dea.read_gmsh(AirGap(STRIP, "top", 0.5e-3), MPI.COMM_SELF)
    rubber = dea.Material(dea.NeoHookean(1e9), dea.IdealDielectric(3.0))
    scene = dea.Scene(
        device, {"film": rubber, "air": dea.Air()}, kinematics=dea.PlaneStrain(1e-3),
        electrodes=[dea.Ground("bottom"), dea.Electrode("air_wall", 1.0)],
        supports=[dea.Clamp("bottom"), dea.Clamp("air_wall")],
    )  # fmt: skip
    run = dea.solve(scene, dea.Ramp("voltage", steps=1), {"q": dea.Charge("air_wall")}, quiet=True)
    series = 2e-3 * 1e-3 * 8.8541878128e-12 / (0.5e-3 + 1e-3 / 3)
    assert run["q_C"] == pytest.approx(series, rel=1e-6)


@pytest.mark.parametrize("match, changes", [
    ("must be a geometry", dict(device=3)),
    ("no such|not a facet group|facet group", dict(face="roof")),
    ("does not lie in one plane",
     dict(device=KreslingCell(54e-3, 30e-3, 0.8, 0.5e-3, 2e-3, relief=0.3, sides=3),
          face="inner")),
    ("call the air otherwise", dict(region="film")),
])  # fmt: skip
def test_refusals(match, changes):
    with pytest.raises(InputError, match=match):
        AirGap(**(dict(device=STRIP, face="top", thickness=1e-3) | changes))
