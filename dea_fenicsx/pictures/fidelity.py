"""Speed against error as a picture, from a ladder's CSV alone."""

from __future__ import annotations

import csv
import os
from functools import partial
from pathlib import Path

import numpy as np

from dea_fenicsx.pictures.curves import STYLE, lettering, write_whole
from dea_fenicsx.support.errors import InputError

MARKED = (1e-2, 1e-3, 1e-4)
"""Errors for which the cheapest rung is circled."""


def ladder(path: str | os.PathLike, out: str | os.PathLike | None = None) -> list[Path]:
    """Draw wall time against error, a line for each fidelity, the cheapest choices circled.

    Parameters
    ----------
    path
        The CSV that `Ladder.write` wrote.
    out
        Path of the picture, without ending; by default beside the CSV.

    Returns
    -------
    list of Path
        PNG and SVG.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    try:
        with open(path, newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    except (csv.Error, ValueError) as fault:
        raise InputError(f"{path} is no table of rungs; write it with Ladder.write.") from fault
    if not rows:
        raise InputError(f"{path} holds no rungs; write it with Ladder.write.")
    try:
        error = np.array([float(row["error"]) for row in rows])
        wall = np.array([float(row["wall_s"]) for row in rows])
        names = [lettering(row["fidelity"]) for row in rows]
    except (KeyError, ValueError, TypeError) as fault:
        raise InputError(f"{path} is no table of rungs; write it with Ladder.write.") from fault
    # an error of nothing but rounding has no place on a logarithmic axis
    error = np.maximum(error, 1e-12)
    target = Path(out) if out else Path(path).with_suffix("")
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(85 / 25.4, 70 / 25.4), layout="constrained")
        for name in dict.fromkeys(names):
            on = [k for k, n in enumerate(names) if n == name]
            axes.loglog(error[on], wall[on], "o-", label=name)
        for wanted in MARKED:
            good = np.flatnonzero(error <= wanted)
            if len(good):
                best = good[np.argmin(wall[good])]
                axes.plot(error[best], wall[best], "o", ms=8, mfc="none", mec="0.3", mew=0.8)
                axes.annotate(f"{100 * wanted:g} %",
                              (error[best], wall[best]), xytext=(4, 5),
                              textcoords="offset points", fontsize=6)  # fmt: skip
            axes.axvline(wanted, color="0.85", lw=0.6, zorder=0)
        axes.invert_xaxis()
        axes.set_xlabel("relative error")
        axes.set_ylabel("wall time [s]")
        axes.legend(fontsize=6)
        made = [
            write_whole(target.with_name(f"{target.name}.{end}"),
                        partial(figure.savefig, format=end, dpi=300))
            for end in ("png", "svg")
        ]  # fmt: skip
        plt.close(figure)
    return made
