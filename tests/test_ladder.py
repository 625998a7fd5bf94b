"""Speed against error: extrapolation, and a ladder whose exact value is known."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from test_helical import RING, ring, tube

import dea_fenicsx as dea
from dea_fenicsx.run.fidelity_ladder import extrapolated

LAM, TWIST = 1.2, 150.0


def twisted(level):
    """A rubber tube of given stretch and twist, whose torque is known."""
    return ring(RING.refine(level), prescribed=[dea.AxialStretch(LAM), dea.Twist(TWIST)])


def test_extrapolation_finds_limit_and_order():
    for n in (1.0, 2.0, 4.0):
        for levels in ((1, 2, 4), (2, 3, 5)):
            values = [3 + 0.2 * level**-n for level in levels]
            limit, order = extrapolated(levels, values)
            assert limit == pytest.approx(3, abs=1e-9)
            assert order == pytest.approx(n, abs=1e-6)
    # what jumps to and fro has no order, and nothing is made up
    assert np.isnan(extrapolated((1, 2, 4), (1.0, 1.2, 1.1))[1])


def test_a_ladder_with_an_exact_value(tmp_path):
    """Torque of Rivlin's twisted tube, by its formula and by elements; order 4 in the cells."""
    torque = tube(LAM, TWIST, RING.inner_radius, RING.outer_radius)[1]
    ladder = dea.speed_vs_error(
        {"formula": lambda: torque, "rings": twisted},
        dea.OverallTorque(), (1, 2, 4), path=dea.Ramp(steps=2), exact=torque, name="tube",
    )  # fmt: skip
    first, *rest = ladder.rungs
    assert (first.element, first.unknowns, first.error) == ("formula", 0, 0)
    errors = [rung.error for rung in rest]
    assert errors[0] > errors[1] > errors[2]
    assert 3 < ladder.orders["rings"] < 4.5  # 4 in the end; 3.2 on meshes as coarse as these
    # extrapolated without the exact value, the mesh's own error is nearly the whole error
    assert rest[1].mesh_error == pytest.approx(errors[1], rel=0.2)
    assert ladder.cheapest(1e-9) is first
    ladder.write(tmp_path / "tube.csv")
    rows = list(csv.DictReader((tmp_path / "tube.csv").read_text("utf-8").splitlines()))
    assert [float(row["error"]) for row in rows] == [0.0, *errors]
    assert all(path.exists() for path in dea.pictures.ladder(tmp_path / "tube.csv"))


@pytest.mark.parametrize("levels", [(), (0, 1, 2), (2, 2, 4), (1, 2)])
def test_bad_levels(levels):
    with pytest.raises(dea.InputError, match="ladder"):
        dea.speed_vs_error(twisted, dea.OverallTorque(), levels)
