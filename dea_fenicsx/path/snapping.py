"""The state to which a device snaps when a growing load passes a limit point."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

from dea_fenicsx.model.state import State
from dea_fenicsx.path.arclength import Point, TracedBranch
from dea_fenicsx.path.branch_steps import BranchSteps
from dea_fenicsx.path.load_course import LoadCourse
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.support.errors import SolverError

FIRST_ARC_BEHIND_LIMIT = 1.0
"""First step along the branch, in units of arc."""

LONGEST_ARC_BEHIND_LIMIT = 4.0
"""Longest step along the branch, in units of arc."""

MOST_STEPS_TO_LANDING = 400
"""Largest number of steps along the branch that are made to find the landing."""

MOTION_STARTS = (0.25, 0.5, 1.0)
"""Distances behind the limit point at which a motion may begin, in units of arc.

They are tried in turn.  At the limit point itself the body is in equilibrium, and would stay there.
"""

SHARES_OF_STEP = (0.5, 0.25, 0.125)
"""If no limit point was found in a step, we look again in its first part: these shares of it."""


class BehindLimit(NamedTuple):
    """What lies on the branch where a load cannot grow any more.

    Attributes
    ----------
    limit
        The limit point.
    landing
        The next stable state that bears the same load; None if there is none, or none was wanted.
    behind
        An equilibrium a little way behind the limit point; None if none was found or wanted.
    """

    limit: Point
    landing: State | None = None
    behind: State | None = None


def over_the_limit(
    solver: NewtonSolver,
    rates: Mapping[str, float],
    factor: float,
    first: float,
    log: Callable[[str], None],
    landing: bool = True,
    behind: bool = False,
) -> BehindLimit:
    """Follow the branch over the limit point to the next stable state that bears the same load.

    The states between the limit point and that state are not stable at this load.  A device with
    enough damping comes to rest there.  The problem is left in the state in which it was.

    Parameters
    ----------
    solver
        The solver, in equilibrium before the limit point.
    rates, factor, first
        As in `TracedBranch`; the load f grows.
    log
        Called with a line of text.
    landing, behind
        Whether the stable state, and a state a little way behind the limit point, are wanted.

    Returns
    -------
    BehindLimit

    Raises
    ------
    SolverError
        If no limit point is found.
    """
    branch = TracedBranch(solver, LoadCourse(solver, rates, factor), first)
    steps = BranchSteps(
        branch, FIRST_ARC_BEHIND_LIMIT, LONGEST_ARC_BEHIND_LIMIT, MOST_STEPS_TO_LANDING
    )
    reached, limit, near = steps.begin, None, None
    for here, there, arc in steps:
        reached = there
        if limit is None and here.slope > 0 > there.slope and (
            found := _limit_point(branch, here, there, arc)
        ):  # fmt: skip
            limit = found
            near = _behind(branch, limit) if behind else None
            if not landing:
                return BehindLimit(limit, None, near)
            log(f"limit point at {limit.factor:.8g} of the ramp; its far side is searched")
        if limit is not None and there.slope > 0 and there.factor > limit.factor:
            landed = _landing(branch, here, there, limit)
            if landed is not None:
                return BehindLimit(limit, landed, near)
        with solver.problem.at(there.state):
            # Towards lock-up the forces and their rounding errors grow by orders of magnitude.
            solver.references.remember(solver.problem.residual())
    if steps.lost is not None and reached is not None:
        log(f"the branch could be followed to {reached.factor:.8g} only "
            f"({steps.lost.outcome.value})")  # fmt: skip
    if limit is None:
        raise SolverError("no limit point was found")
    return BehindLimit(limit, None, near)


def _limit_point(branch: TracedBranch, here: Point, there: Point, arc: float) -> Point | None:
    """The limit point between two points.  Collective.

    If Newton's method fails close to it, where the tangent is singular, a shorter part of the
    branch is searched, on which another way leads there.
    """
    found = branch.limit_point(here, there, arc)
    for share in SHARES_OF_STEP:
        if found is not None:
            break
        _, between = branch.advance(here, share * arc)
        if between is None:
            continue
        if between.slope < 0:
            found = branch.limit_point(here, between, share * arc)
        else:
            found = branch.limit_point(between, there, branch.advanced(between, there))
    return found[0] if found else None


def _behind(branch: TracedBranch, limit: Point) -> State | None:
    """An equilibrium a little way behind a limit point.  Collective."""
    for arc in MOTION_STARTS:
        attempt = branch.step(limit, arc)
        if attempt.converged and branch.factor_of(attempt.found) < limit.factor:
            return attempt.found
    return None


def _landing(branch: TracedBranch, here: Point, there: Point, limit: Point) -> State | None:
    """The stable equilibrium between two points that bears the load of the limit point, or None."""
    landing = branch.land(here, there, limit.factor)
    if not landing.converged:
        return None
    with branch.problem.at(landing.found):
        branch.solver.refresh_inertia()
    return landing.found if branch.solver.inertia.excess == 0 else None
