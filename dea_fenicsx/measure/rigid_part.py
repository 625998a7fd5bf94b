"""What is measured on a rigid part: its displacement, its rotation, and what holds it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dea_fenicsx.measure.holding import holding, holding_forces
from dea_fenicsx.measure.observables import Measurement
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.rigid_parts import RigidPart
from dea_fenicsx.scene.rigid import check_axis, unit_vector
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import one_of


@dataclass(frozen=True)
class PartRotation:
    """Angle of a rigid part in rad, counter-clockwise; several turns count.

    In space it is the part of the rotation vector along an axis.  The direction of this vector is
    the axis of the rotation, and its length is the angle.  So it does not depend on an order of
    rotations.

    Parameters
    ----------
    where
        The name that is `Rigid`.
    about
        The axis, fixed in space: ``"x"``, ``"y"``, ``"z"`` or a direction.
    """

    where: str
    about: str | tuple[float, float, float] = "z"
    unit = "rad"

    def bind(self, problem: Problem) -> Measurement:
        part, about = _turning_part(self, problem)
        return lambda: float(about @ motion_of(problem, part)[1])


@dataclass(frozen=True)
class PartDisplacement:
    """Displacement of the centre of a rigid part along an axis, in m.

    Parameters
    ----------
    where
        The name that is `Rigid`.
    axis
        The axis.
    """

    where: str
    axis: str
    unit = "m"

    def bind(self, problem: Problem) -> Measurement:
        part, a = _part(self, problem), _axis(self, problem)
        return lambda: float(motion_of(problem, part)[0][a]) * problem.scales.length


@dataclass(frozen=True)
class PartForce:
    """Force in N with which its guide holds a rigid part along an axis; 0 where it moves freely.

    It is the force that the device needs at the part, less what `Force` and springs give.

    Parameters
    ----------
    where
        The name that is `Rigid`.
    axis
        The axis.
    """

    where: str
    axis: str
    unit = "N"

    def bind(self, problem: Problem) -> Measurement:
        part, a = _part(self, problem), _axis(self, problem)
        forces = holding_forces(problem)
        return lambda: float(holding(problem, part, forces())[0][a]) * problem.scales.force


@dataclass(frozen=True)
class PartMoment:
    """Moment in N m with which its guide holds a rigid part; 0 where it turns freely.

    It is taken about the centre of the part where it is now.

    Parameters
    ----------
    where
        The name that is `Rigid`.
    about
        The axis, fixed in space: ``"x"``, ``"y"``, ``"z"`` or a direction.
    """

    where: str
    about: str | tuple[float, float, float] = "z"
    unit = "N_m"

    def bind(self, problem: Problem) -> Measurement:
        part, about = _turning_part(self, problem)
        unit = problem.scales.force * problem.scales.length
        forces = holding_forces(problem)
        return lambda: float(about @ holding(problem, part, forces())[1]) * unit


def motion_of(problem: Problem, part: RigidPart) -> tuple[np.ndarray, np.ndarray]:
    """Displacement of a part's centre, dimensionless, and its rotation vector.  Collective.

    The displacement has one number for each axis, the rotation vector one for each rotation.  The
    centre is then at ``part.centre`` plus the displacement, and ``part.turning.matrix`` gives the
    rotation's matrix.
    """
    mine = part.values(problem.w.x.array) if len(part.unknowns[0]) else None
    # A rank without cells does not hold the unknowns.
    values = next(v for v in problem.comm.allgather(mine) if v is not None)
    return part.split(values)


def work_on_parts(problem: Problem) -> float:
    """Work of the present forces and moments on the present motion of rigid parts, in J.

    Collective.
    """
    total, factors = 0.0, problem.factors
    for part in problem.rigid.parts:
        c, psi = motion_of(problem, part)
        for load in problem.rigid.forces:
            if load.surface == part.name:
                moved = problem.scales.length * (np.array(load.newtons) @ c)
                total += factors[load.ramp] * float(moved)
        for turn in problem.rigid.moments:
            if turn.surface == part.name:
                angle = np.array(turn.about[-part.turning.count:]) @ psi
                total += factors[turn.ramp] * turn.newton_metres * float(angle)
    return total


def _part(item: Any, problem: Problem) -> RigidPart:
    """The rigid part that an observable names."""
    found = [part for part in problem.rigid.parts if part.name == item.where]
    if not found:
        raise InputError(
            f"{type(item).__name__} of {item.where!r} needs a rigid part; add Rigid({item.where!r})"
            " to the supports."
        )
    return found[0]


def _turning_part(item: Any, problem: Problem) -> tuple[RigidPart, np.ndarray]:
    """The rigid part that an observable names, and its axis as a vector of the part's rotations."""
    part = _part(item, problem)
    if not part.turning.count:
        raise InputError(
            f"{type(item).__name__} of {item.where!r}: a rigid part of an axisymmetric section "
            "does not turn; measure PartDisplacement or PartForce."
        )
    check_axis(item, problem.scene.kinematics)
    return part, np.array(unit_vector(item.about))[-part.turning.count :]


def _axis(item: Any, problem: Problem) -> int:
    """The number of the axis that an observable names."""
    kinematics = problem.scene.kinematics
    axes = tuple(kinematics.axes) if kinematics.cartesian else tuple(kinematics.axes[-1:])
    one_of(item.axis, axes, f"The axis of {type(item).__name__} of {item.where!r}")
    return kinematics.axes.index(item.axis)
