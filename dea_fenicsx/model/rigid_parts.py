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

from dea_fenicsx.model.components import Component
from dea_fenicsx.model.fixed_values import Constraints
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.model.tied_unknowns import Group, Rows
from dea_fenicsx.scene.declarations import RigidSurface
from dea_fenicsx.scene.scene import Scene
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
    scene
        The scene.
    motion
        The displacement components.
    fields
        For each field its scalar parts, by name, see `Unknowns.parts`.
    rows
        The degrees of freedom that this rank owns.
    """

    def __init__(
        self,
        scene: Scene,
        motion: Sequence[Component],
        fields: dict[str, dict[str, Component]],
        rows: Rows,
    ) -> None:
        self._rows = rows
        found = scene.declared.rigid_surfaces
        self.parts = [_part(scene, told, motion, fields[told.field], rows) for told in found]
        self._told = found

    def __bool__(self) -> bool:
        return bool(self.parts)

    def fix(self, scene: Scene, constraints: Constraints) -> np.ndarray:
        """Fix what is held or prescribed of the parts.  Collective.

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
        given = np.zeros(len(constraints.fixed), dtype=bool)
        taken = constraints.fixed.copy()
        angles = {told.surface: told for told in scene.declared.rigid_angles}
        for part, told in zip(self.parts, self._told, strict=True):
            mine = np.concatenate(part.dofs)
            if self._rows.comm.allreduce(bool(taken[mine].any()), op=MPI.LOR):
                raise InputError(
                    f"The rigid part {part.name!r} shares nodes with a support, a prescribed "
                    "displacement or another rigid part; a node can follow one of them only."
                )
            taken[mine] = True
            for a, axis in enumerate(scene.kinematics.axes):
                if axis in told.held:
                    constraints.fix(part.unknowns[a])
            if part.name in angles:
                turn = angles[part.name]
                constraints.fix(part.unknowns[-1], turn.radians, turn.ramp)
            given[mine] = len(told.held) == len(part.dofs) and part.name in angles
        return given

    def followers(self, owned: int) -> np.ndarray:
        """Mask of the owned degrees of freedom that follow the parts."""
        found = np.zeros(owned, dtype=bool)
        for part in self.parts:
            for dofs in part.dofs:
                found[dofs[dofs < owned]] = True
        return found

    def groups(self, scene: Scene, scales: Scales, constraints: Constraints) -> list[Group]:
        """One group for each unknown of a part that is not fixed, with its moments.  Collective."""
        moments = scene.declared.rigid_moments
        unit = scales.force * scales.length
        found = []
        for part in self.parts:
            for k, dofs in enumerate(part.unknowns):
                fixed = bool(np.all(constraints.fixed[dofs]))
                if self._rows.comm.allreduce(fixed, op=MPI.LAND):
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
        columns = np.array(mine, dtype=np.int64).reshape(len(self.parts), -1)
        self._rows.comm.Allreduce(MPI.IN_PLACE, columns, MPI.MAX)
        self._columns = columns

    def fill(self, expansion: Any, at: np.ndarray) -> None:
        """Enter dg/dq at a state into the matrix from the free unknowns.  Collective.

        Parameters
        ----------
        expansion
            PETSc matrix, see `tied_unknowns.expansion`.  Entries that happen to be 0 are entered,
            too, so that its pattern is the same at any angle.
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
    scene: Scene, told: RigidSurface, motion: Sequence[Component],
    unknowns: dict[str, Component], rows: Rows,
) -> RigidPart:  # fmt: skip
    device = scene.device
    local = motion[0].on(device.dim - 1, device.facets_of(told.surface))
    X = motion[0].space.tabulate_dof_coordinates()[local, :2]
    mine = X[motion[0].dofs[local] < rows.owned]
    total = rows.comm.allreduce(np.array([len(mine), *mine.sum(axis=0)]), op=MPI.SUM)
    return RigidPart(
        told.surface, tuple(part.dofs[local] for part in motion), X - total[1:] / total[0],
        tuple(part.dofs for part in unknowns.values()),
    )  # fmt: skip
