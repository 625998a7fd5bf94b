"""Tutorial: what is in a results folder, and how to read it with pandas, h5py and meshio.

A run writes ordinary files into its results folder.  You can read them without this package.

    history.csv     a table with a row for each step; the names of the columns end with their unit
    summary.json    the last values, settings, versions, git commit, machine, time and memory
    fields.xdmf     the description of the fields at every step, for ParaView, meshio and others
    fields.h5       the numbers of these fields
    script.py       the script that made the results

Run it with `python demos/read_results.py`.  It makes a small run and reads it.  With --read FOLDER
it reads a run of your own instead, which must have the columns voltage_V, top_m and charge_C.
"""

import json
from pathlib import Path

import h5py
import meshio
import numpy as np
import pandas
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/read_results")
    parser.number("--mu", 50e3, "Pa", "shear modulus")
    parser.number("--voltage", 2e3, "V", "end of the ramp")
    parser.add_argument("--read", metavar="FOLDER", help="read this folder and run nothing")
    return parser, parser.parse_args()


def make(parser, args):
    """Make a run to read: a film on a rigid base, from 0 V to --voltage in 4 steps."""
    film = dea.Material(dea.NeoHookean(args.mu), dea.IdealDielectric(eps_r=2.8))
    block = BoxStack(2e-3, 1.5e-3, [Layer("film", 0.5e-3)], divisions=(2, 2))
    scene = dea.Scene(
        dea.device(block, MPI.COMM_WORLD),
        materials={"film": film},
        electrodes=[dea.Electrode("top", args.voltage), dea.Ground("bottom")],
        supports=[dea.Clamp("bottom")],
    )
    dea.solve(
        scene,
        dea.Ramp("voltage", steps=4),
        record={"top": dea.LargestDisplacement("top", "z"), "charge": dea.Charge("top")},
        out=args.out,
        resume=args.resume,
        quiet=args.quiet,
        settings=parser.settings(args),
    )


def read(folder, say):
    """Read a results folder without dea_fenicsx."""
    # pandas: the history.  A capacitance is a charge over a voltage.
    history = pandas.read_csv(folder / "history.csv")
    say(history[["step", "voltage_V", "top_m", "charge_C"]].to_string(index=False))
    last = history.iloc[-1]
    say(f"capacitance at the last step: {last.charge_C / last.voltage_V * 1e12:.3f} pF")

    # json: what it was and what it cost
    summary = json.loads((folder / "summary.json").read_text("utf-8"))
    say(f"{summary['unknowns']} unknowns, stable: {summary['stable']}")

    # meshio: grid and fields of a step
    with meshio.xdmf.TimeSeriesReader(folder / "fields.xdmf") as series:
        points, cells = series.read_points_cells()
        _, nodal, cellwise = series.read_data(series.num_steps - 1)
    highest = np.abs(nodal["displacement_m"][:, 2]).max()
    say(f"meshio: {len(points)} nodes, {len(cells[0].data)} cells of type {cells[0].type}, "
        f"displacement along z up to {highest * 1e6:.3f} um")  # fmt: skip

    # h5py: the same numbers by their names
    with h5py.File(folder / "fields.h5") as h5:
        steps = sorted(name for name in h5 if name.startswith("step_"))
        u = h5[f"{steps[-1]}/node/displacement_m"][:]
        field = h5[f"{steps[-1]}/cell/field_strength_V_per_m"][:]
    say(f"h5py: {len(steps)} steps, largest mean field of a cell {field.max() / 1e6:.4f} MV/m")
    return {
        "top_from_history_m": float(last.top_m),
        "largest_displacement_meshio_m": float(highest),
        "largest_displacement_h5py_m": float(np.abs(u[:, 2]).max()),
        "field_V_per_m": float(field.max()),
        "field_meshio_V_per_m": float(cellwise["field_strength_V_per_m"][0].max()),
    }


def main():
    parser, args = parse()
    if args.read is None:
        make(parser, args)
    if MPI.COMM_WORLD.rank == 0:
        say = (lambda *_: None) if args.quiet else print
        found = read(Path(args.read or args.out), say)
        say(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
