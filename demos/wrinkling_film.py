"""A stretched, held film loses its tension under voltage and wrinkles.

A square film is stretched equally along both axes and held at its rim.  It goes slack where

    eps E^2 = mu (lam^2 - lam^-4),

and a little later it buckles into its first wrinkle, because it has some thickness.  Both are
events of the path, and the null vector of the second one is drawn.
"""

from pathlib import Path

import h5py
import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0

RIM = ("x_min", "x_max", "y_min", "y_max")


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/wrinkling_film")
    parser.number("--mu", 50e3, "Pa", "shear modulus")
    parser.number("--eps-r", 4.7, "-", "relative permittivity")
    parser.number("--thickness", 0.1e-3, "m", "thickness before the stretch")
    parser.number("--slenderness", 50.0, "-", "side over thickness, before the stretch")
    parser.number("--stretch", 1.1, "-", "stretch along both axes")
    parser.count("--cells", 8, "cells along each side")
    return parser, parser.parse_args()


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    lam, h = args.stretch, args.thickness
    side = args.slenderness * h
    mesh = BoxStack(side, side, [Layer("film", h)], divisions=(args.cells, args.cells))
    slack = h / lam**2 * np.sqrt(args.mu * (lam**2 - lam**-4) / (args.eps_r * EPSILON_0))
    along = {"x_min": "y", "y_min": "x", "x_max": "xy", "y_max": "xy"}
    scene = dea.Scene(
        dea.device(mesh, comm),
        {"film": dea.Material(dea.NeoHookean(args.mu), dea.IdealDielectric(args.eps_r))},
        electrodes=[dea.Electrode("top", slack), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y")],
        # the rim is held as the stretched film lies, through its thickness too
        prescribed=[dea.Stretch(s, axes, lam) for s, axes in along.items()]
        + [dea.Stretch(s, "z", lam**-2) for s in RIM],
    )
    run = dea.solve(
        scene,
        [dea.Ramp("stretch", steps=2), dea.Ramp("voltage", to=1.02, steps=2)],
        record={"deflection": dea.LargestDisplacement("top", "z")},
        out=args.out,
        resume=args.resume,
        quiet=args.quiet,
        stability="every",
        failures=[dea.LossOfTension("z")],
        settings=parser.settings(args),
    )
    events = {}
    for row in run.history:
        if row["event"]:
            events.setdefault(row["event"], row)
    wrinkle = events.get("bifurcation")
    run.add(
        slack_voltage_V=events["loss of tension"]["voltage_V"],
        exact_slack_voltage_V=slack,
        wrinkling_voltage_V=wrinkle["voltage_V"] if wrinkle else None,
    )
    if comm.rank == 0 and wrinkle:
        picture = draw(Path(args.out), int(wrinkle["step"]), h / lam**2)
        if not args.quiet:
            s = run.summary
            print(f"\nloss of tension at {s['slack_voltage_V']:.6f} V, exact {slack:.6f} V")
            print(f"first wrinkle at {s['wrinkling_voltage_V']:.4f} V, "
                  f"{100 * (s['wrinkling_voltage_V'] / slack - 1):+.3f} %")  # fmt: skip
            print(f"\nresults: {picture}, {args.out}/fields.xdmf, modes/")


def draw(out, step, top):
    """Deflection of the first wrinkle over the stretched film, as a map."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    with h5py.File(out / "modes" / f"mode_{step:05d}.h5") as h5:
        x = h5["points"][:] + h5["node/displacement_m"][:]
        w = h5["node/mode"][:, 2]
    upper = x[:, 2] > 0.99 * top
    figure, axes = plt.subplots(figsize=(3.4, 2.8), layout="constrained")
    drawn = axes.tricontourf(1e3 * x[upper, 0], 1e3 * x[upper, 1], w[upper], levels=20)
    axes.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal", title="first wrinkle")
    figure.colorbar(drawn, label="deflection (largest displacement: 1)")
    path = out / "first_wrinkle.png"
    figure.savefig(path, dpi=200)
    plt.close(figure)
    return path


if __name__ == "__main__":
    main()
