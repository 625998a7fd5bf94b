"""A bonded layer creases under voltage, is held there, and is unloaded.

A layer of VHB 4910, 20 mm thick and 120 mm long, in plane strain: its bottom is bonded and
grounded, its ends do not move along the layer, and its top is an electrode.  The nominal field
e = V/H sqrt(eps/G) rises at --rate to --field, is held for --hold, and falls again.  A notch, 0.12
mm long and 0.02 mm deep, is cut off the top left corner: there, at a plane of symmetry, the surface
folds into a crease.

The bond and the ends keep the flat layer in place whatever the voltage is; only its pressure rises
with the Maxwell stress.  Its surface is unstable, as that of a compressed block is.  Under the
rising voltage the notch becomes a crease, which creeps: it goes on to grow while the voltage falls
already, and then opens again.

The two sides of the crease touch each other: the surface cannot go through the plane of symmetry,
in which an `Obstacle` lies.  A pressed point may lie off this plane by half a cell of the notch;
`overlap_m` tells how far nodes are beyond it.  Held at 1.25 for 300 s, the crease becomes 3 mm
deep.  With --no-contact the sides go through each other; the crease then grows faster, and the end
of a long hold depends on the mesh.  The depths at the ends of the rise and of the hold,
`depth_when_loaded_m` and `depth_when_held_m`, are null where equilibrium is lost before.

    python demos/crease.py
    python demos/crease.py --hold 300 --notch-cells 4
    python demos/crease.py --field 1.1 --hold 200 --notch 0.5 --mesh 2
"""

from dataclasses import dataclass

import h5py
import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer, graded
from dea_fenicsx.materials import EPSILON_0

G, LIMIT = 15.36e3, 5.99
BRANCHES = ((26.06e3, 0.6074), (26.53e3, 6.56), (10.83e3, 61.25))
"""Shear modulus in Pa and relaxation time in s of each branch (Wang et al., JMPS 95 (2016) 213)."""


def vhb(G):
    """The material; its branches go with G."""
    return dea.Material(
        dea.ArrudaBoyce(G, LIMIT, form="pade"), dea.IdealDielectric(4.8),
        viscous=[dea.Maxwell(G / 15.36e3 * mu, tau) for mu, tau in BRANCHES],
    )  # fmt: skip


HEIGHT, LENGTH, DEEP, WIDE = 20e-3, 120e-3, 0.02e-3, 0.12e-3
"""Of the layer and of its notch, in m."""

MOST = 20.0
"""Largest size of the notch, over the one above."""


def towards(end, finest, n):
    """Ends of n cells from 0, with a first cell of a given size, which grow geometrically."""
    low, high = 0.0, 30.0  # logarithms of the largest over the smallest cell
    for _ in range(200):
        middle = (low + high) / 2
        first = graded(n, np.exp(middle), "start")[1] * end
        low, high = (middle, high) if first > finest else (low, middle)
    return end * graded(n, np.exp(low), "start")


@dataclass(frozen=True)
class Notched(BoxStack):
    """A stack whose top layer is graded towards its top left corner, where a notch is cut off.

    Parameters (besides those of a `BoxStack`)
    ----------
    wide, deep
        Length along the top, and depth, of the notch in m.
    notch
        Number of cells along the notch.
    """

    wide: float = WIDE
    deep: float = DEEP
    notch: int = 2

    def mesh(self):
        mesh, n, top = super().mesh(), self.divisions[0], self.layers[-1]
        at, low = mesh.points, sum(layer.thickness for layer in self.layers[:-1])
        high, cell = low + top.thickness, self.wide / self.notch
        first = np.linspace(0, self.wide, self.notch + 1)
        rest = self.wide + towards(self.length - self.wide, cell, n - self.notch)[1:]
        x = np.concatenate([first, rest])
        at[:, 0] = np.interp(at[:, 0], np.linspace(0, self.length, n + 1), x)
        y = high - towards(top.thickness, cell, top.divisions)[::-1]
        above = at[:, 1] > low
        at[above, 1] = np.interp(at[above, 1], np.linspace(low, high, top.divisions + 1), y)
        # The nodes below the notch go down with it, the less, the deeper they lie.
        share = np.clip(1 - at[above, 0] / self.wide, 0, 1)
        share *= np.exp((at[above, 1] - high) / (20 * self.deep))
        at[above, 1] -= self.deep * share * (at[above, 1] - low) / top.thickness
        return mesh


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/crease")
    parser.number("--rate", 1e-3, "1/s", "rate of the nominal field, in units of sqrt(G/eps)")
    parser.number("--field", 1.25, "-", "largest nominal field")
    parser.number("--hold", 0.0, "s", "time for which it is held")
    parser.number("--mu", G, "Pa", "equilibrium shear modulus G; the branches go with it")
    parser.number("--tolerance", 1e-4, "-", "of the march")
    parser.number("--notch", 1.0, "-", "length and depth of the notch, over 0.12 and 0.02 mm")
    parser.count("--notch-cells", 2, "cells along the notch, and finest cells of the mesh")
    parser.count("--mesh", 1, "refinement of the mesh")
    parser.add_argument(
        "--no-contact", action="store_true", help="the sides of the crease go through each other"
    )
    return parser, parser.parse_args()


