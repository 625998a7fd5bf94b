"""Cavities that leak, collapse, or are not closed: a hollow sphere has a closed form."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from scipy.optimize import brentq

import dea_fenicsx as dea
from dea_fenicsx.geometry import HollowSphere, MembraneDisc
from dea_fenicsx.materials import EPSILON_0

from hard.table import LOST, REFUSED, case, close  # isort: skip

MU, A, B = 50e3, 1e-2, 1.2
RUBBER = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(3.0))
REST = 2 / 3 * np.pi * A**3
RECORD = {"P": dea.CavityPressure("inner"), "cavity": dea.CavityVolume("inner")}
UNIT = A * np.sqrt(MU / (3 * EPSILON_0))


def pressure(a, volts=0.0):
    """Pressure over mu at the inner radius a, of A = 1."""
    b = (a**3 + B**3 - 1) ** (1 / 3)
    g = lambda x: -2 / x - 1 / (2 * x**4)  # noqa: E731
    return g(a) - g(b / B) - volts**2 / 2 * (a**-4 - b**-4) / (1 / a - 1 / b) ** 2


def balloon(supports=None, **given):
    device = dea.read_gmsh(HollowSphere(A, B * A, "half", 2, 8), MPI.COMM_SELF)
    held = [dea.Fix("axis", "r"), dea.Fix("equator", "z")]
    return dea.Scene(
        device, {"wall": RUBBER}, [dea.Electrode("inner", UNIT), dea.Ground("outer")],
        supports=supports or held, loads=[dea.Cavity("inner", ramp="fill", **given)],
        kinematics=dea.Axisymmetric(),
    )  # fmt: skip


def run(scene, *path, **options):
    return dea.solve(scene, list(path), RECORD, quiet=True, **options)


def radius(done):
    return (done["cavity_m3"] / done.column("cavity_m3")[0]) ** (1 / 3)


@case("cavity: gas that leaks to zero")
def leaks():
    gas = pressure(1.3) * 1.3**3 * REST * MU
    done = run(balloon(gas=gas, outside=0.0), dea.Ramp("fill", 1, 3), dea.Ramp("fill", 0, 4))
    assert abs(done["P_Pa"]) < 1e-6 * MU
    return close(radius(done), 1.0, 1e-9, "inner radius")


@case("cavity: a vacuum inside")
def vacuum():
    p0 = 0.1 * MU
    done = run(balloon(gas=-p0 * REST, outside=p0), dea.Ramp("fill", steps=4))
    exact = brentq(lambda a: pressure(a) + 0.1, 0.5, 1.0)
    close(done["P_Pa"], -p0, 1e-4, "pressure")
    return close(radius(done), exact, 1e-4, "inner radius")


@case("cavity: more gas let out than there is", REFUSED, "more gas than the")
def beyond_vacuum():
    run(balloon(gas=1e-3), dea.Ramp("fill", to=-1e3))


@case("cavity: all gas in one step")
def one_step():
    gas = (2.0 + pressure(2.0)) * 8 * REST * MU - 2.0 * REST * MU
    done = run(balloon(gas=gas, outside=2.0 * MU), dea.Ramp("fill", steps=1))
    return close(radius(done), 2.0, 1e-4, "inner radius")


@case("cavity: outside pressure of a million moduli")
def stiff_gas():
    p0 = 1e6
    gas = ((p0 + pressure(1.2)) * 1.2**3 - p0) * REST * MU
    done = run(balloon(gas=gas, outside=p0 * MU), dea.Ramp("fill", steps=4),
               dea.Ramp("voltage", 0.05, 2))  # fmt: skip
    return close(radius(done), 1.2, 1e-5, "inner radius")


@case("cavity: pressure beyond its limit point", LOST)
def over_pressure():
    run(balloon(pressure=0.6 * MU), dea.Ramp("fill", steps=4))


@case("cavity: liquid let out")
def drained():
    done = run(balloon(liquid=-0.1 * REST), dea.Ramp("fill", steps=1))
    a = 0.9 ** (1 / 3)
    return close(done["P_Pa"] / MU, pressure(a), 1e-4, "pressure")


@case("cavity: an open rim", REFUSED, "not closed: one of its edges is open, such as the point")
def open_rim():
    balloon([dea.Fix("axis", "r"), dea.FreeBody()], liquid=1e-7)


@case("cavity: liquid between walls that cannot move", REFUSED, "cannot move")
def rigid_walls():
    disc = dea.read_gmsh(MembraneDisc(12e-3, 4e-3, 1e-3, cells=(1, 1, 1)), MPI.COMM_SELF)
    scene = dea.Scene(
        disc, dict.fromkeys(disc.regions, RUBBER), loads=[dea.Cavity("bottom", liquid=1e-9)],
        supports=[dea.Clamp("rim"), dea.Clamp("bottom"), dea.Fix("axis", "r")],
        kinematics=dea.Axisymmetric(),
    )  # fmt: skip
    dea.solve(scene, dea.Ramp(), quiet=True)
