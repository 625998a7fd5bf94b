"""The path: ramps followed in adaptive steps, with exact landings, retries and a clear end."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from mpi4py import MPI

from dea_fenicsx.errors import EquilibriumLost, InputError, SolverError
from dea_fenicsx.scene import Scene, finite, known
from dea_fenicsx.solver import Attempt, NewtonSolver
from dea_fenicsx.tracing import Trace, trace


@dataclass(frozen=True)
class Ramp:
    """Bring one or more ramps of the scene to a factor, in steps.

    Parameters
    ----------
    what
        Name or names of the ramps (``"voltage"``, ``"stretch"``, ``"load"`` or your own); empty
        for all of the scene.  Ramps that are not named keep their present factor.
    to
        Factor at the end; 1 is the value written in the scene.
    steps
        Number of equal steps; each of their ends is landed on exactly.
    at
        Factors to land on instead, in the order of travel; between them steps grow and shrink
        freely, starting from a `steps`-th of the ramp.
    """

    what: str | tuple[str, ...] = ()
    to: float = 1.0
    steps: int = 10
    at: tuple[float, ...] | None = None

    def names(self, scene: Scene) -> tuple[str, ...]:
        """Names of the scene's ramps that this one moves."""
        if not self.what:
            return scene.ramps
        return (self.what,) if isinstance(self.what, str) else tuple(self.what)

    def label(self, scene: Scene) -> str:
        return "+".join(self.names(scene))


@dataclass(frozen=True)
class Cursor:
    """Where on the path a run stands; enough, with the state, to carry on.

    Attributes
    ----------
    step : number of the accepted step
    ramp : number of the ramp in the path
    position : travelled share of that ramp, 0 to 1
    size : size of the next step, as a share of the ramp
    factors : factor of each of the scene's ramps
    start : factors at the start of the current ramp
    direction : in a trace, sign of the load's change
    """

    step: int = 0
    ramp: int = 0
    position: float = 0.0
    size: float = 0.0
    factors: dict[str, float] = field(default_factory=dict)
    start: dict[str, float] = field(default_factory=dict)
    direction: float = 0.0


@dataclass(frozen=True)
class Step:
    """An accepted step; the problem holds its state while it is yielded.

    `event` is ``"maximum"`` or ``"minimum"`` where the load is stationary along a trace, and empty
    elsewhere.
    """

    cursor: Cursor
    label: str
    attempt: Attempt
    retries: int
    last: bool
    event: str = ""


SMALLEST = 2.0**-10
"""Smallest step in units of the first one, before equilibrium counts as lost."""

EASY = 5
"""Newton iterations up to which a step counts as easy and the next one may grow."""

FASTER = 4.0
"""How much faster than in the step before the state may move with the load."""

WANDERING = 8
"""Newton iterations of a ramp's first step after which its result is not trusted."""


def check_path(scene: Scene, path: Sequence[Ramp | Trace]) -> None:
    """Raise InputError if the path does not fit the scene."""
    if not path:
        raise InputError("The path is empty; give at least one Ramp(...).")
    if not scene.ramps:
        raise InputError(
            "Nothing in the scene can be ramped; give an Electrode a voltage, or add a Stretch or "
            "a load."
        )
    for ramp in path:
        for name in ramp.names(scene):
            known(name, scene.ramps, "ramp in the scene")
        if isinstance(ramp, Trace):
            finite(ramp.first, f"The first step of the trace in {ramp.what}")
            if ramp.first == 0 or ramp.steps < 1 or not ramp.longest > 0:
                raise InputError(
                    f"The trace in {ramp.what} needs a first step other than 0, at least one step "
                    "and a longest step > 0."
                )
            continue
        if not isinstance(ramp.steps, int | np.integer) or ramp.steps < 1:
            raise InputError(
                f"The ramp of {ramp.label(scene)} has {ramp.steps!r} steps, but needs a whole "
                "number of at least 1."
            )
        for value in (ramp.to, *(ramp.at or ())):
            finite(value, f"A target of the ramp of {ramp.label(scene)}")


def follow(
    solver: NewtonSolver,
    path: Sequence[Ramp | Trace],
    resume: Cursor | None = None,
    log: Callable[[str], None] = lambda line: None,
    enough: Callable[[], bool] = lambda: False,
) -> Iterator[Step]:
    """Follow a path and yield each accepted step, the undeformed state first.

    Parameters
    ----------
    solver
        The nonlinear solver with its problem.
    path
        Ramps, one after another.
    resume
        Where to carry on; the problem must hold the state that belongs to it.
    log
        Called with a line of text for every retry.
    enough
        Asked after each step of a trace; True ends the trace.

    Raises
    ------
    EquilibriumLost
        If no equilibrium is found beyond a load.  The problem then holds the last accepted state.
    SolverError
        If the linear solver fails however small the step.
    """
    problem = solver.problem
    scene = problem.scene
    check_path(scene, path)
    if resume is None:
        zero = dict.fromkeys(scene.ramps, 0.0)
        cursor = Cursor(factors=zero, start=zero)
        problem.set_factors(zero)
        yield Step(cursor, path[0].label(scene), Attempt("", 0, 0.0, problem.probe()), 0, False)
    else:
        cursor = resume
        problem.set_factors(cursor.factors)
    while cursor.ramp < len(path):
        item = path[cursor.ramp]
        steps = (
            _follow_trace(solver, path, item, cursor, log, enough)
            if isinstance(item, Trace)
            else _follow_ramp(solver, path, item, cursor, log)
        )
        for step in steps:
            cursor = step.cursor
            yield step
        cursor = replace(
            cursor, ramp=cursor.ramp + 1, position=0.0, size=0.0, start=dict(cursor.factors),
            direction=0.0,
        )  # fmt: skip


