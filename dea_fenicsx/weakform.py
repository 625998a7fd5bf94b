"""From a scene to unknowns, residual and tangent.

One mixed function w = (u, p, phi) holds everything, fixed values included.  Boundary values are
put into w before anything is assembled, so increments vanish there and no lifting is needed; the
linear systems are in the free unknowns only.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import basix
import basix.ufl
import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx import compat
from dea_fenicsx.cells import check_cells
from dea_fenicsx.compat import PETSc, dolfinx
from dea_fenicsx.conditions import ChargedElectrode, DeadPressure, FollowerPressure
from dea_fenicsx.constraints import (
    Component,
    Constraints,
    Floating,
    apply_electrodes,
    apply_supports,
)
from dea_fenicsx.errors import InputError
from dea_fenicsx.forms import Scales, cauchy_stress, kernels, measure, state
from dea_fenicsx.kinematics import cofactor
from dea_fenicsx.mesh import one_sided
from dea_fenicsx.rigid import check_rigid
from dea_fenicsx.scene import SIMPLICES, Scene


@dataclass(frozen=True)
class Probe:
    """Extreme values over all quadrature points.

    Attributes
    ----------
    min_J : smallest det F
    min_margin : smallest distance to chain lock-up (1 where there is none)
    max_field : largest true electric field, dimensionless
    place : undeformed position of the largest field, dimensionless, shape (3,)
    """

    min_J: float
    min_margin: float
    max_field: float
    place: np.ndarray

    @property
    def admissible(self) -> bool:
        """Whether every energy is defined; False for NaN as well."""
        return self.min_J > 0 and self.min_margin > 0


class Problem:
    """The discrete problem of a scene.

    Attributes
    ----------
    w
        The mixed function (u, p, phi), dimensionless.
    scales
        SI value of each dimensionless unit.
    factors
        Current factor of each ramp.
    fields
        For each field, ``"u"``, ``"p"`` and if there is one ``"phi"``, its owned local degrees of
        freedom.
    free
        Owned local degrees of freedom that are unknowns, sorted.
    electrode_dofs
        Owned and ghost degrees of freedom of each electrode, by its label.
    load_factors
        Factor of each ramp that carries loads, as a constant of the form.
    incompressible_cells
        Owned cells of exactly incompressible regions, sorted.
    """

    def __init__(self, scene: Scene) -> None:
        check_cells(scene.device, scene.elements.quadrature_degree)
        self.scene = scene
        self.mesh = scene.device.mesh
        self.comm: MPI.Comm = scene.device.comm
        self.scales = Scales.of(scene)
        self.factors = {name: 0.0 for name in scene.ramps}
        self._build_space()
        self._constrain()
        self._build_forms()

    # ---------------------------------------------------------------- spaces

    def _build_space(self) -> None:
        scene, mesh = self.scene, self.mesh
        cell = mesh.topology.cell_name()
        dim = mesh.geometry.dim
        choice = scene.elements.pressure
        if choice == "auto":
            choice = "continuous" if cell in SIMPLICES else "discontinuous"
        self.pressure_kind = choice
        vector = basix.ufl.element("Lagrange", cell, 2, shape=(dim,))
        pressure = basix.ufl.element("Lagrange", cell, 1)
        if choice == "discontinuous":
            pressure = basix.ufl.element("DPC", cell, 1, discontinuous=True)
        elements = [vector, pressure]
        if scene.has_potential:
            elements.append(basix.ufl.element("Lagrange", cell, scene.elements.potential_degree))
        self.W = dolfinx.fem.functionspace(mesh, basix.ufl.mixed_element(elements))
        self.w = dolfinx.fem.Function(self.W, name="state")
        self.displacement = [Component.of(self.W.sub(0).sub(a)) for a in range(dim)]
        self.pressure = Component.of(self.W.sub(1))
        self.potential = Component.of(self.W.sub(2)) if scene.has_potential else None

        index_map = self.W.dofmap.index_map
        assert self.W.dofmap.index_map_bs == 1
        self.owned = index_map.size_local
        self.size = index_map.size_local + index_map.num_ghosts
        self.fields = {
            "u": self._owned(np.concatenate([c.dofs for c in self.displacement])),
            "p": self._owned(self.pressure.dofs),
        }
        if self.potential is not None:
            self.fields["phi"] = self._owned(self.potential.dofs)

    def _owned(self, dofs: np.ndarray) -> np.ndarray:
        return np.sort(dofs[dofs < self.owned])

    def _constrain(self) -> None:
        self.constraints = Constraints(self.size)
        apply_supports(self.scene, self.displacement, self.constraints)
        check_rigid(self.scene, self.displacement, self.constraints.fixed)
        self.electrode_dofs: dict[str, np.ndarray] = {}
        if self.potential is not None:
            self.electrode_dofs = apply_electrodes(
                self.scene, self.potential, self.scales.potential, self.constraints
            )
        for ramp in self.factors:
            self.constraints.base.setdefault(ramp, np.zeros(self.size))
        start = self.W.dofmap.index_map.local_range[0]
        scene = self.scene
        self.floating = [
            Floating.of(e, self.electrode_dofs[e.label], self.scales.charge, self.owned, start,
                        self.comm)
            for e in scene.electrodes if isinstance(e, ChargedElectrode)
        ]  # fmt: skip
        fixed = self.constraints.fixed[: self.owned]
        follower = np.zeros(self.owned, dtype=bool)
        for electrode in self.floating:
            follower[electrode.dofs] = True
        self.free = np.flatnonzero(~fixed & ~follower).astype(np.int32)
        self.fixed = np.flatnonzero(fixed).astype(np.int32)
        self.free_fields = {
            name: np.searchsorted(self.free, np.intersect1d(dofs, self.free))
            for name, dofs in self.fields.items()
        }
        self.unknowns = self.comm.allreduce(len(self.free), op=MPI.SUM)
        self.counts = {
            name: self.comm.allreduce(len(where), op=MPI.SUM)
            for name, where in self.free_fields.items()
        }
        self._free_rows = PETSc.IS().createGeneral(self.free + start, comm=self.comm)
        self._fixed_rows = PETSc.IS().createGeneral(self.fixed + start, comm=self.comm)
        self._all_rows = PETSc.IS().createStride(self.owned, start, 1, comm=self.comm)
        self._expansion = self._build_expansion() if self.floating else None

    def _build_expansion(self) -> Any:
        """Matrix from the free unknowns to all: a charged electrode's nodes follow its master."""
        offset = self.comm.exscan(len(self.free)) or 0
        P = PETSc.Mat().createAIJ(
            ((self.owned, None), (len(self.free), None)), nnz=(1, 1), comm=self.comm
        )
        first = P.getOwnershipRange()[0]
        column = np.full(self.owned, -1, dtype=np.int64)
        column[self.free] = offset + np.arange(len(self.free))
        for electrode in self.floating:
            mine = int(column[electrode.master]) if electrode.master >= 0 else -1
            column[electrode.dofs] = self.comm.allreduce(mine, op=MPI.MAX)
        for row in np.flatnonzero(column >= 0):
            P.setValue(first + int(row), int(column[row]), 1.0)
        P.assemble()
        return P

    @property
    def expected_negative_pivots(self) -> int:
        """Negative eigenvalues of the tangent on a stable path: one a pressure or potential."""
        return self.counts["p"] + self.counts.get("phi", 0)

    # ----------------------------------------------------------------- forms

    def _build_forms(self) -> None:
        scene, scales = self.scene, self.scales
        degree = scene.elements.quadrature_degree
        self.kernels = kernels(scene, scales)
        x = ufl.SpatialCoordinate(self.mesh)
        weight = scene.kinematics.weight(x)
        u, p, phi = self._split(self.w)
        self.states = [state(scene, k, scales, u, p, phi) for k in self.kernels]
        dx = measure(scene.device, [k.cells for k in self.kernels], degree)
        energy = sum(s.energy * weight * dx(k) for k, s in enumerate(self.states))
        test = ufl.TestFunction(self.W)
        residual = ufl.derivative(energy, self.w, test)
        residual = residual - self._work_of_loads(u, self._split(test)[0], weight, degree)
        tangent = ufl.derivative(residual, self.w, ufl.TrialFunction(self.W))
        self._load_vectors: dict[str, np.ndarray] = {}
        self._residual = compat.compile_form(residual)
        self._tangent = compat.compile_form(tangent)

        points, weights = basix.make_quadrature(
            getattr(basix.CellType, self.mesh.topology.cell_name()), degree
        )
        self._points = points
        self._probes = [
            compat.expression(
                ufl.as_vector(
                    [s.J, s.chain_margin, ufl.sqrt(ufl.dot(s.true_field, s.true_field))]
                ),
                points,
            )
            for s in self.states
        ]
        self._place = compat.expression(x, points)
        cellwise = ufl.TestFunction(dolfinx.fem.functionspace(self.mesh, ("DG", 0)))
        self._swelling = compat.compile_form(
            sum((s.J - 1) * cellwise * weight * dx(k) for k, s in enumerate(self.states))
        )
        volumes = compat.compile_form(
            sum(cellwise * weight * dx(k) for k in range(len(self.states)))
        )
        n = scene.device.owned_cells()
        self.cell_volumes = _cell_values(volumes)[:n]
        self.volume = self.comm.allreduce(float(self.cell_volumes.sum()), op=MPI.SUM)
        self.incompressible_cells = np.sort(
            np.concatenate([np.empty(0, dtype=np.int32),
                            *(k.cells for k in self.kernels if k.kappa is None)])
        )  # fmt: skip

    def _split(self, w: Any) -> tuple[Any, Any, Any | None]:
        parts = ufl.split(w)
        return (*parts, None) if len(parts) == 2 else parts

    def _work_of_loads(self, u: Any, v: Any, weight: Any, degree: int) -> Any:
        """Virtual work of the loads; each ramp's factor is a constant of the form."""
        scene, mesh = self.scene, self.mesh
        self.load_factors = {
            ramp: dolfinx.fem.Constant(mesh, 0.0)
            for ramp in {load.ramp for load in scene.loads}
        }
        self._unit_work: dict[str, Any] = {}
        self._following: set[str] = set()
        if not scene.loads:
            return 0
        sides = [
            self._pressed_side(load)
            if isinstance(load, DeadPressure)
            else one_sided(scene.device, load.where)
            for load in scene.loads
        ]
        ds = measure(scene.device, sides, degree, "ds")
        normal = ufl.FacetNormal(mesh)
        work = 0
        for k, load in enumerate(scene.loads):
            if isinstance(load, DeadPressure):
                pressure = dolfinx.fem.Constant(mesh, load.pascal / self.scales.stress)
                unit_work = -pressure * ufl.dot(normal, v) * weight * ds(k)
            elif isinstance(load, FollowerPressure):
                # force on an area element: -p cof(F) N dA, undeformed area and normal
                pressure = dolfinx.fem.Constant(mesh, load.pascal / self.scales.stress)
                kin = scene.kinematics
                gradient = kin.displacement_gradient(u, ufl.SpatialCoordinate(mesh))
                area = ufl.dot(cofactor(ufl.Identity(3) + gradient)[0], kin.embed(normal))
                unit_work = -pressure * ufl.dot(area, kin.embed(v)) * weight * ds(k)
                self._following.add(load.ramp)
            else:
                traction = dolfinx.fem.Constant(mesh, np.array(load.pascal) / self.scales.stress)
                unit_work = ufl.dot(traction, v) * weight * ds(k)
            self._unit_work[load.ramp] = self._unit_work.get(load.ramp, 0) + unit_work
            work += self.load_factors[load.ramp] * unit_work
        return work

    def _pressed_side(self, load: DeadPressure) -> np.ndarray:
        """Facets of a pressure, seen from the material it presses on."""
        device, materials = self.scene.device, self.scene.materials
        pairs = {name: one_sided(device, load.where, frozenset([device.regions[name]]))
                 for name in ([load.on] if load.on else materials)}  # fmt: skip
        counts = {n: self.comm.allreduce(len(p), op=MPI.SUM) for n, p in pairs.items()}
        total = self.comm.allreduce(len(one_sided(device, load.where)), op=MPI.SUM)
        touching = [n for n, c in counts.items() if c]
        if sum(counts.values()) > total:
            touching = [n for n in touching if materials[n].is_dielectric]
        if sum(counts[n] for n in touching) != total:
            raise InputError(
                f"It is not clear which side the pressure on {load.where!r} presses; name the "
                f"region with DeadPressure(..., on=...), one of: {', '.join(sorted(materials))}."
            )
        return np.concatenate([pairs[n] for n in touching])

    # ------------------------------------------------------------- evaluation

    def set_factors(self, factors: dict[str, float]) -> None:
        """Set the ramp factors: dead loads at once, fixed values at `insert_fixed`."""
        self.factors = dict(factors)
        for ramp, constant in self.load_factors.items():
            constant.value = factors[ramp]

    def insert_fixed(self) -> np.ndarray:
        """Put the fixed values of the current factors into w; returns their change (owned)."""
        target = self.constraints.values(self.factors)
        fixed = self.constraints.fixed
        array = self.w.x.array
        change = target[self.fixed] - array[self.fixed]
        array[fixed] = target[fixed]
        return change

    def get_state(self) -> np.ndarray:
        """Copy of all local values of w, ghosts included."""
        return self.w.x.array.copy()

    def set_state(self, values: np.ndarray) -> None:
        self.w.x.array[:] = values

    def add_free(self, increment: np.ndarray) -> None:
        """Add an increment to the free unknowns (owned) and update what follows them."""
        self.w.x.array[self.free] += increment
        for electrode in self.floating:
            mine = self.w.x.array[electrode.master] if electrode.master >= 0 else 0.0
            self.w.x.array[electrode.dofs] = self.comm.allreduce(mine, op=MPI.SUM)
        self.w.x.scatter_forward()

    def residual(self) -> np.ndarray:
        """Internal minus external forces at all owned degrees of freedom, fixed ones included."""
        if not hasattr(self, "_b"):
            self._b = compat.create_vector(self._residual)
        with self._b.localForm() as local:
            local.set(0.0)
        dolfinx.fem.petsc.assemble_vector(self._b, self._residual)
        self._b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        return self._b.array_r.copy()

    def restrict(self, residual: np.ndarray) -> np.ndarray:
        """A vector over all owned degrees of freedom in the rows of the free unknowns (owned).

        The rows of a charged electrode add up in its master's.
        """
        rows = residual[self.free]
        for electrode in self.floating:
            total = self.comm.allreduce(float(residual[electrode.dofs].sum()), op=MPI.SUM)
            if electrode.master >= 0:
                rows[np.searchsorted(self.free, electrode.master)] += total
        return rows

    def unbalanced(self, residual: np.ndarray) -> np.ndarray:
        """What is out of balance in each free row: the restricted residual and given charges."""
        rows = self.restrict(residual)
        for electrode in self.floating:
            if electrode.master >= 0:
                row = np.searchsorted(self.free, electrode.master)
                rows[row] += electrode.charge * self.factors[electrode.ramp]
        return rows

    def tangent(self) -> Any:
        """Assemble the tangent; returns its block in the free unknowns (reused between calls)."""
        if not hasattr(self, "_A"):
            self._A = dolfinx.fem.petsc.create_matrix(self._tangent)
            self._A_free: Any = None
        self._A.zeroEntries()
        dolfinx.fem.petsc.assemble_matrix(self._A, self._tangent)
        self._A.assemble()
        if self._expansion is not None:
            self._A_free = self._A.ptap(self._expansion, self._A_free)
        else:
            self._A_free = self._A.createSubMatrix(self._free_rows, self._free_rows, self._A_free)
        self._A_free.setOption(PETSc.Mat.Option.SYMMETRIC, not self._following)
        return self._A_free

    def tangent_times_fixed(self, change: np.ndarray) -> np.ndarray:
        """Product of the tangent's columns of fixed unknowns with their change (owned, free rows).

        Uses the tangent of the latest call of `tangent`.
        """
        rows = self._all_rows if self.floating else self._free_rows
        coupling = self._A.createSubMatrix(rows, self._fixed_rows)
        x, y = coupling.createVecs()
        x.array[:] = change
        coupling.mult(x, y)
        product = y.array_r.copy()
        for thing in (coupling, x, y):
            thing.destroy()
        return self.restrict(product) if self.floating else product

    def load_derivative(self, ramp: str) -> np.ndarray:
        """Derivative of the residual by a ramp's factor at fixed free unknowns (owned, free rows).

        Exact: fixed values are linear in the factor and act through the tangent's columns (those of
        the latest call of `tangent`); loads and charges are linear themselves.
        """
        if ramp not in self._load_vectors or ramp in self._following:
            vector = np.zeros(len(self.free))
            if ramp in self._unit_work:
                form = compat.compile_form(-self._unit_work[ramp])
                assembled = dolfinx.fem.assemble_vector(form)
                assembled.scatter_reverse(dolfinx.la.InsertMode.add)
                vector = assembled.array[self.free].copy()
            for electrode in self.floating:
                if electrode.master >= 0 and electrode.ramp == ramp:
                    vector[np.searchsorted(self.free, electrode.master)] += electrode.charge
            self._load_vectors[ramp] = vector
        return self._load_vectors[ramp] + self.tangent_times_fixed(
            self.constraints.base[ramp][self.fixed]
        )

    def probe(self) -> Probe:
        """Extremes of J, lock-up margin and field over the quadrature points.  Collective."""
        low = np.array([np.inf, np.inf])
        best = (-1.0, -1, -1)
        for kernel, evaluate in zip(self.kernels, self._probes, strict=True):
            if len(kernel.cells) == 0:
                continue
            values = evaluate(self.mesh, kernel.cells)
            low = np.minimum(low, values[:, :, :2].min(axis=(0, 1)))
            field = values[:, :, 2]
            k, q = np.unravel_index(int(np.argmax(field)), field.shape)
            if field[k, q] > best[0]:
                best = (float(field[k, q]), int(kernel.cells[k]), int(q))
        place = np.zeros(3)
        if best[1] >= 0:
            x = self._place(self.mesh, np.array([best[1]], dtype=np.int32))[0, best[2]]
            place[: len(x)] = x
        # a NaN on one rank must reach all of them, and MPI's MIN may drop it
        low = np.where(np.isnan(low), -np.inf, low)
        everyone = self.comm.allgather((low, best[0], place))
        low = np.min([e[0] for e in everyone], axis=0)
        winner = max(everyone, key=lambda e: (e[1], *e[2]))
        return Probe(float(low[0]), float(low[1]), max(winner[1], 0.0), winner[2])

    def swelling(self) -> np.ndarray:
        """Change of volume int (J - 1) dX of each owned cell, dimensionless."""
        return _cell_values(self._swelling)[: len(self.cell_volumes)]

    def volume_error(self) -> float:
        """Largest relative change of volume of any incompressible cell.  Collective."""
        cells = self.incompressible_cells
        change = np.abs(self.swelling()[cells]) / self.cell_volumes[cells]
        return self.comm.allreduce(float(np.max(change, initial=0.0)), op=MPI.MAX)

    def stress(self, k: int) -> Any:
        """Symbolic Cauchy stress of kernel k, dimensionless."""
        return cauchy_stress(self.states[k])


def _cell_values(form: Any) -> np.ndarray:
    """Assemble a linear form over cell-wise constants; each rank's own cells are complete."""
    vector = dolfinx.fem.assemble_vector(form)
    return vector.array.copy()
