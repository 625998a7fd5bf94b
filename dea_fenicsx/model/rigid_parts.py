"""Rigid parts: nodes that move as one body, by rotations of any size.

All nodes of a part move by

    u = c + (R - 1) (X - X0),

with X0 its centre.  The displacement c of the centre and the rotation R are global unknowns q, and
the nodes follow them: u = g(q).  In an axisymmetric section c is axial, and there is no rotation.
With the residual r(u) and the tangent K of the nodes as if they were free, the rows and the tangent
of q are

    (dg/dq)^T r        and        (dg/dq)^T K (dg/dq)  +  r . d2g/dq2.

The second part keeps Newton's method quadratic at large rotations.  It couples the rotations of
each part alone, see `rigid_turns`.  Nothing is approximate at a large rotation, and no rotation is
singular.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.rigid_turns import Turning
from dea_fenicsx.model.tied_unknowns import Rows, TiedGroup
from dea_fenicsx.scene.part_declarations import RigidForce, RigidMoment


@dataclass(frozen=True)
class RigidPart:
    """One rigid part on this rank.

    Attributes
    ----------
    name
        The facet group or the region.
    dofs
        Local displacement degrees of freedom of its nodes, one array for each axis in the same
        order of the nodes, ghosts included.
    arms
        X - X0 of each node, dimensionless, shape (nodes, axes).
    centre
        X0, dimensionless, shape (axes,).
    unknowns
        Local degrees of freedom of each unknown: those of c first, then rotations.  Each is one
        constant a cell, all alike.
    shifts
        Displacement of the centre by each of the unknowns of c, shape (unknowns of c, axes).
    turning
        How it turns.
    free_turns
        Mask of the rotations that are neither held nor prescribed.
    carriers
        How many of the nodes, the last ones, are no nodes of the mesh: points in one cell that
        carry the mass of an attached body, see `attached_mass`.
    """

    name: str
    dofs: tuple[np.ndarray, ...]
    arms: np.ndarray
    centre: np.ndarray
    unknowns: tuple[np.ndarray, ...]
    shifts: np.ndarray
    turning: Turning
    free_turns: np.ndarray
    carriers: int = 0

    @property
    def meshed(self) -> int:
        """How many of the nodes, the first ones, are nodes of the mesh."""
        return len(self.arms) - self.carriers

    @property
    def turns_freely(self) -> bool:
        """Whether it turns about several axes, so that rotations do not add up."""
        return bool(self.turning.count > 1 and self.free_turns.all())

    def values(self, array: np.ndarray) -> np.ndarray:
        """The unknowns in an array over local degrees of freedom; 0 where a rank has no cell."""
        return np.array([array[dofs[0]] if len(dofs) else 0.0 for dofs in self.unknowns])

    def split(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Displacement of the centre, shape (axes,), and the rotation vector."""
        n = len(self.shifts)
        return values[:n] @ self.shifts, values[n:]

    def turned(self, array: np.ndarray) -> np.ndarray:
        """R (X - X0) in a state's values, shape (nodes, axes)."""
        psi = self.split(self.values(array))[1]
        return np.asarray(self.arms @ self.turning.matrix(psi).T)

    def place(self, array: np.ndarray) -> None:
        """Put the nodes where the unknowns of the same array say."""
        c, psi = self.split(self.values(array))
        moved = self.arms @ self.turning.matrix(psi).T - self.arms
        for a, dofs in enumerate(self.dofs):
            array[dofs] = c[a] + moved[:, a]

    def follow(self, change: np.ndarray, at: np.ndarray) -> None:
        """Let the nodes follow a small change of the unknowns, at a state's values."""
        c, turn = self.split(self.values(change))
        psi = self.split(self.values(at))[1]
        moved = self.turning.slopes(self.turned(at)) @ self.turning.spin(psi, turn)
        for a, dofs in enumerate(self.dofs):
            change[dofs] = c[a] + moved[:, a]

    def advance(self, array: np.ndarray, before: np.ndarray, step: np.ndarray) -> None:
        """Compose the rotation of a state with a further one, where rotations do not add up."""
        if not self.turns_freely:
            return
        n = len(self.shifts)
        psi = self.turning.composed(self.values(step)[n:], self.values(before)[n:])
        for dofs, value in zip(self.unknowns[n:], psi, strict=True):
            array[dofs] = value

    def slopes(self, array: np.ndarray) -> np.ndarray:
        """dg/dq in a state's values: shape (nodes, axes, unknowns)."""
        turns = self.turning.slopes(self.turned(array))
        shifts = np.broadcast_to(self.shifts.T, (len(self.arms), *self.shifts.T.shape))
        return np.concatenate([shifts, turns], axis=2)


