"""Figure 5.2 for any number of storeys, the pattern as a picture, the fold closing in ParaView."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.origami.kresling import Kresling
from dea_fenicsx.origami.pattern import STYLES, CreasePattern
from dea_fenicsx.origami.solid import vertices
from dea_fenicsx.support.errors import InputError


def _figure(size: tuple[float, float]) -> Any:
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise InputError("Pictures need matplotlib; pip install matplotlib.") from error
    return Figure(figsize=size, layout="constrained")


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
    figure = _figure((7.2, 2.7))
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


def draw_pattern(pattern: CreasePattern, path: str | Path) -> Path:
    """The crease pattern as a picture, in the colours of its drawing."""
    figure = _figure((4.5, 0.6 + 4.5 * pattern.size[1] / pattern.size[0]))
    axes = figure.subplots()
    for name, lines in pattern.lines().items():
        colour, dashes = STYLES[name]
        style: Any = (0, [float(d) for d in dashes.split()]) if dashes else "-"
        for i, line in enumerate(lines):
            x, y = 1e3 * line.T
            if name == "stiffener":
                axes.fill(x, y, color="0.85")
            axes.plot(x, y, color=colour, ls=style, lw=1, label="" if i else name)
    axes.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
    figure.legend(fontsize=7, frameon=False, ncols=4, loc="outside upper center")
    path = Path(path)
    figure.savefig(path, dpi=200)
    return path


def write_folding(storey: Kresling, twists: Any, folder: str | Path) -> Path:
    """The panels at each twist as VTK files, to play in ParaView.

    Opens as ``folding.vtk.series``: time is the twist in degrees; each panel carries
    ``diagonal_strain``.

    Parameters
    ----------
    storey
        With free twist and right chords.
    twists
        phi at each frame in rad.
    folder
        Where the files go.

    Returns
    -------
    Path
        The file of the series.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    n, files = storey.sides, []
    panels = [(i, n + (i + 1) % n, n + i) for i in range(n)]
    panels += [(i, (i + 1) % n, n + (i + 1) % n) for i in range(n)]
    for frame, phi in enumerate(np.atleast_1d(np.asarray(twists, dtype=float))):
        strain = float(storey.at_twist(phi).strain)
        points = vertices(storey, phi).reshape(-1, 3)
        text = ["# vtk DataFile Version 3.0", "Kresling storey", "ASCII"]
        text += ["DATASET UNSTRUCTURED_GRID"]
        text += [f"POINTS {2 * n} double", *(" ".join(f"{x:.9g}" for x in p) for p in points)]
        text += [f"CELLS {2 * n} {8 * n}", *(f"3 {i} {j} {k}" for i, j, k in panels)]
        text += [f"CELL_TYPES {2 * n}", *["5"] * (2 * n)]  # 5: triangle
        text += [f"CELL_DATA {2 * n}", "SCALARS diagonal_strain double 1", "LOOKUP_TABLE default"]
        text += [f"{strain:.9g}"] * (2 * n)
        name = f"folding_{frame:03d}.vtk"
        (folder / name).write_text("\n".join(text) + "\n", "utf-8")
        files.append({"name": name, "time": float(np.degrees(phi))})
    series = folder / "folding.vtk.series"
    series.write_text(json.dumps({"file-series-version": "1.0", "files": files}, indent=1), "utf-8")
    return series
