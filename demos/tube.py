"""Tube actuator: how far a voltage through its wall lengthens it, and how hard it pushes when held.

The inner and the outer face of a tube of film are electrodes.  The voltage makes the wall thinner,
so that the tube grows longer and wider.  Rigid caps close its ends.  They keep the radius there,
and where the tube cannot widen it lengthens a little more.  Then the length is held by smooth
plates, and the force on them is the blocked force.

Beside both stands the exact state of a tube without ends, of neo-Hookean rubber: the radius r is
that of a radius R before with r^2 = a^2 + (R^2 - A^2)/l, the field is V/(r ln(b/a)), and the
pressure follows from the balance of forces along r.

    python demos/tube.py
    python demos/tube.py --voltage 4000 --height 0.06
"""

import numpy as np
from mpi4py import MPI
from scipy.optimize import brentq, fsolve

import dea_fenicsx as dea
from dea_fenicsx.geometry import Layer, Tube
from dea_fenicsx.materials import EPSILON_0


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/tube")
    parser.number("--mu", 100e3, "Pa", "shear modulus")
    parser.number("--permittivity", 3.0, "-", "relative permittivity")
    parser.number("--inner", 3e-3, "m", "inner radius")
    parser.number("--wall", 0.5e-3, "m", "thickness of the wall")
    parser.number("--height", 30e-3, "m", "length of the tube")
    parser.number("--voltage", 12e3, "V", "voltage between the faces")
    parser.count("--steps", 4, "steps of the voltage")
    parser.count("--cells", 24, "cells along the tube")
    return parser, parser.parse_args()


def scene(args, supports):
    """Half a section of the tube; ramp factor 1 is the whole voltage."""
    wall = [Layer("film", args.wall, divisions=2)]
    device = dea.device(Tube(args.inner, args.height, wall, axial=args.cells), MPI.COMM_WORLD)
    film = dea.Material(dea.NeoHookean(args.mu), dea.IdealDielectric(args.permittivity))
    return dea.Scene(
        device, {"film": film},
        electrodes=[dea.Electrode("outer", args.voltage), dea.Ground("inner")],
        supports=supports, kinematics=dea.Axisymmetric(),
    )  # fmt: skip


def exact(args, held):
    """Stretch along the axis and force that a tube without ends needs to be held, in N."""
    A, B, mu = args.inner, args.inner + args.wall, args.mu
    eps = args.permittivity * EPSILON_0
    nodes, weights = np.polynomial.legendre.leggauss(40)
    R, w = A + (nodes + 1) * (B - A) / 2, weights * (B - A) / 2

    def state(a, stretch):
        """Jump of the stress along r over the wall, and the axial force."""
        b = np.sqrt(a**2 + (B**2 - A**2) / stretch)
        r = np.sqrt(a**2 + (R**2 - A**2) / stretch)
        dr = w * R / (r * stretch)
        electric = eps * (args.voltage / (r * np.log(b / a))) ** 2
        across = (R / (r * stretch)) ** 2
        hoop = (mu * ((r / R) ** 2 - across) - electric) / r  # slope of the stress along r
        axial = mu * (stretch**2 - across) - electric  # beyond the stress along r
        # The integral of the stress along r over the section, by parts.
        return hoop @ dr, 2 * np.pi * ((axial * r) @ dr + (hoop * (b**2 - r**2) / 2) @ dr)

    if held:
        a = brentq(lambda a: state(a, 1.0)[0], 0.5 * A, 2.0 * A, xtol=1e-15)
        return 1.0, state(a, 1.0)[1]

    def residual(x):
        jump, force = state(x[0] * A, x[1])
        return jump / mu, force / (mu * np.pi * (B**2 - A**2))

    return fsolve(residual, (1.0, 1.0), xtol=1e-13)[1], 0.0


def main():
    parser, args = parse()
    path = dea.Ramp("voltage", steps=args.steps)
    run = dea.solve(
        scene(args, [dea.Clamp("bottom"), dea.Rigid("top")]), path,
        {"stroke": dea.PartDisplacement("top", "z")}, out=args.out, resume=args.resume,
        quiet=args.quiet, settings=parser.settings(args),
    )  # fmt: skip
    rollers = [dea.Fix("bottom", "z"), dea.Fix("top", "z")]
    held = dea.solve(scene(args, rollers), path, {"hold": dea.Reaction("top", "z")}, quiet=True)
    long_tube, (_, force) = exact(args, held=False)[0] - 1, exact(args, held=True)
    run.add(
        strain=run["stroke_m"] / args.height, strain_of_a_long_tube=float(long_tube),
        blocked_force_N=-held["hold_N"], exact_blocked_force_N=float(-force),
    )  # fmt: skip
    if MPI.COMM_WORLD.rank == 0:
        say = (lambda text: None) if args.quiet else print
        s = run.summary
        say(f"stroke {1e3 * run['stroke_m']:.3f} mm, {100 * s['strain']:.2f} % of the length; a "
            f"tube without ends {100 * long_tube:.2f} %")  # fmt: skip
        say(f"blocked force {1e3 * s['blocked_force_N']:.3f} mN, exact {-1e3 * force:.3f} mN")
        dea.pictures.curve(run.out, "voltage_V", "stroke_m")
        dea.pictures.deformed(run.out, say=say)


if __name__ == "__main__":
    main()
