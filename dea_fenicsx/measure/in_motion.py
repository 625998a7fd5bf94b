"""Observables of a body in motion: its kinetic energy and its momentum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from dea_fenicsx.measure.observables import Measurement
from dea_fenicsx.model.problem import Problem
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
