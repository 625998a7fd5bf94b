"""The scenes in NGSolve: the energy given, Newton with a sparse Cholesky factor in each step."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from netgen.meshing import Element1D, Element2D, Element3D, FaceDescriptor, MeshPoint, Pnt
from netgen.meshing import Mesh as NetgenMesh
from ngsolve import (
    BND,
    CF,
    H1,
    BilinearForm,
    Cof,
    Det,
    FESpace,
    GridFunction,
    Id,
    InnerProduct,
    Integrate,
    LinearForm,
    Mesh,
    Trace,
    Variation,
    VectorH1,
    ds,
    dx,
    grad,
    log,
    x,
)

from tests.peers.scenes import EPSILON_0, Case

INVERSE = "sparsecholesky"


def solve(case: Case, order: int = 2, jumps: bool = False) -> dict[str, Any]:
    """Solve a case; displacement and potential of an order, pressure of one less.

    `jumps` gives each region a pressure of its own, which may jump where regions meet.
    """
    mesh, length = netgen_mesh(case)
    mu0 = min(m.mu for m in case.materials.values())
    eps0 = max(m.eps_r or 0.0 for m in case.materials.values()) * EPSILON_0
    volt = length * np.sqrt(mu0 / eps0)
    surfaces = set(mesh.GetBoundaries())
    ends = {"dirichlet" + "xyz"[axis]: name for name, axis in case.slides.items()}
    U = VectorH1(mesh, order=order, dirichlet=case.clamped or "", **ends)
    regions = list(case.materials) if jumps else ["|".join(case.materials)]
    pressures = [H1(mesh, order=order - 1, definedon=mesh.Materials(r)) for r in regions]
    live = mesh.Materials("|".join([*case.dielectrics, *(set(case.electrodes) - surfaces)]))
    Phi = H1(mesh, order=order, definedon=live)
    X = FESpace([U, *pressures, Phi])
    w = GridFunction(X)
    free = X.FreeDofs()
    potential = len(pressures) + 1  # its place among the components

    def hold(part: int, dofs: Any) -> None:
        """Take degrees of freedom of a component from the unknowns."""
        first = X.Range(part).start
        for k, on in enumerate(dofs):
            if on:
                free[first + k] = False

    for part, region in enumerate(regions, start=1):
        hold(part, ~pressures[part - 1].GetDofs(mesh.Materials(region)))
    hold(potential, ~Phi.GetDofs(live))
    volts = np.full(mesh.nv, np.nan)
    for name, value in case.electrodes.items():
        where = mesh.Boundaries(name) if name in surfaces else mesh.Materials(name)
        hold(potential, Phi.GetDofs(where))
        volts[[v.nr for element in where.Elements() for v in element.vertices]] = value
    held = ~np.isnan(volts)
    a, weight = energy(case, mesh, X, (mu0, eps0), jumps=jumps)
    pick, per_area = mean_seen(case, mesh, X, weight, length)
    residual, step_, sideways, rate = (w.vec.CreateVector() for _ in range(4))
    factor, newton, spent = 0.0, 0, {"assembly_s": 0.0, "solve_s": 0.0}
    potentials = slice(X.Range(potential).start, X.Range(potential).start + mesh.nv)
    rate[:] = 0.0  # on the vertices; the bubbles of a constant are 0
    rate.FV().NumPy()[potentials][held] = volts[held] / volt
    for wanted, distance in case.held():
        factor = factor if wanted is None else wanted
        for _ in range(40):
            w.components[potential].vec.FV().NumPy()[: mesh.nv][held] = factor * volts[held] / volt
            start = time.perf_counter()
            a.Apply(w.vec, residual)
            a.AssembleLinearization(w.vec)
            now = time.perf_counter()
            spent["assembly_s"] += now - start
            inverse = a.mat.Inverse(free, inverse=INVERSE)
            step_.data = inverse * residual
            if distance is not None:  # and the factor that moves what is seen to its place
                residual.data = a.mat * rate
                sideways.data = rate - inverse * residual
                missing = distance / per_area - InnerProduct(pick.vec, w.vec)
                missing += InnerProduct(pick.vec, step_)
                change = missing / InnerProduct(pick.vec, sideways)
                factor += change
                step_.data -= change * sideways
            spent["solve_s"] += time.perf_counter() - now
            w.vec.data -= step_
            newton += 1
            if step_.Norm() < 1e-9 * w.vec.Norm():
                break
        else:
            raise RuntimeError(f"no convergence, {wanted=}, {distance=}")
    return {
        "value": float(InnerProduct(pick.vec, w.vec)) * per_area,
        "unknowns": sum(1 for f in free if f),
        "newton": newton, "krylov": 0, "factorisations": newton, **spent,
    }  # fmt: skip


def energy(
    case: Case, mesh: Any, X: Any, sizes: tuple[float, float], jumps: bool = True,
    condense: bool = False,
) -> tuple[Any, Any]:  # fmt: skip
    """The form of the energy over modulus and permittivity `sizes`, and the integrals' weight.

    `jumps` as of `solve`; with `condense` the unknowns inside of cells are eliminated.
    """
    mu0, eps0 = sizes
    a = BilinearForm(X, symmetric=True, condense=condense)
    u, *p, phi = X.TrialFunction()
    F, E, weight = Id(3), grad(phi), CF(1)
    if case.flat:
        g, hoop = grad(u), u[0] / x if case.axisymmetric else CF(0)
        F = F + CF((g[0, 0], g[0, 1], 0, g[1, 0], g[1, 1], 0, 0, 0, hoop), dims=(3, 3))
        E = CF((E[0], E[1], 0))
        weight = 2 * np.pi * x if case.axisymmetric else weight
    else:
        F = F + grad(u)
    J = Det(F)
    pulled = Cof(F) * E
    I1 = Trace(F.trans * F) - 3
    for k, (name, m) in enumerate(case.materials.items()):
        mu = m.mu / mu0
        density = mu / 2 * I1 if m.Jm is None else -mu * m.Jm / 2 * log(1 - I1 / m.Jm)
        density += p[k if jumps else 0] * (J - 1) - mu * log(J)
        if m.eps_r:
            density -= m.eps_r * EPSILON_0 / eps0 / 2 * InnerProduct(pulled, pulled) / J
        a += Variation((weight * density).Compile() * dx(mesh.Materials(name)))
    return a, weight


def mean_seen(case: Case, mesh: Any, X: Any, weight: Any, length: float) -> tuple[Any, float]:
    """The integral of the displacement seen, and what makes its mean in m of it."""
    seen = mesh.Boundaries(case.seen)
    per_area = length / Integrate(weight, mesh, BND, definedon=seen)
    pick = LinearForm(X)  # by all unknowns
    pick += weight * X.TestFunction()[0][case.axis] * ds(seen)
    pick.Assemble()
    return pick, per_area


def netgen_mesh(case: Case, places: Any = None) -> tuple[Any, float]:
    """The case's mesh, its size scaled to 1, and its size in m; its nodes lie at other `places`."""
    given = case.geometry.mesh()
    length = float(np.ptp(given.points, axis=0).max())
    made = NetgenMesh(dim=2 if case.flat else 3)
    place = np.zeros((len(given.points), 3))
    place[:, : given.points.shape[1]] = given.points / length if places is None else places
    numbers = [made.Add(MeshPoint(Pnt(*map(float, x)))) for x in place]
    if case.flat:
        for index, (name, cells) in enumerate(given.regions.items(), start=1):
            made.Add(FaceDescriptor(surfnr=index, domin=1, bc=index))
            made.SetMaterial(index, name)
            for corners in given.corners(given.cells[cells])[:, [0, 2, 3, 1]]:
                made.Add(Element2D(index, [numbers[k] for k in corners]))
        for index, (name, facets) in enumerate(given.facets.items(), start=1):
            made.SetBCName(index - 1, name)
            for corners in given.corners(facets):
                made.Add(Element1D([numbers[k] for k in corners], index=index))
        return Mesh(made), length
    turn = [0, 4, 6, 2, 1, 5, 7, 3]  # from lattice order to one ring above the other
    for index, (name, cells) in enumerate(given.regions.items(), start=1):
        made.SetMaterial(index, name)
        for corners in given.corners(given.cells[cells])[:, turn]:
            made.Add(Element3D(index, [numbers[k] for k in corners]))
    for index, (name, facets) in enumerate(given.facets.items(), start=1):
        made.Add(FaceDescriptor(surfnr=index, domin=1, bc=index))
        made.SetBCName(index - 1, name)
        for corners in given.corners(facets)[:, [0, 2, 3, 1]]:
            made.Add(Element2D(index, [numbers[k] for k in corners]))
    return Mesh(made), length
