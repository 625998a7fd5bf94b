"""Virtual work of body forces, with densities and forces as cell-wise coefficients."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import ufl

from dea_fenicsx.model.scales import Scales
from dea_fenicsx.model.unknowns import Unknowns
from dea_fenicsx.scene.kinematics import GlobalMotion
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.compat import dolfinx


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

    def number(self, value: Any) -> Any:
        """A number, or several, as a constant of the form."""
        return dolfinx.fem.Constant(self._mesh, value)

    def _cellwise(self, value: Callable[[str], float]) -> Any:
        found = dolfinx.fem.Function(self._constant)
        for name in self._scene.materials:
            found.x.array[self._scene.device.cells_of(name)] = value(name)
        return found
