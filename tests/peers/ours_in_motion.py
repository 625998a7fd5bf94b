"""The scenes in motion by this package."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

import dea_fenicsx as dea
from tests.peers.motion_scenes import DENSITY, MotionCase, beam

RUBBER = dea.Material(
    dea.ArrudaBoyce(15.36e3, 5.99, form="pade"), dea.IdealDielectric(4.8), density=DENSITY,
    viscous=[dea.Maxwell(mu, tau) for mu, tau in beam.BRANCHES],
)  # fmt: skip


def solve(case: MotionCase) -> dict[str, Any]:
    """March to the end, and tell the motion of the point that is seen."""
    device = case.device(MPI.COMM_WORLD)
    scene = dea.Scene(
        device,
        dict.fromkeys(device.regions, RUBBER),
        electrodes=[
            dea.Electrode(case.driven, case.volts), *(dea.Ground(name) for name in case.grounds)
        ],
        supports=[dea.Clamp(case.clamped)],
        elements=case.elements,
    )  # fmt: skip
    march = dea.March(case.seconds, {"voltage": case.drive}, steps=case.steps, inertia=True)
    seen = {"seen": dea.AtPoint(case.seen, "displacement", case.axis)}
    run = dea.solve(scene, march, seen, quiet=True, stability="never")
    told = run.summary
    return {
        "unknowns": told["unknowns"], "newton": told["newton_iterations"],
        "factorisations": told["factorisations"],
        "time": list(run.column("time_s")), "history": list(run.column("seen_m")),
    }  # fmt: skip
