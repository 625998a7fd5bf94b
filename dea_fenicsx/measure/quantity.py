"""The quantities that can be measured inside of a device: their names, units and components.

A quantity is evaluated as a whole tensor, dimensionless, and then reduced to one number for each
place: a component, a size or a principal value.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import ufl

from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.scene.kinematics_base import Kinematics
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown

Quantity = Literal["displacement", "potential", "pressure", "stretch", "stress", "field"]
"""What can be measured at a point."""

LocalQuantity = Literal["displacement", "potential", "pressure", "stretch", "stress", "field", "J"]
"""What can be measured over a region or along a line."""

QUANTITY_UNITS = {
    "displacement": "m", "potential": "V", "pressure": "Pa", "stretch": "", "stress": "Pa",
    "field": "V_per_m", "J": "",
}  # fmt: skip

NUMBER_OF_AXES = {"displacement": 1, "potential": 0, "pressure": 0, "stretch": 1, "stress": 2,
                  "field": 1, "J": 0}  # fmt: skip
"""How many axes name a component."""

WITHOUT_AXIS = {"displacement": "its size", "stretch": "the largest principal stretch",
                "field": "its size"}  # fmt: skip
"""What a quantity with axes is where none is named."""


def axis_numbers(
    kinematics: Kinematics, what: str, axis: Any, owner: str, sizes: bool = False
) -> list[int]:
    """Numbers of the axes that name a component.

    Parameters
    ----------
    kinematics
        The kinematics.
    what, axis
        The quantity, and the axes as the user names them.
    owner
        The observable, for messages.
    sizes
        Whether the axis may be left out, see `WITHOUT_AXIS`; the list is empty then.

    Raises
    ------
    InputError
        If the axis is none of the quantity's.
    """
    axes = kinematics.axes
    if what != "displacement":
        axes = "rtz" if kinematics.axis_of_rotation else "xyz"
    if axis is None and sizes and what in WITHOUT_AXIS:
        return []
    count = NUMBER_OF_AXES[what]
    given = axis or ""
    if len(given) != count or any(a not in axes for a in given):
        due = {0: "left out", 1: f"one of {', '.join(axes)}",
               2: f"two of {', '.join(axes)}, such as '{axes[0]}{axes[-1]}'"}[count]  # fmt: skip
        if sizes and what in WITHOUT_AXIS:
            due += f", or left out for {WITHOUT_AXIS[what]}"
        raise InputError(
            f"The axis of {owner} is {shown(axis)}, but for the {what} must be {due}."
        )
    return [axes.index(a) for a in given]


def needs_field(what: str) -> bool:
    """Whether a quantity has a value in dielectrics alone."""
    return what in ("potential", "field")


def check_field(problem: Problem, what: str, told: str) -> None:
    """Raise InputError if a quantity needs a potential that the scene lacks."""
    if needs_field(what) and problem.potential is None:
        raise InputError(f"{told} has no value: the scene has no electrodes.")


def tensor_of(what: str, at: MaterialPoint) -> Any:
    """The tensor from which a quantity follows, symbolic and dimensionless."""
    found = {
        "displacement": lambda: at.fields["u"],
        "potential": lambda: at.fields["phi"],
        "pressure": lambda: at.cauchy_stress,
        "stretch": lambda: at.F,
        "stress": lambda: at.cauchy_stress,
        "field": lambda: at.true_field,
        "J": lambda: at.J,
    }
    return found[what]()


def entries_of(tensor: Any) -> list[Any]:
    """The entries of a symbolic tensor in the order of its shape, one of a scalar."""
    shape = ufl.as_ufl(tensor).ufl_shape
    return [tensor[i] for i in np.ndindex(shape)] if shape else [tensor]


def unit_of(what: str, scales: Scales) -> float:
    """SI value of the dimensionless unit of a quantity."""
    return {
        "displacement": scales.length, "potential": scales.potential, "pressure": scales.stress,
        "stress": scales.stress, "field": scales.field,
    }.get(what, 1.0)  # fmt: skip


def reduced(what: str, axes: list[int], entries: np.ndarray) -> np.ndarray:
    """One number for each place.

    Parameters
    ----------
    what, axes
        The quantity and the numbers of its axes.
    entries
        The entries of its tensor at each place, shape (..., entries).

    Returns
    -------
    ndarray of shape (...)
    """
    if what in ("potential", "J"):
        return np.asarray(entries[..., 0])
    if what in ("displacement", "field"):
        return entries[..., axes[0]] if axes else np.linalg.norm(entries, axis=-1)
    matrix = entries.reshape(*entries.shape[:-1], 3, 3)
    if what == "pressure":
        return np.asarray(-np.trace(matrix, axis1=-2, axis2=-1) / 3)
    if what == "stress":
        return np.asarray(matrix[..., axes[0], axes[1]])
    if axes:
        return np.asarray(np.linalg.norm(matrix[..., :, axes[0]], axis=-1))
    return np.asarray(np.linalg.norm(matrix, ord=2, axis=(-2, -1)))
