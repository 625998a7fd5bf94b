"""The picture of a calibration: each column with its fit and band, and the residual below."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.calibration.statistics import half_width
from dea_fenicsx.pictures.curves import STYLE, axis_label, write_whole

MOST_WIDE = 4
"""Most columns of panels."""


def draw(found: Any, path: Path) -> Path:
    """Draw all columns of a `Calibration` (PNG)."""
    import matplotlib
    from matplotlib.figure import Figure

    count = len(found.columns)
    wide = min(MOST_WIDE, math.ceil(math.sqrt(count)))
    high = math.ceil(count / wide)
    C = np.where(np.isfinite(found.covariance), found.covariance, 0.0)
    factor = half_width(found.freedom, found.exact)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(2.6 * wide + 0.4, 2.5 * high + 0.2), layout="constrained")
        panels = figure.subplots(
            2 * high, wide, squeeze=False, gridspec_kw={"height_ratios": [3, 1] * high}
        )
        for k in range(wide * high):
            row, column = divmod(k, wide)
            above, below = panels[2 * row, column], panels[2 * row + 1, column]
            if k >= count:
                above.axis("off")
                below.axis("off")
                continue
            one = found.columns[k]
            variance = np.einsum("ij,jk,ik->i", one.slopes, C, one.slopes)
            _panel(above, below, one, factor * np.sqrt(np.maximum(variance, 0.0)))
        return write_whole(path, lambda p: figure.savefig(p, format="png", dpi=200))


def _panel(a: Any, b: Any, one: Any, half: np.ndarray) -> None:
    """A column with its fit, and its residual below."""
    x, c = one.column.x, one.column
    own = one.test.quantity
    label, unit = axis_label(own or c.name, float(np.abs(c.measured).max()))
    a.plot(x, c.measured / unit, "o", ms=2.2, mfc="none", mew=0.5, label="measured")
    a.plot(x, one.predicted / unit, "-", lw=0.9, color="C1", label="fitted")
    ends = [(one.predicted + sign * half) / unit for sign in (-1, 1)]
    if np.all(np.diff(x) >= 0):
        a.fill_between(x, *ends, color="C1", alpha=0.3, lw=0, label="95 %")
    else:  # a loop
        for end in ends:
            a.plot(x, end, ":", lw=0.5, color="C1", label="95 %" if end is ends[0] else None)
    b.plot(x, one.residual / unit, ".", ms=2.5, color="C0")
    b.axhline(0, color="k", lw=0.5)
    a.set_title(f"{one.test.name}, {c.name}" if own else one.test.name, fontsize=7)
    a.set_ylabel(label, fontsize=7)
    b.set_ylabel("residual", fontsize=6)
    across, size = axis_label(one.test.x_name, 1.0)
    b.set_xlabel(across if size == 1 else one.test.x_name.replace("_", " "), fontsize=7)
    a.tick_params(labelbottom=False)
    a.legend(fontsize=5.5)
