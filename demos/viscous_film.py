"""A viscous film under a rising or a constant field, to its pull-in in time.

A free film of VHB 4910 (an equilibrium network of Arruda and Boyce beside three Maxwell branches)
is driven by a nominal field that grows at a constant rate (--rate), or by one that is switched on
and stays (--field).  The film creeps, ever faster, until no equilibrium is left.  All of it is in
the same state, for which dea.exact solves an ordinary differential equation.

Fields are in units of sqrt(G/eps), with G the equilibrium modulus; rates are those per second.

Constants: Wang, Decker, Henann, Chester, J. Mech. Phys. Solids 95 (2016) 213.

    python demos/viscous_film.py --rate 0.016
    python demos/viscous_film.py --field 0.9 --mesh 2
"""

import gmsh
import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.exact import Film, instantaneous, march, relaxed, trace
from dea_fenicsx.geometry import BoxStack, Layer

BRANCHES = ((26.06e3, 0.6074), (26.53e3, 6.56), (10.83e3, 61.25))
"""Shear modulus in Pa and relaxation time in s of each branch, for G = 15.36 kPa."""

LONGEST = 1e4
"""How long a constant field is watched, in units of the longest relaxation time."""

COMPARED = 0.9
"""Share of the pull-in time up to which the stretch is compared: then its rate is infinite."""


class Tetrahedra:
    """The film as an unstructured mesh of tetrahedra."""

    def __init__(self, size):
        self.size = size

    def build(self):
        if not gmsh.isInitialized():
            gmsh.initialize(interruptible=False)
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("film")
        gmsh.model.occ.addBox(0, 0, 0, *3 * [self.size])
        gmsh.model.occ.synchronize()
        names = ["x_min", "x_max", "y_min", "y_max", "bottom", "top"]
        for k, name in enumerate(names, start=1):
            gmsh.model.addPhysicalGroup(2, [k], name=name)
        gmsh.model.addPhysicalGroup(3, [1], name="film")
        gmsh.model.mesh.setSize(gmsh.model.getEntities(0), self.size)
        gmsh.model.mesh.generate(3)
        return gmsh.model


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/viscous_film")
    parser.number("--rate", None, "1/s", "rate of the nominal field, in units of sqrt(G/eps)")
    parser.number("--field", None, "-", "constant nominal field, in units of sqrt(G/eps)")
    parser.count("--mesh", 1, "1 for one hexahedron, 2 for tetrahedra of any shape", (1, 2))
    parser.number("--tolerance", 1e-8, "-", "largest error of a step in the viscous strains")
    parser.number("--mu", 15.36e3, "Pa", "equilibrium shear modulus G; the branches go with it")
    parser.number("--thickness", 1e-3, "m", "thickness of the film")
    return parser, parser.parse_args()


def main():
    parser, args = parse()
    if (args.rate is None) == (args.field is None):
        raise dea.InputError(
            "The film needs either --rate, for a rising field, or --field, for a constant one."
        )
    T, share = args.thickness, args.mu / 15.36e3
    film = dea.Material(
        dea.ArrudaBoyce(args.mu, 5.99, form="pade"), dea.IdealDielectric(4.8),
        viscous=[dea.Maxwell(share * mu, tau) for mu, tau in BRANCHES],
    )  # fmt: skip
    exact = Film(film, T)  # refuses bad constants
    unit = T * float(np.sqrt(args.mu / exact.permittivity))  # the voltage at a field of 1
    seconds = duration(args, exact, unit)
    if args.rate is None:
        course = march(exact, seconds, voltage=args.field * unit)
        drive = dea.Constant(args.field)
    else:
        course = march(exact, seconds, voltage=dea.Rise(args.rate * seconds * unit, seconds))
        drive = dea.Rise(args.rate * seconds, seconds)
    if course.pull_in is None:
        slow = trace(relaxed(exact)).event("pull-in").voltage / unit
        raise dea.InputError(
            f"--field is {args.field:g}, under which the film does not pull in within "
            f"{seconds:.3g} s; below {slow:.5f} it never does."
        )
    path = dea.March(seconds, {"voltage": drive}, tolerance=args.tolerance, order=3)
    run = solved(parser, args, film, unit, path)
    run.add(**findings(args, run, course, unit))
    if MPI.COMM_WORLD.rank == 0:
        times = np.linspace(0, course.end_time, 500)
        lines = {"exact": (times, course.stretch(times))}
        dea.pictures.curve(args.out, x="time_s", y="stretch", lines=lines)
        if not args.quiet:
            report(args, run)


