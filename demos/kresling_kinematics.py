"""The Kresling spiral box as a linkage (Park 2019, 5.2.1): figure 5.2, each way to read it.

The demo computes the heights without strain, the barrier, the snap forces, the strokes, and the
crease pattern to cut.  Park (2019) gives k = 17 without a unit.  The demo assumes lbf/in, because
only this unit gives the 2 to 2.5 lbf of Park (2019).
"""

import csv
import json
from pathlib import Path

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.origami import (
    INCH,
    POUND_FORCE,
    CreasePattern,
    Kresling,
    least_fold_width,
    strokes,
)
from dea_fenicsx.origami.picture import draw_pattern, draw_readings, write_folding
from dea_fenicsx.thesis.errata import PrintedKresling

PLIES = 0.2 * INCH  # m, ten panels of 0.02 in on each other


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/kresling_kinematics")
    parser.number("--side", 2.125 * INCH, "m", "width of a cell")
    parser.number("--edge", 2.75 * INCH, "m", "height of a cell before it is folded")
    parser.number("--height", 1.65 * INCH, "m", "height of the storey at rest in Park (2019)")
    parser.number("--stiffness", 17 * POUND_FORCE / INCH, "N/m", "k of a diagonal")
    parser.number("--modulus", 1e6, "Pa", "E of eq 68, for the energy density")
    parser.number("--thickness", 0.02 * INCH, "m", "of the panels")
    parser.number("--fold", 0.9e-3, "m", "width of the folds in the pattern")
    parser.count("--frames", 31, "frames of the fold closing, for ParaView")
    return parser, parser.parse_args()


def readings(args):
    a, b, h, k = args.side, args.edge, args.height, args.stiffness
    return {
        "printed chords, no twist": PrintedKresling(a, h, k, h, twist="held"),
        "right chords, no twist": Kresling(a, h, k, h, twist="held"),
        "rigid edges, from the printed height": Kresling(a, b, k, h),
        "rigid edges, from the flat cell's height": Kresling(a, b, k),
    }


def described(storey, modulus):
    end = storey.at(storey.lowest)
    height, force = storey.peak()
    return {
        "rest_height_m": storey.height,
        "peak_force_N": force,
        "peak_force_lbf": force / POUND_FORCE,
        "height_at_peak_m": height,
        "peak_force_eq72a_N": storey.peak("partial_force")[1],
        "peak_force_eq72a_lbf": storey.peak("partial_force")[1] / POUND_FORCE,
        "twist_of_collapse_deg": float(np.degrees(end.twist - storey.rest_twist)),
        "strain_of_collapse": float(end.strain),
        "energy_density_of_collapse_J_per_m3": modulus * float(end.energy_density),
    }


def main():
    parser, args = parse()
    pattern = CreasePattern(args.side, args.edge, storeys=1, thickness=args.thickness,
                            fold=args.fold, stiffeners="panels", tab=10e-3)  # fmt: skip
    storeys = readings(args)
    flat = storeys["rigid edges, from the flat cell's height"]
    if MPI.COMM_WORLD.rank != 0:
        return  # nothing here is shared work
    out = Path(args.out)
    out.mkdir(parents=True, exist_ok=True)
    push, pull = flat.snap_forces()
    barrier = flat.barrier()
    summary = {
        "readings": {n: described(s, args.modulus) for n, s in storeys.items()},
        "strain_free_heights_m": [h for _, h in flat.strain_free],
        "strain_free_twists_deg": [float(np.degrees(t)) for t, _ in flat.strain_free],
        "barrier_strain": float(barrier.strain),
        "barrier_twist_deg": float(np.degrees(barrier.twist)),
        "barrier_energy_J": float(barrier.energy),
        "snap_push_N": push,
        "snap_pull_N": pull,
        "contact_twist_deg": float(np.degrees(flat.contact_twist)),
        "folded_panel_angle_deg": float(np.degrees(flat.at(flat.height).panel_angle)),
        "least_fold_width_m": float(least_fold_width(args.thickness)),
        "strokes": [
            {"collapsed_height_m": c}
            | {k: float(v) for k, v in strokes(args.height, c, c).items()}
            for c in (args.height / 8, PLIES)  # either is meant by 700 %
        ],
        "settings": parser.settings(args),
    }
    (out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", "utf-8")
    write_curves(storeys, args.modulus, out / "curves.csv")
    draw_readings(storeys, out / "figure_5_2.png")
    pattern.write_svg(out / "pattern.svg")
    draw_pattern(pattern, out / "pattern.png")
    write_folding(flat, np.linspace(0, flat.contact_twist, args.frames), out / "folding")
    if not args.quiet:
        report(summary)
        print(f"\nresults: {out}/summary.json, curves.csv, figure_5_2.png, pattern.svg, "
              "pattern.png, folding/folding.vtk.series")  # fmt: skip


def write_curves(storeys, modulus, path):
    columns = ("loss_m", "height_m", "twist_deg", "strain", "energy_density_J_per_m3", "energy_J",
               "force_N", "force_eq72a_N")  # fmt: skip
    with path.open("w", newline="", encoding="utf-8") as f:
        writer = csv.writer(f)
        writer.writerow(("reading", *columns))
        for name, storey in storeys.items():
            s = storey.at(np.linspace(storey.height, storey.lowest, 101))
            rows = np.column_stack([
                storey.height - s.height, s.height, np.degrees(s.twist - storey.rest_twist),
                s.strain, modulus * s.energy_density, s.energy, s.force, s.partial_force,
            ])  # fmt: skip
            writer.writerows((name, *(f"{x:.9g}" for x in row)) for row in rows)


def report(s):
    print(f"{'':42}{'peak force (lbf)':>18}{'by eq 72a':>11}{'twist (deg)':>13}{'strain (%)':>12}")
    for name, r in s["readings"].items():
        force, partial = r["peak_force_lbf"], r["peak_force_eq72a_lbf"]
        twist, strain = r["twist_of_collapse_deg"], 100 * r["strain_of_collapse"]
        print(f"{name:42}{force:18.3f}{partial:11.3f}{twist:13.2f}{strain:12.2f}")
    print(f"{'Park':42}{'2 to 2.5':>18}{'':11}{'30':>13}")
    heights = " and ".join(f"{h / INCH:.4f} in" for h in s["strain_free_heights_m"])
    print(f"\nflat cells: no strain at {heights}, {100 * s['barrier_strain']:.2f} % at "
          f"{s['barrier_twist_deg']:.0f} degrees between; snaps at {s['snap_push_N']:.2f} N "
          f"pushed and {-s['snap_pull_N']:.2f} N pulled")  # fmt: skip
    print(f"panels touch at {s['contact_twist_deg']:.0f} degrees of twist: a solid box folds no "
          "further, all curves beyond are of the linkage")  # fmt: skip
    for row in s["strokes"]:
        print(f"down to {row['collapsed_height_m'] / INCH:.4f} in: {100 * row['of_start']:.1f} % "
              f"of the height, {100 * row['of_collapsed']:.0f} % of what is left")  # fmt: skip


if __name__ == "__main__":
    main()
