"""Virtual work of the loads on surfaces, and of what strains a region from within.

The force and the torque on a helical cell as a whole act on single unknowns: see `ties`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.mesh.device import one_sided
from dea_fenicsx.model.energy import measure
from dea_fenicsx.scene.conditions import AxialForce, DeadPressure, FollowerPressure, Torque
from dea_fenicsx.scene.kinematics import Helix, cofactor
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError


class Loads:
    """The loads of a scene on its surfaces; each ramp's factor is a constant of the form.

    Parameters
    ----------
    scene
        The scene.
    stress
        Pa in a unit of stress.
    u, v
        Displacement and its test function, symbolic.
    helix
        The test function's overall part, in a helical cell.

    Attributes
    ----------
    factors
        For each ramp the constant that holds its factor.
    unit_work
        For each ramp the virtual work at factor 1.
    work
        The whole virtual work; 0 without loads.
    following
        Ramps of loads whose direction follows the deformation.
    changing
        Ramps whose unit work depends on the state: those, and pre-stretches.
    """

    def __init__(
        self, scene: Scene, stress: float, u: Any, v: Any, helix: Helix | None = None
    ) -> None:
        mesh, kin = scene.device.mesh, scene.kinematics
        loads = [load for load in scene.loads if not isinstance(load, AxialForce | Torque)]
        self.factors = {
            # in the order of the loads: a set of names has another order on each rank
            ramp: dolfinx.fem.Constant(mesh, 0.0)
            for ramp in dict.fromkeys(load.ramp for load in loads)
        }
        self.unit_work: dict[str, Any] = {}
        self.following: set[str] = set()
        self.changing: set[str] = set()
        self.work: Any = 0
        if not loads:
            return
        sides = [
            _pressed_side(scene, load)
            if isinstance(load, DeadPressure | FollowerPressure)
            else one_sided(scene.device, load.where)
            for load in loads
        ]
        ds = measure(scene.device, sides, scene.elements.quadrature_degree, "ds")
        x, normal = ufl.SpatialCoordinate(mesh), ufl.FacetNormal(mesh)
        weight = kin.weight(x)
        v = kin.motion(v, x, helix)
        for k, load in enumerate(loads):
            if isinstance(load, DeadPressure):
                pressure = dolfinx.fem.Constant(mesh, load.pascal / stress)
                unit_work = -pressure * ufl.dot(kin.normal(normal, x, helix), v) * weight * ds(k)
            elif isinstance(load, FollowerPressure):
                # force on an area element: -p cof(F) N dA, undeformed area and normal
                pressure = dolfinx.fem.Constant(mesh, load.pascal / stress)
                gradient = kin.displacement_gradient(u, x)
                area = ufl.dot(cofactor(ufl.Identity(3) + gradient)[0], kin.embed(normal))
                unit_work = -pressure * ufl.dot(area, kin.embed(v)) * weight * ds(k)
                self.following.add(load.ramp)
                self.changing.add(load.ramp)
            else:
                traction = dolfinx.fem.Constant(mesh, np.array(load.pascal) / stress)
                unit_work = ufl.dot(traction, v) * weight * ds(k)
            self.unit_work[load.ramp] = self.unit_work.get(load.ramp, 0) + unit_work
            self.work += self.factors[load.ramp] * unit_work


    def add_strain(self, ramp: str, factor: Any, work: Any) -> None:
        """A pre-stretch: its factor is part of the energy, `work` minus the residual's derivative
        by it."""
        self.factors[ramp] = factor
        self.unit_work[ramp] = self.unit_work.get(ramp, 0) + work
        self.changing.add(ramp)


def _pressed_side(scene: Scene, load: DeadPressure | FollowerPressure) -> np.ndarray:
    """Facets of a pressure, seen from the material it presses on."""
    device, materials = scene.device, scene.materials
    pairs = {name: one_sided(device, load.where, frozenset([device.regions[name]]))
             for name in ([load.on] if load.on else materials)}  # fmt: skip
    counts = {n: device.comm.allreduce(len(p), op=MPI.SUM) for n, p in pairs.items()}
    total = device.comm.allreduce(len(one_sided(device, load.where)), op=MPI.SUM)
    touching = [n for n, c in counts.items() if c]
    if sum(counts.values()) > total:
        touching = [n for n in touching if materials[n].is_dielectric]
    if sum(counts[n] for n in touching) != total:
        raise InputError(
            f"It is not clear which side the pressure on {load.where!r} presses; name the "
            f"region with {type(load).__name__}(..., on=...), one of: "
            f"{', '.join(sorted(materials))}."
        )
    return np.concatenate([pairs[n] for n in touching])
