"""What is measured where a surface touches an obstacle: force, area, pressure and gap."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.measure.observables import Measurement, group_names, label_of
from dea_fenicsx.model.contact import Contact
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import known, one_of


@dataclass(frozen=True)
class ContactForce:
    """Force in N with which obstacles act on a surface along an axis, int (f dg/dx + t)_a dA.

    It is that of the contact pressure and of friction.

    In plane kinematics it is the force on the kinematics' depth, in axisymmetry that on the full
    circle.

    Parameters
    ----------
    where
        A facet group of an `Obstacle`, or several; all obstacles at them are added up.
    axis
        The axis, one of the components of the displacement.
    """

    where: str | tuple[str, ...]
    axis: str
    unit = "N"

    def bind(self, problem: Problem) -> Measurement:
        kinematics = problem.scene.kinematics
        axes = kinematics.axes
        one_of(self.axis, tuple(axes), "The axis")
        if (kinematics.axis_of_rotation and self.axis != "z") or kinematics.overall:
            raise InputError(
                f"The contact force on {label_of(self.where)!r} along {self.axis!r} is 0 or has no "
                f"meaning in {kinematics.title or 'these kinematics'}; measure ContactPressure or "
                "ContactArea."
            )
        component = 2 if kinematics.axis_of_rotation else axes.index(self.axis)
        forms = [
            contact.integral(contact.traction[component])
            for contact in contacts_at(problem, self.where)
        ]
        return _integral(problem, sum(forms), problem.scales.force)


@dataclass(frozen=True)
class FrictionWork:
    """Energy in J that friction on obstacles has turned into heat since the start of the path.

    Parameters
    ----------
    where
        A facet group of an `Obstacle` with friction, or several.
    """

    where: str | tuple[str, ...]
    unit = "J"

    def bind(self, problem: Problem) -> Measurement:
        rubbing = [one.friction for one in contacts_at(problem, self.where) if one.friction]
        if not rubbing:
            raise InputError(
                f"The obstacle at {label_of(self.where)!r} has no friction; give it friction=, or "
                "leave FrictionWork out."
            )
        places = [problem.frictions.index(one) for one in rubbing]

        def value() -> float:
            mine = sum(float(problem.rubbed.spent[k].sum()) for k in places)
            unit = problem.scales.force * problem.scales.length
            return problem.comm.allreduce(mine, op=MPI.SUM) * unit

        return value


@dataclass(frozen=True)
class ContactArea:
    """Deformed area in m^2 of the part of a surface on which obstacles press.

    In plane strain for the kinematics' depth.  The edge of the part is found to within the distance
    of the points of integration.

    Parameters
    ----------
    where
        A facet group of an `Obstacle`, or several.
    """

    where: str | tuple[str, ...]
    unit = "m2"

    def bind(self, problem: Problem) -> Measurement:
        _refuse_cells(problem, self)
        normal = ufl.FacetNormal(problem.mesh)
        forms = [
            contact.integral(ufl.conditional(contact.touches, contact.area(normal), 0))
            for contact in contacts_at(problem, self.where)
        ]
        return _integral(problem, sum(forms), problem.scales.volume / problem.scales.length)


@dataclass(frozen=True)
class ContactPressure:
    """Largest true contact pressure in Pa: force per deformed area, at the points of integration.

    Parameters
    ----------
    where
        A facet group of an `Obstacle`, or several.
    """

    where: str | tuple[str, ...]
    unit = "Pa"

    def bind(self, problem: Problem) -> Measurement:
        _refuse_cells(problem, self)
        points = [contact.points for contact in contacts_at(problem, self.where)]

        def value() -> float:
            found = [one.values() for one in points]
            mine = max(float(np.max(one.pushed / one.area, initial=0.0)) for one in found)
            return problem.comm.allreduce(mine, op=MPI.MAX) * problem.scales.stress

        return value


@dataclass(frozen=True)
class ContactGap:
    """Smallest gap in m between a surface and its obstacles at the points of integration.

    It is negative where a point is in an obstacle, which the tolerance of the `Obstacle` bounds.

    Parameters
    ----------
    where
        A facet group of an `Obstacle`, or several.
    """

    where: str | tuple[str, ...]
    unit = "m"

    def bind(self, problem: Problem) -> Measurement:
        points = [contact.points for contact in contacts_at(problem, self.where)]

        def value() -> float:
            mine = min(float(np.min(one.values().gap, initial=np.inf)) for one in points)
            return problem.comm.allreduce(mine, op=MPI.MIN) * problem.scales.length

        return value


def contacts_at(problem: Problem, where: str | tuple[str, ...]) -> list[Contact]:
    """The contacts of one facet group or several.

    Raises
    ------
    InputError
        If there is no obstacle at one of them.
    """
    found = []
    for name in group_names(where):
        known(name, problem.scene.device.surfaces, "facet group")
        here = [contact for contact in problem.forms.contacts if contact.told.surface == name]
        if not here:
            raise InputError(
                f"There is no obstacle at {name!r}; add Obstacle({name!r}, ...) to the supports, "
                "or name a surface that has one."
            )
        found += here
    return found


def _integral(problem: Problem, form: Any, unit: float) -> Callable[[], float]:
    """How to measure an integral over surfaces.  Collective."""
    compiled = compat.compile_form(form)

    def value() -> float:
        mine = float(np.real(dolfinx.fem.assemble_scalar(compiled)))
        return problem.comm.allreduce(mine, op=MPI.SUM) * unit

    return value


def _refuse_cells(problem: Problem, what: object) -> None:
    if problem.scene.kinematics.overall:
        raise InputError(
            f"{type(what).__name__} is not measured in helical cells or generalised plane strain."
        )
