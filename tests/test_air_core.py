"""The air inside a Kresling storey: its names, its sizes, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dea_fenicsx.geometry import AirCore, BoxStack, KreslingCell, Layer
from dea_fenicsx.geometry import _gmsh as to_gmsh
from dea_fenicsx.support.errors import InputError

gmsh = pytest.importorskip("gmsh")
STOREY = KreslingCell(
    54e-3, 30e-3, np.radians(50.0), 0.5e-3, 2e-3, relief=0.3, sides=3, along=2, tip=1
)


@pytest.fixture(autouse=True)
def clean_gmsh():
    """Every test ends with gmsh not running."""
    yield
    if gmsh.isInitialized():
        gmsh.finalize()


def test_measures():
    """The air has the volume that gmsh finds, and the parts of the storey are those without air."""
    core = AirCore(STOREY, 0.05)
    core.mesh().check()
    found = to_gmsh.measure(core.build())
    assert {name: dim for name, (dim, _, _) in found.items()} == core.groups()
    sizes = {name: size for name, (_, _, size) in found.items()}
    alone = {name: size for name, (_, _, size) in to_gmsh.measure(STOREY.build()).items()}
    told = core.measures()
    assert sizes["air"] == pytest.approx(told["air"], rel=1e-9)
    assert sizes["core"] == pytest.approx(0.05**2 * alone["inner"], rel=1e-9)
    assert {name: sizes[name] for name in alone} == pytest.approx(alone, rel=1e-9)
    assert set(told) == set(sizes)


def test_the_core_is_the_inner_face_made_smaller():
    core = AirCore(STOREY, 0.1, divisions=3).refine(2)
    mesh = core.mesh()
    assert len(mesh.regions["air"]) == 6 * len(mesh.facets["inner"])
    centre = [0.0, 0.0, STOREY.height / 2]
    small, large = (mesh.points[np.unique(mesh.facets[n])] - centre for n in ("core", "inner"))
    radii = [np.sort(np.linalg.norm(x, axis=1)) for x in (small, large)]
    assert radii[0] == pytest.approx(0.1 * radii[1], rel=1e-12)


@pytest.mark.parametrize("match, changes", [
    ("must be a KreslingCell", dict(storey=BoxStack(1.0, 1.0, [Layer("a", 1.0)]))),
    ("above 0 and below 1", dict(share=1.0)),
    ("name of another group", dict(region="panel")),
    ("name of another group", dict(region="core")),
    ("turns away", dict(storey=replace(STOREY, twist=np.radians(54.0), relief=0.42))),
])  # fmt: skip
def test_refusals(match, changes):
    with pytest.raises(InputError, match=match):
        AirCore(**(dict(storey=STOREY) | changes))
