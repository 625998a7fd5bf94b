"""Rigid motions and unusable cells: told before the solve, in words."""

from __future__ import annotations

import re

import basix.ufl
import numpy as np
import pytest
from conftest import block
from mpi4py import MPI
from test_input import one_sentence

import dea_fenicsx as dea
from dea_fenicsx.mesh.cell_quality import check_cells
from dea_fenicsx.mesh.device import Device
from dea_fenicsx.model.components import Component
from dea_fenicsx.model.fixed_values import FixedValues
from dea_fenicsx.model.free_body import held_body
from dea_fenicsx.model.prescribed_motion import prescriptions
from dea_fenicsx.model.rigid_motions import free_parts, joined_parts, refuse_free_parts
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx

RUBBER = dea.Material(dea.NeoHookean(50e3))
SPACE, PLANE, ROUND = dea.ThreeD(), dea.PlaneStrain(), dea.Axisymmetric()


def check(device, supports, kinematics=SPACE, prescribed=()):
    """What a solve does first: fixed displacements and rigid motions; no form is compiled.

    Returns the displacement components, the fixed values, and the pins of a free body.
    """
    scene = dea.Scene(
        device, dict.fromkeys(device.regions, RUBBER), supports=supports, prescribed=prescribed,
        kinematics=kinematics,
    )  # fmt: skip
    cell, dim = device.mesh.topology.cell_name(), kinematics.dim
    element = basix.ufl.element("Lagrange", cell, 2, shape=(dim,))
    space = dolfinx.fem.functionspace(device.mesh, element)
    parts = [Component.of(space.sub(axis)) for axis in range(dim)]
    imap = space.dofmap.index_map
    values, body = FixedValues(dim * (imap.size_local + imap.num_ghosts), scene.ramps), None
    for item in prescriptions(scene.declared.displacements, device, kinematics, parts):
        values.fix(parts[item.axis].dofs[item.local], item.values, item.ramp)
    free = free_parts(device, kinematics, parts, values.fixed)
    if free and scene.declared.holds_rigid_motions:
        body = held_body(free.pop(0), device, [])
        values.hold(body.pins, parts)
        still = free_parts(device, kinematics, parts, values.fixed)
        assert len(still) == len(free), "the pins hold every motion of the free body"
    refuse_free_parts(free, device, "Fix or Clamp" if body else "Fix, Clamp or FreeBody")
    return parts, values, () if body is None else body.pins


MOTIONS = {
    "one translation": (SPACE, [("x_min", "x"), ("y_min", "y")], "freely: translation along z;"),
    "two planes": (SPACE, [("x_min", "x"), ("bottom", "z")], "freely: translation along y;"),
    "on a table": (
        SPACE, [("bottom", "z")],
        "rotation about the z axis through (0.0005, 0.0005, 0.0005) m, translation along x and "
        "translation along y;"),
    "clamped": (
        SPACE, [("x_min", "xyz"), ("x_max", "x")], ""),
    "sliding on two rails": (
        SPACE, [("x_min", "yz")],
        "rotation about the y axis through (0, 0.0005, 0.0005) m, rotation about the z axis "
        "through (0, 0.0005, 0.0005) m and translation along x;"),
    "strip on rollers": (PLANE, [("x_min", "x")], "freely: translation along y;"),
    "strip held across": (
        PLANE, [("x_min", "y")],
        "rotation about (0, 0.0005) m and translation along x;"),
    "disc held at its rim": (ROUND, [("x_max", "r")], "freely: translation along z;"),
    "disc on a table": (ROUND, [("bottom", "z")], ""),
    "strip clamped": (PLANE, [("x_min", "xy")], ""),
    "symmetry planes": (SPACE, [("x_min", "x"), ("y_min", "y"), ("bottom", "z")], ""),
}  # fmt: skip


@pytest.mark.parametrize("case", MOTIONS)
def test_free_motions_are_named(case):
    kinematics, fixes, words = MOTIONS[case]
    device = block((2, 2, 2)[: kinematics.dim])
    supports = [dea.Fix(where, axes) for where, axes in fixes]
    if not words:
        check(device, supports, kinematics)
        return
    with pytest.raises(dea.InputError, match=re.escape(words)) as caught:
        check(device, supports, kinematics)
    one_sentence(str(caught.value))


def test_three_vertices_hold_a_free_body():
    check(block((2, 2, 2)), [dea.FreeBody()])


@pytest.mark.parametrize("shape", [((2, 2, 2), 1e-3), ((1, 1, 12), 20e-3), ((3, 3, 1), 1e-6)])
def test_a_strain_along_the_axes_does_not_turn_a_free_body(shape):
    """All that is held along an axis has the same coordinate there: it may stay where it is."""
    cells, thickness = shape
    parts, constraints, _ = check(block(cells, thickness=thickness), [dea.FreeBody()])
    assert np.count_nonzero(constraints.fixed) == 6
    for axis, part in enumerate(parts):
        X = part.space.tabulate_dof_coordinates()[constraints.fixed[part.dofs], axis]
        assert len(X) and np.ptp(X) == pytest.approx(0, abs=1e-14)


def test_prescribed_displacements_hold():
    """A film pulled apart at both ends, held along the two other axes there."""
    pulled = [dea.Displacement("x_max", "x", 1e-3)]
    check(block((2, 2, 2)), [dea.Clamp("x_min")], prescribed=pulled)
    with pytest.raises(dea.InputError, match="translation along z;"):
        check(block((2, 2, 2)), [dea.Fix("y_min", "y")], prescribed=pulled)


@pytest.mark.parametrize("thickness", [1e-3, 1e-6])
def test_thin_ends_hold(thickness):
    """A strip a thousand or a million times longer than thick, clamped at its end."""
    check(block((2, 1), size=1.0, thickness=thickness), [dea.Clamp("x_min")], PLANE)


