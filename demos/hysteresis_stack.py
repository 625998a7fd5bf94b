"""A stack of viscous layers under a cyclic voltage: the loop of contraction over voltage.

The branches of the rubber lag behind the voltage, so that contraction depends on what was before.
What the source puts in over a cycle and does not get back is the area of the loop of charge over
voltage; it has become heat.  The loop is wide where a cycle takes about a relaxation time, and
narrow where it takes much less or much more.

Every layer of the free stack is in the same state, for which dea.exact solves an ordinary
differential equation: a short column stands for the stack, and both must agree.

Constants: Wang, Decker, Henann, Chester, J. Mech. Phys. Solids 95 (2016) 213.

    python demos/hysteresis_stack.py
    python demos/hysteresis_stack.py --hertz 1 --cycles 5
"""

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.exact import Film, march
from dea_fenicsx.geometry import BoxStack, Layer

BRANCHES = ((26.06e3, 0.6074), (26.53e3, 6.56), (10.83e3, 61.25))
"""Shear modulus in Pa and relaxation time in s of each branch."""

OTHERS = (0.1, 10.0)
"""Other frequencies whose exact loops are drawn, in units of the one that is asked for."""


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/hysteresis_stack")
    parser.number("--mu", 15.36e3, "Pa", "equilibrium shear modulus")
    parser.number("--thickness", 0.5e-3, "m", "thickness of a layer")
    parser.count("--layers", 2, "layers of the column")
    parser.number("--voltage", 6000.0, "V", "largest voltage")
    parser.number("--hertz", 0.1, "1/s", "frequency of the triangle between 0 V and that voltage")
    parser.count("--cycles", 3, "cycles")
    parser.number("--tolerance", 1e-5, "-", "largest error of a step in the viscous strains")
    return parser, parser.parse_args()


def triangle(hertz, volts=1.0):
    """From 0 up and down again."""
    return dea.Triangle(hertz, amplitude=volts / 2, mean=volts / 2, phase=-np.pi / 2)


def stack(args, film):
    layers = [Layer("film", args.thickness) for _ in range(args.layers)]
    faces = ["bottom", *(f"interface_{k}" for k in range(1, args.layers)), "top"]
    column = BoxStack(args.thickness, None, layers, divisions=1)
    scene = dea.Scene(
        dea.device(column, MPI.COMM_WORLD),
        {"film": film},
        electrodes=[dea.Electrode(tuple(faces[1::2]), args.voltage), dea.Ground(tuple(faces[::2]))],
        supports=[dea.Fix("bottom", "z"), dea.Fix("x_min", "r")],
        kinematics=dea.Axisymmetric(),
    )
    return scene, dea.Charge("+".join(faces[1::2]))


def main():
    parser, args = parse()
    if args.layers < 1 or args.cycles < 1:
        raise dea.InputError("--layers and --cycles must be at least 1.")
    film = dea.Material(
        dea.ArrudaBoyce(args.mu, 5.99, form="pade"), dea.IdealDielectric(4.8),
        viscous=[dea.Maxwell(mu, tau) for mu, tau in BRANCHES],
    )  # fmt: skip
    scene, charge = stack(args, film)
    seconds = args.cycles / args.hertz
    run = dea.solve(
        scene,
        dea.March(seconds, {"voltage": triangle(args.hertz)}, tolerance=args.tolerance),
        {"contraction": dea.Contraction(("bottom", "top"), "z"), "charge": charge},
        out=args.out,
        resume=args.resume,
        quiet=args.quiet,
        stability="never",
        settings=parser.settings(args),
    )
    exact = march(Film(film, args.thickness), seconds, voltage=triangle(args.hertz, args.voltage))
    time, contraction = run.column("time_s"), run.column("contraction")
    due = 1 - exact.at(time).stretches[2]
    volume = np.pi * args.thickness**3 * args.layers
    balance = exact.balance()
    last = (args.cycles - 1) / args.hertz
    before = np.interp(last, balance.time, balance.electric_work)  # a corner of the drive
    run.add(
        largest_contraction=float(contraction.max()),
        contraction_left_after_last_cycle=float(contraction[-1]),
        max_contraction_error=float(np.abs(contraction - due).max()),
        loss_of_last_cycle_J=loss(run, last),
        exact_loss_of_last_cycle_J=float((balance.electric_work[-1] - before) * volume),
    )
    if MPI.COMM_WORLD.rank == 0:
        draw(args, film, exact)
        if not args.quiet:
            report(args, run)


def loss(run, since):
    """What the source puts in from a time on: the integral of voltage over charge, in J."""
    late = run.column("time_s") >= since * (1 - 1e-9)
    volts, charge = run.column("voltage_V")[late], run.column("charge_C")[late]
    return float(np.sum((volts[1:] + volts[:-1]) / 2 * np.diff(charge)))


def draw(args, film, exact):
    """The loop, beside the exact one and those of other frequencies."""
    lines = {}
    for share in (1.0, *OTHERS):
        hertz = share * args.hertz
        course = exact if share == 1 else march(
            Film(film, args.thickness), args.cycles / hertz, voltage=triangle(hertz, args.voltage)
        )  # fmt: skip
        cycle = course.at(np.linspace((args.cycles - 1) / hertz, args.cycles / hertz, 200))
        lines[f"exact, {hertz:g} Hz, last cycle"] = 1 - cycle.stretches[2], cycle.voltage
    dea.pictures.curve(args.out, x="contraction", y="voltage_V", labels=["finite elements"],
                       lines=lines)  # fmt: skip


def report(args, run):
    s = run.summary
    print(f"\nlargest contraction {100 * s['largest_contraction']:.3f} %; after the last cycle "
          f"{100 * s['contraction_left_after_last_cycle']:.3f} % are left")  # fmt: skip
    print(f"largest error of the contraction against the exact state: "
          f"{s['max_contraction_error']:.1e}")  # fmt: skip
    print(f"lost in the last cycle: {1e6 * s['loss_of_last_cycle_J']:.6f} uJ, exact "
          f"{1e6 * s['exact_loss_of_last_cycle_J']:.6f} uJ")  # fmt: skip
    print(f"\nresults: {run.out}/history.csv, voltage_contraction.png, fields.xdmf")


if __name__ == "__main__":
    main()
