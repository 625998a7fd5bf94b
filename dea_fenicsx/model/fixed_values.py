"""Fixed degrees of freedom: displacements, global unknowns, and potentials on electrodes.

Boundaries are found by their names alone.  A comparison of coordinates could give different results
on two ranks that share a node.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.mesh.device import Device
from dea_fenicsx.model.components import Component
from dea_fenicsx.model.fields import Field
from dea_fenicsx.model.free_body import Pin
from dea_fenicsx.scene.condition import Condition
from dea_fenicsx.scene.declarations import FixedGlobal, FixedPotential
from dea_fenicsx.scene.electrodes import Conducting
from dea_fenicsx.support.errors import InputError


class FixedValues:
    """Which degrees of freedom are fixed, and at what value for given ramp factors.

    Parameters
    ----------
    size
        Number of local degrees of freedom of the mixed space, ghosts included.
    ramps
        Names of all ramps of the scene.

    Attributes
    ----------
    fixed
        Mask of the fixed degrees of freedom.
    base
        For each ramp the values at ramp factor 1, dimensionless.
    """

    def __init__(self, size: int, ramps: Iterable[str]) -> None:
        self.fixed = np.zeros(size, dtype=bool)
        self.base = {ramp: np.zeros(size) for ramp in ramps}

    def fix(self, dofs: np.ndarray, values: Any = 0.0, ramp: str | None = None) -> None:
        """Fix `dofs` at `values` times the factor of `ramp`; a later call overrides an earlier."""
        self.fixed[dofs] = True
        for base in self.base.values():
            base[dofs] = 0.0
        if ramp is not None:
            self.base[ramp][dofs] = values

    def values(self, factors: Mapping[str, float]) -> np.ndarray:
        """Value of every fixed degree of freedom (0 at the free ones)."""
        total = np.zeros(len(self.fixed))
        for ramp, base in self.base.items():
            total += factors[ramp] * base
        return total

    def hold(self, pins: Iterable[Pin], motion: Sequence[Component]) -> None:
        """Fix displacement components of single vertices at 0.  Collective."""
        for pin in pins:
            component = motion[pin.axis]
            self.fix(component.dofs[component.on(0, pin.vertices)])

    def fix_globals(
        self, declared: Iterable[tuple[Condition, FixedGlobal]], parts: Mapping[str, Component],
        length: float,
    ) -> None:  # fmt: skip
        """Fix global unknowns, given by their names; `length` is the unit of length in m."""
        for _, told in declared:
            value = told.value * length**told.unknown.per_length
            self.fix(parts[told.unknown.name].dofs, value, told.ramp)

    def fix_outside(
        self, fields: Iterable[Field], parts: Mapping[str, Mapping[str, Component]],
        device: Device,
    ) -> None:  # fmt: skip
        """Fix each field at 0 outside of the regions or the surface of its own.  Collective."""
        for field in fields:
            where: list[tuple[int, np.ndarray]] = []
            if field.regions is not None:
                cells = [np.empty(0, np.int32), *(device.cells_of(name) for name in field.regions)]
                where.append((device.dim, np.concatenate(cells)))
            if field.surface is not None:
                where.append((device.dim - 1, device.facets_by_surface[field.surface]))
            for dim, entities in where:
                for part in parts[field.name].values():
                    alive = np.zeros(len(part.dofs), dtype=bool)
                    alive[part.on(dim, entities)] = True
                    self.fix(part.dofs[~alive])

    def fix_electrodes(
        self, electrodes: Sequence[Conducting],
        declared: Sequence[tuple[Conducting, FixedPotential]], device: Device,
        potential: Component, volt: float,
    ) -> dict[str, np.ndarray]:  # fmt: skip
        """Fix the potential on electrodes.  Collective.

        Parameters
        ----------
        electrodes
            All electrodes of the scene.
        declared
            The potentials that they are given.
        device, potential
            The device and its potential.
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
        # For each node the last electrode that contains it, and the potential in V of this one.
        owner = np.full(len(potential.dofs), -1)
        values = np.zeros(len(potential.dofs))
        X = potential.space.tabulate_dof_coordinates() * device.length
        found: dict[str, np.ndarray] = {}
        for k, electrode in enumerate(electrodes):
            on = _nodes(device, potential, electrode.names)
            given = [told for one, told in declared if one is electrode]
            mine = given[0].volts(X) if given else np.zeros(len(X))
            for j in range(k):
                other = electrodes[j]
                shared = on & (owner == j)
                small = 1e-9 * max(abs(electrode.given_volts), abs(other.given_volts))
                touch = not _agree(electrode, other, mine[shared], values[shared], small)
                if device.comm.allreduce(touch, op=MPI.LOR):
                    raise InputError(
                        f"Electrodes {other.label!r} and {electrode.label!r} touch, but have "
                        "different potentials; leave dielectric between them."
                    )
            owner[on] = k
            values[on] = mine[on]
            dofs = potential.dofs[on]
            if electrode.floats:
                self.fixed[dofs] = False
            for told in given:
                fed = on
                if told.fed_at:
                    fed = on & _nodes(device, potential, told.fed_at)
                    self._check_fed(electrode, told, fed, device)
                self.fix(potential.dofs[fed], mine[fed] / volt, told.ramp)
            found[electrode.label] = dofs
        return found

    @staticmethod
    def _check_fed(
        electrode: Conducting, told: FixedPotential, fed: np.ndarray, device: Device
    ) -> None:
        """Raise InputError if a resistive electrode is fed nowhere.  Collective."""
        if not device.comm.allreduce(bool(fed.any()), op=MPI.LOR):
            raise InputError(
                f"Electrode {electrode.label!r} is fed at {', '.join(told.fed_at)}, which does "
                "not touch it; name a facet group that shares nodes with it."
            )


def _nodes(device: Device, potential: Component, groups: Sequence[str]) -> np.ndarray:
    """Mask of the nodes of facet groups and regions in the potential's own space.  Collective."""
    on = np.zeros(len(potential.dofs), dtype=bool)
    for name in groups:
        if name in device.regions:
            on[potential.on(device.dim, device.cells_of(name))] = True
        else:
            on[potential.on(device.dim - 1, device.facets_by_surface[name])] = True
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
