"""Rigid obstacles in pictures and reports: where they are, and that they are drawn."""

from __future__ import annotations

import importlib.util
import json

import numpy as np
import pytest
from test_pictures import H, write_run

import dea_fenicsx as dea
from dea_fenicsx.pictures import level_sets
from dea_fenicsx.pictures.drawn_body import DrawnBody
from dea_fenicsx.pictures.obstacle_nets import nets_of
from dea_fenicsx.pictures.obstacles import gap_of, obstacles_of, rigid_motion

AXES = ("x", "y", "z")
TURN = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1.0]])


@pytest.mark.parametrize(
    ("shape", "axes"),
    [
        (dea.Plane((0.1, 0.2, 0.3), (1, 2, -2)), "xyz"),
        (dea.Sphere((0.1, 0.2, 0.3), 0.4), "xyz"),
        (dea.Cylinder((0.1, 0.2, 0.3), (0, 3, 4), 0.5, hollow=True), "xyz"),
        (dea.Plane((0.1, 0.2), (3, -4)), "xy"),
        (dea.Cylinder((0.1, 0.2), None, 0.3), "xy"),
        (dea.Plane((0.0, 0.2), (0, -1)), "rz"),
        (dea.Sphere((0.0, 0.2), 0.3), "rz"),
        (dea.Cylinder((0.0, 0.2), None, 0.3), "rz"),
    ],
)
def test_the_gap_is_that_of_the_scene(shape, axes):
    """The gap in a picture is that of the scene at the same point in space."""
    rotational = axes == "rz"
    in_space = shape.in_space(rotational)
    gap = gap_of(json.loads(json.dumps(vars(shape) | {"type": type(shape).__name__})), axes)
    for place in np.random.default_rng(1).uniform(0, 1, (5, 3)):
        x = np.array([place[0], 0, place[1]]) if rotational else place * ([1, 1, axes == "xyz"])
        shown = np.array([x[0], x[2], 0]) if rotational else x
        assert gap(shown) == pytest.approx(float(in_space.gap(x, float)), abs=1e-14)


