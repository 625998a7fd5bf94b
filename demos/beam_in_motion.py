"""A bilayer beam in motion: a voltage that rises in a quarter of a second bends it.

A beam of 50 x 2 x 2 mm of VHB 4910 is clamped at one end.  Its lower half is grounded on both sides
and carries no field.  The potential on top of its upper half is 5 kV (1 - exp(-t/0.25 s)), so that
this half gets longer and the beam bends down, slowly in the end, as the rubber creeps.  The density
is 1000 kg/m^3.  Steps in time are equal ones.  The beam's axes are x (length), y (width) and z
(thickness); tip_m is the displacement along z of the middle of its free end.

    python demos/beam_in_motion.py --mesh fine --steps 250
"""

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer

LENGTH, SIDE = 50e-3, 2e-3
VOLTS, RISE = 5000.0, 0.25
BRANCHES = ((26.06e3, 0.6074), (26.53e3, 6.56), (10.83e3, 61.25))
"""Shear modulus in Pa and relaxation time in s of each branch (Wang et al., JMPS 95 (2016) 213)."""

MESHES = {"coarse": (8, 1), "medium": (12, 1), "fine": (20, 2)}
"""Hexahedra along the beam and across it; each half has one through its thickness."""


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/beam_in_motion")
    parser.add_argument("--mesh", choices=sorted(MESHES), default="coarse", help="its fineness")
    parser.number("--seconds", 5.0, "s", "how long the motion is followed")
    parser.count("--steps", 250, "equal steps of time")
    parser.add_argument("--at", type=float, nargs="*", default=[0.5, 1.0, 2.0, 5.0], metavar="s",
                        help="times in s at which the tip is told")  # fmt: skip
    return parser, parser.parse_args()


def scene(mesh):
    """The beam; at ramp factor 1 it has 5 kV."""
    along, across = MESHES[mesh]
    beam = BoxStack(
        LENGTH, SIDE, [Layer("lower", SIDE / 2), Layer("upper", SIDE / 2)],
        divisions=(along, across),
    )  # fmt: skip
    rubber = dea.Material(
        dea.ArrudaBoyce(15.36e3, 5.99, form="pade"), dea.IdealDielectric(4.8), density=1000.0,
        viscous=[dea.Maxwell(mu, tau) for mu, tau in BRANCHES],
    )  # fmt: skip
    return dea.Scene(
        dea.device(beam, MPI.COMM_WORLD),
        {"lower": rubber, "upper": rubber},
        electrodes=[
            dea.Electrode("top", VOLTS), dea.Ground("interface_1"), dea.Ground("bottom")
        ],
        supports=[dea.Clamp("x_min")],
    )  # fmt: skip


def drive(t):
    return 1 - np.exp(-t / RISE)


def main():
    parser, args = parse()
    at = sorted(t for t in args.at if 0 < t <= args.seconds)
    march = dea.March(
        args.seconds, {"voltage": drive}, steps=args.steps, at=tuple(at), inertia=True
    )
    tip = {"tip": dea.AtPoint((LENGTH, SIDE / 2, SIDE / 2), "displacement", "z")}
    run = dea.solve(
        scene(args.mesh), march, tip, out=args.out, resume=args.resume, quiet=args.quiet,
        stability="never", settings=parser.settings(args),
    )  # fmt: skip
    time, found = run.column("time_s"), run.column("tip_m")
    told = {f"tip_at_{t:g}_s_m": float(np.interp(t, time, found)) for t in at}
    run.add(**told, largest_tip_m=float(found[np.argmax(np.abs(found))]))
    if MPI.COMM_WORLD.rank == 0:
        dea.pictures.curve(args.out, x="time_s", y="tip_m")
        if not args.quiet:
            print()
            for t in at:
                print(f"tip at {t:g} s: {1e3 * told[f'tip_at_{t:g}_s_m']:.5f} mm")
            print(f"results: {run.out}/history.csv, tip_m over time_s")


if __name__ == "__main__":
    main()
