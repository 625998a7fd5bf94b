"""Derivatives at a step of a march that is gone over again, with the lengths of its steps held.

Some marches have a past whose changes are not carried along: branches that are solved for at each
point, charges that leak, friction, rubbers that soften, rigid parts, the energy-conserving scheme.
Such a march is gone over four times, with the variable a little larger and smaller, and lands on
the recorded times with one step from each to the next.  The differences are of fourth order, so
that what remains is the tolerance of Newton's method over the step of the variable.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from dea_fenicsx.gradients.changes import Recorded
from dea_fenicsx.gradients.differences import OBSERVABLE_STEP
from dea_fenicsx.gradients.motion_changes import driven
from dea_fenicsx.gradients.shapes import distortion, most
from dea_fenicsx.gradients.variables import LoadVariable, Shape, Told, Variable, larger
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import State
from dea_fenicsx.path.items import Item, March, Ramp
from dea_fenicsx.path.walk import Walk
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.options import NewtonOptions
from dea_fenicsx.support.errors import DeaError, InputError, SolverError

REPLAY_TOLERANCE = 1e-12
"""Newton's tolerance where a march is gone over again."""

SAME_STATE = 1e-6
"""Largest difference to a recorded state, relative to its largest value."""

KINK = 1e-2
"""Relative difference of the slopes over two steps of a variable that is no error of a formula."""

NOISE = 1e-7
"""Part of an observable that the tolerance of Newton's method may be wrong by."""

SHARES = (1, -1, 2, -2)
"""The places at which a march is gone over again, in steps of the variable."""


@dataclass(frozen=True)
class ScaledRamp(Ramp):
    """A ramp of which one load goes to another factor.

    Attributes
    ----------
    shares
        What the factor at the end is multiplied by, by ramp.
    """

    shares: Mapping[str, float] = field(default_factory=dict)

    def goals(self, scene: Scene) -> dict[str, float]:
        return {n: goal * self.shares.get(n, 1.0) for n, goal in super().goals(scene).items()}


class Taken(NamedTuple):
    """A recorded step: its item of the path, when that began, and the time at its end, in s."""

    item: Item
    began: float
    time: float


