"""What is measured at every accepted step, in SI units.

An observable is bound to a problem once and then measured at each step.  Its name in history.csv
is chosen by the user; the unit is appended by the run (``tip`` becomes ``tip_m``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.measure.charges import ElectrodeCharge, potential_of_unit_load
from dea_fenicsx.measure.holding import cut_parts, holding, holding_forces
from dea_fenicsx.measure.on_surfaces import (
    displacement_dofs,
    facets_once,
    group_names,
    label_of,
    surface_mean,
)
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.kernels import measure
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.scene.electrodes import Conducting
from dea_fenicsx.scene.kinematics import cofactor
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import known

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
    """Mean displacement along an axis, in m: int u_a dA / int dA, undeformed.

    `where` is a facet group, or several that are taken as one.
    """

    where: str | tuple[str, ...]
    axis: str
    unit = "m"

    def bind(self, problem: Problem) -> Measurement:
        mean = surface_mean(problem, self.where, self.axis, projected=False)
        return lambda: mean()[0] * problem.scales.length


@dataclass(frozen=True)
class LargestDisplacement:
    """Displacement of largest size along an axis among the nodes of a facet group, in m, signed.

    `where` is a facet group, or several that are taken as one.
    """

    where: str | tuple[str, ...]
    axis: str
    unit = "m"

    def bind(self, problem: Problem) -> Measurement:
        dofs = displacement_dofs(problem, self.where, self.axis)

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
            surface_mean(problem, where, self.axis, projected=True) for where in self.between
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
    """Deformed area of a facet group, or of several together, in m^2: int |cof(F) N| dA.

    In plane strain for the kinematics' depth.
    """

    where: str | tuple[str, ...]
    unit = "m2"

    def bind(self, problem: Problem) -> Measurement:
        device, kin = problem.scene.device, problem.scene.kinematics
        facets = facets_once(device, self.where)
        if kin.overall:
            raise InputError("Area is not measured in helical cells or generalised plane strain.")
        degree = problem.scene.elements.quadrature_of_surfaces
        ds = measure(device, [facets], degree, "ds")(0)
        x = ufl.SpatialCoordinate(problem.mesh)
        u = problem.space.symbolic(Role.MOTION, problem.w)
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

    Positive along the axis.  In plane strain it is the force on the kinematics' depth.  A plane of
    symmetry bears what acts on a rigid part that it cuts, and not the pressure of a cavity on
    itself.

    Parameters
    ----------
    where
        A facet group, or several that are taken as one, with each node counted once.  Groups that
        meet share the nodes of their common edge, and the force at these is part of the reaction
        of each: so single reactions do not add up to the load, but that of all groups together is
        it.
    axis
        The axis.
    """

    where: str | tuple[str, ...]
    axis: str
    unit = "N"

    def rows(self, problem: Problem) -> np.ndarray:
        """Owned degrees of freedom whose residuals add up to the reaction.  Collective."""
        dofs = displacement_dofs(problem, self.where, self.axis)
        dofs = dofs[dofs < problem.owned]
        if problem.conditions.pairs is not None:  # both ends of a helical cell are one place
            member = np.zeros(problem.owned, dtype=bool)
            member[dofs] = True
            dofs = np.flatnonzero(problem.conditions.pairs.join(member))
        ties = problem.conditions.ties
        if ties:  # a node of a periodic face bears what its partners bear, too
            dofs = ties.widen(dofs)
        held = problem.conditions.fixed_values.fixed[: problem.owned] | ties.held(problem.owned)
        dofs = dofs[held[dofs]]
        if problem.comm.allreduce(len(dofs), op=MPI.SUM) == 0:
            raise InputError(
                f"{label_of(self.where)!r} is not held along {self.axis}, so it has no reaction; "
                "name a group that a support or a prescribed displacement holds."
            )
        return dofs

    def bind(self, problem: Problem) -> Measurement:
        dofs = self.rows(problem)
        forces = holding_forces(problem)
        a = problem.scene.kinematics.axes.index(self.axis)
        cut = cut_parts(problem, dofs, a)
        others = np.setdiff1d(dofs, np.concatenate([np.empty(0), *(p.dofs[a] for p in cut)]))
        others = others.astype(np.int32)

        def value() -> float:
            residual = forces()
            total = problem.comm.allreduce(float(residual[others].sum()), op=MPI.SUM)
            total += sum(float(holding(problem, part, residual)[0][a]) for part in cut)
            return total * problem.scales.force

        return value


