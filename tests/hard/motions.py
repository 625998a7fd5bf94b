"""Bodies in motion: free flight and spin, collapse, and steps and numbers that are far too large.

All is dimensionless: mu, rho and eps are 1.
"""

from __future__ import annotations

import numpy as np
from motion_scenes import CLAMPED, at_rest, rubber, sphere, strip

import dea_fenicsx as dea
from hard.table import FAILED, REFUSED, case, close

SCHEMES = ALPHA, CONSERVING = "generalised-alpha", "energy-conserving"
RADIUS = {"a": dea.AtPoint((1.0, 0.0), "displacement", "r")}
PULL_IN = 0.13709731


def moved(scene, seconds, steps, record, drive=None, **inertia):
    march = dea.March(seconds, drive or {}, steps=steps, inertia=dea.Inertia(**inertia))
    return dea.solve(scene, march, record, quiet=True, stability="never")


def ball(volts, **changes):
    return sphere(volts, cells=(1, 1), **changes)


@case("motion: free flight over a thousand sizes of the body")
def flight():
    record = {"x": dea.MeanDisplacement("x_max", "x"), "p": dea.Momentum("x")}
    scene = strip(cells=(2, 1), length=4.0)
    done = moved(scene, 10.0, 10, record, velocity=(400.0, -1.0))
    close(done.column("p_Ns")[1:], 1600.0, 1e-9, "momentum")
    return close(done["x_m"], 4000.0, 1e-9, "place")


@case("motion: ten turns of a rigid spin keep the angular momentum")
def spin():
    rate = 0.05

    def turn(x):
        return np.stack([-rate * (x[1] - 0.5), rate * (x[0] - 0.5)])

    scene = strip(cells=(1, 1), length=1.0)
    record = {"L": dea.AngularMomentum(), "K": dea.KineticEnergy(), "W": dea.Energy("elastic")}
    done = moved(scene, 20 * np.pi / rate, 300, record, velocity=turn, scheme=CONSERVING)
    close(done.column("K_J")[1:] + done.column("W_J")[1:], rate**2 / 12, 1e-5, "energy")
    return close(done.column("L_Nms")[1:], rate / 6, 1e-9, "angular momentum")


@case("motion: a body a million times heavier than the film on its end")
def heavy():
    """It swings by the stiffness k of the film: sqrt(k/m)."""
    small, record = 1e-6, {"x": dea.PartDisplacement("x_max", "x")}

    def told(loads=(), **attached):
        end = dea.Rigid("x_max", held="y", turns="", **attached)
        return strip(supports=[CLAMPED[0], end], cells=(2, 1), length=4.0, loads=loads)

    pulled = told([dea.Force("x_max", (small, 0.0))])
    k = small / dea.solve(pulled, dea.Ramp(steps=1), record, quiet=True)["x_m"]
    found = dea.modes(at_rest(told(kilograms=4e6)), 1).frequencies[0]
    return close(found, np.sqrt(k / 4e6) / (2 * np.pi), 1e-5, "frequency")


def collapse(**march):
    """The ball is pulled thin ever faster, and nothing stops it."""
    moved(ball(10 * PULL_IN), 5.0, march.pop("steps", None), RADIUS, {"voltage": 1.0}, **march)


case("motion: a voltage step ten times pull-in", FAILED, "a collapse")(collapse)


@case("motion: a voltage step ten times pull-in, in fixed steps", FAILED, "a collapse")
def fixed_collapse():
    collapse(steps=50)


@case("motion: a voltage step ten times pull-in, conserving energy", FAILED, "a collapse")
def conserving_collapse():
    collapse(steps=50, scheme=CONSERVING)


@case("motion: time steps a thousand times too long")
def long_steps():
    """What they cannot follow is damped, and the ball is where the static ramp leads."""
    done = moved(ball(0.05), 2e4, 10, RADIUS, {"voltage": 1.0}, spectral_radius=0.0)
    static = dea.solve(ball(0.05), dea.Ramp(steps=1), RADIUS, quiet=True)
    return close(done["a_m"], static["a_m"], 1e-6, "radius")


@case("motion: time steps a thousand times too long, conserving energy")
def long_conserving_steps():
    record = {"K": dea.KineticEnergy(), "W": dea.Energy("elastic"), "E": dea.Energy("electric")}
    done = moved(ball(0.05), 2e4, 10, record, {"voltage": 1.0}, scheme=CONSERVING)
    sums = (done.column("K_J") + done.column("W_J") - done.column("E_J"))[2:]
    return close(sums, sums[0], 1e-7, "energy")


@case("motion: a drag a million times critical")
def drag():
    """It creeps by f/(d M): from rest the ball hardly moves in a second."""
    done = moved(ball(0.05), 1.0, None, RADIUS, {"voltage": 1.0}, drag=1e6)
    assert 0 < done["a_m"] < 1e-6, f"moved by {done['a_m']:.3g}"
    return f"moved by {done['a_m']:.1g}"


@case("motion: a region without density", REFUSED, "'wall' has no density")
def no_density():
    moved(ball(0.05, density=None), 1.0, None, RADIUS, {"voltage": 1.0})


@case("motion: a negative drag", REFUSED, "must be at least 0")
def negative_drag():
    moved(ball(0.05), 1.0, None, RADIUS, {"voltage": 1.0}, drag=-1.0)


@case("motion: an initial velocity that is not finite", REFUSED, "one finite number in m/s")
def no_velocity():
    moved(ball(0.05), 1.0, None, RADIUS, velocity=(float("inf"), 0.0))


@case("motion: a support that jumps", REFUSED, "prescribed displacement jump")
def jump():
    scene = strip(supports=CLAMPED[:1], cells=(2, 1),
                  prescribed=[dea.Displacement("x_max", "x", 0.1)])  # fmt: skip
    moved(scene, 1.0, 2, {}, {"stretch": 1.0})


@case("motion: conserving energy beside viscous branches", REFUSED, "viscous branches")
def viscous():
    film = {"film": rubber((dea.Maxwell(1.0, 1.0),))}
    moved(strip(supports=CLAMPED, materials=film), 1.0, 2, {}, scheme=CONSERVING)


@case("motion: more modes than unknowns", REFUSED, "modes are wanted")
def many_modes():
    dea.modes(at_rest(strip(supports=CLAMPED, cells=(1, 1), length=1.0)), 500)


@case("motion: modes of a strip beyond its buckling voltage")
def growing():
    """The straight strip is no stable state: a motion grows, and is told first."""
    scene = strip(1.0, CLAMPED, cells=(8, 1))
    path = dea.Ramp("voltage", 0.6, steps=4)
    modes = dea.modes(dea.solve(scene, path, quiet=True), 2)
    assert modes.growing >= 1 and modes.growth_rates[0] > 0, "no growing motion is told"
    return f"{modes.growing} motions grow"
