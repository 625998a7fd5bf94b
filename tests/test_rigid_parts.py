"""Rigid parts in the plane: nodes that turn as one body by any angle, exact in the tangent."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from mpi4py import MPI
from scipy.sparse import csr_array
from stopped_runs import refused

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.solvers.tangent import Tangent

pytestmark = pytest.mark.usefixtures("quick_compile")

MU, H, DEPTH = 5e4, 1e-3, 2e-3
TIGHT = dea.NewtonOptions(tolerance=1e-11)


def strip(length=6, across=2, comm=MPI.COMM_SELF, kinematics=None, **conditions):
    """A strip of height `H` and a length in units of it, with cells that are square."""
    geometry = BoxStack(length * H, None, [Layer("film", H, divisions=across)],
                        divisions=(length * across,))  # fmt: skip
    film = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(3.0))
    kinematics = kinematics or dea.PlaneStrain(DEPTH)
    return dea.Scene(
        dea.read_gmsh(geometry, comm), {"film": film}, kinematics=kinematics, **conditions
    )


def bender(moment, **options):
    """A strip that is clamped at one end, with a moment on a rigid part at the other."""
    return strip(supports=[dea.Clamp("x_min"), dea.Rigid("x_max")],
                 loads=[dea.Moment("x_max", moment)], **options)  # fmt: skip


def moment_of(k):
    """Moment [N m] that bends a block of neo-Hookean rubber to the curvature k, in plane strain.

    Between free faces the square of the stretch goes linearly from exp(-t) to exp(t), with
    sinh(t) = k h, so that the energy per length and depth is

        U = mu/(4 k) (sinh 2t + 2 t - 4 sinh t),

    and the moment is its derivative by k (Rivlin, Proc. R. Soc. A 195 (1949) 463).
    """
    t = np.arcsinh(k * H)
    U = MU / (4 * k) * (np.sinh(2 * t) + 2 * t - 4 * np.sinh(t))
    return DEPTH * (MU * H / k * (np.cosh(t) - 1) - U / k)


def solve(scene, to=1.0, steps=6, **options):
    record = {
        "a": dea.PartRotation("x_max"), "x": dea.MeanDisplacement("x_max", "x"),
        "far": dea.MeanDisplacement("x_min", "x"),
    }  # fmt: skip
    return dea.solve(scene, dea.Ramp(to=to, steps=steps), record, quiet=True, **options)


def test_pure_bending_to_half_a_turn():
    """The difference of two strips' angles is that of a bent block without ends.

    What the clamped and the rigid end change falls off within a height or two, and is the same in
    both.  Measured: 2.7e-4 too much with two cells across, 2.1e-5 with four.
    """
    k, errors = np.pi / (9 * H), []
    for across in (2, 4):
        angles = {
            n: solve(bender(moment_of(k), length=n, across=across))["a_rad"] for n in (6, 9)
        }
        assert angles[9] == pytest.approx(np.pi, rel=0.05)
        errors.append(abs((angles[9] - angles[6]) / (3 * H * k) - 1))
    assert errors[1] < 4e-5 and errors[0] > 8 * errors[1], errors


def test_slender_strip_is_an_elastica():
    """It turns by M L/(EI), EI = mu h^3/3 in plane strain, up to what thickness and ends change."""
    L = 24
    angle = solve(bender(MU * H**3 / 3 * DEPTH * np.pi / (L * H), length=L, across=1))
    assert angle["a_rad"] == pytest.approx(np.pi, rel=5e-3)


def as_array(matrix):
    """A PETSc matrix of one rank as an array."""
    start, column, value = matrix.getValuesCSR()
    return csr_array((value, column, start)).toarray()


def bent(scene, turn=np.pi, noise=3e-3):
    """The problem of a bender in a state near a circular arc, with random displacements on it."""
    problem = Problem(scene)
    values = problem.state.values.copy()
    X, Y = problem.displacement[0].space.tabulate_dof_coordinates()[:, :2].T
    L, Y = X.max(), Y - Y.mean()
    k = turn / L
    ux, uy = (part.dofs for part in problem.displacement)
    values[ux] = (1 / k - Y) * np.sin(k * X) - X
    values[uy] = 1 / k - (1 / k - Y) * np.cos(k * X) - Y
    part = problem.rigid.parts[0]
    given = (np.sin(turn) / k - L, (1 - np.cos(turn)) / k, turn)
    for dofs, value in zip(part.unknowns, given, strict=True):
        values[dofs] = value
    problem.commit(problem.imposed(problem.state.with_values(values)))
    assert np.abs(problem.w.x.array - values).max() < 1e-14  # the end of an arc is rigid
    random = np.random.default_rng(1)
    problem.commit(problem.moved(problem.state, noise * random.standard_normal(len(problem.free))))
    return problem, random


def test_tangent():
    """Order 2 of the residual's remainder, at half a turn; the matrix is the action, symmetric.

    Without the second derivative of the nodes' motion, the angle's row would be of order 1.
    """
    problem, random = bent(bender(1e-6))
    tangent, here = Tangent(problem), problem.state
    direction = random.standard_normal(len(problem.free))
    row = problem.rigid.rows(problem.conditions.groups, problem.free)[0]
    force = problem.unbalanced(problem.residual())
    along = tangent.times(direction)
    matrix = tangent.matrix()
    dense = as_array(matrix)
    assert np.allclose(dense @ direction, along, rtol=0, atol=1e-12 * np.abs(along).max())
    assert np.abs(dense - dense.T).max() < 1e-12 * np.abs(dense).max()
    errors = []
    for h in (1e-4, 5e-5, 2.5e-5):
        with problem.at(problem.moved(here, h * direction)):
            rest = problem.unbalanced(problem.residual()) - force - h * along
        errors.append((np.linalg.norm(rest), abs(rest[row])))
    ratios = np.array(errors[:-1]) / np.array(errors[1:])
    assert np.all(np.abs(ratios - 4) < 0.2), ratios
    second = problem.rigid.stiffness(problem.residual(), problem.w.x.array)[0]
    assert abs(second) > 1e-3 * abs(dense[row, row])
    turn = np.zeros(len(problem.free))
    turn[row] = 1e-6
    residual, kept = problem.residual(), force[row]
    with problem.at(problem.moved(here, turn)):  # the same forces on nodes that have turned
        change = (problem.unbalanced(residual)[row] - kept) / 1e-6
    assert change == pytest.approx(second, rel=1e-4)


def test_newton_is_quadratic_at_half_a_turn():
    k = np.pi / (6 * H)
    problem = solve(bender(moment_of(k)), options=TIGHT).problem
    assert problem.rigid.parts[0].values(problem.w.x.array)[-1] == pytest.approx(np.pi, rel=0.1)
    tangent = Tangent(problem)
    random = np.random.default_rng(2)
    problem.commit(problem.moved(problem.state, 1e-4 * random.standard_normal(len(problem.free))))
    norms = []
    for _ in range(4):
        rest = problem.unbalanced(problem.residual())
        norms.append(float(np.linalg.norm(rest)))
        step = -np.linalg.solve(as_array(tangent.matrix()), rest)
        problem.commit(problem.moved(problem.state, step))
    for before, after in pairwise(norms):
        assert after < 10 * before**2 + 1e-12, norms
    assert norms[0] > 1e-3 and norms[3] < 1e-11, norms


def test_the_clamp_bears_the_moment():
    """No force, and minus the moment about any point, to 1e-10."""
    moment = moment_of(np.pi / (6 * H))
    problem = solve(bender(moment), options=dea.NewtonOptions(tolerance=1e-12)).problem
    residual, scales = problem.residual(), problem.scales
    first = problem.displacement[0]
    place = first.space.tabulate_dof_coordinates()[:, :2]
    held = np.isin(first.dofs, problem.fixed)
    forces = np.stack([residual[part.dofs[held]] for part in problem.displacement], axis=1)
    x = place[held]
    borne = np.sum(x[:, 0] * forces[:, 1] - x[:, 1] * forces[:, 0])
    unit = scales.force * scales.length
    assert borne * unit == pytest.approx(-moment, rel=1e-10)
    assert np.abs(forces.sum(axis=0)).max() * scales.length * scales.force < 1e-10 * moment


@pytest.mark.parametrize("turns", [0.5, 2.0, -1.25])
def test_a_free_body_turns_without_energy(turns):
    """By up to 720 degrees: the far end goes around, and nothing is strained."""
    scene = strip(2, supports=[dea.Rigid("x_max", held="xy")],
                  prescribed=[dea.Turn("x_max", 2 * np.pi * turns)])  # fmt: skip
    run = solve(scene, steps=int(16 * abs(turns)))
    angle = 2 * np.pi * turns
    assert run["a_rad"] == pytest.approx(angle, rel=1e-12)
    assert run["far_m"] == pytest.approx(2 * H * (1 - np.cos(angle)), abs=1e-8 * H)
    assert run["x_m"] == pytest.approx(0.0, abs=1e-12 * H)
    assert abs(run["min_J"] - 1) < 1e-8
    problem = run.problem
    assert np.abs(problem.residual()).max() < 1e-8
    assert np.abs(problem.w.x.array[problem.pressure.dofs]).max() < 1e-7


def test_moment_of_a_prescribed_angle():
    """Turned to the angle that a moment reaches, by a ramp in two runs, the device is the same."""
    by_moment = solve(bender(moment_of(np.pi / (6 * H))))
    turned = strip(supports=[dea.Clamp("x_min"), dea.Rigid("x_max")],
                   prescribed=[dea.Turn("x_max", float(by_moment["a_rad"]))])  # fmt: skip
    half = solve(turned, to=0.5)
    whole = solve(turned, start=half)
    assert whole["x_m"] == pytest.approx(by_moment["x_m"], rel=1e-7)


def test_a_trace_comes_to_the_same_state():
    scene = bender(moment_of(np.pi / (6 * H)))
    ramped = solve(scene)
    record = {"a": dea.PartRotation("x_max")}
    trace = dea.Trace("load", first=0.2, until=("load_factor", 1.0))
    assert dea.solve(scene, trace, record, quiet=True)["a_rad"] == pytest.approx(
        ramped["a_rad"], rel=1e-6
    )


def test_with_a_free_stretch_of_the_depth():
    """Beside another global unknown: the strip is a little softer where the depth is free."""
    scene = bender(moment_of(np.pi / (9 * H)), kinematics=dea.GeneralisedPlaneStrain(DEPTH))
    assert solve(scene)["a_rad"] > solve(bender(moment_of(np.pi / (9 * H))))["a_rad"]


WRONG = {
    "shares nodes": dict(supports=[dea.Clamp("bottom"), dea.Rigid("x_max")]),
    "rigid twice": dict(supports=[dea.Clamp("x_min"), dea.Rigid("x_max"), dea.Rigid("x_max")]),
    "held along": dict(supports=[dea.Clamp("x_min"), dea.Rigid("x_max", "z")]),
    "do not go together": dict(supports=[dea.FreeBody(), dea.Rigid("x_max")]),
    "no facet group": dict(supports=[dea.Clamp("x_min"), dea.Rigid("x_mx")]),
    "needs a rigid part": dict(
        supports=[dea.Clamp("x_min")], loads=[dea.Moment("x_max", 1.0)]),
    "has no effect": dict(
        supports=[dea.Clamp("x_min"), dea.Rigid("x_max")], loads=[dea.Moment("x_max", 1.0)],
        prescribed=[dea.Turn("x_max", 1.0)]),
    "turned twice": dict(
        supports=[dea.Clamp("x_min"), dea.Rigid("x_max")],
        prescribed=[dea.Turn("x_max", 1.0), dea.Turn("x_max", 2.0)]),
    "move freely": dict(supports=[dea.Rigid("x_max")]),
}  # fmt: skip


@pytest.mark.parametrize("words", WRONG)
def test_what_is_refused(words):
    if words == "move freely":
        with pytest.raises(dea.InputError):
            Problem(strip(**WRONG[words]))
        return
    refused(lambda: Problem(strip(**WRONG[words])), words)


def on_these_ranks(comm):
    """Three cells, so that ranks hold one or none each; a quarter of a turn."""
    run = solve(bender(moment_of(np.pi / (6 * H)), comm=comm, length=3, across=1), steps=2)
    return [run["a_rad"], run["x_m"], run["inertia"]]


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_ranks(on_ranks, ranks):
    alone = on_these_ranks(MPI.COMM_SELF)
    assert on_ranks("test_rigid_parts", "on_these_ranks", ranks) == pytest.approx(alone, rel=1e-8)
