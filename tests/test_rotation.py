"""Rotation of a face: rigid motions are exact; a bent bar turns as its curvature says."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import block

import dea_fenicsx as dea
from dea_fenicsx.measure.rotation import BendingAngle, Rotation
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.support.errors import InputError


@pytest.fixture(scope="module")
def problem():
    film = dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(4.7))
    scene = dea.Scene(block((1, 1, 1)), {"film": film}, supports=[dea.FreeBody()])
    return Problem(scene)


def turn(axis, angle):
    """Rotation matrix by Rodrigues' formula."""
    n = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    K = np.cross(np.eye(3), n)
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def move(problem, motion):
    """Set the displacement from a function of the undeformed points, shape (n, 3)."""
    for a, part in enumerate(problem.displacement):
        x = part.space.tabulate_dof_coordinates()
        problem.w.x.array[part.dofs] = (motion(x) - x)[:, a]


@pytest.mark.parametrize("angle", [1e-9, 0.3, 2.5, np.pi])
def test_rigid_rotation_is_exact(problem, angle):
    axis = np.array([1.0, -2.0, 0.5]) / np.linalg.norm([1.0, -2.0, 0.5])
    R = turn(axis, angle)
    move(problem, lambda x: x @ R.T + [0.1, 0.2, -0.3])
    for k, name in enumerate("xyz"):
        found = Rotation("top", name).bind(problem)()
        # half a turn may be counted either way
        same = abs(found) if angle == np.pi else found
        want = abs(angle * axis[k]) if angle == np.pi else angle * axis[k]
        assert same == pytest.approx(want, rel=1e-6, abs=1e-13)
        assert Rotation(("bottom", "top"), name).bind(problem)() == pytest.approx(0, abs=1e-13)
    assert BendingAngle(("bottom", "top")).bind(problem)() == pytest.approx(0, abs=1e-13)
    tilt = np.arccos(np.clip(R[2, 2], -1, 1)) if angle > 1e-3 else angle * np.hypot(*axis[:2])
    assert BendingAngle("top").bind(problem)() == pytest.approx(tilt, rel=1e-6)


def test_faces_of_a_bent_and_twisted_bar(problem):
    """The top turns by 0.4 about y and 0.2 about z against the bottom; both faces stay flat."""
    R = turn((0, 1, 0), 0.4) @ turn((0, 0, 1), 0.2)
    move(problem, lambda x: np.where(x[:, 2:] > 0.5 * x[:, 2].max(), x @ R.T, x))
    assert BendingAngle(("bottom", "top")).bind(problem)() == pytest.approx(0.4, rel=1e-12)
    vector = [Rotation(("bottom", "top"), a).bind(problem)() for a in "xyz"]
    assert np.linalg.norm(vector) == pytest.approx(np.arccos((np.trace(R) - 1) / 2), rel=1e-12)


def test_refuses(problem):
    with pytest.raises(InputError, match="must be one of x, y, z"):
        Rotation("top", "r").bind(problem)
    with pytest.raises(InputError, match="facet group"):
        BendingAngle(("bottom", "tip")).bind(problem)
    flat = dea.Scene(
        block((1, 1)),
        {"film": dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(4.7))},
        supports=[dea.Fix("bottom", "z")],
        kinematics=dea.Axisymmetric(),
    )
    with pytest.raises(InputError, match="in plane strain only"):
        Rotation("top", "z").bind(Problem(flat))
