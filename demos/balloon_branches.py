"""A thick balloon under voltage: its round branch over the maximum and the minimum of the voltage.

A hollow sphere of Gent rubber with electrodes on both faces grows under voltage up to a maximum.
Beyond it the round states go on at falling voltages to a minimum, where the chains begin to lock
up.  Other branches leave the round one on the way: first one (--part whole) on which the cavity
leaves the centre, just before the maximum, then one with the shape of an egg, and ever shorter
waves.  Near the minimum all of them come back at nearly the same voltage.  The trace stays on the
round branch.

Dimensionless: radii over the inner radius A, voltages over A sqrt(mu/eps).  The round states, and
those at which shapes with the Legendre polynomial P_n leave them, are known exactly (see
exact.RoundBalloon).  The first one on the section that is solved is located, its branch is entered
by a short step, and the change of the inner face tells its number n.

    python demos/balloon_branches.py
    python demos/balloon_branches.py --outer 1.5
    python demos/balloon_branches.py --part whole
"""

import numpy as np
from mpi4py import MPI
from numpy.polynomial import legendre

import dea_fenicsx as dea
from dea_fenicsx import exact
from dea_fenicsx.geometry import HollowSphere
from dea_fenicsx.materials import EPSILON_0

EPS_R = 4.0
PLACES = 9
"""Number of places on the inner face from the equator to a pole."""

MOST_WAVES = 8
"""Highest Legendre polynomial that is looked for."""


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/balloon_branches")
    parser.number("--outer", 1.2, "A", "outer radius of the undeformed wall")
    parser.number("--chains", 50.0, "1", "value of I1 - 3 at which the chains lock up, J_m")
    parser.number("--radius", 1e-3, "m", "undeformed inner radius A")
    parser.number("--mu", 1e5, "Pa", "shear modulus")
    parser.add_argument(
        "--part", choices=("half", "whole"), default="half",
        help="section with an equator, which only even n leave, or whole section",
    )  # fmt: skip
    parser.count("--layers", 2, "cells through the wall")
    parser.count("--cells", 8, "cells from the equator to a pole")
    return parser, parser.parse_args()


def rubber(args):
    return dea.Material(dea.Gent(args.mu, args.chains), dea.IdealDielectric(EPS_R))


def unit_volts(args):
    """A sqrt(mu/eps) in V."""
    return args.radius * np.sqrt(args.mu / (EPS_R * EPSILON_0))


def scene(args, volts):
    """The balloon, whose voltage is `volts` at a load factor of 1."""
    A, B = args.radius, args.outer * args.radius
    mesh = HollowSphere(A, B, args.part, args.layers, args.cells)
    half = args.part == "half"
    return dea.Scene(
        dea.device(mesh, MPI.COMM_WORLD),
        {"wall": rubber(args)},
        electrodes=[dea.Electrode("inner", volts), dea.Ground("outer")],
        supports=[dea.Fix("axis", "r"), dea.Fix("equator", "z") if half else dea.FreeBody()],
        kinematics=dea.Axisymmetric(),
    )


def angles(args):
    """Angles from the axis of some nodes of the inner face, as many as the mesh has."""
    places = min(PLACES, 2 * args.cells + 1)
    quarter = np.linspace(0, np.pi / 2, places)
    nodes = np.linspace(0, np.pi / 2, 2 * args.cells + 1)
    chosen = nodes[np.unique([np.argmin(abs(nodes - angle)) for angle in quarter])]
    return chosen if args.part == "half" else np.append(chosen, np.pi - chosen[-2::-1])


def observables(args):
    """Displacements at these places, and at the equator."""
    found = {"equator": dea.AtPoint((args.radius, 0), "displacement", "r")}
    for k, angle in enumerate(angles(args)):
        point = args.radius * np.sin(angle), args.radius * np.cos(angle)
        for axis in "rz":
            found[f"{axis}_{k}"] = dea.AtPoint(point, "displacement", axis)
    return found


