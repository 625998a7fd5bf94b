"""Time the lowest modes of a helical actuator, and tell where the time goes.

    mpirun -n 2 python -m tests.peers.helix_modes [--turns N] [--mesh N] [--count N] [--profile]

The device is that of demos/hdea_ten_layer.py with a density of 1000 kg/m^3, clamped at its bottom
and without voltage.  Ten turns of mesh 3 have 400 000 unknowns.  The times are those of the
rank with most, in the search for modes alone; a busy machine changes cpu_s least.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import resource
import sys
import time
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import HDEA
from tests.peers.scenes import PLATE, VHB

sys.path.append(str(Path(__file__).parents[2] / "demos"))
import hdea_ten_layer


def material(rubber) -> dea.Material:
    electric = dea.Conductor() if rubber.conducts else dea.IdealDielectric(rubber.eps_r)
    return dea.Material(dea.NeoHookean(rubber.mu), electric, density=1000.0)


def scene(turns: int, mesh: int) -> dea.Scene:
    device = dea.read_gmsh(HDEA(turns=turns, **hdea_ten_layer.MESHES[mesh]), MPI.COMM_WORLD)
    plate = material(PLATE)
    return dea.Scene(
        device,
        {"elastomer": material(replace(VHB)), "electrode_a": plate, "electrode_b": plate},
        electrodes=[dea.Electrode("electrode_a", 6e3), dea.Ground("electrode_b")],
        supports=[dea.Clamp("bottom")],
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--turns", type=int, default=10)
    parser.add_argument("--mesh", type=int, default=3, choices=sorted(hdea_ten_layer.MESHES))
    parser.add_argument("--count", type=int, default=10)
    parser.add_argument("--profile", action="store_true", help="tell where rank 0 spends its time")
    args = parser.parse_args()
    comm = MPI.COMM_WORLD
    run = dea.solve(
        scene(args.turns, args.mesh), dea.Ramp("voltage", 0.0, 1), quiet=True, stability="never"
    )
    start, busy, profile = time.perf_counter(), time.process_time(), cProfile.Profile()
    if args.profile:
        profile.enable()
    modes = dea.modes(run, args.count)
    profile.disable()
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    cpu = comm.allreduce(time.process_time() - busy, op=MPI.MAX)
    total = comm.allreduce(memory, op=MPI.SUM)
    if comm.rank == 0:
        wall = time.perf_counter() - start
        print(f"{run.summary['unknowns']} unknowns on {comm.size} ranks: {len(modes)} modes in "
              f"{wall:.1f} s, {cpu:.1f} s of CPU, {total:.2f} GB")  # fmt: skip
        print(modes)
        print("largest error of omega^2 as a share: "
              f"{(modes.errors / abs(modes.squares)).max():.1e}", flush=True)  # fmt: skip
        if args.profile:
            told = pstats.Stats(profile)
            told.sort_stats("tottime").print_stats(8)
            told.sort_stats("cumtime").print_stats("eigenpairs|vibration|linear|factors|tangent")


if __name__ == "__main__":
    main()
