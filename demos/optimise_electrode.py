"""The edge of an electrode on a pre-stretched disc, placed by gradients for the largest stroke.

A round film is stretched over a frame, and an electrode covers its middle.  Under voltage this part
grows, and pushes a mark on the film, halfway to the frame, outwards.  An electrode that is too
small pushes little; one that reaches beyond the mark pushes it back.  The edge with the largest
motion of the mark is searched at a given voltage.  The nodes of the mesh move with the edge, so
that derivatives are exact.  With --trace the pull-in of the first and the best design is found.

Run it with `mpirun -n 2 python demos/optimise_electrode.py`.
"""

from pathlib import Path

import numpy as np
import ufl
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.design import Analysis, improve
from dea_fenicsx.geometry import MembraneDisc

FIRST = 0.35
"""Outer edge of the first design, as a share of the radius of the frame."""


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/optimise_electrode")
    parser.number("--mu", 50e3, "Pa", "shear modulus")
    parser.number("--eps-r", 3.0, "-", "relative permittivity")
    parser.number("--stretch", 2.0, "-", "pre-stretch")
    parser.number("--volts", 7e3, "V", "voltage at which the stroke is measured")
    parser.number("--radius", 10e-3, "m", "radius of the frame")
    parser.number("--thickness", 0.5e-3, "m", "thickness of the stretched film")
    parser.number("--mark", 1e-3, "m", "width of the mark that is to move")
    parser.count("--mesh", 2, "refinement of the mesh")
    parser.add_argument("--trace", action="store_true",
                        help="trace the pull-in of the first and of the best design")  # fmt: skip
    parser.add_argument("--margin", action="store_true",
                        help="also search edge and voltage at the same pull-in margin")  # fmt: skip
    parser.count("--most", 20, "most designs that are solved")
    return parser, parser.parse_args()


def disc(args, comm, edge, volts=None):
    """A section of half of the film, above its middle plane."""
    volts = args.volts if volts is None else volts
    n = args.mesh
    shape = MembraneDisc(args.radius, edge, args.thickness / 2, cells=(5 * n, 1, 5 * n))
    device = dea.device(shape, comm)
    rubber = dea.Material(dea.NeoHookean(args.mu), dea.IdealDielectric(args.eps_r))
    return dea.Scene(
        device, dict.fromkeys(device.regions, rubber),
        electrodes=[dea.Electrode("top_active", volts / 2), dea.Ground("bottom")],
        supports=[dea.Fix("bottom", "z"), dea.Fix("axis", "r"), dea.Fix("rim", "r")],
        prescribed=[dea.PreStretch(tuple(device.regions), r=args.stretch)],
        kinematics=dea.Axisymmetric(),
    )  # fmt: skip


def analyses(args):
    """The motion of the mark at the voltage, and the pull-in."""
    R, middle = args.radius, args.radius / 2

    def mark(r, exp):
        return exp(-(((r - middle) / args.mark) ** 2))

    r = np.linspace(0, R, 20001)
    share = float(np.trapezoid(mark(r, np.exp) * 2 * r, r)) / R**2
    stroke = dea.Expression(lambda at: at.u[0] * mark(at.X[0], ufl.exp) / share, unit="m")
    up, still = dea.Ramp("prestretch", steps=1), {"stability": "never"}
    thin = {"thin": dea.MeanStretch(("bottom", "top_active"), "z")}
    return [
        Analysis({"stroke": stroke}, [up, dea.Ramp("voltage", steps=2)], still),
        Analysis(thin, [up, dea.Trace("voltage", first=1.2, longest=20.0, steps=9)], still),
    ]


def pull_in(args, comm, edge, run):
    """The pull-in voltage of the whole film, or None if the trace is too short to find it."""
    traced = dea.solve(disc(args, comm, edge), run.items, run.record, quiet=True, **run.solve)
    if "maximum" not in traced.column("event"):
        return None
    # half of the film's thickness is modelled, and half of the voltage lies across it
    return 2 * traced.sensitivity("pull-in", ["active.elastic.mu"]).value


