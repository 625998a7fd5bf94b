"""Steps of a fixed length in time converge with their order: films against exact states."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import block

import dea_fenicsx as dea
from dea_fenicsx.exact import Film, march
from dea_fenicsx.model.viscous_history import ViscousHistory
from dea_fenicsx.results.moment import stacked

pytestmark = pytest.mark.usefixtures("quick_compile")

G, T = 15.36e3, 1e-3
VHB = dea.Material(
    dea.ArrudaBoyce(G, 5.99, form="pade"), dea.IdealDielectric(4.8),
    viscous=[dea.Maxwell(26.06e3, 0.6074), dea.Maxwell(26.53e3, 6.56), dea.Maxwell(10.83e3, 61.25)],
)  # fmt: skip
FILM = Film(VHB, T)
UNIT = T * math.sqrt(G / FILM.permittivity)
"""Voltage at which the nominal field is sqrt(G/eps)."""

RATE, LOST = 1.6, 1.508249
"""Rate of the field in 1/s, and the field at pull-in, both in units of sqrt(G/eps)."""

SECONDS = 0.9 * LOST / RATE
"""0.9 of the time to pull-in."""

AT = (0.5, 0.75, 1.0)
"""Times in units of `SECONDS` at which the stretch is compared."""


def distorted(cells):
    """A film of hexahedra or quadrilaterals whose inner nodes have been moved at random."""
    device = block(cells, order=1)
    x = device.mesh.geometry.x[:, : device.dim]
    low, high = x.min(axis=0), x.max(axis=0)
    moved = (x > low + 1e-9) & (x < high - 1e-9)  # nodes of faces stay in their faces
    size = (high - low) / cells
    x[:] += np.where(moved, 0.25 * size * np.random.default_rng(1).uniform(-1, 1, x.shape), 0.0)
    return device


def scene(device):
    """The free film under the unit of voltage, in space or as a disc."""
    solid = device.dim == 3
    sides = ["x", "y"] if solid else ["r"]
    return dea.Scene(
        device,
        {"film": VHB},
        electrodes=[dea.Electrode("top", UNIT), dea.Ground("bottom")],
        supports=[dea.Fix("bottom", "z")]
        + [dea.Fix(f"{axis if solid else 'x'}_min", axis) for axis in sides],
        kinematics=dea.ThreeD() if solid else dea.Axisymmetric(),
    )


def errors(device, steps, order):
    """Error of the stretch at the fixed times."""
    end = RATE * SECONDS
    run = dea.solve(
        scene(device), dea.March(SECONDS, {"voltage": dea.Rise(end, SECONDS)}, steps, order=order),
        {"thickness": dea.MeanStretch(("bottom", "top"), "z")}, quiet=True, stability="never",
    )  # fmt: skip
    time, stretch = run.column("time_s"), run.column("thickness") ** -0.5
    assert len(time) == steps + 1
    exact = march(FILM, SECONDS, voltage=dea.Rise(end * UNIT, SECONDS))
    at = [round(share * steps) for share in AT]
    return stretch[at] - exact.stretch(time[at])


@pytest.mark.parametrize(("cells", "order", "steps"), [
    ((1, 1), 2, (64, 128, 256)),
    ((1, 1), 1, (32, 64, 128)),
    ((3, 2), 2, (64, 128)),
    ((1, 1, 1), 2, (64, 128)),
    ((2, 2, 1), 2, (64, 128)),
])  # fmt: skip
def test_fitted_order(cells, order, steps):
    device = distorted(cells)
    found = np.array([errors(device, number, order) for number in steps])
    slopes = -np.polyfit(np.log(steps), np.log(np.abs(found)), 1)[0]
    assert slopes == pytest.approx(order, abs=0.1)


def test_a_rank_without_cells_writes_its_history():
    """More ranks than cells: a table without rows has as many columns as that of other ranks."""
    history = ViscousHistory((np.zeros((3, 0, 8, 6)),) * 2, (1.0, 0.0))
    assert stacked(history, 0).shape == (0, 2 * 3 * 8 * 6)
