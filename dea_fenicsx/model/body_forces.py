"""Virtual work of body forces, with densities and forces as cell-wise coefficients."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import basix
import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.model.scales import Scales
from dea_fenicsx.model.unknowns import Unknowns
from dea_fenicsx.scene.kinematics import GlobalMotion
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError

LEAST_SINE = 1e-6
"""Sine of the least angle between a membrane and the direction to a point on one of its sides."""


class Body:
    """Fields in a device, symbolic; see `scene.body_forces.BodyFields`.

    Parameters
    ----------
    scene, scales, space
        The scene, its units and its unknowns.
    virtual_motion
        The test function's global part, or None.
    """

    def __init__(
        self, scene: Scene, scales: Scales, space: Unknowns, virtual_motion: GlobalMotion | None
    ) -> None:
        self._scene, self._scales, self._mesh = scene, scales, scene.device.mesh
        self._displacement = space.present["u"]
        x, axes = ufl.SpatialCoordinate(self._mesh), range(len(scene.kinematics.axes))
        self.virtual = scene.kinematics.motion(space.virtual["u"], x, virtual_motion)
        self.place = ufl.as_vector([x[a] + space.present["u"][a] for a in axes])
        self.length = scales.length
        self._constant = dolfinx.fem.functionspace(self._mesh, ("DG", 0))

    @property
    def mass(self) -> Any:
        """Density times the unit of length over that of stress."""
        unit = self._scales.length / self._scales.stress
        materials = self._scene.materials
        return self._cellwise(lambda name: (materials[name].density or 0.0) * unit)

    def force(self, newtons_per_cubic_metre: tuple[float, ...], regions: Sequence[str]) -> Any:
        """A force per volume in N/m^3 in some regions, and 0 elsewhere, dimensionless."""
        unit = self._scales.length / self._scales.stress
        inside = self._cellwise(lambda name: unit * (name in regions))
        return inside * self.number(newtons_per_cubic_metre)

    def pressure(
        self, pascal: float, away_from: tuple[float, ...], regions: Sequence[str]
    ) -> Any:
        """Virtual work per volume of a pressure in Pa on regions of a membrane.  Collective.

        Raises
        ------
        InputError
            If the point lies in the tangent plane of a cell, so that the side is not clear.
        """
        kinematics, x = self._scene.kinematics, ufl.SpatialCoordinate(self._mesh)
        gradient = kinematics.displacement_gradient(self._displacement, x)
        through = ufl.dot(ufl.Identity(3) + gradient, kinematics.film.unit_normal(x))
        area = through / ufl.dot(through, through)  # cof(F) N, since det F = 1
        per_volume = self.number(pascal / self._scales.stress * self._scales.length)
        side = self._side(away_from, regions)
        thickness = self.number(self._scales.length * kinematics.lead(self._scales.length))
        return per_volume / thickness * side * ufl.dot(area, kinematics.embed(self.virtual))

    def _side(self, away_from: tuple[float, ...], regions: Sequence[str]) -> Any:
        """1 in each cell of regions whose normal points away from a point, -1 where to it."""
        device, kinematics = self._scene.device, self._scene.kinematics
        x = ufl.SpatialCoordinate(self._mesh)
        middle = basix.geometry(getattr(basix.CellType, self._mesh.topology.cell_name()))
        point = ufl.as_vector([self.number(value / self.length) for value in away_from])
        away = kinematics.embed(x - point)
        along = ufl.dot(away, kinematics.film.unit_normal(x)) / ufl.sqrt(ufl.dot(away, away))
        evaluate = compat.expression(ufl.as_vector([along]), middle.mean(axis=0, keepdims=True))
        found = dolfinx.fem.Function(self._constant)
        cells = np.concatenate([device.cells_of(name) for name in regions])
        values = evaluate(self._mesh, cells)[:, 0, 0]
        unclear = bool(np.any(~(np.abs(values) > LEAST_SINE)))
        if device.comm.allreduce(unclear, op=MPI.LOR):
            raise InputError(
                "away_from= of MembranePressure lies in the surface of the film, so that it is not "
                "clear to which side the pressure pushes; give a point beside the film."
            )
        found.x.array[cells] = np.sign(values)
        return found

    def number(self, value: Any) -> Any:
        """A number, or several, as a constant of the form."""
        return dolfinx.fem.Constant(self._mesh, value)

    def _cellwise(self, value: Callable[[str], float]) -> Any:
        found = dolfinx.fem.Function(self._constant)
        for name in self._scene.materials:
            found.x.array[self._scene.device.cells_of(name)] = value(name)
        return found
