"""Mechanical scenes in FElupe: displacement, pressure and volume ratio, a direct solve each time.

Triquadratic hexahedra with a continuous pressure and volume ratio of degree 1.  The volume ratio is
then that of the pressure, p = kappa (J - 1), so that the discrete problem is the same as here.
"""

from __future__ import annotations

import time
from typing import Any

import felupe
import numpy as np
from scipy.sparse.linalg import spsolve

from tests.peers.scenes import Case

SIMPSON = np.array([1, 4, 1]) / 6
"""Weights of the nodes along an edge in the mean of a quadratic function."""


def solve(case: Case) -> dict[str, Any]:
    """Solve a case whose electrodes have no voltage, and whose facets seen are of one size."""
    given = case.geometry.mesh()
    length = float(np.ptp(given.points, axis=0).max())
    stress = min(m.mu for m in case.materials.values())
    (rubber,) = case.materials.values()
    points, corners, cells, number = _mesh(given, length)
    region = felupe.RegionTriQuadraticHexahedron(felupe.Mesh(points, cells, "hexahedron27"))
    field = felupe.FieldsMixed(region, n=3, disconnect=False)
    law = felupe.NeoHooke(mu=rubber.mu / stress, bulk=rubber.bulk / stress)
    solid = felupe.SolidBody(felupe.ThreeFieldVariation(law), field)

    fixed, pushed = _held(case, given, number)
    first = np.cumsum([0, *(part.values.size for part in field.fields)])
    free = np.concatenate([
        np.setdiff1d(np.arange(first[1]), fixed),
        *(start + np.arange(corners) for start in first[1:3]),
    ])  # fmt: skip
    newton, spent = 0, {"assembly_s": 0.0, "solve_s": 0.0}
    for k in range(1, case.steps + 1):
        wanted = np.zeros(len(fixed))
        wanted[pushed] = k / case.steps * case.pressed[2] / length
        for _ in range(40):
            start = time.perf_counter()
            residual = np.asarray(solid.assemble.vector(field).toarray()).ravel()
            matrix = solid.assemble.matrix(field).tocsr()
            now = time.perf_counter()
            spent["assembly_s"] += now - start
            change = np.zeros(first[-1])
            change[fixed] = wanted - field[0].values.ravel()[fixed]
            rows = matrix[free]
            change[free] = spsolve(rows[:, free].tocsc(), -residual[free] - rows @ change)
            spent["solve_s"] += time.perf_counter() - now
            for part, begin in zip(field.fields, first, strict=False):
                part.values += change[begin : begin + part.values.size].reshape(part.values.shape)
            newton += 1
            if np.linalg.norm(change) < 1e-9 * np.linalg.norm(field[0].values):
                break
        else:
            raise RuntimeError(f"no convergence in step {k}")
    u = field[0].values[number[given.facets[case.seen]], case.axis]
    value = float(np.einsum("kab,a,b->k", u, SIMPSON, SIMPSON).mean()) * length
    return {
        "value": value, "unknowns": len(free), "newton": newton, "krylov": 0,
        "factorisations": newton, **spent,
    }  # fmt: skip


def _mesh(given: Any, length: float) -> tuple[np.ndarray, int, np.ndarray, np.ndarray]:
    """Points with corners first, number of corners, cells in FElupe's order, new numbers."""
    corner = np.unique(given.corners(given.cells))
    others = np.setdiff1d(np.arange(len(given.points)), corner)
    order = np.concatenate([corner, others])
    number = np.empty(len(order), dtype=np.int64)
    number[order] = np.arange(len(order))
    place = np.rint(felupe.element.TriQuadraticHexahedron().points + 1).astype(int)
    cells = number[given.cells[:, place[:, 0], place[:, 1], place[:, 2]]]
    return given.points[order] / length, len(corner), cells, number


def _held(case: Case, given: Any, number: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Degrees of freedom of the displacement that are given, and which of them are pushed."""

    def dofs(name: str, axis: int) -> np.ndarray:
        return 3 * number[np.unique(given.facets[name])] + axis

    group, axis, _ = case.pressed
    pushed = dofs(group, axis)
    whole = [dofs(name, a) for name in (case.clamped, group) if name for a in range(3)]
    fixed = np.unique(np.concatenate([*whole, *(dofs(n, a) for n, a in case.slides.items())]))
    return fixed, np.isin(fixed, pushed)