def _follow_trace(
    solver: NewtonSolver,
    path: Sequence[Ramp | Trace],
    item: Trace,
    cursor: Cursor,
    log: Callable[[str], None],
    enough: Callable[[], bool],
) -> Iterator[Step]:
    """Follow one trace from a cursor until it has enough or its steps are used up."""
    scene = solver.problem.scene
    done = round(cursor.position * item.steps)
    if done >= item.steps or (done and enough()):
        return  # resumed after its last step
    sign = cursor.direction or float(np.sign(item.first))
    factors = dict(cursor.factors)
    for found in trace(solver, item, cursor.size or 1.0, sign, log):
        if isinstance(found, str):
            names, lost = (item.what,), factors | {item.what: factors[item.what]}
            raise _verdict(scene, names, item.what, factors, lost, Attempt(found, 0, np.inf))
        done += 1
        factors = cursor.factors | {item.what: found.factor}
        cursor = Cursor(
            cursor.step + 1, cursor.ramp, done / item.steps, found.arc, factors,
            dict(cursor.start), found.direction,
        )  # fmt: skip
        last = done >= item.steps and cursor.ramp == len(path) - 1
        yield Step(cursor, item.what, found.attempt, found.retries, last, found.event)
        if done >= item.steps or enough():
            return


def _follow_ramp(
    solver: NewtonSolver,
    path: Sequence[Ramp | Trace],
    ramp: Ramp,
    cursor: Cursor,
    log: Callable[[str], None],
) -> Iterator[Step]:
    """Follow one ramp from a cursor to its end."""
    problem = solver.problem
    scene = problem.scene
    names, label = ramp.names(scene), ramp.label(scene)
    landings = _landings(ramp, cursor.start[names[0]])
    first = 1.0 / ramp.steps
    size = cursor.size or first
    position, start = cursor.position, cursor.start
    predictor = Predictor(solver, names)
    predictor.add(cursor.factors[names[0]])
    index, retries = cursor.step, 0
    factors = dict(cursor.factors)
    while position < 1.0:
        landing = min(s for s in landings if s > position)
        # no crumb is left before a landing
        target = landing if landing - position < 1.25 * size else position + size
        trial = dict(factors)
        for name in names:
            # weighted so that the end is hit to the last bit
            trial[name] = (1 - target) * start[name] + target * ramp.to
        attempt = predictor.solve(trial)
        if attempt.converged:
            grown = 1.5 if attempt.iterations <= EASY else 1.0
            full = target == landing and target - position < size
            size = min(size * (1.0 if full else grown), 1.0)
            position, factors, index = target, trial, index + 1
            if not full and ramp.at is None:
                size = min(size, first)
            cursor = Cursor(index, cursor.ramp, position, size, dict(factors), dict(start))
            last = position == 1.0 and cursor.ramp == len(path) - 1
            predictor.add(factors[names[0]])
            yield Step(cursor, label, attempt, retries, last)
            retries = 0
            continue
        problem.set_factors(factors)
        predictor.restore()
        retries += 1
        size = (target - position) / 2
        log(
            f"{label}: no equilibrium at {describe(scene, trial, names)} ({attempt.reason}, "
            f"{attempt.iterations} Newton iterations); step halved"
        )
        if size < SMALLEST * first:
            raise _verdict(scene, names, label, factors, trial, attempt)


def _landings(ramp: Ramp, start: float) -> list[float]:
    """Positions in (0, 1] to land on."""
    if ramp.at is None:
        return [(k + 1) / ramp.steps for k in range(ramp.steps)]
    span = ramp.to - start
    inside = [(value - start) / span for value in ramp.at] if span else []
    return sorted({s for s in inside if 0 < s < 1} | {1.0})


def describe(scene: Scene, factors: dict[str, float], names: Sequence[str]) -> str:
    """The load of a state in words: volts for electrodes, the bare factor for all else."""
    words = []
    for name in names:
        volts = scene.reference_voltage(name)
        value = factors[name]
        words.append(f"{value * volts:.6g} V" if volts else f"{name} factor {value:.6g}")
    return ", ".join(words)


