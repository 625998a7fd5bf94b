"""The free unknowns of a problem, after fixed values, ties, groups and springs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.air import fix_shape_of_air, unheld_parts
from dea_fenicsx.model.cavities import Cavities
from dea_fenicsx.model.circuits import Circuits
from dea_fenicsx.model.components import Component
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.fixed_values import FixedValues
from dea_fenicsx.model.foundations import on_foundations
from dea_fenicsx.model.free_body import HeldBody, held_body
from dea_fenicsx.model.orientation_springs import OrientationSprings
from dea_fenicsx.model.part_supports import rigid_parts
from dea_fenicsx.model.periodic_faces import PeriodicTies
from dea_fenicsx.model.prescribed_motion import Prescription, prescriptions
from dea_fenicsx.model.rigid_motions import Joined, refuse_free_parts
from dea_fenicsx.model.roles import Roles
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.model.tied_unknowns import (
    Pairs,
    TiedGroup,
    columns,
    expansion,
    floating_groups,
    followers,
    global_groups,
)
from dea_fenicsx.model.unknowns import Unknowns
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.errors import InputError


class Conditions:
    """The effect of a scene's supports, motions and electrodes on the unknowns.

    Parameters
    ----------
    scene, scales, space
        The scene, its units, and its unknowns.
    cavities
        Its cavities.
    released
        Whether a free body is held by its inertia alone.

    Attributes
    ----------
    fixed_values
        Which degrees of freedom are fixed, and at which values for a load.
    electrode_dofs
        Degrees of freedom of each electrode, by its label: all owned ones, and ghosts.
    body
        The free body and what holds it, or None.
    rigid
        The rigid parts, whose nodes follow a displacement and a rotation.
    pairs
        What ties the two ends of a helical cell, or None.
    ties
        The periodic faces, whose nodes follow one another.
    groups
        Degrees of freedom that share a value, with what works on them.
    free, fixed
        Owned local degrees of freedom that are unknowns, and that are fixed, sorted.
    expansion
        PETSc matrix from the free unknowns to all owned degrees of freedom where some follow
        others, or None.  With rigid parts it is that of the undeformed state at first.
    sheet_nodes
        Owned nodes of electrodes with a sheet resistance whose potential is unknown.
    circuits
        The wires of electrodes that sources feed.
    turning
        What keeps a free body's orientation where no dead load gives it one.
    roles
        The unknowns by the role of their fields.
    unknowns
        Number of free unknowns over all ranks.

    Raises
    ------
    InputError
        If two conditions contradict each other, or a part of the device can move freely.
    """

    def __init__(
        self, scene: Scene, scales: Scales, space: Unknowns, cavities: Cavities,
        released: bool = False,
    ) -> None:
        device, kinematics, declared = scene.device, scene.kinematics, scene.declared
        motion, rows = space.of(Role.MOTION), space.rows

        values = self.fixed_values = FixedValues(space.size, scene.ramps)
        given = prescriptions(declared.displacements, device, kinematics, motion)
        self.electrode_dofs = self._fix(given, scene, scales, space)
        cavities.fix(values, space.parts)
        cavities.check_walls(values, motion)

        self.ties = PeriodicTies(
            declared.periodic_faces, device, kinematics.axes, space.continuous, space.parts, rows
        )
        self.ties.fix_means(values, declared.mean_gradients)

        # What moves as a whole: rigid parts, and a free body, which is held without force.
        self.rigid, joined = rigid_parts(declared, device, kinematics, space, values, given)
        self.body = _held(scene, motion, values, joined, self.ties or None, released)
        fix_shape_of_air(values, scene, space, self.rigid.carried(len(values.fixed)))

        # What follows other unknowns: the ends of a cell, electrodes of given charge and the like.
        self.pairs: Pairs | None = None
        if kinematics.periodic_ends is not None:
            self.pairs = Pairs.between(device, kinematics.periodic_ends, space.continuous, rows)
            self.pairs.share_fixed(values, space.W)
            for label, dofs in self.electrode_dofs.items():
                self.electrode_dofs[label] = self.pairs.widen(dofs)
        self.ties.form_classes(values, space.numbers)
        for label, dofs in self.electrode_dofs.items():
            self.electrode_dofs[label] = self.ties.widen(dofs)
        self.groups = self._groups(scene, scales, space, cavities)
        fixed = values.fixed[: space.owned]
        self.ties.refuse_shared(self.rigid.followers(fixed))
        self.ties.leave_out(self._grouped(space.owned))
        follower = followers(self.groups, self.pairs, fixed) | self.rigid.followers(fixed)
        follower |= self.ties.followers(space.owned)
        self.free = np.flatnonzero(~fixed & ~follower).astype(np.int32)
        self.fixed = np.flatnonzero(fixed).astype(np.int32)
        self.expansion: Any = self._expanded(space)
        resistive = [self.electrode_dofs[e.label] for e, _ in declared.sheets]
        self.sheet_nodes = np.intersect1d(self.free, np.concatenate([[], *resistive]))
        self.sheet_nodes = self.sheet_nodes.astype(np.int32)
        self.circuits = Circuits(scene, scales, self.groups, self.electrode_dofs, self.free)
        held = None if released else self.body
        self.turning = OrientationSprings(held, device, motion, self.free)
        self.roles = Roles(space, self.free, device.comm)
        self.unknowns: int = device.comm.allreduce(len(self.free), op=MPI.SUM)

    def _fix(
        self, given: Sequence[Prescription], scene: Scene, scales: Scales, space: Unknowns
    ) -> dict[str, np.ndarray]:
        """Fix what supports, prescribed motions and electrodes give; returns electrodes' nodes."""
        device, declared, values = scene.device, scene.declared, self.fixed_values
        motion, overall = space.of(Role.MOTION), space.parts.get("global", {})
        for item in given:
            values.fix(motion[item.axis].dofs[item.local], item.values, item.ramp)
        values.fix_globals(declared.fixed_globals, overall, scales.length)
        values.fix_outside(space.fields, space.parts, device)
        return self.take_volts(scene, scales, space)

    def takes_volts(self, scene: Scene) -> bool:
        """Whether other voltages of the electrodes change no more than their fixed values."""
        follows = self.pairs is not None or self.ties or self.circuits or len(self.sheet_nodes)
        return not follows and not scene.leaks

    def take_volts(
        self, scene: Scene, scales: Scales, space: Unknowns
    ) -> dict[str, np.ndarray]:
        """Fix the potentials that a scene gives, which may replace others.  Collective.

        Returns
        -------
        dict
            For each electrode's label its degrees of freedom.

        Raises
        ------
        InputError
            If electrodes of different potentials touch.
        """
        if (potential := space.single(Role.POTENTIAL)) is None:
            return {}
        return self.fixed_values.fix_electrodes(
            scene.electrodes, scene.declared.potentials, scene.device, potential, scales.potential
        )

    def _expanded(self, space: Unknowns) -> Any:
        """The matrix from the free unknowns to all owned ones, or None if none follows another."""
        if not (self.groups or self.pairs is not None or self.rigid or self.ties):
            return None
        rows = space.rows
        column = columns(self.free, self.groups, self.pairs, rows)
        found = expansion(
            column, len(self.free), rows, max(self.ties.most_entries, self.rigid.width)
        )
        self.ties.fill(found, column)
        self.rigid.number(column, self.groups, self.free)
        self.rigid.fill(found, np.zeros(space.size), self.fixed_values.fixed)
        return found

    def _grouped(self, owned: int) -> np.ndarray:
        """Mask of the owned degrees of freedom that are in groups."""
        found = np.zeros(owned, dtype=bool)
        for group in self.groups:
            found[group.dofs] = True
            if group.master >= 0:
                found[group.master] = True
        return found

    def _groups(
        self, scene: Scene, scales: Scales, space: Unknowns, cavities: Cavities
    ) -> list[TiedGroup]:
        """Degrees of freedom that share a value; those of electrodes come first.  Collective."""
        kinematics, declared, rows = scene.kinematics, scene.declared, space.rows
        overall, fixed = space.parts.get("global", {}), self.fixed_values.fixed
        unknowns, forces = kinematics.global_unknowns, declared.global_forces
        return [
            *floating_groups(declared.floating, scales.charge, self.electrode_dofs, rows),
            *global_groups(unknowns, forces, scene.period, scales, overall, fixed, rows),
            *self.rigid.groups(fixed, scales.force, scales.length),
            *cavities.groups(space.parts, rows),
            *self.ties.groups(fixed),
        ]


def _held(
    scene: Scene, motion: list[Component], values: FixedValues, joined: Sequence[Joined],
    ties: Any, released: bool,
) -> HeldBody | None:
    """The part that is a free body, which is held unless it is released.  Collective.

    Raises
    ------
    InputError
        If another part can move freely.
    """
    device, declared = scene.device, scene.declared
    held = values.fixed | on_foundations(declared, device, motion, len(values.fixed))
    free = unheld_parts(scene, motion, held, joined, ties)
    # If several parts can move, the largest is the free body, and the others are refused.
    bodies, others = (free[:1], free[1:]) if declared.holds_rigid_motions else ([], free)
    refuse_free_parts(others, device, "Fix or Clamp" if bodies else "Fix, Clamp or FreeBody")
    if declared.rigid_surfaces and declared.holds_rigid_motions and not released:
        name = declared.rigid_surfaces[0].surface
        raise InputError(
            f"Rigid on {name!r} and FreeBody() do not go together but in a path of marches with "
            'inertia alone; hold the rigid part, as in Rigid(..., held="xy"), or another surface.'
        )
    if not bodies:
        return None
    body = held_body(bodies[0], device, [work for _, work in declared.surface_works])
    if not released:
        values.hold(body.pins, motion)
    return body
