"""Marches in time of homogeneous films, against ordinary differential equations."""

from __future__ import annotations

import math
import os
import signal
import tempfile

import numpy as np
from mpi4py import MPI
from scipy.optimize import brentq

import dea_fenicsx as dea
from dea_fenicsx.exact import Dead, Film, Held, instantaneous, march, relaxed, trace
from dea_fenicsx.geometry import BoxStack, Layer
from hard.films import run
from hard.table import (
    EPS_R,
    LOST,
    MU,
    ROUND,
    RUBBER,
    UNIT,
    T,
    Z,
    case,
    close,
    strip,
)

DIELECTRIC = dea.IdealDielectric(EPS_R)
ONE, THREE = ((1.5 * MU, 1.0),), ((1.7 * MU, 0.3), (1.7 * MU, 3.0), (0.7 * MU, 30.0))
BOTH = (dea.Fix("x_min", "r"), dea.Fix("bottom", "z"))


def material(branches=ONE, bulk=None, elastic=RUBBER):
    return dea.Material(elastic, DIELECTRIC, bulk, viscous=[dea.Maxwell(*b) for b in branches])


def scene(of, volts=UNIT, load=0.0, device=None, **changes):
    """A disc of film, which stays homogeneous, under a voltage and a radial dead load."""
    device = device or strip()
    settings = dict(
        electrodes=[dea.Electrode("top", volts), dea.Ground("bottom")], supports=BOTH,
        loads=[dea.DeadLoad("x_max", (load, 0.0))] if load else (), kinematics=ROUND,
    )  # fmt: skip
    return dea.Scene(device, dict.fromkeys(device.regions, of), **(settings | changes))


def ends(time):
    """Rows of a history that are the last ones at their time: those after a jump."""
    return np.append(np.diff(time) > 0, True)


def follows(done, course, rel, since=0.0):
    """Thickness stretches of all steps from a time on are the exact ones."""
    time, z = done.column("time_s"), done.column("z")
    kept = ends(time) & (time >= since) & (time > 0)
    kept &= np.array([not event for event in done.column("event")])
    due = course.at(np.minimum(time[kept] - since, course.end_time)).stretches[2]
    return close(z[kept], due, rel, f"stretch in {len(time)} steps")


def against_exact(branches, wave, seconds, rel=1e-5, bulk=None, of=None, device=None, changes=None,
                  **options):  # fmt: skip
    """A march of the voltage against the exact film; `wave` is made for a unit of voltage."""
    of = of or material(branches, bulk)
    done = run(scene(of, device=device, **(changes or {})),
               dea.March(seconds, {"voltage": wave(1.0)}, **options))  # fmt: skip
    return follows(done, march(Film(of, T), seconds, voltage=wave(UNIT)), rel)


# ------------------------------------------------------------------------- relaxation times


@case("march: steps of a million relaxation times")
def long_steps():
    """The branch adds 3 G tau times a rate of strain to the stress: nothing that shows."""
    of = material(((1.5 * MU, 1e-5),))
    done = run(scene(of), dea.March(100.0, {"voltage": dea.Rise(0.6, 100.0)}, steps=10))
    states = trace(Film(material(()), T))
    due = [states.states_at(0.6 * UNIT * k / 10)[0][0].stretches[2] for k in range(1, 11)]
    return close(done.column("z")[1:], due, 1e-6, "stretch")


@case("march: a relaxation time that is infinite")
def never():
    """A spring that stays: the instantaneous film at each voltage."""
    return against_exact(((1.5 * MU, math.inf),), lambda u: dea.Rise(0.9 * u, 10.0), 10.0, 1e-9)


@case("march: three decades of relaxation times")
def decades():
    branches = tuple((MU / 2, tau) for tau in (0.01, 0.1, 1.0, 10.0))
    return against_exact(branches, lambda u: dea.Rise(0.6 * u, 5.0), 20.0, tolerance=1e-6)


@case("march: a branch 1000 times stiffer than the equilibrium")
def stiff():
    branches = ((1000 * MU, 5.0),)
    return against_exact(branches, lambda u: dea.Rise(u, 10.0), 10.0, tolerance=1e-6)


