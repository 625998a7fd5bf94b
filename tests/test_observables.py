"""Observables of several surfaces together, and angles in the plane."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, HelicalCell, Layer
from dea_fenicsx.model.problem import Problem

pytestmark = pytest.mark.usefixtures("quick_compile")
RUBBER = dea.NeoHookean(5e4)
SOFT = dea.Material(RUBBER)
FILM = dea.Material(RUBBER, dea.IdealDielectric(3.0))


def block(width=1e-3, divisions=(2, 2), comm=MPI.COMM_SELF):
    layers = [Layer("film", 1e-3)]
    return dea.read_gmsh(BoxStack(1e-3, width, layers, divisions=divisions), comm)


def solve(scene, record, steps=2):
    return dea.solve(scene, dea.Ramp(steps=steps), record, quiet=True)


def reactions(comm):
    """A block clamped on two faces that meet: both together bear the load, and no node twice."""
    supports = [dea.Clamp("x_min"), dea.Clamp("bottom")]
    scene = dea.Scene(block(comm=comm), {"film": SOFT}, supports=supports,
                      loads=[dea.DeadLoad("x_max", (0, 0, -2e3))])  # fmt: skip
    both = ("x_min", "bottom")
    run = solve(scene, {
        "F": dea.Reaction(both, "z"), "again": dea.Reaction((*both, "bottom"), "z"),
        "a": dea.Reaction("x_min", "z"), "b": dea.Reaction(["bottom"], "z"),
    })  # fmt: skip
    return [float(run[f"{name}_N"]) for name in ("F", "again", "a", "b")]


def check_reactions(found):
    union, again, first, second = found
    assert union == pytest.approx(2e-3, abs=1e-12)
    assert again == pytest.approx(2e-3, abs=1e-12)
    assert abs(first + second - 2e-3) > 1e-6  # the common edge is part of each


def test_reaction_of_neighbouring_clamps():
    check_reactions(reactions(MPI.COMM_SELF))


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_reaction_on_ranks(on_ranks, ranks):
    check_reactions(on_ranks("test_observables", "reactions", ranks))


@pytest.mark.parametrize(("kinematics", "area"), [
    (dea.PlaneStrain(2e-3), 2e-6), (dea.GeneralisedPlaneStrain(2e-3), 2e-6),
    (dea.Axisymmetric(), np.pi * 1e-6),
])  # fmt: skip
def test_reaction_in_the_plane(kinematics, area):
    """The load on the upper face: 2 kPa times its area."""
    side, other = kinematics.axes[1], kinematics.axes[0]
    supports = [dea.Clamp("bottom"), dea.Fix("x_max", side), dea.Fix("x_min", other)]
    scene = dea.Scene(block(None, (3,)), {"film": SOFT}, supports=supports, kinematics=kinematics,
                      loads=[dea.DeadLoad("top", (0, 2e3))])  # fmt: skip
    run = solve(scene, {"F": dea.Reaction(("bottom", "x_max"), side)})
    assert run["F_N"] == pytest.approx(-2e3 * area, rel=1e-9)


def test_reaction_at_the_ends_of_a_helical_cell():
    """Both ends are one place, and either name stands for it."""
    geometry = HelicalCell(radial=3, rim=1, through=1)
    conductor = dea.Material(RUBBER, dea.Conductor())
    scene = dea.Scene(
        dea.read_gmsh(geometry, MPI.COMM_SELF),
        {"elastomer": FILM, "electrode_a": conductor, "electrode_b": conductor},
        [dea.Electrode("electrode_a", 3e3), dea.Ground("electrode_b")],
        [dea.FreeBody(), dea.Fix("bottom", "r")], kinematics=dea.Helical(geometry.pitch),
    )  # fmt: skip
    names = {"a": "bottom", "b": "top", "c": ("bottom", "top")}
    run = solve(scene, {key: dea.Reaction(name, "r") for key, name in names.items()}, steps=1)
    assert abs(run["c_N"]) > 1e-6
    assert [run["a_N"], run["b_N"]] == pytest.approx([run["c_N"]] * 2, rel=1e-12)


@pytest.fixture(scope="module")
def moved():
    """An L of two faces in space: x_max moves by (0.2, 0, 0.1) mm, top by (0, 0, 0.3) mm."""
    scene = dea.Scene(block(), {"film": SOFT}, supports=[dea.Clamp("bottom")])
    problem = Problem(scene)
    for a, part in enumerate(problem.displacement):
        x = part.space.tabulate_dof_coordinates()
        move = np.stack([0.2 * x[:, 0], 0 * x[:, 0], 0.1 * x[:, 0] + 0.3 * x[:, 2]])
        problem.w.x.array[part.dofs] = move[a]
    return problem


def test_surfaces_together(moved):
    """Means are weighted by area; areas add up; the largest is that of both."""
    both = ("x_max", "top")
    mean = [dea.MeanDisplacement(where, "z").bind(moved)() for where in (*both, both)]
    assert mean == pytest.approx([0.25e-3, 0.35e-3, 0.3e-3], rel=1e-12)
    largest = [dea.LargestDisplacement(w, "z").bind(moved)() for w in ("bottom", "x_max")]
    assert largest == pytest.approx([0.1e-3, 0.4e-3], rel=1e-12)
    assert dea.LargestDisplacement(("bottom", "x_max"), "z").bind(moved)() == largest[1]
    area = [dea.Area(where).bind(moved)() for where in (*both, both, (*both, "top"))]
    assert area[2:] == pytest.approx([area[0] + area[1]] * 2, rel=1e-12)


@pytest.mark.parametrize("make", [
    lambda names: dea.MeanDisplacement(names, "z"), lambda names: dea.Reaction(names, "z"),
    lambda names: dea.LargestDisplacement(names, "z"), dea.Area,
])  # fmt: skip
def test_surfaces_that_are_not_there(moved, make):
    with pytest.raises(dea.InputError, match="'tip'"):
        make(("top", "tip")).bind(moved)
    with pytest.raises(dea.InputError, match="no group"):
        make(()).bind(moved)


# ------------------------------------------------------------------------------ angles in the plane


@pytest.mark.parametrize("kinematics", [dea.PlaneStrain(1e-3), dea.GeneralisedPlaneStrain(1e-3)])
def test_bending_angle_in_the_plane(kinematics):
    """By its default axis, and by any in the plane, it is the rotation of the tip."""
    layers = [Layer("p", 2e-4), Layer("a", 2e-4)]
    device = dea.read_gmsh(BoxStack(6e-3, None, layers, divisions=(8,)), MPI.COMM_SELF)
    scene = dea.Scene(device, {"p": SOFT, "a": FILM},
                      [dea.Electrode("top", 2.5e3), dea.Ground("interface_1")],
                      [dea.Clamp("x_min")], kinematics=kinematics)  # fmt: skip
    ends = ("x_min", "x_max")
    run = solve(scene, {
        "b": dea.BendingAngle(ends), "x": dea.BendingAngle(ends, "x"),
        "y": dea.BendingAngle("x_max", "y"), "r": dea.Rotation("x_max", "z"),
    })  # fmt: skip
    found = [run[f"{name}_rad"] for name in "bxy"]
    assert found == pytest.approx([abs(run["r_rad"])] * 3, rel=1e-9)
    assert found[0] > 0.4
    with pytest.raises(dea.InputError, match="in plane strain"):
        dea.BendingAngle(ends, "z").bind(run.problem)
    assert dea.Rotation("x_max", "x").bind(run.problem)() == pytest.approx(0, abs=1e-12)


def test_no_angles_in_a_section():
    """A ring does not turn as a whole."""
    scene = dea.Scene(block(None, (2,)), {"film": SOFT}, supports=[dea.Clamp("bottom")],
                      kinematics=dea.Axisymmetric())  # fmt: skip
    problem = Problem(scene)
    for wrong in (dea.BendingAngle("top"), dea.Rotation("top", "x"), dea.Rotation("top", "z")):
        with pytest.raises(dea.InputError, match="three dimensions and in plane strain only"):
            wrong.bind(problem)
