"""What a field is at one point of the undeformed device."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
import ufl

from dea_fenicsx.measure.observables import Measurement
from dea_fenicsx.measure.quantity import (
    QUANTITY_UNITS,
    Quantity,
    axis_numbers,
    check_field,
    needs_field,
)
from dea_fenicsx.mesh.places import PLACE_TOLERANCE
from dea_fenicsx.mesh.point_search import PointInMesh, place_of
from dea_fenicsx.model.cell_values import evaluated_at
from dea_fenicsx.model.components import Component
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import is_finite, known, one_of


@dataclass(frozen=True)
@in_si(point="m")
class AtPoint:
    """A field at a point of the undeformed device: the same material point at all loads.

    Parameters
    ----------
    point
        Undeformed position in m, one coordinate for each of the mesh's: (x, y, z) in space, (x, y)
        in plane strain, (r, z) in axisymmetry and in a helical cell.
    what
        ``"displacement"``
            A component of the displacement in m, along `axis`: of a helical cell one of u_r,
            u_theta, u_z in the frame that turns with the section, as in `MeanDisplacement`.
        ``"potential"``
            The electric potential in V, in dielectrics and electrodes.
        ``"pressure"``
            Minus a third of the trace of the Cauchy stress in Pa, as in the fields of a run.
        ``"stretch"``
            The length of a material fibre along `axis`, over its length in the mesh as it is,
            which a pre-stretch has stretched before: |F e|.
        ``"stress"``
            A component of the Cauchy stress in Pa, electrostatic part included; `axis` names two
            axes, such as "xx" or "xz".
        ``"field"``
            A component of the true electric field in V/m, in dielectrics.
    axis
        The axis or axes.  Stresses, stretches and fields have three axes in all kinematics: x, y,
        z, or r, t, z with t along the hoop.
    region
        A region whose cells alone are looked at.  It matters at a boundary between two regions,
        where stresses and fields jump.

    Raises
    ------
    InputError
        When it is bound, if the point lies outside of the mesh or of the region.

    Notes
    -----
    A point that several cells share belongs to the one that comes first in the mesh file, so that
    the value is the same on any number of ranks.
    """

    point: tuple[float, ...]
    what: Quantity
    axis: str | None = None
    region: str | None = None

    @property
    def unit(self) -> str:
        """The unit of the quantity."""
        return QUANTITY_UNITS.get(self.what, "")

    def bind(self, problem: Problem) -> Measurement:
        indices = self._check(problem)
        point = np.array(self.point, dtype=float)
        place = place_with(problem, point, self.what, self.region, self._told())
        if self.what in ("displacement", "potential"):
            return self._nodal(problem, place, indices)
        return self._derived(problem, place, indices)

    def _told(self) -> str:
        """The observable in words, for messages."""
        along = f" along {self.axis}" if self.axis else ""
        return f"The {self.what}{along} at {shown(self.point)}"

    def _check(self, problem: Problem) -> list[int]:
        """Check all but the place; returns the numbers of the axes."""
        one_of(self.what, get_args(Quantity), "What AtPoint measures")
        kinematics = problem.scene.kinematics
        names = tuple(kinematics.coordinates)
        point = self.point
        if not isinstance(point, tuple | list | np.ndarray) or len(point) != len(names) or not all(
            map(is_finite, point)
        ):
            raise InputError(
                f"The point of AtPoint is {shown(point)}, but must be {len(names)} finite "
                f"coordinates in m: {', '.join(names)}."
            )
        if self.region is not None:
            known(self.region, problem.scene.materials, "region", "the scene")
        check_field(problem, self.what, self._told())
        return axis_numbers(kinematics, self.what, self.axis, "AtPoint")

    def _nodal(self, problem: Problem, place: PointInMesh, axes: list[int]) -> Measurement:
        """A component of the displacement, or the potential, from the values at a cell's nodes."""
        part: Component | None = problem.potential
        unit = problem.scales.potential
        if axes:
            part, unit = problem.displacement[axes[0]], problem.scales.length
        assert part is not None
        alone = dolfinx.fem.Function(part.space)  # made on all ranks, used on one
        nodes = part.space.dofmap.cell_dofs(place.cell) if place.cell >= 0 else []
        point = np.zeros(3)
        point[: len(self.point)] = np.array(self.point, dtype=float) / problem.scales.length

        def evaluate() -> float:
            alone.x.array[nodes] = problem.w.x.array[part.dofs[nodes]]
            return float(alone.eval(point, np.array([place.cell], dtype=np.int32))[0]) * unit

        return _from_owner(problem, place, evaluate)

    def _derived(self, problem: Problem, place: PointInMesh, axes: list[int]) -> Measurement:
        """A value that follows from gradients and a material."""
        mine = [k for k, kernel in enumerate(problem.kernels) if place.cell in kernel.cells]
        k = problem.comm.bcast(mine[0] if mine else -1, root=place.rank)
        at, unit = problem.states[k], problem.scales.stress
        if self.what == "stretch":
            tensor, unit = at.F, 1.0
        elif self.what == "field":
            tensor, unit = at.true_field, problem.scales.field
        else:
            tensor = problem.states[k].cauchy_stress
        entries = [tensor[i] for i in np.ndindex(tensor.ufl_shape)]
        found = evaluated_at(
            ufl.as_vector(entries), problem.kernels[k], place.reference, problem.forms.quadrature
        )
        cell = np.array([place.cell], dtype=np.int32)

        def evaluate() -> float:
            values = found(problem.mesh, cell).reshape(tensor.ufl_shape)
            if self.what == "stretch":
                return float(np.linalg.norm(values[:, axes[0]]))
            if self.what == "pressure":
                return -float(np.trace(values)) / 3 * unit
            return float(values[tuple(axes)]) * unit

        return _from_owner(problem, place, evaluate)


