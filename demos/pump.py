"""A membrane pump: a round film on a chamber of liquid or gas, over a cycle of the voltage.

The film is clamped at its rim and closes a chamber that is not meshed: its flat floor lies in the
plane of the rim.  Liquid bulges the film.  Under voltage the film is softer, so the same liquid has
a lower pressure.  One cycle has four legs:

    1  voltage on, valves closed         the pressure falls
    2  inlet open, liquid flows in       by the stroke volume, at a low pressure
    3  voltage off, valves closed        the pressure rises
    4  outlet open, liquid flows out     at a high pressure

The work on the liquid, the area of the loop of pressure over volume, is the electrical work that
goes in: - int P dV = int U dQ over the cycle, since nothing is lost.

With --content gas the chamber is closed, and the film on it breathes as the voltage goes on and
off; then pressure times volume stays, (p0 + P) V = n.

    python demos/pump.py
    python demos/pump.py --content gas --voltage 4000
"""

from itertools import pairwise

import numpy as np
from mpi4py import MPI
from scipy.integrate import simpson

import dea_fenicsx as dea
from dea_fenicsx.geometry import MembraneDisc


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/pump")
    parser.add_argument("--content", choices=("liquid", "gas"), default="liquid",
                        help="what is in the chamber")  # fmt: skip
    parser.number("--mu", 50e3, "Pa", "shear modulus")
    parser.number("--radius", 10e-3, "m", "radius of the film between its clamps")
    parser.number("--thickness", 0.5e-3, "m", "thickness of the film")
    parser.number("--voltage", 5000.0, "V", "voltage on the film")
    parser.number("--fill", 0.5e-6, "m^3", "volume under the film without voltage")
    parser.number("--stroke", 0.2e-6, "m^3", "liquid that is pumped in a cycle")
    parser.number("--chamber", 2e-6, "m^3", "rigid volume of the chamber, for gas")
    parser.number("--outside-pressure", 101325.0, "Pa", "pressure outside, for gas")
    parser.count("--steps", 6, "steps of each leg, an even number")
    parser.count("--mesh", 1, "refinement of the mesh")
    return parser, parser.parse_args()


def scene(args):
    """The film on its chamber; ramp factor 1 of "fill" is the state before the cycle."""
    disc = MembraneDisc(args.radius, 0.9 * args.radius, args.thickness, cells=(8, 1, 3), grading=2)
    device = dea.device(disc.refine(args.mesh), MPI.COMM_WORLD)
    rubber = dea.Material(dea.Gent(args.mu, 80.0), dea.IdealDielectric(3.0))
    if args.content == "liquid":
        chamber = dea.Cavity("bottom", liquid=args.fill, ramp="fill")
    else:
        # at its usual pressure this gas lifts the film by about as much as the liquid does
        added = args.fill * args.outside_pressure
        chamber = dea.Cavity("bottom", gas=added, outside=args.outside_pressure,
                             reservoir=args.chamber, ramp="fill")  # fmt: skip
    return dea.Scene(
        device,
        dict.fromkeys(("active", "passive"), rubber),
        electrodes=[dea.Electrode("top_active", args.voltage), dea.Ground("bottom")],
        supports=[dea.Clamp("rim"), dea.Fix("axis", "r")],
        loads=[chamber],
        kinematics=dea.Axisymmetric(),
    )


def cycle(args):
    """The legs of the cycle, each a ramp and its end: the factors of the filling and voltage."""
    fuller = 1 + args.stroke / args.fill
    if args.content == "gas":
        return [("voltage", 1.0, (1.0, 1.0)), ("voltage", 0.0, (1.0, 0.0))]
    return [
        ("voltage", 1.0, (1.0, 1.0)), ("fill", fuller, (fuller, 1.0)),
        ("voltage", 0.0, (fuller, 0.0)), ("fill", 1.0, (1.0, 0.0)),
    ]  # fmt: skip


def main():
    parser, args = parse()
    if args.steps % 2 or args.fill <= 0 or args.stroke <= 0 or args.voltage == 0:
        parser.error("--steps must be even, --fill and --stroke above 0, and --voltage not 0")
    legs = cycle(args)
    run = dea.solve(
        scene(args),
        [dea.Ramp("fill", steps=6), *(dea.Ramp(what, to, args.steps) for what, to, _ in legs)],
        {
            "pressure": dea.CavityPressure("bottom"),
            "chamber": dea.CavityVolume("bottom"),
            "charge": dea.Charge("top_active"),
            "height": dea.LargestDisplacement("top_active", "z"),
        },
        out=args.out,
        resume=args.resume,
        quiet=args.quiet,
        settings=parser.settings(args),
    )
    run.add(**findings(args, run, legs))
    if MPI.COMM_WORLD.rank == 0:
        dea.pictures.curve(args.out, x="chamber_m3", y="pressure_Pa")
        if not args.quiet:
            report(run)


def corners(args, run, legs):
    """The rows of the history at which the legs begin and end."""
    here = np.column_stack([run.column("fill_factor"), run.column("voltage_V") / args.voltage])
    found, k = [], 0
    for goal in [(1.0, 0.0), *(end for _, _, end in legs)]:
        k += int(np.argmax(np.abs(here[k:] - goal).max(axis=1) < 1e-9))
        found.append(k)
        k += 1
    return found


def integral(y, x, at):
    """int y dx over the legs, each by Simpson's rule."""
    return sum(float(simpson(y[i : j + 1], x=x[i : j + 1])) for i, j in pairwise(at))


def findings(args, run, legs):
    at = corners(args, run, legs)
    P, V = run.column("pressure_Pa"), run.column("chamber_m3")
    U, Q = run.column("voltage_V"), run.column("charge_C")
    first, last = at[0], at[-1]
    found = {
        "stroke_volume_m3": float(np.ptp(V[first:])),
        "pressure_low_Pa": float(P[first:].min()),
        "pressure_high_Pa": float(P[first:].max()),
        "pressure_before_cycle_Pa": float(P[first]),
        "closed_within": float(abs(P[last] / P[first] - 1)),
        "work_on_liquid_J": None, "electric_work_J": None, "energy_error": None,
        "gas_law_error": None,
    }  # fmt: skip
    if args.content == "liquid":
        pumped = -integral(P, V, at)
        # int U dQ of a closed cycle; Q changes from row to row as smoothly as U does
        fed = -integral(Q, U, at)
        found |= {"work_on_liquid_J": pumped, "electric_work_J": fed,
                  "energy_error": abs(pumped / fed - 1)}  # fmt: skip
    else:
        amount = (args.outside_pressure + P) * (V + args.chamber)
        found["gas_law_error"] = float(np.abs(amount[first:] / amount[first] - 1).max())
    return found


def report(run):
    s = run.summary
    print(f"\npressure before the cycle {s['pressure_before_cycle_Pa']:.1f} Pa; in it from "
          f"{s['pressure_low_Pa']:.1f} to {s['pressure_high_Pa']:.1f} Pa")  # fmt: skip
    print(f"stroke volume {s['stroke_volume_m3'] * 1e9:.2f} mm^3")
    if s["work_on_liquid_J"] is not None:
        print(f"work on the liquid {s['work_on_liquid_J'] * 1e6:.4f} uJ, electrical work "
              f"{s['electric_work_J'] * 1e6:.4f} uJ")  # fmt: skip
    else:
        print(f"(p0 + P) V is constant to {s['gas_law_error']:.1e}")
    print(f"\nresults: {run.out}/history.csv, pressure_chamber.png, fields.xdmf")


if __name__ == "__main__":
    main()
