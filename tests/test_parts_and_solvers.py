"""Each part of a mechanism with each way of solving: kept factor, symmetry, inertia, arc length.

The page of the guide about mechanisms has the same table.
"""

from __future__ import annotations

import numpy as np
import pytest
from conftest import block, on_demand
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, HollowSphere, Layer
from dea_fenicsx.model.problem import Problem

pytestmark = pytest.mark.usefixtures("quick_compile")

MU, H, DEPTH, LIGHT = 5e4, 1e-3, 2e-3, 1e-3
FILM = dea.Material(dea.NeoHookean(MU), density=LIGHT)
HELD = dea.Fix("x_min", "x"), dea.Fix("bottom", "y")


def plane(supports, loads=(), device=None, materials=None):
    return dea.Scene(
        device or block((2, 2)), materials or {"film": FILM}, supports=[*supports],
        loads=[*loads], kinematics=dea.PlaneStrain(DEPTH),
    )  # fmt: skip


def pressed(friction):
    """A block under a cylinder that comes down beside its middle."""
    cylinder = dea.Cylinder((0.8 * H, 2 * H), None, 0.95 * H)
    return plane([dea.Clamp("bottom"), dea.Obstacle(
        "top", cylinder, displacement=(0, -0.12 * H), friction=friction, tolerance=H, ramp="load",
    )])  # fmt: skip


def under_air():
    stack = BoxStack(H, None, [Layer("film", H), Layer("gap", H)], divisions=(2,))
    sides = [dea.Clamp("bottom"), dea.Fix("top", "y"), dea.Fix("top", "x")]
    device = dea.read_gmsh(stack, MPI.COMM_SELF)
    return plane(sides, [dea.DeadLoad("interface_1", (0.0, 5e3))], device,
                 {"film": FILM, "gap": dea.Air(density=LIGHT)})  # fmt: skip


def balloon():
    a = 1e-2
    return dea.Scene(
        dea.read_gmsh(HollowSphere(a, 1.2 * a, "half", 1, 3), MPI.COMM_SELF), {"wall": FILM},
        supports=[dea.Fix("axis", "r"), dea.Fix("equator", "z")],
        loads=[dea.Cavity("inner", gas=0.02, ramp="load")], kinematics=dea.Axisymmetric(),
    )  # fmt: skip


RIGID = *HELD, dea.Rigid("x_max", turns="")
PULL = [dea.Force("x_max", (0.02, 0.0))]
SIDES = dea.Periodic("x_min", "x_max")
DOWN = [dea.BodyForce("film", (0.0, -1e7))]
PARTS = {
    "rigid part": (lambda: plane(RIGID, PULL), dea.MeanDisplacement("x_max", "x")),
    "spring": (lambda: plane([*RIGID, dea.Spring("x_max", 30.0, "x")], PULL),
               dea.MeanDisplacement("x_max", "x")),
    "body force": (lambda: plane([dea.Clamp("bottom")], DOWN), dea.MeanDisplacement("top", "y")),
    "periodic": (lambda: plane([dea.Fix("bottom", "y"), dea.Fix("x_min", "x"), SIDES],
                               [dea.DeadLoad("top", (0.0, 1e4))]),
                 dea.MeanDisplacement("top", "y")),
    "cavity": (balloon, dea.CavityPressure("inner")),
    "air": (under_air, dea.MeanDisplacement("interface_1", "y")),
    "obstacle": (lambda: pressed(0.0), dea.ContactForce("top", "y")),
    "friction": (lambda: pressed(0.3), dea.ContactForce("top", "x")),
}  # fmt: skip


@pytest.mark.parametrize(
    "part", [p if p == "air" else pytest.param(p, marks=on_demand) for p in PARTS]
)
def test_a_part_with_each_way_of_solving(part):
    """A ramp, the same without a kept factor, an arc, and a slow motion end in one state."""
    build, observable = PARTS[part]
    scene, record = build(), {"value": observable}
    symmetric = Problem(scene).forms.is_symmetric
    assert symmetric is (part != "friction")

    def end(path, **options):
        run = dea.solve(scene, path, record, quiet=True, **options)
        return run, run.column(f"value_{observable.unit}")

    run, values = end(dea.Ramp("load", steps=4))
    assert bool(np.isnan(run["inertia"])) is (not symmetric)
    wanted = values[-1]
    assert abs(wanted) > 0
    anew = end(dea.Ramp("load", steps=4), options=dea.NewtonOptions(keep_factor=False))[1][-1]
    assert anew == pytest.approx(wanted, rel=1e-7)
    # A state with friction depends on its path, and so a little on the steps along it.
    near = 0.05 if part == "friction" else 1e-4
    trace = dea.Trace("load", first=0.25, steps=60, until=("load_factor", 1.0))
    traced, values = end(trace)
    assert traced.column("load_factor")[-1] == pytest.approx(1.0, abs=1e-6)
    assert values[-1] == pytest.approx(wanted, rel=near)
    slow = dea.March(1.0, {"load": lambda t: t}, steps=8, inertia=dea.Inertia())
    moved, values = end(slow)
    assert moved.column("time_s")[-1] == pytest.approx(1.0)
    assert np.all(np.isfinite(values))
    assert values[-1] == pytest.approx(wanted, rel=near)
