"""Cavities of a problem: closed spaces whose pressure is an unknown.

Each cavity adds to the energy of the device

    - P (V(u) - v) + Psi(v),        -dPsi/dv = p - p0,

with the pressure P above that outside, the volume V(u) behind the walls, and the volume v of what
the cavity holds.  P is a multiplier: its row says that v = V(u).  The row of v says that P = p - p0
with the law p(v) of the gas.  A liquid has v given, and a given pressure has P given and no v.

At any law that falls with v, the block of (v, P) has one negative eigenvalue, and what is left on
the motion after both are eliminated is the device with its gas.  So P counts as one negative
eigenvalue on a stable path, as each pressure of the material does.  The block is regular even where
the amount of gas is 0.

P and v are constants of each cell that touches the walls, all of them tied; elsewhere they are
fixed at 0.  The unknown of the volume is its change over `Enclosed.unit`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.mesh.device import Device
from dea_fenicsx.model.components import Component
from dea_fenicsx.model.fixed_values import FixedValues
from dea_fenicsx.model.loads import Loads, Surface
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.model.tied_unknowns import Rows, TiedGroup
from dea_fenicsx.model.unknowns import Unknowns
from dea_fenicsx.scene.cavity import Filling
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.scene.strain import cofactor
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError


@dataclass(frozen=True)
class Gas:
    """The law of a gas in dimensionless numbers.

    Attributes
    ----------
    at_rest
        Amount n at ramp factor 0, p times V at the reference volume.
    added
        Amount that is added at ramp factor 1.
    outside
        Pressure outside.
    exponent
        1 for an isothermal gas.
    volume, reference
        Undeformed and reference volume, reservoir included.
    """

    at_rest: float
    added: float
    outside: float
    exponent: float
    volume: float
    reference: float

    @classmethod
    def of(cls, told: Filling, scales: Scales) -> Gas:
        """The law of a declared gas."""
        volume = told.space.volume + told.reservoir / scales.volume
        given = told.reference_volume
        reference = volume if given is None else given / scales.volume
        outside = told.outside / scales.stress
        at_rest = outside * volume * (volume / reference) ** (told.exponent - 1)
        added = told.amount / (scales.stress * scales.volume)
        return cls(at_rest, added, outside, told.exponent, volume, reference)

    def amount(self, factor: float) -> float:
        """n at a ramp factor."""
        return self.at_rest + factor * self.added

    def pressure(self, volume: float, factor: float) -> float:
        """Pressure p at a volume, reservoir included."""
        ratio = self.reference / volume
        return float(self.amount(factor) / self.reference * ratio**self.exponent)

    def stored(self, volume: float, factor: float) -> float:
        """Psi at a volume minus Psi at the undeformed one, with the work against the outside."""
        n, k, start, end = self.amount(factor), self.exponent, self.volume, volume
        if k == 1:
            work = n * np.log(end / start)
        else:
            ends = [(self.reference / v) ** (k - 1) for v in (start, end)]
            work = n * (ends[0] - ends[1]) / (k - 1)
        return float(self.outside * (end - start) - work)


class Cavities:
    """The cavities of a problem.

    Parameters
    ----------
    scene, scales
        The scene and its units.

    Attributes
    ----------
    fillings
        What was declared, in the order of the scene.
    on_planes
        What the pressure on planes of symmetry, and on rigid walls that are not meshed, gives to
        rims that are held there, as a form, symbolic; 0 without such planes.  It belongs to the
        plane, so that no reaction of the device contains it.
    """

    def __init__(self, scene: Scene, scales: Scales) -> None:
        self.fillings: list[Filling] = scene.declared.fillings
        self._scene, self._scales = scene, scales
        self._changes: list[Any] = []
        self.on_planes: Any = 0
        self._cells = [_cells_at(scene.device, told.space.facets) for told in self.fillings]

    def __bool__(self) -> bool:
        return bool(self.fillings)

    @property
    def facets(self) -> list[np.ndarray]:
        """The walls of each cavity, as `ufl.Measure` takes them."""
        return [told.space.facets for told in self.fillings]

    # ---------------------------------------------------------------- unknowns

    def _parts(
        self, parts: Mapping[str, Mapping[str, Component]]
    ) -> list[tuple[Filling, np.ndarray, dict[str, Component]]]:
        """Each cavity with its cells and its unknowns by the name of their fields."""
        return [
            (told, cells, {name: parts[name][name] for name in told.fields})
            for told, cells in zip(self.fillings, self._cells, strict=True)
        ]

    def fix(self, values: FixedValues, parts: Mapping[str, Mapping[str, Component]]) -> None:
        """Fix what a ramp gives, and the unknowns where no wall is.  Collective."""
        for told, cells, unknowns in self._parts(parts):
            for part in unknowns.values():
                away = np.ones(len(part.dofs), dtype=bool)
                away[part.on(self._scene.device.dim, cells)] = False
                values.fix(part.dofs[away])
            if told.given_field is None:
                continue
            is_volume = told.given_field == told.volume_field
            unit = self._scales.volume * told.space.unit if is_volume else self._scales.stress
            dofs = self._touching(unknowns[told.given_field], cells)
            values.fix(dofs, told.amount / unit, told.ramp)

    def check_walls(self, values: FixedValues, motion: Sequence[Component]) -> None:
        """Raise InputError if a liquid is between walls none of which can move.  Collective."""
        device = self._scene.device
        for told in self.fillings:
            if told.kind != "liquid":
                continue
            moves = False
            for name in told.space.label.split("+"):
                for part in motion:
                    nodes = part.dofs[part.on(device.dim - 1, device.facets_by_surface[name])]
                    moves = moves or not bool(values.fixed[nodes].all())
            if not device.comm.allreduce(moves, op=MPI.LOR):
                raise InputError(
                    f"The liquid in the cavity behind {told.space.label!r} has no room, since its "
                    "walls cannot move: each of their nodes is held or prescribed; release one of "
                    "the walls, or take gas= or pressure=."
                )

    def groups(
        self, parts: Mapping[str, Mapping[str, Component]], rows: Rows
    ) -> list[TiedGroup]:
        """One group for each unknown that is not given.  Collective."""
        found = []
        for told, cells, unknowns in self._parts(parts):
            for name, part in unknowns.items():
                if name == told.given_field:
                    continue
                found.append(TiedGroup.of(self._touching(part, cells), rows, ()))
        return found

    def _touching(self, part: Component, cells: np.ndarray) -> np.ndarray:
        return np.asarray(part.dofs[part.on(self._scene.device.dim, cells)])

    def unknown(
        self, number: int, name: str, parts: Mapping[str, Mapping[str, Component]]
    ) -> np.ndarray:
        """Local degrees of freedom that hold a field of a cavity, all alike.  Collective."""
        return self._touching(parts[name][name], self._cells[number])

    # ------------------------------------------------------------------- forms

    def work(
        self, space: Unknowns, motion: Any, at: Surface, loads: Loads, ds: Any, first: int
    ) -> Any:
        """What the cavities add to the residual, symbolic.

        Parameters
        ----------
        space
            The unknowns.
        motion
            What the deformation has beside its fields, or None.
        at
            The fields on surfaces.
        loads
            The loads, to which the amounts of gas are added.
        ds
            A measure, of which subdomain `first` + k is the wall of cavity k.
        first
            Number of the first cavity's subdomain.
        """
        kinematics, mesh = self._scene.kinematics, self._scene.device.mesh
        degree = self._scene.elements.quadrature_of_volumes
        total: Any = 0
        for k, told in enumerate(self.fillings):
            wall = ds(first + k, metadata={"quadrature_degree": degree})
            change = told.space.change(kinematics, mesh, space.present["u"], motion)
            self._changes.append(change * wall)
            pressure = space.present[told.pressure_field]
            energy = -pressure * change
            if told.knows_volume:
                even = at.number(told.space.unit / told.space.area) * at.weight
                energy += pressure * space.present[told.volume_field] * even
                if told.kind == "gas":
                    total += self._gas(space, told, at, loads, wall)
            total += ufl.derivative(energy * wall, space.w, space.test)
            if not told.space.has_openings:
                self.on_planes += self._on_planes(space, motion, at, pressure, change, wall)
        return total

    def _on_planes(
        self, space: Unknowns, motion: Any, at: Surface, pressure: Any, change: Any, wall: Any
    ) -> Any:
        """The virtual work P (-dV - int cof(F) N . v dA), which is 0 but for a rim that moves."""
        kinematics, mesh = self._scene.kinematics, self._scene.device.mesh
        x, n = ufl.SpatialCoordinate(mesh), kinematics.embed(ufl.FacetNormal(mesh))
        F = ufl.Identity(3) + kinematics.displacement_gradient(space.present["u"], x, motion)
        pressed = ufl.dot(ufl.dot(cofactor(F)[0], n), at.virtual_in_space) * at.weight
        grown = ufl.derivative(change, space.w, space.test)
        return -pressure * (grown + pressed) * wall

    def _gas(self, space: Unknowns, told: Filling, at: Surface, loads: Loads, wall: Any) -> Any:
        """What the law of a gas adds to the row of its volume, spread evenly over the walls."""
        gas = Gas.of(told, self._scales)
        ratio = at.number(gas.volume / gas.reference)
        ratio += at.number(told.space.unit / gas.reference) * space.present[told.volume_field]
        # The logarithm keeps a volume below 0, which is none, from giving a number.
        per_amount = ufl.exp(-at.number(gas.exponent) * ufl.ln(ratio)) / at.number(gas.reference)
        factor, added = at.number(0.0), at.number(gas.added)
        even = at.number(told.space.unit / told.space.area) * at.weight
        virtual = space.virtual[told.volume_field] * even
        amount = at.number(gas.at_rest) + factor * added
        loads.add_strain(told.ramp, factor, added * per_amount * virtual * wall)
        return (at.number(gas.outside) - amount * per_amount) * virtual * wall

    def change(self, number: int) -> Any:
        """Change of a cavity's volume, as a form, dimensionless."""
        return self._changes[number]


def _cells_at(device: Device, facets: np.ndarray) -> np.ndarray:
    """Local cells, ghosts included, with one of some facets of owned cells.  Collective."""
    mark = dolfinx.fem.Function(dolfinx.fem.functionspace(device.mesh, ("DG", 0)))
    of_cell = mark.function_space.dofmap.list.ravel()
    mark.x.array[of_cell[facets[:, 0]]] = 1.0
    mark.x.scatter_forward()
    return np.flatnonzero(mark.x.array[of_cell] > 0.5).astype(np.int32)
