"""Virtual work of the loads on surfaces, and of pre-stretches.

The force and the torque on a helical cell as a whole act on global unknowns, see `tied_unknowns`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.materials import Material
from dea_fenicsx.mesh.device import Device, one_sided
from dea_fenicsx.scene.body_forces import BodyWork
from dea_fenicsx.scene.condition import Condition
from dea_fenicsx.scene.declarations import SurfaceWork
from dea_fenicsx.scene.kinematics import GlobalMotion, Kinematics, cofactor
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError


class Loads:
    """The loads of a scene on its surfaces; each ramp's factor is a constant of the form.

    Parameters
    ----------
    works
        The virtual work of each load.
    at
        The fields on surfaces.
    ds
        A measure, of which subdomain k is the surface of load k.

    Attributes
    ----------
    on_surfaces
        Ramps that drive loads on surfaces and body forces.
    factors
        For each ramp the constant that holds its factor.
    further
        More constants that hold the factor of a ramp.
    unit_work
        For each ramp the virtual work at factor 1.
    work
        The whole virtual work; 0 without loads.
    standing
        The virtual work of elastic foundations, which no ramp drives; 0 without them.
    following
        Ramps of loads whose direction follows the deformation.
    changing
        Ramps whose unit work depends on the state: those, pre-stretches, and moving obstacles.
    travels
        The ramps that move obstacles, each with the constant that holds its factor.
    unsymmetric
        What loads whose tangent is not symmetric are called.
    """

    def __init__(self, works: Sequence[SurfaceWork], at: Surface, ds: Any) -> None:
        # We keep the order of the loads: a set would have a different order on each rank.
        self._number = at.number
        self.on_surfaces = tuple(dict.fromkeys(work.ramp for work in works if work.ramp))
        self.factors = {ramp: at.number(0.0) for ramp in self.on_surfaces}
        self.further: list[tuple[str, Any]] = []
        self.unit_work: dict[str, Any] = {}
        self.following: set[str] = set()
        self.changing: set[str] = set()
        self.travels: list[tuple[str, Any]] = []
        self.unsymmetric: list[str] = []
        self.work: Any = 0
        self.standing: Any = 0
        for k, load in enumerate(works):
            unit_work = load.density(at) * at.weight * ds(k)
            if not load.ramp:
                self.standing += unit_work
                continue
            if load.follows:
                self.following.add(load.ramp)
                self.changing.add(load.ramp)
            if not load.symmetric:
                self.unsymmetric.append(f"{type(load).__name__} on {load.surface!r}")
            self.unit_work[load.ramp] = self.unit_work.get(load.ramp, 0) + unit_work
            self.work += self.factors[load.ramp] * unit_work

    def add_body(self, work: BodyWork, unit_work: Any) -> None:
        """Add a body force, with its virtual work at factor 1; its ramp counts as one on surfaces.

        Where it depends on the place it has a potential, so that its tangent is symmetric.
        """
        ramp = work.ramp
        if ramp not in self.factors:
            self.on_surfaces = (*self.on_surfaces, ramp)
            self.factors[ramp] = self._number(0.0)
        if work.follows:
            self.changing.add(ramp)
        self.unit_work[ramp] = self.unit_work.get(ramp, 0) + unit_work
        self.work += self.factors[ramp] * unit_work

    def add_strain(self, ramp: str, factor: Any, work: Any) -> None:
        """Add a pre-stretch, or an amount of gas, whose factor is part of the energy.

        `work` is minus the derivative of the residual by this factor.
        """
        self.factors.setdefault(ramp, factor)
        if self.factors[ramp] is not factor:
            self.further.append((ramp, factor))
        self._add_changing(ramp, work)

    def add_travel(self, ramp: str, factor: Any, work: Any) -> None:
        """Add an obstacle that a ramp moves, as `add_strain` adds a pre-stretch."""
        self.travels.append((ramp, factor))
        self._add_changing(ramp, work)

    def _add_changing(self, ramp: str, work: Any) -> None:
        self.unit_work[ramp] = self.unit_work.get(ramp, 0) + work
        self.changing.add(ramp)

    @property
    def constants(self) -> list[tuple[str, Any]]:
        """Each constant that holds the factor of a ramp, with the ramp."""
        return [*self.factors.items(), *self.further, *self.travels]


class Surface:
    """Fields on a surface of the device, symbolic; see `declarations.SurfaceFields`.

    Parameters
    ----------
    kinematics
        The kinematics.
    mesh
        The mesh.
    stress
        Pa in a unit of stress.
    u, v
        Displacement and its test function, symbolic.
    virtual_motion
        The test function's global part, or None.
    """

    def __init__(
        self, kinematics: Kinematics, mesh: Any, stress: float, u: Any, v: Any,
        virtual_motion: GlobalMotion | None,
    ) -> None:  # fmt: skip
        self.x, self._normal = ufl.SpatialCoordinate(mesh), ufl.FacetNormal(mesh)
        self._kinematics, self._mesh, self._stress, self._u = kinematics, mesh, stress, u
        self._virtual_motion = virtual_motion
        self.virtual = kinematics.motion(v, self.x, virtual_motion)

    @property
    def weight(self) -> Any:
        """Area per area of the mesh."""
        return self._kinematics.weight(self.x)

    @property
    def virtual_in_space(self) -> Any:
        """Virtual displacement as a 3-vector."""
        return self._kinematics.embed(self.virtual)

    @property
    def displacement(self) -> Any:
        """Displacement in units of the device's length, in the components of u."""
        return self._u

    @property
    def normal(self) -> Any:
        """Undeformed normal in the components of u."""
        return self._kinematics.normal(self._normal, self.x, self._virtual_motion)

    @property
    def deformed_area(self) -> Any:
        """Area element cof(F) N per undeformed area."""
        kinematics = self._kinematics
        F = ufl.Identity(3) + kinematics.displacement_gradient(self._u, self.x)
        return ufl.dot(cofactor(F)[0], kinematics.embed(self._normal))

    def stress(self, pascal: float | tuple[float, ...]) -> Any:
        """A stress in Pa, or several, as a dimensionless constant of the form."""
        return self.number(np.array(pascal) / self._stress)

    def number(self, value: Any) -> Any:
        """A number, or several, as a constant of the form."""
        return dolfinx.fem.Constant(self._mesh, value)


