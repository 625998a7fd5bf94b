"""Tapers: potentials that fall off along an electrode."""

from __future__ import annotations

from dataclasses import dataclass

from dea_fenicsx.scene.kinematics_base import Kinematics
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import finite

FACE_TOLERANCE = 1e-6
"""Largest distance of a place from the end of a part, as a share of the part's length."""


@dataclass(frozen=True)
@in_si(start="m", end="m")
class Taper:
    """A smooth decrease from 1 to 0 along a coordinate: (1 + cos(pi t))/2, with t from 0 to 1.

    Parameters
    ----------
    start, end
        Undeformed coordinates in m between which it decreases.  It is 1 before the start and 0
        behind the end.  A part of the electrode must lie between them.
    along
        ``"x"``, ``"y"``, ``"z"``, or ``"r"``, the distance from the z axis (in an axisymmetric
        section its first coordinate).
    """

    start: float
    end: float
    along: str = "r"

    def check(self, label: str, kinematics: Kinematics) -> None:
        """Raise InputError unless it runs along a coordinate, on the electrode of a label."""
        axes = set(kinematics.coordinates) | ({"r"} if kinematics.dim == 3 else set())
        finite(self.start, f"The start of the taper of electrode {label!r}")
        finite(self.end, f"The end of the taper of electrode {label!r}")
        if self.start == self.end or self.along not in axes:
            raise InputError(
                f"The taper of electrode {label!r} runs along {self.along!r} from {self.start:g} m "
                f"to {self.end:g} m; give two different coordinates along one of "
                f"{', '.join(sorted(axes))}."
            )

    def check_reach(self, label: str, low: float, high: float) -> None:
        """Raise InputError unless it falls somewhere between the electrode's ends."""
        first, last = sorted((self.start, self.end))
        room = FACE_TOLERANCE * (last - first)
        if low < last - room and high > first + room:
            return
        before = high <= first + room if self.start < self.end else low >= last - room
        effect = "has no effect" if before else "leaves it at 0 V everywhere"
        raise InputError(
            f"The taper of electrode {label!r} falls from {self.along} = {self.start:g} m to "
            f"{self.end:g} m, but the electrode lies between {low:.6g} m and {high:.6g} m, so "
            f"that it {effect}; give start and end on the electrode, in metres, or leave it out."
        )
