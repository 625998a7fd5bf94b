"""Which columns of a history to draw first: the load, and what the script recorded."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from dea_fenicsx.results.reading import load_columns

# columns of every history, beside ramps and what the script records
_COMMON = {
    "step", "time", "time_s", "ramp", "event", "max_field_V_per_m", "max_field_x_m",
    "max_field_y_m", "max_field_z_m", "min_J", "volume_error", "residual", "newton_iterations",
    "krylov_iterations", "factorisations", "retries", "inertia", "inertia_is_of_this_step",
    "negative_modes", "wall_s",
}  # fmt: skip


def recorded(history: Mapping[str, np.ndarray]) -> list[str]:
    """Numeric columns of a history but those that every run has."""
    return [n for n, v in history.items() if n not in _COMMON and v.dtype.kind == "f"]


def load_column(history: Mapping[str, np.ndarray], told: dict[str, Any]) -> str:
    """The column to draw against: the time in s, else the last ramp's load, else the path."""
    if "time_s" in history:
        return "time_s"
    return next(iter(load_columns(history, told)), "time")


def ordinate(history: Mapping[str, np.ndarray], told: dict[str, Any]) -> str:
    """The first recorded column that is no load, else the largest field or the smallest J."""
    loads = load_columns(history, told)
    free = [n for n in recorded(history) if n not in loads]
    names = [*free, "max_field_V_per_m", "min_J"]
    return next((n for n in names if n in history), "time")
