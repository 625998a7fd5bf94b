"""The mean force between periodic faces."""

from __future__ import annotations

from dataclasses import dataclass

from mpi4py import MPI

from dea_fenicsx.measure.observables import Measurement
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import one_of


@dataclass(frozen=True)
class PeriodicForce:
    """Force in N through one period of a body, along an axis: what holds its mean strain.

    It is the derivative of the energy by the difference of the displacements of two periodic faces,
    and so the mean nominal stress times the undeformed area of a face; positive where it pulls
    along the period, or shears towards the axis.  With a free mean strain it is 0.

    Parameters
    ----------
    between
        The two faces of a `Periodic`, in the same order.
    axis
        The axis of the force.
    """

    between: tuple[str, str]
    axis: str
    unit = "N"

    def bind(self, problem: Problem) -> Measurement:
        ties = problem.conditions.ties
        pairs = [(faces.told.first, faces.told.second) for faces in ties.faces]
        first, second = self.between
        if (first, second) not in pairs:
            raise InputError(
                f"PeriodicForce is between {first!r} and {second!r}, which are no periodic faces; "
                f"add Periodic({first!r}, {second!r}) to the supports."
            )
        axes = tuple(problem.scene.kinematics.axes)
        one_of(self.axis, axes, "The axis of PeriodicForce")
        dofs, weights = ties.weights(pairs.index((first, second)), axes.index(self.axis))

        def value() -> float:
            total = float(weights @ problem.residual()[dofs])
            return problem.comm.allreduce(total, op=MPI.SUM) * problem.scales.force

        return value
