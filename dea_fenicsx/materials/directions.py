"""Directions of fibres in the undeformed body: constant, or about an axis."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import is_finite


class Direction(ABC):
    """A field of directions in the undeformed body.

    Its constants are numbers, so that another angle needs no compilation.  In an axisymmetric
    section, a helical cell and a membrane of revolution the components are (r, hoop, z).
    """

    @abstractmethod
    def at(self, place: Sequence[Any]) -> tuple[Any, Any, Any]:
        """A vector along the fibres, of any length, in plain arithmetic.

        Parameters
        ----------
        place
            The three coordinates in m of a point of the undeformed body; (r, 0, z) in a section.
        """

    def unit(self) -> np.ndarray:
        """The unit vector of a direction that is the same everywhere, shape (3,).

        Raises
        ------
        InputError
            If the direction differs from place to place.
        """
        raise InputError(
            f"A homogeneous state needs fibres along one vector, but these have "
            f"{type(self).__name__}(...); give a vector such as (1, 0, 0)."
        )

    def faults(self) -> list[str]:
        """What is wrong with it, as a list of clauses."""
        found = []
        for f in fields(self):  # type: ignore[arg-type]
            value = getattr(self, f.name)
            several = value if isinstance(value, tuple) else (value,)
            if not all(is_finite(x) for x in several) or (
                isinstance(value, tuple) and len(value) != 3
            ):
                found.append(
                    f"{f.name} of {type(self).__name__} is {shown(value)}, but must be "
                    + ("three finite numbers" if isinstance(value, tuple) else "a finite number")
                )
        return found or self._own_faults()

    def _own_faults(self) -> list[str]:
        return []


def _zero(what: str) -> list[str]:
    return [f"the {what} has the length 0, so that it has no direction; give a vector other than 0"]


@dataclass(frozen=True)
class Along(Direction):
    """One vector everywhere; its length does not matter.

    Parameters
    ----------
    vector
        Three components along x, y, z, or along r, hoop and z where there is an axis of rotation.
    """

    vector: tuple[float, float, float]

    def at(self, place: Sequence[Any]) -> tuple[Any, Any, Any]:
        return self.vector

    def unit(self) -> np.ndarray:
        a = np.array(self.vector, dtype=float)
        return a / np.linalg.norm(a)

    def _own_faults(self) -> list[str]:
        return [] if any(self.vector) else _zero("vector of the fibres")


class AboutAxis(Direction):
    """A direction that is the same along a circle about an axis."""

    axis: tuple[float, float, float]
    through: tuple[float, float, float]

    def at(self, place: Sequence[Any]) -> tuple[Any, Any, Any]:
        arm = [x - c for x, c in zip(place, self.through, strict=True)]
        size = sum(n * n for n in self.axis) ** 0.5
        n = [c / size for c in self.axis]
        height = sum(a * c for a, c in zip(arm, n, strict=True))
        out = [a - height * c for a, c in zip(arm, n, strict=True)]
        r = sum(a * a for a in out) ** 0.5
        radial = [a / r for a in out]
        hoop = [
            n[1] * radial[2] - n[2] * radial[1],
            n[2] * radial[0] - n[0] * radial[2],
            n[0] * radial[1] - n[1] * radial[0],
        ]
        parts = self.parts(r)
        return tuple(
            parts[0] * radial[i] + parts[1] * hoop[i] + parts[2] * n[i] for i in range(3)
        )  # type: ignore[return-value]

    @abstractmethod
    def parts(self, r: Any) -> tuple[Any, Any, Any]:
        """Components along the radius, the hoop and the axis at a distance r in m from the axis."""

    def _own_faults(self) -> list[str]:
        return [] if any(self.axis) else _zero("axis of the fibres")


@dataclass(frozen=True)
@in_si(through="m")
class Cylindrical(AboutAxis):
    """A vector in cylindrical components: (1, 0, 0) is radial, (0, 1, 0) along hoops.

    Parameters
    ----------
    vector
        Components along the radius, the hoop and the axis.
    axis, through
        Direction of the axis, and a point of it in m.  No fibre direction exists on the axis.
    """

    vector: tuple[float, float, float]
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    through: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def parts(self, r: Any) -> tuple[Any, Any, Any]:
        return self.vector

    def _own_faults(self) -> list[str]:
        return super()._own_faults() + ([] if any(self.vector) else _zero("vector of the fibres"))


@dataclass(frozen=True)
@in_si(through="m")
class Wound(AboutAxis):
    """Wound about an axis at one angle to it, cos(angle) along the axis and sin(angle) on the hoop.

    Parameters
    ----------
    degrees
        Angle to the axis in degrees, positive for a right-handed screw.
    axis, through
        Direction of the axis, and a point of it in m.
    """

    degrees: float
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    through: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def parts(self, r: Any) -> tuple[Any, Any, Any]:
        angle = self.degrees * (math.pi / 180)
        # The tangent of half the angle serves numbers and symbols alike: see `_cos_and_sin`.
        cos, sin = _cos_and_sin(angle)
        return 0.0, sin, cos


@dataclass(frozen=True)
@in_si(pitch="m", through="m")
class Helix(AboutAxis):
    """Helices of one pitch about an axis: the tangent of their angle to it is 2 pi r/pitch.

    Parameters
    ----------
    pitch
        Rise per turn in m, not 0; negative for a left-handed screw.
    axis, through
        Direction of the axis, and a point of it in m.
    """

    pitch: float
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    through: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def parts(self, r: Any) -> tuple[Any, Any, Any]:
        return 0.0, 2 * math.pi * r / self.pitch, 1.0

    def _own_faults(self) -> list[str]:
        flat = "pitch of Helix is 0, but must not be; take Wound(degrees=90) for rings"
        return super()._own_faults() + ([] if self.pitch else [flat])


def _cos_and_sin(angle: Any) -> tuple[Any, Any]:
    """Cosine and sine of a number, or of a symbol of UFL."""
    if isinstance(angle, int | float | np.floating):
        return math.cos(angle), math.sin(angle)
    import ufl  # symbols come from there, so that it is at hand

    return ufl.cos(angle), ufl.sin(angle)


def direction(given: Any) -> Any:
    """A direction, or three finite numbers as `Along`; anything else is returned as it is."""
    if isinstance(given, np.ndarray) and given.ndim == 1:
        given = given.tolist()
    if isinstance(given, list | tuple) and len(given) == 3 and all(map(is_finite, given)):
        return Along(tuple(given))  # type: ignore[arg-type]
    return given
