"""The choice of mesh and degree with which an observable is as exact as it was asked to be.

From the estimate by cells and directions follows what is made finer: first the degree, as long as
that takes the error down quickly; then those sheets of cells that hold most of the error are
halved, so that the mesh becomes graded towards corners and edges of electrodes.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.geometry.base import Geometry
from dea_fenicsx.geometry.bisected import Bisected, sheets
from dea_fenicsx.gradients.discretisation import DiscretisationError, ErrorEstimates
from dea_fenicsx.mesh.sheets import over_sheets
from dea_fenicsx.results.columns import column_of
from dea_fenicsx.results.finished import Run
from dea_fenicsx.scene.elements import Discretisation
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.errors import EquilibriumLost, SolverError

HIGHEST_DEGREE = 3
"""Degree up to which mesh families go.  Beyond, singular corners need smaller cells instead."""

QUICK = 8.0
"""Factor by which one degree more must reduce the error for the next one to be tried."""

SHARE = 0.9
"""Share of the error that those sheets hold together which are halved."""

DOUBT = 0.5
"""Share of the parts of sheets, without their signs, that an error has at least.

Where parts of both signs nearly cancel, what the richer elements do not see need not cancel.
"""

SHARE_OF_ASKED = 0.6
"""Share of the asked error at which the search ends: estimates on coarse meshes can be as wrong."""

UNCONFIRMED = 3.0
"""Factor on the error of the first discretisation, whose estimate no other one has confirmed."""

CONFIRMING = 3
"""Number of discretisations whose predictions of the exact value are compared.

