"""The contents of summary.json: status, work done, settings, versions."""

from __future__ import annotations

import resource
from collections.abc import Mapping, Sequence
from math import ceil
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.path.items import Item, Trace
from dea_fenicsx.results.axes import axes_of_fields
from dea_fenicsx.results.columns import COUNTS, load_column
from dea_fenicsx.results.identity import described
from dea_fenicsx.results.provenance import package_versions
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.support.compat import PETSc, dolfinx
from dea_fenicsx.support.errors import (
    EquilibriumLost,
    Interrupted,
    MachineError,
    NotReached,
    SolverError,
    StabilityLost,
)


def work(solver: NewtonSolver, history: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Sizes, iterations, seconds and memory of a run.  Collective."""
    problem, comm = solver.problem, solver.problem.comm
    return {
        "unknowns": problem.unknowns,
        "unknowns_by_field": problem.roles.counts,
        "cells": comm.allreduce(problem.scene.device.owned_cells(), op=MPI.SUM),
        "mesh_quality": dict(problem.scene.device.quality),
        "volume_m3": problem.forms.volume * problem.scales.volume,
        "ranks": comm.size,
        "preconditioner": solver.factor_kind,
        "peak_memory_GB": comm.allreduce(_peak_memory_GB(), op=MPI.SUM),
        **{name: sum(int(row[name]) for row in history) for name in COUNTS},
        "assembly_s": solver.counters.assembly_s,
        "factor_s": solver.counters.factor_s,
        "krylov_s": solver.counters.krylov_s,
    }


STATUS = {
    EquilibriumLost: "equilibrium lost", StabilityLost: "stability lost",
    SolverError: "solver failed",
    MachineError: "machine failed", Interrupted: "interrupted", NotReached: "not reached",
}  # fmt: skip
"""Status of a run that ends by an error; see `ending` for the others."""

UNSTABLE = "completed, unstable"
"""Status of a run whose last ramp ends at an equilibrium that is not stable."""

LIMITS = ("maximum", "minimum")
"""Events that change the number of negative eigenvalues by one."""

CRITICAL = (*LIMITS, "bifurcation", "snap")
"""Events that change the number of negative eigenvalues by any amount.

In a bifurcation or a snap several eigenvalues may change their signs.
"""


def count_changes(history: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Where the number of negative eigenvalues changes along a history.

    Returns
    -------
    list of dict
        For each change between two steps at which it was counted: ``from`` and ``to``, the two
        numbers; ``after_step`` and ``step``, the two steps; ``limit_points``, how many lie between
        them; ``located``, whether events between them (limit points, of which each explains a
        change by one, a bifurcation or a snap) explain it.
    """
    found: list[dict[str, Any]] = []
    before: Mapping[str, Any] | None = None
    passed: list[str] = []
    for row in history:
        if row["event"] in CRITICAL:  # the tangent is singular there
            passed.append(row["event"])
            continue
        if not row["inertia_is_of_this_step"] or row["inertia"] is None:
            continue
        if before is not None and before["inertia"] != row["inertia"]:
            limits = sum(event in LIMITS for event in passed)
            located = limits < len(passed) or abs(row["inertia"] - before["inertia"]) <= limits
            found.append({
                "from": before["inertia"], "to": row["inertia"], "after_step": before["step"],
                "step": row["step"], "limit_points": limits, "located": located,
            })  # fmt: skip
        before, passed = row, []
    return found


def ending(
    scene: Scene, history: Sequence[Mapping[str, Any]], path: Sequence[Item]
) -> tuple[str, str]:
    """Status and message of a path that was followed to its end.

    Parameters
    ----------
    scene
        The scene.
    history
        The accepted steps.
    path
        The ramps and traces.
    """
    is_trace = isinstance(path[-1], Trace)
    status, message = _stability(history, is_trace)
    where = None if is_trace else unstable_from(scene, history, path, message)
    told = [sentence for sentence in (message, where) if sentence]
    return status, " ".join(told + loads_not_passed(scene, history, path))


def unstable_from(
    scene: Scene, history: Sequence[Mapping[str, Any]], path: Sequence[Item],
    told_before: str | None,
) -> str | None:  # fmt: skip
    """A sentence on where a branch first becomes unstable along ramps, if it does.

    Parameters
    ----------
    scene, history, path
        As of `ending`.
    told_before
        The sentence before this one.  It may tell the same steps, if it is that of `unlocated`.
    """
    before: Mapping[str, Any] | None = None
    passed: Mapping[str, Any] | None = None
    for row in history:
        if row["event"] in CRITICAL:
            passed = row
        elif row["inertia_is_of_this_step"] and row["inertia"] is not None:
            if row["inertia"]:
                break
            before, passed = row, None
    else:
        return None
    item = path[max(0, ceil(row["time"]) - 1)]
    moved = [load_column(scene, name)[0] for name in item.names(scene)]

    def told(one: Mapping[str, Any]) -> str:
        return ", ".join(f"{name} = {one[name]:.9g}" for name in moved)

    if isinstance(item, Trace) or not moved:
        return None
    if passed is not None:
        return f"Nothing rests on this branch from {told(passed)} (step {passed['step']}) on."
    if before is not None:
        if told_before and f"{before['step']} and {row['step']}" in told_before:
            return "Nothing rests on this branch from there on."
        return (
            f"Nothing rests on this branch from between {told(before)} (step {before['step']}) and "
            f"{told(row)} (step {row['step']}) on."
        )
    return 'From where on nothing rests there is told with stability="every".'


def loads_not_passed(
    scene: Scene, history: Sequence[Mapping[str, Any]], path: Sequence[Item]
) -> list[str]:
    """A sentence for each trace that has no step at some of the loads that it was asked for."""
    found = []
    for k, item in enumerate(path):
        if not isinstance(item, Trace) or not item.at:
            continue
        column, unit = load_column(scene, item.what)
        mine = [row for row in history if k < row["time"] <= k + 1]
        start = [row for row in history if row["time"] <= k][-1:]
        factors = np.array([row[column] / unit for row in start + mine])
        missed = [
            f"{wanted:g}" for wanted in item.at
            if not np.isclose(factors, wanted, rtol=1e-9, atol=1e-12).any()
        ]  # fmt: skip
        if missed:
            loads = f"load{'s' * (len(missed) > 1)} {', '.join(missed)}"
            found.append(f"The trace in {item.what} did not pass the {loads} of at=.")
    return found


def _stability(history: Sequence[Mapping[str, Any]], is_trace: bool) -> tuple[str, str | None]:
    """Status of a completed path, and what its negative eigenvalues say about it.

    A trace is followed for the sake of states that are not stable, a ramp is not.
    """
    last = history[-1]
    negative = last["inertia"] if last["inertia_is_of_this_step"] else None
    if negative and not is_trace:
        many = f"{negative} negative eigenvalue{'s' * (negative > 1)}"
        return UNSTABLE, (
            f"The tangent of the last state has {many}: this equilibrium is not stable, and a real "
            "device does not rest there."
        )
    return "completed", unlocated(history)


def unlocated(history: Sequence[Mapping[str, Any]]) -> str | None:
    """A sentence on changes of the count of negative eigenvalues that no event explains, if any."""
    passed = [change for change in count_changes(history) if not change["located"]]
    if not passed:
        return None
    first, others = passed[0], len(passed) - 1
    also = f" (and at {others} other place{'s' * (others > 1)})" if others else ""
    change = (
        f"The number of negative eigenvalues changes from {first['from']} to {first['to']} between "
        f"steps {first['after_step']} and {first['step']}{also}"
    )
    if limits := first["limit_points"]:
        explained = "limit point" if limits == 1 else f"{limits} limit points"
        return (
            f"{change}.  The {explained} there explain{'s' * (limits == 1)} a change by {limits}, "
            "so a bifurcation lies there too, or the path has changed its branch; "
            'stability="every" looks for it.'
        )
    return (
        f"{change}, where nothing was located: there the path may have changed its branch; "
        'stability="every" looks for the bifurcation.'
    )


def settings(
    solver: NewtonSolver, path: Sequence[Any], script: Mapping[str, Any]
) -> dict[str, Any]:
    """All inputs on which the result of a run depends, as values for JSON."""
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
        "axes": list(axes_of_fields(scene.kinematics)),
        "elements": described(scene.elements),
        "path": [_told(item, scene) for item in path],
        "newton": described(solver.options),
        "scales": described(problem.scales),
    }


def _told(item: Any, scene: Scene) -> dict[str, Any]:
    """An item of a path, with the names of the ramps that it moves.

    ``Ramp()`` names none and moves all; ``Close`` names an electrode and moves its source's ramp.
    """
    told, moved = described(item), list(item.names(scene))
    if "what" in told and not told["what"]:
        told["what"] = moved
    return told | {"ramps": moved}


def _peak_memory_GB() -> float:
    """Peak resident memory of this process in GB (10^9 bytes)."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9


def versions() -> dict[str, str]:
    """Versions of all libraries on which a result depends."""
    return {
        "dolfinx": dolfinx.__version__,
        "petsc": ".".join(map(str, PETSc.Sys.getVersion())),
        "mpi": MPI.Get_library_version().split("\n")[0].split("\x00")[0].strip(),
        **package_versions(),
    }
