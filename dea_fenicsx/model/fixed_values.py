"""Supports, prescribed displacements and electrodes as fixed degrees of freedom.

Boundaries are found by their names alone.  A comparison of coordinates can come out differently
on two ranks that share a node.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.components import Component
from dea_fenicsx.model.dead_loads import split_turns
from dea_fenicsx.model.free_body import Pin, pins, released
from dea_fenicsx.model.prescribed_motion import check_agreement, prescriptions
from dea_fenicsx.model.rigid_motions import FreePart
from dea_fenicsx.scene.conditions import (
    AxialStretch,
    ChargedElectrode,
    Electrode,
    FreeBody,
    Twist,
)
from dea_fenicsx.scene.electrode_profiles import driven_alike, given_volts, profile
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.errors import InputError


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
        `turning`.
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
        If two of them give one node different displacements along one axis, or if it is not clear
        what a stretch is about.
    """
    given = prescriptions(scene, parts)
    check_agreement(scene, parts, given)
    for item in given:
        constraints.fix(parts[item.axis].dofs[item.local], item.values, item.ramp)
    if any(isinstance(item, FreeBody) for item in scene.supports):
        _hold_free_body(scene, parts, constraints)


def _hold_free_body(scene: Scene, parts: list[Component], constraints: Constraints) -> None:
    """Hold what rigid motions are left, but for rotations by which dead loads may turn the body."""
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
    """Fix the overall unknowns that the scene prescribes: elongation, and twist in 1/length."""
    for item in scene.prescribed:
        if isinstance(item, AxialStretch):
            constraints.fix(parts["elongation"].dofs, item.stretch - 1, item.ramp)
        elif isinstance(item, Twist):
            turn = item.radians_per_metre * scene.device.length
            constraints.fix(parts["twist"].dofs, turn, item.ramp)


def apply_electrodes(
    scene: Scene, potential: Component, volt: float, constraints: Constraints
) -> dict[str, np.ndarray]:
    """Fix the potential on electrodes and wherever no field lives.

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
    dielectric = [device.cells_of(n) for n, m in scene.materials.items() if m.is_dielectric]
    alive = np.zeros(len(potential.dofs), dtype=bool)
    alive[potential.on(device.dim, np.concatenate(dielectric))] = True
    constraints.fix(potential.dofs[~alive])

    owner = np.full(len(potential.dofs), -1)
    values = np.zeros(len(potential.dofs))
    X = potential.space.tabulate_dof_coordinates() * device.length
    found: dict[str, np.ndarray] = {}
    for k, electrode in enumerate(scene.electrodes):
        on = np.zeros(len(potential.dofs), dtype=bool)
        for name in electrode.names:
            if name in device.regions:
                on[potential.on(device.dim, device.cells_of(name))] = True
            else:
                on[potential.on(device.dim - 1, device.facets_of(name))] = True
        mine = potential_at(scene, electrode, X)
        for j in range(k):
            other = scene.electrodes[j]
            shared = on & (owner == j)
            small = 1e-9 * max(abs(given_volts(electrode)), abs(given_volts(other)))
            touch = not _agree(electrode, other, mine[shared], values[shared], small)
            if device.comm.allreduce(touch, op=MPI.LOR):
                raise InputError(
                    f"Electrodes {other.label!r} and {electrode.label!r} touch, but have different "
                    "potentials; leave dielectric between them."
                )
        owner[on] = k
        values[on] = mine[on]
        dofs = potential.dofs[on]
        if isinstance(electrode, ChargedElectrode):
            constraints.fixed[dofs] = False
        else:
            ramp = electrode.ramp if electrode.volts else None
            constraints.fix(dofs, mine[on] / volt, ramp)
        found[electrode.label] = dofs
    return found


def _agree(
    a: Electrode | ChargedElectrode, b: Electrode | ChargedElectrode,
    here: np.ndarray, there: np.ndarray, small: float,
) -> bool:  # fmt: skip
    """Whether two electrodes give the nodes that they share the same potential at all times.

    They do where both give 0, whatever drives them.
    """
    if len(here) == 0:
        return True
    if isinstance(a, ChargedElectrode) or isinstance(b, ChargedElectrode):
        return False
    if not driven_alike(a, b) and np.max(np.abs([here, there])) > small:
        return False
    return bool(np.max(np.abs(here - there)) <= small)


def potential_at(
    scene: Scene, electrode: Electrode | ChargedElectrode, X: np.ndarray
) -> np.ndarray:
    """Given potential in V at undeformed positions X in m, shape (n, 3); 0 where it floats."""
    return given_volts(electrode) * profile(scene.kinematics, electrode, X)
