"""Two near modes: a film on a base whose length suits two wave numbers almost equally.

A film on a soft base (see crease_or_buckle.py) may buckle into n or n + 1 half waves.  At one
length both become neutral at the same voltage; here it is changed by --detuning, so that one of
them, at eps E^2 = q_1, comes a little before the other one, at q_2.  With amplitudes a and b that
are small, the branches obey

    (q - q_1) a = A a^3 + B a b^2,     (q - q_2) b = C b^3 + D a^2 b.

The first branch, b = 0, is stable.  The second one, a = 0, is unstable at first, for q > q_1.  As
b grows it stiffens the film against a, if B > C, and from

    q_s = q_2 + (q_2 - q_1) C/(B - C)

on it is stable, too.  At this secondary bifurcation a branch of mixed shapes leaves it.  Then two
shapes are stable at one voltage, and imperfections or the way of loading decide between them.  The
ratio (q_s - q_2)/(q_2 - q_1) hardly depends on the detuning, as long as it is small.

    python demos/two_modes.py
    python demos/two_modes.py --detuning -0.005 --to 1.08
"""

import shutil
from pathlib import Path

import numpy as np
from crease_or_buckle import neutral, scene, volts
from mpi4py import MPI
from scipy.optimize import brentq

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/two_modes")
    parser.number("--mu", 1e5, "Pa", "shear modulus of the film")
    parser.number("--ratio", 0.05, "-", "shear modulus of the base over that of the film")
    parser.number("--thickness", 0.1e-3, "m", "thickness h of the film")
    parser.number("--depth", 6.0, "-", "thickness of the base over that of the film")
    parser.number("--detuning", -0.01, "-", "length over that of two equal modes, less 1")
    parser.number("--to", 1.1, "-", "largest voltage over that of the first mode")
    parser.count("--half-waves", 2, "number n of half waves of the longer one of the two modes")
    parser.count("--cells", 8, "cells along a half wave")
    return parser, parser.parse_args()


def lengths(args):
    """Length of the film over h, and eps E^2/mu at which its two modes are neutral."""
    n = args.half_waves

    def value(m, length):
        return neutral(m * np.pi / length, args.depth, args.ratio)

    # near the wave number of a very soft base
    middle = (n + 0.5) * np.pi / (3 * args.ratio) ** (1 / 3)
    both = brentq(lambda l: value(n, l) - value(n + 1, l), 0.7 * middle, 1.4 * middle)
    length = both * (1 + args.detuning)
    return length, [value(m, length) for m in (n, n + 1)]


def film_on_base(args, length, unit):
    """The film, `length` long in units of h; at a ramp factor of 1 the voltage is `unit`."""
    h = args.thickness
    layers = [Layer("base", args.depth * h, 5), Layer("film", h, 1)]
    mesh = BoxStack(length * h, None, layers, divisions=args.half_waves * args.cells)
    return scene(args, mesh, unit)


def main():
    parser, args = parse()
    for name in ("mu", "ratio", "thickness", "depth"):
        if not (np.isfinite(getattr(args, name)) and getattr(args, name) > 0):
            parser.error(f"--{name} is {getattr(args, name)}, but must be a number above 0")
    if not (0 < abs(args.detuning) <= 0.1 and args.to > 1):
        parser.error("--detuning must be other than 0 and at most 0.1, and --to above 1")
    length, values = lengths(args)
    unit = volts(args, min(values))
    built = film_on_base(args, length, unit)
    top = (1 + args.depth) * args.thickness
    record = {
        "left": dea.AtPoint((0.0, top), "displacement", "y"),
        "right": dea.AtPoint((length * args.thickness, top), "displacement", "y"),
    }
    diagram = dea.branches(
        built,
        dea.Trace("voltage", first=0.4, until=("voltage_V", args.to * unit), steps=60),
        record, args.out, most=(2, 1), quiet=args.quiet, resume=args.resume,
    )  # fmt: skip
    mixed = next((b for b in diagram.branches if b.name == "branch_2_1"), None)
    first, one, two = (diagram[name] for name in ("first", "branch_1", "branch_2"))
    found = [(first.run.history[row]["voltage_V"] / unit) ** 2 * min(values)
             for row, _ in first.bifurcations[:2]]  # fmt: skip
    secondary = ratio = None
    if two.bifurcations:
        row = two.bifurcations[0][0]
        secondary = (two.run.history[row]["voltage_V"] / unit) ** 2 * min(values)
        ratio = (secondary - found[1]) / (found[1] - found[0])
    one.run.add(
        first_q=found[0], second_q=found[1], neutral_first_q=min(values),
        neutral_second_q=max(values), stable_from_q=secondary, distance_ratio=ratio,
        both_stable_at_end=one.run["inertia"] == two.run["inertia"] == 0,
        mixed_negative_modes=None if mixed is None else int(mixed.run["inertia"]),
    )  # fmt: skip
    if MPI.COMM_WORLD.rank == 0:
        kept = {"summary.json": one.run.out, "history.csv": one.run.out}
        for name, folder in kept.items():
            shutil.copyfile(folder / name, Path(args.out) / name)
        diagram.draw("left_m")
        if not args.quiet:
            report(one.run, args.out)


def report(run, out):
    s = run.summary
    print("\n                          film      eigenvalue problem")
    for name in ("first", "second"):
        print(f"{name:>6} mode: eps E^2/mu {s[f'{name}_q']:.6f}  {s[f'neutral_{name}_q']:.6f}")
    if s["stable_from_q"]:
        print(f"the second branch is stable from {s['stable_from_q']:.6f} on: "
              f"{s['distance_ratio']:.3f} times the distance of the two behind it")  # fmt: skip
    print("both shapes are stable at the end" if s["both_stable_at_end"]
          else "one shape alone is stable at the end")  # fmt: skip
    print(f"\nresults: {out}/left_voltage.png, first/, branch_1/, branch_2/, branch_2_1/")


if __name__ == "__main__":
    main()
