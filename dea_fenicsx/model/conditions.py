"""The free unknowns of a problem, after fixed values, ties, groups and springs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.components import Component
from dea_fenicsx.model.fields import Field, Role, pressure_kind
from dea_fenicsx.model.fixed_values import (
    Constraints,
    apply_electrodes,
    apply_overall,
    apply_supports,
)
from dea_fenicsx.model.orientation_springs import Turning
from dea_fenicsx.model.rigid_motions import check_rigid
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.model.tied_unknowns import (
    Group,
    Pairs,
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
    groups
        Degrees of freedom that share a value, with what works on them.
    free, fixed
        Owned local degrees of freedom that are unknowns, and that are fixed, sorted.
    free_fields
        For each group of fields the places of its unknowns among the free ones.
    expansion
        PETSc matrix from the free unknowns to all owned degrees of freedom where some follow
        others, or None.
    turning
        What keeps a free body's orientation where no dead load gives it one.
    unknowns, counts
        Number of free unknowns over all ranks, and by group of fields.
    """

    def __init__(self, scene: Scene, scales: Scales, space: Unknowns) -> None:
        comm = scene.device.comm
        self._space = space
        motion, potential = space.of(Role.MOTION), space.single(Role.POTENTIAL)
        values = self.fixed_values = Constraints(space.size)
        apply_supports(scene, motion, values)
        apply_overall(scene, space.parts.get("global", {}), values)
        check_rigid(scene, motion, values.fixed, values.released if values.turns else None)
        self.electrode_dofs: dict[str, np.ndarray] = {}
        if potential is not None:
            self.electrode_dofs = apply_electrodes(scene, potential, scales.potential, values)
        for ramp in scene.ramps:
            values.base.setdefault(ramp, np.zeros(space.size))
        self.pairs = self._tie_ends(scene, motion, potential)
        self.groups: list[Group] = [
            *floating_groups(scene, scales.charge, self.electrode_dofs, space.rows),
            *global_groups(scene, scales, space.parts.get("global", {}), values, space.rows),
        ]
        fixed = values.fixed[: space.owned]
        follower = followers(self.groups, self.pairs, fixed)
        self.free = np.flatnonzero(~fixed & ~follower).astype(np.int32)
        self.fixed = np.flatnonzero(fixed).astype(np.int32)
        self.turning = Turning(scene, motion, values, self.free)
        self.free_fields = {
            name: self.places(fields) for name, fields in space.groups().items()
        }
        self.unknowns: int = comm.allreduce(len(self.free), op=MPI.SUM)
        self.counts: dict[str, int] = {
            name: comm.allreduce(len(where), op=MPI.SUM)
            for name, where in self.free_fields.items()
        }
        self.expansion: Any = None
        if self.groups or self.pairs is not None:
            self.expansion = expansion(self.free, self.groups, self.pairs, space.rows)

    def places(self, fields: list[Field]) -> np.ndarray:
        """Places of some fields' unknowns among the free ones of this rank."""
        dofs = self._space.owned_of(fields)
        return np.searchsorted(self.free, np.intersect1d(dofs, self.free))

    def _tie_ends(
        self, scene: Scene, motion: Sequence[Component], potential: Component | None
    ) -> Pairs | None:
        """Tie the upper end of a periodic cell to the lower one, fixed values included."""
        ends, space = scene.kinematics.periodic_ends, self._space
        if ends is None:
            return None
        parts = list(motion)
        if pressure_kind(scene) == "continuous":
            parts += space.of(Role.MULTIPLIER)
        if potential is not None:
            parts.append(potential)
        pairs = Pairs.between(scene.device, ends, parts, space.rows)
        pairs.share_fixed(self.fixed_values, space.W)
        for label, dofs in self.electrode_dofs.items():
            member = np.zeros(space.owned, dtype=bool)
            member[dofs[dofs < space.owned]] = True
            self.electrode_dofs[label] = np.union1d(dofs, np.flatnonzero(pairs.join(member)))
        return pairs
