"""Resultants of loads that no support bears, refused before anything is solved."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.components import Component
from dea_fenicsx.model.conditions import Conditions
from dea_fenicsx.model.forms import Forms
from dea_fenicsx.model.free_body import HeldBody
from dea_fenicsx.model.motion_words import in_words
from dea_fenicsx.model.rigid_motions import FreePart
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.support.errors import InputError

UNBALANCED_SHARE = 1e-8
"""Resultants below this share of the sum of the sizes of all forces are rounding errors."""


Forces = Callable[[str], np.ndarray]
"""Minus the nodal forces of a ramp at factor 1, at all owned degrees of freedom."""


def check_free_body(
    body: HeldBody, motion: Sequence[Component], ramps: Sequence[str], forces_of: Forces,
    scales: Scales,
) -> None:  # fmt: skip
    """Raise InputError if the loads of a ramp have a resultant that nothing bears.  Collective.

    A resultant force along a translation that only `FreeBody` prevents is one.  So is a moment
    about an axis of rotation that only `FreeBody` prevents, unless the body turns freely about it:
    then `DeadLoad` turns it until the moment vanishes, but the moment of a pressure never does.

    Parameters
    ----------
    body
        What `FreeBody` holds, and by which ramps the body turns.
    motion
        The displacement components.
    ramps
        Names of the ramps that drive loads on surfaces.
    forces_of
        The forces of a ramp.
    scales
        The units.
    """
    for ramp in ramps:
        forces = -forces_of(ramp)
        kinds = {"force": body.part.translations}
        if ramp not in body.turns:
            kinds["moment"] = body.part.motions
        for what, motions in kinds.items():
            total, size = _work(body.part, motion, motions, forces)
            if np.linalg.norm(total) <= UNBALANCED_SHARE * size:
                continue
            along = in_words(
                body.part.kinematics, body.part.box, (total @ motions)[None], scales.length
            )
            newtons = np.linalg.norm(total) * scales.force
            amount = f" of {newtons:.3g} N" if what == "force" else ""
            raise InputError(
                f"The loads of ramp {ramp!r} have a resultant {what}{amount} that nothing bears: "
                f"FreeBody leaves the {along} free; balance the loads, or hold the device there "
                "with Fix or Clamp."
            )


def _work(
    part: FreePart, motion: Sequence[Component], motions: np.ndarray, forces: np.ndarray
) -> tuple[np.ndarray, float]:
    """Work of nodal forces on each of a part's motions, and a bound of its size.  Collective."""
    comm = motion[0].space.mesh.comm
    sums = np.zeros((2, len(motions)))
    for a, component in enumerate(motion):
        # Only the forces on this part count: the device may have other parts, which are held.
        mine = part.holds(component) & (component.dofs < len(forces))
        x = component.space.tabulate_dof_coordinates()[mine]
        rows = part.kinematics.rigid_motions(x, a, *part.box) @ motions.T
        work = forces[component.dofs[mine], None] * rows
        sums += np.array([work.sum(axis=0), np.abs(work).sum(axis=0)])
    total, size = comm.allreduce(sums, op=MPI.SUM)
    # Forces across the motions cause rounding errors along them, so the size of all forces counts.
    everything = _size(comm, forces) * float(np.abs(motions).max(initial=0.0))
    return total, max(float(np.linalg.norm(size)), everything)


def check_balance(
    conditions: Conditions, forms: Forms, displacement: list[Component], scales: Scales,
    released: bool,
) -> None:  # fmt: skip
    """Raise InputError if loads on surfaces have a resultant that nothing bears.  Collective."""
    body, ramps = conditions.body, forms.loads.on_surfaces
    if conditions.pairs is not None:
        check_cell(displacement, ramps, forms.load_vector)
    elif body is not None and not released:
        check_free_body(body, displacement, ramps, forms.load_vector, scales)


def check_cell(motion: Sequence[Component], ramps: Sequence[str], forces_of: Forces) -> None:
    """Raise InputError if the loads on a periodic cell have a resultant.  Collective.

    Nothing in a cell can bear a resultant of surface loads.

    Parameters
    ----------
    motion
        The displacement components.
    ramps
        Names of the ramps that drive loads on surfaces.
    forces_of
        The forces of a ramp.
    """
    _, hoop, axial = motion
    comm = axial.space.mesh.comm
    for ramp in ramps:
        forces = forces_of(ramp)
        everything = _size(comm, forces)
        for part, what in ((axial, "force"), (hoop, "torque")):
            mine = part.dofs < len(forces)
            arm = part.space.tabulate_dof_coordinates()[mine, 0] if what == "torque" else 1.0
            moments = forces[part.dofs[mine]] * arm
            # The coordinates are at most 1, so `everything` bounds the rounding of a torque, too.
            total = comm.allreduce(float(moments.sum()), op=MPI.SUM)
            if abs(total) > UNBALANCED_SHARE * everything:
                raise InputError(
                    f"The surface loads of ramp {ramp!r} have an axial {what} as resultant, "
                    "which nothing in a helical cell can bear; balance them, or apply "
                    f"{'AxialForce' if what == 'force' else 'Torque'}(...) to the cell."
                )


def _size(comm: MPI.Comm, forces: np.ndarray) -> float:
    """Sum of the sizes of all nodal forces, dimensionless.  Collective."""
    return comm.allreduce(float(np.abs(forces).sum()), op=MPI.SUM)