def loaded_sides(
    works: Sequence[tuple[Condition, SurfaceWork]], device: Device,
    materials: Mapping[str, Material],
) -> list[np.ndarray]:  # fmt: skip
    """For each load its facets, each once over all ranks and seen from one cell, see `one_sided`.

    Collective.

    Raises
    ------
    InputError
        If it is not clear on which side of a surface a pressure presses.
    """
    return [
        _pressed_side(load, work, device, materials)
        if work.one_side
        else one_sided(device, work.surface)
        for load, work in works
    ]


def _pressed_side(
    load: Condition, work: SurfaceWork, device: Device, materials: Mapping[str, Material]
) -> np.ndarray:
    """Facets of a pressure, each with the cell of the material on which it presses."""
    pairs = {name: one_sided(device, work.surface, frozenset([device.regions[name]]))
             for name in ([work.pressed_region] if work.pressed_region else materials)}  # fmt: skip
    counts = {n: device.comm.allreduce(len(p), op=MPI.SUM) for n, p in pairs.items()}
    total = device.comm.allreduce(len(one_sided(device, work.surface)), op=MPI.SUM)
    touching = [n for n, c in counts.items() if c]
    if sum(counts.values()) > total:
        touching = [n for n in touching if materials[n].is_dielectric]
    if sum(counts[n] for n in touching) != total:
        raise InputError(
            f"It is not clear which side the pressure on {work.surface!r} presses; name the "
            f"region with {type(load).__name__}(..., on=...), one of: "
            f"{', '.join(sorted(materials))}."
        )
    return np.concatenate([pairs[n] for n in touching])
