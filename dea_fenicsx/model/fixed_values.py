"""Supports, prescribed displacements and electrodes as fixed degrees of freedom.

Boundaries are found by their names alone.  A comparison of coordinates could give different results
on two ranks that share a node.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.components import Component
from dea_fenicsx.model.dead_loads import split_turns
from dea_fenicsx.model.fields import Field
from dea_fenicsx.model.free_body import Pin, pins, released
from dea_fenicsx.model.prescribed_motion import check_agreement, prescriptions
from dea_fenicsx.model.rigid_motions import FreePart
from dea_fenicsx.scene.declarations import FixedPotential
from dea_fenicsx.scene.electrodes import Conducting
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import known


class Constraints:
    """Which degrees of freedom are fixed, and at what value for given ramp factors.

    Parameters
    ----------
    size
        Number of local degrees of freedom of the mixed space, ghosts included.

    Attributes
    ----------
    fixed
        Mask of the fixed degrees of freedom.
    base
        For each ramp the values at ramp factor 1, dimensionless.
    released
        The rigid motions that `FreeBody` takes from a part of the mesh; None if there are none.
    pins
        The displacement components that it holds.
    turns
        The ramps of the dead loads by which it may turn: then its rotations are unknowns, see
        `orientation_springs`.
    """

    def __init__(self, size: int) -> None:
        self.released: FreePart | None = None
        self.pins: list[Pin] = []
        self.turns: frozenset[str] = frozenset()
        self.fixed = np.zeros(size, dtype=bool)
        self.base: dict[str, np.ndarray] = {}

    def fix(self, dofs: np.ndarray, values: Any = 0.0, ramp: str | None = None) -> None:
        """Fix `dofs` at `values` times the factor of `ramp`; a later call overrides an earlier."""
        self.fixed[dofs] = True
        for base in self.base.values():
            base[dofs] = 0.0
        if ramp is not None:
            base = self.base.setdefault(ramp, np.zeros(len(self.fixed)))
            base[dofs] = values

    def values(self, factors: Mapping[str, float]) -> np.ndarray:
        """Value of every fixed degree of freedom (0 at the free ones)."""
        total = np.zeros(len(self.fixed))
        for ramp, base in self.base.items():
            total += factors[ramp] * base
        return total


def apply_supports(scene: Scene, parts: list[Component], constraints: Constraints) -> None:
    """Fix the displacement components that the scene's supports and stretches name.  Collective.

    Raises
    ------
    InputError
        If two of them prescribe different displacements of one node along one axis, or if the
        centre of a stretch is not clear.
    """
    given = prescriptions(scene, parts)
    check_agreement(scene, parts, given)
    for item in given:
        constraints.fix(parts[item.axis].dofs[item.local], item.values, item.ramp)
    if scene.declared.holds_rigid_motions:
        _hold_free_body(scene, parts, constraints)


def _hold_free_body(scene: Scene, parts: list[Component], constraints: Constraints) -> None:
    """Hold the free rigid motions, except rotations by which dead loads may turn the body."""
    part = released(scene, parts, constraints.fixed)
    constraints.released = part
    if part is None:
        return
    held, constraints.turns = split_turns(scene, part)
    constraints.pins = list(pins(scene, replace(part, motions=held)))
    for pin in constraints.pins:
        component = parts[pin.axis]
        constraints.fix(component.dofs[component.on(0, pin.vertices)])


def apply_overall(
    scene: Scene, parts: dict[str, Component], constraints: Constraints
) -> None:
    """Fix the global unknowns that the scene prescribes, dimensionless."""
    for told in scene.declared.fixed_globals:
        value = told.value * scene.device.length**told.unknown.per_length
        constraints.fix(parts[told.unknown.name].dofs, value, told.ramp)


def apply_regions(
    scene: Scene, fields: Sequence[Field], parts: Mapping[str, Mapping[str, Component]],
    constraints: Constraints,
) -> None:  # fmt: skip
    """Fix each field at 0 outside of the regions in which it lives.  Collective.

    Raises
    ------
    InputError
        If a field is to live in a region that the device does not have.
    """
    device = scene.device
    for field in fields:
        if field.regions is None:
            continue
        for name in field.regions:
            known(name, device.regions, f"region of the field {field.name!r}")
        cells = [np.empty(0, np.int32), *(device.cells_of(name) for name in field.regions)]
        for part in parts[field.name].values():
            alive = np.zeros(len(part.dofs), dtype=bool)
            alive[part.on(device.dim, np.concatenate(cells))] = True
            constraints.fix(part.dofs[~alive])


def apply_electrodes(
    scene: Scene, potential: Component, volt: float, constraints: Constraints
) -> dict[str, np.ndarray]:
    """Fix the potential on electrodes.

    Parameters
    ----------
    scene, potential, constraints
        The scene, its potential, and what is to be filled.
    volt
        The unit of potential in V.

    Returns
    -------
    dict
        For each electrode's label its degrees of freedom in the mixed space.

    Raises
    ------
    InputError
        If electrodes of different potentials touch.
    """
    device = scene.device
    # For each node the last electrode that contains it, and the potential in V of this electrode.
    owner = np.full(len(potential.dofs), -1)
    values = np.zeros(len(potential.dofs))
    X = potential.space.tabulate_dof_coordinates() * device.length
    found: dict[str, np.ndarray] = {}
    for k, electrode in enumerate(scene.electrodes):
        on = _nodes(scene, potential, electrode.names)
        mine = potential_at(scene, electrode, X)
        for j in range(k):
            other = scene.electrodes[j]
            shared = on & (owner == j)
            small = 1e-9 * max(abs(electrode.given_volts), abs(other.given_volts))
            touch = not _agree(electrode, other, mine[shared], values[shared], small)
            if device.comm.allreduce(touch, op=MPI.LOR):
                raise InputError(
                    f"Electrodes {other.label!r} and {electrode.label!r} touch, but have different "
                    "potentials; leave dielectric between them."
                )
        owner[on] = k
        values[on] = mine[on]
        dofs = potential.dofs[on]
        if electrode.floats:
            constraints.fixed[dofs] = False
        for told in _potentials(scene, electrode):
            constraints.fix(dofs, mine[on] / volt, told.ramp)
        found[electrode.label] = dofs
    return found


def _nodes(scene: Scene, potential: Component, groups: Sequence[str]) -> np.ndarray:
    """Mask of the nodes of facet groups and regions in the potential's own space.  Collective."""
    device = scene.device
    on = np.zeros(len(potential.dofs), dtype=bool)
    for name in groups:
        if name in device.regions:
            on[potential.on(device.dim, device.cells_of(name))] = True
        else:
            on[potential.on(device.dim - 1, device.facets_of(name))] = True
    return on


def _agree(
    a: Conducting, b: Conducting, here: np.ndarray, there: np.ndarray, small: float
) -> bool:
    """Whether two electrodes give the nodes that they share the same potential at all times.

    They do where both give 0, whatever drives them.
    """
    if len(here) == 0:
        return True
    if a.floats or b.floats:
        return False
    alike = a.ramp == b.ramp or not (a.given_volts or b.given_volts)
    if not alike and np.max(np.abs([here, there])) > small:
        return False
    return bool(np.max(np.abs(here - there)) <= small)


def potential_at(scene: Scene, electrode: Conducting, X: np.ndarray) -> np.ndarray:
    """Given potential in V at undeformed positions X in m, shape (n, 3); 0 where it floats."""
    told = _potentials(scene, electrode)
    return told[0].volts(X) if told else np.zeros(len(X))


def _potentials(scene: Scene, electrode: Conducting) -> list[FixedPotential]:
    """The potentials that an electrode is given: none where it floats."""
    return [told for owner, told in scene.declared.potentials if owner is electrode]
