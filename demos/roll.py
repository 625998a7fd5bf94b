"""Roll actuator: how far a voltage lengthens a film that is wound up in a spiral.

The film has two layers with an electrode between them; the other electrode lies between the turns.
The voltage makes all layers thinner, so that the roll grows longer and wider.  A section across it
is computed.  It stays plane, and the stretch along the roll is one unknown (generalised plane
strain).

Beside it stands a roll of very many thin layers, for which there is an exact state.  It is a tube
in which a radius R becomes r with r^2 = a^2 + (R^2 - A^2)/l.  A layer of thickness t has the field
V/(t dr/dR), so that the inner layers, which thin less, have a lower field.

    python demos/roll.py
    python demos/roll.py --turns 8 --voltage 3000
"""

import numpy as np
from mpi4py import MPI
from scipy.optimize import fsolve

import dea_fenicsx as dea
from dea_fenicsx.geometry import Layer, Roll
from dea_fenicsx.materials import EPSILON_0


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/roll")
    parser.number("--mu", 100e3, "Pa", "shear modulus")
    parser.number("--permittivity", 3.0, "-", "relative permittivity")
    parser.number("--inner", 2e-3, "m", "inner radius")
    parser.number("--layer", 0.1e-3, "m", "thickness of each of the two layers of the film")
    parser.count("--turns", 5, "turns of the film")
    parser.number("--height", 50e-3, "m", "length of the roll")
    parser.number("--voltage", 3e3, "V", "voltage between the electrodes")
    parser.count("--steps", 3, "steps of the voltage")
    parser.count("--cells", 16, "cells around a turn")
    return parser, parser.parse_args()


def scene(args):
    """A section of the roll; ramp factor 1 is the whole voltage."""
    layers = [Layer("film", args.layer), Layer("film", args.layer)]
    device = dea.device(Roll(args.inner, args.turns, layers, angular=args.cells), MPI.COMM_WORLD)
    film = dea.Material(dea.NeoHookean(args.mu), dea.IdealDielectric(args.permittivity))
    # The inner and the outer face carry the electrode of the winding too, so that all layers work.
    grounds = [dea.Ground(name) for name in ("winding", "inner", "outer")]
    return dea.Scene(
        device, {"film": film}, supports=[dea.FreeBody()],
        electrodes=[dea.Electrode("interface_1", args.voltage), *grounds],
        kinematics=dea.GeneralisedPlaneStrain(args.height),
    )  # fmt: skip


def many_layers(args):
    """Stretch along the axis of a roll of very many layers."""
    A, mu, eps = args.inner, args.mu, args.permittivity * EPSILON_0
    B = A + 2 * args.turns * args.layer
    nodes, weights = np.polynomial.legendre.leggauss(40)
    R, w = A + (nodes + 1) * (B - A) / 2, weights * (B - A) / 2

    def residual(x):
        """Jump of the stress along r over the wall, and the axial force; both without a unit."""
        a, stretch = x[0] * A, x[1]
        b = np.sqrt(a**2 + (B**2 - A**2) / stretch)
        r = np.sqrt(a**2 + (R**2 - A**2) / stretch)
        thinner = R / (r * stretch)
        electric = eps * (args.voltage / (args.layer * thinner)) ** 2
        hoop = (mu * ((r / R) ** 2 - thinner**2) - electric) / r  # slope of the stress along r
        axial = mu * (stretch**2 - thinner**2) - electric  # beyond the stress along r
        dr = w * thinner
        # the integral of the stress along r over the section, by parts
        force = (axial * r) @ dr + (hoop * (b**2 - r**2) / 2) @ dr
        return hoop @ dr / mu, 2 * force / (mu * (B**2 - A**2))

    return float(fsolve(residual, (1.0, 1.0), xtol=1e-13)[1])


def main():
    parser, args = parse()
    record = {"stretch": dea.OverallStretch(), "capacitance": dea.Capacitance("interface_1")}
    run = dea.solve(
        scene(args), dea.Ramp("voltage", steps=args.steps), record, out=args.out,
        resume=args.resume, quiet=args.quiet, settings=parser.settings(args),
    )  # fmt: skip
    strain, limit = run["stretch"] - 1, many_layers(args) - 1
    run.add(
        axial_strain=strain, axial_strain_of_many_layers=limit,
        relative_difference=strain / limit - 1, stroke_m=strain * args.height,
    )  # fmt: skip
    if MPI.COMM_WORLD.rank == 0:
        say = (lambda text: None) if args.quiet else print
        say(f"stroke {1e3 * strain * args.height:.3f} mm, {100 * strain:.3f} % of the length; a "
            f"roll of many thin layers {100 * limit:.3f} %")  # fmt: skip
        say(f"capacitance {1e9 * run['capacitance_F']:.3f} nF")
        dea.pictures.curve(run.out, "voltage_V", "stretch")
        dea.pictures.deformed(run.out, say=say)


if __name__ == "__main__":
    main()
