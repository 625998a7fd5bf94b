"""The smooth fold in place of a crease, its stiffeners, and the box folding (Park 2019, 5.4.3).

The demo computes four things:

1. the four points of the fold, with the numbers of Park (2019) and with those of its own cell;
2. the width that panels of a given thickness need;
3. the pattern to cut, with the folds or the panels between them as stiffeners;
4. the storey that closes with its smooth folds, for ParaView: its panels are rigid, and move from
   the open box to where they meet.
"""

import json
from pathlib import Path

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import KreslingCell
from dea_fenicsx.origami import (
    INCH,
    CreasePattern,
    Kresling,
    SmoothFold,
    fold_angles,
    least_fold_width,
)
from dea_fenicsx.origami.picture import draw_pattern
from dea_fenicsx.results.fields import Grid
from dea_fenicsx.results.folder import Folder

THESIS = SmoothFold((0.0, 0.0), (3.0, 4.0), 0.05, (0.6, 0.6))  # in units of its 3:4:5
# VTK's order of the 27 nodes of a hexahedron, in a lattice of 3 x 3 x 3 with the last index fastest
LATTICE = [0, 18, 24, 6, 2, 20, 26, 8, 9, 21, 15, 3, 11, 23, 17, 5, 1, 19, 25, 7, 4, 22, 10, 16,
           12, 14, 13]  # fmt: skip


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/smooth_fold")
    parser.number("--side", 2.125 * INCH, "m", "width of a cell")
    parser.number("--edge", 2.75 * INCH, "m", "height of a cell")
    parser.number("--fold", 0.9e-3, "m", "width of the folds")
    parser.number("--thickness", 0.02 * INCH, "m", "of the panels")
    parser.number("--relief", 0.12, "-", "share of a crease left out at each end (Park: 0.6/5)")
    parser.number("--closed", 80.0, "deg", "twist to which the box is closed; panels meet at 90")
    parser.count("--frames", 41, "frames of the box closing, for ParaView")
    return parser, parser.parse_args()


def main():
    parser, args = parse()
    storey = Kresling(args.side, args.edge)
    diagonal = float(np.hypot(args.side, args.edge))
    own = SmoothFold((0, 0), (args.side, args.edge), args.fold, (args.relief * diagonal,) * 2)
    sheets = {
        kind: CreasePattern(args.side, args.edge, storeys=1, fold=args.fold, stiffeners=kind,
                            offset=args.relief * diagonal, thickness=args.thickness)
        for kind in ("fold", "panels")
    }  # fmt: skip
    twists = np.radians(np.linspace(0, args.closed, args.frames))
    cells = [
        KreslingCell(args.side, float(storey.at_twist(phi).height), float(phi), args.thickness,
                     args.fold, args.relief)
        for phi in twists
    ]  # fmt: skip
    folds = {k: np.degrees(v) for k, v in fold_angles(storey, twists).items()}
    if MPI.COMM_WORLD.rank != 0:
        return  # nothing here is shared work
    out = Path(args.out)
    history = write_closing(cells, storey, twists, folds, out)
    for kind, sheet in sheets.items():
        sheet.write_svg(out / f"pattern_{kind}.svg")
        draw_pattern(sheet, out / f"pattern_{kind}.png")
    largest = max(float(np.max(np.abs(v))) for k, v in folds.items() if k != "side")
    summary = {
        "corners_of_thesis": THESIS.corners.tolist(),
        "along_of_thesis": THESIS.along.tolist(),
        "across_of_thesis": THESIS.across.tolist(),
        "corners_m": own.corners.tolist(),
        "direction_deg": float(np.degrees(np.arctan2(*own.along[::-1]))),
        "fold_length_m": own.length,
        "thesis_width_scaled_m": 0.05 * diagonal / 5,
        "stiffener_area_m2": {k: [float(_area(p)) for p in s.lines()["stiffener"][:2]]
                              for k, s in sheets.items()},
        "largest_fold_deg": largest,
        "least_fold_width_m": float(least_fold_width(args.thickness, np.radians(largest))),
        "least_fold_width_flat_m": float(least_fold_width(args.thickness)),
        "frames": len(history),
        "settings": parser.settings(args),
    }  # fmt: skip
    (out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", "utf-8")
    if not args.quiet:
        report(summary)
        print(f"\nresults: {out}/fields.xdmf, history.csv, summary.json, pattern_fold.svg, "
              "pattern_panels.svg")  # fmt: skip


def write_closing(cells, storey, twists, folds, out):
    """The storey with its folds at each twist, as displacements from the first; the history."""
    meshes = [cell.mesh() for cell in cells]
    first = meshes[0]
    regions = np.zeros(len(first.cells), dtype=np.int32)
    for k, numbers in enumerate(first.regions.values()):
        regions[numbers] = k + 1
    folder = Folder(out, MPI.COMM_SELF)
    folder.start()
    folder.keep_origin()
    grid = Grid(first.points, first.cells.reshape(-1, 27)[:, LATTICE], "hexahedron", regions)
    folder.write_grid(grid)
    history = []
    for step, (mesh, phi) in enumerate(zip(meshes, twists, strict=True)):
        state = storey.at_twist(phi)
        history.append({
            "step": step, "time": float(np.degrees(phi)), "ramp": "twist", "event": "",
            "twist_deg": float(np.degrees(phi)), "height_m": float(state.height),
            "diagonal_strain": float(state.strain),
            **{f"{name}_fold_deg": float(v[step]) for name, v in folds.items()},
        })  # fmt: skip
        nodes = {"displacement_m": mesh.points - first.points}
        folder.write_step(step, None, history, nodes, {}, None)
    folder.consolidate(history)
    return history


def _area(p):
    """Area of a closed polygon in the plane."""
    x, y = p[:, 0], p[:, 1]
    return abs(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])) / 2


def report(s):
    for k, (thesis, own) in enumerate(zip(s["corners_of_thesis"], s["corners_m"], strict=True)):
        print(f"p{k + 1}: ({thesis[0]:.3f}, {thesis[1]:.3f}) of 3:4:5; of the own cell "
              f"({1e3 * own[0]:.3f}, {1e3 * own[1]:.3f}) mm")  # fmt: skip
    print(f"direction {s['direction_deg']:.2f} degrees, 53.13 of 3:4:5; the width 0.05 of it is "
          f"{1e3 * s['thesis_width_scaled_m']:.3f} mm")  # fmt: skip
    print(f"folded by up to {s['largest_fold_deg']:.1f} degrees, panels need folds "
          f"{1e3 * s['least_fold_width_m']:.3f} mm wide; to lie on each other "
          f"{1e3 * s['least_fold_width_flat_m']:.3f} mm")  # fmt: skip


if __name__ == "__main__":
    main()