@case("march: a branch a millionth of the equilibrium")
def weak():
    branches = ((1e-6 * MU, 5.0),)
    return against_exact(branches, lambda u: dea.Rise(0.6 * u, 10.0), 10.0, tolerance=1e-6)


# ----------------------------------------------------------------------------------- drives


@case("march: a square wave, which jumps")
def square():
    return against_exact(ONE, lambda u: dea.Square(0.5, 0.3 * u, 0.3 * u), 5.0, tolerance=1e-6)


@case("march: a triangle through 0 to the other polarity")
def polarity():
    """At each corner the second derivative of C_v jumps, which adds an error to that of steps."""
    wave = lambda u: dea.Triangle(0.5, 0.6 * u)  # noqa: E731
    return against_exact(ONE, wave, 5.0, 5e-5, tolerance=1e-6)


@case("march: a table with a jump, and rows close together")
def rows():
    times, values = (0, 1, 1, 1 + 1e-9, 3, 3.001, 6), np.array([0, 0.5, 0.1, 0.1, 0.5, 0.0, 0.4])
    return against_exact(ONE, lambda u: dea.Table(times, values * u), 6.0, tolerance=1e-6)


@case("march: a chirp over two decades")
def chirp():
    return against_exact(ONE, lambda u: dea.Chirp(0.05, 5.0, 4.0, 0.2 * u, 0.3 * u), 4.0, 1e-4)


@case("march: a function whose slope jumps between two steps")
def function():
    def wave(u):
        return dea.Function(lambda t: 0.5 * u * min(t, 1 / 3), at=(1 / 3,))

    return against_exact(ONE, wave, 2.0, tolerance=1e-6)


# ------------------------------------------------------------------- kinematics and materials


@case("march: plane strain")
def plane():
    changes = dict(kinematics=dea.PlaneStrain(), supports=[dea.Fix("x_min", "x"),
                                                           dea.Fix("bottom", "y")])  # fmt: skip
    of = material()
    path = dea.March(4.0, {"voltage": dea.Rise(0.5, 4.0)}, tolerance=1e-6)
    done = run(scene(of, **changes), path, {"z": dea.MeanStretch(("bottom", "top"), "y")})
    film = Film(of, T, second=Held(1.0))
    return follows(done, march(film, 4.0, voltage=dea.Rise(0.5 * UNIT, 4.0)), 1e-5)


@case("march: a ring")
def ring():
    geometry = BoxStack(T, None, [Layer("film", T)], divisions=(2,), x0=T / 2)
    return against_exact(ONE, lambda u: dea.Rise(0.6 * u, 4.0), 4.0, tolerance=1e-6,
                         device=dea.read_gmsh(geometry, MPI.COMM_SELF),
                         changes=dict(supports=[dea.Fix("bottom", "z")]))  # fmt: skip


@case("march: a compressible film")
def compressible():
    return against_exact(ONE, lambda u: dea.Rise(0.5 * u, 4.0), 4.0, bulk=3 * MU, tolerance=1e-6)


@case("march: a free body in space")
def free():
    geometry = BoxStack(T, T, [Layer("film", T)], divisions=(1, 1))
    of = material()
    settings = dict(kinematics=dea.ThreeD(), supports=[dea.FreeBody()])
    done = run(scene(of, device=dea.read_gmsh(geometry, MPI.COMM_SELF), **settings),
               dea.March(2.0, {"voltage": dea.Rise(0.6, 2.0)}, tolerance=1e-5))  # fmt: skip
    return follows(done, march(Film(of, T), 2.0, voltage=dea.Rise(0.6 * UNIT, 2.0)), 3e-5)


@case("march: chains that creep towards their lock-up")
def lock_up():
    """Gent's equilibrium alone would carry the load at 94 % of its longest stretch."""
    gent, load = dea.Gent(MU, 6.0), 6 * MU
    of = dea.Material(gent, DIELECTRIC, viscous=[dea.Maxwell(20 * MU, 1.0)])
    done = run(scene(of, load=load, volts=0.0),
               [dea.Ramp("load", steps=4, response="instantaneous"),
                dea.March(60.0, tolerance=1e-6)])  # fmt: skip
    return follows(done, march(Film(of, T, Dead(load), Dead(load)), 60.0), 5e-5)


