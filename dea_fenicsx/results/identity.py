"""The fingerprint of a run, by which a resumed run is recognised as the same run."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import is_dataclass
from os import PathLike
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.problem import Problem
from dea_fenicsx.path.items import March
from dea_fenicsx.results.columns import column_of
from dea_fenicsx.results.fields import Grid
from dea_fenicsx.results.spread import Table, pieces, serving
from dea_fenicsx.scene.elements import Discretisation
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.type_checks import plain

COORDINATE_TOLERANCE = 1e-9
"""Coordinates differ by up to this share of the device's size on another number of ranks."""

DRIVE_SAMPLES = 17
"""Times of a march at which its drives are compared with those of an earlier run."""

_DEEPEST = 8


def described(thing: Any, deep: int = 0) -> Any:
    """Anything as JSON can hold it: a dataclass by its fields, with its type's name.

    Another object is described by its attributes, and a function or a class by its name.
    """
    thing = plain(thing)
    if thing is None or isinstance(thing, bool | int | float | str):
        return thing
    if deep > _DEEPEST:
        return type(thing).__qualname__
    if isinstance(thing, np.ndarray):
        return described(thing.tolist(), deep + 1)
    if isinstance(thing, Mapping):
        return {str(k): described(v, deep + 1) for k, v in thing.items()}
    if isinstance(thing, set | frozenset):
        return sorted((described(t, deep + 1) for t in thing), key=repr)
    if isinstance(thing, list | tuple | range):
        return [described(t, deep + 1) for t in thing]
    if isinstance(thing, PathLike):
        return str(thing)
    if hasattr(thing, "__qualname__"):
        return str(thing.__qualname__)
    if is_dataclass(thing):
        inner = {k: getattr(thing, k) for k in thing.__dataclass_fields__}
    else:
        held = getattr(thing, "__dict__", {}).items()
        inner = {k: v if _is_data(v) else type(v).__qualname__ for k, v in held}
    return {"type": type(thing).__qualname__} | {
        str(k): described(v, deep + 1) for k, v in inner.items()
    }


def _is_data(value: Any) -> bool:
    kinds = str | int | float | list | tuple | Mapping | np.ndarray | np.generic | None
    return isinstance(value, kinds) or is_dataclass(value) or hasattr(value, "__qualname__")


def fingerprint(
    problem: Problem,
    path: Sequence[Any],
    record: Mapping[str, Any],
    failures: Iterable[Any],
    grid: Grid | None,
) -> dict[str, Any]:
    """What must agree between a run and its continuation.  Collective.

    Parameters
    ----------
    problem, path, record, failures
        The run.
    grid
        The grid of its fields, on rank 0; it is the same on any number of ranks.
    """
    scene = problem.scene
    facts = {
        "mesh": mesh_facts(problem, grid),
        "materials": {k: described(m) for k, m in scene.materials.items()},
        **{
            what: [described(item) for item in getattr(scene, what)]
            for what in ("electrodes", "supports", "prescribed", "loads")
        },
        "kinematics": described(scene.kinematics),
        "elements": _elements(scene.elements),
        "path": [described(r) for r in path],
        "ramps": list(scene.ramps),
        "unknowns": problem.unknowns,
        "observables": {column_of(n, o): _definition(o) for n, o in record.items()},
        "failures": [described(f) for f in failures],
    }
    if marches := [item for item in path if isinstance(item, March)]:
        facts["drives"] = [_sampled(march) for march in marches]
    return dict(json.loads(json.dumps(facts)))


def _elements(elements: Discretisation) -> dict[str, Any]:
    """The elements; the degree is left out where it is 2, since it once was always so."""
    facts = dict(described(elements))
    if facts["degree"] == 2:
        del facts["degree"]
    return facts


def _sampled(march: March) -> dict[str, list[float]]:
    """Values of the drives of a march, for a function is else known by its name alone."""
    times = np.linspace(0.0, march.seconds, DRIVE_SAMPLES)
    return {name: [wave(float(t)) for t in times] for name, wave in march.waves.items()}


def _definition(observable: Any) -> Any:
    """What is known of an observable before it is measured.

    One of the package is known by its fields.  Of a class of the user's without declared fields
    only texts count: its other attributes may change while it measures.
    """
    if is_dataclass(observable):
        return described(observable)
    texts = {
        key: described(value)
        for key, value in getattr(observable, "__dict__", {}).items()
        if isinstance(value, str)
        or (isinstance(value, list | tuple) and value and all(isinstance(v, str) for v in value))
    }
    return {"type": type(observable).__qualname__} | texts


