"""Patterned electrodes: sectors lie where they are asked for; what makes no sector is refused.

Their exact measures, names and neighbours are checked in test_geometry.py.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from dea_fenicsx.geometry import HDEA
from dea_fenicsx.support.errors import InputError


def test_sectors_lie_where_they_are_asked_for():
    """Any angles, any number of cells: every electrode cell lies within its sector."""
    sectors = {"left": (-50.0, 77.0), "right": (100.0, 253.0)}
    device = HDEA(sectors=sectors, angular=17)
    assert device.refine(2).sectors == device.sectors
    mesh = device.mesh()
    mesh.check()
    assert not {"electrode_a", "electrode_b_active"} & set(device.groups())
    for name, (start, end) in sectors.items():
        nodes = np.unique(mesh.cells[mesh.regions[f"electrode_a_{name}"]])
        angle = np.degrees(np.arctan2(mesh.points[nodes, 1], mesh.points[nodes, 0]))
        angle = np.mod(angle - start + 1e-6, 360) - 1e-6
        assert angle.min() == pytest.approx(0, abs=1e-9)
        assert angle.max() == pytest.approx(end - start, rel=1e-12)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: HDEA(sectors=180), "pairs of angles"),
        (lambda: HDEA(sectors=(0, 180)), "a pair of angles"),
        (lambda: HDEA(sectors=((0, math.nan),)), "a sector is (0, nan)"),
        (lambda: HDEA(sectors=((90, 0),)), "end at a larger angle"),
        (lambda: HDEA(sectors=((0, 400),)), "less than once"),
        (lambda: HDEA(sectors=((0, 360),)), "the ends of the sector 0 to 360"),
        (lambda: HDEA(sectors=((0, 120), (90, 180))), "0 to 120 and 90 to 180 degrees overlap"),
        (lambda: HDEA(sectors=((300, 400), (0, 90))), "overlap or touch"),
        (lambda: HDEA(sectors={"a": (0, 180), "b": (180, 270)}), "leave a gap"),
        (lambda: HDEA(sectors={"": (0, 180)}), "name of a sector is ''"),
        (lambda: HDEA(angular=3, sectors=((10, 20), (30, 40))), "at least 5"),
    ],
)
def test_refuses(make, says):
    with pytest.raises(InputError) as caught:
        make()
    message = str(caught.value)
    assert says in message and message.endswith(".") and "\n" not in message
