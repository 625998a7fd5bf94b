"""Rigid parts of a scene: their nodes and unknowns, and what of them is held or prescribed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from dea_fenicsx.mesh.device import Device
from dea_fenicsx.mesh.neighbours import extent
from dea_fenicsx.model.attached_mass import carrying_points
from dea_fenicsx.model.components import Component
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.fixed_values import FixedValues
from dea_fenicsx.model.foundations import spring_directions, sprung_turns
from dea_fenicsx.model.prescribed_motion import PLANE_TOLERANCE, Prescription
from dea_fenicsx.model.rigid_motions import BoundingCube, Joined
from dea_fenicsx.model.rigid_parts import RigidPart, RigidParts
from dea_fenicsx.model.rigid_turns import turning_of
from dea_fenicsx.model.unknowns import Unknowns
from dea_fenicsx.scene.declared import Declared
from dea_fenicsx.scene.kinematics_base import Kinematics
from dea_fenicsx.scene.part_declarations import RigidAngle, RigidSurface
from dea_fenicsx.scene.rigid import AXES_OF_TURNS
from dea_fenicsx.support.errors import InputError


def rigid_parts(
    declared: Declared, device: Device, kinematics: Kinematics, space: Unknowns,
    values: FixedValues, given: Sequence[Prescription],
) -> tuple[RigidParts, list[Joined]]:  # fmt: skip
    """The rigid parts of a scene, with what is held of them fixed.  Collective.

    Parameters
    ----------
    declared
        What the conditions of the scene declare.
    device, kinematics, space
        The device, the kinematics and the unknowns.
    values
        The values that are fixed already, and that are added to.
    given
        The displacements that conditions give to facet groups.

    Returns
    -------
    RigidParts
        The parts.
    list of Joined
        What each of them prevents of rigid motions of the device.

    Raises
    ------
    InputError
        If a part shares a node with another part, or with a displacement that is given, unless this
        is a plane of symmetry.
    """
    maker = _Maker(declared, device, kinematics, space, values, given)
    parts, joined = [], []
    for told in declared.rigid_surfaces:
        part, fixed = maker.part(told)
        parts.append(part)
        directions = spring_directions(
            declared.springs, part.name, kinematics.axes, part.centre, device.length
        )
        sprung = sprung_turns(declared.springs, part.name)
        turns = [axis in sprung for axis in AXES_OF_TURNS[kinematics.rotations]]
        held = fixed | np.array([*(False for _ in part.shifts), *turns])
        joined.append(_prevented(part, held, kinematics, directions))
    moments, forces = declared.rigid_moments, declared.rigid_forces
    return RigidParts(parts, space.rows, moments, forces), joined


@dataclass
class _Maker:
    """What the making of parts needs, see `rigid_parts`."""

    declared: Declared
    device: Device
    kinematics: Kinematics
    space: Unknowns
    values: FixedValues
    given: Sequence[Prescription]

    def __post_init__(self) -> None:
        self._motion: list[Component] = self.space.of(Role.MOTION)
        self._taken = np.zeros(len(self.values.fixed), dtype=bool)
        self._comm = self.device.comm

    def part(self, told: RigidSurface) -> tuple[RigidPart, np.ndarray]:
        """A part, and the mask of its unknowns that are fixed.  Collective."""
        name, axes, dim = told.surface, self.kinematics.axes, len(self._motion)
        first = self._motion[0]
        if name in self.device.surfaces:
            local = first.on(self.device.dim - 1, self.device.facets_by_surface[name])
        else:
            local = first.on(self.device.dim, self.device.cells_of(name))
        planes = self._planes(told, local)
        dofs = tuple(component.dofs[local] for component in self._motion)
        self._take(name, np.concatenate(dofs))
        X = first.space.tabulate_dof_coordinates()[local, :dim]
        centre = self._centre(told, X, dofs[0])
        unknowns = tuple(part.dofs for part in self.space.parts[told.field].values())
        turning = turning_of(self.kinematics.rotations)
        if self.kinematics.cartesian:
            shifts = _basis(told, dim)
        else:
            shifts = np.eye(dim)[-1:]
            self.values.fix(dofs[0])  # a rigid ring keeps its radius
        angle = next((a for a in self.declared.rigid_angles if a.surface == name), None)
        free_turns = self._free_turns(told, planes, angle)
        fixed = np.concatenate([self._held(told, planes, shifts), ~free_turns])
        for k in np.flatnonzero(fixed):
            self.values.fix(unknowns[k])
        self._prescribe(told, unknowns, len(shifts), angle)
        for shift in (s for s in self.declared.rigid_shifts if s.surface == name):
            fixed[axes.index(shift.axis) if self.kinematics.cartesian else 0] = True
        space, device = self.space, self.device
        carriers, arms = carrying_points(told, space, device, self.kinematics, self.values)
        dofs = tuple(np.concatenate(pair) for pair in zip(dofs, carriers, strict=True))
        return RigidPart(name, dofs, np.vstack([X - centre, arms]), centre, unknowns, shifts,
                         turning, free_turns, len(arms)), fixed  # fmt: skip

    def _any(self, mask: np.ndarray) -> bool:
        return bool(self._comm.allreduce(bool(np.any(mask)), op=MPI.LOR))

    def _take(self, name: str, mine: np.ndarray) -> None:
        """Raise InputError if another part has some of the nodes.  Collective."""
        if self._any(self._taken[mine]):
            raise _shared(name, "another rigid part")
        self._taken[mine] = True

    def _centre(self, told: RigidSurface, X: np.ndarray, dofs: np.ndarray) -> np.ndarray:
        if told.centre is not None:
            return np.array(told.centre) / self.device.length
        mine = X[dofs < self.space.owned]
        sums = np.array([len(mine), *mine.sum(axis=0)])
        total = self._comm.allreduce(sums, op=MPI.SUM)
        return np.asarray(total[1:] / total[0])

    def _planes(self, told: RigidSurface, local: np.ndarray) -> set[int]:
        """Axes along which planes of symmetry hold some nodes of a part.  Collective."""
        found = set()
        coordinates, axes = self.kinematics.coordinates, self.kinematics.axes
        for item in self.given:
            if not self._any(np.isin(local, item.local)):
                continue
            X = self._motion[0].space.tabulate_dof_coordinates()[item.local]
            low, high = extent(self.device, X[:, coordinates.index(axes[item.axis])])
            plain = item.ramp is None and not self._any(item.values)
            radial = not self.kinematics.cartesian and item.axis == 0
            if not plain or (high - low > PLANE_TOLERANCE and not radial):
                raise _shared(told.surface, item.what)
            if not radial:
                found.add(item.axis)
        return found

    def _held(self, told: RigidSurface, planes: set[int], shifts: np.ndarray) -> np.ndarray:
        """Mask of the displacements of the centre that are held."""
        axes = self.kinematics.axes
        if told.along is None and told.across is None:
            held = np.array([axis in told.held or a in planes for a, axis in enumerate(axes)])
            return held if self.kinematics.cartesian else held[-1:]
        if told.along is not None:
            clash = any(abs(shifts[0, a]) > 1e-12 for a in planes)
            held = np.arange(len(axes)) > 0
        else:
            clash, held = bool(planes), np.arange(len(axes)) == 0
        if clash:
            raise InputError(
                f"The rigid part {told.surface!r} is guided across a plane of symmetry that holds "
                "some of its nodes; guide it along that plane by held=."
            )
        return held

    def _free_turns(
        self, told: RigidSurface, planes: set[int], angle: RigidAngle | None
    ) -> np.ndarray:
        """Mask of the rotations that are neither held nor prescribed."""
        names = {0: "", 1: "z", 3: "xyz"}[self.kinematics.rotations]
        may = np.array([axis in told.turns for axis in names], dtype=bool)
        for a in planes:
            may &= np.array([axis == self.kinematics.axes[a] for axis in names], dtype=bool)
        if angle is None:
            return may
        about = np.array(angle.about[-len(names):])
        if planes and np.any(np.abs(about[~may]) > 0):
            raise InputError(
                f"The rigid part {told.surface!r} is turned out of a plane of symmetry that holds "
                "some of its nodes; turn it about the normal of the plane, or leave Turn out."
            )
        return np.zeros(len(names), dtype=bool)

    def _prescribe(
        self, told: RigidSurface, unknowns: Sequence[np.ndarray], n: int,
        angle: RigidAngle | None,
    ) -> None:  # fmt: skip
        """Fix the unknowns of a part that `Turn` and `Displacement` give."""
        axes = self.kinematics.axes
        if angle is not None:
            turns = unknowns[n:]
            for dofs, share in zip(turns, angle.about[-len(turns):], strict=True):
                self.values.fix(dofs, angle.radians * share, angle.ramp)
        for shift in self.declared.rigid_shifts:
            if shift.surface != told.surface:
                continue
            if not self.kinematics.cartesian and shift.axis == "r":
                raise InputError(
                    f"The rigid part {told.surface!r} is moved along the radius, but a rigid ring "
                    "keeps its radius; leave this Displacement out."
                )
            k = axes.index(shift.axis) if self.kinematics.cartesian else 0
            self.values.fix(unknowns[k], shift.metres / self.device.length, shift.ramp)


def _shared(name: str, what: str) -> InputError:
    return InputError(
        f"The rigid part {name!r} shares nodes with {what}; a node can follow one of the two only, "
        "so leave cells between them, or hold the part itself by held=."
    )


def _basis(told: RigidSurface, dim: int) -> np.ndarray:
    """Directions of the displacements of a centre, orthonormal; a guide's own is the first."""
    guide = told.along if told.along is not None else told.across
    if guide is None:
        return np.eye(dim)
    first = np.array(guide) / np.linalg.norm(guide)
    # The first of the columns is along the guide, and the others are across it.
    Q, _ = np.linalg.qr(np.column_stack([first, np.eye(dim)]))
    Q[:, 0] = first
    return np.asarray(Q.T[:dim])


