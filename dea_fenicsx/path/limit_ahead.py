"""The limit point ahead of a ramp whose steps are failing, found by arc length.

Newton's method takes longest where there is nothing to be found.  Once the limit point is known, a
ramp need not try the loads behind it, and comes to its end in a fraction of the time.
"""

from __future__ import annotations

from collections.abc import Mapping

from dea_fenicsx.path.arclength import TracedBranch
from dea_fenicsx.path.branch_steps import BranchSteps
from dea_fenicsx.path.events import Sentinel
from dea_fenicsx.path.load_course import LoadCourse
from dea_fenicsx.solvers.newton import NewtonSolver

FIRST_ARC_TO_LIMIT, LONGEST_ARC_TO_LIMIT = 0.125, 1.0
"""First and longest step along the branch, in units of arc."""

MOST_STEPS_TO_LIMIT = 12
"""Largest number of steps along the branch.  A limit point that is not near is not worth more."""


def limit_ahead(
    solver: NewtonSolver, sentinel: Sentinel, rates: Mapping[str, float], first: float,
    position: float, failed: float,
) -> float | None:  # fmt: skip
    """Position of the limit point between the last state of a ramp and a load that failed.

    Collective; the problem is left in the state in which it was.

    Parameters
    ----------
    solver
        The solver, in equilibrium at the last state.
    sentinel
        Counts negative eigenvalues; holds the number of the last state.
    rates, first
        As in `TracedBranch`; the load f is the position on the ramp.
    position, failed
        Position of the last state, and that of the step that has failed.

    Returns
    -------
    float or None
        None if the branch reaches the load that failed, or cannot be followed so far.
    """
    branch = TracedBranch(solver, LoadCourse(solver, rates, position), first)
    steps = BranchSteps(branch, FIRST_ARC_TO_LIMIT, LONGEST_ARC_TO_LIMIT, MOST_STEPS_TO_LIMIT)
    _, fall = steps.rise(failed)
    if fall is None:
        return None
    before = sentinel.excess
    now = None if before is None else sentinel.count(fall.there.state)
    if before is not None and now is not None and now != before + 1:
        return None  # a state of another branch, or a crossing before the limit point
    found = branch.limit_point(*fall)
    return None if found is None else found[0].factor
