"""From a scene to unknowns, residual and tangent.

One mixed function w = (u, p, phi) holds everything, fixed values included.  Boundary values are
put into w before anything is assembled, so increments vanish there and no lifting is needed; the
linear systems are in the free unknowns only.  Overall unknowns (a helical cell's stretch and twist,
a slice's stretch along its depth) are one constant a cell, all tied to one another.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import basix
import basix.ufl
import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.mesh.cell_quality import check_cells
from dea_fenicsx.model.components import Component
from dea_fenicsx.model.energy import Scales, cauchy_stress, kernels, material_point, measure
from dea_fenicsx.model.fixed_values import (
    Constraints,
    apply_electrodes,
    apply_overall,
    apply_supports,
)
from dea_fenicsx.model.load_balance import check_balance
from dea_fenicsx.model.loads import Loads
from dea_fenicsx.model.orientation_springs import NO_SPRINGS, Turning
from dea_fenicsx.model.probe import Probe, Prober
from dea_fenicsx.model.rigid_motions import check_rigid
from dea_fenicsx.model.state import Factors, State
from dea_fenicsx.model.tied_unknowns import Group, Pairs, Rows, expansion, followers
from dea_fenicsx.scene.conditions import AxialForce, ChargedElectrode, Torque
from dea_fenicsx.scene.kinematics import Helical, Helix
from dea_fenicsx.scene.scene import SIMPLICES, Scene, period
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import PETSc, dolfinx


class Problem:
    """The discrete problem of a scene.

    Attributes
    ----------
    w
        The mixed function (u, p, phi, overall unknowns), dimensionless.
    scales
        SI value of each dimensionless unit.
    factors
        The present load.
    springs
        Springs that keep the present orientation of a free body.
    fields
        For each field, ``"u"`` (with the overall unknowns), ``"p"`` and if there is one ``"phi"``,
        its owned local degrees of freedom.
    free
        Owned local degrees of freedom that are unknowns, sorted.
    points
        Quadrature points of the reference cell.
    electrode_dofs
        Degrees of freedom of each electrode, by its label: all owned ones, and ghosts.
    residual_form
        The residual, symbolic.
    expansion
        PETSc matrix from the free unknowns to all owned degrees of freedom where some follow
        others, or None.
    overall
        The overall unknowns by name; empty unless the kinematics has some.
    helix
        The overall unknowns, symbolic, or None.
    pairs
        What ties the two ends of a helical cell, or None.
    incompressible_cells
        Owned cells of exactly incompressible regions, sorted.
    turning
        What keeps a free body's orientation where no dead load gives it one.
    """

    def __init__(self, scene: Scene) -> None:
        check_cells(scene.device, scene.elements.quadrature_degree)
        self.scene = scene
        self.mesh = scene.device.mesh
        self.comm: MPI.Comm = scene.device.comm
        self.scales = Scales.of(scene)
        self.factors = Factors(
            dict.fromkeys(scene.ramps, 0.0),
            {name: scene.reference_voltage(name) for name in scene.ramps},
        )
        self._history: Mapping[str, Any] = {}
        self._build_space()
        self._constrain()
        self._build_forms()
        self.commit(self.turning.anchored(self.state))

    # ---------------------------------------------------------------- spaces

    def _build_space(self) -> None:
        scene, mesh = self.scene, self.mesh
        cell = mesh.topology.cell_name()
        dim = len(scene.kinematics.axes)
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
        overall = scene.kinematics.overall
        if overall:
            shape = (len(overall),) if len(overall) > 1 else None
            elements.append(basix.ufl.element("DG", cell, 0, shape=shape))
        self.W = dolfinx.fem.functionspace(mesh, basix.ufl.mixed_element(elements))
        self.w = dolfinx.fem.Function(self.W, name="state")
        self._step = dolfinx.fem.Function(self.W)
        self.displacement = [Component.of(self.W.sub(0).sub(a)) for a in range(dim)]
        self.pressure = Component.of(self.W.sub(1))
        self.potential = Component.of(self.W.sub(2)) if scene.has_potential else None
        whole = self.W.sub(len(elements) - 1)
        self.overall = {
            name: Component.of(whole.sub(k) if len(overall) > 1 else whole)
            for k, name in enumerate(overall)
        }

        index_map = self.W.dofmap.index_map
        assert self.W.dofmap.index_map_bs == 1
        self.owned = index_map.size_local
        self.size = index_map.size_local + index_map.num_ghosts
        self.rows = Rows(self.owned, index_map.local_range[0], self.comm)
        motion = [*self.displacement, *self.overall.values()]
        self.fields = {
            "u": self._owned(np.concatenate([c.dofs for c in motion])),
            "p": self._owned(self.pressure.dofs),
        }
        if self.potential is not None:
            self.fields["phi"] = self._owned(self.potential.dofs)

    def _owned(self, dofs: np.ndarray) -> np.ndarray:
        return np.sort(dofs[dofs < self.owned])

    def _constrain(self) -> None:
        self.constraints = Constraints(self.size)
        apply_supports(self.scene, self.displacement, self.constraints)
        apply_overall(self.scene, self.overall, self.constraints)
        turning = self.constraints.released if self.constraints.turns else None
        check_rigid(self.scene, self.displacement, self.constraints.fixed, turning)
        self.electrode_dofs: dict[str, np.ndarray] = {}
        if self.potential is not None:
            self.electrode_dofs = apply_electrodes(
                self.scene, self.potential, self.scales.potential, self.constraints
            )
        for ramp in self.factors:
            self.constraints.base.setdefault(ramp, np.zeros(self.size))
        self.pairs = pairs = self._tie_ends()
        self.groups = self._tie_groups()
        fixed = self.constraints.fixed[: self.owned]
        follower = followers(self.groups, pairs, fixed)
        self.free = np.flatnonzero(~fixed & ~follower).astype(np.int32)
        self.fixed = np.flatnonzero(fixed).astype(np.int32)
        self.free_fields = {
            name: np.searchsorted(self.free, np.intersect1d(dofs, self.free))
            for name, dofs in self.fields.items()
        }
        self.turning = Turning(self.scene, self.displacement, self.constraints, self.free)
        self.springs = NO_SPRINGS
        self.unknowns = self.comm.allreduce(len(self.free), op=MPI.SUM)
        self.counts = {
            name: self.comm.allreduce(len(where), op=MPI.SUM)
            for name, where in self.free_fields.items()
        }
        self.expansion: Any = None
        if self.groups or pairs is not None:
            self.expansion = expansion(self.free, self.groups, pairs, self.rows)
            self._few, self._all = self.expansion.createVecs()

    def _tie_ends(self) -> Pairs | None:
        """Tie the upper end of a periodic cell to the lower one, fixed values included."""
        kinematics = self.scene.kinematics
        if not isinstance(kinematics, Helical):
            return None
        parts = list(self.displacement)
        if self.pressure_kind == "continuous":
            parts.append(self.pressure)
        if self.potential is not None:
            parts.append(self.potential)
        pairs = Pairs.between(self.scene.device, kinematics.between, parts, self.rows)
        pairs.share_fixed(self.constraints, self.W)
        for label, dofs in self.electrode_dofs.items():
            member = np.zeros(self.owned, dtype=bool)
            member[self._owned(dofs)] = True
            self.electrode_dofs[label] = np.union1d(dofs, np.flatnonzero(pairs.join(member)))
        return pairs

    def _tie_groups(self) -> list[Group]:
        """Charged electrodes, with their charge, and free overall unknowns, with their force."""
        scene, scales = self.scene, self.scales
        groups = [
            Group.of(self.electrode_dofs[e.label], self.rows,
                     ((e.ramp, e.coulombs / scales.charge),))
            for e in scene.electrodes if isinstance(e, ChargedElectrode)
        ]  # fmt: skip
        for name, part in self.overall.items():
            # a rank without cells has none of these degrees of freedom, but must join in
            fixed = bool(np.all(self.constraints.fixed[part.dofs]))
            if not self.comm.allreduce(fixed, op=MPI.LAND):
                height = period(scene) / scales.length
                sources = [
                    (load.ramp, -load.newtons / scales.force * height)
                    if isinstance(load, AxialForce)
                    else (load.ramp, -load.newton_metres / scales.force / scales.length * height)
                    for load in scene.loads
                    if isinstance(load, AxialForce if name == "elongation" else Torque)
                ]
                groups.append(Group.of(part.dofs, self.rows, tuple(sources)))
        return groups

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
        u, p, phi, helix = self._split(self.w)
        self.helix = helix
        self.states = [material_point(scene, k, scales, u, p, phi, helix) for k in self.kernels]
        dx = measure(scene.device, [k.cells for k in self.kernels], degree)
        energy = sum(s.energy * weight * dx(k) for k, s in enumerate(self.states))
        test = ufl.TestFunction(self.W)
        residual = ufl.derivative(energy, self.w, test)
        v, _, _, virtual = self._split(test)
        self.loads = Loads(scene, scales.stress, u, v, virtual)
        residual = residual - self.loads.work
        for k, s in enumerate(self.states):
            for ramp, rate in s.rates.items():
                work = -ufl.derivative(rate * weight * dx(k), self.w, test)
                self.loads.add_strain(ramp, self.kernels[k].prestretch[ramp][0], work)
        self.residual_form = residual
        self._residual = compat.compile_form(residual)

        points, weights = basix.make_quadrature(
            getattr(basix.CellType, self.mesh.topology.cell_name()), degree
        )
        self.points = points
        self._prober = Prober(self.mesh, self.kernels, self.states, points)
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
        check_balance(
            scene, scales, self.displacement, self.constraints,
            list(self.loads.unit_work), self.load_vector,
        )  # fmt: skip
        self.incompressible_cells = np.sort(
            np.concatenate([np.empty(0, dtype=np.int32),
                            *(k.cells for k in self.kernels if k.kappa is None)])
        )  # fmt: skip

    def _split(self, w: Any) -> tuple[Any, Any, Any | None, Helix | None]:
        """Displacement, pressure, potential and helix of a mixed function or test function."""
        parts = ufl.split(w)
        kinematics = self.scene.kinematics
        helix = None
        if isinstance(kinematics, Helical):
            if not hasattr(self, "_lead"):
                self._lead = dolfinx.fem.Constant(self.mesh, kinematics.lead(self.scales.length))
            helix = Helix(self._lead, parts[-1][0], parts[-1][1])
        elif kinematics.overall:
            helix = Helix(0, parts[-1], 0)
        return parts[0], parts[1], parts[2] if self.scene.has_potential else None, helix

    # ------------------------------------------------------------- evaluation

    @property
    def state(self) -> State:
        """A copy of the present state: the accepted one, or the one that `at` tries."""
        return State(self.w.x.array.copy(), self.factors, history=self._history)

    @contextmanager
    def at(self, state: State) -> Iterator[None]:
        """Try a state: within the block the problem is there, and then where it was before."""
        before = self.state
        self.show(state)
        try:
            yield
        finally:
            self.show(before)

    def commit(self, state: State) -> None:
        """Accept a state as the present one."""
        self.show(state)

    def show(self, state: State) -> None:
        """Go to a state, for a search inside of `at`, which comes back."""
        self.w.x.array[:] = state.values
        self.factors = state.factors
        self._history = state.history
        self.springs = self.turning.springs_of(state)
        for ramp, constant in self.loads.factors.items():
            constant.value = state.factors[ramp]

    def under(self, state: State, factors: Mapping[str, float]) -> State:
        """The unknowns of a state under another load, fixed values left as they are.  Collective.

        Where the last dead load on a free body has gone, springs keep the orientation that the
        body has in this state.
        """
        moved = state.with_factors(factors)
        if self.turning.holds(moved.factors) and not self.turning.holds(state.factors):
            return self.turning.anchored(moved)
        return moved

    def imposed(self, state: State) -> State:
        """The state with the fixed values that belong to its load."""
        values = state.values.copy()
        fixed = self.constraints.fixed
        values[fixed] = self.constraints.values(state.factors)[fixed]
        return state.with_values(values)

    def anchored(self, state: State) -> State:
        """The state of a free body which is to keep its orientation from now on.  Collective.

        It keeps it wherever no dead load turns the body.
        """
        return self.turning.anchored(state)

    def overall_values(self) -> np.ndarray:
        """Elongation and, of a helical cell, twist (rad/m), if there are such.  Collective."""
        values = [
            next(v for v in self.comm.allgather(self.w.x.array[part.dofs[:1]]) if len(v))[0]
            for part in self.overall.values()
        ]
        return np.array(values) / np.array([1.0, self.scales.length][: len(values)])

    def add_free(self, increment: np.ndarray) -> None:
        """Add an increment to the free unknowns (owned) and update what follows them."""
        self.spread(increment, self._step)
        self.w.x.array[:] += self._step.x.array

    def moved(self, state: State, increment: np.ndarray) -> State:
        """The state with an increment of the free unknowns (owned).  Collective."""
        self.spread(increment, self._step)
        return state.with_values(state.values + self._step.x.array)

    def spread(self, values: np.ndarray, into: Any) -> None:
        """Lay out free unknowns (owned) and what follows them; fixed ones become 0.  Collective."""
        into.x.array[:] = 0.0
        if self.expansion is None:
            into.x.array[self.free] = values
        else:
            self._few.array[:] = values
            self.expansion.mult(self._few, self._all)
            into.x.array[: self.owned] = self._all.array_r
        into.x.scatter_forward()

    def residual(self) -> np.ndarray:
        """Internal minus external forces at all owned degrees of freedom, fixed ones included."""
        if not hasattr(self, "_b"):
            self._b = compat.create_vector(self._residual)
        return assembled(self._b, self._residual).copy()

    def restrict(self, residual: np.ndarray) -> np.ndarray:
        """A vector over all owned degrees of freedom in the rows of the free unknowns (owned).

        Rows that are tied add up in their master's.
        """
        if self.expansion is None:
            return residual[self.free]
        self._all.array[:] = residual
        self.expansion.multTranspose(self._all, self._few)
        return self._few.array_r.copy()

    def unbalanced(self, residual: np.ndarray) -> np.ndarray:
        """What is out of balance in each free row: the restricted residual and the sources."""
        rows = self.restrict(residual)
        for ramp, factor in self.factors.items():
            self.add_sources(rows, ramp, factor)
        at = self.springs
        rows[at.rows] += self.turning.force(at, self.w.x.array, self.factors)
        return rows

    def add_sources(self, rows: np.ndarray, ramp: str, factor: float) -> None:
        """Add a ramp's charges, forces and torques on groups to the free rows."""
        for group in self.groups:
            if group.master >= 0:
                row = np.searchsorted(self.free, group.master)
                rows[row] += factor * sum(amount for name, amount in group.sources if name == ramp)

    def load_vector(self, ramp: str) -> np.ndarray:
        """Minus the forces of a ramp's surface loads at factor 1, at all owned unknowns."""
        form = compat.compile_form(-self.loads.unit_work[ramp])
        assembled = dolfinx.fem.assemble_vector(form)
        assembled.scatter_reverse(dolfinx.la.InsertMode.add)
        return assembled.array[: self.owned]

    def probe(self) -> Probe:
        """Extremes of J, lock-up margin and field over the quadrature points.  Collective."""
        return self._prober.extremes()

    def place_of(self, cell: int, point: int) -> np.ndarray:
        """Undeformed position of a quadrature point of a local cell, dimensionless."""
        return self._prober.place_of(cell, point)

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


def assembled(vector: Any, form: Any) -> np.ndarray:
    """Assemble a linear form into a ghosted vector; returns its owned values.  Collective."""
    with vector.localForm() as local:
        local.set(0.0)
    dolfinx.fem.petsc.assemble_vector(vector, form)
    vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    return vector.array_r


def _cell_values(form: Any) -> np.ndarray:
    """Assemble a linear form over cell-wise constants; each rank's own cells are complete."""
    vector = dolfinx.fem.assemble_vector(form)
    return vector.array.copy()
