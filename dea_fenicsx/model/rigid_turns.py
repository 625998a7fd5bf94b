"""Rotations of rigid parts: their matrices, and derivatives with respect to further rotations.

A rotation R is stored by its rotation vector psi, R = exp([psi]), whose length counts several
turns.  In space the change of a rotation is a spin w:

    R -> exp([w]) R.

For y = R a with a fixed arm a, the first derivatives with respect to w at w = 0 are dy = w x y, and
the second ones are w x (w x y).  So neither is singular at any rotation, unlike derivatives with
respect to psi, which vanish across psi after a whole turn.  In the plane, and about an axis that is
fixed, both are the same, and psi changes by w.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from dea_fenicsx.support.later import Later

transform = Later("scipy.spatial.transform")

TINY_ANGLE = 1e-9
"""A rotation by a smaller angle has no axis to speak of."""


class Turning(ABC):
    """How parts turn in one kinematics.

    Attributes
    ----------
    count
        Number of rotations.
    """

    count: int

    @abstractmethod
    def matrix(self, psi: np.ndarray) -> np.ndarray:
        """The rotation R of a rotation vector, shape (dim, dim)."""

    @abstractmethod
    def slopes(self, y: np.ndarray) -> np.ndarray:
        """Derivative of turned arms, shape (nodes, dim), by spins: (nodes, dim, count)."""

    @abstractmethod
    def curvature(self, forces: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Sum over nodes of force . second derivative of y by spins, shape (count, count)."""

    def spin(self, psi: np.ndarray, change: np.ndarray) -> np.ndarray:
        """The spin of a small change of the rotation vector."""
        return change

    def composed(self, spin: np.ndarray, psi: np.ndarray) -> np.ndarray:
        """The rotation vector after a further spin."""
        return psi + spin

    def between(self, old: np.ndarray, new: np.ndarray) -> np.ndarray:
        """The spin that leads from one rotation vector to another."""
        return new - old


class NoTurning(Turning):
    """Parts only move along the axis; there are no rotations."""

    count = 0

    def matrix(self, psi: np.ndarray) -> np.ndarray:
        return np.eye(2)

    def slopes(self, y: np.ndarray) -> np.ndarray:
        return np.zeros((*y.shape, 0))

    def curvature(self, forces: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.zeros((0, 0))


class PlaneTurning(Turning):
    """One angle, counter-clockwise."""

    count = 1

    def matrix(self, psi: np.ndarray) -> np.ndarray:
        c, s = np.cos(psi[0]), np.sin(psi[0])
        return np.array([[c, -s], [s, c]])

    def slopes(self, y: np.ndarray) -> np.ndarray:
        return np.stack([-y[:, 1], y[:, 0]], axis=1)[:, :, None]

    def curvature(self, forces: np.ndarray, y: np.ndarray) -> np.ndarray:
        return -np.sum(forces * y)[None, None]


class SpaceTurning(Turning):
    """Rotations of any size in space."""

    count = 3

    def matrix(self, psi: np.ndarray) -> np.ndarray:
        return np.asarray(transform.Rotation.from_rotvec(psi).as_matrix())

    def slopes(self, y: np.ndarray) -> np.ndarray:
        found = np.zeros((len(y), 3, 3))
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            found[:, i, k], found[:, j, k] = -y[:, j], y[:, i]  # e_k x y
        return found

    def curvature(self, forces: np.ndarray, y: np.ndarray) -> np.ndarray:
        both = forces.T @ y
        return np.asarray((both + both.T) / 2 - np.trace(both) * np.eye(3))

    def spin(self, psi: np.ndarray, change: np.ndarray) -> np.ndarray:
        """T(psi) dpsi, T = 1 + (1 - cos a)/a^2 [psi] + (a - sin a)/a^3 [psi]^2, a = |psi|."""
        a = float(np.linalg.norm(psi))
        if a < 1e-4:
            first, second = 0.5 - a**2 / 24, 1 / 6 - a**2 / 120
        else:
            first, second = (1 - np.cos(a)) / a**2, (a - np.sin(a)) / a**3
        once = np.cross(psi, change)
        return np.asarray(change + first * once + second * np.cross(psi, once))

    def between(self, old: np.ndarray, new: np.ndarray) -> np.ndarray:
        first, second = map(transform.Rotation.from_rotvec, (old, new))
        return np.asarray((second * first.inv()).as_rotvec())

    def composed(self, spin: np.ndarray, psi: np.ndarray) -> np.ndarray:
        """The rotation vector of exp([spin]) exp([psi]) that lies nearest to psi."""
        first, second = map(transform.Rotation.from_rotvec, (psi, spin))
        turned = (second * first).as_rotvec()
        angle = float(np.linalg.norm(turned))
        if angle < TINY_ANGLE:
            size = float(np.linalg.norm(psi))
            if size < np.pi:
                return np.asarray(turned)
            axis, angle = psi / size, 0.0
            turns = round(size / (2 * np.pi))
            return np.asarray(turned + 2 * np.pi * turns * axis)
        axis = turned / angle
        turns = round((float(psi @ axis) - angle) / (2 * np.pi))
        return np.asarray(turned + 2 * np.pi * turns * axis)


def turning_of(rotations: int) -> Turning:
    """How parts turn in a kinematics with some number of rotations."""
    kinds: dict[int, Turning] = {0: NoTurning(), 1: PlaneTurning(), 3: SpaceTurning()}
    return kinds[rotations]
