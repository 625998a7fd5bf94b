"""Values of a run as text: cells of history.csv and values of summary.json."""

from __future__ import annotations

from typing import Any

import numpy as np

from dea_fenicsx.support.type_checks import plain


def number_text(value: Any) -> Any:
    """Full precision for floats, an empty cell for None."""
    if value is None:
        return ""
    return repr(float(value)) if isinstance(value, float | np.floating) else value


def json_value(value: Any) -> Any:
    """What JSON can hold: NaN and infinity become null."""
    value = plain(value)
    if isinstance(value, dict):
        return {str(k): json_value(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [json_value(v) for v in value]
    if isinstance(value, np.ndarray):
        return json_value(value.tolist())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    if isinstance(value, str | int | float | bool) or value is None:
        return value
    return str(value)