@case("march: layers with three branches, one and none, at a held stretch")
def layers():
    """They share their stretch, so that the forces of three exact films add up."""
    names, held = ("three", "one", "none"), 1.5
    made = dict(zip(names, map(material, (THREE, ONE, ())), strict=True))
    device = strip(layers=[Layer(name, T) for name in names])
    of = dea.Scene(device, made, supports=BOTH, kinematics=ROUND,
                   prescribed=[dea.Stretch("x_max", "r", held)])  # fmt: skip
    path = [dea.Ramp("stretch", steps=2, response="instantaneous"),
            dea.March(5.0, tolerance=1e-6)]  # fmt: skip
    done = run(of, path, {"force": dea.Reaction("x_max", "r")})
    time = done.column("time_s")[2:]
    sides = (Held(held), Held(held))
    stress = sum(march(Film(m, T, *sides), 5.0).at(time).stress[0] for m in made.values())
    force = np.abs(done.column("force_N")[2:])
    ratio = force / stress
    return close(ratio, 2 * math.pi * T * T, 3e-5, "force over stress")


# ------------------------------------------------------------------------- loss of equilibrium


def lost_at(of, path, due, rel, volts=UNIT, column="time_s", **changes):
    """A path that ends at a pull-in in time, as `due` says."""
    try:
        run(scene(of, volts, **changes), path)
    except dea.EquilibriumLost as error:
        close(error.run[column], due, rel, column)
        raise
    raise AssertionError(f"passed the pull-in at {due:.6g}")


@case("march: pull-in within the first step", LOST, "in time")
def first_step():
    """One step for the whole march; a fixed step to a limit point is 1/256 of it or less."""
    of, wave = material(((1.5 * MU, 100.0),)), dea.Rise(3.0, 1e-2)
    due = march(Film(of, T), 1e-2, voltage=dea.Rise(3 * UNIT, 1e-2)).pull_in_time
    lost_at(of, dea.March(1e-2, {"voltage": wave}, steps=1), due, 1e-5)


@case("march: pull-in within a jump", LOST, "0 s")
def in_a_jump():
    """A ramp in one step, which ends within 1/1024 of its length of the limit."""
    of = material()
    due = trace(instantaneous(Film(of, T))).event("pull-in").voltage
    lost_at(of, dea.March(1.0, {"voltage": 3.0}), due, 3 / 1.5 / 1024 * 2, column="voltage_V")


@case("march: creep to pull-in", LOST, "in time")
def creep():
    of = material(THREE)
    due = march(Film(of, T), 1000.0, voltage=0.8 * UNIT).pull_in_time
    lost_at(of, dea.March(1000.0, {"voltage": 0.8}, tolerance=1e-5), due, 1e-3)


@case("march: creep to pull-in in steps of backward Euler", LOST, "in time")
def creep_euler():
    of = material()
    due = march(Film(of, T), 1000.0, voltage=0.8 * UNIT).pull_in_time
    lost_at(of, dea.March(2 * due, {"voltage": 0.8}, steps=400, order=1), due, 3e-2)


# --------------------------------------------------------------------------- paths and resuming


@case("march: steps of backward Euler against the same recurrence")
def euler():
    """One scalar equation a step, with c the in-plane component of C_v."""
    (modulus, tau), e, dt = ONE[0], 0.6, 0.25
    done = run(scene(material()), dea.March(10 * dt, {"voltage": e}, steps=10, order=1))
    c, due = 1.0, []

    def flown(lam, old, share):
        return ((old + share * lam**2) / (old**-2 + share * lam**-4)) ** (1 / 3)

    def miss(lam, old, share):
        new = flown(lam, old, share)
        spring = modulus / MU * (lam**2 / new - new**2 * lam**-4)
        return lam**2 - lam**-4 + spring - e**2 * lam**4

    for share in [0.0] + 10 * [dt / tau]:
        lam = brentq(miss, 1.0, 1.2, args=(c, share), xtol=1e-15, rtol=1e-14)
        c = flown(lam, c, share)
        due.append(lam**-2)
    time = done.column("time_s")
    return close(done.column("z")[ends(time)], due, 1e-9, "stretch")


@case("march: without branches it is a ramp")
def elastic():
    return against_exact((), lambda u: dea.Triangle(0.5, 0.3 * u, 0.3 * u), 3.0, 1e-9)


