"""Folding and zipping: parts that move freely at first, and then meet something.

``--case storey``: a storey of a Kresling box with three sides, whose upper polygon is pushed down
and turns freely.  Its panels fold inwards until they meet a rod that stands on the axis, and are
pushed on past that.  It is solved with the rod and without it: the difference of the forces is what
the contact changes.  The rod is rigid and without friction.  Panels that meet each other are not
modelled: three creases would meet on the axis at once, and before that the panels bow aside.  At a
stroke of 7.5 mm the state with all three creases on the rod is not stable any more.

``--case zip``: a film with an electrode below hangs over a grounded electrode with a layer of
insulator on it; the air between is meshed.  Half of it is modelled: it is clamped at x = 0, the
plane of symmetry is at x = L.  Three things are found:

  - the voltage at which the free film is lost to the electrode (pull-in);
  - the film pressed down, held by the full voltage and left alone: how far it is zipped.  The
    charge is compared with that of a beam with the free length s that makes
    6 D g^2/s^3 - V^2 C(s)/2 smallest, D = mu h^3/3, where C counts the gap, too;
  - the voltage at which it lets go again, far below pull-in.

No search for contact is made there: the air is squeezed to almost nothing and carries the pressure.

Run it with `mpirun -n 2 python demos/zipping_or_folding.py`.
"""

from pathlib import Path

import numpy as np
from mpi4py import MPI
from scipy.integrate import quad

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, KreslingCell, Layer
from dea_fenicsx.materials import EPSILON_0, bulk_modulus_of

MU, EPS_R, DEPTH = 1e6, 3.0, 1e-3  # Pa, -, m
LENGTH, FILM, INSULATOR = 1e-3, 60e-6, 20e-6  # m

SIDES, SIDE, HEIGHT, TWIST = 3, 54e-3, 30e-3, np.radians(42.0)  # of the storey; m and rad
PANEL, HINGE = 0.5e-3, 2e-3  # thickness of the panels, width of the hinges, m
PETG, NU, RUBBER = 2.1e9, 0.38, 100e6  # Young's moduli of panels and hinges in Pa
MESH = {"along": 2, "tip": 1, "strip": 1, "through": 1, "relief": 0.2}


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/zipping_or_folding")
    parser.add_argument("--case", choices=("storey", "zip"), default="storey", help="what to solve")
    parser.number("--stroke", 7e-3, "m", "storey: how far its upper polygon is pushed down")
    parser.number("--rod", 3.6e-3, "m", "storey: radius of the rod on its axis")
    parser.count("--steps", 10, "storey: steps of the stroke")
    parser.number("--voltage", 100.0, "V", "zip: voltage that holds the film")
    parser.number("--gap", 30e-6, "m", "zip: thickness of the air between film and insulator")
    parser.number("--push", 150.0, "Pa", "zip: pressure that brings the film down before")
    parser.number("--stiffness", 1e-9, "-",
                  "zip: shear modulus of the air over that of the film")  # fmt: skip
    parser.count("--mesh", 12, "zip: cells along the film")
    return parser, parser.parse_args()


def make_scene(args, comm, volts):
    layers = [Layer("insulator", INSULATOR), Layer("gap", args.gap, 2), Layer("film", FILM)]
    strip = BoxStack(LENGTH, None, layers, divisions=args.mesh, order=1)
    rubber = dea.NeoHookean(MU)
    return dea.Scene(
        dea.read_gmsh(strip, comm),
        materials={
            "insulator": dea.Material(rubber, dea.IdealDielectric(EPS_R)),
            "gap": dea.Air(stiffness=args.stiffness),
            "film": dea.Material(rubber),
        },
        electrodes=[dea.Ground("bottom"), dea.Electrode("interface_2", volts)],
        supports=[dea.Clamp("bottom"), dea.Clamp("x_min"), dea.Fix("x_max", "x")],
        loads=[dea.DeadLoad("top", (0.0, -args.push), ramp="push")],
        kinematics=dea.PlaneStrain(DEPTH),
    )


def lost_at(scene, path, **options):
    """The voltage at which a ramp loses its equilibrium, or None if it does not."""
    try:
        dea.solve(scene, path, quiet=True, **options)
    except dea.EquilibriumLost as lost:
        return lost.reached["voltage"] * scene.reference_voltage("voltage")
    return None


def beam(args):
    """Zipped length in m and charge in C of the beam on its clamped support."""
    ratio = EPS_R * args.gap / INSULATOR
    share = quad(lambda x: 1 / (1 + ratio * (3 * x**2 - 2 * x**3)), 0, 1)[0]
    areal = EPS_R * EPSILON_0 / INSULATOR  # F/m^2
    bending = MU * FILM**3 / 3  # plane strain, incompressible
    free = (36 * bending * args.gap**2 / (args.voltage**2 * areal * (1 - share))) ** 0.25
    free = min(free, LENGTH)
    return LENGTH - free, areal * args.voltage * DEPTH * (LENGTH - free * (1 - share))