At singular corners one degree more may see a seventh of the error alone.  Then the predictions
drift from mesh to mesh, and by about as much they are still wrong.
"""

MOST_CHOICES = 14
"""Number of discretisations that are tried."""

MOST_UNKNOWNS_CHOSEN = 400_000
"""Unknowns beyond which nothing is made finer."""


@dataclass(frozen=True)
class Level:
    """One discretisation that was tried, and what came of it.

    Attributes
    ----------
    degree, cells, unknowns : of the discretisation
    value : the observable, in SI units
    estimate : estimated exact value minus `value`
    error : the estimated error relative to the value
    largest : the same with doubts where its parts cancel, and where the discretisations before
        predict another exact value; what is compared with the asked one
    wall_s : wall time of solution and estimate
    """

    degree: int
    cells: int
    unknowns: int
    value: float
    estimate: float
    error: float
    largest: float
    wall_s: float

    def told(self) -> dict[str, Any]:
        """The same for the summary; relative errors of a value of 0 are None."""
        known = {} if self.value else {"error": None, "largest": None}
        return vars(self) | known


class AccuracySearch:
    """The search for a discretisation.

    Parameters
    ----------
    name, observable
        What is to be exact.
    asked
        The largest relative error.
    solved
        Solves a scene along the path, and keeps nothing on disk.
    say
        Tells a line.
    """

    def __init__(
        self, name: str, observable: Any, asked: float, solved: Callable[[Scene], Run],
        say: Callable[[str], object],
    ) -> None:  # fmt: skip
        self.name, self.observable, self.asked = name, observable, asked
        self.solved, self.say = solved, say
        self.levels: list[Level] = []
        self.best: Level | None = None
        self.found: DiscretisationError | None = None
        self.lost = False
        self._quick, self._end = True, "it cannot be made finer"
        self._parts: np.ndarray | None = None
        self._chosen: Scene | None = None

    @property
    def reached(self) -> bool:
        """Whether the best level is as exact as asked, and no finer one says otherwise."""
        return self.best is not None and self.best.largest <= self.asked and not self.lost

    @property
    def wants_sizes(self) -> bool:
        """Whether a mesh of other cells is needed, and it is known which ones."""
        known = self.found is not None and self.found.cells is not None
        return not self.reached and known and self._parts is None

    def find(self, scene: Scene) -> Scene:
        """The scene with the discretisation that is chosen: that of the best level.  Collective."""
        self._keep(scene, self._try(scene))
        while (finer := self._next(scene)) is not None:
            try:
                found = self._try(finer)
            except SolverError as error:  # cells may have become too thin for Newton's tolerance
                self.say(f"Nothing finer could be solved: {error}")
                self._end = "the next finer discretisation could not be solved"
                break
            except EquilibriumLost as error:
                self.lost = True
                self.say(f"Finer elements lose equilibrium: {error}")
                break
            scene = finer
            self._keep(scene, found)
        assert self._chosen is not None
        return self._chosen

    def _keep(self, scene: Scene, found: DiscretisationError) -> None:
        """Keep the level that was tried last, unless one before it was more exact."""
        last = self.levels[-1]
        if self.best is None or last.largest <= self.best.largest:
            self.best, self.found, self._chosen = last, found, scene

    def _next(self, scene: Scene) -> Scene | None:
        """The scene that is to be tried after this one, or None if the search ends."""
        last = self.levels[-1]
        if last.largest <= SHARE_OF_ASKED * self.asked or not last.value:
            return None
        if len(self.levels) >= MOST_CHOICES:
            self._end = f"the search ends with discretisation number {MOST_CHOICES}"
            return None
        if last.unknowns > MOST_UNKNOWNS_CHOSEN:
            self._end = f"the search ends beyond {MOST_UNKNOWNS_CHOSEN} unknowns"
            return None
        return self._finer(scene)

    def _try(self, scene: Scene) -> DiscretisationError:
        """Solve a scene, and estimate its error.  Collective."""
        begun = time.perf_counter()
        run = self.solved(scene)
        problem = run.problem
        of = {self.name: self.observable}
        found = ErrorEstimates(problem).of(problem.state, of, by_cells=True)[self.name]
        comm, mesh = problem.comm, problem.mesh
        cells = mesh.topology.index_map(mesh.topology.dim).size_global
        wall = comm.allreduce(time.perf_counter() - begun, op=MPI.MAX)
        degree = scene.elements.degree
        level = Level(
            degree, cells, found.unknowns, found.value, found.estimate,
            found.relative, self._drifting(self._largest(scene, found), found), wall,
        )  # fmt: skip
        self.levels.append(level)
        self.say(
            f"Degree {degree}, {cells} cells: {column_of(self.name, self.observable)} = "
            f"{found.value:.7g}, estimated error {level.largest:.1e} of it, {wall:.2g} s."
        )
        return found

    def _largest(self, scene: Scene, found: DiscretisationError) -> float:
        """The estimated relative error, with a doubt where its parts cancel.  Collective."""
        device, self._parts = scene.device, None
        if device.family is None or found.cells is None or not found.value:
            return found.relative
        mesh = _graded(device.family).mesh()
        self._parts = np.abs(over_sheets(device, mesh, found.cells))
        return max(found.relative, DOUBT * float(self._parts.sum()) / abs(found.value))

    def _drifting(self, largest: float, found: DiscretisationError) -> float:
        """The estimated relative error, with a doubt where predictions of the value differ."""
        before, share = self.levels[1 - CONFIRMING :], 1.0
        if not before or not found.value:
            return UNCONFIRMED * largest
        last = before[-1]
        if last.degree < found.degree:
            fallen = abs(found.estimate) < abs(last.estimate) / QUICK
            # the drift is the error of the last prediction, and this one is as much better
            share = abs(found.estimate / last.estimate) if fallen else 1.0
        elif self._quick:
            before = [one for one in before if one.degree == found.degree]
        exact = [one.value + one.estimate for one in before]
        exact.append(found.value + found.estimate)
        return largest + share * (max(exact) - min(exact)) / abs(found.value)

    def _finer(self, scene: Scene) -> Scene | None:
        """The scene with a finer discretisation, or None if there is none."""
        degree, graded = scene.elements.degree, self._parts is not None
        if len(self.levels) > 1 and self.levels[-2].degree < degree:
            before, now = (abs(level.estimate) for level in self.levels[-2:])
            self._quick = before > QUICK * now
        highest = HIGHEST_DEGREE if graded else Discretisation.DEGREES[-1]
        if degree < highest and (self._quick or not graded):
            return replace(scene, elements=of_degree(scene.elements, degree + 1))
        return self._halved(scene) if scene.device.family is not None else None

    def _halved(self, scene: Scene) -> Scene:
        """The scene on a mesh with those sheets halved that hold most of the error.

        All are halved if it is not known where the error is.
        """
        device, family = scene.device, scene.device.family
        assert device.rebuilt is not None and family is not None
        graded = _graded(family)
        if self._parts is None:
            chosen = np.unique(sheets(graded.mesh()))
        else:
            order = np.argsort(-self._parts, kind="stable")
            held = np.cumsum(self._parts[order])
            count = min(int(np.searchsorted(held, SHARE * held[-1])) + 1, len(order))
            chosen = np.sort(order[:count])
        finer = device.rebuilt(graded.halved(chosen))
        return replace(scene, device=replace(finer, source=device.source))

    def told(self) -> dict[str, Any]:
        """What the summary says of the search."""
        last = self.best
        assert last is not None
        return {
            "observable": column_of(self.name, self.observable), "asked": self.asked,
            "reached": self.reached, "lost": self.lost, "error": last.error if last.value else None,
            "largest": last.largest if last.value else None,
            "degree": last.degree, "cells": last.cells, "unknowns": last.unknowns,
            "levels": [level.told() for level in self.levels],
        }  # fmt: skip

    def sentence(self) -> str:
        """How exact the observable is, in a sentence."""
        last, column = self.best, column_of(self.name, self.observable)
        assert last is not None
        if self.reached:
            return (
                f"{column} is exact to {last.largest:.1e} of its value by estimate, as asked "
                f"({self.asked:g})."
            )
        if self.lost:
            return (
                f"{column} is exact to {last.largest:.1e} of its value by estimate, but with finer "
                "elements equilibrium is lost before the end of the path, so that it is not known "
                f"whether it is exact to {self.asked:g}."
            )
        return (
            f"{column} is exact to {last.largest:.1e} of its value by estimate, "
            f"{last.largest / self.asked:.3g} times the {self.asked:g} that was asked for; "
            f"{self._hint(last)}."
        )

    def _hint(self, last: Level) -> str:
        if not last.value:
            return "its value is 0, so that no relative error is known"
        if self.wants_sizes:
            return "sizes.pos in its folder has the sizes of cells to mesh it with"
        return self._end


def of_degree(elements: Discretisation, degree: int) -> Discretisation:
    """The elements with another degree of all fields."""
    more = degree - elements.degree
    return replace(
        elements, degree=degree, potential_degree=elements.potential_degree + more,
        quadrature_degree=elements.quadrature_degree + 2 * more,
    )  # fmt: skip


def _graded(family: Geometry) -> Bisected:
    """A family as one whose sheets have been halved, perhaps none of them."""
    return family if isinstance(family, Bisected) else Bisected(family)
