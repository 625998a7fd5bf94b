"""A device that lies a little in its obstacles is pushed out of them before its path begins."""

from __future__ import annotations

from collections.abc import Callable

from dea_fenicsx.model.state import State
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.support.errors import SolverError

FIRST_STEP_OF_OBSTACLES = 0.25
"""First step of the obstacles towards their places, as a share of their depth."""

SMALLEST_STEP = 2.0**-10
"""Step, as a share of the depth, below which the device cannot be pushed out."""


def pushed_out(solver: NewtonSolver, log: Callable[[str], None]) -> State | None:
    """The equilibrium without loads of a device that lies in obstacles; None if it lies in none.

    The obstacles begin where they just touch the device, and move to their places in steps.
    Collective.

    Raises
    ------
    SolverError
        If no equilibrium is found on the way.
    """
    problem = solver.problem
    depths = problem.depths
    if not any(depths):
        return None
    state, share, step = problem.rest, 1.0, FIRST_STEP_OF_OBSTACLES
    try:
        while share > 0.0:
            goal = max(share - step, 0.0)
            _withdraw(solver, goal)
            attempt = solver.solve(state)
            if attempt.converged:
                state, share = attempt.found, goal
                continue
            step /= 2
            if step < SMALLEST_STEP:
                deepest = max(depths) * problem.scales.length
                raise SolverError(
                    f"The device lies {deepest:.3g} m deep in an obstacle and could not be pushed "
                    f"out of it ({attempt.outcome.value}); let it begin outside, and move the "
                    "obstacle by a ramp."
                )
    finally:
        _withdraw(solver, 0.0)
    told = ", ".join(
        f"{depth * problem.scales.length:.3g} m out of the obstacle at {contact.told.surface!r}"
        for contact, depth in zip(problem.forms.contacts, depths, strict=True) if depth
    )  # fmt: skip
    log(f"The undeformed device is pushed {told}.")
    return state


def _withdraw(solver: NewtonSolver, share: float) -> None:
    """Move each obstacle back by a share of the depth to which the device lies in it."""
    problem = solver.problem
    for contact, depth in zip(problem.forms.contacts, problem.depths, strict=True):
        contact.offset.value = share * depth
