"""A film that snaps in motion: it comes to rest where it lands statically.

A free square film of a Gent rubber that stiffens early has a maximum of the voltage.  Beyond it a
battery lets the film snap to a larger stretch.  The demo finds this state twice: statically, by the
branch of equilibria, and in motion, with inertia and drag at constant voltage.  Beside them stands
the exact curve of the film,

    e^2 = mu(s) (s^-2 - s^-8),   mu(s) = Jm/(Jm - 2 s^2 - s^-4 + 3),   e = V/H sqrt(eps/mu).

Everything is dimensionless: shear modulus 1 (in Pa), density, permittivity and side 1.  With a
large limit Jm the film would thin so fast that its free edge runs ahead of the rest.
"""

import numpy as np
from mpi4py import MPI
from scipy.optimize import brentq

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0

THICKNESS = 0.1
STRETCH = {"stretch": dea.MeanStretch(("x_min", "x_max"), "x")}


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/snap_in_motion")
    parser.number("--limit", 8.0, "-", "limit Jm of the Gent rubber, from 7.5 to 10")
    parser.number("--drag", 6.0, "-", "drag in units of sqrt(mu/rho)/side, mu in Pa; from 3 on the "
                  "film does not swing")  # fmt: skip
    parser.number("--tolerance", 1e-4, "-", "largest error of a step in time, over the side")
    return parser, parser.parse_args()


def exact(limit):
    """Largest nominal field of the film, and the stretch to which it snaps there."""

    def field(s):
        return np.sqrt(limit / (limit - (2 * s**2 + s**-4 - 3)) * (s**-2 - s**-8))

    near = np.linspace(1.2, np.sqrt((limit + 2.5) / 2), 200001)
    slope = np.diff(field(near))
    top, low = (near[np.flatnonzero(np.diff(np.sign(slope)) == turn)[0] + 1] for turn in (-2, 2))
    highest = field(top)
    return highest, brentq(lambda s: field(s) - highest, low, near[-1])


def scene(args, field):
    """An eighth of the film; at ramp factor 1 it has a nominal field."""
    rubber = dea.Material(
        dea.Gent(1.0, args.limit), dea.IdealDielectric(1 / EPSILON_0), density=1.0
    )
    mesh = BoxStack(1.0, 1.0, [Layer("film", THICKNESS)], divisions=1)
    return dea.Scene(
        dea.device(mesh, MPI.COMM_WORLD),
        {"film": rubber},
        electrodes=[dea.Electrode("top", field * THICKNESS), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
    )


def landing(run):
    return next(row for row in run.history if row["event"] == "snap")


def main():
    parser, args = parse()
    top, known = exact(args.limit)
    made = scene(args, 1.02 * top)
    static = dea.solve(made, dea.Ramp("voltage", steps=9, at_loss="snap"), STRETCH, quiet=True)
    moving = dea.InMotion(dea.Inertia(0.0, args.tolerance, args.drag))
    run = dea.solve(
        made, dea.Ramp("voltage", steps=9, at_loss=moving), STRETCH, out=args.out,
        resume=args.resume, quiet=args.quiet, settings=parser.settings(args),
    )  # fmt: skip
    rest, snapped = landing(run), landing(static)
    told = next(e for e in run.summary["events"] if e["event"] == "snap")
    run.add(
        pull_in_field=float(rest["voltage_V"]) / THICKNESS,
        exact_pull_in_field=float(top),
        landed_stretch_in_motion=rest["stretch"],
        landed_stretch_static=snapped["stretch"],
        exact_landed_stretch=float(known),
        difference=rest["stretch"] - snapped["stretch"],
        seconds_to_rest=told["seconds"],
    )
    if MPI.COMM_WORLD.rank == 0:
        dea.pictures.curve(args.out, x="time_s", y="stretch")
        if not args.quiet:
            print(f"\nthe film snaps at a nominal field of {run.summary['pull_in_field']:.8f} "
                  f"(exact {top:.8f})")  # fmt: skip
            print(f"landed stretch: {rest['stretch']:.9f} in motion, {snapped['stretch']:.9f} "
                  f"static, {known:.9f} exact; at rest after {told['seconds']:.1f} s")  # fmt: skip
            print(f"results: {run.out}/history.csv, rows of the motion have the event 'motion'")


if __name__ == "__main__":
    main()
