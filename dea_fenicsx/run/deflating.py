"""Other equilibria at the load of a state, each with its stability.  Scripts call `deflate`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain

import numpy as np
from mpi4py import MPI

from dea_fenicsx.measure.observables import Observable
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import State
from dea_fenicsx.path.stability import CriticalEigenvalue
from dea_fenicsx.results.columns import column_of
from dea_fenicsx.results.finished import Run
from dea_fenicsx.run.modes import checked_problem
from dea_fenicsx.solvers.deflation import Deflation
from dea_fenicsx.solvers.eigenpairs import eigenpairs
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.support.agreement import bind_alike, check_same
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.validation import positive, whole

START_DISTANCES = (1.0, 4.0, 16.0, 64.0)
"""Distances of the starts from a known equilibrium, in units of `aside`."""

SMALLEST_DISTANCE = 1e-3
"""Two equilibria are one if their distance is smaller than this share of `aside`."""

DEFAULT_ASIDE = 0.01
"""The default of `aside`, over the device's largest extent."""


@dataclass(frozen=True)
class Equilibrium:
    """One equilibrium of a scene at a load.

    Attributes
    ----------
    state
        The state, with which ``solve(scene, ..., start=)`` begins.
    values
        What was recorded, by the name of its column, in SI units.
    negative_modes
        Negative eigenvalues of the tangent beyond those of a stable state; None if not known.
    distance
        Root mean square of the displacements from the given state, in m.
    """

    state: State
    values: Mapping[str, float]
    negative_modes: int | None
    distance: float

    @property
    def stable(self) -> bool | None:
        """Whether it is stable; None if not known."""
        return None if self.negative_modes is None else self.negative_modes == 0


def deflate(
    run: Run,
    record: Mapping[str, Observable] | None = None,
    most: int = 4,
    aside: float | None = None,
    modes: int = 2,
    step: int = -1,
    starts: Sequence[State] = (),
) -> list[Equilibrium]:
    """Other equilibria at the load of one state of a run, by deflation.  Collective.

    Newton's method starts in the states that are given, and then beside each equilibrium that is
    known, along its softest modes to both sides.  It is kept away from all that are known; see
    `solvers.deflation`.  States that no such start leads to are not found, so that the list need
    not be complete.  Those of a coarse mesh may be states of this mesh alone.

    Parameters
    ----------
    run
        The run, whose problem has no history (no viscous branches, friction, leakage).
    record
        Observables by name, as of `solve`.
    most
        Most equilibria that are looked for beside the given one.
    aside
        Distance of the nearest starts in m: root mean square of the displacements.  Others lie up
        to 64 times as far.  None takes a hundredth of the device's largest extent.
    modes
        Number of softest modes along which the starts lie.
    step
        The row of the history with the given state; the last one by default.
    starts
        States of the same scene at any load, such as `Branch.state` or ``Equilibrium.state`` give.
        They are brought to the load of the given one.

    Returns
    -------
    list of Equilibrium
        The given one first, then the others by their distance from it.

    Raises
    ------
    InputError
        If a number is of no use, the state is not in memory, the problem has history, or its
        tangent is not symmetric.
    SolverError
        If the tangent at a state cannot be factorised.
    """
    problem = checked_problem(run, "deflate")
    whole(most, "The number most= of equilibria", 1)
    whole(modes, "The number modes= of starts", 1)
    length = problem.scales.length
    if aside is None:
        aside = DEFAULT_ASIDE * length
    positive(aside, "The distance aside= of deflate", "a length > 0 in m")
    if isinstance(step, bool) or not isinstance(step, int | np.integer):
        raise InputError(f"step={shown(step)} of deflate must be a row of the history, as -1.")
    check_same(problem.comm, {"most": most, "aside": aside, "modes": modes, "step": step})
    if problem.histories or not problem.forms.is_symmetric:
        raise InputError(
            "deflate needs a scene without history and with a symmetric tangent: no viscous "
            "branches, friction, leakage or follower pressure."
        )
    record = record or {}
    measures = {column_of(n, o): bind_alike(problem, n, o) for n, o in record.items()}
    first = run._states.of(int(step), len(run.history))
    finder = Deflation(NewtonSolver(problem), SMALLEST_DISTANCE * aside / length)
    finder.known.append(first)
    _check_starts(problem, starts)
    for search in chain(_from_given(finder, starts), _from_known(finder, modes, aside / length)):
        if len(finder.known) > most:
            break
        found = search()
        if found is not None:
            finder.known.append(found)
    return _described(finder, measures)


def _check_starts(problem: Problem, starts: Sequence[State]) -> None:
    """Raise InputError unless all starts are states of a problem.  Collective."""
    if not isinstance(starts, Sequence) or isinstance(starts, str):
        raise InputError(f"The starts of deflate are {shown(starts)}; it needs a list of states.")
    for start in starts:
        fits = isinstance(start, State) and len(start.values) == problem.size
        if not problem.comm.allreduce(fits, op=MPI.LAND):
            raise InputError(
                f"A start of deflate is {shown(start)}, but must be a state of the run's scene on "
                "the same ranks."
            )


Search = Callable[[], State | None]
"""Finds an equilibrium that is not known yet, or none."""


def _from_given(finder: Deflation, starts: Sequence[State]) -> Iterator[Search]:
    """Newton's method from each start that is given to the load of the first state."""
    load = dict(finder.known[0].factors)
    for start in starts:
        yield partial(finder.carried, start, load)


def _from_known(finder: Deflation, modes: int, aside: float) -> Iterator[Search]:
    """Searches beside each state that is known by the time that it is reached."""
    spectrum = CriticalEigenvalue(finder.solver)
    motion = finder.problem.roles.free(Role.MOTION)
    reached = 0
    while reached < len(finder.known):
        state = finder.known[reached]
        reached += 1
        with finder.problem.at(state):
            pairs = eigenpairs(finder.solver, modes)
        ways = []
        for pair in pairs:
            # of two signs, that which is first must be the same on any number of ranks
            like = spectrum.as_values(pair.vector)[finder.problem.free[motion]]
            same = finder.mean(like, pair.vector[motion]) >= 0
            ways += [pair.vector if same else -pair.vector]
        for size in START_DISTANCES:
            away = size * aside
            for way in ways:
                for side in (1.0, -1.0):
                    yield partial(finder.search, finder.moved(state, way, side * away), away)


def _described(
    finder: Deflation, measures: Mapping[str, Callable[[], float]]
) -> list[Equilibrium]:
    """The states that are known, with what is measured on them."""
    problem, first = finder.problem, finder.known[0]
    spectrum = CriticalEigenvalue(finder.solver)
    unit, found = problem.scales.length, []
    for state in finder.known:
        count = spectrum.count(state)
        with problem.at(state):
            values = {column: float(measure()) for column, measure in measures.items()}
        away = finder.distance(state, first) * unit
        found.append(Equilibrium(state, values, count, away))
    return sorted(found, key=lambda one: one.distance)
