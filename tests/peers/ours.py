"""The scenes by this package: with the peers' elements, and as it would solve them by itself."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

import dea_fenicsx as dea
from tests.peers.scenes import Case, Rubber


def material(rubber: Rubber) -> Any:
    elastic = dea.NeoHookean(rubber.mu) if rubber.Jm is None else dea.Gent(rubber.mu, rubber.Jm)
    electric = dea.Conductor() if rubber.conducts else None
    if rubber.eps_r:
        electric = dea.IdealDielectric(rubber.eps_r)
    return dea.Material(elastic, electric, rubber.bulk)


def solve(
    case: Case, own_elements: bool = False, options: Any = None, degree: int = 2
) -> dict[str, Any]:
    """Solve a case; `own_elements` takes the package's own elements instead of the peers'.

    `options` are those of Newton's method, and `degree` is that of the own elements.
    """
    device = dea.device(case.geometry, MPI.COMM_WORLD)
    kinematics: Any = dea.PlaneStrain() if case.flat else dea.ThreeD()
    if case.axisymmetric:
        kinematics = dea.Axisymmetric()
    sliding = [dea.Fix(name, kinematics.axes[k]) for name, k in case.slides.items()]
    plate = []
    if case.pressed is not None:
        group, moved, metres = case.pressed
        sliding += [dea.Fix(group, name) for k, name in enumerate(kinematics.axes) if k != moved]
        plate = [dea.Displacement(group, kinematics.axes[moved], metres, ramp="press")]
    same = dea.Discretisation(pressure="continuous", augmentation=0.0)
    scene = dea.Scene(
        device,
        {name: material(m) for name, m in case.materials.items()},
        electrodes=[dea.Electrode(name, volts) if volts else dea.Ground(name)
                    for name, volts in case.electrodes.items()],
        supports=[*([dea.Clamp(case.clamped)] if case.clamped else []), *sliding],
        prescribed=plate,
        kinematics=kinematics,
        elements=dea.Discretisation(degree=degree) if own_elements else same,
    )  # fmt: skip
    along = scene.kinematics.axes[case.axis]
    path: Any = dea.Ramp("press" if plate else "voltage", steps=case.steps)
    if case.reach is not None:
        path = dea.Trace("voltage", at=(1.0,), until=("seen_m", case.reach))
    run = dea.solve(
        scene, path, {"seen": dea.MeanDisplacement(case.seen, along)},
        quiet=True, stability="never", options=options,
    )  # fmt: skip
    last = run.history[-1]
    if case.reach is not None:
        last = [row for row in run.history if row["event"] == "landed"][-1]
    told = run.summary
    return {
        "value": last["seen_m"],
        "unknowns": told["unknowns"],
        "newton": told["newton_iterations"],
        "krylov": told["krylov_iterations"],
        "factorisations": told["factorisations"],
        "assembly_s": told["assembly_s"],
        "solve_s": told["factor_s"] + told["krylov_s"],
    }