def duration(args, exact, unit):
    """How long the march lasts in s: beyond the pull-in, if there is one."""
    if args.rate is None:
        return LONGEST * max(tau for _, tau in BRANCHES)
    if not (np.isfinite(args.rate) and args.rate > 0):
        raise dea.InputError(f"--rate is {args.rate}, but must be a number > 0 in 1/s.")
    fast = trace(instantaneous(exact)).event("pull-in").voltage / unit  # no rate goes beyond it
    return 1.05 * fast / args.rate


def solved(parser, args, film, unit, path):
    """The run to its pull-in, which ends it as an error: EquilibriumLost."""
    T = args.thickness
    cell = BoxStack(T, T, [Layer("film", T)], divisions=(1, 1))
    device = dea.device(cell if args.mesh == 1 else Tetrahedra(T), MPI.COMM_WORLD)
    scene = dea.Scene(
        device,
        {"film": film},
        electrodes=[dea.Electrode("top", unit), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
    )
    try:
        dea.solve(
            scene,
            path,
            record={
                "stretch": dea.MeanStretch(("x_min", "x_max"), "x"),
                "stretch_y": dea.MeanStretch(("y_min", "y_max"), "y"),
                "charge": dea.Charge("top"),
            },
            out=args.out,
            resume=args.resume,
            quiet=args.quiet,
            stability="never",
            options=dea.NewtonOptions(tolerance=1e-12),
            settings=parser.settings(args),
        )
    except dea.EquilibriumLost as pull_in:
        return pull_in.run
    raise dea.SolverError("The march came to its end, but the film should have pulled in before.")


def findings(args, run, course, unit):
    """What is asked for goes into the summary, and None for what is not."""
    time, stretch = run.column("time_s"), run.column("stretch")
    rising = args.rate is not None
    compared = (time > 0) & (time <= COMPARED * course.pull_in_time)
    if not rising:
        compared |= time == time[0]
        compared[: np.flatnonzero(time == 0)[-1]] = False  # before the field is there
    error = np.abs(stretch[compared] / course.stretch(time[compared]) - 1)
    return {
        "pull_in_field": run["voltage_V"] / unit if rising else None,
        "pull_in_time_s": None if rising else run["time_s"],
        "stretch_at_0": None if rising else float(stretch[time == 0][-1]),
        "stretch_at_pull_in": run["stretch"],
        "max_relative_error": float(error.max(initial=0.0)),
        "exact_pull_in_field": course.pull_in_field * args.thickness / unit if rising else None,
        "exact_pull_in_time_s": None if rising else course.pull_in_time,
        "exact_stretch_at_0": None if rising else course.stretch_at_0,
        "exact_stretch_at_pull_in": course.pull_in_stretch,
    }


def report(args, run):
    s = run.summary
    print(f"\n{'':28}{'finite elements':>18}{'exact':>18}")
    for name, key in (("pull-in field, sqrt(G/eps)", "pull_in_field"),
                      ("pull-in time, s", "pull_in_time_s"),
                      ("stretch at once", "stretch_at_0"),
                      ("stretch at pull-in", "stretch_at_pull_in")):  # fmt: skip
        if s[key] is not None:
            print(f"{name:28}{s[key]:18.7f}{s['exact_' + key]:18.7f}")
    print(f"largest relative error of the stretch up to {COMPARED:g} of the pull-in time: "
          f"{s['max_relative_error']:.1e}, in {len(run.history)} steps")  # fmt: skip
    print(f"\nresults: {run.out}/history.csv, stretch_time.png, fields.xdmf")


if __name__ == "__main__":
    main()
