"""A stack of layers in a box of air: its names, their sizes, and what is refused."""

from __future__ import annotations

import pytest

from dea_fenicsx.geometry import AirBox, BoxStack, Layer
from dea_fenicsx.geometry import _gmsh as to_gmsh
from dea_fenicsx.support.errors import InputError

gmsh = pytest.importorskip("gmsh")
SOLID = BoxStack(1.0, 2.0, [Layer("a", 0.1), Layer("b", 0.3)], (3, 2))
STRIP = BoxStack(1.0, None, [Layer("a", 0.1)] * 2, 5, order=1)
OPEN = ("x_max", "y_min", "y_max", "top")


@pytest.fixture(autouse=True)
def clean_gmsh():
    """Every test ends with gmsh not running."""
    yield
    if gmsh.isInitialized():
        gmsh.finalize()


@pytest.mark.parametrize("box", [
    AirBox(SOLID, 0.5, OPEN, divisions=2), AirBox(STRIP, 2.0), AirBox(STRIP, 2.0, ("top",)),
    AirBox(SOLID, 0.5).refine(2),
])  # fmt: skip
def test_measures(box):
    box.mesh().check()
    found = to_gmsh.measure(box.build())
    assert {name: dim for name, (dim, _, _) in found.items()} == box.groups()
    assert {name: size for name, (_, _, size) in found.items()} == pytest.approx(box.measures())


def test_names_and_sizes():
    sizes = AirBox(SOLID, 0.5, OPEN).measures()
    assert set(sizes) == set(SOLID.measures()) | {"air", "walls", "x_min_air", "bottom_air"}
    assert sizes["air"] == pytest.approx(1.5 * 3.0 * 0.9 - 1.0 * 2.0 * 0.4)
    assert sizes["bottom_air"] == pytest.approx(1.5 * 3.0 - 1.0 * 2.0)
    assert set(AirBox(STRIP, 2.0).measures()) == set(STRIP.measures()) | {"air", "walls"}


@pytest.mark.parametrize("match, changes", [
    ("it must be a BoxStack", dict(stack=3)),
    ("names of sides", dict(sides=("left",))),
    ("names of sides", dict(sides=())),
    ("names of sides", dict(sides=("y_min",))),
    ("the name of a layer", dict(region="a")),
    ("name of a facet group", dict(region="walls")),
])  # fmt: skip
def test_refusals(match, changes):
    with pytest.raises(InputError, match=match):
        AirBox(**(dict(stack=STRIP, thickness=1.0) | changes))
