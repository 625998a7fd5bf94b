"""Velocities and accelerations of the nodes of rigid parts where a motion starts.

The nodes follow the unknowns q of a part, u = g(q).  So their velocity and acceleration are

    v = (dg/dq) q',        a = (dg/dq) q'' + w x (w x y),

with the spin w and the turned arms y.  What is prescribed of q', `Turn` and `Displacement` give.
All else of it is what fits best to a velocity that the nodes have.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.rigid_parts import RigidPart, RigidParts

SMALLEST_MOTION_OF_NODES = 1e-12
"""Motions of a part that move its nodes by a smaller share are none, such as a turn of one node."""


def start_of_parts(
    rigid: RigidParts, velocity: np.ndarray, acceleration: np.ndarray, at: np.ndarray,
    fixed: np.ndarray, owned: int, comm: MPI.Comm,
) -> None:  # fmt: skip
    """Let the nodes of rigid parts start as these move.  Collective.

    Parameters
    ----------
    rigid
        The parts.
    velocity, acceleration
        Rates of all local values.  They hold what is prescribed of the unknowns of the parts, which
        becomes 0, and get what follows at the nodes, but for the accelerations q'' that are free.
    at
        Values of the state.
    fixed
        Mask of the fixed local degrees of freedom.
    owned
        How many of the local degrees of freedom this rank owns.
    comm
        The communicator.
    """
    for part in rigid.parts:
        given = np.array([
            comm.allreduce(bool(np.all(fixed[dofs])), op=MPI.LAND) for dofs in part.unknowns
        ])  # fmt: skip
        slopes, n = part.slopes(at), len(part.shifts)
        rates, pulls = (_prescribed(part, array, at, given) for array in (velocity, acceleration))
        rates = _fitted(part, slopes, velocity, rates, given, owned, comm)
        for dofs in part.unknowns:
            velocity[dofs] = acceleration[dofs] = 0.0
        inwards = _centripetal(part.turned(at), rates[n:])
        for a, dofs in enumerate(part.dofs):
            velocity[dofs] = slopes[:, a] @ rates
            acceleration[dofs] = slopes[:, a] @ pulls + inwards[:, a]


def turn_on(
    rigid: RigidParts, guess: np.ndarray, old: np.ndarray, new: np.ndarray, share: float
) -> None:
    """Let parts in a guess turn as from an old to a new state, by a share of that spin.

    A polynomial through rotation vectors is no guess where they are near a whole turn.
    """
    for part in rigid.parts:
        if part.turns_freely:
            n, turning = len(part.shifts), part.turning
            last = part.values(new)[n:]
            spin = share * turning.between(part.values(old)[n:], last)
            for dofs, psi in zip(part.unknowns[n:], turning.composed(spin, last), strict=True):
                guess[dofs] = psi


def _prescribed(
    part: RigidPart, array: np.ndarray, at: np.ndarray, given: np.ndarray
) -> np.ndarray:
    """The prescribed rates of a part, with a spin for those of its rotation vector."""
    found, n = part.values(array), len(part.shifts)
    # A prescribed rotation has an axis that stays, so that its spin is the rate of its vector.
    found[n:] = part.turning.spin(part.split(part.values(at))[1], found[n:])
    return np.asarray(np.where(given, found, 0.0))


def _fitted(
    part: RigidPart, slopes: np.ndarray, velocity: np.ndarray, rates: np.ndarray,
    given: np.ndarray, owned: int, comm: MPI.Comm,
) -> np.ndarray:  # fmt: skip
    """Rates of a part: the given ones, and those that fit best to a velocity of its nodes."""
    size = len(rates)
    sums = np.zeros((size, size + 1))
    for a, dofs in enumerate(part.dofs):
        mine = (dofs < owned) & (np.arange(len(dofs)) < part.meshed)
        rows = slopes[mine, a]
        rest = velocity[dofs[mine]] - rows @ rates
        sums += rows.T @ np.column_stack([rows, rest])
    sums = comm.allreduce(sums, op=MPI.SUM)
    free = np.flatnonzero(~given)
    found = rates.copy()
    if len(free):
        matrix, right = sums[np.ix_(free, free)], sums[free, -1]
        found[free] = np.linalg.lstsq(matrix, right, rcond=SMALLEST_MOTION_OF_NODES)[0]
    return found


def _centripetal(y: np.ndarray, spin: np.ndarray) -> np.ndarray:
    """The acceleration w x (w x y) of turned arms, shape (nodes, axes)."""
    if len(spin) == 3:
        return np.asarray(np.cross(spin, np.cross(spin, y)))
    return -float(spin @ spin) * y
