"""Bad input of the device families, each refused in one sentence that names what is wrong."""

from __future__ import annotations

import math

import pytest
from test_geometry import ELASTOMER, METAL, SANDWICH

from dea_fenicsx.geometry import HDEA, BoxStack, DiskStack, HelicalCell, Layer, graded
from dea_fenicsx.support.errors import InputError

LENGTHS = [0.0, -1e-3, math.nan, math.inf, "1 mm", None, True]
COUNTS = [0, -1, 1.5, math.nan, "3", None, True]


@pytest.mark.parametrize("value", LENGTHS, ids=str)
@pytest.mark.parametrize("name", ["outer_radius", "inner_radius", "elastomer"])
def test_hdea_refuses_lengths(name, value):
    with pytest.raises(InputError, match=rf"^HDEA: {name} is .* metres\.$"):
        HDEA(**{name: value})


@pytest.mark.parametrize("value", COUNTS, ids=str)
@pytest.mark.parametrize("name", ["turns", "angular", "radial", "rim", "through"])
def test_hdea_refuses_counts(name, value):
    with pytest.raises(InputError, match=rf"^HDEA: {name} is .* whole number of at least"):
        HDEA(**{name: value})


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: HDEA(inset=2.5e-3), "no electrode"),
        (lambda: HDEA(inset=-1e-4), "inset is"),
        (lambda: HDEA(inner_radius=7e-3), "not below outer_radius"),
        (lambda: HDEA(electrode=-1e-5), "zero or a positive length"),
        (lambda: HDEA(grading=0), "positive ratio"),
        (lambda: HelicalCell(electrode=0.0, films=True), "give electrode > 0"),
        (lambda: HDEA(strands=1.5), "strands is 1.5"),
        (lambda: HDEA(ends="round"), "must be one of ramp, flat"),
        (lambda: HDEA(cap=1e-3), 'give ends="flat" with it'),
        (lambda: HDEA(ends="flat", cap=-1e-3), "zero or a positive length"),
        (lambda: HDEA(order=3), "order is 3"),
        (lambda: HDEA().refine(0), "factor is 0"),
        (lambda: HDEA().lead_angle(0.0), "r is 0.0"),
        (lambda: Layer("", 1.0), "name is ''"),
        (lambda: Layer('a"b', 1.0), "without quotes"),
        (lambda: Layer("a", 0.0), "Layer a: thickness"),
        (lambda: Layer("a", 1.0, 0), "divisions is 0"),
        (lambda: Layer("a", 1.0, ends="left"), "both, start, end, none"),
        (lambda: BoxStack(1.0, 1.0, []), "layers is empty"),
        (lambda: BoxStack(1.0, 1.0, ["a"]), "must be a Layer"),
        (lambda: BoxStack(1.0, 1.0, Layer("a", 1.0), (0, 1)), "divisions is 0"),
        (lambda: BoxStack(1.0, 1.0, [Layer("a", 1.0)], (1,)), "2 values"),
        (lambda: BoxStack(-1.0, 1.0, [Layer("a", 1.0)]), "length is -1.0"),
        (lambda: BoxStack(1.0, 0.0, [Layer("a", 1.0)]), "width is 0.0"),
        (lambda: BoxStack(1.0, 1.0, [Layer("a", 1.0)], x0=math.nan), "x0 is nan"),
        (lambda: BoxStack(1.0, 1.0, [Layer("top", 1.0)]), "also the name of a facet group"),
        (lambda: DiskStack(1.0, []), "layers is empty"),
        (lambda: DiskStack(1.0, [ELASTOMER], inner_radius=1.0), "not below radius"),
        (lambda: DiskStack(1.0, [ELASTOMER], inset=1.0), "no electrode"),
        (lambda: DiskStack(1.0, [ELASTOMER], inner_inset=0.1), "without a hole"),
        (lambda: DiskStack(1.0, [ELASTOMER], angular=10), "multiple of 4"),
        (lambda: DiskStack(1.0, [METAL], inset=0.1), "give margin a name"),
        (lambda: DiskStack(1.0, SANDWICH, inset=0.1, margin="carbon"), "name of an electrode"),
        (lambda: DiskStack(1.0, SANDWICH, inset=0.1, margin="side"), "facet group"),
        (lambda: graded(0, 1.0), "n is 0"),
        (lambda: graded(2, math.nan), "positive ratio"),
        (lambda: graded(2, 2.0, "middle"), "must be one of"),
    ],
)
def test_refuses(make, says):
    with pytest.raises(InputError) as caught:
        make()
    message = str(caught.value)
    assert says in message and message.endswith(".") and "\n" not in message


@pytest.mark.parametrize("path", ["missing/a.msh", "a.vtk", "folder.msh", "/proc/a.msh"])
def test_refuses_paths(tmp_path, path):
    (tmp_path / "folder.msh").mkdir()
    with pytest.raises(InputError, match=r"^Mesh file .*\.$"):
        HDEA(turns=1).write(tmp_path / path)
    assert [p.name for p in tmp_path.iterdir()] == ["folder.msh"]
