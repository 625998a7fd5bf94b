"""Resultants of loads that no support bears, refused before anything is solved."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.components import Component
from dea_fenicsx.model.fixed_values import Constraints
from dea_fenicsx.model.rigid_motions import FreePart, in_words, modes, translations
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.errors import InputError

UNBALANCED_SHARE = 1e-8
"""Resultants below this share of the sum of the sizes of all forces are rounding errors."""


def check_balance(
    scene: Scene,
    scales: Scales,
    parts: Sequence[Component],
    constraints: Constraints,
    ramps: Iterable[str],
    forces_of: Callable[[str], np.ndarray],
) -> None:
    """Raise InputError if the loads of a ramp have a resultant that nothing bears.  Collective.

    A resultant force along a translation that only `FreeBody` prevents is one.  So is a moment
    about an axis of rotation that only `FreeBody` prevents, unless the body turns freely about it:
    then `DeadLoad` turns it until the moment vanishes, but the moment of a pressure never does.

    Parameters
    ----------
    scene, scales
        The scene and its units.
    parts
        Its displacement components.
    constraints
        What `FreeBody` holds in it, and by which ramps the body turns.
    ramps
        Names of the ramps that drive loads on surfaces.
    forces_of
        Minus the nodal forces of a ramp at factor 1, at all owned degrees of freedom.
    """
    driven = {load.ramp for load in scene.loads}
    mine = [ramp for ramp in ramps if ramp in driven]
    released = constraints.released
    if scene.kinematics.periodic_ends is not None:
        for ramp in mine:
            _check_cell(scene, parts, ramp, forces_of(ramp))
    elif released is not None:
        shifts = translations(released.motions, scene.kinematics.rotations)
        for ramp in mine:
            forces = -forces_of(ramp)
            _check_free(scene, scales, parts, released, shifts, ramp, forces, "force")
            if ramp not in constraints.turns:
                motions = released.motions
                _check_free(scene, scales, parts, released, motions, ramp, forces, "moment")


def _check_free(
    scene: Scene, scales: Scales, parts: Sequence[Component], released: FreePart,
    motions: np.ndarray, ramp: str, forces: np.ndarray, what: str,
) -> None:  # fmt: skip
    """Raise InputError if forces do work on a motion that only `FreeBody` prevents."""
    kinematics, box = scene.kinematics, released.box
    sums = np.zeros((2, len(motions)))
    for a, part in enumerate(parts):
        # Only the forces on this part count: the device may have other parts, which are held.
        mine = np.zeros(len(part.dofs), dtype=bool)
        mine[part.space.dofmap.list[released.cells].ravel()] = True
        mine &= part.dofs < len(forces)
        rows = modes(part.space.tabulate_dof_coordinates()[mine], a, kinematics, box) @ motions.T
        work = forces[part.dofs[mine], None] * rows
        sums += np.array([work.sum(axis=0), np.abs(work).sum(axis=0)])
    total, size = scene.device.comm.allreduce(sums, op=MPI.SUM)
    # Forces across the motions cause rounding errors along them, so the size of all forces counts.
    everything = _size(scene, forces) * float(np.abs(motions).max(initial=0.0))
    if np.linalg.norm(total) <= UNBALANCED_SHARE * max(float(np.linalg.norm(size)), everything):
        return
    along = in_words((total @ motions)[None], box, kinematics, scene.device.length)
    newtons = np.linalg.norm(total) * scales.force
    amount = f" of {newtons:.3g} N" if what == "force" else ""
    raise InputError(
        f"The loads of ramp {ramp!r} have a resultant {what}{amount} that nothing bears: FreeBody "
        f"leaves the {along} free; balance the loads, or hold the device there with Fix or Clamp."
    )


def _check_cell(scene: Scene, parts: Sequence[Component], ramp: str, forces: np.ndarray) -> None:
    """In a periodic cell nothing can bear a resultant of surface loads."""
    _, hoop, axial = parts
    everything = _size(scene, forces)
    for part, what in ((axial, "force"), (hoop, "torque")):
        mine = part.dofs < len(forces)
        arm = part.space.tabulate_dof_coordinates()[mine, 0] if what == "torque" else 1.0
        moments = forces[part.dofs[mine]] * arm
        # The coordinates are at most 1, so `everything` bounds the rounding of a torque as well.
        total = scene.device.comm.allreduce(float(moments.sum()), op=MPI.SUM)
        if abs(total) > UNBALANCED_SHARE * everything:
            raise InputError(
                f"The surface loads of ramp {ramp!r} have an axial {what} as resultant, "
                "which nothing in a helical cell can bear; balance them, or apply "
                f"{'AxialForce' if what == 'force' else 'Torque'}(...) to the cell."
            )


def _size(scene: Scene, forces: np.ndarray) -> float:
    """Sum of the sizes of all nodal forces, dimensionless.  Collective."""
    return scene.device.comm.allreduce(float(np.abs(forces).sum()), op=MPI.SUM)