def outwards(args, row):
    """Displacements away from the centre at the places on the inner face, in m."""
    return np.array([
        np.sin(t) * row[f"r_{k}_m"] + np.cos(t) * row[f"z_{k}_m"]
        for k, t in enumerate(angles(args))
    ])  # fmt: skip


def first_bifurcation(args, sphere, volts, largest):
    """Radius over A and number n of the first bifurcation up to an inner radius; None without."""
    path = dea.Trace(
        "voltage", steps=22, until=("equator_m", largest - args.radius), longest=2.0, switch=0.05
    )
    try:
        run = dea.solve(scene(args, volts), path, observables(args), quiet=True, stability="every")
    except dea.DeaError as end:
        run = getattr(end, "run", None)
        if run is None:
            raise
    rows = run.history
    found = [k for k, row in enumerate(rows[:-1]) if row["event"] == "bifurcation"]
    if not found:
        return None, None
    here = rows[found[0]]
    change = outwards(args, rows[found[0] + 1]) - outwards(args, here)
    polynomials = legendre.legvander(np.cos(angles(args)), MOST_WAVES)
    numbers = np.arange(MOST_WAVES + 1)
    if args.part == "half":
        polynomials, numbers = polynomials[:, ::2], numbers[::2]
    shares = np.linalg.lstsq(polynomials, change, rcond=None)[0]
    shares[0] = 0.0
    return 1 + here["equator_m"] / args.radius, int(numbers[np.argmax(abs(shares))])


def main():
    parser, args = parse()
    if args.outer <= 1:
        parser.error("--outer must be above 1")
    sphere = exact.RoundBalloon(args.radius, args.outer * args.radius, rubber(args))
    locked = args.radius * np.sqrt((args.chains + 3) / 2)
    limits = sphere.limits(0.98 * locked)
    if len(limits) < 2:
        parser.error("with these --outer and --chains the voltage has no maximum and minimum")
    unit, maximum, minimum = unit_volts(args), limits[0], limits[1]
    path = dea.Trace(
        "voltage", steps=400, until=("equator_m", 1.03 * minimum.radius - args.radius)
    )
    run = dea.solve(
        scene(args, maximum.volts), path, observables(args), out=args.out, resume=args.resume,
        quiet=args.quiet, stability="never", settings=parser.settings(args),
    )  # fmt: skip
    found = {row["event"]: row["voltage_V"] / unit for row in run.history if row["event"]}
    shapes = (2, 4) if args.part == "half" else (1, 2)
    leaves = [c for c in sphere.shape_changes(1.3 * maximum.radius, shapes) if c.loses]
    radius, number = None, None
    if leaves:
        far = leaves[0].state.radius + 0.04 * args.radius
        radius, number = first_bifurcation(args, sphere, maximum.volts, far)
    run.add(
        maximum_voltage=found.get("maximum"),
        minimum_voltage=found.get("minimum"),
        exact_maximum=maximum.volts / unit,
        exact_minimum=minimum.volts / unit,
        first_bifurcation_radius=radius,
        first_bifurcation_mode=number,
        exact_bifurcation_radius=leaves[0].state.radius / args.radius if leaves else None,
        exact_bifurcation_mode=leaves[0].mode if leaves else None,
    )
    if MPI.COMM_WORLD.rank == 0 and not args.quiet:
        report(run)


def report(run):
    s = run.summary
    print("\n               found       exact")
    for name in ("maximum", "minimum"):
        value = s[f"{name}_voltage"]
        print(f"{name} V:  {value:.7f}   {s[f'exact_{name}']:.7f}")
    if s["first_bifurcation_radius"]:
        print(
            f"first branch:  n = {s['first_bifurcation_mode']} at a = "
            f"{s['first_bifurcation_radius']:.5f}   (exact: n = {s['exact_bifurcation_mode']} at "
            f"{s['exact_bifurcation_radius']:.5f})"
        )
    print(f"\nresults: {run.out}/history.csv, fields.xdmf")


if __name__ == "__main__":
    main()
