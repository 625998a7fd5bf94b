"""The free unknowns of a problem, after fixed values, ties, groups and springs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.components import Component
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.fixed_values import (
    Constraints,
    apply_electrodes,
    apply_overall,
    apply_regions,
    apply_supports,
)
from dea_fenicsx.model.orientation_springs import Turning
from dea_fenicsx.model.rigid_motions import check_rigid
from dea_fenicsx.model.rigid_parts import RigidParts
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
    pairs
        What ties the two ends of a helical cell, or None.
    rigid
        The rigid parts, whose nodes follow a translation and an angle.
    groups
        Degrees of freedom that share a value, with what works on them.
    free, fixed
        Owned local degrees of freedom that are unknowns, and that are fixed, sorted.
    roles
        The unknowns by the role of their fields.
    expansion
        PETSc matrix from the free unknowns to all owned degrees of freedom where some follow
        others, or None.  With rigid parts it is that of the undeformed state at first.
    turning
        What keeps a free body's orientation where no dead load gives it one.
    unknowns
        Number of free unknowns over all ranks.
    """

    def __init__(self, scene: Scene, scales: Scales, space: Unknowns) -> None:
        comm = scene.device.comm
        self._space = space
        motion, potential = space.of(Role.MOTION), space.single(Role.POTENTIAL)
        values = self.fixed_values = Constraints(space.size)
        apply_supports(scene, motion, values)
        apply_overall(scene, space.parts.get("global", {}), values)
        self.rigid = RigidParts(scene, motion, space.parts, space.rows)
        given = self.rigid.fix(scene, values)
        check_rigid(scene, motion, values.fixed | given, values.released if values.turns else None)
        apply_regions(scene, space.fields, space.parts, values)
        space.at_rest[values.fixed] = 0.0
        self.electrode_dofs: dict[str, np.ndarray] = {}
        if potential is not None:
            self.electrode_dofs = apply_electrodes(scene, potential, scales.potential, values)
        for ramp in scene.ramps:
            values.base.setdefault(ramp, np.zeros(space.size))
        self.pairs = self._tie_ends(scene, motion)
        self.groups: list[Group] = [
            *floating_groups(scene, scales.charge, self.electrode_dofs, space.rows),
            *global_groups(scene, scales, space.parts.get("global", {}), values, space.rows),
            *self.rigid.groups(scene, scales, values),
        ]
        fixed = values.fixed[: space.owned]
        follower = followers(self.groups, self.pairs, fixed) | self.rigid.followers(space.owned)
        self.free = np.flatnonzero(~fixed & ~follower).astype(np.int32)
        self.fixed = np.flatnonzero(fixed).astype(np.int32)
        self.turning = Turning(scene, motion, values, self.free)
        self.roles = Roles(space, self.free, comm)
        self.unknowns: int = comm.allreduce(len(self.free), op=MPI.SUM)
        self.expansion: Any = None
        if self.groups or self.pairs is not None or self.rigid:
            self.expansion = self._expansion(space)

    def _expansion(self, space: Unknowns) -> Any:
        ties = self.free, self.groups, self.pairs, space.rows
        if not self.rigid:
            return expansion(*ties)
        self.rigid.number(columns(*ties))
        return expansion(*ties, lambda P: self.rigid.fill(P, np.zeros(space.size)))

    def _tie_ends(self, scene: Scene, motion: Sequence[Component]) -> Pairs | None:
        """Tie the upper end of a periodic cell to the lower one, fixed values included.

        All fields that are continuous are tied, the displacement first.
        """
        ends, space = scene.kinematics.periodic_ends, self._space
        if ends is None:
            return None
        parts = list(motion)
        for field in space.fields:
            if field.role is not Role.MOTION and field.is_continuous:
                parts += space.parts[field.name].values()
        pairs = Pairs.between(scene.device, ends, parts, space.rows)
        pairs.share_fixed(self.fixed_values, space.W)
        for label, dofs in self.electrode_dofs.items():
            member = np.zeros(space.owned, dtype=bool)
            member[dofs[dofs < space.owned]] = True
            self.electrode_dofs[label] = np.union1d(dofs, np.flatnonzero(pairs.join(member)))
        return pairs
