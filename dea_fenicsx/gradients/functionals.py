"""Observables as functions of integrals over the device, which can be derived exactly.

An observable is J = g(I_1, I_2, ..., f) with integrals I_k of the state, each a form, and the
factors f of the ramps.  The derivatives of the forms are those of UFL.  Those of g are found by a
complex step, which is exact to rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import singledispatch
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.gradients.kept_forms import KeptForms
from dea_fenicsx.measure.axial import (
    OverallContraction,
    OverallForce,
    OverallStretch,
    OverallTorque,
    OverallTwist,
)
from dea_fenicsx.measure.charges import ElectrodeCharge
from dea_fenicsx.measure.contact import ContactArea
from dea_fenicsx.measure.currents import ChargeLoss, Current
from dea_fenicsx.measure.energy import CONTACT, LOADS, Dissipation, Energy
from dea_fenicsx.measure.in_motion import KineticEnergy, Momentum
from dea_fenicsx.measure.observables import (
    Area,
    Capacitance,
    Charge,
    Contraction,
    LargestDisplacement,
    MeanDisplacement,
    MeanStretch,
    Potential,
    Reaction,
    electrode_named,
    facets_once,
    group_names,
)
from dea_fenicsx.measure.over_region import Expression, OverRegion
from dea_fenicsx.measure.point_in_si import PointInSI
from dea_fenicsx.measure.vibration import Frequency, vibrations
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.kernels import measure
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.scene.declarations import ELONGATION, TWIST
from dea_fenicsx.scene.kinematics import cofactor
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError

COMPLEX_STEP = 1e-40
"""The step of the derivatives of g.  Its square vanishes beside 1, and nothing is subtracted."""

SHARED = 1e-6
"""Relative difference of two squares of frequencies that counts as none."""


@dataclass
class Functional:
    """An observable J = g(I, f).

    Attributes
    ----------
    forms
        The integrals I, symbolic and dimensionless, of the problem's present state.
    combine
        g, of the integrals and of the ramps' factors, which may be complex numbers.
    ramps
        The ramps of which g depends.
    rows
        For an observable that is a sum of residuals its weights over the owned degrees of freedom,
        in SI units: it depends on the loads through the residual.  Its form is that of `forms`.
    refresh
        Brings what the forms hold beside the state, such as a shape, to the present state.
    per_period
        Whether it is one over the height of a periodic cell, which a change of shape may alter.
    """

    forms: Sequence[Any]
    combine: Callable[[Sequence[Any], Mapping[str, Any]], Any]
    ramps: Sequence[str] = field(default_factory=tuple)
    rows: np.ndarray | None = None
    refresh: Callable[[], None] | None = None
    per_period: bool = False
    _slopes: list[Any] = field(default_factory=list, init=False)
    _weighted: list[Any] = field(default_factory=list, init=False)

    def value(self, problem: Problem, kept: KeptForms) -> float:
        """J on the mesh and in the state as they are.  Collective."""
        if self.refresh is not None:
            self.refresh()
        if self.rows is not None:
            return kept.total(self.rows @ problem.residual())
        values = [kept.value(form) for form in self.forms]
        return float(self.combine(values, problem.factors))

    def weighted(self, problem: Problem, kept: KeptForms) -> tuple[list[Any], dict[str, float]]:
        """Forms whose derivatives add up to those of J at fixed factors, and dJ/df.  Collective.

        They are (dg/dI_k) I_k with the present values of dg/dI_k.  Those over the same surfaces or
        regions are one form; a form cannot hold two lists of them.
        """
        if self.refresh is not None:
            self.refresh()
        values = [kept.value(form) for form in self.forms]
        factors = {name: float(value) for name, value in problem.factors.items()}
        if len(self._slopes) != len(self.forms):
            self._weigh(problem)
        for k, slope in enumerate(self._slopes):
            moved = [v + 1j * COMPLEX_STEP * (i == k) for i, v in enumerate(values)]
            slope.value = float(np.imag(self.combine(moved, factors)) / COMPLEX_STEP)
        by_load = {}
        for name in self.ramps:
            moved_factors = factors | {name: factors[name] + 1j * COMPLEX_STEP}
            by_load[name] = float(np.imag(self.combine(values, moved_factors)) / COMPLEX_STEP)
        if self.rows is not None:
            for name in problem.loads.unit_work:
                mine = float(self.rows @ problem.forms.load_vector(name))
                by_load[name] = problem.comm.allreduce(mine, op=MPI.SUM)
        return self._weighted, by_load

    def _weigh(self, problem: Problem) -> None:
        """Weigh the integrals by constants, which get their values at each state."""
        alike: dict[int, Any] = {}
        for form in self.forms:
            self._slopes.append(dolfinx.fem.Constant(problem.mesh, 0.0))
            place = id(form.integrals()[0].subdomain_data())
            weighted = self._slopes[-1] * form
            alike[place] = alike[place] + weighted if place in alike else weighted
        self._weighted = list(alike.values())


@singledispatch
def functional_of(observable: Any, problem: Problem) -> Functional | None:
    """The observable as a function of integrals; None for one that is not known as such.

    Raises
    ------
    InputError
        If the observable has no derivative.
    """
    return None


@functional_of.register
def _(observable: MeanDisplacement, problem: Problem) -> Functional:
    moment, area, _ = _means(problem, observable.where, observable.axis, projected=False)
    length = problem.scales.length
    return Functional([moment, area], lambda i, _: i[0] / i[1] * length)


@functional_of.register
def _(observable: MeanStretch, problem: Problem) -> Functional:
    first, second = observable.between
    forms = [
        *_means(problem, first, observable.axis, projected=True),
        *_means(problem, second, observable.axis, projected=True),
    ]

    def stretch(i: Sequence[Any], _: Any) -> Any:
        u1, x1 = i[0] / i[1], i[2] / i[1]
        u2, x2 = i[3] / i[4], i[5] / i[4]
        return 1 + (u2 - u1) / (x2 - x1)

    return Functional(forms, stretch)


@functional_of.register
def _(observable: Contraction, problem: Problem) -> Functional:
    found = functional_of(MeanStretch(observable.between, observable.axis), problem)
    assert found is not None
    stretch = found.combine
    return Functional(found.forms, lambda i, f: 1 - stretch(i, f))


@functional_of.register
def _(observable: Area, problem: Problem) -> Functional | None:
    kinematics = problem.scene.kinematics
    if kinematics.overall:
        return None
    device, degree = problem.scene.device, problem.scene.elements.quadrature_of_surfaces
    ds = measure(device, [facets_once(device, observable.where)], degree, "ds")(0)
    x = ufl.SpatialCoordinate(problem.mesh)
    u = problem.space.symbolic(Role.MOTION, problem.w)
    F = ufl.Identity(3) + kinematics.displacement_gradient(u, x)
    area = ufl.dot(cofactor(F)[0], kinematics.embed(ufl.FacetNormal(problem.mesh)))
    form = ufl.sqrt(ufl.dot(area, area)) * kinematics.weight(x) * ds
    unit = problem.scales.volume / problem.scales.length
    return Functional([form], lambda i, _: i[0] * unit)


@functional_of.register
def _(observable: Charge, problem: Problem) -> Functional | None:
    named = [electrode_named(problem, name) for name in group_names(observable.electrode)]
    if any(kernel.relaxation for kernel in problem.kernels):
        return None
    forms = [ElectrodeCharge(problem, e).form() for e in {e.label: e for e in named}.values()]
    unit = problem.scales.charge
    return Functional(forms, lambda i, _: sum(i) * unit)


@functional_of.register
def _(observable: Potential, problem: Problem) -> Functional | None:
    electrode = electrode_named(problem, observable.electrode)
    if electrode.floats:
        return None
    if electrode.ramp not in problem.factors:
        return Functional([], lambda _, f: 0.0)
    volts, ramp = electrode.given_volts, electrode.ramp
    return Functional([], lambda _, f: f[ramp] * volts, (ramp,))


@functional_of.register
def _(observable: Capacitance, problem: Problem) -> Functional | None:
    electrode = electrode_named(problem, observable.electrode)
    charge = functional_of(Charge(observable.electrode), problem)
    if electrode.floats or charge is None or not problem.factors[electrode.ramp]:
        return None
    whole, volts, ramp = charge.combine, electrode.given_volts, electrode.ramp
    return Functional(charge.forms, lambda i, f: whole(i, f) / (f[ramp] * volts), (ramp,))


@functional_of.register
def _(observable: Energy, problem: Problem) -> Functional | None:
    if observable.what in (LOADS, CONTACT):
        return None
    unit = problem.scales.stress * problem.scales.volume
    return Functional([observable.form(problem)], lambda i, _: i[0] * unit)


@functional_of.register
def _(observable: Reaction, problem: Problem) -> Functional | None:
    rows = observable.rows(problem)
    if problem.rigid or problem.cavities.on_planes != 0:
        return None
    return _of_rows(problem, rows, problem.scales.force)


@functional_of.register(OverallStretch)
@functional_of.register(OverallContraction)
@functional_of.register(OverallTwist)
def _(observable: Any, problem: Problem) -> Functional:
    observable.bind(problem)  # which refuses where there is none
    twist = isinstance(observable, OverallTwist)
    unknowns = problem.space.present["global"]
    one = unknowns[int(twist)] if unknowns.ufl_shape else unknowns
    dx = ufl.dx(domain=problem.mesh)
    forms = [one * dx, dolfinx.fem.Constant(problem.mesh, 1.0) * dx]
    offset, unit = {
        OverallStretch: (1.0, 1.0), OverallContraction: (0.0, -1.0),
        OverallTwist: (0.0, 1 / problem.scales.length),
    }[type(observable)]  # fmt: skip
    return Functional(forms, lambda i, _: offset + i[0] / i[1] * unit)


@functional_of.register(OverallForce)
@functional_of.register(OverallTorque)
def _(observable: Any, problem: Problem) -> Functional:
    observable.bind(problem)
    twist = isinstance(observable, OverallTorque)
    dofs = problem.overall[(TWIST if twist else ELONGATION).name].dofs
    scene, scales = problem.scene, problem.scales
    unit = scales.force * scales.length / scene.period
    rows = dofs[dofs < problem.owned]
    found = _of_rows(problem, rows, unit * (scales.length if twist else 1.0))
    return replace(found, per_period=True)


def _of_rows(problem: Problem, rows: np.ndarray, unit: float) -> Functional:
    """A sum of residuals as a form, the virtual work of a displacement that is 1 in its rows."""
    chosen = dolfinx.fem.Function(problem.W)
    chosen.x.array[rows] = 1.0
    chosen.x.scatter_forward()
    form = ufl.action(problem.forms.residual, chosen)
    weights = unit * chosen.x.array[: problem.owned]
    return Functional([form], lambda i, _: i[0] * unit, rows=weights)


def _means(
    problem: Problem, where: str | tuple[str, ...], axis: str, projected: bool
) -> tuple[Any, Any, Any]:
    """Integrals of u_a, 1 and X_a over a facet group, as `MeanStretch` weighs them; symbolic."""
    device, kinematics = problem.scene.device, problem.scene.kinematics
    degree = problem.scene.elements.quadrature_of_surfaces
    ds = measure(device, [facets_once(device, where)], degree, "ds")(0)
    x = ufl.SpatialCoordinate(problem.mesh)
    weight = kinematics.weight(x)
    along = kinematics.coordinates.find(axis)
    if projected:
        weight = weight * ufl.FacetNormal(problem.mesh)[along]
    u = problem.space.symbolic(Role.MOTION, problem.w)
    one = dolfinx.fem.Constant(problem.mesh, 1.0)
    a = kinematics.axes.index(axis)
    return u[a] * weight * ds, one * weight * ds, x[max(along, 0)] * weight * ds


@functional_of.register
def _(observable: Frequency, problem: Problem) -> Functional:
    observable.bind(problem)  # which refuses where there is none
    if problem.rigid or problem.springs.rows.size or not problem.forms.is_symmetric:
        _refuse(observable, "the scene has rigid parts, springs or a tangent without symmetry")
    solver, shape = NewtonSolver(problem), dolfinx.fem.Function(problem.W)
    k = observable.number

    def refresh() -> None:
        found = vibrations(solver, k + 2)
        gaps = [abs(found[k].square - found[j].square) for j in (k - 1, k + 1) if j >= 0]
        if min(gaps) < SHARED * abs(found[k].square):
            _refuse(observable, "two vibrations have this frequency, and change places")
        shape.x.array[:] = found[k].shape

    stiffness = ufl.action(problem.forms.tangent(shape), shape)
    density = problem.massive().density
    u = problem.space.symbolic(Role.MOTION, shape)
    degree = problem.scene.elements.quadrature_of_mass
    dx = ufl.Measure("dx", problem.mesh, metadata={"quadrature_degree": degree})
    weight = problem.scene.kinematics.weight(ufl.SpatialCoordinate(problem.mesh))

    def hertz(i: Sequence[Any], _: Any) -> Any:
        square = i[0] / i[1]  # Rayleigh's quotient, which is stationary at a vibration
        sign = np.sign(np.real(square))
        return sign * np.sqrt(sign * square) / (2 * np.pi)

    forms = [stiffness, density * ufl.inner(u, u) * weight * dx]
    return Functional(forms, hertz, refresh=refresh)


# ------------------------------------------------------------------------- what has no derivative


def _refuse(observable: Any, why: str) -> None:
    raise InputError(f"{type(observable).__name__} has no derivative here: {why}.")


@functional_of.register
def _(observable: LargestDisplacement, problem: Problem) -> None:
    _refuse(
        observable, "it jumps from one node to another where they move alike; record "
        "MeanDisplacement, or AtPoint at the node",
    )  # fmt: skip


@functional_of.register(OverRegion)
@functional_of.register(Expression)
def _(observable: Any, problem: Problem) -> Functional | None:
    if observable.take in ("min", "max"):
        _refuse(
            observable, f'the {observable.take} changes from one place to another; record the '
            '"mean" or the "integral", or AtPoint',
        )  # fmt: skip
    if isinstance(observable, OverRegion):
        return None
    observable.bind(problem)  # which refuses where there is none
    device = problem.scene.device
    names = None if observable.regions is None else group_names(observable.regions)
    parts = [
        [device.cells_of(name) for name in kernel.regions if names is None or name in names]
        for kernel in problem.kernels
    ]
    none = np.empty(0, dtype=np.int32)
    cells = [  # those of kernels are owned, so that none counts on two ranks
        np.intersect1d(kernel.cells, np.concatenate([none, *part]))
        for kernel, part in zip(problem.kernels, parts, strict=True)
    ]
    dx = measure(device, cells, problem.scene.elements.quadrature_degree)
    weight = problem.scene.kinematics.weight(ufl.SpatialCoordinate(problem.mesh))
    one = dolfinx.fem.Constant(problem.mesh, 1.0)
    chosen = [k for k, part in enumerate(parts) if part]
    value = sum(observable.value(PointInSI(problem, k)) * weight * dx(k) for k in chosen)
    if observable.take == "integral":
        unit = problem.scales.volume
        return Functional([value], lambda i, _: i[0] * unit)
    volume = sum(one * weight * dx(k) for k in chosen)
    return Functional([value, volume], lambda i, _: i[0] / i[1])


@functional_of.register
def _(observable: ContactArea, problem: Problem) -> None:
    _refuse(observable, "the area in contact grows in jumps, point by point")


@functional_of.register(Current)
@functional_of.register(ChargeLoss)
@functional_of.register(Dissipation)
@functional_of.register(KineticEnergy)
@functional_of.register(Momentum)
def _(observable: Any, problem: Problem) -> None:
    if not problem.time:
        _refuse(observable, "it belongs to a march, and this state to no time")