class Replay:
    """Goes over the steps of a run again, with a variable a little larger or smaller.

    Parameters
    ----------
    problem
        The problem of the run.
    recorded
        Gives the recorded step of a row.
    row
        The row to which it goes.

    Raises
    ------
    InputError
        If the run did not begin in the undeformed state, or the row is that of an event.
    """

    def __init__(
        self, problem: Problem, recorded: Callable[[int], Recorded], row: int
    ) -> None:
        self.problem = problem
        first, self.last = recorded(0), recorded(row).state
        if event := recorded(row).event:
            raise InputError(
                f"The step of the event {event!r} in a march has no derivative here; "
                "ask for the accepted step before or after it."
            )
        told = (recorded(k) for k in range(row + 1))  # one at a time, for they may lie on disk
        self.steps = [Taken(s.item, s.began, s.state.time) for s in told if not s.event]
        off = most(problem, first.state.values - problem.rest.values)
        if off > SAME_STATE or any(first.state.factors.values()):
            raise InputError(
                "A march that begins in a state of another run has no derivative here; compare "
                "two runs instead."
            )
        self._solver: NewtonSolver | None = None
        self._reached: dict[tuple[Told, int], State] = {}
        self.residual = self._checked()

    def _checked(self) -> float:
        """How far the recorded state is missed by the same march.  Collective."""
        with self.problem.at(self.problem.state):
            found = self._walked(None, 0.0)
        due = self.last
        size = most(self.problem, due.values)
        off = most(self.problem, found.values - due.values) / max(size, SAME_STATE)
        if off > SAME_STATE:
            raise SolverError(
                "The derivative was not found: a march that is gone over again in the recorded "
                f"steps ends in another state ({off:.1e} off)."
            )
        return off

    def slope(
        self, told: Told, one: Variable, measure: Callable[[], float],
        anew: Callable[[], float] | None,
    ) -> float:  # fmt: skip
        """The derivative of an observable by a variable.  Collective.

        Parameters
        ----------
        told, one
            The variable, as it was asked for and as it was found.
        measure
            The observable in the problem's present state.
        anew
            The same where nothing is kept of the mesh: for changes of shape.

        Raises
        ------
        SolverError
            If a march takes other steps, or the observable has a kink here.
        """
        step, problem = self._step(one), self.problem
        value = anew if anew and isinstance(one, Shape) else measure
        found = {}
        for share in SHARES:
            with problem.at(problem.state), self._changed(one, share * step):
                key = told, share
                if key not in self._reached:
                    self._reached[key] = self._walked(one, share * step)
                problem.show(self._reached[key])
                found[share] = float(value())
        near = (found[1] - found[-1]) / (2 * step)
        far = (found[2] - found[-2]) / (4 * step)
        noise = NOISE * abs(found[1]) / step
        if not abs(far - near) <= KINK * abs(near) + noise:
            raise SolverError(
                f"The derivative by {one.name!r} was not found: the march changes by a kink there, "
                "as where a point begins to slide; compare two runs instead."
            )
        return (4 * near - far) / 3

    def _step(self, one: Variable) -> float:
        """The step of a variable.  Collective."""
        if isinstance(one, LoadVariable):
            return OBSERVABLE_STEP * one.unit
        if isinstance(one, Shape):
            return OBSERVABLE_STEP / distortion(self.problem, one.velocity)
        return OBSERVABLE_STEP * (abs(one.value) or 1.0)

    @contextmanager
    def _changed(self, one: Variable, step: float) -> Iterator[None]:
        """Let a variable that is no load be larger by a step.  Collective."""
        constants = self.problem.parameters
        if one.name not in list(constants):
            with larger(self.problem, one, step):
                yield
            return
        kept = constants[one.name]
        try:
            self._put(one.name, kept + step)
            yield
        finally:
            self._put(one.name, kept)

    def _put(self, name: str, value: float) -> None:
        """Give a constant a value; the stiffness of contacts follows."""
        self.problem.parameters[name] = value
        for contact in self.problem.forms.contacts:
            contact.take(self.problem.parameters.materials)

    def _walked(self, one: Variable | None, step: float) -> State:
        """The state in which the march ends under a load that is larger by a step.  Collective."""
        problem, last = self.problem, self.last
        if self._solver is None:
            self._solver = NewtonSolver(problem, NewtonOptions(tolerance=REPLAY_TOLERANCE))
        self._solver.renew()
        problem.commit(problem.rest)
        path = [self._held(item, one, step) for item in self._items()]
        try:
            for count, taken in enumerate(Walk(self._solver, path).follow(), 1):
                if count == len(self.steps):
                    if abs(taken.state.time - last.time) > SAME_STATE * max(last.time, 1e-300):
                        break
                    return taken.state
        except DeaError as error:
            raise SolverError(
                f"The derivative was not found, since a march nearby fails: {error}"
            ) from error
        raise SolverError(
            "The derivative was not found: a march nearby takes other steps than the recorded one."
        )

    def _items(self) -> list[tuple[Item, float]]:
        """The items of the path up to the row, with the times in s at which they began."""
        found: list[tuple[Item, float]] = []
        for step in self.steps:
            if not found or found[-1][0] is not step.item or found[-1][1] != step.began:
                found.append((step.item, step.began))
        return found

    def _held(self, told: tuple[Item, float], one: Variable | None, step: float) -> Item:
        """An item that takes the recorded steps, under a load that is larger by a step."""
        item, began = told
        if isinstance(item, March):
            times = [s.time - began for s in self.steps if (s.item, s.began) == told]
            at = tuple(sorted({t for t in times if t > 0}))
            item = driven(replace(item, at=at, steps=1), one, step) if one else replace(
                item, at=at, steps=1
            )
        elif isinstance(item, Ramp) and isinstance(one, LoadVariable):
            held = {name: getattr(item, name) for name in Ramp.__dataclass_fields__}
            item = ScaledRamp(**held, shares={one.ramp: 1 + step / one.unit})
        return item
