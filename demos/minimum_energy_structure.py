"""Minimum energy structure: a pre-stretched film bends its flexible frame, and a voltage opens it.

A film is stretched in both directions of its plane and bonded on a thin, flexible frame.  Released,
it shortens and bends the frame, until the energy of both is least; a voltage on the film takes its
tension away, and the frame opens again.

This is the section along the bending direction, in plane strain.  The frame is a sheet with a
window; its bars take a share of the width, so in the section it has that share of its modulus.
Half of the structure is computed: its middle is a plane of symmetry, where the frame is held, and
the bar of the frame at its end is rigid and free.

Bent into a circle, the section at undeformed height Z is stretched by lam, lam^2 = b^2 + 2 k Z, and
the energy per undeformed length is known exactly,

    U(b, k) = int mu/2 (lam^2 + lam^-2 - 2) dZ                            in the frame
            + int mu/2 (l^2 lam^2 + l^-4 lam^-2 + l^2 - 3) dZ - C V^2/2   in the film,

with the pre-stretch l and C = eps/int lam^-2 dZ.  Its least value is the closed form.
"""

import numpy as np
from mpi4py import MPI
from numpy.polynomial import legendre
from scipy.optimize import root

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/minimum_energy_structure")
    parser.number("--mu", 30e3, "Pa", "shear modulus of the film")
    parser.number("--eps-r", 4.7, "-", "relative permittivity of the film")
    parser.number("--prestretch", 3.0, "-", "stretch of the film in both directions of its plane")
    parser.number("--film", 0.1e-3, "m", "thickness of the stretched film")
    parser.number("--frame-mu", 1e9, "Pa", "shear modulus of the frame")
    parser.number("--frame", 0.1e-3, "m", "thickness of the frame")
    parser.number("--share", 0.3, "-", "part of the width that the bars of the frame take")
    parser.number("--length", 30e-3, "m", "length of the structure")
    parser.number("--width", 20e-3, "m", "width of the structure")
    parser.number("--voltage", 4000.0, "V", "end of the ramp")
    parser.count("--cells", 40, "cells along half of the length")
    return parser, parser.parse_args()


def energy(args, b, k, volts):
    """U(b, k) in J per m of length and of width, and its slopes by b and k."""
    points, weights = legendre.leggauss(20)
    t, h, pre = args.frame, args.film, args.prestretch

    def over(low, high, function, slope):
        Z = (low + high) / 2 + (high - low) / 2 * points
        w, s = (high - low) / 2 * weights, b**2 + 2 * k * Z  # s = lam^2
        return np.array([w @ function(s), w @ (slope(s) * 2 * b), w @ (slope(s) * 2 * Z)])

    frame = over(0, t, lambda s: s + 1 / s - 2, lambda s: 1 - 1 / s**2)
    film = over(
        t, t + h, lambda s: pre**2 * s + 1 / (pre**4 * s) + pre**2 - 3,
        lambda s: pre**2 - 1 / (pre**4 * s**2),
    )  # fmt: skip
    gap, *narrowing = over(t, t + h, lambda s: 1 / s, lambda s: -1 / s**2)
    field = args.eps_r * EPSILON_0 * volts**2 / 2
    electric = field / gap**2 * np.array([-gap, *narrowing])
    return args.share * args.frame_mu / 2 * frame + args.mu / 2 * film + electric


def closed_form(args, volts):
    """Curvature of the bottom of the frame in 1/m, signed, and the least energy in J."""

    def slopes(x):  # b - 1 and k t, in units of what the film's force gives
        return energy(args, 1 + x[0] * unit, x[1] * unit / args.frame, volts)[1:] / scale

    unit = args.mu * args.prestretch**2 * args.film / (args.share * args.frame_mu * args.frame)
    scale = args.mu * args.film * np.array([1.0, args.frame])
    found = root(slopes, [0.0, 0.0], tol=1e-13)
    b, k = 1 + found.x[0] * unit, found.x[1] * unit / args.frame
    area = args.length * args.width
    return -k / b, energy(args, b, k, volts)[0] * area, energy(args, 1.0, 0.0, volts)[0] * area


