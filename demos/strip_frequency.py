"""A clamped strip under voltage: its first frequency vanishes where it buckles.

Plane strain, both ends clamped.  The field puts the flat strip under compression, which lowers the
frequency of bending.  omega^2 is followed to 0 by a secant rule in the square of the voltage, with
modes about the flat state alone.  Beside it stands the voltage at which the static path finds its
bifurcation, by the count of negative eigenvalues of the tangent.
"""

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0

CLOSE = 1e-8
"""Change of the voltage, relative to itself, at which the secant rule ends."""


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/strip_frequency")
    parser.number("--mu", 50e3, "Pa", "shear modulus")
    parser.number("--eps-r", 4.7, "-", "relative permittivity")
    parser.number("--density", 1000.0, "kg/m^3", "mass per undeformed volume")
    parser.number("--thickness", 0.1e-3, "m", "thickness h")
    parser.number("--slenderness", 50.0, "-", "length over thickness, L/h")
    parser.count("--cells", 24, "cells along the strip")
    parser.count("--layers", 1, "cells through the thickness")
    return parser, parser.parse_args()


def strip(args):
    """The scene, and Euler's voltage in V, which is that of ramp factor 1."""
    h = args.thickness
    field = np.sqrt(4 * np.pi**2 / 3 * args.mu / (args.eps_r * EPSILON_0)) / args.slenderness
    mesh = BoxStack(args.slenderness * h, None, [Layer("strip", h, divisions=args.layers)],
                    divisions=args.cells, grading=2.0)  # fmt: skip
    material = dea.Material(
        dea.NeoHookean(args.mu), dea.IdealDielectric(args.eps_r), density=args.density
    )
    scene = dea.Scene(
        dea.device(mesh, MPI.COMM_WORLD),
        {"strip": material},
        electrodes=[dea.Electrode("top", field * h), dea.Ground("bottom")],
        supports=[dea.Clamp("x_min"), dea.Clamp("x_max")],
        kinematics=dea.PlaneStrain(),
    )
    return scene, field * h


def square_at(scene, factor):
    """The lowest omega^2 in 1/s^2 about the flat state at a load factor."""
    run = dea.solve(scene, dea.Ramp("voltage", to=factor, steps=2), quiet=True)
    return float(dea.modes(run, 1).squares[0])


def vanishing(scene, first=0.5, second=0.9):
    """Load factor at which omega^2 vanishes, by a secant rule in the factor's square."""
    a, b = first**2, second**2
    fa, fb = square_at(scene, first), square_at(scene, second)
    for _ in range(20):
        a, b, fa = b, b - fb * (b - a) / (fb - fa), fb
        if abs(b - a) <= CLOSE * b:
            break
        fb = square_at(scene, np.sqrt(b))
    return float(np.sqrt(b))


def main():
    parser, args = parse()
    scene, euler = strip(args)
    run = dea.solve(
        scene,
        dea.Ramp("voltage", to=1.2, steps=12),
        {"first": dea.Frequency()},
        out=args.out,
        resume=args.resume,
        quiet=args.quiet,
        stability="every",
        settings=parser.settings(args),
    )  # fmt: skip
    buckling = [row["voltage_V"] for row in run.history if row["event"] == "bifurcation"]
    zero = vanishing(scene) * euler
    run.add(
        frequency_zero_voltage_V=zero,
        buckling_voltage_V=buckling[0] if buckling else None,
        euler_voltage_V=euler,
        frequency_at_rest_Hz=float(run.column("first_Hz")[0]),
    )
    if MPI.COMM_WORLD.rank == 0:
        dea.pictures.curve(args.out, x="voltage_V", y="first_Hz")
        if not args.quiet:
            found = f"{buckling[0]:.6f} V" if buckling else "no voltage of this ramp"
            print(f"\nthe first frequency vanishes at {zero:.6f} V, the strip buckles at {found}, "
                  f"Euler {euler:.6f} V")  # fmt: skip
            print(f"results: {run.out}/history.csv, frequency over voltage in first_Hz")


if __name__ == "__main__":
    main()
