"""The scenes in NGSolve as it is fastest: inner unknowns condensed, few iterations.

Displacement and potential have one order, and the pressure one less, with a jump between regions.
The unknowns inside of cells are eliminated cell by cell (``condense=True``), and Newton's method
ends as soon as its last increment shows that the next one would be far below the error asked.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from ngsolve import H1, FESpace, GridFunction, InnerProduct, VectorH1

from tests.peers.ngsolve_peer import INVERSE, energy, mean_seen, netgen_mesh
from tests.peers.scenes import EPSILON_0, Case

LAST_INCREMENT = 1e-3
"""Relative size of the last increment: that of the next one would be about its square."""


def solve(case: Case, order: int, mapped: Callable | None = None) -> dict[str, Any]:
    """Solve a case whose electrodes are facets.

    Parameters
    ----------
    case
        The case.
    order
        Order of displacement and potential.
    mapped
        For curved cells: `tests.peers.error_scenes.unrolled`, which gives nodes of straight
        cells and what curves them.
    """
    if mapped:
        case = replace(case, geometry=replace(case.geometry, order=1))
    curved = mapped(case) if mapped else None
    mesh, length = netgen_mesh(case, None if curved is None else curved[0])
    if curved is not None:
        bent = GridFunction(VectorH1(mesh, order=order))
        bent.Set(curved[1]())
        mesh.SetDeformation(bent)
    mu0 = min(m.mu for m in case.materials.values())
    eps0 = max(m.eps_r or 0.0 for m in case.materials.values()) * EPSILON_0
    volt = length * np.sqrt(mu0 / eps0)
    ends: dict[str, list[str]] = {}
    for name, axis in case.slides.items():
        ends.setdefault("dirichlet" + "xyz"[axis], []).append(name)
    held = {key: "|".join(names) for key, names in ends.items()}
    U = VectorH1(mesh, order=order, dirichlet=case.clamped or "", **held)
    pressures = [
        H1(mesh, order=order - 1, definedon=mesh.Materials(name)) for name in case.materials
    ]
    live = mesh.Materials("|".join(case.dielectrics))
    Phi = H1(mesh, order=order, definedon=live, dirichlet="|".join(case.electrodes))
    X = FESpace([U, *pressures, Phi])
    w, given = GridFunction(X), GridFunction(X)
    volts = {name: value / volt for name, value in case.electrodes.items() if value}
    given.components[-1].Set(mesh.BoundaryCF(volts), definedon=mesh.Boundaries("|".join(volts)))
    a, weight = energy(case, mesh, X, (mu0, eps0), condense=True)
    pick, per_area = mean_seen(case, mesh, X, weight, length)
    free = _free(X, U, pressures, Phi, mesh, case, live)
    newton = 0
    for k in range(case.steps):
        w.vec.data += (1 / case.steps) * given.vec
        newton += _newton(a, w, free, last=k == case.steps - 1)
    return {
        "value": float(InnerProduct(pick.vec, w.vec)) * per_area,
        "unknowns": sum(1 for f in X.FreeDofs() if f), "newton": newton,
    }  # fmt: skip


def _free(X: Any, U: Any, pressures: Any, Phi: Any, mesh: Any, case: Case, live: Any) -> Any:
    """The free unknowns that are left when those inside of cells are eliminated."""
    free = X.FreeDofs(coupling=True)
    spaces = [*pressures, Phi]
    regions = [*(mesh.Materials(name) for name in case.materials), live]
    for part, (space, region) in enumerate(zip(spaces, regions, strict=True), start=1):
        first = X.Range(part).start
        for k, on in enumerate(space.GetDofs(region)):
            if not on:
                free[first + k] = False
    return free


def _newton(a: Any, w: Any, free: Any, last: bool) -> int:
    """Newton's method from the present state; returns the number of its iterations."""
    residual, step = w.vec.CreateVector(), w.vec.CreateVector()
    for k in range(40):
        a.Apply(w.vec, residual)
        a.AssembleLinearization(w.vec)
        inverse = a.mat.Inverse(free, inverse=INVERSE)
        residual.data += a.harmonic_extension_trans * residual
        step.data = inverse * residual
        step.data += a.harmonic_extension * step
        step.data += a.inner_solve * residual
        w.vec.data -= step
        size = step.Norm() / w.vec.Norm()
        if not np.isfinite(size):
            break
        # a step that is not the last one need not end so exactly
        if size < (LAST_INCREMENT if last else 30 * LAST_INCREMENT):
            return k + 1
    raise RuntimeError("no convergence")
