"""Optimisation of a density by gradients: where a stiffener or an electrode is to lie."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from dea_fenicsx.design.density import Density, Layout
from dea_fenicsx.design.descent import Descent, Sample
from dea_fenicsx.design.improving import (
    PULL_IN,
    PULL_IN_MARGIN,
    Analysis,
    ImproveOptions,
    check_quantities,
    checked_options,
    listed,
)
from dea_fenicsx.design.kept_designs import KeptDesigns
from dea_fenicsx.design.variables import check_resumable, goals, limits
from dea_fenicsx.design.variations import Build
from dea_fenicsx.results.finished import Run
from dea_fenicsx.results.identity import described
from dea_fenicsx.run.session import solve
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.errors import DeaError, InputError, Interrupted, MachineError
from dea_fenicsx.support.type_checks import shown

FILLED = "filled"
"""The share of the regions that is filled, as a quantity."""


@dataclass(frozen=True)
class Distributed:
    """What a search for a density has found.

    Attributes
    ----------
    density, places
        The density in each place, and the positions of the places in m along its axes.
    quantities, before
        What was asked for, at this design and at the first one.
    evaluations, solved
        Designs that were solved, and those that this call has solved.
    converged, feasible
        Whether the last search has ended by itself, and whether its design keeps the constraints.
    message
        How the last search ended, in words.
    variables
        The variables that belong to the density.
    scene
        The scene with this density.
    """

    density: np.ndarray
    places: np.ndarray
    quantities: Mapping[str, float]
    before: Mapping[str, float]
    evaluations: int
    solved: int
    converged: bool
    feasible: bool
    message: str
    variables: np.ndarray
    scene: Scene

    @property
    def greyness(self) -> float:
        """4 times the mean of rho (1 - rho): 0 if each place is filled or empty."""
        return float(4 * np.mean(self.density * (1 - self.density)))


def distribute(
    build: Build,
    density: Density,
    objective: Mapping[str, str],
    analyses: Analysis | Sequence[Analysis],
    constraints: Mapping[str, Any] | None = None,
    out: str | os.PathLike | None = None,
    resume: bool = False,
    **options: Unpack[ImproveOptions],
) -> Distributed:
    """Find where on a film a stiffener or an electrode is to lie, by gradients.  Collective.

    Parameters
    ----------
    build
        Called as ``build(comm)``; returns the scene on the ranks of `comm`.
    density
        What is distributed, see `Density`.
    objective, analyses, constraints
        As of `improve`.  The quantity ``"filled"`` is the share of the regions that is filled.
    out, resume
        As of `improve`.
    options
        As of `improve`, and `most` counts the designs of each search.

    Returns
    -------
    Distributed
        The same on every rank.

    Raises
    ------
    InputError
        For wrong input, a quantity without a derivative, and if the start cannot be solved.
    """
    chosen = checked_options("distribute", options)
    comm, runs = chosen["comm"], listed(analyses)
    wanted, bounds = goals(objective), limits(constraints or {})
    check_quantities(runs, wanted, bounds, [FILLED])
    check_resumable(resume, out)
    scene = build(comm) if callable(build) else build
    if not isinstance(scene, Scene):
        raise InputError(f"build returned {shown(scene)}, but must return a Scene.")
    layout = Layout(density, scene)
    facts = {
        "analyses": [[described(item) for item in run.items] for run in runs],
        "quantities": [*wanted, *bounds], "density": repr(density),
    }  # fmt: skip
    x, told = layout.first(density.sharpness[0]), list[dict[str, Any]]()
    for number, one in enumerate(density.sharpness):
        if number:
            x = layout.resharpened(x, density.sharpness[number - 1], one)
        folder = None if out is None else Path(out) / f"sharpness_{one:g}"
        free = dict.fromkeys(layout.names, (0.0, 1.0))
        kept = KeptDesigns(folder, layout.names, facts, resume, comm)
        try:
            sampler = _Sampler(scene, layout, one, runs, [*wanted, *bounds])
            descent = Descent(sampler, kept, free, wanted, bounds, chosen)
            told.append(descent.run(dict(zip(layout.names, x.tolist(), strict=True))))
        finally:
            kept.close()
        x = np.array([told[-1]["design"][name] for name in layout.names])
    rho, last = layout.filled(x, density.sharpness[-1]), told[-1]
    return Distributed(
        rho, layout.places, last["quantities"], told[0]["before"],
        sum(one["evaluations"] for one in told), sum(one["solved"] for one in told),
        last["converged"], last["feasible"], last["message"], x, filled_scene(scene, layout, rho),
    )  # fmt: skip


def filled_scene(scene: Scene, layout: Layout, rho: np.ndarray) -> Scene:
    """A scene with a density."""
    return replace(scene, supports=[*scene.supports, *layout.supports(rho)])


class _Sampler:
    """Solves a density, and derives what is asked for by each variable."""

    def __init__(
        self, scene: Scene, layout: Layout, sharpness: float, runs: Sequence[Analysis],
        names: Sequence[str],
    ) -> None:  # fmt: skip
        self.scene, self.layout, self.sharpness = scene, layout, sharpness
        self.runs, self.names = runs, list(dict.fromkeys(names))

    def __call__(self, design: Mapping[str, float]) -> Sample:
        """The quantities of a design and their derivatives, or why there are none.  Collective."""
        layout, names, comm = self.layout, self.layout.names, self.scene.device.comm
        x = np.array([design[name] for name in names])
        rho = layout.filled(x, self.sharpness)
        values: dict[str, float] = {FILLED: float(layout.share @ rho)}
        by_x = layout.slopes(x, self.sharpness).T @ layout.share
        slopes = {FILLED: dict(zip(names, by_x.tolist(), strict=True))}
        told = filled_scene(self.scene, layout, rho)
        try:
            solved = [
                solve(told, one.items, one.record, **{"quiet": True, **one.solve})
                for one in self.runs
            ]
        except (Interrupted, MachineError):
            raise
        except DeaError as error:
            return Sample({}, {}, f"{type(error).__name__}: {error}")
        changes = layout.changes(x, self.sharpness)
        for one, run in zip(self.runs, solved, strict=True):
            for name in one.names:
                if name in self.names:
                    values[name], slopes[name] = _quantity(run, one, name, changes)
        return Sample(*comm.bcast((values, slopes), root=0))


def _quantity(
    run: Run, one: Analysis, name: str, changes: Sequence[Any]
) -> tuple[float, dict[str, float]]:
    """A quantity of a run, and its derivatives by the variables.  Collective."""
    found = run.sensitivity(PULL_IN if one.traced else name, changes)
    unit = 1.0
    if name == PULL_IN_MARGIN:
        unit = run.problem.scene.unit_volts.get(one.traced, 0.0) or 1.0
    return found.value / unit, {v: slope / unit for v, slope in found.derivatives.items()}