def structure(args):
    """Half of the section, as a scene."""
    layers = [Layer("frame", args.frame), Layer("film", args.film)]
    device = dea.device(
        BoxStack(args.length / 2, None, layers, divisions=(args.cells,)), MPI.COMM_WORLD,
        surfaces={"root": dea.OnPlane("x", 0.0) & dea.InBox((0.0, 0.0), (0.0, args.frame))},
    )  # fmt: skip
    rubber = dea.Material(dea.NeoHookean(args.mu), dea.IdealDielectric(args.eps_r))
    return dea.Scene(
        device,
        {"frame": dea.Material(dea.NeoHookean(args.share * args.frame_mu)), "film": rubber},
        electrodes=[dea.Electrode("top", args.voltage), dea.Ground("interface_1")],
        supports=[dea.Fix("x_min", "x"), dea.Fix("root", "y"), dea.Rigid("x_max")],
        prescribed=[dea.PreStretch("film", args.prestretch, z=args.prestretch, ramp="release")],
        kinematics=dea.PlaneStrain(args.width),
    )


def main():
    parser, args = parse()
    # the material line along the bottom of the frame, away from both ends
    line = (0.1 * args.length, 0.0), (0.4 * args.length, 0.0)
    record = {
        "curvature": dea.Curvature(*line),
        "angle": dea.PartRotation("x_max"),
        "elastic": dea.Energy("elastic"),
    }
    run = dea.solve(
        structure(args), [dea.Ramp("release", steps=6), dea.Ramp("voltage", steps=4)], record,
        args.out, resume=args.resume, quiet=args.quiet, settings=parser.settings(args),
    )  # fmt: skip
    released = next(r for r in run.history if r["release_factor"] == 1)
    curvature, least, flat = closed_form(args, 0.0)
    opened, _, _ = closed_form(args, args.voltage)
    run.add(
        released_curvature_per_m=released["curvature_per_m"],
        closed_form_curvature_per_m=curvature,
        relative_difference=released["curvature_per_m"] / curvature - 1,
        released_energy_relative_difference=2 * released["elastic_J"] / least - 1,
        released_bend_deg=float(np.degrees(2 * released["angle_rad"])),
        released_energy_J=2 * released["elastic_J"],
        closed_form_energy_J=least,
        flat_energy_J=flat,
        opened_curvature_per_m=run["curvature_per_m"],
        closed_form_opened_curvature_per_m=opened,
        opened_relative_difference=run["curvature_per_m"] / opened - 1,
        opened_bend_deg=float(np.degrees(2 * run["angle_rad"])),
    )
    if MPI.COMM_WORLD.rank == 0:
        dea.pictures.deformed(args.out)
        if not args.quiet:
            report(args, run.summary)
            print(f"\nresults: {run.out}/history.csv, fields.xdmf")


def report(args, s):
    print(f"\nreleased it bends by {s['released_bend_deg']:.2f} deg, "
          f"at {args.voltage:g} V by {s['opened_bend_deg']:.2f} deg")  # fmt: skip
    for when in ("", "opened_"):
        found = s[f"{when or 'released_'}curvature_per_m"]
        exact = s[f"closed_form_{when}curvature_per_m"]
        print(f"curvature {found:.5f} 1/m, by least energy {exact:.5f} "
              f"({100 * (found / exact - 1):+.3f} %)")  # fmt: skip
    print(f"elastic energy {1e3 * s['released_energy_J']:.4f} mJ, least "
          f"{1e3 * s['closed_form_energy_J']:.4f} mJ, held flat {1e3 * s['flat_energy_J']:.4f} mJ")


if __name__ == "__main__":
    main()
