"""The forms of a problem: its residual, and other quantities that are integrated or evaluated."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property, partial
from typing import Any

import basix
import numpy as np
import ufl
from mpi4py import MPI
from ufl.corealg.traversal import unique_pre_traversal

from dea_fenicsx.mesh.device import one_sided
from dea_fenicsx.model.body_forces import Body
from dea_fenicsx.model.cavities import Cavities
from dea_fenicsx.model.charge_memory import LeakMemory
from dea_fenicsx.model.contact import Contacts
from dea_fenicsx.model.damage import Damages
from dea_fenicsx.model.heat import Temperatures
from dea_fenicsx.model.kernels import Kernel, kernels, measure
from dea_fenicsx.model.loads import Loads, Surface, loaded_sides
from dea_fenicsx.model.material_point import Deformation, MaterialPoint
from dea_fenicsx.model.memory import Memory
from dea_fenicsx.model.probe import Prober
from dea_fenicsx.model.rigid_parts import RigidPart
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.model.sheets import Sheets
from dea_fenicsx.model.terms import EnergyTerm, Term, terms_of
from dea_fenicsx.model.terms.base import Variation
from dea_fenicsx.model.terms.springs import SpringWork
from dea_fenicsx.model.touching_surfaces import TouchingSurface
from dea_fenicsx.model.unknowns import Unknowns
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import PETSc, dolfinx


class Forms:
    """All forms of a problem.

    Parameters
    ----------
    scene, scales, space
        The scene, its units, and its unknowns.
    cavities
        Its cavities.
    touching
        The surfaces that may touch an obstacle.
    springs, parts
        Terms of springs on rigid parts, and the rigid parts.

    Attributes
    ----------
    terms
        The terms of the energy and of the virtual work.
    kernels, points
        Regions that share one integral, and for each the fields at a point, symbolic.
    motion
        What the deformation has beside its fields, symbolic, or None.
    loads
        The loads on surfaces and the pre-stretches.
    contacts
        The surfaces that may touch an obstacle.
    residual
        The residual, symbolic.
    quadrature
        Quadrature points of the reference cell.
    compiled, prober
        The compiled residual, and what evaluates a state at the quadrature points; from `compile`.
    temperatures
        Temperatures at the quadrature points, from `compile`, too.
    damages
        What remembers the largest energies, from `compile`, too.
    cell_volumes, volume
        Volume of each owned cell, and of the whole device, dimensionless; from `compile`, too.
    incompressible_cells
        Owned cells of exactly incompressible regions, sorted.
    """

    compiled: Any
    prober: Prober
    memory: Memory
    leaks: LeakMemory
    temperatures: Temperatures
    damages: Damages
    cell_volumes: np.ndarray
    volume: float

    def __init__(
        self, scene: Scene, scales: Scales, space: Unknowns, cavities: Cavities,
        touching: Sequence[TouchingSurface] = (), springs: Sequence[SpringWork] = (),
        parts: Sequence[RigidPart] = (),
    ) -> None:  # fmt: skip
        device, kinematics, elements = scene.device, scene.kinematics, scene.elements
        mesh, degree, works = device.mesh, elements.quadrature_degree, scene.declared.surface_works
        self._mesh, self._owned, self._space = mesh, space.owned, space
        self._scales = scales
        self._weight = kinematics.weight(ufl.SpatialCoordinate(mesh))
        cell = getattr(basix.CellType, mesh.topology.cell_name())
        self.quadrature, _ = basix.make_quadrature(cell, degree)
        lead = dolfinx.fem.Constant(mesh, kinematics.lead(scales.length))
        self.motion = kinematics.global_motion(space.present.get("global"), lead)
        virtual_motion = kinematics.global_motion(space.virtual.get("global"), lead)

        self.terms: list[Term] = [*terms_of(scene), *springs]
        self.kernels: list[Kernel] = kernels(scene, scales, space.fields)
        soft = [kernel.cells for kernel in self.kernels if kernel.is_incompressible]
        self.incompressible_cells = np.sort(np.concatenate([np.empty(0, dtype=np.int32), *soft]))
        self._dx = measure(device, [k.cells for k in self.kernels], degree)
        self.sheets = Sheets(scene, scales, space, self.motion)
        sides = loaded_sides(works, device, scene.materials)
        along = [
            np.concatenate([one_sided(device, n) for n in names]) for names in self.sheets.names
        ]
        self.contacts = Contacts(scene, scales, space, touching, parts)
        # A form may hold one list of subdomains for all of its surfaces.
        pressed = [surface.facets for surface in touching]
        ds = measure(device, [*sides, *along, *cavities.facets, *pressed], degree, "ds")
        after = len(sides) + len(along) + len(cavities.facets)
        for number, contact in enumerate(self.contacts, after):
            contact.integrate_by(ds, number)
        # UFL objects that kernels share are walked over once for all of them
        deformed = Deformation.of(mesh, kinematics, space.present["u"], self.motion)
        self.points = [
            MaterialPoint(mesh, kinematics, k, scales.stress, space.present, deformed, self.motion)
            for k in self.kernels
        ]
        for point in self.points:
            point.energy = self._energy(point)
        beside = sum(self.integral(k, work) for k, work in self._works())
        at = Surface(
            kinematics, mesh, scales.stress, space.present["u"], space.virtual["u"], virtual_motion
        )
        self.loads = Loads([work for _, work in works], at, ds)
        for work in scene.declared.body_works:
            body = Body(scene, scales, space, virtual_motion)
            self.loads.add_body(work, self._everywhere(work.density(body)))
        self.residual = self._variation() - self.loads.work + beside
        self.residual -= self.loads.standing
        if self.sheets:
            self.residual += self.sheets.work(at.weight, ds, len(sides))
        if cavities:
            first = len(sides) + len(along)
            self.residual += cavities.work(space, self.motion, at, self.loads, ds, first)
        self._add_contacts()
        self._add_strains(springs)

    def _add_contacts(self) -> None:
        """Add the virtual work of contact forces, and the work of ramps that move an obstacle."""
        for contact in self.contacts:
            self.residual += contact.virtual_work(self._space)
            if ramp := contact.told.ramp:
                work = contact.work_of_travel(self._space)
                self.loads.add_travel(ramp, contact.factor, work)

    def _add_strains(self, springs: Sequence[SpringWork]) -> None:
        """Add the work of ramps that act in the energy: springs, pre-stretches, temperatures."""
        space = self._space
        for spring in springs:
            if spring.ramp is not None:
                rates = [spring.rate(point, self._virtual) for point in self.points]
                work = sum(self.integral(k, rate) for k, rate in enumerate(rates))
                self.loads.add_strain(spring.ramp, spring.factor, work)
        for k, point in enumerate(self.points):
            for ramp, rate in point.rates.items():
                work = -ufl.derivative(self.integral(k, rate), space.w, space.test)
                work -= self._following(k, partial(ufl.diff, v=point.strain_factors[ramp]))
                self.loads.add_strain(ramp, self.kernels[k].strain_factors[ramp], work)

    def compile(self) -> None:
        """Compile what every run evaluates: the residual, the probe and cell volumes.  Collective.

        It comes last, so that all that can be refused is refused before this long work.
        """
        mesh = self._mesh
        each = ufl.TestFunction(dolfinx.fem.functionspace(mesh, ("DG", 0)))
        volumes = sum(self.integral(k, each) for k in range(len(self.points)))
        swelling = sum(
            self.integral(k, (p.elastic_J - 1) * each) for k, p in enumerate(self.points)
        )
        compat.compile_together(
            self.residual, lambda: [*self._tangents(), swelling, volumes]
        )
        self.compiled = compat.compile_form(self.residual)
        self._swelling: Any = compat.compile_form(swelling)
        owned = mesh.topology.index_map(mesh.topology.dim).size_local
        self.cell_volumes = _cell_values(compat.compile_form(volumes))[:owned]
        self.volume = mesh.comm.allreduce(float(self.cell_volumes.sum()), op=MPI.SUM)
        for term in self.terms:
            term.settle(self.volume)
        self.prober = Prober(mesh, self.kernels, self.points, self.quadrature)
        self.temperatures = Temperatures(mesh, self.kernels, self.quadrature)
        self.memory = Memory(
            mesh, self.kernels, self.points, self.quadrature, self.temperatures
        )
        self.damages = Damages(mesh, self.kernels, self.points, self.quadrature)
        self.leaks = LeakMemory(mesh, self.kernels, self.points, self.quadrature, self._scales)
        self.sheets.compile(self._flux)
        self.contacts.frictions.compile()

    def _tangents(self) -> list[Any]:
        """The tangent as a matrix and as a product with a function, symbolic."""
        W = self._space.W
        return [self.tangent(way) for way in (ufl.TrialFunction(W), dolfinx.fem.Function(W))]

    def _flux(self, displacement: Any) -> Any:
        """The linear form of the flux of a nominal displacement, int T . Grad N dX."""
        return -sum(
            self.integral(k, ufl.dot(displacement, self._virtual(point.nominal_field)))
            for k, point in enumerate(self.points) if point.kernel.eps is not None
        )  # fmt: skip

    def integral(self, k: int, density: Any) -> Any:
        """The integral of a density over the regions of kernel k."""
        return density * self._weight * self._dx(k)

    def _everywhere(self, density: Any) -> Any:
        """The integral of a density over the device."""
        return sum(self.integral(k, density) for k in range(len(self.kernels)))

    def _energy(self, point: MaterialPoint) -> Any:
        """The sum of all terms of the energy that live on a point's kernel."""
        return _sum([term.density(point) for term in self._energies(point)])

    def _energies(self, point: MaterialPoint) -> list[EnergyTerm]:
        """The terms of the energy that live on a point's kernel."""
        alive = (term for term in self.terms if term.lives_on(point.kernel))
        return [term for term in alive if isinstance(term, EnergyTerm)]

    def _variation(self) -> Any:
        """The variation of the energy, without the terms that give their own; a linear form."""
        found = []
        for k, point in enumerate(self.points):
            terms = [t for t in self._energies(point) if t.work(point, self._virtual) is None]
            if terms:
                found.append(self.integral(k, _sum([t.density(point) for t in terms])))
        return ufl.derivative(sum(found), self._space.w, self._space.test)

    def _works(self) -> Iterator[tuple[int, Any]]:
        """Virtual work per undeformed volume that terms give themselves, by kernel."""
        for k, point in enumerate(self.points):
            for term in self.terms:
                if term.lives_on(point.kernel):
                    work = term.work(point, self._virtual)
                    if work is not None:
                        yield k, work

    def tangent(self, direction: Any) -> Any:
        """Derivative of the residual in a direction, a function or a trial function; symbolic."""
        w = self._space.w

        def change(expression: Any) -> Any:
            return ufl.derivative(expression, w, direction)

        found = change(self._varying)
        return found + sum(self._following(k, change) for k in range(len(self.points)))

    def compiled_tangent(self, along: Any = None) -> Any:
        """The tangent compiled, as a matrix or as its product with a function.  Collective.

        It follows from the residual alone, unless a term adds what follows the deformation.
        """
        way = ufl.TrialFunction(self._space.W) if along is None else along
        if any(type(term).following is not Term.following for term in self.terms):
            return compat.compile_form(self.tangent(way))
        how, beside = ("matrix", ()) if along is None else ("product", (along,))
        w, residual = self._space.w, self.residual
        return compat.compile_derived(residual, how, w, lambda: self.tangent(way), beside)

    @cached_property
    def _varying(self) -> Any:
        """The residual without integrals that do not depend on the state, such as dead loads.

        So scenes that differ by such loads alone share the code of their tangent.
        """
        w, integrals = self._space.w, self.residual.integrals()
        return ufl.Form([
            i for i in integrals if any(e is w for e in unique_pre_traversal(i.integrand()))
        ])

    def _following(self, k: int, change: Variation) -> Any:
        """Virtual work of kernel k due to coefficients that follow a change, symbolic, or 0."""
        point, total = self.points[k], 0
        for term in self.terms:
            if term.lives_on(point.kernel):
                found = term.following(point, change, self._virtual)
                total += 0 if found is None else self.integral(k, found)
        return total

    def _virtual(self, expression: Any) -> Any:
        """The virtual change of an expression in the fields."""
        return ufl.derivative(expression, self._space.w, self._space.test)

    @property
    def unsymmetric(self) -> list[str]:
        """Names of the terms and surface loads whose tangent is not symmetric."""
        return self._without([term.name for term in self.terms if not term.symmetric])

    @property
    def unsymmetric_at_once(self) -> list[str]:
        """The same where no time passes."""
        return self._without([term.name for term in self.terms if not term.symmetric_at_once])

    def _without(self, terms: list[str]) -> list[str]:
        """Names of terms, and of all loads and contacts whose tangent is not symmetric."""
        rubbing = [f"friction on {c.told.surface!r}" for c in self.contacts if c.friction]
        return [*terms, *self.loads.unsymmetric, *rubbing]

    @property
    def is_symmetric(self) -> bool:
        """Whether the tangent is symmetric, or is taken as such.

        A follower pressure has no potential where its surface has a free edge; the part of its
        tangent that is not symmetric is left out of the factor, not of the tangent itself.
        """
        return not self.unsymmetric

    def swelling(self) -> np.ndarray:
        """Change of volume int (J - 1) dX of each owned cell beyond its thermal expansion."""
        return _cell_values(self._swelling)[: len(self.cell_volumes)]

    def load_vector(self, ramp: str) -> np.ndarray:
        """Minus the forces of a ramp's surface loads at factor 1, at all owned unknowns."""
        form = compat.compile_form(-self.loads.unit_work[ramp])
        vector = dolfinx.fem.assemble_vector(form)
        vector.scatter_reverse(dolfinx.la.InsertMode.add)
        return np.asarray(vector.array[: self._owned])


def assembled(vector: Any, form: Any) -> np.ndarray:
    """Assemble a linear form into a ghosted vector; returns its owned values.  Collective."""
    with vector.localForm() as local:
        values = local.array_w
        values[:] = 0.0
        compat.add_assembled(values, form)
    vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    return np.asarray(vector.array_r)


def _sum(densities: Sequence[Any]) -> Any:
    """The sum of some densities, without a 0 in front of it."""
    total = densities[0]
    for density in densities[1:]:
        total = total + density
    return total


def _cell_values(form: Any) -> np.ndarray:
    """Assemble a linear form over cell-wise constants; each rank's own cells are complete."""
    return np.asarray(dolfinx.fem.assemble_vector(form).array.copy())
