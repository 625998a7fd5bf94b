"""What springs prevent of rigid motions: foundations of surfaces, and springs to the ground.

A device on springs is held by them, though it moves as they give way.  So nothing else needs to
hold it there, and what holds a free body must not be in their way.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dea_fenicsx.mesh.device import Device
from dea_fenicsx.model.components import Component
from dea_fenicsx.scene.declared import Declared
from dea_fenicsx.scene.springs import FoundationWork, SpringForce
from dea_fenicsx.scene.torsion import TorsionMoment

COARSE_STEP, FINE_STEP = 1e-6, 1e-9
"""Elongations, over the size of the device, from which we take the stiffness of a force law.

A law that has a stiffness at 0 has about the same one at both.
"""


def on_foundations(
    declared: Declared, device: Device, motion: Sequence[Component], size: int
) -> np.ndarray:
    """Mask of the `size` local degrees of freedom of displacements along foundations.  Collective.

    Parameters
    ----------
    declared
        What the conditions of a scene declare.
    device, motion
        The device, and the displacement components.
    size
        Number of local degrees of freedom of the mixed space.
    """
    found = np.zeros(size, dtype=bool)
    for _, work in declared.surface_works:
        if not isinstance(work, FoundationWork):
            continue
        for part, stiffness in zip(motion, work.stiffness, strict=True):
            if stiffness > 0:
                facets = device.facets_by_surface[work.surface]
                found[part.dofs[part.on(device.dim - 1, facets)]] = True
    return found


def spring_directions(
    springs: Sequence[SpringForce], name: str, axes: str, centre: np.ndarray, length: float
) -> np.ndarray:
    """Directions along which springs to the ground hold the centre of a rigid part.

    Parameters
    ----------
    springs
        All springs on rigid parts.
    name
        The name of the part.
    axes
        Names of the displacement components.
    centre
        The centre of the part, dimensionless.
    length
        The unit of length in m.

    Returns
    -------
    ndarray of shape (n, axes)
        Unit vectors, for those springs that have a stiffness at the start.
    """
    found = []
    for told in springs:
        if told.surface != name or told.to is not None or isinstance(told, TorsionMoment):
            continue
        if not _is_stiff(told, length):
            continue
        if told.axis is not None:
            found.append(np.eye(len(axes))[axes.index(told.axis)])
            continue
        arm = centre - np.array(told.anchor) / length
        if (size := float(np.linalg.norm(arm))) > 0:
            found.append(arm / size)
    return np.array(found).reshape(len(found), len(axes))


def sprung_turns(springs: Sequence[SpringForce], name: str) -> str:
    """Axes about which torsional springs to the ground hold a rigid part."""
    return "".join(
        str(told.axis) for told in springs
        if isinstance(told, TorsionMoment) and told.surface == name and told.to is None
        and _is_stiff(told, 1.0)
    )  # fmt: skip


def _is_stiff(told: SpringForce, length: float) -> bool:
    """Whether the force of a spring changes with its elongation at the start.

    `length` is the unit of the elongation.

    A force that grows as a higher power than the first falls faster than its elongation.
    """
    steps = (COARSE_STEP * length, FINE_STEP * length)
    coarse, fine = (float(told.law(step)) - float(told.law(-step)) for step in steps)
    return bool(np.isfinite(fine) and abs(fine) > 0.1 * FINE_STEP / COARSE_STEP * abs(coarse))
