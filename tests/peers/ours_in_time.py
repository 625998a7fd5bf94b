"""The scenes in time by this package."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

import dea_fenicsx as dea
from tests.peers.time_scenes import TimeCase, blister


def solve(case: TimeCase) -> dict[str, Any]:
    """March until the field is there or no equilibrium is left."""
    scene = dea.Scene(
        dea.read_gmsh(case.geometry, MPI.COMM_WORLD),
        {"film": blister.VHB},
        electrodes=[dea.Electrode(case.driven, case.unit), dea.Ground("bottom")],
        supports=[*(dea.Clamp(name) for name in case.clamped),
                  *(dea.Fix(name, "xyz"[axis]) for name, axis in case.slides.items())],
    )  # fmt: skip
    path, start = [], 0.0
    if case.precise is not None:
        start, steps = case.precise
        drive = dea.Rise(start, start / case.rate)
        path.append(dea.March(start / case.rate, {"voltage": drive}, steps=steps))
    seconds = (case.field - start) / case.rate
    drive = dea.Rise(case.field, seconds, low=start)
    path.append(dea.March(seconds, {"voltage": drive}, tolerance=case.tolerance))
    end = "the field asked for"
    try:
        run = dea.solve(
            scene, path, {"seen": dea.AtPoint(case.seen, "displacement", "z")},
            quiet=True, stability="never",
        )  # fmt: skip
    except (dea.EquilibriumLost, dea.SolverError) as error:
        run, end = error.run, str(error)
    told = run.summary
    return {
        "field": case.rate * run["time_s"], "value": run["seen_m"], "end": end,
        "unknowns": told["unknowns"], "steps": len(run.history) - 1,
        "newton": told["newton_iterations"], "factorisations": told["factorisations"],
        "assembly_s": told["assembly_s"], "solve_s": told["factor_s"] + told["krylov_s"],
    }  # fmt: skip
