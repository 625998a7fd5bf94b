"""Energies of a device, the work of its loads, and the power that it turns into heat."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.measure.observables import Measurement, group_names
from dea_fenicsx.measure.rigid_part import work_on_parts
from dea_fenicsx.model.kernels import measure
from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.terms import EnergyTerm, Term
from dea_fenicsx.model.terms.softening import lost
from dea_fenicsx.model.terms.viscous import dissipation
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import known

CONTACT = "contact"
"""The name of what single points of contacts store, which is no energy of a region."""

LOADS = "loads"
"""The name of the work of loads, which is no energy of a region."""


@dataclass(frozen=True)
class Energy:
    """An energy in J: of the elastic body, of the electric field, of one term, or work of loads.

    In plane strain it is that of the kinematics' depth, in axisymmetry that of the full circle, in
    a helical cell that of one period over one full turn.

    Parameters
    ----------
    what
        ``"elastic"``
            The strain energy int W(F) dX, with what the volume's change stores: kappa/2 (J - 1)^2
            in a region with a bulk modulus kappa, and the augmentation of the elements, which is 0
            in the exact state.  A pre-stretch counts as strain.
        ``"electric"``
            The energy of the electric field, 1/2 int eps J |F^-T E|^2 dX.  It is positive, 1/2 C
            V^2 of a capacitor.  The energy whose minimum is the equilibrium at given voltages has
            the other sign here: it contains minus this energy, for it counts the batteries, too.
        ``"viscous"``
            The energy of the springs of viscous branches, which with the elastic energy of the
            equilibrium makes up what the body stores.
        ``"loads"``
            The work of the present loads on the present displacement, int t . u dA for a dead
            traction t: minus the loads' potential energy.  It is the work done so far by loads
            that are there from the beginning.  Of a load that grows with the displacement half of
            it has been done.  Axial forces and torques, and forces and moments on rigid parts, are
            counted; charges and voltages are not.
        ``"contact"``
            What deviations of the contact force from its mean around each vertex store at
            obstacles, int (f - p)^2/(2 r) dA.  It tends to 0 with the size of the cells; with it
            the energy is conserved exactly.
        The name of a term
            The energy of that term of the problem, see `model.terms`.
    regions
        A region or several, each counted once; None takes all.  Not for ``"loads"``
        and ``"contact"``.

    Raises
    ------
    InputError
        When it is bound: for an energy or a region that there is not, and for the work of loads
        that follow the deformation, since it depends on the path.

    Notes
    -----
    At given voltages V with charges Q and dead loads of factor f, whose work at f = 1 is A,

        d(elastic - electric - loads) = - sum Q dV - A df,

    exactly in the discrete problem, up to the tolerance of Newton's method; equally
    d(elastic + electric) = sum V dQ + f dA.  A prescribed displacement or pre-stretch that changes
    does work, too.
    """

    what: str
    regions: str | tuple[str, ...] | None = None
    unit = "J"

    def bind(self, problem: Problem) -> Measurement:
        if self.what == LOADS:
            return self._bind_loads(problem)
        if self.what == CONTACT and problem.forms.contacts:
            contacts = problem.forms.contacts
            return integral(problem, sum(one.integral(one.energy) for one in contacts))
        return integral(problem, self.form(problem))

    def form(self, problem: Problem) -> Any:
        """The energy of regions as a form, dimensionless, symbolic; not that of loads.

        Raises
        ------
        InputError
            For an energy or a region that there is not.
        """
        terms = self._terms(problem)

        def density(k: int, point: MaterialPoint) -> list[Any]:
            kernel = problem.kernels[k]
            found = [term.stored(point) for term in terms if term.lives_on(kernel)]
            return [one for one in found if one is not None]

        return over_regions(problem, self.regions, density)

    def _terms(self, problem: Problem) -> list[Term]:
        """The problem's terms that are part of this energy."""
        energies = [t for t in problem.forms.terms if isinstance(t, EnergyTerm) or t.stored_as]
        terms = [t for t in energies if any(map(t.lives_on, problem.kernels))]
        found = [t for t in terms if (t.stored_as or t.name) == self.what]
        found = found or [t for t in terms if t.name == self.what]
        if not found:
            names = [name for t in terms for name in (t.stored_as, t.name) if name]
            known(self.what, dict.fromkeys([*names, LOADS]), "energy", "the problem")
        return found

    def _bind_loads(self, problem: Problem) -> Measurement:
        """The work of dead loads, and of forces and torques on global unknowns."""
        scene = problem.scene
        if self.regions is not None:
            raise InputError(
                'Energy("loads") has no regions, for loads act on surfaces; leave regions= out.'
            )
        for load, work in scene.declared.surface_works:
            if work.follows and work.ramp:
                raise InputError(
                    f"The work of {type(load).__name__} on {work.surface!r} depends on the path, "
                    'since the load follows the deformation; Energy("loads") is for dead loads.'
                )
        if any(work.follows for work in scene.declared.body_works):
            raise InputError(
                "The work of Centrifugal depends on the path, since the force follows the device; "
                'Energy("loads") is for dead loads.'
            )
        on_surfaces: Measurement = lambda: 0.0  # noqa: E731
        if problem.loads.work != 0:
            # the virtual work of dead loads is linear, so it gives the work on w itself
            on_surfaces = integral(problem, ufl.action(problem.loads.work, problem.w))
        if problem.rigid.wandering:
            raise InputError(
                "The work of a moment on a part that turns freely in space depends on the path; "
                'Energy("loads") is for dead loads.'
            )
        period = scene.period if scene.kinematics.global_unknowns else 0.0
        forces = [force for _, force in scene.declared.global_forces]
        places = [scene.kinematics.global_unknowns.index(told.unknown) for told in forces]

        def value() -> float:
            total = on_surfaces()
            if forces:
                moved = problem.space.global_values(problem.scales.length) * period
                for told, k in zip(forces, places, strict=True):
                    total += problem.factors[told.ramp] * told.amount * float(moved[k])
            return total + work_on_parts(problem)

        return value


