"""A rigid sphere on a bonded layer of rubber: Hertz's force, pressure and area."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer

MU, RADIUS, DEPTH, THICKNESS = 1e5, 1.0, 1e-3, 2.0
"""Shear modulus in Pa; radius of the sphere, its largest indentation and the layer in m."""

GROWTH = 1.25
"""Size of each cell over that of its neighbour nearer to the contact."""


REACH = 1.5
"""How far the cells have one size, in contact radii."""


def marks(size, cell, uniform):
    """Ends of cells from 0 to a size, which have one size over a first part and grow then."""
    ends = list(np.arange(uniform + 1) * cell)
    while ends[-1] < size:
        ends.append(ends[-1] + GROWTH * (ends[-1] - ends[-2]))
    past = np.array(ends[uniform:]) - ends[uniform]
    return np.array([*ends[:uniform], *(ends[uniform] + past * (size - ends[uniform]) / past[-1])])


@dataclass(frozen=True)
class Layered(BoxStack):
    """A layer whose cells are small where the sphere touches it.

    Parameters (besides those of a `BoxStack`)
    ----------
    r, z
        Ends of the cells.
    """

    r: tuple[float, ...] = ()
    z: tuple[float, ...] = ()

    def mesh(self):
        mesh = super().mesh()
        for k, ends in enumerate((self.r, self.z)):
            even = np.linspace(0, ends[-1], len(ends))
            mesh.points[:, k] = np.interp(mesh.points[:, k], even, ends)
        return mesh


def layer(cells, comm=MPI.COMM_SELF):
    """A layer with so many cells along the contact radius at the largest indentation."""
    radius = math.sqrt(RADIUS * DEPTH)
    r = marks(2 * THICKNESS, radius / cells, round(REACH * cells))
    z = THICKNESS - marks(THICKNESS, radius / cells, cells)[::-1]
    rows = [Layer("rubber", THICKNESS, len(z) - 1)]
    stack = Layered(2 * THICKNESS, None, rows, (len(r) - 1,), r=tuple(r), z=tuple(z))
    return dea.Scene(
        dea.read_gmsh(stack, comm), {"rubber": dea.Material(dea.NeoHookean(MU))},
        supports=[
            dea.Clamp("bottom"), dea.Fix("x_min", "r"),
            dea.Obstacle("top", dea.Sphere((0.0, THICKNESS + RADIUS), RADIUS),
                         displacement=(0.0, -DEPTH)),
        ],
        kinematics=dea.Axisymmetric(),
    )  # fmt: skip


RECORD = {
    "force": dea.ContactForce("top", "z"), "area": dea.ContactArea("top"),
    "peak": dea.ContactPressure("top"), "support": dea.Reaction("bottom", "z"),
}  # fmt: skip


def pressed(cells, steps=2, comm=MPI.COMM_SELF):
    """Force, area and peak pressure over Hertz's, with the factor of the bonded layer."""
    run = dea.solve(layer(cells, comm), dea.Ramp("obstacle", steps=steps), RECORD, quiet=True,
                    options=dea.NewtonOptions(tolerance=1e-11))  # fmt: skip
    last = run.history[-1]
    a = math.sqrt(RADIUS * DEPTH)
    x = a / THICKNESS
    bonded = 1 + 1.133 * x + 1.283 * x**2 + 0.769 * x**3
    force = 16 / 3 * MU * math.sqrt(RADIUS) * DEPTH**1.5 * bonded
    assert last["support_N"] == pytest.approx(-last["force_N"], rel=1e-7)
    assert run.summary["inertia"] == 0
    assert x < 1 / 60
    return [-last["force_N"] / force, last["area_m2"] / (math.pi * a**2),
            last["peak_Pa"] / (1.5 * force / (math.pi * a**2))]  # fmt: skip


def test_hertz():
    """Within 2 % of Hertz, and the finer the mesh the nearer to its limit."""
    forces = {}
    for cells in (2, 4, 8):
        forces[cells], area, peak = pressed(cells)
        assert forces[cells] == pytest.approx(1, abs=0.02)
        # Two facets in the contact resolve its peak to 4 %.
        assert peak == pytest.approx(1, abs=0.02 + 0.04 / cells)
        # The edge is found to within two points of integration, 0.34 of a facet apart.
        assert area == pytest.approx(1, abs=0.68 / cells)
    # The strains are small, but not infinitely small: the limit differs from 1 by 0.3 %.
    assert abs(forces[8] - 1) < 0.004
    assert abs(forces[4] - forces[8]) < 0.3 * abs(forces[2] - forces[8])


def test_any_number_of_steps():
    """The pressure at a point is the least exact: it holds r times the error of a place."""
    assert pressed(4, steps=5) == pytest.approx(pressed(4, steps=1), rel=2e-7)


@pytest.mark.mpi
@pytest.mark.slow
@pytest.mark.parametrize("ranks", [3])
def test_any_number_of_ranks(ranks, on_ranks):
    assert on_ranks("test_hertz", "_coarse", ranks) == pytest.approx(pressed(3), rel=1e-7)


def _coarse(comm):
    return pressed(3, comm=comm)
