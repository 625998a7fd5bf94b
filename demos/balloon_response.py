"""A thick balloon with a viscous branch under a small oscillating pressure: modulus and phase.

The wall is neo-Hookean with one Maxwell branch, and the balloon is at rest.  The answer of its
inner radius a to a pressure P cos(omega t) is known (inner radius A, outer radius B):

    da/dP = 1/(K mu*(omega) - M omega^2),   mu* = 1 + g i omega tau/(1 + i omega tau),
    K = 4 mu (1/A - A^2/B^3),   M = rho A (1 - A/B),

with g the modulus of the branch over that of the spring.  Everything is dimensionless: mu = 1 (in
Pa), rho = 1, A = 1.
"""

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import HollowSphere
from dea_fenicsx.materials import EPSILON_0


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/balloon_response")
    parser.number("--omega", 1.0, "-", "angular frequency in units of sqrt(mu/rho)/A, mu in Pa")
    parser.number("--outer", 1.2, "-", "outer radius over inner radius")
    parser.number("--branch", 1.5, "-", "modulus of the branch over that of the spring")
    parser.number("--tau", 0.5, "-", "relaxation time of the branch in units of A sqrt(rho/mu)")
    parser.count("--radial", 3, "cells through the wall")
    parser.count("--around", 8, "cells over a right angle")
    return parser, parser.parse_args()


def closed_form(args, omega):
    """Complex da/dP at an angular frequency."""
    i, B = 1j * omega * args.tau, args.outer
    modulus = 1 + args.branch * i / (1 + i)
    return 1 / (4 * (1 - B**-3) * modulus - (1 - 1 / B) * omega**2)


def main():
    parser, args = parse()
    wall = dea.Material(
        dea.NeoHookean(1.0), dea.IdealDielectric(1 / EPSILON_0), density=1.0,
        viscous=[dea.Maxwell(args.branch, args.tau)],
    )  # fmt: skip
    sphere = HollowSphere(1.0, args.outer, layers=args.radial, cells=args.around)
    scene = dea.Scene(
        dea.device(sphere, MPI.COMM_WORLD),
        {"wall": wall},
        supports=[dea.Fix("axis", "r"), dea.Fix("equator", "z")],
        loads=[dea.FollowerPressure("inner", 1.0)],
        kinematics=dea.Axisymmetric(),
    )
    radius = {"radius": dea.AtPoint((1.0, 0.0), "displacement", "r")}
    rest = dea.solve(
        scene, dea.Ramp("load", to=0.0, steps=1, response="relaxed"), radius, out=args.out,
        resume=args.resume, quiet=args.quiet, settings=parser.settings(args),
    )  # fmt: skip
    omegas = args.omega * np.geomspace(0.25, 4, 9)  # the one in the middle is that of --omega
    found = dea.frequency_response(rest, omegas / (2 * np.pi), "load", radius)
    exact = closed_form(args, args.omega)
    modulus, phase = found.modulus("radius_m"), found.phase_deg("radius_m")
    rest.add(
        modulus=float(modulus[4]),
        phase_deg=float(phase[4]),
        closed_form_modulus=float(abs(exact)),
        closed_form_phase_deg=float(np.degrees(np.angle(exact))),
    )
    if MPI.COMM_WORLD.rank == 0:
        found.write(rest.out / "response.csv")
        draw(rest.out / "response.png", args, omegas, modulus, phase)
        if not args.quiet:
            angle = np.degrees(np.angle(exact))
            print(f"\nomega {args.omega:g}: modulus {modulus[4]:.7f} (exact {abs(exact):.7f}), "
                  f"phase {phase[4]:.4f} degrees (exact {angle:.4f})")  # fmt: skip
            print(f"results: {rest.out}/response.csv, {rest.out}/response.png")


def draw(path, args, omegas, modulus, phase):
    """Modulus and phase of the radius over the frequency, computed and exact."""
    fine = np.geomspace(omegas[0], omegas[-1], 200)
    exact = closed_form(args, fine)
    figure = Figure(figsize=(6, 4.5), layout="constrained")
    upper, lower = figure.subplots(2, sharex=True)
    upper.semilogx(fine, abs(exact), "k-", label="exact")
    upper.semilogx(omegas, modulus, "o", label="finite elements")
    upper.set_ylabel("amplitude da/dP (-)")
    upper.legend()
    lower.semilogx(fine, np.degrees(np.unwrap(np.angle(exact))), "k-")
    lower.semilogx(omegas, phase, "o")
    lower.set_ylabel("phase (degrees)")
    lower.set_xlabel("angular frequency in units of sqrt(mu/rho)/A")
    lower.set_xticks(omegas[::2], [f"{omega:.3g}" for omega in omegas[::2]])
    lower.set_xticks([], minor=True)
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    main()
