"""Inf-sup constants of the pairs of displacement and pressure, of degree 2, 3 and 4.

The constant is the least value over all q of the largest one over all v of

    int q div v dX / (|grad v| |q|),

with norms in L2, v = 0 on the whole boundary, and q without a mean.  It is the square root of the
second least eigenvalue of B A^-1 B^T q = lambda M q.  The pair is stable if the constant stays away
from 0 as the mesh becomes finer.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
import ufl
from conftest import on_demand
from mpi4py import MPI
from scipy.sparse.linalg import splu

import dea_fenicsx as dea
from dea_fenicsx.model.fields import declared_fields
from dea_fenicsx.support.compat import dolfinx

pytestmark = pytest.mark.usefixtures("quick_compile")
RUBBER = {"rubber": dea.Material(dea.NeoHookean(1.0))}


def unit_mesh(cell, divisions):
    """A unit square or cube with its cells along each axis."""
    kind = getattr(dolfinx.mesh.CellType, cell)
    if len(divisions) == 2:
        return dolfinx.mesh.create_unit_square(MPI.COMM_SELF, *divisions, kind)
    return dolfinx.mesh.create_unit_cube(MPI.COMM_SELF, *divisions, kind)


def inf_sup(cell, degree, divisions):
    """The inf-sup constant of the package's own elements."""
    device = dea.from_dolfinx(unit_mesh(cell, divisions), regions="rubber", surfaces={
        "left": dea.OnPlane("x", 0.0)})  # fmt: skip
    scene = dea.Scene(
        device, RUBBER, supports=[dea.Clamp("left")],
        kinematics=dea.PlaneStrain() if device.dim == 2 else dea.ThreeD(),
        elements=dea.Discretisation(degree=degree),
    )  # fmt: skip
    mesh, (motion, pressure) = device.mesh, declared_fields(scene)
    V = dolfinx.fem.functionspace(mesh, motion.element.sub_elements[0])  # one component
    Q = dolfinx.fem.functionspace(mesh, pressure.element)
    u, v, p, q = (f(space) for space in (V, Q) for f in (ufl.TrialFunction, ufl.TestFunction))

    def matrix(form):
        return dolfinx.fem.assemble_matrix(dolfinx.fem.form(form * ufl.dx)).to_scipy().tocsc()

    outer = dolfinx.mesh.exterior_facet_indices(mesh.topology)
    held = dolfinx.fem.locate_dofs_topological(V, device.dim - 1, outer)
    free = np.setdiff1d(np.arange(V.dofmap.index_map.size_local), held)
    factor = splu(matrix(ufl.inner(ufl.grad(u), ufl.grad(v)))[free][:, free])
    inner, M = 0.0, matrix(p * q)
    for axis in range(device.dim):
        B = matrix(q * u.dx(axis))[:, free]
        inner += B @ factor.solve(B.T.toarray())
    found = scipy.linalg.eigvalsh((inner + inner.T) / 2, M.toarray())
    assert abs(found[0]) < 1e-10  # of a constant pressure
    return float(np.sqrt(max(found[1], 0.0)))


SQUARE, CUBE = [(2, 2), (4, 4), (8, 8)], [(1, 1, 1), (2, 2, 2), (3, 3, 3)]
LONG = [(2, 20), (4, 40), (8, 80)]
"""Cells ten times as long as high."""
CASES = [
    ("quadrilateral", 2, SQUARE, 0.45), ("quadrilateral", 3, SQUARE, 0.45),
    ("quadrilateral", 4, SQUARE, 0.45), ("quadrilateral", 2, LONG, 0.14),
    ("quadrilateral", 3, LONG[:2], 0.24), ("quadrilateral", 4, LONG[:2], 0.34),
    ("triangle", 2, SQUARE, 0.35), ("triangle", 3, SQUARE, 0.26), ("triangle", 4, SQUARE, 0.2),
    ("triangle", 2, LONG, 0.36), ("triangle", 3, LONG[:2], 0.25), ("triangle", 4, LONG[:2], 0.19),
    ("hexahedron", 2, CUBE, 0.35), ("hexahedron", 3, CUBE, 0.37), ("hexahedron", 4, CUBE, 0.37),
    ("hexahedron", 2, [(2, 2, 20), (3, 3, 30)], 0.12),
    ("hexahedron", 3, [(1, 1, 10), (2, 2, 20)], 0.14),
    ("hexahedron", 4, [(1, 1, 10), (2, 2, 20)], 0.23),
    ("tetrahedron", 2, [(2, 2, 2), (3, 3, 3), (4, 4, 4)], 0.17),
    ("tetrahedron", 3, [(2, 2, 2), (3, 3, 3), (4, 4, 4)], 0.14),
    ("tetrahedron", 4, [(2, 2, 2), (3, 3, 3)], 0.12),
    ("tetrahedron", 2, [(2, 2, 20), (3, 3, 30)], 0.14),
    ("tetrahedron", 3, [(2, 2, 20)], 0.07), ("tetrahedron", 4, [(2, 2, 20)], 0.05),
]  # fmt: skip
"""Cell, degree, meshes from coarse to fine, and a bound that all of their constants keep."""


def check(cell, degree, meshes, bound):
    found = [inf_sup(cell, degree, divisions) for divisions in meshes]
    assert min(found) > bound and found[-1] > 0.9 * found[-2:][0], found


def test_quadrilaterals_of_degree_3():
    check(*CASES[1])


@on_demand
@pytest.mark.parametrize(("cell", "degree", "meshes", "bound"), CASES)
def test_no_pair_loses_its_constant(cell, degree, meshes, bound):
    check(cell, degree, meshes, bound)
