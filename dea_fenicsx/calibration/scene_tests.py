"""A test of a device that finite elements predict, with the derivatives of the run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.calibration.constants import constants_of
from dea_fenicsx.calibration.experiments import Column, Experiment, columns_of
from dea_fenicsx.calibration.parameters import Trial
from dea_fenicsx.path.items import Item
from dea_fenicsx.results.columns import column_of
from dea_fenicsx.results.finished import Run
from dea_fenicsx.run.session import solve
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import known

AT = 1e-6
"""Distance within which a step of the run lies at a measured place, over the largest place."""

DERIVED = ("elastic.", "electric.eps_r", "bulk_modulus")
"""Beginnings of the names of constants by which a static run has derivatives."""


@dataclass(frozen=True, eq=False)
class SceneTest(Experiment):
    """A test of a device by finite elements: stroke, blocked force, capacitance, over any load.

    Parameters
    ----------
    name
        For reports.
    build
        Called as ``build(comm, trial)``; returns the scene on the ranks of `comm`.
    path
        The path, whose steps land on the measured places, such as
        ``Ramp("voltage", at=volts / volts[-1])``.
    record
        Observables by name, as in `solve`.
    x
        The measured places, shape (n,), in the unit of the history's column `x_name`.
    measured
        Values by the names of the observables' columns (``"tip_m"`` of ``"tip"``), each of shape
        (n,).
    x_name
        Column of the history in which the places stand.
    error, weight
        As in `FunctionTest`.
    variables
        For a parameter of your own the name in `Run.sensitivity`, as in
        ``{"thickness": "thickness:film"}``.  Constants of the material need none.
    exact_slopes
        Whether derivatives are taken from `Run.sensitivity`.  Say False if `build` takes a constant
        for more than its material.
    comm
        The ranks; all of them by default.
    step
        Step of what has no derivative, in differences.
    """

    name: str
    build: Callable[[Any, Trial], Scene]
    path: Item | Sequence[Item]
    record: Mapping[str, Any]
    x: Any
    measured: Mapping[str, Any]
    x_name: str = "voltage_V"
    error: Any = None
    weight: float = 1.0
    variables: Mapping[str, str] = field(default_factory=dict)
    exact_slopes: bool = True
    comm: Any = None
    step: float = 1e-3
    _last: dict[str, Any] = field(default_factory=dict, repr=False)

    def columns(self) -> list[Column]:
        for column in self.measured:
            known(column, self._observables, "recorded column", f"the test {self.name!r}")
        return columns_of(self.name, self.x, self.measured, self.error, self.weight)

    @property
    def _observables(self) -> dict[str, str]:
        """The name of the observable of each column."""
        return {column_of(name, one): name for name, one in self.record.items()}

    def _solved(self, trial: Trial) -> tuple[Run, Scene, list[int]]:
        """The run of a trial, its scene, and its rows at the measured places.  Collective."""
        values = dict(trial)
        if self._last.get("values") == values:
            trial.read |= self._last["read"]
            run, scene, rows = self._last["run"]
            return run, scene, rows
        self._last.clear()  # a run that nobody can see lets its problem be used again
        scene = self.build(self.comm or MPI.COMM_WORLD, trial)
        run = solve(scene, self.path, self.record, quiet=True)
        places, x = run.column(self.x_name), np.asarray(self.x, dtype=float).ravel()
        rows = [int(np.argmin(np.abs(places - one))) for one in x]
        far = np.abs(places[rows] - x) > AT * np.abs(x).max()
        if far.any():
            raise InputError(
                f"No step of the test {self.name!r} lies at {self.x_name} = {x[far][0]:g}; let its "
                "path land there, as in Ramp('voltage', at=...)."
            )
        self._last.update(values=values, run=(run, scene, rows), read=set(trial.read))
        return run, scene, rows

    def predict(self, trial: Trial) -> Mapping[str, Any]:
        run, _, rows = self._solved(trial)
        return {column: run.column(column)[rows] for column in self.measured}

    def slopes(self, trial: Trial) -> Mapping[str, Mapping[str, Any]]:
        if not self.exact_slopes:
            return {}
        run, scene, rows = self._solved(trial)
        names = self._variables(scene, trial)
        wanted = list(dict.fromkeys(v for some in names.values() for v in some))
        if not wanted:
            return {}
        found: dict[str, dict[str, Any]] = {name: {} for name in names}
        for column in self.measured:
            own = [run.sensitivity(self._observables[column], wanted, step=row) for row in rows]
            for name, some in names.items():
                found[name][column] = np.array([sum(g[v] for v in some) for g in own])
        return found

    def _variables(self, scene: Scene, trial: Trial) -> dict[str, list[str]]:
        """For each parameter the variables whose derivatives add up to its own."""
        found = {name: [one] for name, one in self.variables.items() if name in trial}
        made = trial.template
        if made is None:
            return found
        several = made if isinstance(made, Mapping) else {"": made}
        present = trial.material if isinstance(made, Mapping) else {"": trial.material}
        for key in several:
            dot = f"{key}." if key else ""
            regions = [r for r, one in scene.materials.items() if one == present[key]]
            for constant in constants_of(several[key]):
                if f"{dot}{constant}" in trial and constant.startswith(DERIVED) and regions:
                    found[f"{dot}{constant}"] = [f"{region}.{constant}" for region in regions]
        return found
