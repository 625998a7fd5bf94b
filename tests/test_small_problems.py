"""What makes small problems fast gives what the slower ways give."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import (
    BoxStack,
    DiscCapacitor,
    DiskStack,
    FingerStack,
    HollowSphere,
    Layer,
    MembraneDisc,
    Roll,
    TabbedStack,
    Tube,
)
from dea_fenicsx.mesh import device
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.solvers import factors, unpivoted
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.small_krylov import fgmres
from dea_fenicsx.solvers.unpivoted import Unpivoted

pytestmark = pytest.mark.usefixtures("quick_compile")

LAYERS = [Layer("passive", 0.5e-3, 2), Layer("active", 0.5e-3)]
SHEETS = [Layer("sheet", 0.1e-3, electrode=True), Layer("active", 0.5e-3)]


def strip(cells=8, thrust=0.0):
    """A strip of two layers, clamped at one end, that may be pressed at the other."""
    box = BoxStack(20e-3, None, LAYERS, cells, grading=4, ends="start")
    rubber = dea.NeoHookean(80e3)
    return dea.Scene(
        dea.device(box, MPI.COMM_SELF),
        {"active": dea.Material(rubber, dea.IdealDielectric(2.8)), "passive": dea.Material(rubber)},
        [dea.Electrode("top", 8e3), dea.Ground("interface_1")], [dea.Clamp("x_min")],
        loads=[dea.DeadLoad("x_max", (-thrust, 0))] if thrust else [],
        kinematics=dea.PlaneStrain(5e-3),
    )  # fmt: skip


def matrix_of(solver, values):
    """The tangent where the displacements have some values."""
    problem = solver.problem
    at = problem.rest.values.copy()
    at[problem.free[problem.roles.free(Role.MOTION)]] = values
    with problem.at(problem.rest.with_values(at)):
        return solver.tangent.matrix(1e-8)


@pytest.mark.parametrize("size", [0.0, 3e-4, 1e-3])
def test_the_plain_factor_has_the_inertia_of_the_tangent(size):
    """In the undeformed state, and where random displacements have made it unstable."""
    solver = NewtonSolver(Problem(strip()))
    problem = solver.problem
    motion = problem.roles.free(Role.MOTION)
    values = size * np.random.default_rng(4).standard_normal(len(motion))
    matrix = matrix_of(solver, values)
    starts, columns, entries = matrix.getValuesCSR()
    dense = np.zeros((len(starts) - 1,) * 2)
    dense[np.repeat(np.arange(len(dense)), np.diff(starts)), columns] = entries
    negative = int(np.count_nonzero(np.linalg.eigvalsh(dense) < 0))
    assert (negative > problem.roles.expected_negative_pivots) == (size > 5e-4)
    factor = Unpivoted(problem, matrix)
    assert factor.make() and factor.negative == negative
    b, x = matrix.createVecs()
    wanted = np.cos(np.arange(len(dense)))
    b.array[:] = dense @ wanted
    factor.apply(b, x)
    assert x.array == pytest.approx(wanted, abs=1e-3)


def test_a_factor_that_is_not_exact_is_not_taken(monkeypatch):
    """MUMPS factorises in its place, and the run goes the same way."""
    ramp, tip = dea.Ramp(steps=2), {"tip": dea.MeanDisplacement("x_max", "y")}
    plain = dea.solve(strip(), ramp, tip, quiet=True, failures=())
    assert isinstance(plain.lent._whole._factor, Unpivoted)
    monkeypatch.setattr(unpivoted, "LARGEST_ERROR_OF_SOLVE", 0.0)
    checked = dea.solve(strip(), ramp, tip, quiet=True, failures=())
    assert isinstance(checked.lent._whole._factor, factors.Mumps)
    assert float(plain["tip_m"]) == pytest.approx(float(checked["tip_m"]), rel=1e-9)
    same = [row["negative_modes"] for row in plain.history[1:]]
    assert same == [row["negative_modes"] for row in checked.history[1:]] == [0, 0]


def test_gmres():
    """It solves to what was asked, in as many iterations as there are different eigenvalues."""
    rng = np.random.default_rng(2)
    turn, _ = np.linalg.qr(rng.standard_normal((40, 40)))
    A = turn @ np.diag(np.repeat([1.0, 2.0, -3.0, 5.0], 10)) @ turn.T
    b = rng.standard_normal(40)
    x, iterations = fgmres(A.__matmul__, np.copy, b, 1e-10, 20)
    assert iterations == 4 and np.linalg.norm(A @ x - b) < 1e-10 * np.linalg.norm(b)
    inverse = np.linalg.inv(A)
    assert fgmres(A.__matmul__, inverse.__matmul__, b, 1e-8, 20)[1] == 1
    assert fgmres(A.__matmul__, np.copy, b, 1e-10, 3) == (None, 3)
    assert fgmres(A.__matmul__, np.copy, 0 * b, 1e-10, 3)[0] == pytest.approx(0 * b)
    assert fgmres(A.__matmul__, np.copy, np.nan * b, 1e-10, 3)[0] is None


@pytest.mark.parametrize("family", [
    BoxStack(20e-3, None, LAYERS, 7, grading=4, ends="start"),
    BoxStack(20e-3, None, LAYERS, 3, order=1, x0=1e-3),
    BoxStack(20e-3, 5e-3, LAYERS, (4, 3), grading=3),
    BoxStack(1e-3, 1e-3, [Layer("film", 1e-4)]),
    Tube(20e-3, 5e-3, LAYERS, order=1),
    Tube(20e-3, 5e-3, LAYERS, "quarter", angular=8, axial=2),
    Tube(20e-3, 5e-3, LAYERS, "whole", angular=5, axial=1),
    DiskStack(20e-3, [*LAYERS, *SHEETS], 2e-3, order=1),
    DiskStack(20e-3, [*LAYERS, *SHEETS], 2e-3, end_electrodes=True),
    DiskStack(20e-3, [*LAYERS, *SHEETS], 2e-3, None, 4e-3, 1e-3, angular=5, rim=2),
    FingerStack(LAYERS, 3, 5e-3, 2e-3, both=True),
    TabbedStack(20e-3, [*LAYERS, *LAYERS], 2e-3, 10e-3, 3e-3),
    Roll(5e-3, 2, LAYERS, angular=6),
    Roll(5e-3, 2, LAYERS, 5e-3, angular=6, axial=2),
    DiscCapacitor(1e-3, 2e-3, 3e-3, (3, 2, 4)),
    MembraneDisc(2e-3, 1e-3, 1e-4, 2e-4, (2, 2, 1)),
    MembraneDisc(2e-3, 1e-3, 1e-4, 2e-4, (2, 2, 1), angular=8),
    HollowSphere(1e-3, 2e-3, "whole"),
    HollowSphere(1e-3, 2e-3, "octant", cells=4),
])  # fmt: skip
def test_families_are_meshed_as_by_gmsh(family, monkeypatch):
    """Nodes, cells, tags, names and quality."""
    quick = dea.device(family, MPI.COMM_SELF)
    monkeypatch.setattr(device, "comes_in_parts", lambda *given: False)
    slow = dea.device(family, MPI.COMM_SELF)
    for found, told in (
        (quick.mesh.geometry.x, slow.mesh.geometry.x),
        (quick.mesh.topology.original_cell_index, slow.mesh.topology.original_cell_index),
        (quick.cells.values, slow.cells.values), (quick.cells.indices, slow.cells.indices),
        (quick.facets.values, slow.facets.values), (quick.facets.indices, slow.facets.indices),
    ):  # fmt: skip
        assert np.array_equal(found, told)
    assert (quick.regions, quick.surfaces) == (slow.regions, slow.surfaces)
    assert (quick.source, quick.length) == (slow.source, slow.length)
    assert quick.quality == pytest.approx(slow.quality)
