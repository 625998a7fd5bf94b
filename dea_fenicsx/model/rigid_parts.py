"""Rigid parts: surfaces whose nodes move as one body, which may turn by any angle in the plane.

All nodes of the surface move by

    u = c + (R(theta) - 1) (X - X0),

with X0 the mean of the nodes.  The translation c and the angle theta are global unknowns q, and the
nodes follow them: u = g(q).  With the residual r(u) and the tangent K of the nodes as if they were
free, the rows and the tangent of q are

    (dg/dq)^T r        and        (dg/dq)^T K (dg/dq)  +  r . d2g/dq2.

The second part keeps Newton's method quadratic at large angles.  Since d2g/dtheta2 is
-R(theta) (X - X0), and all other second derivatives vanish, it is one number for each part: minus
the sum of r . R(theta) (X - X0) over the nodes.  Nothing is approximate at a large angle, and no
angle is singular.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.mesh.device import Device
from dea_fenicsx.model.components import Component
from dea_fenicsx.model.fixed_values import FixedValues
from dea_fenicsx.model.tied_unknowns import Group, Rows
from dea_fenicsx.scene.declarations import RigidAngle, RigidMoment, RigidSurface
from dea_fenicsx.support.errors import InputError


@dataclass(frozen=True)
class RigidPart:
    """One rigid part on this rank.

    Attributes
    ----------
    name
        The surface.
    dofs
        Local displacement degrees of freedom of its nodes, one array for each axis in the same
        order of the nodes, ghosts included.
    arms
        X - X0 of each node, dimensionless, shape (nodes, 2).
    unknowns
        Local degrees of freedom of c along each axis and of theta: one constant a cell, all alike.
    """

    name: str
    dofs: tuple[np.ndarray, ...]
    arms: np.ndarray
    unknowns: tuple[np.ndarray, ...]

    def values(self, array: np.ndarray) -> np.ndarray:
        """c and theta in an array over local degrees of freedom; 0 where this rank has no cell."""
        return np.array([array[dofs[0]] if len(dofs) else 0.0 for dofs in self.unknowns])

    def turned(self, angle: float) -> np.ndarray:
        """R(theta) (X - X0), shape (nodes, 2)."""
        c, s = np.cos(angle), np.sin(angle)
        return self.arms @ np.array([[c, s], [-s, c]])

    def by_angle(self, angle: float) -> np.ndarray:
        """dR/dtheta (X - X0), shape (nodes, 2)."""
        x, y = self.turned(angle).T
        return np.stack([-y, x], axis=1)

    def place(self, array: np.ndarray) -> None:
        """Put the nodes where c and theta of the same array say."""
        *c, angle = self.values(array)
        moved = self.turned(angle) - self.arms
        for a, dofs in enumerate(self.dofs):
            array[dofs] = c[a] + moved[:, a]

    def follow(self, change: np.ndarray, angle: float) -> None:
        """Let the nodes follow a small change of c and theta, at an angle."""
        *c, turn = self.values(change)
        moved = turn * self.by_angle(angle)
        for a, dofs in enumerate(self.dofs):
            change[dofs] = c[a] + moved[:, a]


class RigidParts:
    """All rigid parts of a problem.

    Parameters
    ----------
    declared
        The surfaces that move as one body.
    device
        The device.
    motion
        The displacement components.
    fields
        For each field its scalar parts, by name, see `Unknowns.parts`.
    rows
        The degrees of freedom that this rank owns.
    """

    def __init__(
        self,
        declared: Sequence[RigidSurface],
        device: Device,
        motion: Sequence[Component],
        fields: dict[str, dict[str, Component]],
        rows: Rows,
    ) -> None:
        self._rows = rows
        self._held = {told.surface: told.held for told in declared}
        self.parts = [_part(told, device, motion, fields[told.field], rows) for told in declared]

    def __bool__(self) -> bool:
        return bool(self.parts)

    def fix(self, values: FixedValues, turned: Sequence[RigidAngle]) -> np.ndarray:
        """Fix what is held or prescribed of the parts.  Collective.

        Parameters
        ----------
        values
            The values that are fixed already, and that are added to.
        turned
            The angles by which parts are turned.

        Returns
        -------
        ndarray
            Mask of the local degrees of freedom that are held or given by rigid parts that cannot
            move by themselves.

        Raises
        ------
        InputError
            If a part shares a node with a support, a prescribed motion or another part, or is
            turned twice.
        """
        given = np.zeros(len(values.fixed), dtype=bool)
        taken = values.fixed.copy()
        angles = {told.surface: told for told in turned}
        for part in self.parts:
            held = self._held[part.name]
            mine = np.concatenate(part.dofs)
            if self._rows.comm.allreduce(bool(taken[mine].any()), op=MPI.LOR):
                raise InputError(
                    f"The rigid part {part.name!r} shares nodes with a support, a prescribed "
                    "displacement or another rigid part; a node can follow one of them only."
                )
            taken[mine] = True
            for axis, unknown in zip("xy", part.unknowns, strict=False):
                if axis in held:
                    values.fix(unknown)
            if part.name in angles:
                turn = angles[part.name]
                values.fix(part.unknowns[-1], turn.radians, turn.ramp)
            given[mine] = len(held) == len(part.dofs) and part.name in angles
        return given

    def followers(self, owned: int) -> np.ndarray:
        """Mask of the owned degrees of freedom that follow the parts."""
        found = np.zeros(owned, dtype=bool)
        for part in self.parts:
            for dofs in part.dofs:
                found[dofs[dofs < owned]] = True
        return found

    def groups(
        self, fixed: np.ndarray, moments: Sequence[RigidMoment], unit: float
    ) -> list[Group]:
        """One group for each unknown of a part that is not fixed, with its moments.  Collective.

        Parameters
        ----------
        fixed
            Mask of the fixed local degrees of freedom.
        moments
            The moments on the parts.
        unit
            The unit of moment in N m.
        """
        found = []
        for part in self.parts:
            for k, dofs in enumerate(part.unknowns):
                if self._rows.comm.allreduce(bool(np.all(fixed[dofs])), op=MPI.LAND):
                    continue
                mine = [m for m in moments if m.surface == part.name and k == len(part.dofs)]
                sources = tuple((m.ramp, -m.newton_metres / unit) for m in mine)
                found.append(Group.of(dofs, self._rows, sources))
        return found

    def place(self, array: np.ndarray) -> None:
        """Put all nodes of the parts where their unknowns in the same array say."""
        for part in self.parts:
            part.place(array)

    def follow(self, change: np.ndarray, at: np.ndarray) -> None:
        """Let the nodes follow a small change of the unknowns, at a state's values."""
        for part in self.parts:
            part.follow(change, part.values(at)[-1])

    def number(self, column: np.ndarray) -> None:
        """Keep the columns of the parts' unknowns in the expansion.  Collective.

        Parameters
        ----------
        column
            Column of each owned degree of freedom; negative for a fixed one.
        """
        owned = self._rows.owned
        mine = [
            [int(np.max(column[dofs[dofs < owned]], initial=-1)) for dofs in part.unknowns]
            for part in self.parts
        ]
        columns = np.array(mine, dtype=np.int64)
        self._rows.comm.Allreduce(MPI.IN_PLACE, columns, MPI.MAX)
        self._columns = columns

    def fill(self, expansion: Any, at: np.ndarray) -> None:
        """Enter dg/dq at a state into the matrix from the free unknowns.  Collective.

        Parameters
        ----------
        expansion
            PETSc matrix from `tied_unknowns.expansion`, which is assembled here.  Entries that
            happen to be 0 are entered, too, so that its pattern is the same at any angle.
        at
            Values of the state.
        """
        first, owned = expansion.getOwnershipRange()[0], self._rows.owned
        for part, columns in zip(self.parts, self._columns, strict=True):
            slope = part.by_angle(part.values(at)[-1])
            for a, dofs in enumerate(part.dofs):
                for k, values in ((a, np.ones(len(dofs))), (-1, slope[:, a])):
                    if columns[k] < 0:
                        continue
                    for dof, value in zip(dofs, values, strict=True):
                        if dof < owned:
                            expansion.setValue(first + int(dof), int(columns[k]), float(value))
        expansion.assemble()

    def stiffness(self, residual: np.ndarray, at: np.ndarray) -> np.ndarray:
        """r . d2g/dtheta2 of each part, shape (parts,).  Collective.

        Parameters
        ----------
        residual
            The residual at all owned degrees of freedom.
        at
            Values of the state.
        """
        found = np.zeros(len(self.parts))
        for k, part in enumerate(self.parts):
            arms = part.turned(part.values(at)[-1])
            for a, dofs in enumerate(part.dofs):
                mine = dofs < self._rows.owned
                found[k] -= residual[dofs[mine]] @ arms[mine, a]
        return np.asarray(self._rows.comm.allreduce(found, op=MPI.SUM))

    def rows(self, groups: Sequence[Group], free: np.ndarray) -> np.ndarray:
        """Place of each part's angle among the free unknowns of this rank, -1 where it has none."""
        masters = np.array([g.master for g in groups if g.master >= 0], dtype=np.int64)
        found = np.full(len(self.parts), -1)
        for k, part in enumerate(self.parts):
            mine = np.intersect1d(part.unknowns[-1], masters)
            if len(mine):
                found[k] = np.searchsorted(free, mine[0])
        return found


def _part(
    told: RigidSurface, device: Device, motion: Sequence[Component],
    unknowns: dict[str, Component], rows: Rows,
) -> RigidPart:  # fmt: skip
    local = motion[0].on(device.dim - 1, device.facets_of(told.surface))
    X = motion[0].space.tabulate_dof_coordinates()[local, :2]
    mine = X[motion[0].dofs[local] < rows.owned]
    total = rows.comm.allreduce(np.array([len(mine), *mine.sum(axis=0)]), op=MPI.SUM)
    return RigidPart(
        told.surface, tuple(part.dofs[local] for part in motion), X - total[1:] / total[0],
        tuple(part.dofs for part in unknowns.values()),
    )  # fmt: skip
