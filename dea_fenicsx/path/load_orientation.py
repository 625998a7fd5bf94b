"""The orientation that dead loads give to a free body when they begin to act.

Dead loads with a moment, however small, turn a free body until the moment vanishes.  So the body is
turned as a whole to this orientation before the first step.  This causes no strain.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.free_body import HeldBody
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import State
from dea_fenicsx.support.compat import dolfinx

NEGLIGIBLE_MOMENT = 1e-6
"""Moments below this share of the sum of all forces times their arms are rounding errors."""


def turn_to_loads(
    problem: Problem, rates: Mapping[str, float]
) -> tuple[State, float]:
    """Turn a free body as a whole to where the loads that begin to act have no moment.  Collective.

    There are several orientations without a moment.  We take the stable one, in which the potential
    of the loads is lowest.  If there are several of these, we take the nearest.

    Parameters
    ----------
    problem
        The problem in its present state.
    rates
        Change of each ramp's factor that begins.

    Returns
    -------
    State, float
        The turned state, and the angle in rad; 0 if the body is not free to turn, if dead loads
        act already, or if the new ones have no moment.
    """
    acting = problem.turning.ramps & {ramp for ramp, rate in rates.items() if rate}
    if not acting or not problem.turning.holds(problem.factors):
        return problem.state, 0.0
    body = _body(problem)
    forces = -sum(rates[ramp] * problem.forms.load_vector(ramp) for ramp in sorted(acting))
    moments, size = _first_moments(problem, np.asarray(forces))
    axes = body.axes
    turned = np.array([moments[2, 1] - moments[1, 2], moments[0, 2] - moments[2, 0],
                       moments[1, 0] - moments[0, 1]])  # fmt: skip
    if np.linalg.norm(axes @ turned) <= NEGLIGIBLE_MOMENT * size:
        return problem.state, 0.0
    R = _about(axes[0], moments) if len(axes) == 1 else _lowest(moments)
    turned_state = problem.anchored(problem.imposed(_rotated(problem, R, body.pins[0].place)))
    return turned_state, float(np.arccos(np.clip((np.trace(R) - 1) / 2, -1, 1)))


def _body(problem: Problem) -> HeldBody:
    """The free body of a problem that has one."""
    body = problem.conditions.body
    assert body is not None
    return body


def _positions(problem: Problem) -> list[np.ndarray]:
    """For each displacement component the deformed position of each local node, shape (n, 3).

    Nodes are numbered by each component's own space; positions come through the cells.
    """
    parts, w = problem.displacement, problem.w.x.array
    found = []
    for part in parts:
        x = part.space.tabulate_dof_coordinates().copy()
        nodes = part.space.dofmap.list.ravel()
        for j, other in enumerate(parts):
            x[nodes, j] += w[other.dofs[other.space.dofmap.list.ravel()]]
        found.append(x)
    return found


def _first_moments(problem: Problem, forces: np.ndarray) -> tuple[np.ndarray, float]:
    """Sum of f_i x_j over the nodes, shape (3, 3), and of |f| |x|, about the middle of the body."""
    free = _body(problem).part
    total = np.zeros((3, 3))
    size = 0.0
    for i, (part, x) in enumerate(zip(problem.displacement, _positions(problem), strict=True)):
        mine = free.holds(part) & (part.dofs < problem.owned)
        f, arm = forces[part.dofs[mine]], x[mine] - free.box.middle
        total[i] = f @ arm
        size += float(np.abs(f) @ np.linalg.norm(arm, axis=1))
    summed = problem.comm.allreduce(np.append(total.ravel(), size), op=MPI.SUM)
    return summed[:9].reshape(3, 3), float(summed[9])


def _rotation(axis: np.ndarray, cosine: float, sine: float) -> np.ndarray:
    """Rotation matrix about a unit axis."""
    cross = np.cross(np.eye(3), axis)
    return cosine * np.eye(3) + sine * cross + (1 - cosine) * np.outer(axis, axis)


def _about(axis: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """The rotation about an axis that gives the loads the lowest potential -tr(R^T M)."""
    across = np.eye(3) - np.outer(axis, axis)
    flat = across @ moments @ across
    turned = np.array([flat[2, 1] - flat[1, 2], flat[0, 2] - flat[2, 0], flat[1, 0] - flat[0, 1]])
    cosine, sine = np.trace(flat), float(axis @ turned)
    size = np.hypot(cosine, sine)
    return _rotation(axis, float(cosine / size), sine / size)


def _lowest(moments: np.ndarray) -> np.ndarray:
    """The rotation that gives the loads the lowest potential -tr(R^T M).

    If there are several, it is the one by the smallest angle.
    """
    U, s, Vt = np.linalg.svd(moments)
    if s[1] > NEGLIGIBLE_MOMENT * s[0]:
        return U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    # All loads point along u and all arms along v: take the smallest rotation from v to u.
    u, v = U[:, 0], Vt[0]
    axis = np.cross(v, u)
    sine = float(np.linalg.norm(axis))
    if sine < NEGLIGIBLE_MOMENT:
        return np.eye(3)
    return _rotation(axis / sine, float(v @ u), sine)


def _rotated(problem: Problem, R: np.ndarray, centre: np.ndarray) -> State:
    """The present state with the free part of the device turned as a whole about a place."""
    state = problem.state
    values = dolfinx.fem.Function(problem.W)
    values.x.array[:] = state.values
    for i, (part, x) in enumerate(zip(problem.displacement, _positions(problem), strict=True)):
        mine = _body(problem).part.holds(part)
        turned = (x[mine] - centre) @ R[i] + centre[i]
        values.x.array[part.dofs[mine]] = turned - part.space.tabulate_dof_coordinates()[mine, i]
    values.x.scatter_forward()
    return state.with_values(values.x.array.copy())
