"""A few eigenpairs of the tangent, against all of them from a dense solver."""

from __future__ import annotations

import numpy as np
import pytest
import ufl
from mpi4py import MPI
from scipy.linalg import eigh

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.model import forms
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.terms import WorkTerm, terms_of
from dea_fenicsx.path.stability import CriticalEigenvalue
from dea_fenicsx.solvers.eigenpairs import eigenpairs
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import PETSc, dolfinx

FILM = dea.Material(dea.NeoHookean(50e3), dea.IdealDielectric(3.0))


def clamped_film(comm=MPI.COMM_SELF, cells=(1, 1), width=1e-3, volts=5e3):
    """A square film on a rigid base, in equilibrium: by symmetry it has double eigenvalues."""
    geometry = BoxStack(1e-3, width, [Layer("film", 1e-3)], divisions=cells)
    scene = dea.Scene(
        dea.read_gmsh(geometry, comm), {"film": FILM},
        [dea.Electrode("top", volts), dea.Ground("bottom")],
        [dea.Fix("bottom", axis) for axis in "xyz"],
    )  # fmt: skip
    problem = Problem(scene)
    solver = NewtonSolver(problem)
    attempt = solver.solve(problem.state, {"voltage": 1.0})
    problem.commit(attempt.found)
    return solver


def dense(matrix):
    """All entries of a PETSc matrix on one rank."""
    return matrix.getValues(*(np.arange(n, dtype=np.int32) for n in matrix.getSize()))


def all_eigenvalues(solver, mass=None):
    """Eigenvalues of K v = m M v, the nearest to zero first, without those of constraints.

    With C C^T = M the matrix C^T S C has the eigenvalues 1/m, where S is K^-1 in the displacements.
    """
    u = solver.problem.roles.free(Role.MOTION)
    S = np.linalg.inv(dense(solver.tangent.matrix(0.0)))[np.ix_(u, u)]
    if mass is not None:
        C = np.linalg.cholesky(dense(mass)[np.ix_(u, u)])
        S = C.T @ S @ C
    inverse = eigh((S + S.T) / 2, eigvals_only=True)
    inverse = inverse[np.abs(inverse) > 1e-9 * np.abs(inverse).max()]
    return 1 / inverse[np.argsort(-np.abs(inverse))]


def values(pairs):
    return np.array([pair.value for pair in pairs])


@pytest.mark.parametrize("width", [1e-3, 1.00001e-3, 1.3e-3], ids=["double", "close", "apart"])
def test_the_nearest_eigenpairs(width):
    """To 1e-8, in order, each vector an eigenvector, and the first that of `CriticalEigenvalue`."""
    solver = clamped_film(width=width)
    known = all_eigenvalues(solver)
    gap = abs(known[1] / known[0] - 1)
    assert (gap < 1e-9) if width == 1e-3 else (gap < 1e-4) == (width < 1.1e-3)
    pairs = eigenpairs(solver, 6)
    assert np.allclose(values(pairs), known[:6], rtol=1e-8, atol=0)
    u = solver.problem.roles.free(Role.MOTION)
    V = np.stack([pair.vector for pair in pairs], axis=1)
    assert np.allclose(V[u].T @ V[u], np.eye(6), atol=1e-8)
    for pair in pairs:
        rest = solver.tangent.times(pair.vector)
        rest[u] -= pair.value * pair.vector[u]
        assert np.linalg.norm(rest) < 1e-7 * abs(pair.value) and pair.residual < 1e-7 * pair.value
    _, size, _ = CriticalEigenvalue(solver).nearest_zero(solver.problem.state)
    assert abs(size - pairs[0].value) < 1e-4 * size


def test_more_than_there_are():
    """What keeps the volume takes motions away: those that are left are found, and no more."""
    solver = clamped_film()
    known = all_eigenvalues(solver)
    motions = len(solver.problem.roles.free(Role.MOTION))
    assert len(known) == motions - solver.problem.roles.count(Role.MULTIPLIER) < motions
    for count in (len(known) + 1, 10 * motions):
        found = eigenpairs(solver, count)
        assert len(found) == len(known)
        assert np.allclose(values(found), known, rtol=1e-8, atol=0)


def test_a_state_that_is_not_stable():
    """Negative eigenvalues come in the order of their size, among the positive ones."""
    solver = clamped_film()
    problem = solver.problem
    more = problem.under(problem.state, {"voltage": 8.0})
    problem.commit(problem.imposed(more.with_values(8 * more.values)))
    known = all_eigenvalues(solver)
    assert known[:8].min() < 0 < known[:8].max()
    assert np.allclose(values(eigenpairs(solver, 8)), known[:8], rtol=1e-8, atol=0)


def mass_matrix(problem):
    """int u . v dX in the free unknowns, which no other follows here."""
    u, v = (
        problem.space.symbolic(Role.MOTION, kind(problem.W))
        for kind in (ufl.TrialFunction, ufl.TestFunction)
    )
    form = compat.compile_form(ufl.inner(u, v) * ufl.dx)
    whole = dolfinx.fem.petsc.assemble_matrix(form)
    whole.assemble()
    rows = PETSc.IS().createGeneral(problem.free + problem.space.rows.start, comm=problem.comm)
    return whole.createSubMatrix(rows, rows)


def test_a_mass_matrix():
    solver = clamped_film()
    mass = mass_matrix(solver.problem)
    pairs = eigenpairs(solver, 5, mass)
    assert np.allclose(values(pairs), all_eigenvalues(solver, mass)[:5], rtol=1e-8, atol=0)
    M = dense(mass)
    V = np.stack([pair.vector for pair in pairs], axis=1)
    assert np.allclose(V.T @ M @ V, np.eye(5), atol=1e-8)


def test_what_is_refused(monkeypatch):
    class Cross(WorkTerm):
        name = "cross stress"

        def work(self, at, virtual):
            return (at.F[2, 2] - 1) * virtual(at.F[0, 0])

    solver = clamped_film()
    for count in (0, -1, 1.5, "two"):
        with pytest.raises(dea.InputError, match="whole number"):
            eigenpairs(solver, count)
    monkeypatch.setattr(forms, "terms_of", lambda scene: [*terms_of(scene), Cross()])
    with pytest.raises(dea.InputError, match="cross stress is not symmetric"):
        eigenpairs(clamped_film(), 1)


def first_ones(comm):
    """The three nearest eigenvalues and the largest residual of their vectors, on some ranks."""
    solver = clamped_film(comm)
    pairs = eigenpairs(solver, 3, mass_matrix(solver.problem))
    return list(values(pairs)), max(pair.residual / pair.value for pair in pairs)


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_on_several_ranks(ranks, on_ranks):
    """The film has one cell, so that some ranks have none."""
    found, residual = on_ranks("test_eigenpairs", "first_ones", ranks)
    known, _ = first_ones(MPI.COMM_SELF)
    assert np.allclose(found, known, rtol=1e-8, atol=0) and residual < 1e-6
