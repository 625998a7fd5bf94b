"""The tangent is the derivative of the residual, and symmetric: Taylor remainder of order 2."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest
from conftest import block

import dea_fenicsx as dea
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.run import reuse
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.tangent import Tangent

CASES = {
    "neo-Hookean": (dea.NeoHookean(50e3), None),
    "Gent": (dea.Gent(50e3, 40.0), None),
    "neo-Hookean, finite bulk modulus": (dea.NeoHookean(50e3), 5e5),
    "Gent, finite bulk modulus": (dea.Gent(50e3, 40.0), 5e5),
}
PLACES = {
    "3-D": ((1, 1, 1), dea.ThreeD()),
    "plane strain": ((2, 1), dea.PlaneStrain()),
    "axisymmetric": ((2, 1), dea.Axisymmetric()),
}


def problem_at_a_rough_state(elastic, kappa, cells, kinematics, rng):
    """A problem away from equilibrium: every unknown perturbed, charged and loaded."""
    scene = dea.Scene(
        block(cells),
        {"film": dea.Material(elastic, dea.IdealDielectric(3.0), kappa)},
        electrodes=[dea.Electrode("top", 2000.0), dea.Ground("bottom")],
        supports=[dea.Clamp("x_min")],
        loads=[dea.DeadPressure("x_max", 1e3)],
        kinematics=kinematics,
    )
    problem = Problem(scene)
    problem.commit(problem.imposed(problem.under(problem.state, dict.fromkeys(scene.ramps, 1.0))))
    problem.commit(problem.moved(problem.state, 0.02 * rng.standard_normal(len(problem.free))))
    return problem


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("case", CASES)
def test_taylor_remainder(case, place):
    rng = np.random.default_rng(7)
    problem = problem_at_a_rough_state(*CASES[case], *PLACES[place], rng)
    start = problem.state
    direction = rng.standard_normal(len(problem.free))
    residual = problem.residual()[problem.free]
    linear = Tangent(problem)
    tangent = linear.matrix()
    x, y = tangent.createVecs()
    x.array[:] = direction
    tangent.mult(x, y)
    assert linear.times(direction) == pytest.approx(y.array_r, abs=1e-11 * tangent.norm())
    steps = np.array([1e-2, 1e-3, 1e-4]) * 0.1
    remainders = []
    for h in steps:
        problem.commit(start)
        problem.commit(problem.moved(problem.state, h * direction))
        change = problem.residual()[problem.free] - residual - h * y.array_r
        remainders.append(np.linalg.norm(change))
    order = np.polyfit(np.log(steps), np.log(remainders), 1)[0]
    assert order == pytest.approx(2, abs=0.1)
    assert tangent.isSymmetric(1e-12 * tangent.norm())


def test_fixed_columns_are_the_tangents_too():
    """The lifted first step uses the tangent's columns of the fixed unknowns."""
    rng = np.random.default_rng(3)
    problem = problem_at_a_rough_state(dea.NeoHookean(50e3), None, (1, 1, 1), dea.ThreeD(), rng)
    start, before = problem.state, problem.residual()[problem.free]
    tangent = Tangent(problem)
    change = rng.standard_normal(len(problem.fixed))
    product = tangent.times_fixed(change)
    h = 1e-6
    problem.commit(start)
    problem.w.x.array[problem.fixed] += h * change
    difference = (problem.residual()[problem.free] - before) / h
    assert difference == pytest.approx(product, abs=1e-4 * np.abs(product).max())


def test_a_run_that_is_gone_leaves_nothing_behind(monkeypatch):
    """A ring of owners through PETSc would keep each problem, and its communicators run out."""
    scene = dea.Scene(
        block((1, 1, 1)), {"film": dea.Material(dea.NeoHookean(5e4))},
        supports=[dea.Clamp("bottom")], loads=[dea.DeadLoad("top", (0, 0, 1e3))],
    )  # fmt: skip
    gone, spaces = [], []

    def noted(self, *arguments):
        original(self, *arguments)
        gone.extend(weakref.ref(thing) for thing in (self, self.problem, self.tangent))
        spaces.append(weakref.ref(self.problem.W))

    original = NewtonSolver.__init__
    monkeypatch.setattr(NewtonSolver, "__init__", noted)
    gc.disable()  # a collection comes late in a large process
    try:
        dea.solve(scene, dea.Ramp(steps=2), quiet=True)
        reuse.clear()  # small problems are kept for a run with other constants
        assert [thing() for thing in gone] == [None] * 3
    finally:
        gc.enable()
    gc.collect()
    assert [space() for space in spaces] == [None]