def place_with(
    problem: Problem, point: np.ndarray, what: str, region: str | None, told: str
) -> PointInMesh:
    """Where a quantity is measured.  Collective.

    Parameters
    ----------
    problem
        The problem.
    point
        Undeformed position in m, shape (dim,).
    what, region
        The quantity, and the region in whose cells alone it is looked for.
    told
        What is measured in words, for messages.

    Raises
    ------
    InputError
        If the point lies in no cell in which the quantity has a value.
    """
    cells, where = _cells_with(problem, what, region)
    place = place_of(problem.scene.device, point, cells)
    if place is None:
        raise InputError(f"{told} has no value: the scene has no {where}.")
    if place.distance > PLACE_TOLERANCE * problem.scene.device.length:
        raise InputError(
            f"{told} is at a point {place.distance:.3g} m outside of the {where}; give an "
            "undeformed position in metres inside of it."
        )
    kinematics = problem.scene.kinematics
    on_axis = abs(point[0]) < PLACE_TOLERANCE * problem.scene.device.length
    return _off_axis(place) if kinematics.axis_of_rotation and on_axis else place


def _off_axis(place: PointInMesh) -> PointInMesh:
    """A place on the axis of rotation, moved by a millionth of its cell into the cell.

    On the axis itself the hoop stretch u_r/r is 0/0.
    """
    dim = len(place.reference)
    inside = np.full(dim, 1 / (dim + 1))  # a point within triangles, and within squares, too
    return replace(place, reference=place.reference + 1e-6 * (inside - place.reference))


def _cells_with(problem: Problem, what: str, region: str | None) -> tuple[np.ndarray, str]:
    """The owned cells in which a quantity has a value, and what they are in words."""
    scene = problem.scene
    device = scene.device
    alive = dict.fromkeys(n for k in problem.kernels if k.eps is not None for n in k.regions)
    names, where = list(scene.materials), "mesh"
    if needs_field(what):
        held = [name for e in scene.electrodes for name in e.names if name in device.regions]
        names = [*alive, *(held if what == "potential" else [])]
        where = "dielectrics" + (" and electrodes" if what == "potential" else "")
    if region is not None:
        where = f"region {region!r}" + (f" of {where}" if where != "mesh" else "")
        names = [name for name in names if name == region]
    found = [device.cells_of(name) for name in dict.fromkeys(names)]
    cells = np.unique(np.concatenate([np.empty(0, dtype=np.int32), *found]))
    return cells[cells < device.owned_cells()], where


def _from_owner(problem: Problem, place: PointInMesh, evaluate: Callable[[], float]) -> Measurement:
    """A measurement that one rank makes and tells the others.  Collective."""

    def value() -> float:
        mine = evaluate() if problem.comm.rank == place.rank else 0.0
        return float(problem.comm.bcast(mine, root=place.rank))

    return value
