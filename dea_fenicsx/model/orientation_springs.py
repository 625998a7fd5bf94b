"""Springs that keep the orientation of a free body which dead loads may turn.

Dead loads keep their direction in space.  They turn a free body until their moment vanishes.  If
the body were held in its first orientation, reactions would have to bear this moment.  So the
rotations of the body are unknowns like any other displacement.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.model.components import Component
from dea_fenicsx.model.dead_loads import felt_axes
from dea_fenicsx.model.fixed_values import Constraints
from dea_fenicsx.model.free_body import Corners, Pin, across, without
from dea_fenicsx.model.rigid_motions import FreePart, modes
from dea_fenicsx.model.state import State
from dea_fenicsx.scene.scene import Scene


@dataclass(frozen=True)
class Springs:
    """Springs on single degrees of freedom, which are relaxed in one orientation of the body.

    Attributes
    ----------
    dofs
        Local degrees of freedom.
    rows
        Their places among the free unknowns of this rank.
    always
        Whether each acts under dead loads, too.
    rest
        The value at which each is relaxed.
    """

    dofs: np.ndarray
    rows: np.ndarray
    always: np.ndarray
    rest: np.ndarray


NO_SPRINGS = Springs(
    np.empty(0, dtype=np.int32), np.empty(0, dtype=np.int64), np.empty(0, dtype=bool), np.empty(0)
)


class Turning:
    """Springs that keep a free body's orientation where no dead load gives it one.

    While all dead loads are 0, the orientation of the body is not determined.  Under dead loads of
    one direction its rotation about this direction is not determined.  There, springs keep the
    present orientation.  Their forces are 0, because all other forces are balanced.  The other
    springs do not act under dead loads.  They are only added to the matrix of the kept factor,
    which would be singular at the first step without them.

    Parameters
    ----------
    scene, parts, constraints
        The scene, its displacement components, and what is held of it.
    free
        Owned local degrees of freedom that are unknowns, sorted.

    Attributes
    ----------
    ramps
        Ramps of the dead loads; empty if nothing turns.
    """

    NAME = "orientation"
    """Name of its springs in the history of a state."""

    STIFFNESS = 1.0
    """Stiffness of each spring, in units of a shear modulus times the device's size."""

    def __init__(
        self, scene: Scene, parts: Sequence[Component], constraints: Constraints, free: np.ndarray
    ) -> None:
        self.ramps = constraints.turns
        self._scene, self._parts, self._free = scene, parts, free
        self._released, self._pins = constraints.released, constraints.pins
        self._felt = felt_axes(scene, self._released) if self.ramps else np.empty((0, 3))

    def springs_of(self, state: State) -> Springs:
        """The springs of a state, relaxed in the orientation that they keep.  Collective."""
        return state.history.get(self.NAME, NO_SPRINGS)

    def anchored(self, state: State) -> State:
        """The state with springs that keep the orientation that it has now.  Collective."""
        if not self.ramps:
            return state
        return replace(state, history={**state.history, self.NAME: self._placed(state.values)})

    def _placed(self, values: np.ndarray) -> Springs:
        found = list(springs(self._scene, self._parts, self._released, self._pins,
                             self._felt, values))  # fmt: skip
        dofs, always = [], []
        for pin, kept in found:
            part = self._parts[pin.axis]
            local = part.dofs[part.on(0, pin.vertices)]
            local = local[np.isin(local, self._free)]
            dofs.append(local)
            always.append(np.full(len(local), kept))
        mine = np.concatenate(dofs)
        rows = np.searchsorted(self._free, mine)
        return Springs(mine, rows, np.concatenate(always), values[mine])

    def holds(self, factors: Mapping[str, float]) -> bool:
        """Whether all springs act, which is so while no dead load acts."""
        return bool(self.ramps) and not any(factors[ramp] for ramp in self.ramps)

    def force(self, at: Springs, values: np.ndarray, factors: Mapping[str, float]) -> np.ndarray:
        """Forces of the springs, in their rows."""
        return self.stiffness(at, factors) * (values[at.dofs] - at.rest)

    def stiffness(self, at: Springs, factors: Mapping[str, float]) -> np.ndarray:
        """Stiffness of each spring, in its row."""
        return self.STIFFNESS * (at.always | self.holds(factors))


def springs(
    scene: Scene, parts: Sequence[Component], part: FreePart | None, held: Sequence[Pin],
    felt: np.ndarray, state: np.ndarray,
) -> Iterator[tuple[Pin, bool]]:  # fmt: skip
    """Where springs hold an orientation, and which of them act under dead loads, too.

    Collective.

    Parameters
    ----------
    scene, parts
        The scene and its displacement components.
    part
        What `FreeBody` holds.
    held
        The pins that hold its translations.
    felt
        Axes about which dead loads turn it.
    state
        Values of the mixed space.
    """
    assert part is not None
    kinematics, box, free = scene.kinematics, part.box, part.motions
    for pin in held:
        free = without(free, modes(pin.place[None], pin.axis, kinematics, box)[0])
    corners, anchor = Corners(scene.device, part, parts, state), held[0].place
    if len(free) == 3 and len(felt) == 2:
        about = np.cross(felt[0], felt[1])
        along = np.linalg.solve(free[:, :3].T, about) @ free
        for pin in across(scene, corners, box, anchor, along[None] / np.linalg.norm(along)):
            yield pin, True
            free = without(free, modes(pin.place[None], pin.axis, kinematics, box)[0])
    for pin in across(scene, corners, box, anchor, free):
        yield pin, False
