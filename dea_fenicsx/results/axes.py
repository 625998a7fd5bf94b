"""Names of the axes of a run's fields, by which components of vectors and tensors are ordered."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

FIXED = ("x", "y", "z")
"""Axes of fields along fixed directions."""

ABOUT_AN_AXIS = ("r", "z", "hoop")
"""Axes of fields of a body of revolution and of a helical cell: those of the picture come first.

Inside the package the hoop comes second, see `Axisymmetric`.
"""


def axes_of_fields(kinematics: Any) -> tuple[str, str, str]:
    """Names of the axes by which the fields in files are ordered."""
    return ABOUT_AN_AXIS if kinematics.axis_of_rotation else FIXED


def axes_told(summary: dict[str, Any]) -> tuple[str, str, str]:
    """The same of a run, by its summary; one of an earlier version tells the kinematics only."""
    settings: Any = summary.get("settings")
    with suppress(KeyError, TypeError):
        if settings["axes"] in (list(FIXED), list(ABOUT_AN_AXIS)):
            one, two, three = settings["axes"]
            return one, two, three
    with suppress(KeyError, TypeError):
        if settings["kinematics"]["type"] in ("Axisymmetric", "Helical"):
            return ABOUT_AN_AXIS
    return FIXED
