"""Whether a ramp presses a part of the device to zero thickness.

As a part is pressed, its smallest principal stretch falls.  At 0 no material state exists.
Newton's method fails a little earlier, because the other stretches and their rounding errors grow
without bound.  How it fails depends on where the last steps lie, so the last accepted state
decides.  A part is being crushed if two things hold at some point: little of the thickness is left,
and it falls towards zero at the rate at which it has fallen before.  Before a limit point this is
different: no stretch falls to zero, and all change faster the nearer the limit point is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import ufl

from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import State
from dea_fenicsx.path.predictor import Predictor
from dea_fenicsx.path.stability import path_slope
from dea_fenicsx.support import compat

LARGEST_CRUSHED_STRETCH = 0.05
"""Largest principal stretch of a point that is about to be crushed."""

LEAST_RATE_OVER_MEAN = 0.25
"""Least rate of the stretch, over the mean rate of the ramp, of a point that is being crushed.

A part under a growing force gets thinner ever more slowly, and is never crushed.
"""

MOST_RATE_OVER_NEARBY = 1.1
"""Largest rate of the stretch over the mean rate since a nearby state.  Limit points have 1.2."""

MOST_RATE_OVER_FAR = 3.0
"""The same since a state that is more than `NEARBY_IN_STEPS` away."""

NEARBY_IN_STEPS = 8.0
"""Largest distance of a nearby state along the load, in units of the last trial's step."""

STEP_BACK = 1e-3
"""Step back along the tangent by which the rate is measured, in units of the last trial's step."""


@dataclass(frozen=True)
class Crush:
    """A point that is pressed to zero thickness.

    Attributes
    ----------
    region
        Name of its region.
    place
        Its undeformed position in m.
    stretch
        Its smallest principal stretch in the last accepted state.
    factor
        Factor of the leading ramp at which the stretch would be 0 at half its present rate.  The
        load at which it is 0 lies before it, even where the rate falls on the way.
    """

    region: str
    place: tuple[float, ...]
    stretch: float
    factor: float

    @property
    def words(self) -> str:
        """What happens, for a message."""
        place = ", ".join(f"{x:.3g}" for x in self.place)
        return (
            f"{self.region} is crushed to zero thickness at ({place}) m, where the smallest "
            f"stretch is {self.stretch:.2g} and runs to zero"
        )


def find_crush(predictor: Predictor, origin: State, failed: Mapping[str, float]) -> Crush | None:
    """The point that is pressed to zero thickness behind the last accepted state.  Collective.

    Parameters
    ----------
    predictor
        Holds the last accepted states.
    origin
        The state at the start of the ramp.
    failed
        Factors of the last trial.

    Returns
    -------
    Crush or None
        None if there is no such point.
    """
    problem, last, name = predictor.problem, predictor.known[-1], predictor.name
    comm, now = problem.comm, last.factors[name]
    step = failed[name] - now
    stretches = _Stretches(problem)
    here = stretches.of(last)
    lowest = float(np.min(comm.allgather(here.min(initial=np.inf))))
    if not lowest <= LARGEST_CRUSHED_STRETCH or step == 0 or now == origin.factors[name]:
        return None
    rates = {n: (failed[n] - factor) / step for n, factor in last.factors.items()}
    slope = path_slope(predictor.solver, last, rates)
    if slope is None:
        return None
    back = -STEP_BACK * step
    before = {n: factor + back * rates[n] for n, factor in last.factors.items()}
    state = problem.imposed(problem.under(problem.moved(last, back * slope), before))
    loss = (stretches.of(state) - here) / abs(back)
    mean = (stretches.of(origin) - here) / abs(now - origin.factors[name])
    found = (here <= LARGEST_CRUSHED_STRETCH) & (loss > 0) & (loss >= LEAST_RATE_OVER_MEAN * mean)
    for earlier in predictor.known[:-1]:
        way = abs(now - earlier.factors[name])
        most = MOST_RATE_OVER_NEARBY if way <= NEARBY_IN_STEPS * abs(step) else MOST_RATE_OVER_FAR
        found &= loss <= most * (stretches.of(earlier) - here) / way
    mine = None
    if found.any():
        k = int(np.flatnonzero(found)[np.argmin(here[found])])
        mine = (float(here[k]), *stretches.where(k), now + 2 * np.sign(step) * here[k] / loss[k])
    everyone = [one for one in comm.allgather(mine) if one is not None]
    if not everyone:
        return None
    stretch, place, region, factor = min(everyone)
    return Crush(region, place, stretch, float(factor))


class _Stretches:
    """The smallest principal stretch at each quadrature point of the owned cells of a problem."""

    def __init__(self, problem: Problem) -> None:
        self.problem, forms = problem, problem.forms
        self._points = len(forms.quadrature)
        owned = problem.scene.device.owned_cells()
        self._parts = []
        for kernel, point in zip(problem.kernels, problem.states, strict=True):
            entries = ufl.as_vector([point.F[i, j] for i in range(3) for j in range(3)])
            cells = kernel.cells[kernel.cells < owned]
            self._parts.append((cells, compat.expression(entries, forms.quadrature)))

    def of(self, state: State) -> np.ndarray:
        """In a state, all cells and points in one row.  Collective."""
        found = [np.empty(0)]
        with self.problem.at(state):
            for cells, evaluate in self._parts:
                if len(cells):
                    F = evaluate(self.problem.mesh, cells).reshape(-1, 3, 3)
                    found.append(np.linalg.svd(F, compute_uv=False)[:, -1])
        return np.concatenate(found)

    def where(self, number: int) -> tuple[tuple[float, ...], str]:
        """Undeformed position in m, and region, of a point of the row."""
        device = self.problem.scene.device
        cells = np.concatenate([cells for cells, _ in self._parts])
        cell, point = int(cells[number // self._points]), number % self._points
        place = self.problem.forms.prober.place_of(cell, point) * device.length
        names = (n for n in device.regions if cell in device.cells_of(n))
        return tuple(float(x) for x in place[: device.dim]), next(names)
