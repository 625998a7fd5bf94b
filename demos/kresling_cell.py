"""One storey of the Kresling box by finite elements: force over stroke (Park 2019, 5.2.2).

Thin panels and rubber hinges as solids, the four lower sides clamped, the four upper ones pushed
down.  With free twist the storey folds, linear (the tangent at rest, as in Park 2019) and at large
displacements; with held twist it can't, and its panels buckle.

Height 1.65 in and angle 45 degrees are those of Table 5.1, the angle read as the twist at rest.
With sides of 2.125 in the edges are then 2.011 in long, not the 2.75 in of the flat cell: with
those, panels meet on the axis at a height of 1.7455 in, and no storey that starts at 2.75 in or
below has a stroke of 1.4 in.

From 0.41 in on, at 11.8 N, the rubber at the free ends of the upper hinges folds on mesh 2.  Where
that happens depends on mesh and augmentation; before it the force hardly does.  So the default
stroke is 0.4 in, and Park's 1.4 in are out of reach.  Contact is not modelled.

With held twist the panels buckle at 0.62 mm and about 185 N, on even cells (grading 1).  The small
cells of this demo lie where the stress at rest is singular, and its large ones are too long for the
waves of the panels: mesh 2 finds 0.684 mm, and mesh 1 no buckling within 0.9 mm.

Run it with `mpirun -n 2 python demos/kresling_cell.py`.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import KreslingCell
from dea_fenicsx.materials import bulk_modulus_of
from dea_fenicsx.origami import INCH, Kresling

MODULI = (100e6, 75e6, 50e6)  # Pa, of the hinges
RATIOS = (1, 2, 4, 8, 16, 32, 64)  # panel over hinge modulus, for the two springs
# cells along half a hinge, beside its end, across half of one, through the thickness
MESHES = {
    1: {"along": 2, "tip": 1, "strip": 2, "through": 1},
    2: {"along": 3, "tip": 2, "strip": 3, "through": 1},
    3: {"along": 4, "tip": 3, "strip": 4, "through": 2},
    4: {"along": 5, "tip": 4, "strip": 6, "through": 3},
    5: {"along": 5, "tip": 4, "strip": 9, "through": 4},
}
GRADING = {"grading": 6.0, "grading_strip": 3.0, "grading_through": 2.0}
SMALL = 1e-6  # of the height: what makes a step linear to six digits


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/kresling_cell")
    parser.number("--side", 2.125 * INCH, "m", "side of the square")
    parser.number("--height", 1.65 * INCH, "m", "height at rest")
    parser.number("--twist", 45.0, "deg", "twist at rest")
    parser.number("--stroke", 0.4 * INCH, "m", "how far the upper sides are pushed down")
    parser.number("--held-stroke", 0.9e-3, "m", "the same, with held twist")
    parser.number("--thickness", 0.02 * INCH, "m", "of panels and hinges")
    parser.number("--hinge", 2e-3, "m", "width of the hinges (not given in Park (2019))")
    parser.number("--panel-modulus", 2.1e9, "Pa", "Young's modulus of PETG (not given)")
    parser.number("--poisson", 0.38, "-", "Poisson's ratio of PETG (not given)")
    parser.number("--hinge-modulus", MODULI[0], "Pa", "Young's modulus of the hinges")
    parser.count("--mesh", 2, f"mesh density, {min(MESHES)} (coarse) to {max(MESHES)} (half a "
                 "million unknowns)", MESHES)  # fmt: skip
    parser.count("--steps", 16, "landings on the way, besides one at 1e-4 of it")
    parser.add_argument("--study", action="store_true", help="also the stiffness on all "
                        "coarser meshes")  # fmt: skip
    return parser, parser.parse_args()


def storey(args):
    """The linkage of the same size, and the least height that its panels can reach, in m."""
    turn, radius = np.radians(args.twist), args.side / np.sqrt(2)
    edge = float(np.hypot(args.height, 2 * radius * np.sin(turn / 2)))
    linkage = Kresling(args.side, edge, height=args.height)
    reach = linkage.contact_twist
    flat = edge <= 2 * radius * np.sin(reach / 2)
    return linkage, 0.0 if flat else float(linkage.at_twist(reach).height)


def scene(args, device, stroke, held, hinge=None, panel=None):
    """The storey with its upper sides pushed down by `stroke` in m at ramp factor 1."""
    young, nu = panel or args.panel_modulus, args.poisson
    mu = young / (2 * (1 + nu))
    petg = dea.Material(dea.NeoHookean(mu), bulk_modulus=bulk_modulus_of(mu, nu))
    rubber = dea.Material(dea.NeoHookean((hinge or args.hinge_modulus) / 3))
    return dea.Scene(
        device,
        {"panel": petg, "side": rubber, "edge": rubber, "diagonal": rubber},
        supports=[dea.Clamp("bottom"), *([dea.Fix("top", "xy")] if held else [])],
        prescribed=[dea.Displacement("top", "z", -stroke)],
    )


RECORD = {
    "stroke": dea.MeanDisplacement("top", "z"),
    "force": dea.Reaction("top", "z"),
    "twist": dea.Rotation("top", "z"),
}


def stiffness(args, device, held=False, **moduli):
    """Of the linear solution, the tangent at rest, in N/m."""
    small = SMALL * args.height
    run = dea.solve(
        scene(args, device, small, held, **moduli), dea.Ramp("stretch", steps=1), RECORD,
        quiet=True, stability="never",
    )  # fmt: skip
    return -run["force_N"] / small


def share(stiffnesses):
    """Of the elastic energy, that in the hinges: d ln K/d ln E, mean over the range of moduli."""
    return float(np.log(stiffnesses[0] / stiffnesses[-1]) / np.log(MODULI[0] / MODULI[-1]))


def springs(args, device):
    """The storey as two springs in series, hinges and panels, where it softens by 30 %.

    Stiffnesses are of degree one in both moduli, so only their ratio is varied: hinges of half the
    modulus at a ratio x are half as stiff as those of the whole at 2 x.  At the ratio where that
    costs 30 %, 1/K = 1/K_hinge + 1/K_panel, with K_hinge in step with the hinges' modulus, is
    fitted to three moduli.
    """
    E, ratio = args.hinge_modulus, np.array(RATIOS)
    k = np.array([stiffness(args, device, hinge=E, panel=E * x) for x in ratio])
    drop = 1 - k[1:] / 2 / k[:-1]
    at = float(np.exp(np.interp(0.3, drop, np.log(ratio[:-1]))))
    scale = np.array(MODULI) / MODULI[0]
    found = np.array([stiffness(args, device, hinge=E * x, panel=E * at) for x in scale])
    slope, rest = np.polyfit(1 / scale, 1 / found, 1)
    return {
        "modulus_ratio_for_30_percent": at,
        "drop_there": 1 - found[-1] / found[0],
        "spring_ratio_there": rest / slope,
        "misfit_of_springs": float(np.max(np.abs((slope / scale + rest) * found - 1))),
    }


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    linkage, lowest = storey(args)
    if args.stroke > args.height - lowest:
        raise dea.InputError(
            f"--stroke is {args.stroke:g} m, but panels of this storey lie on each other after "
            f"{args.height - lowest:g} m."
        )

    def device(mesh):
        return dea.device(
            KreslingCell(args.side, args.height, float(np.radians(args.twist)), args.thickness,
                         args.hinge, **MESHES[mesh], **GRADING), comm,
        )  # fmt: skip

    cell = device(args.mesh)
    landings = (1e-4, *np.linspace(0, 1, args.steps + 1)[1:-1])
    try:
        run = dea.solve(
            scene(args, cell, args.stroke, False),
            dea.Ramp("stretch", steps=args.steps, at=landings, snap=True),
            RECORD, out=args.out, resume=args.resume, quiet=args.quiet, stability="every",
            settings=parser.settings(args),
        )  # fmt: skip
    except dea.EquilibriumLost as error:  # no stable state behind a limit point: up to there
        run = error.run
    held = dea.solve(
        scene(args, cell, args.held_stroke, True), dea.Ramp("stretch", steps=9), RECORD,
        out=Path(args.out) / "held", resume=args.resume, quiet=True, stability="every",
    )  # fmt: skip
    at_rest = {k: stiffness(args, cell, held=k) for k in (False, True)}
    softer = {k: [stiffness(args, cell, held=k, hinge=E) for E in MODULI] for k in at_rest}
    rigid = [stiffness(args, cell, hinge=E, panel=1e14) for E in (MODULI[0], MODULI[-1])]

    run.add(
        edge_m=linkage.edge,
        panels_meet_at_height_m=lowest,
        **path_findings(args, run, held, linkage, at_rest),
        hinge_moduli_Pa=MODULI,
        stiffness_of_moduli_N_per_m=softer[False],
        stiffness_held_of_moduli_N_per_m=softer[True],
        drop=1 - softer[False][-1] / softer[False][0],
        drop_held=1 - softer[True][-1] / softer[True][0],
        hinge_share_of_energy=share(softer[False]),
        hinge_share_of_energy_held=share(softer[True]),
        stiffness_rigid_panels_N_per_m=rigid[0],
        drop_rigid_panels=1 - rigid[-1] / rigid[0],
        **springs(args, cell),
    )
    if args.study:
        run.add(study=study(args, device))
    if comm.rank == 0:
        draw(Path(args.out) / "force_stroke.png", args, run, held, linkage)
        dea.pictures.deformed(args.out, "displacement_m")
        if not args.quiet:
            report(run, args)


def path_findings(args, run, held, linkage, at_rest):
    """Forces and turns along the strokes, beside the tangents at rest."""
    strokes, forces = -run.column("stroke_m"), -run.column("force_N")
    turn = np.degrees(run.column("twist_rad"))
    buckled = [row for row in held.history if row["event"] == "bifurcation"]
    small = forces[1] / strokes[1]
    return dict(
        stiffness_N_per_m=at_rest[False],
        stiffness_held_N_per_m=at_rest[True],
        reached_stroke_m=strokes[-1],
        linear_force_at_stroke_N=at_rest[False] * strokes[-1],
        force_at_stroke_N=forces[-1],
        largest_force_N=float(np.max(forces)),
        small_stroke_over_linear=small / at_rest[False],
        twist_at_stroke_deg=turn[-1],
        linkage_twist_at_stroke_deg=float(
            np.degrees(linkage.twist_at(args.height - strokes[-1])) - args.twist
        ),
        held_buckling_stroke_m=-buckled[0]["stroke_m"] if buckled else float("nan"),
        held_buckling_force_N=-buckled[0]["force_N"] if buckled else float("nan"),
    )


def study(args, device):
    """Stiffness at rest on coarser meshes and on this one."""
    rows = []
    for mesh in range(1, args.mesh + 1):
        cell = device(mesh)
        rows.append({
            "mesh": mesh,
            "stiffness_N_per_m": stiffness(args, cell),
            "stiffness_held_N_per_m": stiffness(args, cell, held=True),
        })  # fmt: skip
    return rows


def draw(path, args, run, held, linkage):
    figure = Figure(figsize=(7.2, 3.3), layout="constrained")
    force, turn, drop = figure.subplots(1, 3)
    s = run.summary
    strokes = -1e3 * run.column("stroke_m")
    force.plot(strokes, -run.column("force_N"), "C0", lw=1, label="free twist")
    force.plot(strokes, s["stiffness_N_per_m"] * strokes / 1e3, "C0--", lw=1,
               label="free twist, linear")  # fmt: skip
    force.plot(-1e3 * held.column("stroke_m"), -held.column("force_N"), "C1", lw=1,
               label="held twist")  # fmt: skip
    for row in held.history:
        if row["event"] == "bifurcation":
            force.plot(-1e3 * row["stroke_m"], -row["force_N"], "C1x", ms=4)
    heights = np.linspace(args.height, args.height - args.stroke, 100)
    turn.plot(strokes, np.degrees(run.column("twist_rad")), "C0", lw=1, label="finite elements")
    turn.plot(1e3 * (args.height - heights), np.degrees(linkage.twist_at(heights)) - args.twist,
              "k:", lw=1, label="rigid panels")  # fmt: skip
    turn.legend(fontsize=6, frameon=False)
    for k, held_ in enumerate(("", "held_")):
        values = np.array(s[f"stiffness_{held_}of_moduli_N_per_m"])
        drop.plot(np.array(MODULI) / 1e6, values / values[0], f"C{k}o-", ms=3, lw=1,
                  label="held twist" if held_ else "free twist")  # fmt: skip
    drop.plot(MODULI[-1] / 1e6, 0.7, "ks", ms=4, mfc="none", label="Park (2019)")
    drop.plot([50, 100], [0.5, 1], "k:", lw=1, label="hinges alone")
    drop.legend(fontsize=6, frameon=False)
    force.set(xlabel="Stroke (mm)", ylabel="Force (N)", ylim=(0, 1.6 * s["largest_force_N"]))
    turn.set(xlabel="Stroke (mm)", ylabel="Turn (degrees)")
    drop.set(xlabel="Hinge modulus (MPa)", ylabel="Stiffness over that at 100 MPa")
    figure.legend(*force.get_legend_handles_labels(), fontsize=7, frameon=False, ncols=3,
                  loc="outside upper center")  # fmt: skip
    figure.savefig(path, dpi=200)


def report(run, args):
    s = run.summary
    print(f"\nstiffness at rest: {s['stiffness_N_per_m']:.5g} N/m with free twist, "
          f"{s['stiffness_held_N_per_m']:.5g} N/m with held twist")  # fmt: skip
    if s["reached_stroke_m"] < 0.999 * args.stroke:
        print("equilibrium was lost: " + s["message"])
    print(f"force at {s['reached_stroke_m'] / INCH:.3g} in: {s['force_at_stroke_N']:.2f} N, linear "
          f"{s['linear_force_at_stroke_N']:.2f} N; turn {s['twist_at_stroke_deg']:.2f} degrees, of "
          f"rigid panels {s['linkage_twist_at_stroke_deg']:.2f}")  # fmt: skip
    if np.isfinite(s["held_buckling_stroke_m"]):
        print(f"held twist: the panels buckle after {1e3 * s['held_buckling_stroke_m']:.3g} mm at "
              f"{s['held_buckling_force_N']:.4g} N")  # fmt: skip
    print(f"hinges of {MODULI[-1] / 1e6:g} instead of {MODULI[0] / 1e6:g} MPa: stiffness falls by "
          f"{100 * s['drop']:.1f} %, with held twist by {100 * s['drop_held']:.1f} % (Park: 30 %; "
          "hinges alone 50 %); hinges hold "
          f"{100 * s['hinge_share_of_energy']:.0f} and "
          f"{100 * s['hinge_share_of_energy_held']:.0f} % of the energy")  # fmt: skip
    print(f"rigid panels: it falls by {100 * s['drop_rigid_panels']:.1f} %; with panels "
          f"{s['modulus_ratio_for_30_percent']:.3g} times as stiff as the hinges by "
          f"{100 * s['drop_there']:.1f} %, where K_hinge/K_panel = {s['spring_ratio_there']:.3f} "
          f"(two springs: 4/3; misfit {100 * s['misfit_of_springs']:.1f} %)")  # fmt: skip
    for row in s.get("study", ()):
        print("  ".join(f"{k} {v:.6g}" for k, v in row.items()))
    print(f"\nresults: {run.out}/history.csv, force_stroke.png, fields.xdmf; held/")


if __name__ == "__main__":
    main()