def scene(args):
    """The layer; at a ramp factor of 1 the nominal field is sqrt(G/eps)."""
    k, cells = args.mesh, args.notch_cells
    layer = Notched(LENGTH, None, [Layer("layer", HEIGHT, 14 * k)], (18 + cells) * k,
                    notch=cells * k, wide=args.notch * WIDE, deep=args.notch * DEEP)  # fmt: skip
    unit = HEIGHT * float(np.sqrt(args.mu / (4.8 * EPSILON_0)))
    supports = [dea.Clamp("bottom"), dea.Fix("x_min", "x"), dea.Fix("x_max", "x")]
    if not args.no_contact:
        plane, cell = dea.Plane((0.0, 0.0), (1.0, 0.0)), args.notch * WIDE / (cells * k)
        supports.append(dea.Obstacle("top", plane, tolerance=cell / 2))
    return dea.Scene(
        dea.device(layer, MPI.COMM_WORLD),
        {"layer": vhb(args.mu)},
        electrodes=[dea.Electrode("top", unit), dea.Ground("bottom")],
        supports=supports,
        kinematics=dea.PlaneStrain(),
    )


def main():
    parser, args = parse()
    for name in ("rate", "field", "notch"):
        if not (np.isfinite(getattr(args, name)) and getattr(args, name) > 0):
            raise dea.InputError(f"--{name} is {getattr(args, name)}, but must be a number > 0.")
    if args.notch > MOST:
        raise dea.InputError(
            f"--notch is {args.notch:g}, but must be at most {MOST:g}: the notch is a small one."
        )
    rise = args.field / args.rate
    path = [dea.March(rise, {"voltage": dea.Rise(args.field, rise)}, tolerance=args.tolerance)]
    if args.hold > 0:
        path.append(dea.March(args.hold, tolerance=args.tolerance))
    fall = dea.Rise(0.0, rise, low=args.field)
    path.append(dea.March(rise, {"voltage": fall}, tolerance=args.tolerance))
    run, end = followed(parser, args, path)
    unit = HEIGHT * float(np.sqrt(args.mu / (4.8 * EPSILON_0)))
    field, depth = run.column("voltage_V") / unit, -run.column("corner_m")
    k, time = int(np.argmax(depth)), run.column("time_s")
    held = [float(np.interp(t, time, depth)) if t <= time[-1] * (1 + 1e-9) else None
            for t in (rise, rise + args.hold)]  # fmt: skip
    run.add(
        rate_per_s=args.rate, notch_depth_m=args.notch * DEEP,
        depth_when_loaded_m=held[0], depth_when_held_m=held[1],
        largest_field=float(field.max()), largest_depth_m=float(depth[k]),
        field_at_largest_depth=float(field[k]), last_field=float(field[-1]),
        last_time_s=run["time_s"], last_depth_m=float(depth[-1]), overlap_m=overlap(run), end=end,
        seconds=run.summary["wall_s"],
    )  # fmt: skip
    if MPI.COMM_WORLD.rank == 0:
        dea.pictures.curve(args.out, x="voltage_V", y="corner_m")
        if not args.quiet:
            report(run)


def followed(parser, args, path):
    """The run, and how the march ended."""
    try:
        run = dea.solve(
            scene(args),
            path,
            record={"corner": dea.AtPoint((0.0, HEIGHT - args.notch * DEEP), "displacement", "y"),
                    "notch": dea.AtPoint((args.notch * WIDE, HEIGHT), "displacement", "y")},
            out=args.out,
            resume=args.resume,
            quiet=args.quiet,
            stability="never",
            settings=parser.settings(args),
        )  # fmt: skip
    except (dea.EquilibriumLost, dea.SolverError) as error:
        if getattr(error, "run", None) is None:
            raise
        return error.run, str(error)
    return run, "unloaded"


def overlap(run):
    """How far nodes have gone beyond the plane of symmetry in m, over all steps.  Collective."""
    found = 0.0
    if MPI.COMM_WORLD.rank == 0:
        with h5py.File(run.out / "fields.h5") as h5:
            x = h5["grid/points"][:, 0]
            for row in run.history:
                moved = h5[f"step_{row['step']:05d}/node/displacement_m"][:, 0]
                found = max(found, -float(np.min(x + moved)))
    return MPI.COMM_WORLD.bcast(found)


def report(run):
    s = run.summary
    print(f"\nlargest field {s['largest_field']:.5f}; the crease is "
          f"{1e3 * s['largest_depth_m']:.4g} mm deep at {s['field_at_largest_depth']:.5f}; overlap "
          f"{1e3 * s['overlap_m']:.3g} mm")  # fmt: skip
    print(f"last field {s['last_field']:.5f} after {s['last_time_s']:.5g} s, depth "
          f"{1e3 * s['last_depth_m']:.4g} mm\nend: {s['end']}")  # fmt: skip
    print(f"\nresults: {run.out}/history.csv, corner_voltage.png, fields.xdmf")


if __name__ == "__main__":
    main()
