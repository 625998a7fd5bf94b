"""A closed cavity: which walls and planes enclose a volume, and how large it is."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import block
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, HollowSphere, Layer, MembraneDisc, Tube
from dea_fenicsx.mesh.rims import outer_facets, rim_of
from dea_fenicsx.model.problem import Problem

MU, EDGE = 50e3, 1e-3
RUBBER = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(3.0), bulk_modulus=20 * MU)
QUICK = dict(liquid=1e-10, ramp="fill")
PLANES = {
    "half": [dea.Fix("axis", "r"), dea.Fix("equator", "z")],
    "whole": [dea.Fix("axis", "r"), dea.FreeBody()],
    "octant": [dea.Fix(f"{axis}_min", axis) for axis in "xyz"],
}


def sphere(part, comm=MPI.COMM_SELF, layers=1, cells=6):
    return dea.read_gmsh(HollowSphere(10e-3, 12e-3, part, layers, cells), comm)


def scene_of(device, where, supports, kinematics=None, **given):
    return dea.Scene(
        device, {name: RUBBER for name in device.regions}, supports=supports,
        loads=[dea.Cavity(where, **(QUICK | given))], kinematics=kinematics or dea.ThreeD(),
    )  # fmt: skip


def balloon(part, supports=None, **given):
    kinematics = dea.ThreeD() if part == "octant" else dea.Axisymmetric()
    return scene_of(sphere(part), "inner", supports or PLANES[part], kinematics, **given)


def moved_volume(problem, gradient, where="inner"):
    """Deformed volume of a cavity where the displacement is linear in space."""
    values = problem.state.values.copy()
    for a, part in enumerate(problem.displacement):
        x = part.space.tabulate_dof_coordinates()
        values[part.dofs] = x[:, : len(gradient)] @ gradient[a]
    measured = dea.CavityVolume(where).bind(problem)
    with problem.at(problem.state.with_values(values)):
        problem.w.x.scatter_forward()
        return measured()


@pytest.mark.parametrize("part, share", [("half", 1 / 2), ("whole", 1.0), ("octant", 1 / 8)])
def test_volume_of_a_sphere(part, share):
    """4/3 pi a^3, but for the parabolas of the mesh; a linear motion scales it by det F."""
    problem = Problem(balloon(part))
    volume = dea.CavityVolume("inner").bind(problem)()
    assert volume == pytest.approx(share * 4 / 3 * np.pi * 10e-3**3, rel=3e-4)
    if part == "octant":
        found, det = moved_volume(problem, np.diag([0.1, 0.2, -0.3])), 1.1 * 1.2 * 0.7
    else:
        found, det = moved_volume(problem, np.diag([0.1, 0.3])), 1.1**2 * 1.3
    assert found == pytest.approx(det * volume, rel=1e-12)


def test_a_shift_of_a_closed_cavity_changes_nothing():
    """The whole section has no plane, so its volume may not depend on where it lies."""
    problem = Problem(balloon("whole"))
    values = problem.state.values.copy()
    values[problem.displacement[1].dofs] += 0.37
    measured = dea.CavityVolume("inner").bind(problem)
    before = measured()
    with problem.at(problem.state.with_values(values)):
        assert measured() == pytest.approx(before, rel=1e-13)


@pytest.mark.parametrize("axes", ["", "x", "y"])
def test_box_with_a_hole_in_plane_strain(axes):
    """Half a square pipe: two walls and a roof beside a plane of symmetry, held or stated.

    The area is 2 mm x 1 mm and the depth 3 mm.
    """
    device = pipe()
    supports = {"": [dea.Fix("foot", "y"), dea.Fix("left", "x")],
                "x": [dea.Clamp("top")], "y": [dea.Clamp("top")]}[axes]  # fmt: skip
    given = {"symmetry": "y"} if axes == "y" else {"openings": "y"} if axes == "x" else {}
    scene = scene_of(device, "hole", supports, dea.PlaneStrain(3e-3), **given)
    problem = Problem(scene)
    volume = 2e-3 * 1e-3 * 3e-3
    assert dea.CavityVolume("hole").bind(problem)() == pytest.approx(volume, rel=1e-12)
    linear = np.array([[0.2, 0.0], [0.0, -0.1]])
    assert moved_volume(problem, linear, "hole") == pytest.approx(1.2 * 0.9 * volume, rel=1e-12)


class Pipe:
    """A block of 4 mm x 2 mm with a hole of 2 mm x 1 mm in the middle of its foot."""

    def build(self):
        import gmsh

        if not gmsh.isInitialized():
            gmsh.initialize(interruptible=False)
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("pipe")
        occ = gmsh.model.occ
        outer = occ.addRectangle(-2e-3, 0, 0, 4e-3, 2e-3)
        hole = occ.addRectangle(-1e-3, 0, 0, 2e-3, 1e-3)
        occ.cut([(2, outer)], [(2, hole)])
        occ.synchronize()
        names = {"foot": [], "hole": [], "left": [], "right": [], "top": []}
        for _, line in gmsh.model.getEntities(1):
            x, y, _ = gmsh.model.occ.getCenterOfMass(1, line)
            name = ("left" if x < -1.9e-3 else "right" if x > 1.9e-3 else "top" if y > 1.9e-3
                    else "foot" if y < 1e-6 and abs(x) > 1e-3 else "hole")  # fmt: skip
            names[name].append(line)
        for name, lines in names.items():
            gmsh.model.addPhysicalGroup(1, lines, name=name)
        gmsh.model.addPhysicalGroup(2, [e for _, e in gmsh.model.getEntities(2)], name="wall")
        gmsh.model.mesh.setSize(gmsh.model.getEntities(0), 1e-3)
        gmsh.model.mesh.generate(2)
        return gmsh.model


def pipe():
    return dea.read_gmsh(Pipe(), MPI.COMM_SELF)


def test_held_rims_close_flat():
    """A clamped membrane over a hollow: its own lift is the volume, from 0."""
    disc = MembraneDisc(12e-3, 4e-3, 1e-3, cells=(2, 1, 2))
    scene = scene_of(
        dea.read_gmsh(disc, MPI.COMM_SELF), "bottom", [dea.Clamp("rim"), dea.Fix("axis", "r")],
        dea.Axisymmetric(),
    )  # fmt: skip
    problem = Problem(scene)
    assert dea.CavityVolume("bottom").bind(problem)() == pytest.approx(0, abs=1e-20)
    values = problem.state.values.copy()
    part = problem.displacement[1]
    r = part.space.tabulate_dof_coordinates()[:, 0]
    values[part.dofs] = (1 - (r / r.max()) ** 2) * 0.25
    with problem.at(problem.state.with_values(values)):
        lift = 0.25 * problem.scales.length
        paraboloid = np.pi / 2 * (12e-3) ** 2 * lift
        assert dea.CavityVolume("bottom").bind(problem)() == pytest.approx(paraboloid, rel=1e-12)


# ------------------------------------------------------------------------------ refusals


def refusal(make):
    with pytest.raises(dea.InputError) as told:
        make()
    return str(told.value)


def test_an_open_cavity_names_its_edge():
    found = refusal(lambda: balloon("half", [dea.Fix("axis", "r"), dea.FreeBody()]))
    assert "'inner' of a cavity is not closed" in found
    assert "the point (0.01, 0, 0) m" in found
    found = refusal(lambda: balloon("octant", [*PLANES["octant"][:2], dea.FreeBody()]))
    assert "6 of its edges are open, such as the edge from (" in found
    assert ", 0) m to (" in found
    assert "openings='z'" in found


def test_a_moved_rim_is_open():
    """A plane that a ramp moves does not close a cavity by itself; openings= says what does."""
    device = sphere("half")
    moved = [dea.Displacement("equator", "z", 1e-3)]

    def scene(**given):
        return dea.Scene(
            device, {"wall": RUBBER}, supports=[dea.Fix("axis", "r")], prescribed=moved,
            loads=[dea.Cavity("inner", **(QUICK | given))], kinematics=dea.Axisymmetric(),
        )  # fmt: skip

    assert "not closed" in refusal(scene)
    problem = Problem(scene(openings="z"))
    half = 2 / 3 * np.pi * 10e-3**3
    assert dea.CavityVolume("inner").bind(problem)() == pytest.approx(half, rel=1e-4)


def test_all_walls_of_a_block_enclose_material():
    walls = ("x_min", "x_max", "y_min", "y_max", "bottom", "top")
    found = refusal(lambda: scene_of(block((1, 1, 1)), walls, [dea.FreeBody()]))
    assert "encloses the material and no cavity" in found
    found = refusal(lambda: scene_of(block((1, 1, 1)), walls[:5], [dea.FreeBody()]))
    assert "4 of its edges are open" in found


def test_what_else_is_refused():
    layers = [Layer("low", EDGE), Layer("high", EDGE)]
    stack = BoxStack(EDGE, None, layers, divisions=(2,))
    device = dea.read_gmsh(stack, MPI.COMM_SELF)
    inside = next(name for name in device.surfaces if name.startswith("interface"))
    found = refusal(lambda: scene_of(device, inside, [dea.Clamp("bottom")], dea.PlaneStrain()))
    assert "lies inside the device" in found
    both = [dea.Cavity("inner", gas=1.0), dea.Cavity(("inner",), liquid=1e-9, ramp="more")]

    def twice():
        return dea.Scene(sphere("half"), {"wall": RUBBER}, supports=PLANES["half"], loads=both,
                         kinematics=dea.Axisymmetric())  # fmt: skip

    assert "is a wall of two cavities" in refusal(twice)
    for given, words in [
        (dict(liquid=None), "exactly one of gas=, liquid= and pressure="),
        (dict(gas=1.0), "gas= and liquid="),
        (dict(liquid=np.nan), "must be a finite number"),
        (dict(exponent=0.9), "must be a number >= 1"),
        (dict(outside=-1.0), "must be a number >= 0"),
        (dict(reservoir=-1.0), "must be a number >= 0"),
        (dict(reference_volume=0.0), "must be a volume > 0"),
        (dict(openings="x"), "some of r, z"),
        (dict(symmetry="q"), "some of r, z"),
    ]:
        assert words in refusal(lambda given=given: balloon("half", **given)), given
    disc = dea.read_gmsh(MembraneDisc(12e-3, 4e-3, 1e-3, cells=(1, 1, 1)), MPI.COMM_SELF)
    held = [dea.Clamp("rim"), dea.Fix("axis", "r")]
    gas = dict(liquid=None, gas=1.0)
    found = refusal(lambda: scene_of(disc, "bottom", held, dea.Axisymmetric(), **gas))
    assert "has no volume in the undeformed body" in found
    found = refusal(lambda: Problem(balloon("half")) and
                    dea.CavityPressure("outer").bind(Problem(balloon("half"))))  # fmt: skip
    assert "needs a cavity with these walls" in found


def rims(comm):
    """Places of open edges, and the volume, on any number of ranks."""
    device = sphere("octant", comm)
    rim = rim_of(device, outer_facets(device, ["inner"]))
    try:
        dea.Scene(device, {"wall": RUBBER}, supports=[dea.Fix("x_min", "x"), dea.FreeBody()],
                  loads=[dea.Cavity("inner", **QUICK)])  # fmt: skip
        told = ""
    except dea.InputError as error:
        told = str(error)
    scene = dea.Scene(device, {"wall": RUBBER}, supports=PLANES["octant"],
                      loads=[dea.Cavity("inner", **QUICK)])  # fmt: skip
    space = scene.declared.fillings[0].space
    return [len(rim), told, space.volume, space.area, list(space.origin), list(space.shares)]


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_ranks_agree_about_the_rim(ranks, on_ranks):
    one, many = rims(MPI.COMM_SELF), on_ranks("test_cavity_closed", "rims", ranks)
    assert many[:2] == one[:2]
    assert many[2:4] == pytest.approx(one[2:4], rel=1e-12)
    assert many[4:] == [pytest.approx(v, abs=1e-12) for v in one[4:]]


def test_gas_behind_a_flat_wall_is_refused_before_its_rim():
    """A flat wall holds no gas however its rim is closed; a free rim alone is told as before."""
    disc = dea.read_gmsh(MembraneDisc(12e-3, 4e-3, 1e-3, cells=(2, 1, 2)), MPI.COMM_SELF)
    free = ("bottom", [dea.Fix("axis", "r"), dea.FreeBody()], dea.Axisymmetric())
    gas = dict(liquid=None, gas=1e-6)
    assert "has no volume" in refusal(lambda: scene_of(disc, *free, **gas))
    assert "not closed" in refusal(lambda: scene_of(disc, *free, **gas, reservoir=1e-9))
    assert "not closed" in refusal(lambda: scene_of(disc, *free))
    cube = block((1, 1, 1))
    assert "has no volume" in refusal(lambda: scene_of(cube, "top", [dea.Clamp("bottom")], **gas))
    # the normal of a straight pipe is radial, which is not flat
    pipe = dea.read_gmsh(Tube(1e-3, 2e-3, [Layer("wall", 1e-3)], axial=2), MPI.COMM_SELF)
    held = [dea.Clamp("bottom"), dea.Clamp("top")]
    scene_of(pipe, "inner", held, dea.Axisymmetric(), **gas)
