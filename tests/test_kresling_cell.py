"""The Kresling storey as a solid: shape against the linkage, plates, and its stiffness."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.errors import InputError
from dea_fenicsx.geometry import BoxStack, KreslingCell, Layer
from dea_fenicsx.geometry import _gmsh as to_gmsh
from dea_fenicsx.materials import bulk_modulus_of
from dea_fenicsx.origami import INCH, Kresling, fold_angles, vertices

SIDE, HEIGHT, TWIST, T = 2.125 * INCH, 1.65 * INCH, math.pi / 4, 0.02 * INCH
CELL = KreslingCell(SIDE, HEIGHT, TWIST, T, hinge=2e-3, along=2, strip=2)
SHAPES = {
    "square": CELL,
    "tube": KreslingCell(SIDE, 2.75 * INCH, 0.0, T, 2e-3, through=2),
    "hexagon": KreslingCell(0.1, 0.08, 0.9, 1e-3, 6e-3, relief=0.2, sides=6, tip=2),
}


def linkage(cell: KreslingCell) -> Kresling:
    radius = cell.side / (2 * math.sin(math.pi / cell.sides))
    edge = math.hypot(cell.height, 2 * radius * math.sin(cell.twist / 2))
    return Kresling(cell.side, edge, height=cell.height, sides=cell.sides)


# ---- shape ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SHAPES)
def test_measures(name):
    """Plane parts exactly, arcs of parabolas to fourth order."""
    coarse = SHAPES[name]
    errors = []
    for cell in (coarse, coarse.refine(2)):
        found = {n: size for n, (_, _, size) in to_gmsh.measure(cell.build()).items()}
        exact = cell.measures()
        assert set(found) == set(exact) == set(cell.groups())
        errors.append({n: abs(found[n] / exact[n] - 1) for n in exact})
    for part in exact:
        if part in ("panel", "side", "bottom", "top"):
            assert errors[0][part] < 1e-12
        elif errors[0][part] > 1e-10:
            assert errors[1][part] < errors[0][part] / 12


@pytest.mark.parametrize("name", SHAPES)
def test_panels_lie_on_those_of_the_linkage(name):
    cell = SHAPES[name]
    storey = linkage(cell)
    below, above = vertices(storey, cell.twist)
    n = cell.sides
    mesh = cell.mesh()
    used = np.unique(mesh.cells[mesh.regions["panel"]])
    points = mesh.points[used]
    least = np.full(len(points), np.inf)
    for i in range(n):
        for p in ((below[i], below[(i + 1) % n], above[(i + 1) % n]),
                  (below[i], above[(i + 1) % n], above[i])):  # fmt: skip
            normal = np.cross(p[1] - p[0], p[2] - p[0])
            away = np.abs((points - p[0]) @ normal / np.linalg.norm(normal))
            for level in range(cell.through + 1):  # nodes lie at these distances from the middle
                least = np.minimum(least, np.abs(away - level * cell.thickness / 2 / cell.through))
    assert np.max(least) < 1e-12
    folds = fold_angles(storey, cell.twist)
    half = cell._half_folds()
    assert half[:, 0] == pytest.approx(0.0, abs=1e-12)
    assert 2 * half[:, 1] == pytest.approx(float(folds["edge"]), abs=1e-9)
    assert 2 * half[:, 2] == pytest.approx(float(folds["diagonal"]), abs=1e-9)


def test_hinges_hang_together():
    """Each fold joins two panels; nothing else does: the end faces and the cuts are free."""
    mesh = CELL.mesh()
    sides = np.concatenate([
        mesh.corners(np.take(mesh.cells, end, axis=axis)) for axis in (1, 2, 3) for end in (0, -1)
    ])  # fmt: skip
    keys, times = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)
    once = {tuple(k) for k in keys[times == 1]}
    assert times.max() == 2
    for name in ("bottom", "top", "inner", "outer"):
        assert {tuple(r) for r in np.sort(mesh.corners(mesh.facets[name]), axis=1)} <= once
    joined = 2 * CELL.along * 2 * CELL.sides  # facets in the middle of the folds
    assert np.count_nonzero(times == 2) > joined
    arc = np.linalg.norm(np.diff(mesh.points[mesh.cells[mesh.regions["edge"]][:, 1, :, 1]],
                                 axis=1), axis=2).sum()  # fmt: skip
    strips = 2 * CELL.sides * 2 * CELL.along
    assert arc / strips == pytest.approx(CELL.hinge / 2, rel=5e-3)  # by chords


def test_thickness_is_the_same_everywhere():
    mesh = CELL.mesh()
    through = mesh.points[mesh.cells[..., -1]] - mesh.points[mesh.cells[..., 0]]
    assert np.linalg.norm(through, axis=-1) == pytest.approx(T, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"twist": math.pi / 2}, "the pattern cannot close at a twist of 1.5708 rad"),
        ({"twist": -0.1}, "cannot close"),
        ({"twist": math.nan}, "finite number"),
        ({"thickness": 2e-3}, "too thick for their fold: hinges must be wider than 0.00248"),
        ({"hinge": 0.5e-3}, "too thick for their fold"),
        ({"hinge": 25e-3}, "leave no panel between them"),
        ({"hinge": 4e-3}, "make the relief larger"),
        ({"relief": 0.5}, "above 0 and below 0.5"),
        ({"sides": 2}, "at least 3"),
        ({"height": 0.0}, "positive length"),
        ({"strip": 0}, "at least 1"),
    ],
)
def test_bad_input(change, words):
    with pytest.raises(InputError, match=words):
        replace(CELL, **change)


# ---- elements ---------------------------------------------------------------------------------


def petg(young=2.1e9, nu=0.38):
    mu = young / (2 * (1 + nu))
    return dea.Material(dea.NeoHookean(mu), bulk_modulus=bulk_modulus_of(mu, nu))


def test_cantilever_plate_at_1_to_100():
    """Plate theory: w = 4 q (1 - nu^2) L^3 / (E t^2) of a tip load q t on each width.

    Held across its width, so that the clamp adds no corner effects: no shear locking at cells 25
    times as long as they are thick.
    """
    thick, length, young, nu, load = T, 100 * T, 2.1e9, 0.38, 1.0
    shape = BoxStack(length, length / 4, [Layer("panel", thick)], divisions=(4, 1))
    scene = dea.Scene(
        dea.read_gmsh(shape, MPI.COMM_WORLD),
        {"panel": petg(young, nu)},
        supports=[dea.Clamp("x_min"), dea.Fix("y_min", "y"), dea.Fix("y_max", "y")],
        loads=[dea.DeadLoad("x_max", (0.0, 0.0, load))],
    )
    run = dea.solve(scene, dea.Ramp(steps=1), {"tip": dea.MeanDisplacement("x_max", "z")},
                    quiet=True, stability="never")  # fmt: skip
    exact = 4 * load * (1 - nu**2) * length**3 / (young * thick**2)
    assert exact < 0.01 * length
    assert run["tip_m"] == pytest.approx(exact, rel=0.01)
