"""Figure 5.2 for any number of storeys beside each other."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from dea_fenicsx.errors import InputError
from dea_fenicsx.origami.kresling import Kresling


def draw_readings(storeys: Mapping[str, Kresling], path: str | Path) -> Path:
    """Draw strain, twist and force over the loss of height from rest.

    Force by the energy (lines) and by eq 72a (dashes); for each storey whose twist is free a cross
    where its panels meet, if that is on the way.

    Parameters
    ----------
    storeys
        Name in the legend to storey.
    path
        The picture; its ending says the kind.

    Raises
    ------
    InputError
        If matplotlib is missing.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise InputError("Curves need matplotlib; pip install matplotlib.") from error
    figure = Figure(figsize=(7.2, 2.7), layout="constrained")
    strain, twist, force = figure.subplots(1, 3)
    for i, (name, storey) in enumerate(storeys.items()):
        assert storey.height is not None
        colour = f"C{i}"
        heights = np.linspace(storey.height, storey.lowest, 200)
        state = storey.at(heights)
        loss = 1e3 * (storey.height - heights)
        strain.plot(loss, 100 * state.strain, color=colour, lw=1, label=name)
        twist.plot(loss, np.degrees(state.twist - storey.rest_twist), color=colour, lw=1)
        force.plot(loss, state.force, color=colour, lw=1)
        if storey.twist == "free":
            force.plot(loss, state.partial_force, "--", color=colour, lw=1)
    force.plot([], [], "k-", lw=1, label="energy")
    force.plot([], [], "k--", lw=1, label="eq 72a")
    force.legend(fontsize=6, frameon=False)
    for axes, text in ((strain, "Strain of the diagonal (%)"), (twist, "Twist from rest (degrees)"),
                       (force, "Force (N)")):  # fmt: skip
        axes.set(xlabel="Loss of height (mm)", ylabel=text)
    figure.legend(*strain.get_legend_handles_labels(), fontsize=7, frameon=False, ncols=2,
                  loc="outside upper center")  # fmt: skip
    path = Path(path)
    figure.savefig(path, dpi=200)
    return path
