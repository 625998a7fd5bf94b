"""What is measured at every accepted step, in SI units.

An observable is bound to a problem once and then measured at each step.  Its name in history.csv
is chosen by the user; the unit is appended by the run (``tip`` becomes ``tip_m``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx import compat
from dea_fenicsx.compat import dolfinx
from dea_fenicsx.conditions import Ground, ThinFilm
from dea_fenicsx.errors import InputError
from dea_fenicsx.forms import measure
from dea_fenicsx.kinematics import cofactor
from dea_fenicsx.mesh import one_sided
from dea_fenicsx.scene import known
from dea_fenicsx.weakform import Problem

Measurement = Callable[[], float]


class Observable(Protocol):
    """Something to be measured: its unit suffix, and how it is bound to a problem.

    A run is resumed only if it gives the same value on the last state as before; one that measures
    anything else than the state has an attribute ``of_the_state = False``.
    """

    unit: str

    def bind(self, problem: Problem) -> Measurement:
        """Check names and prepare; the result is called, on all ranks, at each step."""
        ...


@dataclass(frozen=True)
class MeanDisplacement:
    """Mean displacement of a facet group along an axis, in m: int u_a dA / int dA, undeformed."""

    where: str
    axis: str
    unit = "m"

    def bind(self, problem: Problem) -> Measurement:
        mean = _surface_mean(problem, self.where, self.axis, projected=False)
        return lambda: mean()[0] * problem.scales.length


@dataclass(frozen=True)
class LargestDisplacement:
    """Displacement of largest size along an axis among the nodes of a facet group, in m, signed."""

    where: str
    axis: str
    unit = "m"

    def bind(self, problem: Problem) -> Measurement:
        dofs = _displacement_dofs(problem, self.where, self.axis)

        def value() -> float:
            u = problem.w.x.array[dofs]
            mine = float(u[np.argmax(np.abs(u))]) if len(u) else 0.0
            return max(problem.comm.allgather(mine), key=abs) * problem.scales.length

        return value


@dataclass(frozen=True)
class MeanStretch:
    """Mean stretch between two facet groups along an axis: 1 + (u_2 - u_1)/(x_2 - x_1).

    Means are weighted by the area projected on the axis, so that for a device between the two
    groups this is the volume mean of the displacement gradient plus 1, whatever their shape.
    """

    between: tuple[str, str]
    axis: str
    unit = ""

    def bind(self, problem: Problem) -> Measurement:
        first, second = (
            _surface_mean(problem, where, self.axis, projected=True) for where in self.between
        )
        if abs(second()[1] - first()[1]) < 1e-12:
            raise InputError(
                f"{self.between[0]!r} and {self.between[1]!r} lie at the same {self.axis}; a "
                "stretch needs two groups at a distance."
            )

        def value() -> float:
            (u1, x1), (u2, x2) = first(), second()
            return 1 + (u2 - u1) / (x2 - x1)

        return value


@dataclass(frozen=True)
class Contraction:
    """Loss of height between two facet groups relative to the height, 1 - `MeanStretch`."""

    between: tuple[str, str]
    axis: str
    unit = ""

    def bind(self, problem: Problem) -> Measurement:
        stretch = MeanStretch(self.between, self.axis).bind(problem)
        return lambda: 1 - stretch()


@dataclass(frozen=True)
class Area:
    """Deformed area of a facet group in m^2: int |cof(F) N| dA.

    In plane strain for the kinematics' depth.
    """

    where: str
    unit = "m2"

    def bind(self, problem: Problem) -> Measurement:
        device, kin = problem.scene.device, problem.scene.kinematics
        known(self.where, device.surfaces, "facet group")
        if kin.overall:
            raise InputError("Area is not measured in helical cells or generalised plane strain.")
        ds = measure(device, [one_sided(device, self.where)], 4, "ds")(0)
        x = ufl.SpatialCoordinate(problem.mesh)
        u = ufl.split(problem.w)[0]
        F = ufl.Identity(3) + kin.displacement_gradient(u, x)
        area = ufl.dot(cofactor(F)[0], kin.embed(ufl.FacetNormal(problem.mesh)))
        form = compat.compile_form(ufl.sqrt(ufl.dot(area, area)) * kin.weight(x) * ds)
        unit = problem.scales.volume / problem.scales.length

        def value() -> float:
            mine = float(np.real(dolfinx.fem.assemble_scalar(form)))
            return problem.comm.allreduce(mine, op=MPI.SUM) * unit

        return value


@dataclass(frozen=True)
class Reaction:
    """Force in N that holds a facet group along an axis, from the residual at its fixed nodes.

    Positive along the axis.  In plane strain it is the force on the kinematics' depth.
    """

    where: str
    axis: str
    unit = "N"

    def bind(self, problem: Problem) -> Measurement:
        dofs = _displacement_dofs(problem, self.where, self.axis)
        dofs = dofs[(dofs < problem.owned) & problem.constraints.fixed[dofs]]
        if problem.comm.allreduce(len(dofs), op=MPI.SUM) == 0:
            raise InputError(
                f"{self.where!r} is not held along {self.axis}, so it has no reaction; name a "
                "group that a support or a prescribed displacement holds."
            )

        def value() -> float:
            total = float(problem.residual()[dofs].sum())
            return problem.comm.allreduce(total, op=MPI.SUM) * problem.scales.force

        return value


@dataclass(frozen=True)
class Charge:
    """Charge on an electrode in C, from the residual of the potential at its nodes.

    Parameters
    ----------
    electrode
        A name used in the scene's electrodes.
    """

    electrode: str
    unit = "C"

    def bind(self, problem: Problem) -> Measurement:
        dofs = _electrode(problem, self.electrode)
        weights: np.ndarray | float = 1.0
        named = [e for e in problem.scene.electrodes if self.electrode in (e.label, *e.names)]
        if isinstance(named[0], ThinFilm) and named[0].volts:
            # work-conjugate to the voltage: -dPi/dV
            volt = named[0].volts / problem.scales.potential
            weights = problem.constraints.base[named[0].ramp][dofs] / volt

        def value() -> float:
            total = -float((weights * problem.residual()[dofs]).sum())
            return problem.comm.allreduce(total, op=MPI.SUM) * problem.scales.charge

        return value


@dataclass(frozen=True)
class Potential:
    """Potential of an electrode in V, given or floating."""

    electrode: str
    unit = "V"

    def bind(self, problem: Problem) -> Measurement:
        dofs = _electrode(problem, self.electrode)
        count = problem.comm.allreduce(len(dofs), op=MPI.SUM)

        def value() -> float:
            total = float(problem.w.x.array[dofs].sum())
            return problem.comm.allreduce(total, op=MPI.SUM) / count * problem.scales.potential

        return value


@dataclass(frozen=True)
class Capacitance:
    """Charge of an electrode over its potential in F; NaN at zero voltage.

    The other electrodes are taken as they are: with all of them grounded this is the capacitance.
    """

    electrode: str
    unit = "F"
    may_be_undefined = True

    def bind(self, problem: Problem) -> Measurement:
        charge = Charge(self.electrode).bind(problem)
        named = [e for e in problem.scene.electrodes if self.electrode in (e.label, *e.names)]
        electrode = named[0]
        if electrode == Ground(electrode.where):
            raise InputError(
                f"Electrode {self.electrode!r} is grounded; name a driven electrode for its "
                "capacitance."
            )

        potential = Potential(self.electrode).bind(problem)

        def value() -> float:
            volts = potential()
            return charge() / volts if volts else float("nan")

        return value


def _electrode(problem: Problem, name: str) -> np.ndarray:
    """Owned degrees of freedom of an electrode, by its label or one of its names."""
    for electrode in problem.scene.electrodes:
        if name in (electrode.label, *electrode.names):
            dofs = problem.electrode_dofs[electrode.label]
            return dofs[dofs < problem.owned]
    known(name, [e.label for e in problem.scene.electrodes], "electrode")
    raise AssertionError


def _axis(problem: Problem, axis: str) -> int:
    axes = problem.scene.kinematics.axes
    if axis not in tuple(axes):
        raise InputError(f"The axis is {axis!r}, but must be one of {', '.join(axes)}.")
    return axes.index(axis)


def _displacement_dofs(problem: Problem, where: str, axis: str) -> np.ndarray:
    """Local degrees of freedom of a displacement component on a facet group.  Collective."""
    device = problem.scene.device
    part = problem.displacement[_axis(problem, axis)]
    known(where, device.surfaces, "facet group")
    return part.dofs[part.on(device.dim - 1, device.facets_of(where))]


def _surface_mean(
    problem: Problem, where: str, axis: str, projected: bool
) -> Callable[[], tuple[float, float]]:
    """Means of u_a and X_a over a facet group; weighted by the normal's component if projected.

    The mean of u is a scalar product with a vector assembled once.
    """
    a = _axis(problem, axis)
    device = problem.scene.device
    known(where, device.surfaces, "facet group")
    ds = measure(device, [one_sided(device, where)], 4, "ds")(0)
    x = ufl.SpatialCoordinate(problem.mesh)
    weight = problem.scene.kinematics.weight(x)
    kinematics = problem.scene.kinematics
    if projected and axis not in tuple(kinematics.coordinates):
        raise InputError(
            f"The axis is {axis!r}, but must be one of {', '.join(kinematics.coordinates)}."
        )
    along = kinematics.coordinates.find(axis)  # -1 where the mesh does not go
    if projected:
        weight = weight * ufl.FacetNormal(problem.mesh)[along]
    v = ufl.split(ufl.TestFunction(problem.W))[0]

    def total(integrand: Any) -> float:
        mine = dolfinx.fem.assemble_scalar(compat.compile_form(integrand * ds))
        return float(np.real(problem.comm.allreduce(mine, op=MPI.SUM)))

    one = dolfinx.fem.Constant(problem.mesh, 1.0)
    area = total(one * weight)
    if abs(area) < 1e-14:
        raise InputError(
            f"Facet group {where!r} has no area facing {axis}; name a group that faces that axis."
        )
    position = total(x[along] * weight) / area if projected else 0.0
    vector = dolfinx.fem.assemble_vector(compat.compile_form(v[a] * weight * ds))
    vector.scatter_reverse(dolfinx.la.InsertMode.add)
    weights = vector.array[: problem.owned] / area

    def mean() -> tuple[float, float]:
        mine = float(weights @ problem.w.x.array[: problem.owned])
        return problem.comm.allreduce(mine, op=MPI.SUM), position

    return mean
