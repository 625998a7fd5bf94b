"""What is measured on a rigid part."""

from __future__ import annotations

from dataclasses import dataclass

from dea_fenicsx.measure.observables import Measurement
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.support.errors import InputError


@dataclass(frozen=True)
class PartRotation:
    """Angle of a rigid part in rad, counter-clockwise; several turns count.

    Parameters
    ----------
    where
        The facet group that is `Rigid`.
    """

    where: str
    unit = "rad"

    def bind(self, problem: Problem) -> Measurement:
        found = [part for part in problem.rigid.parts if part.name == self.where]
        if not found:
            raise InputError(
                f"PartRotation of {self.where!r} needs a rigid part; add Rigid({self.where!r}) to "
                "the supports."
            )
        part, comm = found[0], problem.comm

        def value() -> float:
            # a rank without cells does not hold the angle
            mine = problem.w.x.array[part.unknowns[-1][:1]]
            return float(next(v for v in comm.allgather(mine) if len(v))[0])

        return value
