"""Cone: a pre-stretched ring of film between a rigid disc and a rigid ring, under a force.

The film is stretched, glued to a ring and to a disc in its middle, which a force pulls out of the
plane; then a voltage moves the disc farther.  All inputs have no dimension: lengths are those of
the undeformed film over its outer radius B, the force is q = F/(2 pi mu H B), the field is
e = (V/H) sqrt(eps/mu).  The deflection is told beside that of a membrane without thickness.
"""

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.exact import Cone
from dea_fenicsx.geometry import BoxStack, DiskStack, Layer, Meridian
from dea_fenicsx.materials import EPSILON_0

INNER, B = 0.3, 10e-3  # radius of the disc over that of the ring; radius of the ring in m


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/cone")
    parser.number("--mu", 50e3, "Pa", "shear modulus")
    parser.number("--prestretch", 1.5, "-", "stretch of the film before it is glued")
    parser.number("--force", 0.5, "-", "F/(2 pi mu H B)")
    parser.number("--field", 0.1, "-", "(V/H) sqrt(eps/mu), of the undeformed thickness")
    parser.number("--thickness", 0.01, "-", "H/B of the undeformed film")
    parser.count("--cells", 32, "cells along the radius")
    parser.add_argument("--solid", action="store_true", help="three dimensions, not a section")
    parser.add_argument("--membrane", action="store_true", help="a membrane: a line, no solid")
    parser.add_argument("--trace", action="store_true", help="follow the voltage over its maximum")
    parser.number("--until", 2.2, "-", "deflection at which the trace ends, over that at 0 V")
    args = parser.parse_args()
    if args.solid and args.membrane:
        raise dea.InputError("--solid and --membrane exclude each other; give one of them.")
    return parser, args


def cone(args, thickness):
    """The scene: factor 1 of its ramps is the pre-stretch, the force and the field."""
    lp, H = args.prestretch, thickness * B
    film = [Layer("film", H / lp**2, divisions=1 if args.solid else 2)]
    if args.membrane:
        shape = Meridian((lp * INNER * B, 0.0), (lp * B, 0.0), cells=args.cells)
    elif args.solid:
        shape = DiskStack(lp * B, film, inner_radius=lp * INNER * B, angular=16,
                          radial=args.cells, grading=8.0)  # fmt: skip
    else:
        shape = BoxStack(lp * (1 - INNER) * B, None, film, args.cells, grading=8.0,
                         x0=lp * INNER * B)  # fmt: skip
    disc, ring = ("inner", "side") if args.solid else ("x_min", "x_max")
    kinematics = dea.ThreeD() if args.solid else dea.Axisymmetric()
    if args.membrane:
        disc, ring, kinematics = "start", "end", dea.AxisymmetricMembrane(H / lp**2)
    volts = args.field * H * np.sqrt(args.mu / (3.0 * EPSILON_0))
    force = 2 * np.pi * args.force * args.mu * H * B
    scene = dea.Scene(
        dea.device(shape, MPI.COMM_WORLD),
        {"film": dea.Material(dea.NeoHookean(args.mu), dea.IdealDielectric(3.0))},
        electrodes=electrodes(args, volts),
        supports=[dea.Clamp(ring), dea.Rigid(disc)],
        prescribed=[dea.PreStretch("film", x=lp, y=lp) if args.solid
                    else dea.PreStretch("film", r=lp)],
        loads=[dea.Force(disc, (0, 0, force) if args.solid else (0, force))],
        kinematics=kinematics,
    )  # fmt: skip
    return scene, disc


def electrodes(args, volts):
    """On both faces of a solid; a membrane itself bears the voltage through its thickness."""
    if not volts:
        return []
    if args.membrane:
        return [dea.Electrode("film", volts)]
    return [dea.Electrode("top", volts), dea.Ground("bottom")]


def deflection(args, thickness, **options):
    """The run that pre-stretches, pulls and charges the film."""
    scene, disc = cone(args, thickness)
    path = [dea.Ramp("prestretch", steps=2), dea.Ramp("load", steps=4)]
    if args.field:
        start = Cone(args.prestretch, args.force, 0.0, INNER).deflection() * B
        path.append(dea.Trace("voltage", first=0.2, until=("deflection_m", args.until * start))
                    if args.trace else dea.Ramp("voltage", steps=2))  # fmt: skip
    record = {"deflection": dea.PartDisplacement(disc, "z")}
    return dea.solve(scene, path, record, **options)


def main():
    parser, args = parse()
    run = deflection(args, args.thickness, out=args.out, resume=args.resume, quiet=args.quiet,
                     settings=parser.settings(args))  # fmt: skip
    try:
        thin = Cone(args.prestretch, args.force, args.field, INNER).deflection()
    except dea.InputError:  # no membrane is in equilibrium there
        thin = None
    tops = [row for row in run.history if row["event"] == "maximum"]
    unit = args.thickness * B * np.sqrt(args.mu / (3.0 * EPSILON_0))  # V at the field 1
    run.add(
        deflection=None if args.trace and args.field else run["deflection_m"] / B,
        thin_membrane_deflection=thin,
        pull_in_field=tops[0]["voltage_V"] / unit if tops else None,
        pull_in_deflection=tops[0]["deflection_m"] / B if tops else None,
    )
    if MPI.COMM_WORLD.rank == 0 and not args.quiet:
        s = run.summary
        if s["deflection"] is not None:
            what = "as a membrane" if args.membrane else f"at H/B = {args.thickness:g}"
            print(f"\ndeflection {s['deflection']:.6f} B {what}")
        if thin is not None:
            print(f"thin membrane: {thin:.6f} B")
        if tops:
            print(f"pull-in at the field {s['pull_in_field']:.4f} and the deflection "
                  f"{s['pull_in_deflection']:.4f} B")  # fmt: skip
        print(f"results: {run.out}/history.csv, fields.xdmf")


if __name__ == "__main__":
    main()