def test_level_sets():
    """Area of a sphere, length of a circle, and the part of a plane within a box."""
    low, high = np.full(3, -1.0), np.array([1.0, 1.2, 1.1])

    def ball(x):
        return np.linalg.norm(x, axis=-1) - 0.8

    a, b, c = np.moveaxis(level_sets.surface(ball, low, high), 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert area == pytest.approx(4 * np.pi * 0.8**2, rel=5e-3)
    for normal in (1, 2):
        rectangle = [low.copy(), high.copy()]
        rectangle[0][normal] = rectangle[1][normal] = 0.0
        ends = level_sets.lines(ball, *rectangle, normal)
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum()
        assert length == pytest.approx(2 * np.pi * 0.8, rel=1e-3)
    flat = level_sets.surface(lambda x: x[..., 2] - 0.013, low, high)
    assert np.allclose(flat[..., 2], 0.013) and np.allclose(np.ptp(flat, axis=(0, 1))[:2], (2, 2.2))
    assert len(level_sets.surface(lambda x: 1 + 0 * x[..., 0], low, high)) == 0


def test_rigid_motion():
    points = np.random.default_rng(2).uniform(0, 1, (6, 3))
    turn, shift = rigid_motion(points, points @ TURN.T + [1, 2, 3])
    assert np.allclose(turn, TURN) and np.allclose(shift, [1, 2, 3])
    turn, shift = rigid_motion(points[:1], points[:1] + np.arange(1, 4))
    assert np.allclose(turn, np.eye(3)) and np.allclose(shift, [1, 2, 3])


def with_obstacles(folder, *told):
    """A run of a cube that is pressed flat, whose summary tells of obstacles."""
    run = write_run(folder)
    about = {"kinematics": {"type": "ThreeD"}, "regions": {"low": 1, "high": 2},
             "path": [{"what": "voltage"}], "supports": [{"type": "Clamp"}, *told]}  # fmt: skip
    (run / "summary.json").write_text(json.dumps({"settings": about}))
    return run


def obstacle(shape, **more):
    return {"type": "Obstacle", "where": "top", "shape": vars(shape) | {
        "type": type(shape).__name__}} | more  # fmt: skip


def test_where_obstacles_are(tmp_path):
    """A ramp moves one, a region that is displaced carries another one, a third is no body."""
    plane = dea.Plane((0, 0, -0.2 * H), (0, 0, 1))
    run = with_obstacles(
        tmp_path / "run",
        obstacle(plane, displacement=[0, 0, -2 * H], ramp="press"),
        obstacle(dea.Sphere((H, H, 3 * H), H), carried_by="high"),
        obstacle(dea.Plane((0, 0, 0), (0, 0, 1), between=True)),
        {"type": "Obstacle", "where": "top", "shape": "<function gap>"},
        obstacle(plane, carried_by="no such part"),
    )
    columns = (run / "history.csv").read_text().splitlines()
    press = ("press_factor", 0, 0.25, 1)
    rows = [f"{row},{factor}" for row, factor in zip(columns, press, strict=True)]
    (run / "history.csv").write_text("\n".join(rows) + "\n")
    still, moved = (obstacles_of(run, step) for step in (0, 2))
    assert len(still) == len(moved) == 2
    bottom = np.array([0.1 * H, 0, -0.2 * H])
    assert [one[0].gap(bottom) for one in (still, moved)] == pytest.approx([0, 2 * H])
    middle = moved[0].warped(0.5).gap(bottom)
    assert middle == pytest.approx(H)
    # the mean of the region's nodes moves by this; its strain is no rigid motion
    x = np.array([2 * H, 1.5 * H, 1.5 * H])
    assert moved[1].displacements(x[None])[0] == pytest.approx(x * [0.05, 0.05, -0.1], abs=0.02 * H)
    told, nets, around = nets_of(run, [0, 2], np.array([[0, 0, 0], [4 * H, 3 * H, 2 * H]]), False)
    assert [len(motions) for _, motions in told] == [2, 2] and all(len(net) for net in nets)
    assert around[0, 2] == pytest.approx(-2.2 * H) and np.allclose(nets[0][:, 2], -0.2 * H)


@pytest.mark.parametrize("kind", ["space", "damaged"])
def test_pictures_show_obstacles(tmp_path, kind):
    pytest.importorskip("matplotlib")
    told = [obstacle(dea.Plane((0, 0, -0.1 * H), (0, 0, 1)))]
    if kind == "damaged":
        told = [{"type": "Obstacle", "where": 3, "shape": shape} for shape in (
            None, {"type": "Plane", "point": "a", "normal": [0, 0, 1]},
            {"type": "Sphere", "centre": [0, 0, 0], "radius": "nan"},
            {"type": "Cylinder", "point": [0, 0, 0], "axis": [0, 0, 0], "radius": 1})]  # fmt: skip
    run = with_obstacles(tmp_path / "run", *told)
    body = DrawnBody(run, "displacement_m", 2, AXES)
    assert len(body.obstacles) == (kind == "space")
    if kind == "space":
        (triangles,) = body.shells(1.0)
        assert np.allclose(triangles[..., 2], -0.1 * H)
        assert body.seen(1.0)[1][:, 2].min() == pytest.approx(-0.1 * H)
        from matplotlib.image import imread

        image = imread(dea.pictures.deformed(run, "displacement_m"))[..., :3]
        right = image[:, image.shape[1] // 2 :]  # the section, with the body behind it in blue
        assert (np.abs(right - np.array([0xC6, 0xD8, 0xE8]) / 255).max(axis=-1) < 0.02).any()


@pytest.mark.skipif(importlib.util.find_spec("plotly") is None, reason="plotly is not installed")
def test_reports_show_obstacles(tmp_path):
    pytest.importorskip("pyvista")
    run = with_obstacles(tmp_path / "run", obstacle(dea.Sphere((H, H, 2.2 * H), 0.2 * H)))
    text = dea.pictures.report(run).read_text("utf-8")
    assert '"obstacles": [["top", [[1.0, 0.0, 0.0, 0.0, 1.0' in text and "obstacle/0" in text
