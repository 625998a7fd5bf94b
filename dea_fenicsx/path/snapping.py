"""The state to which a device snaps when a growing load passes a limit point."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from dea_fenicsx.model.state import State
from dea_fenicsx.path.arclength import Branch, Point
from dea_fenicsx.path.branch_steps import BranchSteps
from dea_fenicsx.path.load_course import LoadCourse
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.support.errors import SolverError

FIRST_ARC = 1.0
"""First step along the branch, in units of arc."""

LONGEST_ARC = 4.0
"""Longest step along the branch, in units of arc."""

MOST_STEPS = 400
"""Largest number of steps along the branch that are made to find the landing."""


def over_the_limit(
    solver: NewtonSolver,
    rates: Mapping[str, float],
    factor: float,
    first: float,
    log: Callable[[str], None],
) -> tuple[Point, State | None]:
    """Follow the branch over the limit point to the next stable state that bears the same load.

    The states between the limit point and that state are not stable at this load.  A device with
    enough damping comes to rest there.  The problem is left in the state in which it was.

    Parameters
    ----------
    solver
        The solver, in equilibrium before the limit point.
    rates, factor, first
        As in `Branch`; the load f grows.
    log
        Called with a line of text.

    Returns
    -------
    Point, State or None
        The limit point, and the landing; None if there is none.

    Raises
    ------
    SolverError
        If no limit point is found.
    """
    branch = Branch(solver, LoadCourse(solver, rates, factor), first)
    steps = BranchSteps(branch, FIRST_ARC, LONGEST_ARC, MOST_STEPS)
    reached, limit = steps.begin, None
    for here, there, arc in steps:
        reached = there
        if limit is None and there.slope < 0 and (
            found := branch.limit_point(here, there, arc)
        ):  # fmt: skip
            limit = found[0]
            log(f"limit point at {limit.factor:.8g} of the ramp; its far side is searched")
        if limit is not None and there.slope > 0 and there.factor > limit.factor:
            landing = _landing(branch, here, there, limit)
            if landing is not None:
                return limit, landing
        with solver.problem.at(there.state):
            # Towards lock-up the forces and their rounding errors grow by orders of magnitude.
            solver.references.remember(solver.problem.residual())
    if steps.lost is not None and reached is not None:
        log(f"the branch could be followed to {reached.factor:.8g} only "
            f"({steps.lost.outcome.value})")  # fmt: skip
    if limit is None:
        raise SolverError("no limit point was found")
    return limit, None


def _landing(branch: Branch, here: Point, there: Point, limit: Point) -> State | None:
    """The stable equilibrium between two points that bears the load of the limit point, or None."""
    landing = branch.land(here, there, limit.factor)
    if not landing.converged:
        return None
    with branch.problem.at(landing.found):
        branch.solver.refresh_inertia()
    return landing.found if branch.solver.inertia.excess == 0 else None