@dataclass(frozen=True)
class Charge:
    """Charge on an electrode in C: what does work with its voltage, -dPi/dV.

    On an ordinary electrode it is the whole charge, so that over all electrodes and grounds charges
    add up to 0.  On a tapered electrode each place counts by its share of the voltage.  A thin film
    has the charge of its own region alone, on its face at `end`; an electrode or a ground on one of
    its faces is the same conductor, and shows that face's charge again.  Where electrodes touch,
    each has an equal share of what lies on their common nodes.

    Parameters
    ----------
    electrode
        A name used in the scene's electrodes, or several, whose electrodes are then added up.
    """

    electrode: str | tuple[str, ...]
    unit = "C"

    def bind(self, problem: Problem) -> Measurement:
        named = [electrode_named(problem, name) for name in group_names(self.electrode)]
        charges = [ElectrodeCharge(problem, e) for e in {e.label: e for e in named}.values()]
        return lambda: sum(charge.of_state() for charge in charges)


@dataclass(frozen=True)
class Potential:
    """Potential of an electrode in V: its voltage if one is given, or what it floats at.

    Of a thin film it is that of the face at `end`, of a tapered electrode that before the taper.
    """

    electrode: str
    unit = "V"

    def bind(self, problem: Problem) -> Measurement:
        electrode = electrode_named(problem, self.electrode)
        if not electrode.floats:
            volts = electrode.given_volts
            return lambda: 0.0 + problem.factors.get(electrode.ramp, 0.0) * volts
        dofs = problem.conditions.electrode_dofs[electrode.label]
        volt = problem.scales.potential
        return lambda: _common(problem, problem.w.x.array[dofs]) * volt


@dataclass(frozen=True)
class Capacitance:
    """Charge of an electrode over its potential in F.

    The other electrodes are taken as they are: with all of them grounded this is the capacitance.
    Where the electrode's ramp is at 0, or its potential is, it is dQ/dV along that ramp while
    nothing moves: the limit of Q/V on the way there, if no other ramp has brought charge.
    """

    electrode: str
    unit = "F"

    def bind(self, problem: Problem) -> Measurement:
        electrode = electrode_named(problem, self.electrode)
        if not electrode.floats and not electrode.given_volts:
            raise InputError(
                f"Electrode {self.electrode!r} is grounded; name a driven electrode for its "
                "capacitance."
            )
        charge = ElectrodeCharge(problem, electrode)
        potential = Potential(self.electrode).bind(problem)

        def at_rest() -> float:
            psi = potential_of_unit_load(problem, electrode)
            if not electrode.floats:
                return charge.of(psi) / electrode.given_volts
            assert problem.potential is not None
            whole = np.zeros(problem.size)
            whole[problem.potential.dofs] = psi
            rise = _common(problem, whole[problem.conditions.electrode_dofs[electrode.label]])
            return charge.of(psi) / (rise * problem.scales.potential)

        def value() -> float:
            volts = potential()
            live = problem.factors[electrode.ramp] and volts
            return charge.of_state() / volts if live else at_rest()

        return value


def _common(problem: Problem, values: np.ndarray) -> float:
    """The value that all have in common, of which some ranks hold none.  Collective."""
    return next(float(v[0]) for v in problem.comm.allgather(values[:1]) if len(v))


def electrode_named(problem: Problem, name: str) -> Conducting:
    """An electrode of the scene by its label or one of its names."""
    for electrode in problem.scene.electrodes:
        if name in (electrode.label, *electrode.names):
            return electrode
    known(name, [e.label for e in problem.scene.electrodes], "electrode")
    raise AssertionError
