"""The first Newton step of a device that has not touched its obstacles yet.

A thin plate that is flat follows its tangent far through an obstacle below it.  All points that lie
there are then taken for pressed, and each further iteration only lets go those at the rim of what
is pressed.  So the first step ends a little beyond the state in which the first point touches.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import State

BEYOND_TOUCH = 1.2
"""Length of a step that lands, in units of that to the first touch."""


def share_to_land(problem: Problem, end: State) -> float:
    """Share of the way from the present state to another one after which the device lands.

    It is 1 if the way leads to no obstacle or if the device is at one already.  It is also 1 if the
    other state has other prescribed displacements: a part of the way would not fit to them.
    Collective.
    """
    contacts = problem.forms.contacts
    if not contacts:
        return 1.0
    dofs = problem.roles.owned(Role.MOTION)
    dofs = dofs[problem.conditions.fixed_values.fixed[dofs]]
    prescribed = bool(np.any(end.values[dofs] != problem.state.values[dofs]))
    near = [contact.is_near() for contact in contacts]
    if problem.comm.allreduce(prescribed or any(near), op=MPI.LOR):
        return 1.0
    before = [contact.points.values().gap for contact in contacts]
    mine = 1.0
    with problem.at(end):
        for contact, gap in zip(contacts, before, strict=True):
            after = contact.points.values().gap
            closed = after < 0
            touched = gap[closed] / (gap - after)[closed]
            mine = min(mine, BEYOND_TOUCH * float(np.min(touched, initial=1.0)))
    return float(problem.comm.allreduce(mine, op=MPI.MIN))


def landed(problem: Problem, last: State, guess: State) -> State:
    """A prediction that follows a state, or where it lands if it leads into an obstacle."""
    with problem.at(last):
        share = share_to_land(problem, guess)
    if share == 1.0:
        return guess
    values = last.values + share * (guess.values - last.values)
    return guess.with_values(values)
