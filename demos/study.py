"""A study: how pre-stretch, thickness and material decide what a disc does at a given voltage.

A round film is stretched at its rim, and an electrode covers its middle.  Each point of the grid is
a run of its own.  Under mpirun every rank takes the next free point.  Where the voltage is above
that of pull-in, the run loses its equilibrium, and its row says so.  A killed study goes on where
it was.

Run it with `mpirun -n 2 python demos/study.py`.
"""

import json
import shutil
import time
from pathlib import Path

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import MembraneDisc

RADIUS, ELECTRODE, EDGE = 12e-3, 4e-3, 3e-3  # m, before the pre-stretch
MATERIALS = {
    "neo-Hookean": dea.NeoHookean(50e3),
    "Gent": dea.Gent(50e3, 120.0),
    "Yeoh": dea.Yeoh(25e3, -50.0, 1.0),
}


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/study")
    parser.number("--volts", 1.5e3, "V", "voltage through the film")
    parser.number("--thinnest", 0.25e-3, "m", "smallest thickness before the pre-stretch")
    parser.number("--thickest", 1e-3, "m", "largest thickness before the pre-stretch")
    parser.count("--thicknesses", 2, "number of thicknesses")
    parser.count("--stretches", 4, "number of pre-stretches from 1 to 4")
    parser.count("--materials", 2, "number of materials, at most 3")
    return parser, parser.parse_args()


def builder(volts):
    """What builds the scene of a point: half of the film, whose middle plane is the ground."""

    def build(comm, stretch, thickness, material):
        disc = MembraneDisc(RADIUS, ELECTRODE, thickness / 2, taper=EDGE, cells=(3, 2, 3))
        device = dea.device(disc, comm)
        film = dea.Material(MATERIALS[material], dea.IdealDielectric(4.7))
        edge = dea.Taper(ELECTRODE, ELECTRODE + EDGE)
        return dea.Scene(
            device,
            dict.fromkeys(device.regions, film),
            electrodes=[dea.Electrode(("top_active", "top_edge"), volts / 2, taper=edge),
                        dea.Ground("bottom")],
            supports=[dea.Fix("bottom", "z"), dea.Fix("axis", "r")],
            prescribed=[dea.Stretch("rim", "r", stretch)],
            kinematics=dea.Axisymmetric(),
        )  # fmt: skip

    return build


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    if args.materials > len(MATERIALS):
        raise dea.InputError(f"--materials is {args.materials}, but must be at most 3.")
    over = {
        "stretch": np.linspace(1, 4, args.stretches),
        "thickness": np.linspace(args.thinnest, args.thickest, args.thicknesses),
        "material": list(MATERIALS)[: args.materials],
    }
    record = {"area": dea.Area("top_active"), "force": dea.Reaction("rim", "r"),
              "capacitance": dea.Capacitance("top_active")}  # fmt: skip
    path = [dea.Ramp("stretch", steps=3), dea.Ramp("voltage", steps=2)]
    begin = time.perf_counter()
    found = dea.study(builder(args.volts), over, record, path, args.out, quiet=args.quiet)
    if comm.rank == 0:
        done = [row for row in found if row["status"] == "completed"]
        gains = {
            (row["stretch"], row["thickness"], row["material"]):
            row["area_m2"] / (np.pi * (ELECTRODE * row["stretch"]) ** 2) - 1
            for row in done
        }  # fmt: skip
        best = max(gains, key=gains.get)
        told = {
            "status": "completed", "runs": len(found), "solved_now": found.solved,
            "completed": len(done), "failed": len(found) - len(done),
            "largest_area_gain": gains[best], "best_stretch": best[0], "best_thickness_m": best[1],
            "best_material": best[2], "wall_s": time.perf_counter() - begin,
            "settings": parser.settings(args),
        }  # fmt: skip
        shutil.copy(Path(args.out, "table.csv"), Path(args.out, "history.csv"))
        Path(args.out, "summary.json").write_text(json.dumps(told, indent=1), "utf-8")
        if not args.quiet:
            print(f"largest gain of area {100 * gains[best]:.3g} % at {args.volts:g} V: "
                  f"{best[2]}, stretch {best[0]:g}, {best[1] * 1e3:.3g} mm")  # fmt: skip
            print(f"{args.out}/table.csv, {args.out}/study.png")


if __name__ == "__main__":
    main()
