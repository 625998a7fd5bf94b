"""A thick balloon whose pressure and voltage are switched on together: how far it swings.

The wall is neo-Hookean, at rest until t = 0, and no other load acts.  The elements are axisymmetric
and stand beside the exact equation of the sphere.  The same loads also have an equilibrium, about
which the balloon breathes; lower modes of other shapes are told apart by their shape.  Everything
is dimensionless: shear modulus mu = 1 (in Pa), density, permittivity and inner radius 1.
"""

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.exact import Balloon
from dea_fenicsx.geometry import HollowSphere
from dea_fenicsx.materials import EPSILON_0

BEYOND = 1.1
"""End of the march, in units of the time at which the exact radius is largest."""

ROUND = 1e-2
"""Largest difference of the displacements of pole and equator, over themselves, in breathing."""


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/balloon_motion")
    parser.number("--pressure", 0.05, "-", "inner pressure in units of mu, mu in Pa")
    parser.number("--voltage", 0.0, "-", "voltage in units of A sqrt(mu/eps)")
    parser.number("--outer", 1.2, "-", "outer radius over inner radius")
    parser.count("--steps", 400, "steps of time")
    parser.count("--radial", 4, "cells through the wall")
    parser.count("--around", 14, "cells over a right angle")
    return parser, parser.parse_args()


def scene(args):
    """A quarter of the section; both loads have a ramp of their own."""
    sphere = HollowSphere(1.0, args.outer, layers=args.radial, cells=args.around)
    wall = dea.Material(dea.NeoHookean(1.0), dea.IdealDielectric(1 / EPSILON_0), density=1.0)
    return dea.Scene(
        dea.device(sphere, MPI.COMM_WORLD),
        {"wall": wall},
        electrodes=[dea.Electrode("inner", args.voltage), dea.Ground("outer")],
        supports=[dea.Fix("axis", "r"), dea.Fix("equator", "z")],
        loads=[dea.FollowerPressure("inner", args.pressure)],
        kinematics=dea.Axisymmetric(),
    )


EQUATOR = dea.AtPoint((1.0, 0.0), "displacement", "r")
POLE = dea.AtPoint((0.0, 1.0), "displacement", "z")


def largest(run):
    """The largest radius and its time, by the quartic through five steps; None if at an end."""
    t, a = run.column("time_s")[1:], 1 + run.column("radius_m")[1:]
    k = int(np.argmax(a))
    if not 2 <= k <= len(a) - 3:
        return None, None
    quartic = np.polyfit((t[k - 2 : k + 3] - t[k]) / (t[k] - t[k - 1]), a[k - 2 : k + 3], 4)
    turns = np.roots(np.polyder(quartic))
    x = min((r.real for r in turns if abs(r.imag) < 1e-9), key=abs)
    return float(np.polyval(quartic, x)), float(t[k] + x * (t[k] - t[k - 1]))


def equilibrium(args, made):
    """Radius and breathing frequency in equilibrium at the same loads; None if there is none."""
    ramps = [dea.Ramp(name, steps=4) for name in made.ramps]
    if not ramps:
        ramps = [dea.March(1.0, steps=1)]
    try:
        run = dea.solve(made, ramps, {"radius": EQUATOR}, quiet=True)
    except dea.EquilibriumLost:
        return None, None
    modes = dea.modes(run, 8)
    for k in range(8):
        pole, equator = modes.derivative(POLE, k), modes.derivative(EQUATOR, k)
        if abs(pole - equator) < ROUND * abs(pole):
            break
    else:
        return 1 + run["radius_m"], None
    omega = 2 * np.pi * modes.frequencies[k]
    return 1 + run["radius_m"], None if np.isnan(omega) else float(omega)


def main():
    parser, args = parse()
    exact = Balloon(1.0, args.outer, 1.0, 1.0, 1.0)
    peak = exact.largest(args.pressure, args.voltage)
    if peak is None or not peak[1]:
        seconds = np.pi / exact.breathing(1.0)
    else:
        seconds = BEYOND * peak[1]
    made = scene(args)
    march = dea.March(seconds, dict.fromkeys(made.ramps, 1.0), steps=args.steps, inertia=True)
    run = dea.solve(made, march, {"radius": EQUATOR}, out=args.out, resume=args.resume,
                    quiet=args.quiet, settings=parser.settings(args))  # fmt: skip
    radius, time = largest(run)
    rests, omega = equilibrium(args, made)
    at = exact.equilibrium(args.pressure, args.voltage)
    run.add(
        largest_radius=radius,
        time_of_largest=time,
        equilibrium_radius=rests,
        breathing_omega=omega,
        exact_largest_radius=peak[0] if peak else None,
        exact_time_of_largest=peak[1] if peak else None,
        exact_equilibrium_radius=at,
        exact_breathing_omega=exact.breathing(at, args.voltage) if at else None,
    )
    if MPI.COMM_WORLD.rank == 0:
        dea.pictures.curve(args.out, x="time_s", y="radius_m")
        if not args.quiet:
            print()
            for key in ("largest_radius", "time_of_largest", "equilibrium_radius",
                        "breathing_omega"):  # fmt: skip
                found, known = run.summary[key], run.summary[f"exact_{key}"]
                print(f"{key:20} {told(found)}   exact {told(known)}")
            print(f"\nresults: {run.out}/history.csv, fields.xdmf")


def told(value):
    return "none      " if value is None else f"{value:.8f}"


if __name__ == "__main__":
    main()
