"""Cone with a bias spring: how far a voltage moves the disc, and how hard it pushes when held.

A pre-stretched ring of film carries a rigid disc, which a spring pushes out of the plane.  A linear
spring gives a small stroke.  A bistable one has a negative stiffness about the disc's place, which
takes most of the film's stiffness away, so that the same voltage moves the disc farther.  Inputs
without unit are lengths over the outer radius B of the undeformed film, and forces over
2 pi mu H B.
"""

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0

INNER, B = 0.3, 10e-3  # radius of the disc over that of the ring; radius of the ring in m
DISC, RING = "x_min", "x_max"


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/spring_cone")
    parser.add_argument("--bias", choices=("linear", "bistable"), default="bistable",
                        help="the spring")  # fmt: skip
    parser.number("--mu", 50e3, "Pa", "shear modulus")
    parser.number("--prestretch", 1.5, "-", "stretch of the film before it is glued")
    parser.number("--field", 0.2, "-", "(V/H) sqrt(eps/mu), of the undeformed thickness")
    parser.number("--thickness", 0.02, "-", "H/B of the undeformed film")
    parser.number("--stiffness", 0.5, "-", "stiffness of the linear spring")
    parser.number("--rest", 1.2, "-", "deflection at which the linear spring has no force")
    parser.number("--peak", 0.05, "-", "largest force of the bistable spring")
    parser.number("--distance", 0.4, "-", "distance of the two states of the bistable spring")
    parser.count("--cells", 12, "cells along the radius")
    return parser, parser.parse_args()


def scene(args, springs=(), prescribed=()):
    """Film, disc and ring; factor 1 of the voltage is the field."""
    lp, H = args.prestretch, args.thickness * B
    film = [Layer("film", H / lp**2, divisions=2)]
    shape = BoxStack(lp * (1 - INNER) * B, None, film, args.cells, grading=8.0,
                     x0=lp * INNER * B)  # fmt: skip
    volts = args.field * H * np.sqrt(args.mu / (3.0 * EPSILON_0))
    return dea.Scene(
        dea.device(shape, MPI.COMM_WORLD),
        {"film": dea.Material(dea.NeoHookean(args.mu), dea.IdealDielectric(3.0))},
        electrodes=[dea.Electrode("top", volts), dea.Ground("bottom")],
        supports=[dea.Clamp(RING), dea.Rigid(DISC), *springs],
        prescribed=[dea.PreStretch("film", r=lp), *prescribed],
        kinematics=dea.Axisymmetric(),
    )


RECORD = {"deflection": dea.PartDisplacement(DISC, "z"), "held_by": dea.PartForce(DISC, "z"),
          "springs": dea.Energy("springs")}  # fmt: skip


def main():
    parser, args = parse()
    unit = 2 * np.pi * args.mu * args.thickness * B**2
    linear = dea.Spring(DISC, args.stiffness * unit / B, "z", rest=args.rest * B)
    before = [dea.Ramp("prestretch", steps=2), dea.Ramp("spring", steps=4)]
    options = dict(out=args.out, resume=args.resume, quiet=args.quiet,
                   settings=parser.settings(args))  # fmt: skip
    plain = dea.solve(scene(args, [linear]), before, RECORD, quiet=True)
    place = float(plain["deflection_m"])  # where the linear spring holds the disc at 0 V
    springs = [linear]
    if args.bias == "bistable":
        s = args.distance * B
        law = dea.BistableLaw(args.peak * unit, s)  # its unstable state lies at that place
        springs.append(dea.Spring(DISC, law, "z", rest=place - s / 2))
    run = dea.solve(scene(args, springs), [*before, dea.Ramp("voltage", steps=4)], RECORD,
                    **options)  # fmt: skip
    start = next(r["deflection_m"] for r in run.history if r["spring_factor"] == 1)

    # The disc held there without a spring: what holds it changes by the force of the voltage.
    record = {name: RECORD[name] for name in ("deflection", "held_by")}
    held = dea.solve(
        scene(args, prescribed=[dea.Displacement(DISC, "z", start)]),
        [dea.Ramp("prestretch", steps=2), dea.Ramp("stretch", steps=4),
         dea.Ramp("voltage", steps=2)],
        record, quiet=True,
    )  # fmt: skip
    at_rest = next(r["held_by_N"] for r in held.history if r["stretch_factor"] == 1)
    run.add(
        bias=args.bias,
        deflection_at_0V=start / B,
        stroke=(run["deflection_m"] - start) / B,
        stroke_m=run["deflection_m"] - start,
        blocked_force_N=at_rest - held["held_by_N"],
    )
    if MPI.COMM_WORLD.rank == 0 and not args.quiet:
        s = run.summary
        print(f"\n{args.bias} bias: from {s['deflection_at_0V']:.4f} B by {s['stroke']:.5f} B, "
              f"{1e3 * s['stroke_m']:.4f} mm")  # fmt: skip
        print(f"blocked force {1e3 * s['blocked_force_N']:.3f} mN")
        print(f"results: {run.out}/history.csv, fields.xdmf")


if __name__ == "__main__":
    main()
