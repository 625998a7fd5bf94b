"""Imperfections: devices whose undeformed shape is a little other than it should be."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dea_fenicsx.mesh.device import Device
from dea_fenicsx.mesh.moved import Shape, moved
from dea_fenicsx.results.untrusted import read_data
from dea_fenicsx.support.agreement import check_same
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.files import clean
from dea_fenicsx.support.later import Later
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import finite, positive, whole

spatial = Later("scipy.spatial")

SAME_PLACE = 1e-6
"""Largest distance of a node from that of the mode, as a share of the device."""

WAVES = 64
"""Number of plane waves of which a random shape is made."""


@dataclass(frozen=True)
class ModeShape:
    """The null vector of a critical state that a run has found, at the nodes of the same mesh.

    Parameters
    ----------
    folder
        Results folder of the run.
    number
        Which of the files in its ``modes/``, from 1 on.
    """

    folder: str | os.PathLike
    number: int = 1

    def __post_init__(self) -> None:
        if not isinstance(self.folder, str | os.PathLike):
            raise InputError(
                f"ModeShape is given the folder {shown(self.folder)}, but needs the results "
                "folder of a run, as a text or a path."
            )
        whole(self.number, "The number of the mode of ModeShape", 1)

    def __call__(self, positions: np.ndarray) -> np.ndarray:
        try:
            files = sorted((Path(self.folder) / "modes").glob("mode_*.h5"))
        except (OSError, ValueError):  # a name that no folder can have
            files = []
        if not 1 <= self.number <= len(files):
            raise InputError(
                f"There are {len(files)} modes in {clean(self.folder, 100)}/modes, but number "
                f"{shown(self.number)} is asked for; a run with stability=\"every\" writes them."
            )
        file = files[self.number - 1]
        points, mode = (
            read_data(file.parent, f"{file.name}:/{name}") for name in ("points", "node/mode")
        )
        if points.ndim != 2 or points.shape[1:] != (3,) or mode.shape != points.shape:
            raise InputError(f"{clean(file, 200)} does not hold a mode at points.")
        far, nearest = spatial.KDTree(points).query(positions.T)
        size = np.ptp(points, axis=0).max()
        if np.max(far, initial=0.0) > SAME_PLACE * size:
            raise InputError(
                f"The mode in {clean(file, 200)} is of another mesh; solve this one first."
            )
        dim = 3 if np.ptp(points[:, 2]) > 0 else 2
        return mode[nearest, :dim].T


@dataclass(frozen=True)
@in_si(wavelength="m")
class RandomShape:
    """A smooth random displacement along one axis, of plane waves with random directions.

    The same seed gives the same field, on any mesh and any number of ranks.

    Parameters
    ----------
    axis
        ``"x"``, ``"y"`` or ``"z"``: where the nodes are moved to; of an axisymmetric section
        ``"x"`` is the radius and ``"y"`` the axis.
    wavelength
        The shortest wavelength in m; the longest one is twice as long.
    seed
        A whole number.
    dim
        Dimension of the mesh.
    """

    axis: str
    wavelength: float
    seed: int = 0
    dim: int = 3

    def __post_init__(self) -> None:
        positive(self.wavelength, "The wavelength of RandomShape", "a length > 0 in m")
        whole(self.seed, "The seed of RandomShape", 0)
        if self.seed >= 2**64:
            raise InputError(f"The seed of RandomShape is {shown(self.seed)}, but must be < 2^64.")
        whole(self.dim, "The dimension dim of RandomShape", 2)
        if self.dim > 3 or not isinstance(self.axis, str) or self.axis not in [*"xyz"[: self.dim]]:
            raise InputError(
                f"RandomShape has the axis {shown(self.axis)} and dim={shown(self.dim)}, but needs "
                "dim=2 and an axis of x and y, or dim=3 and one of x, y and z."
            )

    def __call__(self, positions: np.ndarray) -> np.ndarray:
        rng = np.random.default_rng(self.seed)
        ways = rng.standard_normal((WAVES, self.dim))
        ways /= np.linalg.norm(ways, axis=1)[:, None]
        numbers = 2 * np.pi / self.wavelength * rng.uniform(0.5, 1.0, WAVES)
        phases = rng.uniform(0, 2 * np.pi, WAVES)
        waves = np.cos((numbers[:, None] * ways) @ positions[: self.dim] + phases[:, None])
        found = np.zeros((self.dim, positions.shape[1]))
        found["xyz".index(self.axis)] = waves.sum(axis=0)
        return found


def imperfect(device: Device, shape: Shape, size: float) -> Device:
    """A device whose undeformed shape deviates by a given shape.  Collective.

    Electrodes, supports and names stay.  The given device stays as it is.

    Parameters
    ----------
    device
        The perfect one.
    shape
        `ModeShape`, `RandomShape`, or a function of positions in m, of shape (3, n), that gives
        displacements of shape (dim, n); their factor does not matter.
    size
        The largest displacement in m; a negative one is to the other side.

    Raises
    ------
    InputError
        If the shape is 0 or not finite, or is of another mesh.
    """
    if not callable(shape):
        raise InputError(
            f"imperfect is given the shape {shown(shape)}, but needs ModeShape, RandomShape or a "
            "function of positions."
        )
    finite(size, "The size of an imperfection in m")
    check_same(device.comm, {"size": size})
    return moved(device, shape, float(size))