@dataclass(frozen=True)
class Dissipation:
    """The power in W that the dashpots of viscous branches turn into heat; never negative.

    Per undeformed volume it is the sum over the branches of

        mu/(2 tau) [tr(A A) - (tr A)^2 / 3],    A = Cbar C_v^-1,

    which is mu/(2 tau) times the square of the deviator of C_v^-1/2 Cbar C_v^-1/2.  For a
    `ViscousBranch` it is the square of the deviator of the branch's Kirchhoff stress over 2 eta.

    Parameters
    ----------
    regions
        A region or several, each counted once; None takes all.

    Raises
    ------
    InputError
        When it is bound: for a region that there is not.
    """

    regions: str | tuple[str, ...] | None = None
    unit = "W"

    def bind(self, problem: Problem) -> Measurement:
        def density(k: int, point: MaterialPoint) -> list[Any]:
            return [dissipation(point)] if problem.kernels[k].is_viscous else []

        return integral(problem, over_regions(problem, self.regions, density))


@dataclass(frozen=True)
class DamageLoss:
    """Energy in J that the softening of rubbers has taken for good, see `OgdenRoxburgh`.

    Parameters
    ----------
    regions
        Name of a region, or several; all if None.

    Raises
    ------
    InputError
        When it is bound: for a region that there is not.
    """

    regions: str | tuple[str, ...] | None = None
    unit = "J"

    def bind(self, problem: Problem) -> Measurement:
        def density(k: int, point: MaterialPoint) -> list[Any]:
            return [lost(point)] if problem.kernels[k].damage is not None else []

        return integral(problem, over_regions(problem, self.regions, density))


def over_regions(
    problem: Problem,
    regions: str | tuple[str, ...] | None,
    density: Callable[[int, MaterialPoint], list[Any]],
) -> Any:
    """The integral over regions of the densities that a kernel has there, symbolic."""
    device = problem.scene.device
    names = list(device.regions) if regions is None else group_names(regions)
    for name in names:
        known(name, problem.scene.materials, "region", "the scene")
    chosen = np.concatenate([device.cells_of(name) for name in names])
    cells = [np.intersect1d(kernel.cells, chosen) for kernel in problem.kernels]
    dx = measure(device, cells, problem.scene.elements.quadrature_degree)
    weight = problem.scene.kinematics.weight(ufl.SpatialCoordinate(problem.mesh))
    return sum(
        one * weight * dx(k)
        for k, point in enumerate(problem.states)
        for one in density(k, point)
    )


def integral(problem: Problem, form: Any) -> Measurement:
    """How to measure a dimensionless energy in the present state, in J.  Collective.

    A form of 0, where no part of the device has such an energy, gives 0.
    """
    compiled = compat.compile_form(form) if form != 0 else None
    unit = problem.scales.stress * problem.scales.volume

    def value() -> float:
        if compiled is None:
            return 0.0
        mine = float(np.real(dolfinx.fem.assemble_scalar(compiled)))
        return problem.comm.allreduce(mine, op=MPI.SUM) * unit

    return value
