"""Rigid motions of a free body in its present state, as values of the mixed function."""

from __future__ import annotations

import numpy as np

from dea_fenicsx.model.problem import Problem


def rigid_shapes(problem: Problem) -> np.ndarray:
    """The infinitesimal rigid motions that only `FreeBody` holds, in the present state.

    While dead loads determine the orientation of the body, its rotations are none of them.

    Returns
    -------
    ndarray of shape (local degrees of freedom, motions)
        Empty without a free body.
    """
    body = problem.conditions.body
    if body is None or problem.released:
        return np.zeros((problem.size, 0))
    part, parts = body.part, problem.displacement
    oriented = bool(body.turns) and not problem.turning.holds(problem.factors)
    motions = part.translations if oriented else part.motions
    x = parts[0].space.tabulate_dof_coordinates().copy()
    for a, component in enumerate(parts):
        x[:, a] += problem.w.x.array[component.dofs]
    found = np.zeros((problem.size, len(motions)))
    for a, component in enumerate(parts):
        mine = part.holds(component)
        rows = part.kinematics.rigid_motions(x[mine], a, *part.box) @ motions.T
        found[component.dofs[mine]] = rows
    return found
