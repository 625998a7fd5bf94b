"""Scenes of membranes, dimensionless: modulus 1, permittivity that of vacuum times eps."""

from __future__ import annotations

import math

from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import Meridian
from dea_fenicsx.support.compat import dolfinx

EPS, EPS0, MU = 4.0, 8.8541878128e-12, 5e4
RUBBER = dea.Material(
    dea.NeoHookean(MU), electric=dea.IdealDielectric(EPS, breakdown=1e9), density=1e3
)
LENGTH, WIDTH, THICKNESS = 0.1, 0.05, 1e-3


def volts(e, thickness):
    """The voltage of a nominal field e in units of sqrt(mu/eps)."""
    return e * thickness * math.sqrt(MU / (EPS * EPS0))


def sheet(comm=MPI.COMM_SELF, divisions=(3, 2), length=LENGTH, width=WIDTH):
    mesh = dolfinx.mesh.create_rectangle(
        comm, [(0.0, 0.0), (length, width)], divisions, dolfinx.mesh.CellType.quadrilateral,
        ghost_mode=dolfinx.mesh.GhostMode.shared_facet,
    )  # fmt: skip
    sides = {
        "left": dea.OnPlane("x", 0.0), "right": dea.OnPlane("x", length),
        "bottom": dea.OnPlane("y", 0.0), "top": dea.OnPlane("y", width),
    }  # fmt: skip
    return dea.from_dolfinx(mesh, regions="film", surfaces=sides)


def film(comm=MPI.COMM_SELF, e=0.0, kinematics=None, **changes):
    """A flat film on two planes of symmetry."""
    given = dict(
        device=sheet(comm), materials={"film": RUBBER},
        electrodes=[dea.Electrode("film", volts(e, THICKNESS))],
        supports=[dea.Fix("left", "x"), dea.Fix("bottom", "y")],
        kinematics=kinematics or dea.Membrane(THICKNESS),
    )  # fmt: skip
    return dea.Scene(**(given | changes))


STRETCHES = {
    "x": dea.MeanStretch(("left", "right"), "x"), "y": dea.MeanStretch(("bottom", "top"), "y"),
    "z": dea.OverRegion("stretch", axis="z"), "Q": dea.Charge("film"),
}  # fmt: skip


def cone(lp, q, e=0.0, cells=20, comm=MPI.COMM_SELF):
    """The cone of radii 0.3 and 1 m: its deflection before and under voltage, in m."""
    before, stretched = 1e-3, 1e-3 / lp**2
    device = dea.device(Meridian((0.3 * lp, 0.0), (lp, 0.0), cells=cells), comm)
    force = q * 2 * math.pi * before * MU
    scene = dea.Scene(
        device, {"film": RUBBER}, electrodes=[dea.Electrode("film", volts(e, before))],
        supports=[dea.Clamp("end"), dea.Fix("start", "r")],
        prescribed=[dea.PreStretch("film", r=lp)],
        loads=[dea.DeadLoad("start", (0.0, force / (2 * math.pi * 0.3 * lp * stretched)))],
        kinematics=dea.AxisymmetricMembrane(stretched),
    )  # fmt: skip
    path = [dea.Ramp(["prestretch"], steps=1), dea.Ramp(["load"], steps=4)]
    path += [dea.Ramp(["voltage"], steps=2)] if e else []
    z = {"z": dea.MeanDisplacement("start", "z")}
    run = dea.solve(scene, path, z, quiet=True)
    return run, run.history["z_m"]


def balloon_pressure(a, e, thickness, radius):
    """The pressure of a thin neo-Hookean sphere at a stretch a, in Pa."""
    return 2 * (1 / a - a**-7 - e**2 * a) * MU * thickness / radius


def balloon(device, supports, kinematics, inside, e=0.3, a=1.2, steps=4, **record):
    """A balloon of radius 10 mm and thickness 0.1 mm under pressure and voltage."""
    pressure = balloon_pressure(a, e, kinematics.thickness, 1e-2)
    scene = dea.Scene(
        device, {"film": RUBBER},
        electrodes=[dea.Electrode("film", volts(e, kinematics.thickness))], supports=supports,
        loads=[dea.MembranePressure("film", pressure, inside)], kinematics=kinematics,
    )  # fmt: skip
    wanted = {"Q": dea.Charge("film"), "t": dea.OverRegion("stretch", "mean"), **record}
    return dea.solve(scene, dea.Ramp(["load", "voltage"], steps=steps), wanted, quiet=True)


def round_balloon(comm=MPI.COMM_SELF, cells=16, **options):
    """Half a section of it."""
    arc = Meridian((0.0, 1e-2), (1e-2, 0.0), (0.0, 0.0), cells=cells)
    return balloon(
        dea.device(arc, comm), [dea.Fix("start", "r"), dea.Fix("end", "z")],
        dea.AxisymmetricMembrane(1e-4), (0.0, 0.0), **options,
        radius=dea.MeanDisplacement("end", "r"),
        pole=dea.AtPoint((0.0, 1e-2), "displacement", "z"),
    )  # fmt: skip


def on_all_ranks(comm):
    """What the test of ranks compares: a balloon of two cells, and a film."""
    thin = round_balloon(comm, cells=2, a=1.02, steps=1)
    run = dea.solve(film(comm, 0.3), dea.Ramp(steps=1), STRETCHES, quiet=True)
    return {"balloon": float(thin["radius_m"]), "x": float(run["x"]), "Q": float(run["Q_C"])}