def mesh_facts(problem: Problem, grid: Grid | None) -> dict[str, Any]:
    """Size, shape, cells and names of a mesh, the same on any number of ranks.  Collective."""
    device, comm = problem.scene.device, problem.comm

    def look() -> dict[str, Any]:
        assert grid is not None
        corners = [(part.min(axis=0), part.max(axis=0)) for part in pieces(grid.points)]
        low, high = (f([c[k] for c in corners], axis=0) for k, f in enumerate((np.min, np.max)))
        size = float((high - low).max())
        # Weights that are random, and the same each time, let every node count.
        weights = np.random.default_rng(0)
        sums = np.array([
            sum(weights.standard_normal(len(part)) @ ((part - low) / size)
                for part in pieces(grid.points))
            for _ in range(2)
        ])  # fmt: skip
        return {
            "kind": grid.kind,
            "cells": len(grid.cells),
            "nodes": len(grid.points),
            "connections": _digest(grid.cells, grid.regions),
            "low": (low / size).tolist(),
            "extents": ((high - low) / size).tolist(),
            "log_size_m": math.log(size),
            "shape": sums.ravel().tolist(),
        }

    facts = comm.bcast(serving(comm, look), root=0)
    return facts | {
        "regions": dict(device.regions),
        "surfaces": {name: _surface(problem, name) for name in sorted(device.surfaces)},
    }


def _digest(*tables: Table) -> str:
    found = hashlib.sha256()
    for table in tables:
        for part in pieces(table):
            found.update(np.ascontiguousarray(part, dtype=np.int64).tobytes())
    return found.hexdigest()


def _surface(problem: Problem, name: str) -> list[float]:
    """Number of a surface's facets, and sums over their middles.  Collective."""
    device = problem.scene.device
    mesh, dim = device.mesh, device.dim - 1
    facets = device.facets_by_surface[name]
    facets = facets[facets < mesh.topology.index_map(dim).size_local].astype(np.int32)
    sums = np.zeros(5)
    if len(facets):
        middles = dolfinx.mesh.compute_midpoints(mesh, dim, facets)
        sums[:] = len(facets), *middles.sum(axis=0), np.sum(middles**2)
    total = problem.comm.allreduce(sums, op=MPI.SUM)
    count = total[0] or 1.0
    return [float(total[0]), *(total[1:] / count).tolist()]


def same_mesh(mine: Mapping[str, Any], theirs: Any) -> bool:
    """Whether two meshes agree in what `mesh_facts` says of them, as JSON has kept it or not."""
    return _same(json.loads(json.dumps(mine)), theirs, COORDINATE_TOLERANCE)


def difference(mine: Mapping[str, Any], theirs: Any) -> str | None:
    """How two fingerprints differ, as a clause with "it" for the earlier run; None if they agree.

    Parameters
    ----------
    mine
        That of this run.
    theirs
        What a checkpoint says.
    """
    if not isinstance(theirs, Mapping):
        return "its description is missing"
    for key, value in mine.items():
        other = theirs.get(key)
        if key == "observables":
            told = _other_records(value, other)
            if told:
                return told
        elif not _same(value, other, COORDINATE_TOLERANCE if key == "mesh" else 0.0):
            return f"its {key} is not this script's"
    return None


def _other_records(mine: Mapping[str, Any], theirs: Any) -> str | None:
    if not isinstance(theirs, Mapping):
        return "it does not say what it records"
    for column in mine:
        if column not in theirs:
            return f"it does not record the column {column!r}"
    for column in theirs:
        if column not in mine:
            return f"it records the column {str(column)[:80]!r}, which this script does not"
    for column, value in mine.items():
        if not _same(value, theirs[column]):
            return f"its column {column!r} is another observable"
    return None


def _same(a: Any, b: Any, tolerance: float = 0.0) -> bool:
    """Whether two facts agree; numbers may differ by a tolerance."""
    if isinstance(a, Mapping):
        # What a later version of the package added, and this script leaves out, is None.
        return (
            isinstance(b, Mapping)
            and set(b) <= set(a)
            and all(_same(a[k], b[k], tolerance) if k in b else a[k] is None for k in a)
        )
    if isinstance(a, list):
        return (
            isinstance(b, list)
            and len(a) == len(b)
            and all(_same(x, y, tolerance) for x, y in zip(a, b, strict=True))
        )
    if _real(a) and _real(b):
        return bool(a == b or abs(a - b) <= tolerance * max(1.0, abs(a)))
    return type(a) is type(b) and bool(a == b)


def _real(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