def _prevented(
    part: RigidPart, held: np.ndarray, kinematics: Kinematics, directions: np.ndarray
) -> Joined:
    """What a part prevents of rigid motions: a row for each unknown held, and for each spring.

    `held` is the mask of its unknowns that are fixed or have a torsional spring, `directions` are
    those of its other springs, shape (springs, axes).
    """
    dim, turns = len(part.centre), part.turning.count

    def rows(box: BoundingCube) -> np.ndarray:
        at = np.zeros((1, 3))
        at[0, :dim] = part.centre
        corners = np.vstack([at, *(at + box.half * np.eye(3)[c] for c in range(dim))])
        u = np.stack([kinematics.rigid_motions(corners, a, *box) for a in range(dim)])
        found = list(np.einsum("ka,am->km", part.shifts, u[:, 0]))
        slope = u[:, 1:] - u[:, :1]  # of axis a along coordinate c, by motion
        pairs = {0: [], 1: [(0, 1)], 3: [(1, 2), (2, 0), (0, 1)]}[turns]
        found += [(slope[j, i] - slope[i, j]) / 2 for i, j in pairs]
        kept = np.array(found)[held].reshape(int(held.sum()), u.shape[2])
        return np.vstack([kept, directions @ u[:, 0]])

    return Joined(part.dofs[0][: part.meshed], rows)
