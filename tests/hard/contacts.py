"""Obstacles and friction: hard starts, steps and coefficients, and what must be refused."""

from __future__ import annotations

import dea_fenicsx as dea

from hard.table import (  # isort: skip
    MU, REFUSED, RUBBER, T, TIGHT, case, close, strip,
)  # fmt: skip

PLANE = dea.PlaneStrain(1.0)
FLOOR = dea.Plane((0.0, 0.0), (0.0, 1.0))
RUB = 0.2
MODULUS = MU * 0.8 ** (-2 / 3)
"""Shear modulus in Pa of the layer that is pressed to 0.8 of its height between walls."""


def dented(depth=0.0, down=0.0, radius=2.8 * T, **more):
    """A bonded layer under a cylinder, which starts some way in it and moves down."""
    shape = dea.Cylinder((2 * T, T + radius - depth), None, radius)
    return dea.Scene(
        strip((8, 2), 4 * T, T), {"film": dea.Material(RUBBER)}, kinematics=PLANE,
        supports=[
            dea.Clamp("bottom"), dea.Fix("x_min", "x"), dea.Fix("x_max", "x"),
            dea.Obstacle("top", shape, displacement=(0.0, -down), **more),
        ],
    )  # fmt: skip


FORCE = {"f": dea.ContactForce("top", "y")}


def dent(path=None, **given):
    path = path or dea.Ramp("obstacle", steps=3)
    return dea.solve(dented(**given), path, FORCE, quiet=True, options=TIGHT).history


@case("obstacle: a tenth of the layer deep in it at the start")
def penetrated():
    closed = dent(down=0.1 * T)[-1]["f_N"]
    return close(dent(depth=0.1 * T, down=1e-9 * T)[0]["f_N"], closed, 1e-8, "force")


@case("obstacle: its middle in the device", REFUSED, "lies inside the device")
def inside():
    dent(depth=0.5 * T, down=T, radius=0.1 * T)


@case("obstacle: all of the way in one step")
def one_step():
    few, many = (
        dent(down=0.2 * T, path=dea.Ramp("obstacle", steps=steps))[-1]["f_N"] for steps in (1, 12)
    )
    return close(few, many, 1e-8, "force")


@case("obstacle: closed, opened and closed ten times")
def again():
    path = [dea.Ramp("obstacle", to=float(k % 2 == 0), steps=1) for k in range(20)]
    rows = [row for row in dent(down=0.2 * T, path=path) if row["obstacle_factor"] in (0.0, 1.0)]
    assert all(row["f_N"] == 0 for row in rows if row["obstacle_factor"] == 0), "a force is left"
    forces = [row["f_N"] for row in rows if row["obstacle_factor"] == 1]
    return close(forces[-1], forces[0], 1e-9, "force")


@case("obstacle: a tolerance below rounding", REFUSED, "rounding allows no less")
def tiny_tolerance():
    dent(down=0.1 * T, tolerance=1e-15)


@case("obstacle: carried by what is no rigid part", REFUSED, "is no rigid part")
def not_carried():
    dent(down=0.1 * T, carried_by="bottom")


def rubbed(path, rub=RUB, shear=0.5):
    """A layer between walls of its own kind, pressed on a floor and sheared along it."""
    scene = dea.Scene(
        strip((2, 2), 2 * T, T), {"film": dea.Material(RUBBER, bulk_modulus=4 * MU)},
        kinematics=PLANE,
        prescribed=[
            dea.Displacement("top", "y", -0.2 * T, ramp="press"),
            dea.Displacement("top", "x", shear * T, ramp="shear"),
        ],
        supports=[
            dea.Periodic("x_min", "x_max", free=""), dea.Obstacle("bottom", FLOOR, friction=rub),
        ],
    )  # fmt: skip
    record = {
        "n": dea.ContactForce("bottom", "y"), "t": dea.Reaction("top", "x"),
        "u": dea.MeanDisplacement("bottom", "x"), "w": dea.FrictionWork("bottom"),
    }  # fmt: skip
    path = [dea.Ramp("press", steps=1), *path]
    return dea.solve(scene, path, record, quiet=True, options=TIGHT).history[-1]


@case("friction: a coefficient of 1000, which bonds")
def bonded():
    last = rubbed([dea.Ramp("shear", steps=2)], rub=1000.0)
    return close(last["t_N"], MODULUS * 0.5 * 2 * T, 1e-9, "force")


@case("friction: a coefficient of 1e-9")
def slippery():
    last = rubbed([dea.Ramp("shear", steps=2)], rub=1e-9)
    return close(last["t_N"], 1e-9 * last["n_N"], 1e-4, "force")


@case("friction: slid fifty thicknesses in one step")
def far():
    last = rubbed([dea.Ramp("shear", steps=1)], shear=50.0)
    close(last["t_N"], RUB * last["n_N"], 1e-8, "force")
    return close(last["w_J"], last["t_N"] * last["u_m"], 1e-8, "heat")


@case("friction: to and fro three times")
def cycles():
    path = [dea.Ramp("shear", to=to, steps=3) for to in (1.0, *(-1.0, 1.0) * 3)]
    last = rubbed(path)
    # Each way back and forth slips by the way of the top less twice the shear that friction bears.
    borne = last["t_N"] / (MODULUS * 2)
    slipped = (0.5 * T - borne) + 6 * (T - 2 * borne)
    return close(last["w_J"], RUB * last["n_N"] * slipped, 1e-8, "heat")


@case("friction: a negative coefficient", REFUSED, "a coefficient of 0 or more")
def negative():
    rubbed([], rub=-0.1)


@case("friction: counted work without friction", REFUSED, "has no friction")
def no_friction():
    rubbed([], rub=0.0)
