"""Observables of a body in motion: its kinetic energy, momentum and angular momentum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from dea_fenicsx.measure.observables import Measurement
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import one_of


@dataclass(frozen=True)
class KineticEnergy:
    """Kinetic energy of the body in J, 0 where it moves without inertia."""

    unit = "J"

    def bind(self, problem: Problem) -> Measurement:
        unit = problem.scales.stress * problem.scales.volume

        def value() -> float:
            if problem.motion is None:
                return 0.0
            v = problem.motion.velocity[: problem.owned]
            mine = float(v @ problem.massive().times(v)) / 2
            return float(problem.comm.allreduce(mine, op=MPI.SUM)) * unit

        return value


@dataclass(frozen=True)
class Momentum:
    """Momentum of the body along an axis in N s, 0 where it moves without inertia."""

    axis: str
    unit = "Ns"

    def bind(self, problem: Problem) -> Measurement:
        axes = tuple(problem.scene.kinematics.axes)
        one_of(self.axis, axes, "The axis")
        part = problem.displacement[axes.index(self.axis)]
        along = np.zeros(problem.size)
        along[part.dofs] = 1.0
        if carrying := problem.rigid.carrying(problem.size):
            along[carrying[axes.index(self.axis)]] = 1.0

        def value() -> float:
            if problem.motion is None:
                return 0.0
            v = problem.motion.velocity[: problem.owned]
            mine = float(along[: problem.owned] @ problem.massive().times(v))
            return float(problem.comm.allreduce(mine, op=MPI.SUM)) * problem.scales.force

        return value


@dataclass(frozen=True)
class AngularMomentum:
    """Angular momentum about the origin, in N m s; 0 where the body moves without inertia.

    It is int rho x x v dX with the present place x.

    Parameters
    ----------
    axis
        The axis: x, y or z in space, z in the plane.

    Raises
    ------
    InputError
        When it is bound: for another axis, and in an axisymmetric section or a helical cell.
    """

    axis: str = "z"
    unit = "Nms"

    def bind(self, problem: Problem) -> Measurement:
        kinematics = problem.scene.kinematics
        if not kinematics.cartesian:
            raise InputError("AngularMomentum is for three dimensions and plane strain only.")
        one_of(self.axis, ("xyz" if len(kinematics.axes) == 3 else "z"), "The axis")
        k = "xyz".index(self.axis)
        i, j = (k + 1) % 3, (k + 2) % 3
        mine = _dofs(problem, i), _dofs(problem, j)
        here = tuple(_places(problem, a) for a in (i, j))
        unit = problem.scales.stress * problem.scales.volume

        def value() -> float:
            if problem.motion is None:
                return 0.0
            v = problem.motion.velocity[: problem.owned]
            heavy = np.zeros(problem.size)
            heavy[: problem.owned] = problem.massive().times(v)
            x, y = (X + problem.w.x.array[dofs] for X, dofs in zip(here, mine, strict=True))
            total = float(x @ heavy[mine[1]] - y @ heavy[mine[0]])
            return float(problem.comm.allreduce(total, op=MPI.SUM)) * unit

        return value


def _dofs(problem: Problem, a: int) -> np.ndarray:
    """Local degrees of freedom along an axis: of the nodes, then of points that carry a mass."""
    carriers = [part.dofs[a][part.meshed:] for part in problem.rigid.parts]
    return np.concatenate([problem.displacement[a].dofs, *carriers]).astype(np.int64)


def _places(problem: Problem, a: int) -> np.ndarray:
    """The undeformed coordinate of each of `_dofs`, dimensionless."""
    nodes = problem.displacement[a].space.tabulate_dof_coordinates()[:, a]
    carriers = [(part.centre + part.arms[part.meshed:])[:, a] for part in problem.rigid.parts]
    return np.concatenate([nodes, *carriers])
