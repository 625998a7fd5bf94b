"""Springs that keep the orientation of a free body which dead loads may turn.

Dead loads keep their direction in space.  They turn a free body until their moment vanishes.  If
the body were held in its first orientation, reactions would have to bear this moment.  So the
rotations of the body are unknowns like any other displacement.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.mesh.device import Device
from dea_fenicsx.model.components import Component
from dea_fenicsx.model.free_body import Corners, HeldBody, Pin, across, without
from dea_fenicsx.model.state import State


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


class OrientationSprings:
    """Springs that keep a free body's orientation where no dead load gives it one.

    While all dead loads are 0, the orientation of the body is not determined.  Under dead loads of
    one direction its rotation about this direction is not determined.  There, springs keep the
    present orientation.  Their forces are 0, because all other forces are balanced.  The other
    springs do not act under dead loads.  They are only added to the matrix of the kept factor,
    which would be singular at the first step without them.

    Parameters
    ----------
    body
        The free body, or None.
    device, motion
        The device and its displacement components.
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
        self, body: HeldBody | None, device: Device, motion: Sequence[Component], free: np.ndarray
    ) -> None:
        self.ramps: frozenset[str] = frozenset() if body is None else body.turns
        self._body, self._device, self._motion, self._free = body, device, motion, free

    def springs_of(self, state: State) -> Springs:
        """The springs of a state, relaxed in the orientation that they keep.  Collective."""
        return state.history.get(self.NAME, NO_SPRINGS)

    def anchored(self, state: State) -> State:
        """The state with springs that keep the orientation that it has now.  Collective."""
        if not self.ramps:
            return state
        return replace(state, history={**state.history, self.NAME: self._placed(state.values)})

    def _placed(self, values: np.ndarray) -> Springs:
        assert self._body is not None
        corners = Corners(self._device, self._body.part, self._motion, values)
        dofs, always = [], []
        for pin, kept in springs(self._body, corners):
            part = self._motion[pin.axis]
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


def springs(body: HeldBody, corners: Corners) -> Iterator[tuple[Pin, bool]]:
    """Where springs hold an orientation, and which of them act under dead loads, too.

    Collective.

    Parameters
    ----------
    body
        A free body whose translations alone are held.
    corners
        The corners of its part as they lie now.
    """
    free, anchor = body.part.motions, body.pins[0].place
    for pin in body.pins:
        free = without(free, corners.rows_at(pin.place)[pin.axis])
    if len(free) == 3 and len(body.axes) == 2:
        about = np.cross(body.axes[0], body.axes[1])
        along = np.linalg.solve(free[:, :3].T, about) @ free
        for pin in across(corners, anchor, along[None] / np.linalg.norm(along)):
            yield pin, True
            free = without(free, corners.rows_at(pin.place)[pin.axis])
    for pin in across(corners, anchor, free):
        yield pin, False
