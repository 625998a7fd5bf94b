"""Air: contact, attraction and capacitance where they are hard, and what must be refused."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.exact import disc_capacitance
from dea_fenicsx.geometry import DiscCapacitor, Layer
from dea_fenicsx.materials import EPSILON_0

from hard.table import (  # isort: skip
    FAILED, LOST, MU, REFUSED, RUBBER, T, case, close, lost, strip,
)  # fmt: skip

KAPPA = 5 * MU
FOAM = dea.Material(RUBBER, bulk_modulus=KAPPA)
WALLS = [dea.Fix("bottom", "y"), dea.Fix("x_min", "x"), dea.Fix("x_max", "x")]
PLANE = dea.PlaneStrain()


def blocks(gap, air, end, electrodes=(), supports=WALLS, upper=True):
    """A block, air of a share `gap` of its height, and another block, pressed to a height `end`."""
    layers = [Layer("lower", T), Layer("gap", gap * T, 2)] + [Layer("upper", T)] * upper
    regions = {"lower": FOAM, "gap": air} | ({"upper": FOAM} if upper else {})
    height = 2 + gap if upper else 1 + gap
    return dea.Scene(
        strip(layers=layers, size=0.2 * T, order=1), regions, electrodes=electrodes,
        supports=supports,
        prescribed=[dea.Stretch("top", "y", end / height)], kinematics=PLANE,
    )  # fmt: skip


def stress(stretch):
    """Nominal stress between walls."""
    return MU * 2 / 3 * (stretch ** (1 / 3) - stretch ** (-5 / 3)) + KAPPA * (stretch - 1)


@case("air, a gap closed and the blocks pressed to a half")
def pressed():
    run = dea.solve(
        blocks(0.1, dea.Air(), 1.0), dea.Ramp(steps=3), {"force": dea.Reaction("top", "y")},
        quiet=True,
    )  # fmt: skip
    return close(run["force_N"] / (0.2 * T), stress(0.5), 1e-3, "stress")


@case("air, a gap closed and opened again")
def opened():
    path = [dea.Ramp("stretch", to, steps=3) for to in (1.0, 0.0)]
    run = dea.solve(
        blocks(0.1, dea.Air(), 1.9), path, {"all": dea.Energy("elastic")}, quiet=True
    )
    return f"energy left {run['all_J']:.1e} J" if run["all_J"] < 1e-15 else run["all_J"] / 0


@case("air a million times stiffer than usual")
def stiff():
    run = dea.solve(
        blocks(0.1, dea.Air(stiffness=1e-5), 1.9), dea.Ramp(steps=3),
        {"force": dea.Reaction("top", "y")}, quiet=True,
    )  # fmt: skip
    left = (1e-5 * MU / 2 / -stress(0.95)) ** (1 / 3)
    return close(run["force_N"] / (0.2 * T), stress(0.95), 2 * left, "stress")


@case("air, a film that nothing else holds", REFUSED, "can move freely")
def floating():
    # the upper block touches air and its walls alone
    dea.solve(
        dea.Scene(
            strip(layers=[Layer("lower", T), Layer("gap", T), Layer("upper", T)]),
            {"lower": FOAM, "gap": dea.Air(), "upper": FOAM}, supports=[dea.Clamp("bottom")],
            loads=[dea.DeadLoad("top", (0.0, -1.0))], kinematics=PLANE,
        ),
        dea.Ramp(), quiet=True,
    )  # fmt: skip


@case("air, bare electrodes pressed together", FAILED, "short circuit")
def short():
    bare = [dea.Electrode("interface_1", 1e-3, ramp="stretch"), dea.Ground("interface_2")]
    dea.solve(blocks(0.1, dea.Air(), 1.9, bare), dea.Ramp(steps=3), quiet=True)


@case("air without electrodes and solids", REFUSED, "nothing to solve")
def nothing():
    dea.Scene(strip(), {"film": dea.Air()}, kinematics=PLANE)


@case("air, bare plates to pull-in", LOST, "limit point")
def plates():
    def volts(l):
        return T * (0.2 - (l - 1)) * np.sqrt(2 * stress(l) / EPSILON_0)

    limit = max(volts(l) for l in np.linspace(1.001, 1.19, 20001))
    scene = dea.Scene(
        strip(layers=[Layer("block", T), Layer("gap", 0.2 * T, 2)], size=0.1 * T, order=1),
        {"block": FOAM, "gap": dea.Air()},
        electrodes=[dea.Electrode("interface_1", 2 * limit), dea.Ground("top")],
        supports=[*WALLS, dea.Clamp("top")], kinematics=PLANE,
    )  # fmt: skip
    lost(scene, dea.Ramp("voltage", steps=4), limit, 0.02, {})


@case("discs in air at a fiftieth of their radius")
def near_discs():
    return discs(0.02)


@case("discs in air at ten times their radius")
def far_discs():
    return discs(10.0)


def discs(distance):
    # The error of the walls grows with the square of the discs' dipole.
    box = 20 * max(1.0, distance / 2) ** (2 / 3)
    device = dea.read_gmsh(DiscCapacitor(T, distance * T, box * T), MPI.COMM_SELF)
    scene = dea.Scene(
        device, {"air": dea.Air()}, kinematics=dea.Axisymmetric(),
        electrodes=[dea.Ground("lower_disc"), dea.ChargedElectrode("upper_disc", 1e-12)],
    )  # fmt: skip
    run = dea.solve(
        scene, dea.Ramp(steps=1), {"phi": dea.Potential("upper_disc")}, quiet=True
    )
    found = 1e-12 / run["phi_V"] / EPSILON_0 / T
    return close(found, disc_capacitance(distance), 5e-3, "capacitance")
