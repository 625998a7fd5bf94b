"""How viscous branches respond to a ramp or a trace: instantaneously, or relaxed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from dea_fenicsx.model.motion import MOTION
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.viscous_history import Rule
from dea_fenicsx.path.items import Ramp, Trace
from dea_fenicsx.path.time_stepping import TimeStepper
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.support.errors import SolverError

FIRST_RELAXATION = 0.05
"""First step of a relaxation at constant load, in units of the shortest relaxation time."""

RELAXATION_GROWTH = 2.0
"""Length of each step of a relaxation over that of the one before."""

LONGEST_RELAXATION = 1e3
"""After so many of the longest relaxation time the rest is gone in one step."""


def respond(
    solver: NewtonSolver, item: Ramp | Trace, log: Callable[[str], None]
) -> None:
    """Let the branches respond to a ramp or a trace as it says.  Collective.

    Before a relaxed response the body relaxes at its present load.

    Raises
    ------
    SolverError
        If no relaxed state is found at this load.
    """
    problem = solver.problem
    memory = problem.forms.memory
    if not memory or item.response != "relaxed":
        return
    if math.isinf(_span(problem)):
        return  # resumed within the item
    if any(problem.state.factors.values()) or problem.state.time:
        log(f"{item.label(problem.scene)}: the viscous branches relax at the present load first")
        _relax(solver)
    state = problem.state
    history = state.history.get(memory.NAME) or memory.at_rest()
    problem.commit(
        replace(state, history={**state.history, memory.NAME: history.ahead(math.inf)})
    )


def _span(problem: Problem) -> float:
    memory = problem.forms.memory
    history = problem.state.history.get(memory.NAME)
    return 0.0 if history is None else float(history.span)


def _relax(solver: NewtonSolver) -> None:
    """Let the branches flow at constant load until they are relaxed, by backward Euler."""
    problem = solver.problem
    memory, clock = problem.forms.memory, problem.state.time
    stepper = TimeStepper(solver, {}, clock, order=1, only=memory.NAME)
    times = memory.relaxation_times()
    if times is None:
        return
    shortest, longest = times
    seconds, last = FIRST_RELAXATION * shortest, LONGEST_RELAXATION * longest
    smallest = seconds * 2.0**-20
    while seconds < last:
        attempt = stepper.step(seconds)
        if attempt.converged:
            settled = stepper.settled(attempt.found)
            problem.commit(settled)
            stepper.accept(settled)
            seconds *= RELAXATION_GROWTH
        else:
            seconds /= 4
            if seconds < smallest:
                raise SolverError(
                    "No relaxed state was found at the load at which a relaxed response is to "
                    f"begin (last trial: {attempt.outcome.value}); the body may creep to a pull-in "
                    "there, which a March would show."
                )
    end = stepper.target(0.0, stepper.ahead(math.inf, Rule.EULER))
    attempt = solver.solve(end)
    if not attempt.converged:
        raise SolverError(
            "No relaxed state was found at the load at which a relaxed response is to begin "
            f"({attempt.outcome.value})."
        )
    problem.commit(replace(attempt.found, time=clock))


def settle(problem: Problem) -> None:
    """Accept the viscous strains of the present state.  Collective."""
    memory = problem.forms.memory
    if not memory or _span(problem) == 0:
        return
    state = problem.state
    history = memory.settled(state.history[memory.NAME], state.time)
    problem.commit(replace(state, history={**state.history, memory.NAME: history}))


def come_to_rest(solver: NewtonSolver) -> None:
    """Let a body that has moved with inertia go on without; it must be near equilibrium.

    Collective.

    Raises
    ------
    SolverError
        If there is no equilibrium near its present state.
    """
    problem = solver.problem
    if problem.motion is None:
        return
    history = {name: h for name, h in problem.state.history.items() if name != MOTION}
    state = replace(problem.state, history=history)
    attempt = solver.solve(state)
    if not attempt.converged:
        raise SolverError(
            "The body has not come to rest, and no equilibrium was found from its present state "
            f"({attempt.outcome.value}); let it move for longer, with viscous branches or drag."
        )
    problem.commit(attempt.found)
