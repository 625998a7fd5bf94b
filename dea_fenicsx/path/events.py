"""Events between two accepted steps: bifurcations, and margins that turn negative.

Each event is located by equilibria in between, so its load does not depend on the step size.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.model.state import State
from dea_fenicsx.path.roots import root
from dea_fenicsx.path.stability import CriticalEigenvalue, Place
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.outcome import Attempt
from dea_fenicsx.support.errors import SolverError

MOST_CHANGES_LOCATED = 3
"""Largest number of changes of the inertia that are located in one step, beside its limit point.

A slack film has dozens of them in one step.
"""

COINCIDENT = 1e-5
"""Share of a step within which several modes become neutral at one bifurcation.

Symmetry makes them do so at once, but for the errors of the search and of rounding.
"""


@dataclass(frozen=True)
class Alarm:
    """A mode of failure, with a margin that turns negative when it occurs.

    Attributes
    ----------
    name
        What the event is called, such as ``"loss of tension"``.
    margin
        Returns a dimensionless number, positive before the failure.  Called on all ranks.
    """

    name: str
    margin: Callable[[], float]


@dataclass(frozen=True)
class Passed:
    """An event between two accepted states.

    Attributes
    ----------
    name
        ``"bifurcation"`` or an alarm's name.
    share
        Its place on the way, 0 to 1.
    attempt
        How the equilibrium there was found.
    mode
        The null vector of a bifurcation, laid out like the state.
    changes
        How many eigenvalues pass zero there, of those that were located.
    """

    name: str
    share: float
    attempt: Attempt
    mode: np.ndarray | None = None
    changes: int = 1

    @property
    def state(self) -> State:
        """The equilibrium there."""
        return self.attempt.found


class Sentinel:
    """Watches a path for events.

    Parameters
    ----------
    solver
        The nonlinear solver with its problem.
    alarms
        Margins to watch.
    stability
        Whether to count negative eigenvalues at every accepted step, and to locate each change.
    fired
        Alarms that have already occurred in an earlier part of the run; each is reported once.
    counting
        Whether to count negative eigenvalues at every accepted step without locating changes; with
        `stability` they are counted in any case.

    Attributes
    ----------
    excess
        Negative eigenvalues of the last accepted state beyond those of a stable one, or None.
    """

    def __init__(
        self,
        solver: NewtonSolver,
        alarms: Iterable[Alarm] = (),
        stability: bool = False,
        fired: Iterable[str] = (),
        counting: bool = False,
    ) -> None:
        self.solver, self.problem = solver, solver.problem
        self.alarms = list(alarms)
        self.stability = stability
        self.counting = stability or counting
        self.fired = set(fired)
        self.excess: int | None = None
        self._margins: dict[str, float] = {}
        self._spectrum = CriticalEigenvalue(solver)

    def start(self) -> None:
        """Take the problem's present state as the one before the next step."""
        state = self.problem.state
        self._margins = self._measured(state)
        if self.counting:
            self.excess = self._spectrum.count(state)

    def _armed(self) -> list[Alarm]:
        return [a for a in self.alarms if a.name not in self.fired]

    def _measured(self, state: State) -> dict[str, float]:
        """Margins of the alarms that have not been given, at a state."""
        with self.problem.at(state):
            return {a.name: a.margin() for a in self._armed()}

    def count(self, state: State) -> int | None:
        """Negative eigenvalues of a state beyond those of a stable one, or None."""
        return self._spectrum.count(state) if self.counting else None

    def mode_of(self, vector: np.ndarray) -> np.ndarray:
        """A direction in the free unknowns laid out like a state."""
        return self._spectrum.as_values(vector)

    def passed(
        self,
        here: State,
        place: Place,
        rates: Mapping[str, float],
        count: int | None = None,
        limits: int = 0,
    ) -> list[Passed]:
        """The events between the state before and this one, in the order of travel.

        This state is then the state before of the next call.

        Parameters
        ----------
        here
            The state that the path has come to.
        place
            Finds an equilibrium at a share of the way.
        rates
            Change of each ramp's factor along the way.
        count
            Inertia of this state.
        limits
            Limit points on the way, which change the inertia by one each.
        """
        before, self.excess = self.excess, count
        found: list[Passed] = []
        margins = self._measured(here)
        for alarm in self._armed():
            if margins[alarm.name] < 0:
                event = self._cross(alarm, place, self._margins[alarm.name], margins[alarm.name])
                found += [event] if event else []
                self.fired.add(alarm.name)
        self._margins = margins
        changed = before is not None and count is not None and abs(count - before) > limits
        if self.stability and changed:
            assert before is not None and count is not None
            found += self.bifurcations(place, before, count, rates, limits)
        if any(e.mode is not None for e in found):
            self.solver.forget_factor()  # The factor belongs to a singular tangent.
        return sorted(found, key=lambda e: e.share)

    def _cross(self, alarm: Alarm, place: Place, low: float, high: float) -> Passed | None:
        """Where an alarm's margin passes zero."""
        attempts: list[Attempt] = []

        def margin(share: float) -> float:
            attempt = place(share)
            if not attempt.converged:
                raise SolverError(attempt.outcome.value)
            attempts.append(attempt)
            with self.problem.at(attempt.found):
                return alarm.margin()

        try:
            # The margins at both ends are known; only states in between are solved for.
            share = 0.0 if low <= 0 else root(
                lambda s: low if s == 0 else high if s == 1 else margin(s), 0.0, 1.0, xtol=1e-10,
                rtol=1e-10,
            )  # fmt: skip
            margin(share)
        except SolverError:
            return None
        return Passed(alarm.name, share, attempts[-1])

    def bifurcations(
        self, place: Place, before: int, after: int, rates: Mapping[str, float], limits: int = 0
    ) -> list[Passed]:
        """The first bifurcations on the way, located by changes of the inertia.

        Where several modes become neutral at once, there is one bifurcation, with the first mode.
        Limit points also change the inertia; they are left out.

        Parameters
        ----------
        place
            Finds an equilibrium at a share of the way.
        before, after
            Negative eigenvalues at its two ends.
        rates
            Change of each ramp's factor along the way.
        limits
            As of `passed`.
        """
        found: list[Passed] = []
        low = 0.0
        for _ in range(min(abs(after - before), MOST_CHANGES_LOCATED + limits)):
            critical = self._spectrum.locate(place, before, rates, low)
            if critical is None:
                break
            changes = abs(critical.after - before)
            if found and critical.share - found[-1].share < COINCIDENT:
                found[-1] = replace(found[-1], changes=found[-1].changes + changes)
            elif critical.is_bifurcation:
                share, attempt, mode = critical.share, critical.attempt, critical.mode
                found.append(Passed("bifurcation", share, attempt, mode, changes))
            before, low = critical.after, min(1.0, critical.share + 10 * critical.width + 1e-7)
            if before == after or low >= 1.0:
                break
        return found
