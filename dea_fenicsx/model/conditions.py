"""The free unknowns of a problem, after fixed values, ties, groups and springs."""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.circuits import Circuits
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.fixed_values import FixedValues
from dea_fenicsx.model.free_body import HeldBody, held_body
from dea_fenicsx.model.orientation_springs import Turning
from dea_fenicsx.model.part_supports import rigid_parts
from dea_fenicsx.model.prescribed_motion import prescriptions
from dea_fenicsx.model.rigid_motions import free_parts, refuse_free_parts
from dea_fenicsx.model.roles import Roles
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.model.tied_unknowns import (
    Group,
    Pairs,
    columns,
    expansion,
    floating_groups,
    followers,
    global_groups,
)
from dea_fenicsx.model.unknowns import Unknowns
from dea_fenicsx.scene.scene import Scene


class Conditions:
    """The effect of a scene's supports, motions and electrodes on the unknowns.

    Parameters
    ----------
    scene, scales, space
        The scene, its units, and its unknowns.

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

    def __init__(self, scene: Scene, scales: Scales, space: Unknowns) -> None:
        device, kinematics, declared = scene.device, scene.kinematics, scene.declared
        motion, overall, rows = space.of(Role.MOTION), space.parts.get("global", {}), space.rows

        # What is fixed, by supports, prescribed motions and electrodes.
        given = prescriptions(declared.displacements, device, kinematics, motion)
        values = self.fixed_values = FixedValues(space.size, scene.ramps)
        for item in given:
            values.fix(motion[item.axis].dofs[item.local], item.values, item.ramp)
        values.fix_globals(declared.fixed_globals, overall, scales.length)
        values.fix_outside(space.fields, space.parts, device)
        self.electrode_dofs: dict[str, np.ndarray] = {}
        if (potential := space.single(Role.POTENTIAL)) is not None:
            self.electrode_dofs = values.fix_electrodes(
                scene.electrodes, declared.potentials, device, potential, scales.potential
            )

        # What moves as a whole: rigid parts, and a free body, which is held without force.
        self.rigid, joined = rigid_parts(declared, device, kinematics, space, values, given)
        free = free_parts(device, kinematics, motion, values.fixed, joined)
        # If several parts can move, the largest is the free body, and the others are refused.
        bodies, others = (free[:1], free[1:]) if declared.holds_rigid_motions else ([], free)
        refuse_free_parts(others, device, "Fix or Clamp" if bodies else "Fix, Clamp or FreeBody")
        self.body: HeldBody | None = None
        for part in bodies:
            self.body = held_body(part, device, [work for _, work in declared.surface_works])
            values.hold(self.body.pins, motion)

        # What follows other unknowns: the ends of a cell, electrodes of given charge and the like.
        self.pairs: Pairs | None = None
        if kinematics.periodic_ends is not None:
            self.pairs = Pairs.between(device, kinematics.periodic_ends, space.continuous, rows)
            self.pairs.share_fixed(values, space.W)
            for label, dofs in self.electrode_dofs.items():
                self.electrode_dofs[label] = self.pairs.widen(dofs)
        unknowns, forces = kinematics.global_unknowns, declared.global_forces
        self.groups: list[Group] = [
            *floating_groups(declared.floating, scales.charge, self.electrode_dofs, rows),
            *global_groups(unknowns, forces, scene.period, scales, overall, values.fixed, rows),
            *self.rigid.groups(values.fixed, scales.force, scales.length),
        ]
        fixed = values.fixed[: space.owned]
        follower = followers(self.groups, self.pairs, fixed) | self.rigid.followers(fixed)
        self.free = np.flatnonzero(~fixed & ~follower).astype(np.int32)
        self.fixed = np.flatnonzero(fixed).astype(np.int32)
        self.expansion: Any = None
        if self.groups or self.pairs is not None or self.rigid:
            column = columns(self.free, self.groups, self.pairs, rows)
            self.expansion = expansion(column, len(self.free), rows, self.rigid.width)
            self.rigid.number(column, self.groups, self.free)
            self.rigid.fill(self.expansion, np.zeros(space.size), values.fixed)

        resistive = [self.electrode_dofs[e.label] for e, _ in declared.sheets]
        self.sheet_nodes = np.intersect1d(self.free, np.concatenate([[], *resistive]))
        self.sheet_nodes = self.sheet_nodes.astype(np.int32)
        self.circuits = Circuits(scene, scales, self.groups, self.electrode_dofs, self.free)
        self.turning = Turning(self.body, device, motion, self.free)
        self.roles = Roles(space, self.free, device.comm)
        self.unknowns: int = device.comm.allreduce(len(self.free), op=MPI.SUM)
