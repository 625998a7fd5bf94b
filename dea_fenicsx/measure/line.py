"""What a quantity is along a straight line of the undeformed device, and how the line bends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.measure.observables import Measurement
from dea_fenicsx.measure.point import AtPoint, place_with
from dea_fenicsx.measure.quantity import (
    NUMBER_OF_AXES,
    QUANTITY_UNITS,
    LocalQuantity,
    axis_numbers,
    check_field,
    entries_of,
    reduced,
    tensor_of,
    unit_of,
)
from dea_fenicsx.mesh.point_search import PointInMesh
from dea_fenicsx.model.cell_values import evaluated_at_each
from dea_fenicsx.model.components import Component
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import is_finite, known, one_of, whole

TakenAlong = Literal["mean", "max", "min"]
"""What is taken of the values along a line."""

Values = Callable[[], np.ndarray]
"""Gives one number, or several, for each point of a line, on all ranks."""


@dataclass(frozen=True)
@in_si(start="m", end="m")
class AlongLine:
    """A quantity along a straight line of the undeformed device: the same material line always.

    As an observable it gives one number: the mean, the largest or the smallest value.  All of the
    values are given by `profile`, and by `columns` as one column of the history for each point.

    Parameters
    ----------
    start, end
        Undeformed ends of the line in m, one coordinate for each of the mesh's.
    what
        A quantity as in `OverRegion`.
    axis
        The axis or axes as in `OverRegion`.
    take
        ``"mean"``, ``"max"`` or ``"min"``; the mean is that over the undeformed length, by the
        trapezium rule.
    points
        Number of points, which lie at equal distances, both ends included.
    region
        A region whose cells alone are looked at, as in `AtPoint`.

    Raises
    ------
    InputError
        When it is bound, if one of the points lies outside of the mesh or of the region.
    """

    start: tuple[float, ...]
    end: tuple[float, ...]
    what: LocalQuantity
    axis: str | None = None
    take: TakenAlong = "mean"
    points: int = 51
    region: str | None = None

    @property
    def unit(self) -> str:
        """The unit of the quantity."""
        return QUANTITY_UNITS.get(self.what, "")

    def bind(self, problem: Problem) -> Measurement:
        one_of(self.take, get_args(TakenAlong), "What AlongLine takes (take=)")
        values = self._values(problem)

        def taken() -> float:
            found = values()
            if self.take == "mean":
                return float(np.mean((found[1:] + found[:-1]) / 2))
            return float(np.max(found) if self.take == "max" else np.min(found))

        return taken

    def profile(self, problem: Problem) -> tuple[np.ndarray, np.ndarray]:
        """The quantity at each point in the present state of a problem.  Collective.

        Parameters
        ----------
        problem
            The problem, such as ``run.problem`` of a finished run.

        Returns
        -------
        tuple of two ndarrays of shape (points,)
            Distance from the start along the undeformed line in m, and the values in the unit of
            the quantity.
        """
        found = self._values(problem)()
        return np.linspace(0, _length(self.start, self.end), len(found)), found

    def columns(self, name: str) -> dict[str, AtPoint]:
        """An observable for each point, as in ``record={**line.columns("w"), ...}``.

        Parameters
        ----------
        name
            What their names begin with; ``"w"`` gives w_000, w_001 and so on along the line.
        """
        whole(self.points, "The number of points of AlongLine", 2)
        if self.what == "J" or (self.axis is None and NUMBER_OF_AXES.get(self.what, 0)):
            raise InputError(
                f"AlongLine gives no columns of {shown(self.what)} without an axis; name one, or "
                "take the values by profile(run.problem)."
            )
        places = np.linspace(np.array(self.start, float), np.array(self.end, float), self.points)
        return {
            f"{name}_{k:03d}": AtPoint(
                tuple(map(float, place)), self.what, self.axis, self.region  # type: ignore[arg-type]
            )
            for k, place in enumerate(places)
        }  # fmt: skip

    def _values(self, problem: Problem) -> Values:
        one_of(self.what, get_args(LocalQuantity), "What AlongLine measures")
        told = f"The {self.what} along the line"
        line = _line(self, problem)
        check_field(problem, self.what, told)
        axes = axis_numbers(problem.scene.kinematics, self.what, self.axis, "AlongLine", sizes=True)
        unit = unit_of(self.what, problem.scales)
        places = [_place(problem, x, self.what, self.region) for x in line]
        if self.what in ("displacement", "potential"):
            parts: list[Component] = problem.displacement
            if self.what == "potential":
                assert problem.potential is not None
                parts = [problem.potential]
            entries = _nodal(problem, places, line, parts)
        else:
            entries = _derived(problem, places, self.what)
        return lambda: reduced(self.what, axes, entries()) * unit


@dataclass(frozen=True)
@in_si(start="m", end="m")
class Curvature:
    """Mean curvature of a material line in 1/m that is straight in the undeformed device.

    It is the angle by which the deformed line turns from its start to its end, over its deformed
    length, from chords between points at equal undeformed distances; it is exact for a circle.  In
    plane kinematics and in axisymmetry it is positive where the line turns counter-clockwise, from
    x to y or from r to z.

    Parameters
    ----------
    start, end
        Undeformed ends of the line in m, one coordinate for each of the mesh's.
    about
        In space the axis about which the line turns by the right-hand rule, for a signed value;
        None gives the size of the curvature.
    points
        Number of points, both ends included; at least 3.
    region
        A region whose cells alone are looked at.

    Raises
    ------
    InputError
        When it is bound, if one of the points lies outside of the mesh or of the region.
    """

    start: tuple[float, ...]
    end: tuple[float, ...]
    about: str | None = None
    points: int = 21
    region: str | None = None
    unit = "per_m"

    def bind(self, problem: Problem) -> Measurement:
        kinematics = problem.scene.kinematics
        if kinematics.axes != kinematics.coordinates:
            raise InputError(
                "Curvature is measured in space, in plane strain and in axisymmetry, but not in "
                "helical cells."
            )
        line = _line(self, problem, least=3)
        flat = kinematics.dim == 2
        if flat and self.about is not None:
            raise InputError(
                f"Curvature is about {shown(self.about)}, but in a plane all lines turn about its "
                "normal; leave about= out."
            )
        if self.about is not None:
            one_of(self.about, ("x", "y", "z"), "The axis of Curvature (about=)")
        places = [_place(problem, x, "displacement", self.region) for x in line]
        moved = _nodal(problem, places, line, problem.displacement)
        length = problem.scales.length

        def value() -> float:
            x = np.zeros((len(line), 3))
            x[:, : line.shape[1]] = line + moved() * length
            turned = _mean_turning(x)
            if flat:
                return float(turned[2])
            return float(turned["xyz".index(self.about)] if self.about else np.linalg.norm(turned))

        return value


def _mean_turning(x: np.ndarray) -> np.ndarray:
    """Mean of the curvature times the unit normal of its circle over a line of points, shape (3,).

    Two chords of lengths a and b at an angle d have the curvature 2 sin(d/2) over (a + b)/2.
    """
    chords = np.diff(x, axis=0)
    sizes = np.linalg.norm(chords, axis=1)
    t = chords / sizes[:, None]
    half = np.linalg.norm(t[1:] + t[:-1], axis=1) / 2  # cos(d/2)
    turns = np.cross(t[:-1], t[1:]) / np.maximum(half, 1e-300)[:, None]
    return np.asarray(turns.sum(axis=0) / np.sum((sizes[1:] + sizes[:-1]) / 2))


def _length(start: tuple[float, ...], end: tuple[float, ...]) -> float:
    return float(np.linalg.norm(np.subtract(end, start)))


def _line(item: AlongLine | Curvature, problem: Problem, least: int = 2) -> np.ndarray:
    """The points of a line in m, shape (points, dim), after a check of what the user gives."""
    owner, names = type(item).__name__, tuple(problem.scene.kinematics.coordinates)
    for what, point in (("start", item.start), ("end", item.end)):
        if len(point) != len(names) or not all(map(is_finite, point)):
            raise InputError(
                f"The {what} of {owner} is {shown(point)}, but must be {len(names)} finite "
                f"coordinates in m: {', '.join(names)}."
            )
    whole(item.points, f"The number of points of {owner}", least)
    if not _length(item.start, item.end) > 0:
        raise InputError(f"The start and the end of {owner} are one point; give two.")
    if item.region is not None:
        known(item.region, problem.scene.materials, "region", "the scene")
    return np.linspace(np.array(item.start, float), np.array(item.end, float), item.points)


def _place(problem: Problem, x: np.ndarray, what: str, region: str | None) -> PointInMesh:
    told = f"The {what} at {shown(tuple(float(c) for c in x))} on the line"
    return place_with(problem, x, what, region, told)


def _nodal(
    problem: Problem, places: list[PointInMesh], line: np.ndarray, parts: list[Component]
) -> Values:
    """Dimensionless values of components of the unknowns at places, shape (points, parts)."""
    mine = np.array([k for k, p in enumerate(places) if p.cell >= 0], dtype=int)
    cells = np.array([places[k].cell for k in mine], dtype=np.int32)
    points = np.zeros((len(mine), 3))
    points[:, : line.shape[1]] = line[mine] / problem.scales.length
    alone = [dolfinx.fem.Function(part.space) for part in parts]

    def values() -> np.ndarray:
        found = np.zeros((len(places), len(parts)))
        for a, (part, function) in enumerate(zip(parts, alone, strict=True)):
            function.x.array[:] = problem.w.x.array[part.dofs]
            if len(mine):
                found[mine, a] = function.eval(points, cells).reshape(len(mine))
        # each number lives on one rank, so that the sum is exact
        return np.asarray(problem.comm.allreduce(found, op=MPI.SUM))

    return values


def _derived(problem: Problem, places: list[PointInMesh], what: str) -> Values:
    """Dimensionless entries of a tensor at places, shape (points, entries)."""
    comm = problem.comm
    kernel_of = np.full(len(places), -1)
    for k, kernel in enumerate(problem.kernels):
        held = [p.cell >= 0 and p.cell in kernel.cells for p in places]
        kernel_of[held] = k
    comm.Allreduce(MPI.IN_PLACE, kernel_of, MPI.MAX)
    evaluated: list[tuple[np.ndarray, np.ndarray, np.ndarray, Any]] = []
    size = 0
    for k, kernel in enumerate(problem.kernels):
        here = np.flatnonzero(kernel_of == k)
        if not len(here):
            continue
        entries = entries_of(tensor_of(what, problem.states[k]))
        size = len(entries)
        references = np.array([places[i].reference for i in here])
        evaluate = evaluated_at_each(
            ufl.as_vector(entries), kernel, references, problem.forms.quadrature
        )
        which = np.array([i for i, j in enumerate(here) if places[j].cell >= 0], dtype=int)
        cells = np.array([places[here[i]].cell for i in which], dtype=np.int32)
        evaluated.append((here[which], cells, which, evaluate))

    def values() -> np.ndarray:
        found = np.zeros((len(places), size))
        for rows, cells, which, evaluate in evaluated:
            found[rows] = evaluate(problem.mesh, cells, which)
        return np.asarray(comm.allreduce(found, op=MPI.SUM))

    return values

