"""What is measured of a cavity: its pressure, its volume, and the energy of its gas."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from dea_fenicsx.measure.observables import Measurement, group_names, label_of
from dea_fenicsx.model.cavities import Gas
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError


@dataclass(frozen=True)
class CavityPressure:
    """Pressure in a cavity above that outside, in Pa.

    Parameters
    ----------
    where
        A wall of the cavity, or all of them.
    """

    where: str | tuple[str, ...]
    unit = "Pa"

    def bind(self, problem: Problem) -> Measurement:
        number = _cavity(problem, self.where, self)
        cavities = problem.cavities
        name = cavities.fillings[number].pressure_field
        dofs = cavities.unknown(number, name, problem.space.parts)
        comm, pascal = problem.comm, problem.scales.stress

        def value() -> float:
            # Only ranks with cells at the walls hold the pressure.
            mine = problem.w.x.array[dofs[:1]]
            return float(next(v for v in comm.allgather(mine) if len(v))[0]) * pascal

        return value


@dataclass(frozen=True)
class CavityVolume:
    """Deformed volume of a cavity in m^3, without its reservoir.

    Parts that are not meshed belong to it as `Cavity` says.  With planes of symmetry it is the part
    on this side of them, in plane strain it is for the kinematics' depth.

    Parameters
    ----------
    where
        A wall of the cavity, or all of them.
    """

    where: str | tuple[str, ...]
    unit = "m3"

    def bind(self, problem: Problem) -> Measurement:
        number = _cavity(problem, self.where, self)
        volume = _volume(problem, number)
        return lambda: volume() * problem.scales.volume


@dataclass(frozen=True)
class CavityEnergy:
    """Energy in J that the gas of a cavity and the outside have taken up from the walls.

    It is minus the work that the present amount of gas does, against the outside, from the
    undeformed volume to the present one: int (p0 - p) dV.  So it falls as the gas expands.  Of a
    liquid, and of a given pressure, it is minus the present pressure times the change of volume.

    Parameters
    ----------
    where
        A wall of the cavity, or all of them.
    """

    where: str | tuple[str, ...]
    unit = "J"

    def bind(self, problem: Problem) -> Measurement:
        number = _cavity(problem, self.where, self)
        told = problem.cavities.fillings[number]
        volume, joule = _volume(problem, number), problem.scales.stress * problem.scales.volume
        if told.kind == "gas":
            gas = Gas.of(told, problem.scales)
            rigid = gas.volume - told.space.volume
            return lambda: (
                gas.stored(volume() + rigid, problem.factors[told.ramp]) * joule
            )
        pressure, pascal = CavityPressure(self.where).bind(problem), problem.scales.stress
        rest = told.space.volume
        return lambda: -pressure() / pascal * (volume() - rest) * joule


def _volume(problem: Problem, number: int) -> Measurement:
    """The dimensionless volume behind the walls of a cavity.  Collective."""
    cavities = problem.cavities
    form = compat.compile_form(cavities.change(number))
    rest = cavities.fillings[number].space.volume

    def value() -> float:
        mine = float(np.real(dolfinx.fem.assemble_scalar(form)))
        return rest + problem.comm.allreduce(mine, op=MPI.SUM)

    return value


def _cavity(problem: Problem, where: str | tuple[str, ...], item: object) -> int:
    """Number of the cavity that has some walls."""
    names = set(group_names(where))
    for k, told in enumerate(problem.cavities.fillings):
        if names <= set(told.space.label.split("+")):
            return k
    raise InputError(
        f"{type(item).__name__} of {label_of(where)!r} needs a cavity with these walls; add "
        f"Cavity({where!r}, ...) to the loads."
    )
