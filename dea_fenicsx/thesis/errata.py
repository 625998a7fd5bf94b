"""Equations of the thesis as they are printed, for comparison with the right ones."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from dea_fenicsx.origami.kresling import Kresling, StoreyState
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import check_declared
from dea_fenicsx.support.units import in_si


def torque_as_printed(storey: Kresling, state: StoreyState) -> Any:
    """Torque of a storey in N m by eq 72b of J. Park's thesis (2019), word for word.

    R^2 k (pi/4 + theta0 + dtheta)(1 - c0/c): a sine is missing in it, and two signs are turned.
    """
    theta0 = storey.rest_twist + np.pi / 4
    psi = np.pi / 4 + theta0 + (storey.rest_twist - state.twist)
    return storey.radius**2 * storey.stiffness * psi * (1 - storey.rest_diagonal / state.diagonal)


@in_si(side="m", edge="m", stiffness="N/m", height="m")
class PrintedKresling(Kresling):
    """One storey of a square Kresling box with the chords that the thesis prints.

    Eq 65 and 66 have s(x) = R sin(x), which is no chord of the circle through the corners: that is
    2 R sin(x/2).  Such a storey is no solid.  Its height must be given.

    Parameters
    ----------
    side, edge, stiffness, height, sides, twist
        As of `Kresling`.

    Raises
    ------
    InputError
        As `Kresling`, and for other than 4 sides or without a height.
    """

    is_solid = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "chords", "printed")
        check_declared(self)
        if self.sides != 4:
            raise InputError("Kresling: the printed chords are those of a square; give 4 sides.")
        if self.height is None:
            raise InputError(
                "Kresling: with the printed chords a flat cell does not close; give a height."
            )
        super().__post_init__()

    @property
    def longest_chord(self) -> float:
        """Largest value of R sin(x) in m."""
        return self.radius

    @cached_property
    def rest_twist(self) -> float:
        """phi at rest in rad."""
        return float(self.twist_at(self.height))

    @property
    def strain_free(self) -> list[tuple[float, float]]:
        """Twist and height of the state at rest, the only one without strain."""
        return [(float(self.rest_twist), float(self.height))]  # type: ignore[arg-type]

    def twist_at(self, height: Any) -> Any:
        """The smallest twist phi >= 0, in rad, of a storey with rigid edges at a height."""
        return np.arcsin(self._chord_share(height))

    def _chord2(self, x: Any) -> Any:
        return self.radius**2 * np.sin(x) ** 2

    def _slope(self, x: Any) -> Any:
        return self.radius**2 * np.sin(2 * x)

    def _panel_angle(self, h: Any, phi: Any) -> Any:
        return np.full(np.shape(phi), np.nan)

    def _square_change(self, h: Any, phi: Any) -> Any:
        change = (h - self.height) * (h + self.height)
        if self.twist == "held":
            return change
        psi, psi0 = phi + self.step, self.rest_twist + self.step
        return change + (self._chord2(psi) - self._chord2(psi0))

    def _path_force(self, h: Any, phi: Any, c: Any) -> Any:
        """dU/d(-h) with rigid edges in N; sin(2 phi + pi)/sin(2 phi) - 1 = -2."""
        change = self._square_change(h, phi)
        return -2 * self.stiffness * h * change / (c * (c + self.rest_diagonal))
