"""Air: which energy it has, and which of its unknowns follow the body.

The elastic energy of the air is so small that the errors of the field's discrete energy, which are
tiny forces on the nodes of the air, would fold its cells.  So the nodes inside the air are no free
unknowns of the equilibrium.  They make the energy M of the air's shape smallest, for the surface of
the body as it is, which the multiplier eta ensures: the energy of the device has the term
dM(u)[eta].  Each component of eta adds one positive and one negative eigenvalue to those of the
device in which the air follows the body, whatever the sign of all else on these nodes is: for an
invertible matrix C the matrix | H C^T; C 0 | has as many of one sign as of the other.  So the count
of negative eigenvalues is that of the device, and modes of the air alone are none.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dea_fenicsx.materials import Air
from dea_fenicsx.mesh.device import Device
from dea_fenicsx.model.components import Component
from dea_fenicsx.model.fields import SHAPE_OF_AIR, Role
from dea_fenicsx.model.fixed_values import FixedValues
from dea_fenicsx.model.rigid_motions import FreePart, Joined, Ties, free_parts
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.model.unknowns import Unknowns
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support import compat


@dataclass(frozen=True)
class BoundAir:
    """The air of a kernel.

    Attributes
    ----------
    modulus
        Cell-wise shear modulus, dimensionless.
    smoothing
        Cell-wise weight of the second derivatives of u, the smoothing times the square of the size
        of a cell, dimensionless; None where there is no smoothing.
    """

    modulus: Any
    smoothing: Any | None


def bound_air(
    scene: Scene, scales: Scales, cellwise: Callable, names: Sequence[str]
) -> BoundAir | None:
    """The air of a kernel with some regions, or None where they are solid."""
    materials: dict[str, Air] = {}
    for name in names:
        material = scene.materials[name]
        if isinstance(material, Air):
            materials[name] = material
    if not materials:
        return None
    moduli = [m.elastic.shear_modulus() for m in scene.solids.values()]
    softest = min(moduli, default=scales.stress) / scales.stress
    modulus = cellwise(lambda name: materials[name].stiffness * softest)
    if not any(m.smoothing for m in materials.values()):
        return BoundAir(modulus, None)
    smoothing = cellwise(lambda name: materials[name].smoothing)
    smoothing.x.array[:] *= _squared_sizes(scene.device)
    return BoundAir(modulus, smoothing)


def _squared_sizes(device: Device) -> np.ndarray:
    """Square of the largest edge of each local cell's box, dimensionless."""
    x = device.mesh.geometry.x[compat.geometry_dofmap(device.mesh)]
    sizes = (x.max(axis=1) - x.min(axis=1)).max(axis=1) if len(x) else np.empty(0)
    return np.asarray(sizes) ** 2


def cells_in(device: Device, regions: Sequence[str]) -> np.ndarray:
    """Mask of the local cells of some regions, ghosts included."""
    imap = device.mesh.topology.index_map(device.dim)
    found = np.zeros(imap.size_local + imap.num_ghosts, dtype=bool)
    for name in regions:
        found[device.cells_of(name)] = True
    return found


def has_moving_air(scene: Scene) -> bool:
    """Whether there is air beside solids, which it follows."""
    return 0 < len(scene.solids) < len(scene.materials)


def unheld_parts(
    scene: Scene, motion: Sequence[Component], fixed: np.ndarray,
    joined: Sequence[Joined], ties: Ties | None,
) -> list[FreePart]:
    """The parts of the device that can move freely, as of `free_parts`.  Collective.

    What nothing but air holds can move, too.
    """
    device, kinematics = scene.device, scene.kinematics
    found = free_parts(device, kinematics, motion, fixed, joined, ties)
    if not found and has_moving_air(scene):
        solid = cells_in(device, tuple(scene.solids))
        found = free_parts(device, kinematics, motion, fixed, joined, ties, solid)
    return found


def fix_shape_of_air(
    values: FixedValues, scene: Scene, space: Unknowns, carried: np.ndarray
) -> None:
    """Fix the multiplier of the air's shape where nothing follows the body.  Collective.

    What is left are the nodes inside the air, or on its outer surface, whose displacement nothing
    else gives.

    Parameters
    ----------
    values
        The fixed values; all others are known.
    scene, space
        The scene and its unknowns.
    carried
        Mask of the degrees of freedom of the mixed space that move with rigid parts.
    """
    if SHAPE_OF_AIR not in space.parts:
        return
    device = scene.device
    solid = np.flatnonzero(cells_in(device, tuple(scene.solids))).astype(np.int32)
    for part, mine in zip(space.of(Role.MOTION), space.parts[SHAPE_OF_AIR].values(), strict=True):
        given = (values.fixed | carried)[part.dofs]
        given[part.on(device.dim, solid)] = True
        values.fix(mine.dofs[given])
