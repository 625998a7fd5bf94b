"""Checks of what a test predicts: its columns, their lengths, and the unit of what was measured."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

from dea_fenicsx.calibration.experiments import Column, Experiment
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown

OTHER_UNIT = 200.0
"""Ratio of measured and predicted values above which the unit is doubted."""


def shaped(found: Mapping[str, Any], c: Column, test: Experiment) -> np.ndarray:
    """A column of what a test predicts, with as many values as were measured.

    Raises
    ------
    InputError
        If the column is missing or has another length.
    """
    if not isinstance(found, Mapping) or c.name not in found:
        names = ", ".join(map(str, found)) if isinstance(found, Mapping) else shown(found)
        raise InputError(f"The test {test.name!r} predicts no column {c.name!r}, but {names}.")
    try:
        values = np.asarray(found[c.name], dtype=float)
        return np.broadcast_to(values.ravel() if values.ndim else values, c.measured.shape)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"The test {test.name!r} predicts {shown(found[c.name])} for {c.name!r}, but must "
            f"predict {len(c.measured)} numbers."
        ) from error


def doubt_unit(test: Experiment, c: Column, values: np.ndarray) -> None:
    """Warn if the measured values are hundreds of times those that are predicted, or less."""
    sizes = [float(np.sqrt(np.mean(x**2))) for x in (c.measured, values)]
    if min(sizes) == 0:
        return
    ratio = sizes[0] / sizes[1]
    if not 1 / OTHER_UNIT < ratio < OTHER_UNIT:
        warnings.warn(
            f"The column {c.name!r} of the test {test.name!r} is {ratio:.3g} times what is "
            "predicted at the start; values must be in SI units (1 kPa = 1e3 Pa, 1 mm = 1e-3 m).",
            stacklevel=5,
        )
