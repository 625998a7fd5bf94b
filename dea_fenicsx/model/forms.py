"""The forms of a problem: its residual, and other quantities that are integrated or evaluated."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import basix
import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.model.kernels import Kernel, kernels, measure
from dea_fenicsx.model.loads import Loads
from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.model.memory import Memory
from dea_fenicsx.model.probe import Prober
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.model.terms import EnergyTerm, Term, WorkTerm, terms_of
from dea_fenicsx.model.unknowns import Unknowns
from dea_fenicsx.scene.kinematics import GlobalMotion
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import PETSc, dolfinx


class Forms:
    """All forms of a problem.

    Parameters
    ----------
    scene, scales, space
        The scene, its units, and its unknowns.

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
    residual
        The residual, symbolic.
    quadrature
        Quadrature points of the reference cell.
    prober
        Evaluates a state at the quadrature points.
    cell_volumes, volume
        Volume of each owned cell, and of the whole device, dimensionless.
    incompressible_cells
        Owned cells of exactly incompressible regions, sorted.
    """

    def __init__(self, scene: Scene, scales: Scales, space: Unknowns) -> None:
        mesh, kinematics = scene.device.mesh, scene.kinematics
        degree = scene.elements.quadrature_degree
        self._space, self._kinematics = space, kinematics
        self._lead = dolfinx.fem.Constant(mesh, kinematics.lead(scales.length))
        self.terms: list[Term] = terms_of(scene)
        self.kernels: list[Kernel] = kernels(scene, scales, space.fields)
        fields, self.motion = self._split(space.w)
        self.points = [self._point(scene, k, scales, fields) for k in self.kernels]
        weight = kinematics.weight(ufl.SpatialCoordinate(mesh))
        dx = measure(scene.device, [k.cells for k in self.kernels], degree)

        def integral(k: int, density: Any) -> Any:
            """The integral of a density over a kernel's regions."""
            return density * weight * dx(k)

        test = ufl.TestFunction(space.W)
        energy = sum(integral(k, p.energy) for k, p in enumerate(self.points))
        virtual, virtual_motion = self._split(test)
        self.loads = Loads(scene, scales.stress, fields["u"], virtual["u"], virtual_motion)
        self.residual = ufl.derivative(energy, space.w, test) - self.loads.work
        for k, work in self._works(space.w, test):
            self.residual += integral(k, work)
        for k, point in enumerate(self.points):
            for ramp, rate in point.rates.items():
                work = -ufl.derivative(integral(k, rate), space.w, test)
                self.loads.add_strain(ramp, self.kernels[k].prestretch[ramp][0], work)
        self.compiled: Any = compat.compile_form(self.residual)
        cell = getattr(basix.CellType, mesh.topology.cell_name())
        self.quadrature, _ = basix.make_quadrature(cell, degree)
        self.memory = Memory(mesh, self.kernels, self.points, self.quadrature)
        self.prober = Prober(mesh, self.kernels, self.points, self.quadrature)
        self._measure_cells(scene, integral)
        if self.memory:
            self.memory.weigh(self.cell_volumes, scene.materials, scene.device.cells_of)

    def _split(self, function: Any) -> tuple[dict[str, Any], GlobalMotion | None]:
        """The fields of a mixed function or test function by name, and its global motion."""
        fields = self._space.split(function)
        return fields, self._kinematics.global_motion(fields.get("global"), self._lead)

    def _point(
        self, scene: Scene, kernel: Kernel, scales: Scales, fields: dict[str, Any]
    ) -> MaterialPoint:
        """The fields of a kernel, with the sum of all terms that live there."""
        point = MaterialPoint(scene, kernel, scales, fields, self.motion)
        energies = (term for term in self.terms if isinstance(term, EnergyTerm))
        densities = [term.density(point) for term in energies if term.lives_on(kernel)]
        total = densities[0]
        for density in densities[1:]:
            total = total + density
        point.close(total)
        return point

    def _works(self, w: Any, test: Any) -> Iterator[tuple[int, Any]]:
        """Virtual work per undeformed volume that is no variation of an energy, by kernel."""

        def virtual(expression: Any) -> Any:
            return ufl.derivative(expression, w, test)

        for k, (kernel, point) in enumerate(zip(self.kernels, self.points, strict=True)):
            for term in self.terms:
                if isinstance(term, WorkTerm) and term.lives_on(kernel):
                    yield k, term.work(point, virtual)

    @property
    def unsymmetric(self) -> list[str]:
        """Names of the terms and surface loads whose tangent is not symmetric."""
        terms = [term.name for term in self.terms if not term.symmetric]
        return [*terms, *self.loads.unsymmetric]

    @property
    def is_symmetric(self) -> bool:
        """Whether the tangent is symmetric, or is taken as such.

        A follower pressure has no potential where its surface has a free edge; the part of its
        tangent that is not symmetric is left out of the factor, not of the tangent itself.
        """
        return not self.unsymmetric

    def _measure_cells(self, scene: Scene, integral: Callable[[int, Any], Any]) -> None:
        device = scene.device
        cellwise = ufl.TestFunction(dolfinx.fem.functionspace(device.mesh, ("DG", 0)))
        self._swelling: Any = compat.compile_form(
            sum(integral(k, (p.J - 1) * cellwise) for k, p in enumerate(self.points))
        )
        volumes = compat.compile_form(
            sum(integral(k, cellwise) for k in range(len(self.points)))
        )
        self.cell_volumes = _cell_values(volumes)[: device.owned_cells()]
        self.volume: float = device.comm.allreduce(float(self.cell_volumes.sum()), op=MPI.SUM)
        soft = [kernel.cells for kernel in self.kernels if kernel.is_incompressible]
        self.incompressible_cells = np.sort(np.concatenate([np.empty(0, dtype=np.int32), *soft]))

    def swelling(self) -> np.ndarray:
        """Change of volume int (J - 1) dX of each owned cell, dimensionless."""
        return _cell_values(self._swelling)[: len(self.cell_volumes)]

    def load_vector(self, ramp: str) -> np.ndarray:
        """Minus the forces of a ramp's surface loads at factor 1, at all owned unknowns."""
        form = compat.compile_form(-self.loads.unit_work[ramp])
        vector = dolfinx.fem.assemble_vector(form)
        vector.scatter_reverse(dolfinx.la.InsertMode.add)
        return np.asarray(vector.array[: self._space.owned])


def assembled(vector: Any, form: Any) -> np.ndarray:
    """Assemble a linear form into a ghosted vector; returns its owned values.  Collective."""
    with vector.localForm() as local:
        local.set(0.0)
    dolfinx.fem.petsc.assemble_vector(vector, form)
    vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    return np.asarray(vector.array_r)


def _cell_values(form: Any) -> np.ndarray:
    """Assemble a linear form over cell-wise constants; each rank's own cells are complete."""
    return np.asarray(dolfinx.fem.assemble_vector(form).array.copy())
