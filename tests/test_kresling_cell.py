"""The Kresling storey as a solid: shape against the linkage, plates, and its stiffness."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import on_demand
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, KreslingCell, Layer
from dea_fenicsx.geometry import _gmsh as to_gmsh
from dea_fenicsx.materials import bulk_modulus_of
from dea_fenicsx.origami import INCH, Kresling, fold_angles, vertices
from dea_fenicsx.support.errors import InputError

SIDE, HEIGHT, TWIST, T = 2.125 * INCH, 1.65 * INCH, math.pi / 4, 0.02 * INCH
CELL = KreslingCell(SIDE, HEIGHT, TWIST, T, hinge=2e-3, along=2, strip=2)
SHAPES = {
    "square": CELL,
    "tube": KreslingCell(SIDE, 2.75 * INCH, 0.0, T, 2e-3, through=2),
    "graded": KreslingCell(SIDE, HEIGHT, TWIST, T, 2e-3, along=3, tip=3, strip=3, through=2,
                           grading=4.0, grading_strip=3.0, grading_through=2.0),
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


@pytest.mark.parametrize("slender", [100, 1000])
def test_cantilever_plate(slender):
    """Plate theory: w = 4 q (1 - nu^2) L^3 / (E t^2) of a tip load q t on each width.

    Held across its width, so that the clamp adds no corner effects.  No shear locking, at cells 8
    and 83 times as long as they are thick; what is missing is that of twelve plane pieces.
    """
    length, young, nu = 100 * T, 2.1e9, 0.38
    thick, load = length / slender, 1e3 / slender**2
    shape = BoxStack(length, length / 4, [Layer("panel", thick)], divisions=(12, 1))
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


# ---- stiffness at rest ------------------------------------------------------------------------


def arc_stiffness(length, turn, bending, tension):
    """Of a clamped arc per width: forces and moment at its end, by (x, y, rotation) there.

    Castigliano, x along the start's tangent and y towards the centre; and where the end lies.
    """
    x, w = np.polynomial.legendre.leggauss(16)
    s, ds = (x + 1) / 2 * length, w / 2 * length
    k = turn / length if turn else 1e-9
    place = np.array([np.sin(k * s) / k, (1 - np.cos(k * s)) / k])
    end = np.array([np.sin(k * length) / k, (1 - np.cos(k * length)) / k])
    moment = np.vstack([place[1] - end[1], end[0] - place[0], np.ones_like(s)])
    force = np.vstack([np.cos(k * s), np.sin(k * s), 0 * s])
    return np.linalg.inv((moment * ds) @ moment.T / bending + (force * ds) @ force.T / tension), end


def rigid_panels_on_arcs(cell, young, held):
    """Axial stiffness in N/m of rigid panels that hang together by curved beams; free twist.

    Six unknowns a panel.  An end face at the top goes down upright and is else free.  The beams'
    width is held, as in the middle of a long hinge (plane strain), or free, as at its ends.
    """
    panels, t = 2 * cell.sides, cell.thickness
    modulus = young / (1 - 0.5**2) if held else young
    K = np.zeros((6 * panels + 1,) * 2)  # the last unknown is the height of the top
    corner, up, half = cell._panels, cell._normals, cell._half_folds()
    gauss, weight = np.polynomial.legendre.leggauss(8)

    def motion(body, x):
        """Displacement and rotation at a point by all unknowns."""
        found = np.zeros((6, len(K)))
        if body == "top":
            found[2, -1] = 1.0
        elif body != "bottom":
            own = slice(6 * body, 6 * body + 6)
            arm = np.array([[0, x[2], -x[1]], [-x[2], 0, x[0]], [x[1], -x[0], 0]])
            found[:, own] = np.block([[np.eye(3), arm], [np.zeros((3, 3)), np.eye(3)]])
        return found

    for k in range(panels):
        for j, other in enumerate((
            "top" if k % 2 else "bottom", (k + (-3 if k % 2 else 3)) % panels, k ^ 1
        )):  # fmt: skip
            if j and other < k:
                continue
            a, b = corner[k][j], corner[k][(j + 1) % 3]
            size = np.linalg.norm(b - a)
            along = (b - a) / size
            out = np.cross(along, up[k])
            alpha, length = half[k, j], cell.hinge if j else cell.hinge / 2
            away = cell.hinge / 2 * (math.tan(alpha) / alpha if abs(alpha) > 1e-9 else 1.0)
            turn = 2 * alpha if j else 0.0
            planar, end = arc_stiffness(length, turn, modulus * t**3 / 12, modulus * t)
            shear = young / 3 * t / length
            if other == "top":  # nothing holds it sideways
                level = np.array([out[:2] @ out[:2], -up[k][:2] @ out[:2], 0.0])
                pull = planar @ level
                planar = planar - np.outer(pull, pull) / (level @ pull)
                shear = 0.0
            left = 1 - 2 * cell.relief
            for g, w in zip(gauss, weight, strict=True):
                x = a + (0.5 + left * g / 2) * size * along + (end[0] - away) * out - end[1] * up[k]
                apart = motion(other, x) - motion(k, x)
                q = np.vstack([out @ apart[:3], -up[k] @ apart[:3], along @ apart[3:]])
                slip = along @ apart[:3]
                share = w / 2 * left * size
                K += share * (q.T @ planar @ q + shear * np.outer(slip, slip))
    return K[-1, -1] - K[-1, :-1] @ np.linalg.solve(K[:-1, :-1], K[:-1, -1])


def stiffness(cell, hinge, panel, held=False):
    """Of the linear solution in N/m: a step of a millionth of the height."""
    small = 1e-6 * cell.height
    rubber = dea.Material(dea.NeoHookean(hinge / 3))
    scene = dea.Scene(
        dea.read_gmsh(cell, MPI.COMM_WORLD),
        {"panel": petg(panel), "side": rubber, "edge": rubber, "diagonal": rubber},
        supports=[dea.Clamp("bottom"), *([dea.Fix("top", "xy")] if held else [])],
        prescribed=[dea.Displacement("top", "z", -small)],
    )
    run = dea.solve(scene, dea.Ramp("stretch", steps=1), {"force": dea.Reaction("top", "z")},
                    quiet=True, stability="never")  # fmt: skip
    return -run["force_N"] / small


def test_rigid_panels_on_curved_beams():
    """An independent model of 49 unknowns bounds it: its beams' width is held, or free.

    On finer meshes 881.5 and 883.8 N/m, between 770 and 1014.
    Panels a million times as stiff: hinges resist a shift of their axis by 12 E I/w^3 a length,
    against which panels only a thousand times as stiff still bend.
    """
    cell = replace(CELL, thickness=0.25e-3, strip=3)
    found = stiffness(cell, 1e8, 1e14)
    assert rigid_panels_on_arcs(cell, 1e8, False) < found < rigid_panels_on_arcs(cell, 1e8, True)
    assert found == pytest.approx(884.0, rel=0.02)


def test_hinges_alone_soften_with_their_modulus():
    stiff, soft = (stiffness(CELL, hinge, 1e14) for hinge in (100e6, 50e6))
    assert 1 - soft / stiff == pytest.approx(0.5, abs=0.01)


# ---- buckling with held twist ------------------------------------------------------------------


def held_storey(cell, stroke):
    """The storey with its twist held, pushed down by a stroke at factor 1."""
    rubber = dea.Material(dea.NeoHookean(100e6 / 3), density=1200.0)
    return dea.Scene(
        dea.device(cell, MPI.COMM_WORLD),
        {"panel": replace(petg(), density=1200.0), "side": rubber, "edge": rubber,
         "diagonal": rubber},
        supports=[dea.Clamp("bottom"), dea.Fix("top", "xy")],
        prescribed=[dea.Displacement("top", "z", -stroke)],
    )  # fmt: skip


BUCKLING_STROKE = 0.620e-3
"""Stroke in m at which the panels buckle, extrapolated from three meshes of even cells."""


@on_demand
def test_panels_buckle_with_held_twist():
    """The lowest frequency vanishes where the panels begin to move in and out by turns.

    omega^2 of this motion is taken on both sides of the bifurcation, and between them by a line.
    """
    cell = replace(CELL, along=3, tip=2)
    strokes, squares, run = (0.63e-3, 0.67e-3), [], None
    scene = held_storey(cell, 1e-3)
    lower = [dea.AtPoint(tuple(map(float, place)), "displacement", "z")
             for place in cell._panels[::2].mean(axis=1)]  # fmt: skip
    for stroke in strokes:
        path = dea.Ramp("stretch", to=stroke / 1e-3, steps=1 if run else 3)
        run = dea.solve(scene, path, quiet=True, stability="never", start=run)
        modes = dea.modes(run, 1)
        squares.append(float(modes.squares[0]))
        moved = np.array([modes.derivative(point, 0) for point in lower])
        assert moved == pytest.approx(moved[0] * np.array([1, -1, 1, -1]), rel=1e-3)
    assert squares[0] > 0 > squares[1]
    found = np.interp(0, squares[::-1], strokes[::-1])
    assert found == pytest.approx(BUCKLING_STROKE, rel=0.06)  # of this coarse mesh
