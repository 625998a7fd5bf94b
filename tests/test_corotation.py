"""A factor that turns with the material: exact for rigid turns, a help for bent strips."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import numbers_of_ranks
from mpi4py import MPI
from scipy.spatial.transform import Rotation as Turn

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.solvers.corotation import Corotation, polar
from dea_fenicsx.solvers.newton import NewtonSolver

ROUNDING = 1e-12


@pytest.mark.parametrize("dim", [2, 3])
def test_polar_takes_the_stretch_away(dim):
    rng = np.random.default_rng(3)
    stretch = rng.normal(size=(50, dim, dim))
    stretch = np.matmul(stretch, np.swapaxes(stretch, 1, 2)) + 0.1 * np.eye(dim)
    R = Turn.random(50, random_state=4).as_matrix()
    if dim == 2:
        R = Turn.from_rotvec(np.outer(rng.uniform(-3, 3, 50), [0, 0, 1])).as_matrix()[:, :2, :2]
    assert polar(np.matmul(R, stretch)) == pytest.approx(R, abs=ROUNDING)


def bender(dim: int, volts: float = 2000.0, comm: MPI.Comm = MPI.COMM_SELF) -> dea.Scene:
    """A bilayer that bends by its upper half's voltage."""
    layers = (Layer("passive", 0.5e-3, 1), Layer("active", 0.5e-3, 1))
    size = (None, 24) if dim == 2 else (2e-3, (24, 1))
    device = dea.read_gmsh(BoxStack(20e-3, size[0], layers, size[1]), comm)
    return dea.Scene(
        device,
        {"passive": dea.Material(dea.NeoHookean(80e3)),
         "active": dea.Material(dea.NeoHookean(80e3), dea.IdealDielectric(2.8))},
        electrodes=[dea.Electrode("top", volts), dea.Ground("interface_1")],
        supports=[dea.Clamp("x_min")],
        kinematics=dea.ThreeD() if dim == 3 else dea.PlaneStrain(),
    )  # fmt: skip


@pytest.mark.engine
@pytest.mark.parametrize("dim", [2, 3])
def test_a_rigid_turn_costs_nothing(dim):
    """Turned as a whole by 40 degrees, a body goes on with its old factor as with a new one.

    Its clamped end is turned as well, by hand.  Nodes there are fixed and turn with no one.
    """
    problem = Problem(bender(dim, 100.0))
    solver = NewtonSolver(problem, dea.NewtonOptions(factor="whole"))
    rng = np.random.default_rng(1)
    rhs = rng.normal(size=len(problem.free))
    rhs[problem.roles.free(Role.MULTIPLIER)] *= 1e-3
    count = solver.counters
    assert solver.linear_solve(rhs, 1e-8) is not None
    assert count.krylov <= 2
    axis = [0, 0, 1] if dim == 2 else [0, 1, 0]
    R = Turn.from_rotvec(np.deg2rad(40) * np.array(axis)).as_matrix()[:dim, :dim]
    turn_all(problem, R)
    before = count.krylov
    assert solver.linear_solve(rhs, 1e-8) is not None
    assert (count.factorisations, count.krylov - before) == (1, pytest.approx(1, abs=1))
    # and by itself the old factor is no help at all
    solver._corotation.update = lambda: None
    solver._corotation._turn = None
    assert solver.linear_solve(rhs, 1e-8) is not None
    assert count.factorisations == 2


def turn_all(problem: Problem, R: np.ndarray) -> None:
    """Put a rigid turn of the undeformed body into a problem's displacement."""
    parts = problem.displacement
    x = parts[0].space.tabulate_dof_coordinates()[:, : len(parts)]
    for part, values in zip(parts, (x @ R.T - x).T, strict=True):
        problem.w.x.array[part.dofs] = values


@pytest.mark.engine
@pytest.mark.parametrize("dim", [2, 3])
def test_a_bent_strip_keeps_its_factor(dim):
    """Bent by its voltage, it takes half the iterations with the factor from rest turned along."""
    run = dea.solve(bender(dim, 6000.0), dea.Ramp(steps=4), {}, quiet=True)
    problem, bent = run.problem, run.problem.state
    rhs = problem.unbalanced(np.random.default_rng(1).normal(size=problem.owned))
    solver = NewtonSolver(problem, dea.NewtonOptions(factor="whole", krylov_limit=100))
    taken = []
    for turning in (True, False):
        problem.commit(bent.with_values(0 * bent.values))
        solver.forget_factor()
        assert solver.linear_solve(rhs, 1e-6) is not None
        problem.commit(bent)
        if not turning:
            solver._corotation.update = lambda: None
        before = solver.counters.krylov
        assert solver.linear_solve(rhs, 1e-6) is not None
        taken.append(solver.counters.krylov - before)
    assert 0 < taken[0] < 0.5 * taken[1]


@pytest.mark.mpi
def test_ranks_turn_alike(on_ranks):
    here = angles(MPI.COMM_SELF)
    for ranks in numbers_of_ranks():
        assert on_ranks("test_corotation", "angles", ranks) == pytest.approx(here, rel=1e-9)


def angles(comm: MPI.Comm) -> float:
    """Sum over all free nodes of the squared sines of a bent strip's angles."""
    problem = Problem(bender(3, comm=comm))
    parts = problem.displacement
    x = parts[0].space.tabulate_dof_coordinates()
    problem.w.x.array[parts[2].dofs] = 0.2 * x[:, 0] ** 2
    problem.w.x.scatter_forward()
    turning = Corotation(problem)
    found = turning._rotations()
    owned = parts[0].dofs[turning._nodes] < problem.owned
    return float(comm.allreduce(np.sum(found[owned, 2, 0] ** 2)))
