"""Bodies that repeat: periodic faces under large strains, at limit points, thin, and held badly."""

from __future__ import annotations

import dea_fenicsx as dea
from hard.films import run
from hard.table import (
    EPS,
    EPS_R,
    LOST,
    MU,
    REFUSED,
    RUBBER,
    UNIT,
    T,
    case,
    close,
    lost,
    strip,
)

SIDES, ENDS = ("x_min", "x_max"), ("bottom", "top")
DIELECTRIC = dea.Material(RUBBER, dea.IdealDielectric(EPS_R))


def repeating(device=None, volts=0.0, supports=(), free=None, **changes):
    """One period of a film in plane strain."""
    device = device or strip((2, 1))
    settings = dict(
        electrodes=[dea.Electrode("top", volts), dea.Ground("bottom")],
        supports=[dea.Periodic(*SIDES, free=free), *(supports or [dea.FreeBody()])],
        kinematics=dea.PlaneStrain(T),
    )  # fmt: skip
    return dea.Scene(device, dict.fromkeys(device.regions, DIELECTRIC), **(settings | changes))


@case("periodic: a mean strain of 4 in one go")
def far():
    """Pure shear: P = mu (lam - lam^-3)."""
    scene = repeating(prescribed=[dea.MeanStrain(SIDES, "x", 4.0)])
    done = run(scene, dea.Ramp("stretch", steps=1), {"f": dea.PeriodicForce(SIDES, "x")})
    return close(done["f_N"], MU * (5 - 5**-3) * T**2, 1e-9, "force")


@case("periodic: voltage beyond pull-in", LOST)
def beyond():
    """In plane strain (V/H)^2 eps/mu = 1 - lam^-4, which tends to 1 and never reaches it."""
    lost(repeating(volts=1.2 * UNIT), dea.Ramp(steps=4), UNIT, 0.05, {})


@case("periodic: a film 1 : 1000 thin")
def thin():
    """(V/H)^2 eps/mu = 1 - lam^-4."""
    device = strip((4, 1), size=T, thickness=T / 1000)
    volts = 0.8 * UNIT / 1000
    done = run(repeating(device, volts), dea.Ramp(steps=3), {"x": dea.MeanStretch(SIDES, "x")})
    lam = (1 - EPS / MU * (volts * 1000 / T) ** 2) ** -0.25
    return close(done["x"], lam, 1e-8, "stretch")


@case("periodic: faces that are meshed otherwise", REFUSED, "mesh both alike")
def otherwise():
    device = strip((2, 2))
    x = device.mesh.geometry.x
    x[:, 1] += 0.1 * x[:, 0] * x[:, 1] * (1 - x[:, 1])
    run(repeating(device, 0.1 * UNIT), dea.Ramp(steps=1))


@case("periodic: stretched where no volume can go", REFUSED, "its volume")
def full():
    scene = repeating(
        supports=[dea.Periodic(*ENDS, free=""), dea.FreeBody()], electrodes=(),
        prescribed=[dea.MeanStrain(SIDES, "x", 0.1)],
    )  # fmt: skip
    run(scene, dea.Ramp(steps=1))


@case("periodic: both faces held, and free to strain", REFUSED, "at both ends")
def both():
    held = [dea.Fix(face, "x") for face in SIDES]
    run(repeating(volts=0.1 * UNIT, supports=[*held, dea.Fix("bottom", "y")]), dea.Ramp(steps=1))


@case("periodic: a bonded film, whose strain is held by its base")
def bonded():
    """Nothing can move: the field is V/H, and the mean force that of its pressure.

    With mu and no strain the total stress across is 0, so that along it is -eps (V/H)^2.
    """
    volts = 0.5 * UNIT
    scene = repeating(volts=volts, free="", supports=[dea.Clamp("bottom")])
    done = run(scene, dea.Ramp(steps=1), {"f": dea.PeriodicForce(SIDES, "x"),
                                          "u": dea.LargestDisplacement("top", "y")})  # fmt: skip
    assert abs(done["u_m"]) < 1e-9 * T, "it moves"
    return close(done["f_N"], -EPS * (volts / T) ** 2 * T**2, 1e-8, "force")