def at_same_margin(args, comm, first, margin, runs):
    """The edge and the voltage of the largest motion, with a given margin against pull-in."""
    return improve(
        lambda comm, edge, volts: disc(args, comm, edge, volts),
        {"edge": (0.2 * args.radius, 0.85 * args.radius, first),
         "volts": (0.5 * args.volts, 2 * args.volts, args.volts)},
        {"stroke": "max"}, runs, {"pull-in margin": (margin, None)},
        out=Path(args.out) / "designs_of_same_margin", resume=args.resume, quiet=args.quiet,
        most=args.most, tolerance=1e-7,
    )  # fmt: skip


def main():
    parser, args = parse()
    comm, runs = MPI.COMM_WORLD, analyses(args)
    first = FIRST * args.radius

    begun = dea.solve(
        disc(args, comm, first), runs[0].items, runs[0].record, out=args.out, resume=args.resume,
        quiet=args.quiet, settings=parser.settings(args), **runs[0].solve,
    )  # fmt: skip
    found = improve(
        lambda comm, edge: disc(args, comm, edge),
        {"edge": (0.2 * args.radius, 0.85 * args.radius, first)},
        {"stroke": "max"}, runs[0], out=Path(args.out) / "designs", resume=args.resume,
        quiet=args.quiet, most=args.most, tolerance=1e-7,
    )  # fmt: skip
    critical: list[float | None] = [None, None]
    if args.trace or args.margin:
        critical = [pull_in(args, comm, edge, runs[1]) for edge in (first, found.design["edge"])]
    kept = None
    if args.margin and critical[0]:
        kept = at_same_margin(args, comm, first, critical[0] / args.volts, runs)
    before, after = found.before, found.quantities
    gain = after["stroke"] / before["stroke"] - 1
    begun.add(
        stroke_before_m=before["stroke"], stroke_after_m=after["stroke"], stroke_gain=gain,
        evaluations=found.evaluations, converged=found.converged,
        edge_before_m=first, edge_after_m=found.design["edge"],
        pull_in_before_V=critical[0], pull_in_after_V=critical[1], **told_of(kept),
    )  # fmt: skip
    if comm.rank == 0:
        draw(args, found, first)
        if not args.quiet:
            print(
                f"the mark moves by {before['stroke'] * 1e3:.5g} mm with the edge at "
                f"{first * 1e3:.4g} mm, and by {after['stroke'] * 1e3:.5g} mm with the edge at "
                f"{found.design['edge'] * 1e3:.5g} mm ({100 * gain:.3g} % more), after "
                f"{found.evaluations} designs"
            )
            if critical[0]:
                print(f"pull-in at {critical[0]} V and {critical[1]} V")
            if kept is not None:
                print(
                    f"with the pull-in margin {kept.quantities['pull-in margin']:.5g} of the first "
                    f"design: {kept.quantities['stroke'] * 1e3:.5g} mm with the edge at "
                    f"{kept.design['edge'] * 1e3:.5g} mm at {kept.design['volts']:.5g} V, after "
                    f"{kept.evaluations} designs"
                )


def told_of(kept):
    """What the summary says of the search at the same margin; null where there was none."""
    if kept is None:
        names = ("margin", "stroke_at_margin_m", "edge_at_margin_m", "volts_at_margin_V")
        return {**dict.fromkeys(names), "evaluations_at_margin": None}
    return {
        "margin": kept.quantities["pull-in margin"],
        "stroke_at_margin_m": kept.quantities["stroke"],
        "edge_at_margin_m": kept.design["edge"], "volts_at_margin_V": kept.design["volts"],
        "evaluations_at_margin": kept.evaluations,
    }  # fmt: skip


def draw(args, found, first):
    """The stroke of all designs over their edge."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    solved = [row for row in found.history if "stroke" in row]
    rows = sorted(solved, key=lambda row: row["edge"])
    edges = [row["edge"] * 1e3 for row in rows]
    figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
    axes.plot(edges, [row["stroke"] * 1e3 for row in rows], "k.", label="designs")
    axes.plot(found.design["edge"] * 1e3, found.quantities["stroke"] * 1e3, "C1o", label="best")
    axes.axvline(first * 1e3, color="C0", ls="--", label="first")
    axes.set(xlabel="edge of the electrode in mm", ylabel="motion of the mark in mm")
    axes.legend()
    figure.savefig(f"{args.out}/designs.png", dpi=150)
    plt.close(figure)


if __name__ == "__main__":
    main()
