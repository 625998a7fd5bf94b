"""Points that carry the mass of bodies attached to rigid parts.

A body with the mass m, its centre of mass at the centre of a part and the moments of inertia I_k
has the kinetic energy

    T = m/2 |c'|^2 + 1/2 sum_k J_k |R' e_k|^2,      J_k = (I_1 + I_2 + I_3)/2 - I_k,

with the velocity c' of the centre and the rotation R.  So we let points at 0, e_1, e_2, e_3 from
the centre follow the part as its nodes do, with the mass m at the first of them and with J_k on the
difference of the others to it.  In the plane one point at e_1 with I_3 is enough.  Whatever a
scheme does with the inertia of nodes, it then does with that of attached bodies.  The points are
degrees of freedom of one cell; those of all other cells are fixed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dea_fenicsx.mesh.device import Device
from dea_fenicsx.model.fixed_values import FixedValues
from dea_fenicsx.model.rigid_parts import RigidPart
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.model.unknowns import Unknowns
from dea_fenicsx.scene.attached import Attached
from dea_fenicsx.scene.kinematics_base import Kinematics
from dea_fenicsx.scene.part_declarations import RigidSurface
from dea_fenicsx.support.compat import PETSc


def carrying_points(
    told: RigidSurface, space: Unknowns, device: Device, kinematics: Kinematics,
    values: FixedValues,
) -> tuple[list[np.ndarray], np.ndarray]:  # fmt: skip
    """The points that carry the mass of a body attached to a part.

    Returns
    -------
    list of ndarray
        For each axis the local degrees of freedom of the points; none on a rank that does not know
        the first cell of the mesh.
    ndarray of shape (points, axes)
        Their arms from the centre, dimensionless.
    """
    dim = len(kinematics.axes)
    empty = [np.empty(0, dtype=np.int32) for _ in range(dim)]
    if not told.attached:
        return empty, np.empty((0, dim))
    parts = list(space.parts[told.attached_field].values())
    cell = int(device.mesh.topology.index_map(device.dim).global_to_local(np.array([0]))[0])
    if not kinematics.cartesian:  # a ring keeps its radius
        for part in parts[::dim]:
            values.fix(part.dofs)
    found = []
    for part in parts:
        mine = part.dofs[part.space.dofmap.list[cell].ravel()] if cell >= 0 else part.dofs[:0]
        values.fix(np.setdiff1d(part.dofs, mine))
        found.append(mine)
    points = len(parts) // dim if cell >= 0 else 0
    dofs = [np.concatenate([empty[a], *found[a::dim]]).astype(np.int32) for a in range(dim)]
    return dofs, np.eye(dim + 1, dim, -1)[:points]


def add_attached(
    matrix: Any, told: Sequence[RigidSurface], parts: Sequence[RigidPart], scales: Scales
) -> None:
    """Add the masses of attached bodies to an assembled mass matrix in s^2.  Collective."""
    bodies = [one.attached for one in told]
    if not any(bodies):
        return
    matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
    first, last = matrix.getOwnershipRange()
    for body, part in zip(bodies, parts, strict=True):
        if body is None or not part.carriers:
            continue
        block = _points_mass(body, part.carriers, scales)
        for dofs in part.dofs:
            points = dofs[part.meshed:]
            if points[0] < last - first:
                rows = (points + first).astype(PETSc.IntType)
                matrix.setValues(rows, rows, block, addv=True)
    matrix.assemble()


def _points_mass(body: Attached, points: int, scales: Scales) -> np.ndarray:
    """The mass matrix of the points along each axis, in s^2, shape (points, points)."""
    energy = scales.stress * scales.volume
    J = np.zeros(points - 1)
    if body.moments:
        moments = np.array(body.moments)
        J = (moments.sum() / 2 - moments if len(moments) > 1 else moments) / energy
    found = np.diag(np.concatenate([[body.kilograms * scales.length**2 / energy + J.sum()], J]))
    found[0, 1:] -= J
    found[1:, 0] -= J
    return found