@case("march: at rest, for ever")
def rest():
    done = run(scene(material(), load=0.5 * MU), dea.March(1e6), Z)
    return close(done.column("z"), 1.0, 1e-12, "stretch")


@case("march: a relaxed ramp after a march")
def relaxed_ramp():
    of = material(THREE)
    path = [dea.March(1.0, {"voltage": dea.Rise(0.5, 1.0)}),
            dea.Ramp("voltage", 0.6, steps=2, response="relaxed")]  # fmt: skip
    due = trace(relaxed(Film(of, T))).states_at(0.6 * UNIT)[0][0].stretches[2]
    return close(run(scene(of), path)["z"], due, 1e-8, "stretch")


@case("march: a relaxed ramp with a branch that never relaxes")
def relaxed_spring():
    """A branch of infinite relaxation time stays a spring in a relaxed response, too."""
    of = material(((1.5 * MU, math.inf), (MU, 1.0)))
    path = [dea.March(1.0, {"voltage": dea.Rise(0.5, 1.0)}),
            dea.Ramp("voltage", 0.6, steps=2, response="relaxed")]  # fmt: skip
    spring = Film(material(((1.5 * MU, math.inf),)), T)
    due = trace(instantaneous(spring)).states_at(0.6 * UNIT)[0][0].stretches[2]
    return close(run(scene(of), path)["z"], due, 1e-8, "stretch")


@case("march: ramps, marches and a trace in one path")
def mixed():
    """The trace meets the pull-in of the film whose viscous strains are those of 2 s of load."""
    of, load = material(THREE), 0.5 * MU
    path = [dea.Ramp("load", steps=2, response="instantaneous"),
            dea.March(2.0, {"voltage": dea.Rise(0.3, 2.0)}, tolerance=1e-6),
            dea.Trace("voltage", until=("z", 0.4), response="instantaneous")]  # fmt: skip
    done = run(scene(of, load=load), path)
    top = next(row for row in done.history if row["event"] == "maximum")
    film = Film(of, T, Dead(load), Dead(load))
    first = march(film, 2.0, voltage=dea.Rise(0.3 * UNIT, 2.0))
    due = march(film, 1.0, voltage=dea.Step(2 * UNIT, at=0.0, low=0.3 * UNIT), start=first).pull_in
    return close(top["voltage_V"], due.voltage, 1e-5, "pull-in voltage")


@case("march: relaxed before, then creep")
def rested():
    of, load = material(THREE), 0.5 * MU
    path = [dea.Ramp("load", steps=2, response="relaxed"),
            dea.March(5.0, {"voltage": 0.3}, tolerance=1e-6)]  # fmt: skip
    done = run(scene(of, load=load), path)
    film = Film(of, T, Dead(load), Dead(load))
    return follows(done, march(film, 5.0, voltage=0.3 * UNIT, start="relaxed"), 1e-5)


STOPS = [False]
"""Whether an observable stops the run."""


class Stopping(dea.MeanStretch):
    """A stretch that stops the run after 2.5 s, as Ctrl-C does."""

    def bind(self, problem):
        inner = super().bind(problem)

        def value():
            if STOPS[0] and problem.state.time > 2.5:
                os.kill(os.getpid(), signal.SIGINT)
            return inner()

        return value


@case("march: resumed in its midst")
def resumed():
    """Stopped by a signal, with its history in the checkpoint."""
    path = [dea.March(5.0, {"voltage": dea.Rise(0.6, 5.0)}, steps=40)]
    whole = run(scene(material()), path)

    with tempfile.TemporaryDirectory() as out:
        try:
            STOPS[0] = True
            run(scene(material()), path, {"z": Stopping(("bottom", "top"), "z")}, out=out)
            raise AssertionError("the signal was not heard")
        except dea.Interrupted as stopped:
            assert 19 <= len(stopped.run.history) <= 24, "stopped elsewhere"
        finally:
            STOPS[0] = False
        done = run(scene(material()), path, {"z": Stopping(("bottom", "top"), "z")}, out=out,
                   resume=True)  # fmt: skip
    assert len(done.history) == len(whole.history), "other steps"
    return close(done.column("z"), whole.column("z"), 1e-10, "stretch")

