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
PLANE = {"quadrilateral": "quadrilateral", "triangle": "triangle"}
SPACE = {"hexahedron": "hexahedron", "tetrahedron": "tetrahedron"}


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
