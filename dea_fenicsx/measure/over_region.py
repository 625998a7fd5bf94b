"""Means, extremes and integrals over regions: of named quantities, and of any expression.

Everything is evaluated at the quadrature points of the cells, where the energy is integrated and
the extremes of each step are taken.  A mean is the integral over the undeformed volume, divided by
this volume; the largest and smallest values are those at the quadrature points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, get_args

import basix
import numpy as np
import ufl
from mpi4py import MPI
from ufl.algorithms import extract_arguments

from dea_fenicsx.measure.observables import Measurement, group_names
from dea_fenicsx.measure.point_in_si import PointInSI
from dea_fenicsx.measure.quantity import (
    QUANTITY_UNITS,
    LocalQuantity,
    axis_numbers,
    check_field,
    entries_of,
    needs_field,
    reduced,
    tensor_of,
    unit_of,
)
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.support import compat
from dea_fenicsx.support.agreement import together
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.validation import known, one_of

Taken = Literal["mean", "max", "min", "integral"]
"""What is taken of the values in a region."""

Entries = Callable[[int], list[Any]]
"""Gives the symbolic entries to be evaluated in the cells of a kernel, by its number."""


@dataclass(frozen=True)
class OverRegion:
    """The mean, an extreme or the integral of a quantity over regions.

    Parameters
    ----------
    what
        ``"displacement"``, ``"potential"``, ``"pressure"``, ``"stretch"``, ``"stress"`` or
        ``"field"`` as in `AtPoint`, or ``"J"``, the volume per undeformed volume.
    take
        ``"mean"`` over the undeformed volume, ``"max"``, ``"min"``, or ``"integral"`` over the
        undeformed volume, whose unit is that of the quantity times m^3.
    axis
        The axis or axes as in `AtPoint`.  Where it is left out, a displacement and a field are
        taken by their size, and a stretch is the largest principal one.
    regions
        A region or several, each counted once; None takes all in which the quantity has a value.

    Raises
    ------
    InputError
        When it is bound: for a region that there is not, or in which the quantity has no value.
    """

    what: LocalQuantity
    take: Taken = "mean"
    axis: str | None = None
    regions: str | tuple[str, ...] | None = None

    @property
    def unit(self) -> str:
        """The unit of the quantity, times m^3 for an integral."""
        unit = QUANTITY_UNITS.get(self.what, "")
        return unit if self.take != "integral" else f"{unit}_m3" if unit else "m3"

    def bind(self, problem: Problem) -> Measurement:
        one_of(self.what, get_args(LocalQuantity), "What OverRegion measures")
        one_of(self.take, get_args(Taken), "What OverRegion takes (take=)")
        kinematics = problem.scene.kinematics
        axes = axis_numbers(kinematics, self.what, self.axis, "OverRegion", sizes=True)
        told = f"The {self.what} over {shown(self.regions or 'all regions')}"
        check_field(problem, self.what, told)

        def entries(k: int) -> list[Any]:
            if needs_field(self.what) and problem.kernels[k].eps is None:
                return []
            return entries_of(tensor_of(self.what, problem.states[k]))

        samples = Samples(problem, self.regions, entries, told)
        unit = unit_of(self.what, problem.scales)
        return samples.measurement(self.take, lambda v: reduced(self.what, axes, v) * unit)


@dataclass(frozen=True)
class Expression:
    """The mean, an extreme or the integral of an expression of your own over regions.

    ``dea.Expression(lambda at: at.J, "max")`` is the largest volume per undeformed volume, and
    ``dea.Expression(lambda at: ufl.tr(at.stress), unit="Pa", regions="film")`` the mean trace of
    the Cauchy stress in one region.

    Parameters
    ----------
    value
        A function of a place in the body, whose fields are symbolic and in SI units, see
        `PointInSI`; it returns a scalar of UFL, or a number.
    take, regions
        As in `OverRegion`; a region without a field has the field 0.
    unit
        The unit of what is taken, for the name of the column: ``"Pa"``, for an integral
        ``"Pa_m3"``; empty for a pure number.

    Raises
    ------
    InputError
        When it is bound: if the function fails, or returns something else.
    """

    value: Callable[[PointInSI], Any]
    take: Taken = "mean"
    regions: str | tuple[str, ...] | None = None
    unit: str = ""

    def bind(self, problem: Problem) -> Measurement:
        one_of(self.take, get_args(Taken), "What Expression takes (take=)")
        if not callable(self.value):
            raise InputError(
                f"The value of Expression is {shown(self.value)}, but must be a function of a "
                "place, as in Expression(lambda at: at.J)."
            )

        def entries(k: int) -> list[Any]:
            at = PointInSI(problem, k)
            return [together(problem.comm, lambda: self._scalar(at), "The value of Expression")]

        samples = Samples(problem, self.regions, entries, "An Expression")
        return samples.measurement(self.take, lambda v: v[..., 0])

    def _scalar(self, at: PointInSI) -> Any:
        """The symbolic value at a place."""
        try:
            found = ufl.as_ufl(self.value(at))
            right = found.ufl_shape == () and not extract_arguments(found)
        except Exception as error:  # the function is the user's own
            told = " ".join(str(error).split()).rstrip(".")
            raise InputError(
                f"The value of Expression cannot be formed ({type(error).__name__}: {told}); it "
                "must be a function of a place that returns a scalar of UFL, as in "
                "Expression(lambda at: at.J)."
            ) from error
        if not right:
            raise InputError(
                f"The value of Expression has the shape {found.ufl_shape}, but must be a scalar "
                "without test functions; take one component, a trace or a norm of it."
            )
        return found


@dataclass(frozen=True)
class CentreOfMass:
    """A coordinate of the centre of mass of the deformed body in m.

    It is int rho (X_a + u_a) dX / int rho dX, over the undeformed volume.

    Parameters
    ----------
    axis
        The axis: x, y or z in space, x or y in plane strain, z in axisymmetry.
    regions
        A region or several, each counted once; None takes all.
    densities
        Mass per undeformed volume of each region in kg/m^3; None takes those of the materials.
        Where no material has one, regions are all alike.  Air without a density weighs nothing.

    Raises
    ------
    InputError
        When it is bound: for an axis along which the kinematics has no such coordinate, and for a
        region without a density beside others that have one.
    """

    axis: str
    regions: str | tuple[str, ...] | None = None
    densities: dict[str, float] | None = None
    unit = "m"

    def bind(self, problem: Problem) -> Measurement:
        kinematics = problem.scene.kinematics
        axes = kinematics.coordinates if kinematics.cartesian else kinematics.coordinates[1:]
        if not kinematics.cartesian and kinematics.global_unknowns:
            raise InputError("CentreOfMass is not measured in helical cells, which have no end.")
        one_of(self.axis, tuple(axes), "The axis of CentreOfMass")
        a = kinematics.coordinates.index(self.axis)
        x = ufl.SpatialCoordinate(problem.mesh)

        def entries(k: int) -> list[Any]:
            return [x[a] + problem.states[k].fields["u"][kinematics.axes.index(self.axis)]]

        samples = Samples(problem, self.regions, entries, "CentreOfMass")
        samples.weigh(self._densities(problem, samples.names))
        return samples.measurement("mean", lambda v: v[..., 0] * problem.scales.length)

    def _densities(self, problem: Problem, names: list[str]) -> dict[str, float]:
        if self.densities is None:
            return _of_materials(problem, names)
        for name in self.densities:
            known(name, problem.scene.materials, "region", "the scene")
        for name in names:
            density = self.densities.get(name)
            if density is None or not 0 < density < np.inf:
                raise InputError(
                    f"CentreOfMass: densities give {shown(density)} for the region {name!r}, but "
                    "must give a number > 0 in kg/m^3."
                )
        return self.densities


def _of_materials(problem: Problem, names: list[str]) -> dict[str, float]:
    """Densities of regions by their materials, or 1 for each where they are all alike.

    Raises
    ------
    InputError
        If one has none beside others that have one.
    """
    materials = problem.scene.materials
    bodies = [name for name in names if not materials[name].is_air] or names
    known_ones = {name: materials[name].density for name in bodies}
    lacking = sorted(name for name, density in known_ones.items() if density is None)
    if lacking and len(lacking) < len(bodies):
        raise InputError(
            f"CentreOfMass: the region {lacking[0]!r} has no density, but others have one; give "
            "Material(..., density=...) in kg/m^3, or densities=."
        )
    found = {name: materials[name].density or 0.0 for name in names}
    return found | dict.fromkeys(bodies, 1.0) if lacking else found


class Samples:
    """Symbolic entries, evaluated at all quadrature points of regions.

    Parameters
    ----------
    problem
        The problem.
    regions
        A region, several, or None for all.
    entries
        What is evaluated in the cells of each kernel; an empty list leaves the kernel out.
    told
        What is measured in words, for messages.

    Attributes
    ----------
    names
        The regions whose cells are evaluated.

    Raises
    ------
    InputError
        For a region that there is not, or that has no value.
    """

    def __init__(
        self, problem: Problem, regions: str | tuple[str, ...] | None, entries: Entries, told: str
    ) -> None:
        device = problem.scene.device
        self._problem = problem
        wanted = list(device.regions) if regions is None else list(group_names(regions))
        for name in wanted:
            known(name, problem.scene.materials, "region", "the scene")
        degree = problem.scene.elements.quadrature_degree
        kind = getattr(basix.CellType, problem.mesh.topology.cell_name())
        points, self._rule = basix.make_quadrature(kind, degree)
        x = ufl.SpatialCoordinate(problem.mesh)
        weight = problem.scene.kinematics.weight(x) * abs(ufl.JacobianDeterminant(problem.mesh))
        self.names: list[str] = []
        self._evaluated: list[tuple[np.ndarray, Callable]] = []
        for k, kernel in enumerate(problem.kernels):
            mine = [name for name in kernel.regions if name in wanted]
            found = entries(k) if mine else []
            if not found:
                continue
            self.names += mine
            chosen = np.concatenate([device.cells_of(name) for name in mine])
            evaluate = compat.expression(ufl.as_vector([*found, weight]), points)
            self._evaluated.append((np.intersect1d(kernel.cells, chosen), evaluate))
        lacking = [name for name in wanted if name not in self.names]
        if not self.names or (lacking and regions is not None):
            where = f"region {lacking[0]!r}" if regions is not None and lacking else "scene"
            raise InputError(f"{told} has no value: the {where} has no dielectric.")
        self._density: dict[str, float] = dict.fromkeys(self.names, 1.0)

    def weigh(self, densities: dict[str, float]) -> None:
        """Count each region by its density, in any one unit."""
        self._density = densities

    def measurement(self, take: str, value: Callable[[np.ndarray], np.ndarray]) -> Measurement:
        """What is taken of the values, in the present state.  Collective.

        Parameters
        ----------
        take
            One of `Taken`.
        value
            Gives the number at each point, shape (...), from the entries, shape (..., entries).
        """
        comm, mesh = self._problem.comm, self._problem.mesh
        unit = self._problem.scales.volume
        densities = [self._densities_of(cells) for cells, _ in self._evaluated]

        def taken() -> float:
            sums, low, high = np.zeros(2), np.inf, -np.inf
            for (cells, evaluate), density in zip(self._evaluated, densities, strict=True):
                if len(cells) == 0:
                    continue
                found = evaluate(mesh, cells)
                numbers = value(found[:, :, :-1])
                weights = found[:, :, -1] * self._rule * density[:, None]
                sums += [np.sum(weights * numbers), np.sum(weights)]
                low, high = np.minimum(low, np.min(numbers)), np.maximum(high, np.max(numbers))
            # MPI's own MIN and MAX may lose a NaN of one rank, so numpy compares.
            everyone = np.array(comm.allgather((low, high)))
            total, volume = comm.allreduce(sums, op=MPI.SUM)
            return float({
                "mean": total / volume, "integral": total * unit,
                "min": np.min(everyone[:, 0]), "max": np.max(everyone[:, 1]),
            }[take])  # fmt: skip

        return taken

    def _densities_of(self, cells: np.ndarray) -> np.ndarray:
        """The density in each of some owned cells."""
        found = np.zeros(len(cells))
        for name in self.names:
            found[np.isin(cells, self._problem.scene.device.cells_of(name))] = self._density[name]
        return found