def cubes(comm, shift, kind="hexahedron"):
    """Two unit cubes, one moved by `shift`, of vertices of their own; both have the same names."""
    one = dolfinx.mesh.create_unit_cube(
        MPI.COMM_SELF, 2, 2, 2, getattr(dolfinx.mesh.CellType, kind)
    )
    x, table = one.geometry.x, compat.geometry_dofmap(one)
    points = np.vstack([x, x + shift])
    cells = np.vstack([table, table + len(x)]).astype(np.int64)
    if comm.rank:
        points, cells = points[:0], cells[:0]
    domain = one.ufl_domain().ufl_coordinate_element()
    most_cells_at_a_facet = (2,) if compat.VERSION >= (0, 11) else ()
    partitioner = dolfinx.mesh.create_cell_partitioner(
        dolfinx.mesh.GhostMode.shared_facet, *most_cells_at_a_facet
    )
    where = (points, domain) if compat.VERSION < (0, 10) else (domain, points)
    mesh = dolfinx.mesh.create_mesh(comm, cells, *where, partitioner=partitioner)
    for d in (2, 3):
        mesh.topology.create_connectivity(d, 3)
    mesh.topology.create_connectivity(3, 2)
    n = mesh.topology.index_map(3).size_local + mesh.topology.index_map(3).num_ghosts
    tags = dolfinx.mesh.meshtags(
        mesh, 3, np.arange(n, dtype=np.int32), np.ones(n, dtype=np.int32)
    )
    left = dolfinx.mesh.locate_entities_boundary(mesh, 2, lambda p: np.isclose(p[0], 0.0))
    facets = dolfinx.mesh.meshtags(mesh, 2, np.sort(left), np.ones(len(left), dtype=np.int32))
    return Device(mesh, tags, facets, {"film": 1}, {"left": 1}, 1.0, "cubes")


def test_a_part_that_is_not_joined_is_named():
    """Two cubes side by side that share no vertices: only the first is clamped."""
    device = cubes(MPI.COMM_SELF, (1.0, 0.0, 0.0))
    assert joined_parts(device)[1] == 2
    words = "part of 8 cells around (1.5, 0.5, 0.5) m (region film) is not joined"
    with pytest.raises(dea.InputError, match=re.escape(words)) as caught:
        check(device, [dea.Clamp("left")])
    assert "every rigid motion" in str(caught.value)
    one_sentence(str(caught.value))


def test_separate_parts_may_be_held_separately():
    """Both cubes stand on the clamped plane."""
    check(cubes(MPI.COMM_SELF, (0.0, 3.0, 0.0)), [dea.Clamp("left")])


SPLIT = """
import sys
sys.path[:0] = [{tests!r}]
from mpi4py import MPI
from conftest import block
from test_rigid import PLANE, check, cubes
import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
comm = MPI.COMM_WORLD
def told(*a):
    try:
        check(*a)
        return "held"
    except dea.InputError as error:
        return str(error)
strip = BoxStack(3e-3, None, [Layer("film", 1e-3)], divisions=(3,))
device = dea.read_gmsh(strip, comm)
one = dea.read_gmsh(BoxStack(1e-3, None, [Layer("film", 1e-3)], divisions=(1,)), comm)
lines = [
    told(device, [dea.Clamp("x_min")], PLANE),
    told(device, [dea.Fix("x_min", "x")], PLANE),
    told(one, [dea.Clamp("x_min")], PLANE),
    told(one, [dea.Fix("bottom", "y")], PLANE),
    told(cubes(comm, (1.0, 0.0, 0.0)), [dea.Clamp("left")]),
    told(cubes(comm, (0.0, 3.0, 0.0)), [dea.Clamp("left")]),
]
assert len({{tuple(l) for l in comm.allgather(lines)}}) == 1
if comm.rank == 0:
    print("\\n".join(lines))
"""


@pytest.mark.mpi
def test_parts_and_motions_on_three_ranks(start, tmp_path):
    """Parts span ranks; a mesh of one cell leaves two ranks empty."""
    from conftest import ROOT

    script = tmp_path / "split.py"
    script.write_text(SPLIT.format(tests=str(ROOT / "tests")))
    lines = [start(script, ranks=n, check=True).stdout.splitlines() for n in (1, 3)]
    assert lines[0] == lines[1]
    assert [("held" in line) for line in lines[0]] == [True, False, True, False, False, True]


# ------------------------------------------------------------------------------ unusable cells


def test_a_folded_cell_is_told():
    device = block((3, 3), order=1)
    x = device.mesh.geometry.x
    x[int(np.argmin(np.linalg.norm(x[:, :2] - 1 / 3, axis=1))), 0] += 0.5
    with pytest.raises(dea.InputError, match=r"cells of .* are folded or flat") as caught:
        check_cells(device, 4)
    one_sentence(str(caught.value))


def test_an_inverted_tetrahedron_is_told():
    """A vertex pushed through the faces opposite: each Jacobian has one sign, but cells overlap."""
    device = cubes(MPI.COMM_SELF, (1.0, 0.0, 0.0), "tetrahedron")
    check_cells(device, 4)
    x = device.mesh.geometry.x
    x[int(np.argmin(np.linalg.norm(x - 0.5, axis=1))), 0] += 0.7
    with pytest.raises(dea.InputError, match=r"inverted .* the first at") as caught:
        check_cells(device, 4)
    one_sentence(str(caught.value))


@pytest.mark.parametrize("bad", [np.nan, 1e300])
def test_a_lost_node_is_told(bad):
    device = block((2, 2), order=1)
    device.mesh.geometry.x[0, 0] = bad
    with pytest.raises(dea.InputError):
        check_cells(device, 4)
