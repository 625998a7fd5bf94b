"""The body that is attached to a rigid part: its mass and its moments of inertia."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dea_fenicsx.scene.kinematics_base import Kinematics
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import finite

INERTIA_TOLERANCE = 1e-9
"""Relative error of moments of inertia of a flat body, whose largest is the sum of the others."""


@dataclass(frozen=True)
class Attached:
    """A body whose centre of mass is the centre of a rigid part.

    Attributes
    ----------
    kilograms
        Its mass in kg.
    moments
        Moments of inertia in kg m^2 about each axis of rotation; empty for a point mass.
    """

    kilograms: float
    moments: tuple[float, ...] = ()

    @classmethod
    def of(cls, kilograms: float, moments: tuple[float, ...] | float | None) -> Attached | None:
        """The body that `Rigid` declares, or None if it has neither mass nor moments."""
        given = _listed(moments)
        return cls(float(kilograms), given) if kilograms or any(given) else None


def _listed(moments: tuple[float, ...] | float | None) -> tuple[float, ...]:
    if moments is None:
        return ()
    return tuple(moments) if isinstance(moments, tuple | list) else (float(moments),)


def check_attached(
    where: str, kilograms: float, moments: tuple[float, ...] | float | None,
    kinematics: Kinematics,
) -> None:  # fmt: skip
    """Raise InputError unless a body can be attached to the rigid part `where`."""
    what = f"Rigid on {where!r}"
    finite(kilograms, f"kilograms= of {what}")
    if kilograms < 0:
        raise InputError(f"The mass of {what} is {kilograms:g} kg, but must be at least 0.")
    if moments is None:
        return
    given, turns = _listed(moments), kinematics.rotations
    if not turns:
        raise InputError(
            f"moments= of {what} has no effect, since a part of an axisymmetric section does not "
            "turn; leave it out."
        )
    if len(given) != turns:
        wanted = "three, about x, y and z" if turns == 3 else "one, about z"
        raise InputError(f"moments= of {what} has {len(given)} numbers, but must have {wanted}.")
    for value in given:
        finite(value, f"A moment of inertia of {what}")
        if value < 0:
            raise InputError(
                f"A moment of inertia of {what} is {value:g} kg m^2, but must be at least 0."
            )
    if turns == 3 and 2 * max(given) > np.sum(given) * (1 + INERTIA_TOLERANCE):
        raise InputError(
            f"The moments of inertia of {what} are {', '.join(f'{v:g}' for v in given)} kg m^2, "
            "which no body has: none may be larger than the sum of the two others."
        )
