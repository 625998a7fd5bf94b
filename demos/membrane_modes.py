"""A clamped round membrane: its ten lowest frequencies, beside those of a thin membrane.

The film is stretched equal-biaxially, clamped at its rim and put under voltage.  Of a film much
thinner than wide the frequencies are known:

    f = j_mn/(2 pi a) sqrt((mu (lam^2 - lam^-4) - eps E^2)/rho),   E = lam^2 V/H,

with j_mn the n-th zero of the Bessel function J_m and a the deformed radius.  Voltage lowers them,
and all of them vanish at loss of tension.  A film of finite thickness lies above this by about its
thickness over its radius, since the clamp bends it.  With --extrapolate a second film of half the
thickness is computed, and the frequencies of both are continued linearly to no thickness.  All
lengths are in units of the undeformed radius R, frequencies in units of sqrt(mu/rho)/R.
"""

import h5py
import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI
from scipy.special import jn_zeros

import dea_fenicsx as dea
from dea_fenicsx.geometry import DiskStack, Layer
from dea_fenicsx.materials import EPSILON_0

COUNT = 10
FARTHEST = 8  # zeros of J_0 ... J_7 hold the ten lowest


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/membrane_modes")
    parser.number("--stretch", 1.2, "-", "equal-biaxial stretch of the film")
    parser.number("--field", 0.0, "-", "V/H sqrt(eps/mu): nominal field of the undeformed film, "
                  "with the modulus mu in Pa")  # fmt: skip
    parser.number("--thickness", 0.02, "-", "undeformed thickness over undeformed radius")
    parser.count("--angular", 32, "cells around, a multiple of 4")
    parser.count("--radial", 12, "cells from the core to the rim, smaller towards the rim")
    parser.add_argument("--extrapolate", action="store_true", help="also compute a film of half "
                        "the thickness, and continue the frequencies to no thickness")  # fmt: skip
    return parser, parser.parse_args()


def closed_form(stretch, field):
    """The ten lowest frequencies of a thin membrane; NaN beyond loss of tension."""
    zeros = np.concatenate([
        np.repeat(jn_zeros(m, FARTHEST), 1 if m == 0 else 2) for m in range(FARTHEST)
    ])  # fmt: skip
    tension = stretch**2 - stretch**-4 - (stretch**2 * field) ** 2
    speed = np.sqrt(tension) if tension >= 0 else np.nan
    return np.sort(zeros)[:COUNT] / (2 * np.pi * stretch) * speed


def scene(args, thickness):
    """The stretched film with mu, rho, eps and R all 1; at ramp factor 1 it has its field."""
    a, h = args.stretch, thickness / args.stretch**2
    # bending by the clamp decays over a few thicknesses from the rim, where cells are small
    grading = max(1.0, min(0.25 * a / h, 40.0))
    disc = DiskStack(a, [Layer("film", h)], radial=args.radial, angular=args.angular,
                     grading=grading)  # fmt: skip
    device = dea.device(disc, MPI.COMM_WORLD)
    film = dea.Material(
        dea.NeoHookean(1.0), dea.IdealDielectric(eps_r=1 / EPSILON_0), density=1.0
    )
    stretch = [dea.PreStretch("film", x=a, y=a)] if a != 1 else []
    return dea.Scene(
        device,
        {"film": film},
        electrodes=[dea.Electrode("top", args.field * thickness), dea.Ground("bottom")],
        supports=[dea.Clamp("side")],
        prescribed=stretch,
    )


def across(run):
    """Ten modes that move across the film: there are others, which move within its plane."""
    for wanted in (2 * COUNT, 4 * COUNT, 8 * COUNT):
        modes = dea.modes(run, wanted)
        found = [k for k in range(wanted) if modes.share("z", k) > 0.5]
        if len(found) >= COUNT:
            break
    return modes, found[:COUNT]


def solved(args, thickness, **options):
    """The run of a film, all its modes, and the numbers of the ten that move across it."""
    made = scene(args, thickness)
    # the film is stretched first, then put under voltage; a ramp that drives nothing is none
    path = [dea.Ramp(name, steps=1) for name in ("prestretch", "voltage") if name in made.ramps]
    run = dea.solve(made, path or dea.March(1.0), quiet=args.quiet, **options)
    modes, found = across(run)
    return run, modes, found


def main():
    parser, args = parse()
    run, modes, found = solved(
        args, args.thickness, out=args.out, resume=args.resume, settings=parser.settings(args)
    )
    modes.write(run.out)
    frequencies = modes.frequencies[found]
    columns = {"frequency": frequencies, "closed_form": closed_form(args.stretch, args.field)}
    columns["extrapolated"] = np.full(COUNT, np.nan)
    if args.extrapolate:
        _, thinner, across_it = solved(args, args.thickness / 2)
        columns["extrapolated"] = 2 * thinner.frequencies[across_it] - frequencies
    keys = {f"{name}_{k}": f for name, found in columns.items() for k, f in enumerate(found)}
    run.add(
        **{k: None if np.isnan(f) else float(f) for k, f in keys.items()},
        growing_modes=modes.growing,
    )
    if MPI.COMM_WORLD.rank == 0:
        draw(run.out, found, columns)
    if MPI.COMM_WORLD.rank == 0 and not args.quiet:
        report(columns, args.extrapolate)
        if modes.growing:
            print(f"{modes.growing} of them grow: the film has lost its tension.")
        print(f"\nresults: {run.out}/modes.xdmf")


def report(columns, extrapolated):
    """Print the frequencies beside those of a thin membrane."""
    what = ["frequency", *["extrapolated"] * extrapolated]
    print("\nmode  thin membrane", *(f"{name:>12}  difference" for name in what),
          "   (units of sqrt(mu/rho)/R)")  # fmt: skip
    for k, g in enumerate(columns["closed_form"]):
        told = (f"{columns[n][k]:12.6f}  {100 * (columns[n][k] / g - 1):+8.2f} %" for n in what)
        print(f"{k:4}  {g:13.6f}", *told)


def draw(out, found, columns):
    """The shapes of the modes, seen from above, with their frequencies; read from modes.h5."""
    figure = Figure(figsize=(8, 3.9), layout="constrained")
    with h5py.File(out / "modes.h5") as file:
        points = file["grid/points"][:]
        top = points[:, 2] > points[:, 2].max() * (1 - 1e-6)
        for axes, k, f, thin in zip(figure.subplots(2, 5).ravel(), found, columns["frequency"],
                                    columns["closed_form"], strict=True):  # fmt: skip
            height = file[f"mode_{k:03}/node/mode"][top, 2]
            axes.tricontourf(*points[top, :2].T, height / np.abs(height).max(),
                             levels=np.linspace(-1, 1, 21), cmap="RdBu")  # fmt: skip
            axes.set_title(f"{f:.3f} (thin: {thin:.3f})", fontsize=8)
            axes.set_aspect("equal")
            axes.axis("off")
    figure.suptitle("Shape of each mode, and its frequency in units of sqrt(mu/rho)/R", fontsize=9)
    figure.savefig(out / "modes.png", dpi=200)


if __name__ == "__main__":
    main()
