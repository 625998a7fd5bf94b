"""Rigid parts in space and in an axisymmetric section: rotations of any size, guides, balance."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import block
from mpi4py import MPI
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation
from stopped_runs import refused

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.rigid_turns import SpaceTurning
from dea_fenicsx.solvers.tangent import Tangent

pytestmark = pytest.mark.usefixtures("quick_compile")

MU, H = 5e4, 1e-3
RUBBER = {"film": dea.Material(dea.NeoHookean(MU))}
TIGHT = dea.NewtonOptions(tolerance=1e-12)


def bar(cells=(2, 1), comm=MPI.COMM_SELF, **conditions):
    """A bar of a square section H x H along x, with cubes as cells, clamped at its end."""
    geometry = BoxStack(cells[0] * H, H, [Layer("film", H, divisions=1)], divisions=cells)
    conditions.setdefault("supports", [dea.Clamp("x_min"), dea.Rigid("x_max")])
    return dea.Scene(dea.read_gmsh(geometry, comm), RUBBER, **conditions)


def borne(problem, where="x_min"):
    """Force and moment about the origin, in N and N m, with which a clamp holds the device."""
    residual, device = problem.residual(), problem.scene.device
    first = problem.displacement[0]
    local = first.on(2, device.facets_of(where))
    x = first.space.tabulate_dof_coordinates()[local] * problem.scales.length
    forces = np.stack([residual[part.dofs[local]] for part in problem.displacement], axis=1)
    forces *= problem.scales.force
    return forces.sum(axis=0), np.cross(x, forces).sum(axis=0)


def as_array(matrix):
    start, column, value = matrix.getValuesCSR()
    return csr_array((value, column, start)).toarray()


def turned_problem():
    """A bar that is turned as a whole by 2.7 rad about an oblique axis, with noise on it."""
    problem = Problem(bar())
    part = problem.rigid.parts[0]
    psi = np.array([2.0, 1.5, -1.0])
    R = Rotation.from_rotvec(psi).as_matrix()
    values = problem.state.values.copy()
    X = problem.displacement[0].space.tabulate_dof_coordinates()
    for a in range(3):
        values[problem.displacement[a].dofs] = (X @ (R - np.eye(3)).T)[:, a]
    q = [*((R - np.eye(3)) @ part.centre), *psi]
    for dofs, value in zip(part.unknowns, q, strict=True):
        values[dofs] = value
    problem.commit(problem.state.with_values(values))
    assert np.abs(problem.w.x.array - values).max() < 1e-14
    assert np.abs(problem.residual()).max() < 1e-13
    random = np.random.default_rng(1)
    problem.commit(problem.moved(problem.state, 0.01 * random.standard_normal(len(problem.free))))
    return problem, random


def test_tangent():
    """Order 2 of the residual's remainder; off equilibrium spins do not commute.

    For forces r at arms y the spin rows g = sum y x r change by the symmetric second derivative
    and by -g x w/2, which vanishes in equilibrium.
    """
    problem, random = turned_problem()
    tangent, here = Tangent(problem), problem.state
    rows = problem.rigid.rows(problem.conditions.groups, problem.free)
    direction = random.standard_normal(len(problem.free))
    force, along = problem.unbalanced(problem.residual()), tangent.times(direction)
    dense = as_array(tangent.matrix())
    assert np.allclose(dense @ direction, along, rtol=0, atol=1e-12 * np.abs(along).max())
    assert np.abs(dense - dense.T).max() < 1e-12 * np.abs(dense).max()
    exact = along.copy()
    exact[rows] -= np.cross(force[rows], direction[rows]) / 2
    errors = []
    for h in (1e-4, 5e-5, 2.5e-5):
        with problem.at(problem.moved(here, h * direction)):
            rest = problem.unbalanced(problem.residual()) - force - h * exact
        errors.append((np.linalg.norm(rest), np.linalg.norm(rest[rows])))
    ratios = np.array(errors[:-1]) / np.array(errors[1:])
    assert np.all(np.abs(ratios - 4) < 0.2), ratios
    second = problem.rigid.stiffness(problem.residual(), problem.w.x.array)
    assert np.abs(second).max() > 1e-4 * np.abs(dense[np.ix_(rows, rows)]).max()


def test_rotations_pass_whole_turns():
    """Small spins about the same axis add up; beside a whole turn no axis is singular."""
    turning = SpaceTurning()
    axis, psi = np.array([2.0, -1.0, 2.0]) / 3, np.zeros(3)
    for _ in range(100):
        psi = turning.composed(0.15 * axis, psi)
    assert psi == pytest.approx(15.0 * axis, rel=1e-12)
    psi = turning.composed(-2e-12 * axis, 2 * np.pi * axis + 1e-12 * axis)
    assert psi == pytest.approx(2 * np.pi * axis, rel=1e-11)
    across = turning.composed(np.array([0.1, 0.2, 0.0]), 2 * np.pi * axis)
    assert turning.matrix(across) == pytest.approx(turning.matrix(np.array([0.1, 0.2, 0])))


def test_a_clamp_bears_force_and_moment():
    """Of a moment of fixed axis and a force on a part that moves freely, to 1e-10."""
    M = 5e-6 * np.array([1.0, 0.5, -0.7])
    F = np.array([1e-3, -1e-3, 1e-3])
    loads = [dea.Moment("x_max", float(np.linalg.norm(M)), about=tuple(M)),
             dea.Force("x_max", tuple(F))]  # fmt: skip
    record = {
        **{f"a{k}": dea.PartRotation("x_max", k) for k in "xyz"},
        **{f"u{k}": dea.PartDisplacement("x_max", k) for k in "xyz"},
        "F": dea.PartForce("x_max", "y"), "M": dea.PartMoment("x_max", "z"),
    }  # fmt: skip
    run = dea.solve(bar((3, 1), loads=loads), dea.Ramp(steps=2), record, quiet=True, options=TIGHT)
    problem = run.problem
    force, moment = borne(problem)
    c = np.array([run[f"u{k}_m"] for k in "xyz"])
    place = problem.rigid.parts[0].centre * problem.scales.length + c
    assert force == pytest.approx(-F, abs=1e-10 * np.linalg.norm(F))
    whole = M + np.cross(place, F)
    assert moment == pytest.approx(-whole, abs=1e-10 * np.linalg.norm(whole))
    assert np.linalg.norm([run[f"a{k}_rad"] for k in "xyz"]) > 0.1
    assert abs(run["F_N"]) < 1e-10 * np.linalg.norm(F)
    assert abs(run["M_N_m"]) < 1e-10 * np.linalg.norm(M)
    assert run["newton_iterations"] < 40


def test_a_force_is_a_load_on_the_surface():
    """An even traction on a flat surface has its resultant at the mean of its nodes."""
    found = []
    for load in (dea.Force("x_max", (0.0, 0.0, 2e-3)),
                 dea.DeadLoad("x_max", (0.0, 0.0, 2e-3 / H**2))):  # fmt: skip
        run = dea.solve(bar(loads=[load]), dea.Ramp(steps=1),
                        {"u": dea.PartDisplacement("x_max", "z")}, quiet=True)  # fmt: skip
        found.append(run["u_m"])
        assert dea.Energy("loads").bind(run.problem)() == pytest.approx(2e-3 * run["u_m"])
    assert found[0] == pytest.approx(found[1], rel=1e-8)


def test_two_turns_about_an_oblique_axis():
    """By 720 degrees: the far end goes around, and nothing is strained."""
    axis = np.array([1.0, 2.0, 2.0]) / 3
    scene = bar((1, 1), supports=[dea.Rigid("x_max", held="xyz", centre=(H, 0, 0))],
                prescribed=[dea.Turn("x_max", 4 * np.pi, about=(1, 2, 2))])  # fmt: skip
    record = {f"a{k}": dea.PartRotation("x_max", k) for k in "xyz"}
    record["far"] = dea.AtPoint((0.0, 0.0, 0.0), "displacement", "x")
    record |= {
        "along": dea.PartRotation("x_max", (2, 4, 4)),
        "across": dea.PartRotation("x_max", (2, -1, 0)),
    }
    run = dea.solve(scene, dea.Ramp("turn", steps=24), record, quiet=True)
    assert [run[f"a{k}_rad"] for k in "xyz"] == pytest.approx(4 * np.pi * axis, rel=1e-12)
    assert run["along_rad"] == pytest.approx(4 * np.pi, rel=1e-12)
    assert abs(run["across_rad"]) < 1e-12
    assert abs(run["min_J"] - 1) < 1e-8
    assert np.abs(run.problem.residual()).max() < 1e-8
    angles = 4 * np.pi * run.column("turn_factor")
    expected = [(Rotation.from_rotvec(a * axis).as_matrix() - np.eye(3))[0, 0] * -H
                for a in angles]  # fmt: skip
    assert run.column("far_m") == pytest.approx(np.array(expected), abs=1e-8 * H)


def test_planes_of_symmetry_leave_the_plane_problem():
    """A slice between two planes y = const bends as in plane strain, for it may not tilt."""
    moment = 1e-6
    kept = [dea.Fix("y_min", "y"), dea.Fix("y_max", "y")]
    slice_ = bar((3, 1), supports=[dea.Clamp("x_min"), *kept, dea.Rigid("x_max")],
                 loads=[dea.Moment("x_max", -moment, about="y")])  # fmt: skip
    run = dea.solve(slice_, dea.Ramp(steps=2), {"a": dea.PartRotation("x_max", "y")}, quiet=True)
    flat = BoxStack(3 * H, None, [Layer("film", H, divisions=1)], divisions=(3,))
    plane = dea.Scene(
        dea.read_gmsh(flat, MPI.COMM_SELF), RUBBER, kinematics=dea.PlaneStrain(H),
        supports=[dea.Clamp("x_min"), dea.Rigid("x_max")], loads=[dea.Moment("x_max", moment)],
    )  # fmt: skip
    same = dea.solve(plane, dea.Ramp(steps=2), {"a": dea.PartRotation("x_max")}, quiet=True)
    assert -run["a_rad"] == pytest.approx(same["a_rad"], rel=1e-6)


@pytest.mark.parametrize("guide", [dict(along=(1.0, 0.0, 1.0)), dict(across=(1.0, 0.0, -1.0))])
def test_a_slanted_guide(guide):
    """The part goes up the slope, and its guide pushes across it alone."""
    scene = bar(supports=[dea.Clamp("x_min"), dea.Rigid("x_max", turns="", **guide)],
                loads=[dea.Force("x_max", (0.0, 0.0, 4e-3))])  # fmt: skip
    record = {"x": dea.PartDisplacement("x_max", "x"), "z": dea.PartDisplacement("x_max", "z"),
              "Fx": dea.PartForce("x_max", "x"), "Fz": dea.PartForce("x_max", "z"),
              "Fy": dea.PartForce("x_max", "y")}  # fmt: skip
    run = dea.solve(scene, dea.Ramp(steps=1), record, quiet=True, options=TIGHT)
    assert run["x_m"] == pytest.approx(run["z_m"], rel=1e-9) and run["z_m"] > 1e-2 * H
    assert run["Fx_N"] + run["Fz_N"] == pytest.approx(0.0, abs=1e-13)
    assert abs(run["Fx_N"]) > 1e-4 and abs(run["Fy_N"]) < 1e-12
    force, _ = borne(run.problem)
    assert force[2] + run["Fz_N"] == pytest.approx(-4e-3, rel=1e-9)


def test_a_rigid_region_moves_as_its_end():
    """The last of two cells is rigid: its inside moves with it, and the first one is strained."""
    layers = [Layer("film", H, divisions=1), Layer("lid", H, divisions=1)]
    device = dea.read_gmsh(BoxStack(H, H, layers, divisions=(1, 1)), MPI.COMM_SELF)
    scene = dea.Scene(
        device, {"film": RUBBER["film"], "lid": RUBBER["film"]},
        supports=[dea.Clamp("bottom"), dea.Rigid("lid")],
        loads=[dea.Force("lid", (2e-3, 0.0, 5e-3))],
    )  # fmt: skip
    record = {"top": dea.MeanStretch(("bottom", "top"), "z"),
              "lid": dea.AtPoint((0.3 * H, 0.3 * H, 1.7 * H), "stretch", "x"),
              "turn": dea.PartRotation("lid", "y")}  # fmt: skip
    run = dea.solve(scene, dea.Ramp(steps=1), record, quiet=True)
    assert run["lid"] == pytest.approx(1.0, abs=1e-10)
    assert run["top"] > 1.001 and run["turn_rad"] > 1e-3


def ring(**conditions):
    """A ring r = H to 3 H of height H, whose outer side is clamped and whose inner one is rigid."""
    device = block((4, 2), size=2 * H, thickness=H)
    device.mesh.geometry.x[:, 0] += device.mesh.geometry.x[:, 0].max() / 2
    supports = [dea.Clamp("x_max"), dea.Rigid("x_min")]
    return dea.Scene(device, RUBBER, supports=supports, kinematics=dea.Axisymmetric(), **conditions)


def test_axial_part():
    """An axisymmetric part has one unknown: a force moves it, and the rim bears that force."""
    record = {"u": dea.PartDisplacement("x_min", "z"), "R": dea.Reaction("x_max", "z"),
              "r": dea.LargestDisplacement("x_min", "r")}  # fmt: skip
    run = dea.solve(ring(loads=[dea.Force("x_min", (0.0, 4e-3))]), dea.Ramp(steps=2), record,
                    quiet=True, options=TIGHT)  # fmt: skip
    assert run["R_N"] == pytest.approx(-4e-3, rel=1e-10)
    assert run["r_m"] == 0.0
    # moved by as much, it is held by the same force
    moved = ring(prescribed=[dea.Displacement("x_min", "z", float(run["u_m"]))])
    back = dea.solve(moved, dea.Ramp("stretch", steps=2), {"F": dea.PartForce("x_min", "z")},
                     quiet=True, options=TIGHT)  # fmt: skip
    assert back["F_N"] == pytest.approx(4e-3, rel=1e-8)


CLAMP = dea.Clamp("x_min")
WRONG = {
    "shares nodes with Clamp": dict(supports=[dea.Clamp("bottom"), dea.Rigid("x_max")]),
    "shares nodes with another": dict(
        supports=[dea.Rigid("x_max", "xyz", turns=""), dea.Rigid("top")]),
    "Clamp acts on it": dict(supports=[dea.Clamp("x_max"), dea.Rigid("x_max")]),
    "no facet group or region": dict(supports=[CLAMP, dea.Rigid("x_mx")]),
    "must turn about none": dict(supports=[CLAMP, dea.Rigid("x_max", turns="xy")]),
    "more than one of": dict(supports=[CLAMP, dea.Rigid("x_max", "x", along=(1, 0, 0))]),
    "has 2 components": dict(supports=[CLAMP, dea.Rigid("x_max", along=(1, 0))]),
    "a direction": dict(supports=[CLAMP, dea.Rigid("x_max", across=(0, 0, 0))]),
    "is guided": dict(supports=[CLAMP, dea.Rigid("x_max", "x")],
                      prescribed=[dea.Displacement("x_max", "x", 1e-4)]),
    "turn about z alone": dict(supports=[CLAMP, dea.Rigid("x_max", turns="z")],
                               loads=[dea.Moment("x_max", 1.0, about="x")]),
    "out of a plane of symmetry": dict(
        supports=[CLAMP, dea.Fix("y_min", "y"), dea.Rigid("x_max")],
        prescribed=[dea.Turn("x_max", 1.0, about="z")]),
    "needs a rigid part": dict(supports=[CLAMP], loads=[dea.Force("x_max", (1.0, 0, 0))]),
    "tuple of 3": lambda: dict(supports=[CLAMP, dea.Rigid("x_max")],
                  loads=[dea.Moment("x_max", 1.0, about=(0, 1))]),
    "translation along z": dict(
        supports=[dea.Rigid("x_max", "xy", turns="")], loads=[dea.Force("x_max", (0, 0, 1.0))]),
}  # fmt: skip


@pytest.mark.parametrize("words", WRONG)
def test_what_is_refused(words):
    def make():
        given = WRONG[words]
        return Problem(bar(**(given() if callable(given) else given)))

    refused(make, words)


def test_parts_hold_a_device():
    """Two hinges hold a bar that nothing else does: each prevents its own share of motions."""
    hinges = [dea.Rigid("x_min", "xyz", turns="y"), dea.Rigid("x_max", "z")]
    Problem(bar(supports=hinges))
    loose = [dea.Rigid("x_min", "xyz", turns="y"), dea.Rigid("x_max", "x")]
    refused(lambda: Problem(bar(supports=loose)), "rotation about the y axis")


def on_these_ranks(comm):
    """Two cells, so that ranks hold one or none."""
    loads = [dea.Moment("x_max", 2e-6, about=(1, 1, 0)), dea.Force("x_max", (0, 0, 5e-4))]
    record = {"a": dea.PartRotation("x_max", "x"), "u": dea.PartDisplacement("x_max", "z"),
              "M": dea.PartMoment("x_max", "z")}  # fmt: skip
    run = dea.solve(bar(comm=comm, loads=loads), dea.Ramp(steps=1), record, quiet=True)
    return [run["a_rad"], run["u_m"], run["inertia"], 1 + run["M_N_m"]]


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_ranks(on_ranks, ranks):
    alone = on_these_ranks(MPI.COMM_SELF)
    assert on_ranks("test_rigid_space", "on_these_ranks", ranks) == pytest.approx(alone, rel=1e-8)
