"""Optimisation with gradients, against the optimum of a laminate."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI
from scipy.optimize import minimize_scalar

import dea_fenicsx as dea
from dea_fenicsx.design import Analysis, improve
from dea_fenicsx.design.variations import variation
from dea_fenicsx.support.compat import dolfinx

pytestmark = pytest.mark.usefixtures("quick_compile")
T, VOLTS, LENGTH, MIDDLE = 1e-3, 100.0, 8.0, 2.0
STIFF = dea.Material(dea.NeoHookean(2e5), dea.IdealDielectric(3.0))
SLOPE = dea.Expression(lambda at: at.F[1, 0], "mean", ("active_middle", "passive_middle"))
"""Slope over the middle, where it is the curvature times the distance from the plane of symmetry."""

ANALYSIS = Analysis({"slope": SLOPE}, dea.Ramp(steps=1), {"options": dea.NewtonOptions(1e-12)})


def bilayer(comm, ratio, volts=VOLTS, mu=5e4):
    """Half of a strip of two layers; what is near its free end does not reach its middle."""
    n = (8, 2)
    corners = [(0.0, 0.0), (LENGTH, 2.0)]
    mesh = dolfinx.mesh.create_rectangle(
        comm, corners, n, dolfinx.mesh.CellType.quadrilateral,
        ghost_mode=dolfinx.mesh.GhostMode.shared_facet,
    )  # fmt: skip
    cells = np.arange(mesh.topology.index_map(2).size_local + mesh.topology.index_map(2).num_ghosts,
                      dtype=np.int32)  # fmt: skip
    centres = dolfinx.mesh.compute_midpoints(mesh, 2, cells)
    tags = 1 + (centres[:, 1] > 1) + 2 * (centres[:, 0] > MIDDLE)
    x = mesh.geometry.x
    x[:, 1] = np.where(x[:, 1] > 1, 1 + ratio * (x[:, 1] - 1), x[:, 1])
    device = dea.from_dolfinx(
        mesh, dolfinx.mesh.meshtags(mesh, 2, cells, tags.astype(np.int32)),
        regions={"active_middle": 1, "passive_middle": 2, "active": 3, "passive": 4},
        surfaces={"left": dea.OnPlane("x", 0.0), "bottom": dea.OnPlane("y", 0.0),
                  "between": dea.Interior(dea.OnPlane("y", T))}, unit=T,
    )  # fmt: skip
    soft = dea.Material(dea.NeoHookean(mu), dea.IdealDielectric(3.0))
    return dea.Scene(
        device,
        {name: soft if name.startswith("active") else STIFF for name in device.regions},
        electrodes=[dea.Electrode("bottom", volts), dea.Ground("between")],
        supports=[dea.Fix("left", "x"), dea.FreeBody()], kinematics=dea.PlaneStrain(T),
    )  # fmt: skip


def curvature(ratio, volts=VOLTS, mu=5e4):
    soft = dea.Material(dea.NeoHookean(mu), dea.IdealDielectric(3.0))
    plies = [dea.exact.Ply(soft, T, driven=True), dea.exact.Ply(STIFF, ratio * T)]
    return dea.exact.Laminate(plies).curvature(volts)


def test_the_best_thickness_of_a_passive_layer(tmp_path):
    """The thickness ratio of largest curvature, to 1e-4 in at most ten designs; then once more."""
    exact = minimize_scalar(
        lambda r: -abs(curvature(r)), bounds=(0.05, 2.0), method="bounded", options={"xatol": 1e-9}
    ).x

    def search(**more):
        return improve(
            bilayer, {"ratio": (0.1, 1.5, 1.0)}, {"slope": "max"}, ANALYSIS,
            out=tmp_path, quiet=True, comm=MPI.COMM_SELF, **more,
        )  # fmt: skip

    found = search()
    assert found.converged and found.feasible and found.evaluations <= 10
    assert found.design["ratio"] == pytest.approx(exact, rel=1e-4)
    assert found.quantities["slope"] > found.before["slope"]
    kept = next(tmp_path.glob("designs.0.jsonl"))
    lines = kept.read_text().splitlines(keepends=True)
    kept.write_text("".join(lines[:3]) + lines[3][:20])  # as a kill leaves it
    again = search(resume=True)
    assert again.design == found.design and again.evaluations == found.evaluations
    assert again.solved == found.evaluations - 3
