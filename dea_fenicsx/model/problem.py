"""The discrete problem of a scene, and the state in which it is.

One mixed function holds all fields, including the fixed values.  The boundary values are set before
anything is assembled.  So increments vanish at fixed degrees of freedom, the right-hand sides need
no correction for them, and the linear systems contain the free unknowns only.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.cavities import Cavities
from dea_fenicsx.model.charge_memory import ChargeMemory
from dea_fenicsx.model.components import Component
from dea_fenicsx.model.conditions import Conditions
from dea_fenicsx.model.contact_start import depths
from dea_fenicsx.model.damage import Damages
from dea_fenicsx.model.fields import Role, declared_fields
from dea_fenicsx.model.forms import Forms, assembled
from dea_fenicsx.model.friction import FrictionHistory, Frictions
from dea_fenicsx.model.load_balance import check_balance
from dea_fenicsx.model.mass import Mass
from dea_fenicsx.model.memory import Memory
from dea_fenicsx.model.motion import MOTION, Motion
from dea_fenicsx.model.parameters import Parameters
from dea_fenicsx.model.probe import Probe
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.model.state import Factors, State
from dea_fenicsx.model.terms.springs import spring_terms
from dea_fenicsx.model.touching_surfaces import contact_fields, touching_surfaces
from dea_fenicsx.model.unknowns import Unknowns
from dea_fenicsx.model.viscous_history import ViscousHistory
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.petsc_objects import PetscObjects


class Problem:
    """The discrete problem of a scene.

    Attributes
    ----------
    scene, mesh, comm
        The scene, its mesh and its communicator.
    scales
        SI value of each dimensionless unit.
    space
        The unknowns.
    conditions
        Which of them are free.
    roles
        The same by the role of their fields.
    forms
        The residual and what else is integrated.
    parameters
        The constants of the materials, to be read and set by name.
    factors
        The present load.
    time
        The present time in s.
    springs
        Springs that keep the present orientation of a free body.
    displacement
        The displacement components.
    pressure, potential
        The pressure, and the potential or None.
    free, fixed
        Owned local degrees of freedom that are unknowns, and that are fixed, sorted.
    handed_out
        Whether a script may hold it, so that no other run may use it.
    rigid
        The rigid parts.
    cavities
        The cavities.
    charges, circuits
        The charges that depend on the past, and the wires of electrodes that sources feed.
    frictions
        The surfaces that rub on an obstacle.
    rest
        The undeformed state without loads, in which it begins.
    depths
        How deep the undeformed device lies in each obstacle, dimensionless.
    shown
        How often the problem has gone to another state.
    released
        Whether a free body is held by its inertia alone, and not by the pins of `FreeBody`.
    mass
        The mass, whose inertia acts where something has set it; None where nothing moves in time.
    earlier
        dg/dq of rigid parts and the factors where a step begins whose forces are means, or None.
    """

    mass: Mass | None = None
    earlier: tuple[Any, Mapping[str, float]] | None = None

    def __init__(self, scene: Scene, released: bool = False) -> None:
        self.scene, self.mesh = scene, scene.device.mesh
        self.comm: MPI.Comm = scene.device.comm
        self.scales = Scales.of(scene)
        touching, axes = touching_surfaces(scene), scene.kinematics.axes
        fields = [*declared_fields(scene), *contact_fields(touching, scene.device, axes)]
        self.space = Unknowns(self.mesh, fields, scene.kinematics.global_unknowns)
        self.cavities = Cavities(scene, self.scales)
        self.conditions = Conditions(scene, self.scales, self.space, self.cavities, released)
        self.released = released
        told, parts = scene.declared.springs, self.conditions.rigid.parts
        springs = spring_terms(told, parts, axes, self.scales, self.mesh)
        self.forms = Forms(scene, self.scales, self.space, self.cavities, touching, springs, parts)
        self.parameters = Parameters(scene, self.scales, self.forms.kernels)
        self._name_parts()
        check_balance(self.conditions, self.forms, self.displacement, self.scales, released)
        self.forms.compile()
        self.charges = ChargeMemory(self)
        self._weigh()
        self.handed_out = False
        self._unstrained: dict[str, Any] = {m.NAME: m.at_rest() for m in self.memories}
        at_rest = np.where(self.conditions.fixed_values.fixed, 0.0, self.space.at_rest)
        unloaded = Factors(dict.fromkeys(scene.ramps, 0.0), scene.unit_volts)
        self.frictions = self.forms.contacts.frictions
        self._since: dict[str, Any] = {one.NAME: one.at_rest() for one in self.counted}
        self.rest = self.anchored(State(at_rest, unloaded, history=dict(self._since)))
        self.commit(self.rest)
        self.depths = depths(scene, self.forms.contacts)

    def _weigh(self) -> None:
        """Tell the memories the constants by which they work.  Collective."""
        device, parameters = self.scene.device, self.parameters
        if memory := self.forms.memory:
            memory.weigh(self.forms.cell_volumes, self.scene.materials, device.cells_of)
        if leaks := self.forms.leaks:
            leaks.take(lambda: parameters.materials, device.cells_of, self.scene.leaks_alike)

    def _name_parts(self) -> None:
        """Set short names for the parts that are used most often."""
        space, conditions, forms = self.space, self.conditions, self.forms
        self.W, self.w, self.owned, self.size = space.W, space.w, space.owned, space.size
        self.displacement = space.of(Role.MOTION)
        self.pressure: Component = space.of(Role.MULTIPLIER)[0]
        self.potential = space.single(Role.POTENTIAL)
        self.free, self.fixed, self.rigid = conditions.free, conditions.fixed, conditions.rigid
        self.unknowns, self.roles = conditions.unknowns, conditions.roles
        self.turning, self.loads = conditions.turning, forms.loads
        self.loads.following |= self.rigid.wandering
        self.circuits = conditions.circuits
        self.kernels, self.states = forms.kernels, forms.points
        self._step = dolfinx.fem.Function(self.W)
        self._petsc = PetscObjects(self.comm)
        self._b, self.shown, self._expanded = None, 0, 0
        if conditions.expansion is not None:
            self._few, self._all = conditions.expansion.createVecs()
            self._petsc.keep("expansion", conditions.expansion)
            self._petsc.keep("few", self._few)
            self._petsc.keep("all", self._all)

    @property
    def pressure_kind(self) -> str:
        """``"continuous"`` or ``"discontinuous"``."""
        return self.scene.elements.pressure_on(self.mesh.topology.cell_name())

    @property
    def expansion(self) -> Any:
        """PETSc matrix from the free unknowns to all owned ones, or None.  Collective.

        It is the derivative of what follows other unknowns, in the present state.
        """
        found = self.conditions.expansion
        if self.rigid and self._expanded != self.shown:
            self.rigid.fill(found, self.w.x.array, self.conditions.fixed_values.fixed)
            self._expanded = self.shown
        return found

    @property
    def overall(self) -> dict[str, Component]:
        """The global unknowns by name; empty unless the kinematics has some."""
        return self.space.parts.get("global", {})

    @property
    def rubbed(self) -> FrictionHistory:
        """The friction up to the last accepted state."""
        return self._since[self.frictions.NAME]

    @property
    def state(self) -> State:
        """A copy of the present state: the accepted one, or the one that `at` tries."""
        return State(self.w.x.array.copy(), self.factors, self.time, history=self._history)

    @property
    def memories(self) -> list[Memory | ChargeMemory]:
        """The memory of viscous branches and that of charges, as far as the scene has them."""
        return [memory for memory in (self.forms.memory, self.charges) if memory]

    @property
    def counted(self) -> list[Frictions | Damages]:
        """Friction and damage, whose histories change only when a state is accepted."""
        return [one for one in (self.frictions, self.forms.damages) if one]

    @property
    def histories(self) -> dict[str, Any]:
        """The histories that belong to the present state, by the names of their memories."""
        return {
            memory.NAME: self._history.get(memory.NAME) or self._unstrained[memory.NAME]
            for memory in self.memories
        }

    @property
    def history(self) -> ViscousHistory | None:
        """The viscous strains that belong to the present state; None without viscous branches."""
        return self.histories.get(self.forms.memory.NAME)

    @property
    def motion(self) -> Motion | None:
        """The motion of the present state; None on a path without inertia."""
        return self._history.get(MOTION)

    @contextmanager
    def at(self, state: State) -> Iterator[None]:
        """Try a state: within the block the problem is there, and then where it was before."""
        before, since = self.state, self._since
        self.show(state)
        try:
            yield
        finally:
            self._since = since
            self.show(before)

    def commit(self, state: State) -> None:
        """Accept a state as the present one; friction then counts slip from there.  Collective."""
        self.show(state)
        self._since = {o.NAME: o.settled(self._history[o.NAME]) for o in self.counted}

    def show(self, state: State) -> None:
        """Make a state the present one, within a block of `at`, which restores the old state."""
        self._place(state.values)
        self.factors = state.factors
        self.time = state.time
        self._history = state.history
        for one in self.counted:
            self._history = {one.NAME: self._since[one.NAME], **self._history}
            one.show(self._history[one.NAME])
        for ramp, constant in self.loads.constants:
            constant.value = state.factors[ramp]
        self.forms.temperatures.check()
        for memory in self.memories:
            memory.show(self.histories[memory.NAME])
        self.springs = self.turning.springs_of(state)
        if self.mass is not None or self.motion is not None:
            self.massive().show(self.motion)
        if history := self.history:
            self.forms.memory.let_flow(history, self.parameters.materials)

    def _place(self, values: np.ndarray) -> None:
        """Go to some values of the unknowns; the nodes of rigid parts follow theirs."""
        self.w.x.array[:] = values
        self.rigid.place(self.w.x.array)
        self.shown += 1

    def under(self, state: State, factors: Mapping[str, float]) -> State:
        """The unknowns of a state under another load.  Fixed values are not changed.  Collective.

        If no dead load acts on a free body any more, springs keep the orientation that the body has
        in this state.  Friction counts the slip from the last accepted state.
        """
        moved = replace(state.with_factors(factors), history={**state.history, **self._since})
        if self.turning.holds(moved.factors) and not self.turning.holds(state.factors):
            return self.turning.anchored(moved)
        return moved

    def imposed(self, state: State) -> State:
        """The state with the fixed values that belong to its load."""
        values = state.values.copy()
        fixed = self.conditions.fixed_values.fixed
        values[fixed] = self.conditions.fixed_values.values(state.factors)[fixed]
        if self.circuits:
            memory = self.charges.NAME
            history = state.history.get(memory) or self._unstrained[memory]
            self.circuits.impose(values, state.factors, history)
        self.rigid.place(values)
        self.conditions.ties.follow(values)
        return state.with_values(values)

    def anchored(self, state: State) -> State:
        """The state of a free body which is to keep its orientation from now on.  Collective.

        It keeps it wherever no dead load turns the body.
        """
        return self.turning.anchored(state)

    def reuse(self, scene: Scene) -> None:
        """Take constants and voltages of a scene that differs by them alone, and begin anew."""
        self.parameters.take(scene.materials)
        for contact in self.forms.contacts:
            contact.take(scene.materials)
        if list(scene.electrodes) != list(self.scene.electrodes):
            self.conditions.take_volts(scene, self.scales, self.space)
            self.rest = self.rest.with_factors(Factors(self.rest.factors, scene.unit_volts))
        self.scene, self.mass = scene, None
        self._weigh()
        self.commit(self.rest)

    def moved(self, state: State, increment: np.ndarray) -> State:
        """The state with an increment of the free unknowns (owned).  Collective."""
        self.spread(increment, self._step)
        values = state.values + self._step.x.array
        self.rigid.advance(values, state.values, self._step.x.array)
        self.rigid.place(values)
        return state.with_values(values)

    def spread(self, values: np.ndarray, into: Any) -> None:
        """Write the free unknowns (owned), and those tied to them, into a function.

        Fixed degrees of freedom become 0.  Collective.
        """
        local = into.x.array
        local[:] = 0.0
        if (expansion := self.expansion) is None:
            local[self.free] = values
        else:
            self._few.array[:] = values
            expansion.mult(self._few, self._all)
            local[: self.owned] = self._all.array_r
        into.x.scatter_forward()

    def residual(self) -> np.ndarray:
        """Internal minus external forces at all owned degrees of freedom, fixed ones included.

        Where the body moves, its inertial forces are among the internal ones.
        """
        if self._b is None:
            self._b = self._petsc.keep("b", compat.create_vector(self.forms.compiled))
        found = assembled(self._b, self.forms.compiled).copy()
        if self.mass is not None and self.mass.acts:
            found += self.mass.forces(self.w.x.array[: self.owned])
        return found

    def massive(self) -> Mass:
        """The mass; the first call makes it.  Collective.

        Raises
        ------
        InputError
            As of `Mass`.
        """
        if self.mass is None:
            materials = self.parameters.materials
            self.mass = Mass(self.scene, self.scales, self.space, materials, self.rigid)
        return self.mass

    def restrict(self, residual: np.ndarray) -> np.ndarray:
        """A vector over all owned degrees of freedom in the rows of the free unknowns (owned).

        The rows of tied degrees of freedom are added to the row of their master.
        """
        if self.expansion is None:
            return residual[self.free]
        self._all.array[:] = residual
        self.expansion.multTranspose(self._all, self._few)
        found = self._few.array_r.copy()
        if self.earlier is None:
            return found
        self.earlier[0].multTranspose(self._all, self._few)
        return np.asarray((found + self._few.array_r) / 2)

    def unbalanced(self, residual: np.ndarray) -> np.ndarray:
        """The unbalanced force or charge in each free row.

        It is the restricted residual plus the sources and the forces of the springs.
        """
        rows = self.restrict(residual)
        for ramp, factor in self.factors.items():
            self.add_sources(rows, ramp, factor)
            if self.earlier is not None:
                self.add_sources(rows, ramp, (self.earlier[1][ramp] - factor) / 2, charges=False)
        at = self.springs
        rows[at.rows] += self.turning.force(at, self.w.x.array, self.factors)
        if self.forms.sheets:
            rows += self.restrict(self.forms.sheets.past(self.conditions.sheet_nodes))
        if self.circuits:
            self.circuits.add_charges(rows, self.w.x.array, self.factors)
        return rows

    def add_sources(
        self, rows: np.ndarray, ramp: str, factor: float, charges: bool = True
    ) -> None:
        """Add a ramp's charges, forces and torques on groups to the free rows."""
        for group in self.conditions.groups:
            if group.master >= 0 and (charges or not group.electric):
                row = np.searchsorted(self.free, group.master)
                total = sum(amount for name, amount in group.sources if name == ramp)
                rows[row] += factor * total / (self.forms.leaks.psi if group.electric else 1.0)

    def probe(self) -> Probe:
        """Extremes of J, lock-up margin and field over the quadrature points.  Collective."""
        return self.forms.prober.extremes(self.forms.memory.least_margin)
