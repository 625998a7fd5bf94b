"""Newton steps and predictions that lead into an obstacle end a little behind its surface.

A thin plate that is flat follows its tangent far through an obstacle below it.  All points that lie
there are then taken for pressed.  Each further iteration only lets go those at the rim of what is
pressed, so that many are needed.  Points that are missing cost less: all that have come to lie in
the obstacle are pressed at once.  So the first steps end where the first of the open points
has just passed the surface.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import State

DEPTH_OF_LANDING = 0.1
"""Depth of a point that lands, in units of the tolerance of its gap.

It is small enough that few points are pressed which open again, and large enough that the point is
pressed in the next iteration.
"""

MOST_LANDINGS = 4
"""Number of first Newton iterations that may be shortened.

A contact over many facets that grows within one step must not grow by one row of them in each
iteration.
"""


def share_to_land(problem: Problem, end: State) -> float:
    """Share of the way from the present state to another one after which the device lands.

    It is 1 if no point that is open now leads far into an obstacle.  It is also 1 if the other
    state has other prescribed displacements: a part of the way would not fit to them.  Collective.
    """
    contacts = problem.forms.contacts
    if not contacts:
        return 1.0
    dofs = problem.roles.owned(Role.MOTION)
    dofs = dofs[problem.conditions.fixed_values.fixed[dofs]]
    prescribed = bool(np.any(end.values[dofs] != problem.state.values[dofs]))
    if problem.comm.allreduce(prescribed, op=MPI.LOR):
        return 1.0
    before = [contact.points.values() for contact in contacts]
    mine = 1.0
    with problem.at(end):
        for contact, old in zip(contacts, before, strict=True):
            gap, after = old.gap, contact.points.values().gap
            depth = DEPTH_OF_LANDING * contact.allowed(gap)
            deep = (old.pushed <= 0) & (gap > -depth) & (after < -depth)
            shares = (gap + depth)[deep] / (gap - after)[deep]
            mine = min(mine, float(np.min(shares, initial=1.0)))
    return float(problem.comm.allreduce(mine, op=MPI.MIN))


def landed(problem: Problem, last: State, guess: State) -> State:
    """A prediction that follows a state, or where it lands if it leads into an obstacle."""
    with problem.at(last):
        share = share_to_land(problem, guess)
    if share == 1.0:
        return guess
    values = last.values + share * (guess.values - last.values)
    return guess.with_values(values)