class RigidParts:
    """All rigid parts of a problem.

    Parameters
    ----------
    parts
        The parts.
    rows
        The degrees of freedom that this rank owns.
    moments, forces
        What acts on the parts.
    """

    def __init__(
        self, parts: Sequence[RigidPart], rows: Rows,
        moments: Sequence[RigidMoment] = (), forces: Sequence[RigidForce] = (),
    ) -> None:  # fmt: skip
        self.parts, self._rows = list(parts), rows
        self.moments, self.forces = moments, forces
        counts = [part.turning.count for part in self.parts]
        self._starts = np.concatenate([[0], np.cumsum(counts, dtype=int)])
        self._places = np.full(self._starts[-1], -1)

    def __bool__(self) -> bool:
        return bool(self.parts)

    @property
    def width(self) -> int:
        """Largest number of unknowns that a node follows along one axis, and one for its own."""
        return max((1 + len(p.shifts) + p.turning.count for p in self.parts), default=2)

    @property
    def wandering(self) -> set[str]:
        """Ramps of moments whose work depends on the path."""
        freely = {part.name for part in self.parts if part.turns_freely}
        return {told.ramp for told in self.moments if told.surface in freely}

    def followers(self, fixed: np.ndarray) -> np.ndarray:
        """Mask of the owned degrees of freedom that follow the parts, but for the fixed ones."""
        found = np.zeros(len(fixed), dtype=bool)
        for part in self.parts:
            for dofs in part.dofs:
                found[dofs[dofs < len(fixed)]] = True
        return found & ~fixed

    def prescribable(self, fixed: np.ndarray) -> np.ndarray:
        """Mask of the local degrees of freedom that hold unknowns of the parts and are fixed."""
        found = np.zeros(len(fixed), dtype=bool)
        for part in self.parts:
            found[np.concatenate(part.unknowns)] = True
        return found & fixed

    def carried(self, size: int) -> np.ndarray:
        """Mask of the local degrees of freedom, `size` in all, of the nodes of the parts."""
        found = np.zeros(size, dtype=bool)
        for part in self.parts:
            found[np.concatenate(part.dofs)] = True
        return found

    def carrying(self, size: int) -> list[np.ndarray]:
        """Masks of the local degrees of freedom, `size` in all, of points that carry a mass.

        One mask for each axis.
        """
        axes = len(self.parts[0].dofs) if self.parts else 0
        found = [np.zeros(size, dtype=bool) for _ in range(axes)]
        for part in self.parts:
            for mask, dofs in zip(found, part.dofs, strict=True):
                mask[dofs[part.meshed:]] = True
        return found

    def groups(self, fixed: np.ndarray, force: float, length: float) -> list[TiedGroup]:
        """One group for each unknown of a part that is not fixed, with its loads.  Collective.

        Parameters
        ----------
        fixed
            Mask of the fixed local degrees of freedom.
        force, length
            The units in N and m.
        """
        found = []
        for part in self.parts:
            n = len(part.shifts)
            for k, dofs in enumerate(part.unknowns):
                if self._rows.comm.allreduce(bool(np.all(fixed[dofs])), op=MPI.LAND):
                    continue
                if k < n:
                    sources = [
                        (told.ramp, -float(part.shifts[k] @ told.newtons) / force)
                        for told in self.forces if told.surface == part.name
                    ]  # fmt: skip
                else:
                    axis = k - n if part.turning.count == 3 else 2
                    sources = [
                        (told.ramp, -told.newton_metres * told.about[axis] / (force * length))
                        for told in self.moments if told.surface == part.name
                    ]  # fmt: skip
                found.append(TiedGroup.of(dofs, self._rows, tuple(sources)))
        return found

    def place(self, array: np.ndarray) -> None:
        """Put all nodes of the parts where their unknowns in the same array say."""
        for part in self.parts:
            part.place(array)

    def advance(self, array: np.ndarray, before: np.ndarray, step: np.ndarray) -> None:
        """Correct the rotations in a sum of a state's values and a step, see `RigidPart`."""
        for part in self.parts:
            part.advance(array, before, step)

    def follow(self, change: np.ndarray, at: np.ndarray) -> None:
        """Let the nodes follow a small change of the unknowns, at a state's values."""
        for part in self.parts:
            part.follow(change, at)

    def number(self, column: np.ndarray, groups: Sequence[TiedGroup], free: np.ndarray) -> None:
        """Keep where the parts' unknowns are among the free ones.  Collective.

        Parameters
        ----------
        column
            Column of each owned degree of freedom; negative for a fixed one.
        groups
            All groups of degrees of freedom that share a value.
        free
            Owned local degrees of freedom that are unknowns, sorted.
        """
        owned = self._rows.owned
        mine = [
            [int(np.max(column[dofs[dofs < owned]], initial=-1)) for dofs in part.unknowns]
            for part in self.parts
        ]
        columns = np.array(mine, dtype=np.int64)
        self._rows.comm.Allreduce(MPI.IN_PLACE, columns, MPI.MAX)
        self._columns = columns
        self._places = self.rows(groups, free)

    def fill(self, expansion: Any, at: np.ndarray, fixed: np.ndarray) -> None:
        """Enter dg/dq at a state into the matrix from the free unknowns.  Collective.

        Parameters
        ----------
        expansion
            PETSc matrix from `tied_unknowns.expansion`, which is assembled here.  Entries that
            happen to be 0 are entered, too, so that its pattern is the same at any rotation.
        at
            Values of the state.
        fixed
            Mask of the fixed local degrees of freedom, which do not follow.
        """
        first, owned = expansion.getOwnershipRange()[0], self._rows.owned
        for part, columns in zip(self.parts, self._columns, strict=True):
            slopes, n = part.slopes(at), len(part.shifts)
            for a, dofs in enumerate(part.dofs):
                turns = [n + k for k in range(part.turning.count)
                         if part.turning.count == 1 or k != a]  # fmt: skip
                used = [k for k in [*np.flatnonzero(part.shifts[:, a]), *turns] if columns[k] >= 0]
                if not used:
                    continue
                names = columns[used].astype(np.int32)
                for dof, values in zip(dofs, slopes[:, a, used], strict=True):
                    if dof < owned and not fixed[dof]:
                        expansion.setValues([first + int(dof)], names, values)
        expansion.assemble()

    def stiffness(self, residual: np.ndarray, at: np.ndarray) -> np.ndarray:
        """r . d2g/dq2 over the rotations of all parts, block after block.  Collective.

        Parameters
        ----------
        residual
            The residual at all owned degrees of freedom.
        at
            Values of the state.
        """
        found = np.zeros((self._starts[-1],) * 2)
        for part, start in zip(self.parts, self._starts[:-1], strict=True):
            block = slice(start, start + part.turning.count)
            mine = [dofs < self._rows.owned for dofs in part.dofs]
            y, forces = part.turned(at), np.zeros(part.arms.shape)
            for a, dofs in enumerate(part.dofs):
                forces[mine[a], a] = residual[dofs[mine[a]]]
            found[block, block] = part.turning.curvature(forces, y)
        return np.asarray(self._rows.comm.allreduce(found, op=MPI.SUM))

    def by_moments(self, factors: Any, unit: float) -> np.ndarray:
        """What moments of fixed axes add to `stiffness`: -[M]/2 where parts turn freely.

        Parameters
        ----------
        factors
            Factor of each ramp.
        unit
            The unit of moment in N m.
        """
        found = np.zeros((self._starts[-1],) * 2)
        for part, start in zip(self.parts, self._starts[:-1], strict=True):
            if part.turns_freely:
                M = sum(
                    (factors[told.ramp] * told.newton_metres / unit * np.array(told.about)
                     for told in self.moments if told.surface == part.name), np.zeros(3),
                )  # fmt: skip
                block = slice(start, start + 3)
                found[block, block] = -np.cross(M, np.eye(3)).T / 2
        return found

    def rows(self, groups: Sequence[TiedGroup], free: np.ndarray) -> np.ndarray:
        """Place of each rotation of all parts among the free unknowns of this rank, or -1."""
        masters = np.array([g.master for g in groups if g.master >= 0], dtype=np.int64)
        found = np.full(self._starts[-1], -1)
        for part, start in zip(self.parts, self._starts[:-1], strict=True):
            for k in range(part.turning.count):
                mine = np.intersect1d(part.unknowns[len(part.shifts) + k], masters)
                if len(mine):
                    found[start + k] = np.searchsorted(free, mine[0])
        return found

    def add_product(self, product: np.ndarray, block: np.ndarray, direction: np.ndarray) -> None:
        """Add the product of `stiffness` with a direction in the free rows.  Collective."""
        mine = self._places >= 0
        given = np.zeros(len(mine))
        given[mine] = direction[self._places[mine]]
        if any(part.turning.count > 1 for part in self.parts):
            given = self._rows.comm.allreduce(given, op=MPI.SUM)
        product[self._places[mine]] += (block @ given)[mine]

    def enter(self, matrix: Any, block: np.ndarray) -> None:
        """Add `stiffness` to a matrix in the free unknowns.  Collective."""
        first = matrix.getOwnershipRange()[0]
        for part, start, columns in zip(
            self.parts, self._starts[:-1], self._columns, strict=True
        ):
            turns = range(start, start + part.turning.count)
            names = columns[len(part.shifts):]
            for i in turns:
                for j, name in zip(turns, names, strict=True):
                    if self._places[i] >= 0 and name >= 0:
                        row = int(first + self._places[i])
                        matrix.setValue(row, int(name), block[i, j], addv=True)
        matrix.assemble()
