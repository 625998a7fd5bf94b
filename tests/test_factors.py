"""Split factors against whole ones: the same answers, and a count that proves stability."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse
from conftest import numbers_of_ranks
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import HDEA, BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.solvers import linear
from dea_fenicsx.solvers.factors import WholeFactor
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.split_factor import PHI, SplitFactor, U
from dea_fenicsx.solvers.tangent import Tangent
from dea_fenicsx.solvers.unsymmetric import by_lu
from dea_fenicsx.support.compat import PETSc

MU, EPS_R = 73.7e3, 4.7
RUBBER = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(EPS_R))


def helix(comm=MPI.COMM_SELF, stiffness=1.0, kappa=None):
    """One turn, with electrodes of another stiffness, which may be compressible."""
    device = dea.read_gmsh(HDEA(turns=1, angular=8), comm)
    electrode = dea.Material(dea.NeoHookean(stiffness * MU), dea.Conductor(), kappa)
    return dea.Scene(
        device,
        {"elastomer": RUBBER, "electrode_a": electrode, "electrode_b": electrode},
        electrodes=[dea.Electrode("electrode_a", 6e3), dea.Ground("electrode_b")],
        supports=[dea.FreeBody()],
    )


def ramp(scene, factor, stability="last", **options):
    record = {"contraction": dea.Contraction(("bottom", "top"), "z"),
              "charge": dea.Charge("electrode_a")}  # fmt: skip
    return dea.solve(scene, dea.Ramp("voltage", steps=3), record, quiet=True, stability=stability,
                     options=dea.NewtonOptions(factor=factor, **options))  # fmt: skip


@pytest.mark.slow
@pytest.mark.engine
@pytest.mark.parametrize("electrodes", [{}, {"stiffness": 1e3}, {"stiffness": 100, "kappa": 2e8}])
def test_all_factors_give_the_same_state(electrodes):
    # stiff electrodes bear most of what a residual is relative to: 1e-10 of it is 2e-9 of the
    # contraction
    close = {"tolerance": 1e-11}
    split, single, whole, plain = (
        ramp(helix(**electrodes), "split", **close),
        ramp(helix(**electrodes), "single", **close),
        ramp(helix(**electrodes), "whole", **close),
        ramp(helix(**electrodes), "whole", keep_factor=False, **close),
    )
    for name in ("contraction", "charge_C"):
        assert split[name] == pytest.approx(whole[name], rel=1e-9)
        assert single[name] == pytest.approx(whole[name], rel=1e-9)
        assert plain[name] == pytest.approx(whole[name], rel=1e-9)
    for run in (split, single, whole):
        assert run.summary["stable"] is True
    assert plain.summary["factorisations"] >= plain.summary["newton_iterations"]
    assert split.summary["factorisations"] < split.summary["newton_iterations"]


def split_ramp(comm):
    """Contraction at the end of a ramp with a split factor, and whether it is stable."""
    run = ramp(helix(comm), "split")
    return run["contraction"], run.summary["stable"]


@pytest.mark.slow
@pytest.mark.mpi
def test_split_factors_on_any_number_of_ranks(on_ranks):
    here, _ = split_ramp(MPI.COMM_SELF)
    for ranks in numbers_of_ranks():
        value, stable = on_ranks("test_factors", "split_ramp", ranks)
        assert value == pytest.approx(here, rel=1e-9)
        assert stable is True


@pytest.mark.parametrize(("share", "is_stable"), [(0.95, True), (1.3, False)])
def test_the_cheap_count_proves_a_stable_state_and_no_other(share, is_stable):
    """A free film at a given in-plane stretch: unstable beyond 2^(1/3), where its charge is not.

    The states come from their closed form, phi^2 = lam^-2 - lam^-8 (a free neo-Hookean film).
    """
    stretch = share * 2 ** (1 / 3)
    volts = 1e-3 * np.sqrt(MU / (EPS_R * EPSILON_0) * (stretch**-2 - stretch**-8))
    device = dea.read_gmsh(BoxStack(4e-3, 4e-3, [Layer("film", 1e-3)], divisions=(2, 2)),
                           MPI.COMM_SELF)  # fmt: skip
    scene = dea.Scene(
        device, {"film": RUBBER},
        electrodes=[dea.Electrode("top", volts), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
    )  # fmt: skip
    problem = Problem(scene)
    problem.commit(problem.imposed(problem.under(problem.state, {"voltage": 1.0})))
    for part, growth in zip(problem.displacement, (stretch, stretch, stretch**-2), strict=True):
        axis = problem.displacement.index(part)
        x = part.space.tabulate_dof_coordinates()
        problem.w.x.array[part.dofs] = (growth - 1) * x[:, axis]
    potential = problem.potential
    z = potential.space.tabulate_dof_coordinates()[:, 2]
    problem.w.x.array[potential.dofs] = z / z.max() * volts / problem.scales.potential
    solver = NewtonSolver(problem)
    attempt = solver.solve(problem.state)
    assert attempt.converged  # the pressure is all that is missing
    problem.commit(attempt.found)
    tangent = Tangent(problem)
    assert (SplitFactor(problem).excess(tangent.matrix) == 0) is is_stable
    whole = WholeFactor(problem)
    assert whole.make(tangent.matrix())
    assert (whole.excess == 0) is is_stable


def test_the_count_lets_the_potential_follow_where_that_is_needed(monkeypatch):
    """A film of one cell with a given charge is stable beyond pull-in, which u alone cannot tell.

    A free neo-Hookean film has phi^2 = lam^-2 - lam^-8; the maximum of phi is at lam = 1.26.
    """
    T, A, lam = 1e-3, 1e-6, 1.27
    volts = T * np.sqrt(MU / (EPS_R * EPSILON_0) * (lam**-2 - lam**-8))
    charge = EPS_R * EPSILON_0 * A / T * lam**4 * volts
    asked = []
    count = SplitFactor._negative

    def listen(self, tangent, names):
        asked.append((names, count(self, tangent, names)))
        return asked[-1][1]

    monkeypatch.setattr(SplitFactor, "_negative", listen)
    scene = dea.Scene(
        dea.read_gmsh(BoxStack(T, T, [Layer("film", T)], divisions=(1, 1)), MPI.COMM_SELF),
        {"film": RUBBER},
        electrodes=[dea.ChargedElectrode("top", charge), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
    )
    run = dea.solve(
        scene, dea.Ramp(steps=10), {"stretch": dea.MeanStretch(("x_min", "x_max"), "x")},
        quiet=True, stability="last", options=dea.NewtonOptions(factor="split"),
    )  # fmt: skip
    assert run["stretch"] == pytest.approx(lam, rel=1e-8)
    (first, alone), (second, both) = asked
    assert (first, second) == ((U,), (U, PHI))
    assert alone > 0 == both
    assert run.summary["stable"] is True


def test_an_aged_factor_is_renewed_when_its_age_has_cost_a_new_one():
    problem = Problem(helix())
    solver = NewtonSolver(problem)
    assert solver.solve(problem.state, {"voltage": 0.1}).converged
    worth = solver._factor.worth
    assert 1 < worth < 1000
    solver._judge_factor(3, 1e-3)
    assert not solver._stale
    for _ in range(int(worth) + 31):
        solver._judge_factor(5, 1e-3)
    assert solver._stale


def test_split_factors_need_a_discontinuous_pressure():
    scene = helix()
    scene = dea.Scene(scene.device, scene.materials, scene.electrodes, scene.supports,
                      elements=dea.Discretisation(pressure="continuous"))  # fmt: skip
    with pytest.raises(dea.InputError, match="discontinuous pressure"):
        ramp(scene, "split")
    with pytest.raises(dea.InputError, match="auto, whole, single, split, precise"):
        ramp(helix(), "half")


def test_kept_matrix_and_factors_are_filled_anew():
    """Two factors that share a kept matrix each solve with what it held when they were made."""
    device = dea.read_gmsh(BoxStack(2e-3, None, [Layer("film", 1e-3, 2)], 4), MPI.COMM_SELF)
    scene = dea.Scene(
        device, {"film": RUBBER}, [dea.Electrode("top", 1e3), dea.Ground("bottom")],
        [dea.Clamp("x_min")], kinematics=dea.PlaneStrain(),
    )  # fmt: skip
    problem = Problem(scene)
    tangent = Tangent(problem)
    factors = WholeFactor(problem), WholeFactor(problem, single=True)
    rng = np.random.default_rng(5)
    x, y = tangent.operator.createVecs()
    b = rng.standard_normal(len(problem.free))
    kept, solved = [], []
    for factor, exact in zip(factors, (1e-10, 1e-2), strict=True):
        problem.commit(problem.moved(problem.state, 0.005 * rng.standard_normal(len(problem.free))))
        kept.append(tangent.matrix())
        assert factor.make(kept[-1])
        x.array[:] = b
        factor.apply(None, x, y)
        solved.append(y.array_r.copy())
        assert tangent.times(solved[-1]) == pytest.approx(b, abs=exact)
    assert kept[0] == kept[1]
    factors[0].apply(None, x, y)
    assert np.array_equal(y.array_r, solved[0])  # the matrix has changed, its first factor not
    assert factors[0].make(tangent.matrix())
    factors[0].apply(None, x, y)
    assert y.array_r == pytest.approx(solved[1], abs=1e-3 * np.max(np.abs(solved[1])))
    kept[0].destroy()
    fresh = tangent.matrix()
    assert fresh.getSize() == (problem.unknowns,) * 2 and fresh.norm() > 0


def test_precise_factors_solve_in_few_iterations_and_count(monkeypatch):
    monkeypatch.setattr(linear, "UNKNOWNS_FOR_CHEAP_FACTOR", 1000)
    problem = Problem(helix())
    solver = NewtonSolver(problem, dea.NewtonOptions(factor="precise"))
    assert solver._split and solver._split.precise
    rhs = np.random.default_rng(0).standard_normal(len(problem.free))
    found = solver.linear_solve(rhs, 1e-11)
    assert solver.counters.krylov <= 4
    rest = solver.tangent.times(found) - rhs
    assert np.linalg.norm(rest) < 1e-10 * np.linalg.norm(rhs)
    assert solver.inertia.excess == 0


def test_constraints_delay_no_pivot():
    """A mass with volume constraints is factorised without pivoting, and solved to rounding."""
    motions, volumes, random = 300, 100, np.random.default_rng(5)
    places = np.concatenate([np.arange(i, i + 3) for i in range(0, motions, 3)])
    rows = np.repeat(np.arange(volumes), 3)
    constraint = scipy.sparse.coo_matrix(
        (1e-3 * random.standard_normal(len(rows)), (rows, places)), (volumes, motions)
    )
    mass = scipy.sparse.diags([2.0, 9.0, 2.0], [-1, 0, 1], (motions, motions))
    whole = scipy.sparse.bmat([[mass, constraint.T], [constraint, None]], "csr")
    csr = whole.indptr.astype(PETSc.IntType), whole.indices.astype(PETSc.IntType), whole.data
    matrix = PETSc.Mat().createAIJ(whole.shape, csr=csr, comm=MPI.COMM_SELF)
    solver = by_lu(matrix, motions + np.arange(volumes))
    known, (found, force) = random.standard_normal(motions + volumes), matrix.createVecs()
    force.array[:] = whole @ known
    solver.solve(force, found)
    assert solver.getPC().getFactorMatrix().getMumpsInfog(13) == 0
    left = np.linalg.norm(whole @ found.array_r - force.array_r)
    assert left <= 1e-12 * force.norm()
