"""Nodes of periodic faces: each follows its partner, one period further.

The nodes of all pairs of faces form classes, in which each node follows a leader:

    u = u_leader + sum_k o_k d_k,

with the difference of displacements d_k of pair k, three numbers (in the plane two) for the whole
device, and o_k = 1, 0 or -1.  A node on an edge between two pairs of faces follows by both of them.
The pressure and the potential are the same in a class.  A leader is a node that is held where there
is one, so that a support on one face holds both.

All of this is linear, so that an increment of the unknowns keeps it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.mesh.device import Device
from dea_fenicsx.model.components import Component
from dea_fenicsx.model.face_matching import FacePair, Matches, classes, matched
from dea_fenicsx.model.fixed_values import FixedValues
from dea_fenicsx.model.tied_unknowns import Rows, TiedGroup
from dea_fenicsx.scene.kinematics_base import Kinematics
from dea_fenicsx.scene.periodic import MeanGradient, PeriodicFaces
from dea_fenicsx.support.errors import InputError

VALUE_TOLERANCE = 1e-9
"""Two dimensionless values on opposite faces are equal if they differ by no more than this."""


class PeriodicTies:
    """All periodic faces of a problem.

    Parameters
    ----------
    declared
        The faces.
    device
        The device.
    axes
        Names of the displacement components.
    parts
        The components of all continuous fields, the displacement first.
    fields
        For each field its scalar parts, by name, see `Unknowns.parts`.
    rows
        The degrees of freedom that this rank owns.

    Attributes
    ----------
    faces
        The pairs of faces.
    matches
        The pairs of degrees of freedom.

    Raises
    ------
    InputError
        If the nodes of two faces do not lie at the same places, one period apart along an axis.
    """

    def __init__(
        self, declared: Sequence[PeriodicFaces], device: Device, axes: str,
        parts: Sequence[Component], fields: Mapping[str, Mapping[str, Component]], rows: Rows,
    ) -> None:  # fmt: skip
        self._rows, self._axes = rows, axes
        self.faces: list[FacePair] = []
        found: list[list[np.ndarray]] = []
        for k, told in enumerate(declared):
            period, pairs = matched(told, device, parts, rows)
            along = int(np.argmax(np.abs(period)))
            unknowns = tuple(part.dofs for part in fields[told.field].values())
            self.faces.append(FacePair(told, along, float(period[along]), unknowns))
            for c, (masters, slaves, x) in enumerate(pairs):
                same = np.ones(len(masters), dtype=np.int64)
                axis = c if c < len(axes) else -1
                found.append([masters, slaves, k * same, axis * same, x])
        none = np.empty(0, dtype=np.int64)
        found = found or [[none, none, none, none, np.empty((0, 3))]]
        self.matches = Matches(*map(np.concatenate, zip(*found, strict=True)))
        self.leaders = self.members = np.empty(0, dtype=np.int64)
        self._member_axes, self._offsets = self.leaders, np.empty((0, len(self.faces)))
        self._follows = self._led_by_fixed = np.empty(0, dtype=bool)

    def __bool__(self) -> bool:
        return bool(self.faces)

    @property
    def most_entries(self) -> int:
        """Most numbers in a row of the expansion: a leader and each difference; at least 2."""
        return max(2, 1 + len(self.faces))

    # ---------------------------------------------------------------- what is fixed

    def fix_means(self, values: FixedValues, given: Sequence[MeanGradient]) -> None:
        """Fix the differences d that are prescribed, or 0, in the values that are fixed already."""
        prescribed = {(g.first, g.second, g.axis): g for g in given}
        for faces in self.faces:
            told = faces.told
            free = self._axes[faces.axis] if told.free is None else told.free
            for axis, dofs in zip(self._axes, faces.unknowns, strict=True):
                mean = prescribed.get((told.first, told.second, axis))
                if mean is not None:
                    values.fix(dofs, mean.strain * faces.length, mean.ramp)
                elif axis not in free:
                    values.fix(dofs)

    def form_classes(self, values: FixedValues, numbers: np.ndarray) -> None:
        """Choose leaders, and fix what follows fixed nodes by given differences.  Collective.

        Parameters
        ----------
        values
            What is fixed; it is added to.
        numbers
            Number over all ranks of each local degree of freedom, ghosts included.

        Raises
        ------
        InputError
            If both nodes of a pair are held in ways that do not go together.
        """
        if not self.faces:
            return
        m = self.matches
        every, inverse = np.unique(np.concatenate([m.masters, m.slaves]), return_inverse=True)
        first, second = np.split(inverse, 2)
        fixed = self._rows.fetch(values.fixed[: self._rows.owned], every)
        leader, offsets = classes(first, second, m.faces, fixed, len(self.faces))
        axes = np.full(len(every), -1)
        axes[first], axes[second] = m.axes, m.axes
        others = np.flatnonzero(leader != np.arange(len(every)))
        self.members, self.leaders = every[others], every[leader[others]]
        self._member_axes, self._offsets = axes[others], offsets[others]
        moving = np.any((self._offsets != 0) & self._unknown(values.fixed), axis=1)
        led = fixed[leader[others]]
        self._share_fixed(values, fixed[others], led & ~moving, led & moving)
        self._follows = ~(led & ~moving)
        self._led_by_fixed = led & moving
        self._place_locally(numbers)
        self._write_fixed(values, led & ~moving)

    def _unknown(self, fixed: np.ndarray) -> np.ndarray:
        """For each member and pair of faces whether d along the member's axis is unknown."""
        comm = self._rows.comm
        found = np.zeros((len(self.members), len(self.faces)), dtype=bool)
        for k, faces in enumerate(self.faces):
            for a, dofs in enumerate(faces.unknowns):
                # a rank without cells has none of these degrees of freedom
                if not comm.allreduce(bool(np.all(fixed[dofs])), op=MPI.LAND):
                    found[self._member_axes == a, k] = True
        return found

    def _share_fixed(
        self, values: FixedValues, held: np.ndarray, given: np.ndarray, moving: np.ndarray
    ) -> None:
        """Raise InputError if members that are held contradict their leaders.  Collective."""
        self._given: dict[str, np.ndarray] = {}
        for ramp, base in values.base.items():
            self._given[ramp] = self._led(base)
            mine = self._rows.fetch(base[: self._rows.owned], self.members)
            apart = held & given & (np.abs(mine - self._given[ramp]) > VALUE_TOLERANCE)
            if np.any(apart):
                self._refuse(int(np.argmax(apart)), "at different values, which do not agree with")
        if np.any(held & moving):
            self._refuse(int(np.argmax(held & moving)), "at both ends, which leaves no freedom to")

    def _refuse(self, member: int, how: str) -> None:
        """Refuse a member that is held in another way than its leader."""
        k = int(np.argmax(np.abs(self._offsets[member])))
        told, axis = self.faces[k].told, int(self._member_axes[member])
        along = f" along {self._axes[axis]}" if axis >= 0 else ""
        raise InputError(
            f"The periodic faces {told.first!r} and {told.second!r} are held{along} {how} their "
            f"mean strain{along}; hold one of them, leave the axis out of free=, or give a "
            "MeanStrain."
        )

    def _led(self, array: np.ndarray) -> np.ndarray:
        """What leaders and differences in an array give the members, on all ranks.  Collective."""
        found = self._rows.fetch(array[: self._rows.owned], self.leaders)
        comm = self._rows.comm
        for k, faces in enumerate(self.faces):
            for a, dofs in enumerate(faces.unknowns):
                value = next(float(v[0]) for v in comm.allgather(array[dofs[:1]]) if len(v))
                mine = self._member_axes == a
                found[mine] += self._offsets[mine, k] * value
        return found

    def _place_locally(self, numbers: np.ndarray) -> None:
        """Find the members among the local degrees of freedom, ghosts included."""
        order = np.argsort(self.members)
        at = np.searchsorted(self.members, numbers, sorter=order)
        at = np.minimum(at, max(len(order) - 1, 0))
        which = order[at] if len(order) else at
        here = self.members[which] == numbers if len(order) else np.zeros(len(numbers), dtype=bool)
        self._local, self._which = np.flatnonzero(here), which[here]

    def _write_fixed(self, values: FixedValues, given: np.ndarray) -> None:
        """Fix the members that follow fixed leaders by given differences."""
        chosen = given[self._which]
        local, which = self._local[chosen], self._which[chosen]
        values.fixed[local] = True
        for ramp, base in values.base.items():
            base[local] = self._given[ramp][which]

    def restraints(
        self, kinematics: Kinematics, fixed: np.ndarray, parts: np.ndarray,
        boxes: Sequence[tuple[np.ndarray, float]],
    ) -> list[np.ndarray]:  # fmt: skip
        """Rows that vanish for the rigid motions which given differences allow.  Collective.

        Parameters
        ----------
        kinematics
            The kinematics.
        fixed
            Mask of the fixed local degrees of freedom.
        parts
            Part of the mesh of each owned degree of freedom of the displacement.
        boxes
            Middle and half size of each part.

        Returns
        -------
        list of ndarrays of shape (n, number of rigid motions), one for each part
        """
        m = self.matches
        found: list[list[np.ndarray]] = [[] for _ in boxes]
        if not self.faces:
            return [np.empty((0, 1))] * len(boxes)
        part = self._rows.fetch(parts, m.slaves)
        for k, faces in enumerate(self.faces):
            period = faces.length * np.eye(3)[faces.axis]
            for a, dofs in enumerate(faces.unknowns):
                if not self._rows.comm.allreduce(bool(np.all(fixed[dofs])), op=MPI.LAND):
                    continue
                for i, box in enumerate(boxes):
                    x = m.x[(m.faces == k) & (m.axes == a) & (part == i)]
                    there = kinematics.rigid_motions(x, a, *box)
                    found[i].append(there - kinematics.rigid_motions(x - period, a, *box))
        return [np.vstack(rows) if rows else np.empty((0, 1)) for rows in found]

    def joined_parts(self, parts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of the parts of the mesh on both sides of each pair of nodes.  Collective."""
        at = self.matches.axes == 0
        return tuple(self._rows.fetch(parts, n[at]) for n in (
            self.matches.masters, self.matches.slaves
        ))  # type: ignore[return-value]  # fmt: skip

    # ---------------------------------------------------------------- what follows

    def refuse_shared(self, others: np.ndarray) -> None:
        """Raise InputError if a node of the faces follows anything else, too.  Collective.

        Parameters
        ----------
        others
            Mask of the owned degrees of freedom that follow rigid parts.
        """
        for numbers in (self.matches.masters, self.matches.slaves):
            shared = self._rows.fetch(others, numbers) if self.faces else np.zeros(0, dtype=bool)
            if np.any(shared):
                told = self.faces[self.matches.faces[np.argmax(shared)]].told
                raise InputError(
                    f"The periodic faces {told.first!r} and {told.second!r} share nodes with a "
                    "rigid part; a node can follow one of them only."
                )

    def leave_out(self, grouped: np.ndarray) -> None:
        """Let members follow no leader that are tied to others in groups.  Collective.

        Parameters
        ----------
        grouped
            Mask of the owned degrees of freedom that are in groups, such as floating electrodes.
        """
        if self.faces:
            self._follows = self._follows & ~self._rows.fetch(grouped, self.members)

    def followers(self, owned: int) -> np.ndarray:
        """Mask of the owned degrees of freedom that follow a leader."""
        found = np.zeros(owned, dtype=bool)
        if self.faces:
            here, local = self._rows.mine(self.members)
            found[local] = self._follows[here]
        return found

    def groups(self, fixed: np.ndarray) -> list[TiedGroup]:
        """One group for each difference d that is not fixed.  Collective."""
        found = []
        for faces in self.faces:
            for dofs in faces.unknowns:
                if not self._rows.comm.allreduce(bool(np.all(fixed[dofs])), op=MPI.LAND):
                    found.append(TiedGroup.of(dofs, self._rows, ()))
        return found

    def fill(self, expansion: Any, column: np.ndarray) -> None:
        """Enter the rows of members into the matrix from the free unknowns.  Collective.

        Parameters
        ----------
        expansion
            PETSc matrix from `tied_unknowns.expansion`, not assembled yet.
        column
            Column of each owned degree of freedom; negative for what is fixed or follows.
        """
        if not self.faces:
            return
        rows, owned = self._rows, self._rows.owned
        leaders = rows.fetch(column + 1, self.leaders) - 1
        own = np.array([
            [int(np.max(column[dofs[dofs < owned]], initial=-1)) for dofs in faces.unknowns]
            for faces in self.faces
        ])  # fmt: skip
        rows.comm.Allreduce(MPI.IN_PLACE, own, MPI.MAX)
        first = expansion.getOwnershipRange()[0]
        here, local = rows.mine(self.members)
        for i, dof in zip(np.flatnonzero(here), local, strict=True):
            if not self._follows[i]:
                continue
            entries = {int(leaders[i]): 1.0}
            if (a := self._member_axes[i]) >= 0:
                for k in np.flatnonzero(self._offsets[i]):
                    entries[int(own[k, a])] = float(self._offsets[i, k])
            for number, value in entries.items():
                if number >= 0:
                    expansion.setValue(first + int(dof), number, value)

    def follow(self, array: np.ndarray) -> None:
        """Put all members where leaders and differences in the same array say.  Collective.

        It holds for values and for small changes alike, ghosts included.
        """
        if self.faces:
            led = self._led(array)
            chosen = self._follows[self._which]
            array[self._local[chosen]] = led[self._which[chosen]]

    # ---------------------------------------------------------------- for others

    def widen(self, dofs: np.ndarray) -> np.ndarray:
        """Local degrees of freedom with all owned ones of their classes, sorted.  Collective."""
        if not self.faces:
            return dofs
        member = np.zeros(self._rows.owned, dtype=bool)
        member[dofs[dofs < self._rows.owned]] = True
        return np.union1d(dofs, np.flatnonzero(self.join(member)))

    def join(self, member: np.ndarray) -> np.ndarray:
        """A mask over owned degrees of freedom, widened to whole classes.  Collective."""
        wide = member.copy()
        m = self.matches
        for _ in range(2 * len(self.faces)):  # along each axis there and back
            both = self._rows.fetch(wide, m.slaves) | self._rows.fetch(wide, m.masters)
            for numbers in (m.slaves, m.masters):
                here, local = self._rows.mine(numbers)
                wide[local] |= both[here]
        return wide

    def held(self, owned: int) -> np.ndarray:
        """Mask of the owned degrees of freedom that follow fixed ones by unknown differences."""
        found = np.zeros(owned, dtype=bool)
        if self.faces:
            here, local = self._rows.mine(self.members)
            found[local] = self._led_by_fixed[here]
        return found

    def weights(self, number: int, axis: int) -> tuple[np.ndarray, np.ndarray]:
        """Owned degrees of freedom that move with d of a pair along an axis, and by how much."""
        here, local = self._rows.mine(self.members)
        offsets = np.where(self._member_axes == axis, self._offsets[:, number], 0.0)[here]
        return local[offsets != 0], offsets[offsets != 0]

    def given_surfaces(self, fixed: np.ndarray) -> list[str]:
        """Faces between which the strain along the period is prescribed, or 0.  Collective."""
        found = []
        for faces in self.faces:
            mine = bool(np.all(fixed[faces.unknowns[faces.axis]]))
            if self._rows.comm.allreduce(mine, op=MPI.LAND):
                found += [faces.told.first, faces.told.second]
        return found
