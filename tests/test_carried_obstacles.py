"""Obstacles that a rigid part carries: balance of forces, energy, and what is refused."""

from __future__ import annotations

import pytest
from conftest import block
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer

MU, L = 5e4, 1e-3
RUBBER = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(3.0))
TIGHT = dea.NewtonOptions(tolerance=1e-12)
EXACT = {"quiet": True, "options": TIGHT}
FINGER = dea.Cylinder((1.0 * L, 1.5 * L), None, 0.48 * L)


def arm(moved, turns="", **more):
    """A strip that is clamped at its left end; its rigid right end carries a finger."""
    device = dea.read_gmsh(
        BoxStack(3 * L, None, [Layer("film", L, divisions=1)], (6,)), MPI.COMM_SELF
    )
    given = dict(shape=FINGER, carried_by="x_max") | more
    return dea.Scene(
        device, {"film": RUBBER}, kinematics=dea.PlaneStrain(1e-2), prescribed=moved,
        supports=[
            dea.Clamp("x_min"), dea.Rigid("x_max", turns=turns), dea.Obstacle("top", **given),
        ],
    )  # fmt: skip


ARM = {
    "f": dea.ContactForce("top", "y"), "ry": dea.Reaction("x_min", "y"),
    "py": dea.PartForce("x_max", "y"), "m": dea.PartMoment("x_max"),
    "e": dea.Energy("elastic"), "c": dea.Energy("contact"),
}  # fmt: skip


def test_forces_within_the_device_balance():
    """The finger presses, yet the clamp and the guide of the part bear equal forces alone."""
    down = [dea.Displacement("x_max", "y", -0.2 * L, ramp="move")]
    last = dea.solve(arm(down), dea.Ramp("move", steps=3), ARM, **EXACT).history[-1]
    assert last["f_N"] < -0.01
    assert last["ry_N"] == pytest.approx(-last["py_N"], rel=1e-9)


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_finger_turns_with_its_part(friction):
    """The moment on the part is the derivative of the energy by its angle, without friction."""
    turned = [dea.Turn("x_max", 0.2, ramp="move")]
    at = [0.8, 0.999, 1.0]
    scene = arm(turned, "z", friction=friction)
    row = dea.solve(scene, dea.Ramp("move", at=at, steps=3), ARM, **EXACT).history
    assert row[-1]["f_N"] < 0
    assert row[-1]["ry_N"] == pytest.approx(-row[-1]["py_N"], abs=1e-9 * abs(row[-1]["f_N"]))
    near = [r for r in row if r["move_factor"] in (0.999, 1.0)]
    change = sum(near[1][name] - near[0][name] for name in ("e_J", "c_J"))
    work = (near[0]["m_N_m"] + near[1]["m_N_m"]) / 2 * 0.2 * 0.001
    if friction:
        assert change < work
    else:
        assert change == pytest.approx(work, rel=1e-6)


def test_in_space():
    """A lid carries a plate below the block, which follows it: the same as a lid that stays."""
    found = []
    for carried in (None, "top"):
        scene = dea.Scene(
            block((1, 1, 1)), {"film": RUBBER},
            prescribed=[dea.Displacement("top", "z", 0.2 * L, ramp="move")],
            supports=[
                dea.Rigid("top", turns=""), dea.Fix("x_min", "x"), dea.Fix("y_min", "y"),
                dea.Obstacle(
                    "bottom", dea.Plane((0, 0, 0), (0, 0, 1)), displacement=(0, 0, 0.3 * L),
                    ramp="press", carried_by=carried,
                ),
            ],
        )  # fmt: skip
        path = dea.Ramp(("press",) if carried is None else ("press", "move"), steps=2)
        run = dea.solve(scene, path, {"f": dea.ContactForce("bottom", "z")}, **EXACT)
        found.append(run.history[-1]["f_N"])
    assert found[0] > 0
    assert found[1] == pytest.approx(found[0], rel=1e-9)


@pytest.mark.parametrize("given, words", [
    (dict(carried_by="x_maxx"), "which is no rigid part"),
    (dict(carried_by="top"), "which is no rigid part"),
])  # fmt: skip
def test_what_is_refused(given, words):
    with pytest.raises(dea.InputError, match=words):
        arm([], **given)


def test_a_part_that_turns_about_all_axes_carries_nothing():
    with pytest.raises(dea.InputError, match="turns about several axes"):
        dea.Scene(
            block((1, 1, 1)), {"film": RUBBER},
            supports=[
                dea.Rigid("top"), dea.Clamp("bottom"),
                dea.Obstacle("x_max", dea.Plane((2 * L, 0, 0), (-1, 0, 0)), carried_by="top"),
            ],
        )  # fmt: skip