def _verdict(
    scene: Scene,
    names: Sequence[str],
    label: str,
    reached: dict[str, float],
    failed: dict[str, float],
    attempt: Attempt,
) -> EquilibriumLost | SolverError:
    """The error that ends a path that cannot be followed any further."""
    low, high = describe(scene, reached, names), describe(scene, failed, names)
    if attempt.reason == "linear solver":
        return SolverError(
            f"The linear solver failed between {low} and {high} of the {label} ramp; check "
            "supports and material constants."
        )
    if attempt.reason == "rounding":
        return SolverError(
            f"Newton's residual came to rest at {attempt.residual:.2g} between {low} and {high} of "
            f"the {label} ramp, just above its tolerance; it is rounding, so loosen "
            "NewtonOptions(tolerance=...) or use cells that are less thin."
        )
    error = EquilibriumLost(
        f"Equilibrium was lost between {low} and {high} of the {label} ramp "
        f"(last trial: {attempt.reason}); a pull-in or another limit point lies there, and all "
        "steps before it are kept."
    )
    error.reached, error.failed = dict(reached), dict(failed)
    return error


class Predictor:
    """Starts each step from an extrapolation of the states before it.

    Displacement and pressure are even in a voltage or charge, so for such a ramp they are
    extrapolated in its square; the potential is extrapolated in the voltage or charge itself.
    """

    def __init__(self, solver: NewtonSolver, names: tuple[str, ...]) -> None:
        self.solver = solver
        self.problem = solver.problem
        scene = self.problem.scene
        self.name = names[0]
        self.even = all(scene.is_electric(n) for n in names)
        self.known: list[tuple[float, np.ndarray]] = []
        self._phi = np.zeros(self.problem.size, dtype=bool)
        if self.problem.potential is not None:
            self._phi[self.problem.potential.dofs] = True

    def add(self, factor: float) -> None:
        """Remember the problem's state as that of a factor."""
        # a ramp to the present value comes by the same factor twice: no polynomial takes both
        others = [known for known in self.known if known[0] != factor]
        self.known = [*others[-2:], (factor, self.problem.get_state())]

    def _speed(self, factor: float, since: tuple[float, np.ndarray], now: np.ndarray) -> float:
        """Largest change of displacement since a state, per change of the load's coordinate."""
        span = abs(factor**2 - since[0] ** 2) if self.even else abs(factor - since[0])
        dofs = self.problem.fields["u"]
        move = float(np.max(np.abs(now[dofs] - since[1][dofs]), initial=0.0))
        return self.problem.comm.allreduce(move, op=MPI.MAX) / span if span else 0.0

    def _judge(self, factor: float, attempt: Attempt) -> Attempt:
        """Refuse a converged state that does not continue the path but lies on another branch.

        Towards a limit point the speed of a smooth path grows like an inverse square root, by a
        factor of at most 2.4 when a step lands right on it.
        """
        if not attempt.converged:
            return attempt
        now = self.problem.get_state()
        speed = self._speed(factor, self.known[-1], now)
        if len(self.known) == 1:
            far = attempt.iterations > WANDERING
        else:
            usual = self._speed(self.known[-1][0], self.known[-2], self.known[-1][1])
            far = speed > FASTER * usual > 0
        return replace(attempt, reason="jumped") if far else attempt

    def restore(self) -> None:
        """Put the last accepted state back."""
        self.problem.set_state(self.known[-1][1])

    def solve(self, factors: dict[str, float]) -> Attempt:
        """Solve at new factors: from the extrapolation, else by a tangent step."""
        problem = self.problem
        problem.set_factors(factors)
        if len(self.known) > 1:
            self._extrapolate(factors[self.name])
            problem.insert_fixed()
            if problem.probe().admissible:
                attempt = self._judge(factors[self.name], self.solver.solve(lift=False))
                if attempt.converged:
                    return attempt
            self.restore()
        return self._judge(factors[self.name], self.solver.solve(lift=True))

    def _extrapolate(self, factor: float) -> None:
        """Polynomial through the known states, at a factor."""
        at = np.array([f for f, _ in self.known])
        states = [s for _, s in self.known]
        by_factor = _lagrange(at, factor)
        guess = sum(c * s for c, s in zip(by_factor, states, strict=True))
        if self.even:
            squares = at**2
            if len(np.unique(squares)) == len(squares):
                by_square = _lagrange(squares, factor**2)
                even = sum(c * s for c, s in zip(by_square, states, strict=True))
                guess = np.where(self._phi, guess, even)
        self.problem.set_state(guess)


def _lagrange(nodes: np.ndarray, x: float) -> np.ndarray:
    """Weights of the polynomial through values at `nodes`, at x."""
    others = [np.delete(nodes, k) for k in range(len(nodes))]
    return np.array([np.prod((x - o) / (n - o)) for n, o in zip(nodes, others, strict=True)])
