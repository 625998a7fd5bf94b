"""The motion that belongs to a state: velocities, accelerations, and the step that led there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

MOTION = "motion"
"""Name of the motion among the histories of a state."""


@dataclass(frozen=True, eq=False)
class Motion:
    """What a state in motion has beside its values.

    Attributes
    ----------
    velocity, acceleration
        First and second time derivative of the displacement in 1/s and 1/s^2, laid out like the
        values of the state; 0 for other fields.
    auxiliary
        The acceleration with which the scheme goes on, that of a time between two steps.
    length
        Length in s of the step to which it belongs; 0 at a start.
    stiffness, constant
        c in 1/s^2 and d in 1/s^2, all local values or None, of the inertial forces M (c u + d) of
        the state; drag is included.
    """

    velocity: np.ndarray
    acceleration: np.ndarray
    auxiliary: np.ndarray
    length: float = 0.0
    stiffness: float = 0.0
    constant: np.ndarray | None = None

    def settled(self, drag: float) -> Motion:
        """The motion of an accepted state, whose inertial forces are known."""
        total = self.acceleration + drag * self.velocity if drag else self.acceleration
        return replace(self, stiffness=0.0, constant=total)