def storey(args, rod, comm):
    """The storey, its lower polygon clamped and the upper one pushed down; with a rod or not."""
    cell = KreslingCell(SIDE, HEIGHT, TWIST, PANEL, HINGE, sides=SIDES, **MESH)
    mu = PETG / (2 * (1 + NU))
    petg = dea.Material(dea.NeoHookean(mu), bulk_modulus=bulk_modulus_of(mu, NU))
    rubber = dea.Material(dea.NeoHookean(RUBBER / 3))
    axis = dea.Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), args.rod)
    return dea.Scene(
        dea.read_gmsh(cell, comm),
        {"panel": petg, "side": rubber, "edge": rubber, "diagonal": rubber},
        supports=[dea.Clamp("bottom"), *([dea.Obstacle("inner", axis)] if rod else [])],
        prescribed=[dea.Displacement("top", "z", -args.stroke)],
    )


def fold(args, comm, settings):
    """Force over stroke, with the rod and without it."""
    record = {
        "stroke": dea.MeanDisplacement("top", "z"),
        "force": dea.Reaction("top", "z"),
        "twist": dea.Rotation("top", "z"),
    }
    met = {"gap": dea.ContactGap("inner"), "pressure": dea.ContactPressure("inner")}
    path = dea.Ramp("stretch", steps=args.steps, at=np.linspace(0, 1, args.steps + 1)[1:-1])
    runs = [
        dea.solve(storey(args, rod, comm), path, record | (met if rod else {}), out=out,
                  resume=args.resume, quiet=args.quiet, settings=settings)
        for rod, out in ((True, args.out), (False, Path(args.out) / "without_rod"))
    ]  # fmt: skip
    run, free = runs
    stroke, gap = -run.column("stroke_m"), run.column("gap_m")
    closed = np.flatnonzero(run.column("pressure_Pa") > 0)
    meet = None
    if len(closed):  # the gap before is continued to 0
        k = max(int(closed[0]) - 1, 1)
        meet = stroke[k] + gap[k] * (stroke[k] - stroke[k - 1]) / (gap[k - 1] - gap[k])
    loose = -np.interp(stroke[-1], -free.column("stroke_m"), free.column("force_N"))
    run.add(
        case="storey",
        panels_meet_at_stroke_m=meet,
        stroke_reached_m=stroke[-1],
        force_at_stroke_N=-run["force_N"],
        force_without_contact_N=loose,
        contact_changes_force_by=-run["force_N"] / loose - 1,
        twist_at_stroke_deg=float(np.degrees(run["twist_rad"])),
        twist_without_contact_deg=float(np.degrees(free["twist_rad"])),
        **dict.fromkeys(ZIP_KEYS),
    )
    if comm.rank == 0 and not args.quiet:
        told = "do not meet the rod" if meet is None else f"meet the rod at {meet * 1e3:.2f} mm"
        print(f"\nthe panels {told}; at {stroke[-1] * 1e3:.2f} mm the force is "
              f"{-run['force_N']:.2f} N, without the rod {loose:.2f} N")
        print(f"results: {run.out}/history.csv, without_rod/history.csv, fields.xdmf")  # fmt: skip


ZIP_KEYS = ("pull_in_voltage_V", "release_voltage_V", "gap_closed", "charge_when_zipped_C",
            "beam_charge_C", "beam_zipped_length_m", "air_energy_share")  # fmt: skip


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    solve = fold if args.case == "storey" else zip_down
    solve(args, comm, parser.settings(args))


def zip_down(args, comm, settings):
    """The film pressed down and left alone, its pull-in and its release."""
    scene = make_scene(args, comm, args.voltage)
    run = dea.solve(
        scene,
        [dea.Ramp("push", steps=5), dea.Ramp("voltage", steps=3),
         dea.Ramp("push", to=0.0, steps=2)],
        record={
            "deflection": dea.LargestDisplacement("interface_2", "y"),
            "charge": dea.Charge("interface_2"),
            "air": dea.Energy("air"),
            "elastic": dea.Energy("elastic"),
        },
        out=args.out,
        resume=args.resume,
        quiet=args.quiet,
        settings=settings,
    )  # fmt: skip
    pull_in = lost_at(scene, dea.Ramp("voltage", steps=3))
    release = lost_at(scene, dea.Ramp("voltage", to=0.0, steps=3), start=run)
    zipped, charge = beam(args)
    run.add(
        case="zip",
        pull_in_voltage_V=pull_in,
        release_voltage_V=release,
        gap_closed=-run["deflection_m"] / args.gap,
        charge_when_zipped_C=run["charge_C"],
        beam_charge_C=charge,
        beam_zipped_length_m=zipped,
        air_energy_share=run["air_J"] / run["elastic_J"],
    )
    if comm.rank == 0 and not args.quiet:
        print(f"\nzipped at {args.voltage:g} V: charge {run['charge_C']:.4e} C, of a beam "
              f"{charge:.4e} C, zipped over {zipped * 1e3:.2f} mm of {LENGTH * 1e3:g} mm")
        print(f"pull-in at {pull_in if pull_in is None else round(pull_in, 2)} V, release at "
              f"{release if release is None else round(release, 2)} V")
        print(f"the air takes {run['air_J'] / run['elastic_J']:.1%} of the elastic energy")
        print(f"results: {run.out}/history.csv")  # fmt: skip


if __name__ == "__main__":
    main()
