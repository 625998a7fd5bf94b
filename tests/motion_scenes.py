"""Small devices that vibrate and move, dimensionless: mu, rho and eps are 1."""

from __future__ import annotations

from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, HollowSphere, Layer
from dea_fenicsx.materials import EPSILON_0


def rubber(viscous=(), **changes):
    """A neo-Hookean dielectric, unless changes say otherwise."""
    given = {
        "elastic": dea.NeoHookean(1.0), "electric": dea.IdealDielectric(1 / EPSILON_0),
        "density": 1.0, "viscous": viscous,
    }  # fmt: skip
    return dea.Material(**(given | changes))


def sphere(volts=0.0, pressure=0.0, part="half", cells=(2, 6), comm=MPI.COMM_SELF, **material):
    """A thick sphere of radii 1 and 1.2, by symmetry or as a free body."""
    device = dea.read_gmsh(HollowSphere(1.0, 1.2, part, *cells), comm)
    supports = {
        "half": [dea.Fix("axis", "r"), dea.Fix("equator", "z")],
        "whole": [dea.Fix("axis", "r"), dea.FreeBody()],
        "octant": [dea.Fix(f"{axis}_min", axis) for axis in "xyz"],
    }
    return dea.Scene(
        device,
        {"wall": rubber(**material)},
        electrodes=[dea.Electrode("inner", volts), dea.Ground("outer")],
        supports=supports[part],
        loads=[dea.FollowerPressure("inner", pressure)] if pressure else [],
        kinematics=dea.ThreeD() if part == "octant" else dea.Axisymmetric(),
    )


def strip(volts=0.0, supports=(), cells=(8, 1), length=10.0, comm=MPI.COMM_SELF, **changes):
    """A strip of unit thickness in plane strain; a free body unless supports are given."""
    mesh = BoxStack(length, None, [Layer("film", 1.0, divisions=cells[1])], divisions=cells[:1])
    given = {
        "materials": {"film": rubber()},
        "electrodes": [dea.Electrode("top", volts), dea.Ground("bottom")] if volts else [],
        "supports": list(supports) or [dea.FreeBody()],
        "kinematics": dea.PlaneStrain(),
    }
    return dea.Scene(dea.read_gmsh(mesh, comm), **(given | changes))


CLAMPED = (dea.Clamp("x_min"), dea.Clamp("x_max"))


def at_rest(scene, **options):
    """A run that stays in the undeformed state."""
    return dea.solve(scene, dea.March(1.0, steps=1), quiet=True, **options)
