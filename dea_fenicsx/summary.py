"""What summary.json says of a run: work done, settings, versions."""

from __future__ import annotations

import resource
from collections.abc import Mapping, Sequence
from typing import Any

from mpi4py import MPI

from dea_fenicsx.compat import PETSc, dolfinx
from dea_fenicsx.identity import described
from dea_fenicsx.provenance import package_versions
from dea_fenicsx.solver import NewtonSolver


def work(solver: NewtonSolver, history: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Sizes, iterations, seconds and memory of a run.  Collective."""
    problem, comm = solver.problem, solver.problem.comm
    counted = ("newton_iterations", "krylov_iterations", "factorisations")
    return {
        "unknowns": problem.unknowns,
        "unknowns_by_field": problem.counts,
        "cells": comm.allreduce(problem.scene.device.owned_cells(), op=MPI.SUM),
        "mesh_quality": dict(problem.scene.device.quality),
        "volume_m3": problem.volume * problem.scales.volume,
        "ranks": comm.size,
        "peak_memory_GB": comm.allreduce(_peak_memory_GB(), op=MPI.SUM),
        **{name: sum(int(row[name]) for row in history) for name in counted},
        "assembly_s": solver.counters.assembly_s,
        "factor_s": solver.counters.factor_s,
        "krylov_s": solver.counters.krylov_s,
    }


def settings(
    solver: NewtonSolver, path: Sequence[Any], script: Mapping[str, Any]
) -> dict[str, Any]:
    """All that shapes a run's result, as JSON can hold it."""
    problem = solver.problem
    scene = problem.scene
    return {
        "script": dict(script),
        "mesh": scene.device.source,
        "regions": dict(scene.device.regions),
        "surfaces": dict(scene.device.surfaces),
        "materials": {k: described(m) for k, m in scene.materials.items()},
        "electrodes": [described(e) for e in scene.electrodes],
        "supports": [described(s) for s in scene.supports],
        "prescribed": [described(s) for s in scene.prescribed],
        "loads": [described(s) for s in scene.loads],
        "kinematics": described(scene.kinematics),
        "elements": described(scene.elements),
        "path": [described(r) for r in path],
        "newton": described(solver.options),
        "scales": described(problem.scales),
    }


def _peak_memory_GB() -> float:
    """Peak resident memory of this process in GB (10^9 bytes)."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9


def versions() -> dict[str, str]:
    """Versions of everything that shapes a result."""
    return {
        "dolfinx": dolfinx.__version__,
        "petsc": ".".join(map(str, PETSc.Sys.getVersion())),
        "mpi": MPI.Get_library_version().split("\n")[0].split("\x00")[0].strip(),
        **package_versions(),
    }
