"""Equations of the thesis as they are printed, for comparison with the right ones."""

from __future__ import annotations

from typing import Any

import numpy as np

from dea_fenicsx.origami.kresling import Kresling, State


def torque_as_printed(storey: Kresling, state: State) -> Any:
    """Torque of a storey in N m by eq 72b of J. Park's thesis (2019), word for word.

    R^2 k (pi/4 + theta0 + dtheta)(1 - c0/c): a sine is missing in it, and two signs are turned.
    """
    theta0 = storey.rest_twist + np.pi / 4
    psi = np.pi / 4 + theta0 + (storey.rest_twist - state.twist)
    return storey.radius**2 * storey.stiffness * psi * (1 - storey.rest_diagonal / state.diagonal)
