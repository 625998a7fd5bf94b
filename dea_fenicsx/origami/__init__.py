"""The Kresling spiral box of thesis chapter 5 in closed form: kinematics, pattern, actuation.

    storey = Kresling(side=2.125 * INCH, edge=2.75 * INCH, stiffness=17 * POUND_FORCE / INCH)
    storey.strain_free, storey.barrier(), storey.snap_forces()
    storey.at(height)                         # twist, strain, energy, force
    CreasePattern(storeys=1, stiffeners="panels").write_svg("pattern.svg")

NumPy and SciPy only; nothing here needs a mesh.
"""

from importlib import import_module
from typing import Any
from warnings import warn

from dea_fenicsx.origami.box import (
    Box,
    blocked_force,
    table_of_angles,
    voltage_to_block,
)
from dea_fenicsx.origami.kresling import Kresling, StoreyState, strokes
from dea_fenicsx.origami.pattern import CreasePattern, SmoothFold, least_fold_width
from dea_fenicsx.origami.solid import fold_angles, vertices
from dea_fenicsx.support.units import INCH, POUND_FORCE

__all__ = [
    "Kresling",
    "StoreyState",
    "strokes",
    "vertices",
    "fold_angles",
    "CreasePattern",
    "SmoothFold",
    "least_fold_width",
    "Box",
    "table_of_angles",
    "blocked_force",
    "voltage_to_block",
    "INCH",
    "POUND_FORCE",
]


def __getattr__(name: str) -> Any:
    """What has moved to another room or got another name, with a DeprecationWarning."""
    if name == "State":
        warn("origami.State is called StoreyState now.", DeprecationWarning, stacklevel=2)
        return StoreyState
    if name == "torque_as_printed":
        errata = "dea_fenicsx.thesis.errata"
        warn(f"torque_as_printed is in {errata} now.", DeprecationWarning, stacklevel=2)
        return getattr(import_module(errata), name)
    raise AttributeError(f"dea_fenicsx.origami has no {name!r}")
