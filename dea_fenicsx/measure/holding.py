"""Forces by which supports hold a device: the residual, less what supports do not bear."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.rigid_parts import RigidPart
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx

Forces = Callable[[], np.ndarray]
"""The dimensionless force that holds each owned degree of freedom, in the present state."""


def holding_forces(problem: Problem) -> Forces:
    """How to find the forces that hold a device.  Collective, as are the calls of what is returned.

    The pressure of a cavity on a plane that closes it acts on the plane, and not on the rim.
    """
    if problem.cavities.on_planes == 0:
        return problem.residual
    form = compat.compile_form(problem.cavities.on_planes)
    fixed, owned = problem.conditions.fixed_values.fixed[: problem.owned], problem.owned

    def forces() -> np.ndarray:
        vector = dolfinx.fem.assemble_vector(form)
        vector.scatter_reverse(dolfinx.la.InsertMode.add)
        return np.asarray(problem.residual() - np.where(fixed, vector.array[:owned], 0.0))

    return forces


def holding(
    problem: Problem, part: RigidPart, residual: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Force and moment that hold a rigid part, dimensionless.  Collective.

    `residual` are the forces of `holding_forces`.
    """
    at, owned = problem.w.x.array, problem.owned
    slopes = part.slopes(at)
    rows = np.zeros(len(part.unknowns))
    for a, dofs in enumerate(part.dofs):
        mine = dofs < owned
        rows += residual[dofs[mine]] @ slopes[mine, a]
    for k, dofs in enumerate(part.unknowns):
        rows[k] += float(residual[dofs[dofs < owned]].sum())
    rows = problem.comm.allreduce(rows, op=MPI.SUM)
    force, moment = part.split(rows)
    scales, factors = problem.scales, problem.factors
    for load in problem.rigid.forces:
        if load.surface == part.name:
            newtons = factors[load.ramp] * np.array(load.newtons)
            force = force - part.shifts.T @ (part.shifts @ newtons) / scales.force
    for turn in problem.rigid.moments:
        if turn.surface == part.name:
            about = np.array(turn.about[-part.turning.count:])
            unit = scales.force * scales.length
            moment = moment - factors[turn.ramp] * turn.newton_metres * about / unit
    return force, moment


def cut_parts(problem: Problem, dofs: np.ndarray, axis: int) -> list[RigidPart]:
    """The rigid parts that fixed nodes hold along an axis: planes of symmetry cut them.

    The plane bears what acts on the whole part, and not on its nodes there alone.  Collective.
    """
    if not problem.scene.kinematics.cartesian and axis == 0:
        return []
    touched = [bool(np.isin(dofs, part.dofs[axis]).any()) for part in problem.rigid.parts]
    everyone = np.any(problem.comm.allgather(touched), axis=0)
    return [part for part, cut in zip(problem.rigid.parts, everyone, strict=True) if cut]
