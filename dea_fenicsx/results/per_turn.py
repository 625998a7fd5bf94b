"""Stroke, twist and peak field of each turn of a helical device, from the fields of a run.

This is how a three-dimensional run is compared with a helically periodic cell: in its middle turns
the ends no longer tell.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dea_fenicsx.results.reading import read_frame
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.later import Later

spatial = Later("scipy.spatial")

FIELD_NAME = "field_strength_V_per_m"


@dataclass(frozen=True)
class TurnTable:
    """What each turn does, from the bottom up.

    Attributes
    ----------
    contraction : ndarray, shape (turns - 1,)
        Loss of distance between places one pitch apart, over the pitch; entry k is the mean by
        volume over all pairs of nodes of which the lower one lies in turn k.
    twist_rad : ndarray, shape (turns - 1,)
        Rotation about the axis between places one pitch apart.
    scatter : ndarray, shape (turns - 1,)
        Standard deviation of the contraction over the pairs: 0 in a helically symmetric state.
    peak_field_V_per_m : ndarray, shape (turns,)
        Largest true field at the middle of a cell in each turn; empty without a field.
    """

    contraction: np.ndarray
    twist_rad: np.ndarray
    scatter: np.ndarray
    peak_field_V_per_m: np.ndarray

    @property
    def middle(self) -> tuple[float, float]:
        """Contraction and twist (rad) of the middle turn."""
        k = len(self.contraction) // 2
        return float(self.contraction[k]), float(self.twist_rad[k])


def per_turn(folder: str | os.PathLike, pitch: float, step: int = -1) -> TurnTable:
    """Measure each turn of a device around the z axis, as `geometry.HDEA` makes it.

    The caps of flat ends are left out; both are equally thick.

    Parameters
    ----------
    folder
        A run's results folder.
    pitch
        Rise per turn in metres; the lower end of the helix is at z = 0 where x > 0, y = 0.
    step
        Which step of the run; -1 is the last.

    Raises
    ------
    InputError
        If no two nodes lie a pitch apart along z.
    """
    grid = read_frame(Path(folder), step).grid
    nodes = np.reshape(grid.cells, (grid.n_cells, -1))[:, 1:]
    sizes = _sizes(np.asarray(grid.points)[nodes[:, :8]])
    of = np.floor(_height(np.asarray(grid.cell_centers().points), pitch)).astype(int)
    turns = _turns(np.asarray(grid.points), pitch)
    sizes[(of < 0) | (of >= turns)] = 0.0
    volume = np.bincount(nodes.ravel(), np.repeat(sizes, nodes.shape[1]), grid.n_points)
    found = measure_turns(
        np.asarray(grid.points), grid.point_data["displacement_m"], pitch, volume
    )
    if FIELD_NAME in grid.cell_data:
        field = np.asarray(grid.cell_data[FIELD_NAME])
        peak = np.array([field[of == k].max() for k in range(turns)])
        found = replace(found, peak_field_V_per_m=peak)
    return found


def measure_turns(
    x: np.ndarray, u: np.ndarray, pitch: float, volume: np.ndarray | None = None
) -> TurnTable:
    """The same from nodes and their displacements, each (n, 3), in metres; without a field.

    `volume` is what each node stands for, by default the same.  A rotation of the whole, as that of
    a free body, is taken out first.
    """
    volume = np.ones(len(x)) if volume is None else volume
    u = np.asarray(u)
    above = x + np.array([0, 0, pitch])
    distance, partner = spatial.cKDTree(x).query(above, distance_upper_bound=1e-4 * abs(pitch))
    height = _height(x, pitch)
    turns = _turns(x, pitch)
    # At the seam the body is one pitch higher than elsewhere, so its last pairs are left out.
    inside = (height > -1e-6) & (height < turns - 1 + 1e-6)
    lower = np.flatnonzero(np.isfinite(distance) & inside)
    if len(lower) == 0:
        raise InputError(
            f"No two nodes lie {pitch:g} m apart along z; give the pitch of a device of two turns "
            "or more."
        )
    upper = partner[lower]
    u = _upright(x, x + u, lower, upper, volume[lower]) - x
    shorter = (u[lower, 2] - u[upper, 2]) / pitch
    rotation = _angle(x + u) - _angle(x)
    turned = (rotation[upper] - rotation[lower] + np.pi) % (2 * np.pi) - np.pi
    # a common face belongs to the turn above it, the topmost to the last one
    turn = np.minimum(np.floor(height[lower] + 1e-6).astype(int), turns - 2)
    share = volume[lower] / np.bincount(turn, volume[lower])[turn]
    mean = np.bincount(turn, share * shorter)
    square = np.bincount(turn, share * (shorter - mean[turn]) ** 2)
    return TurnTable(mean, np.bincount(turn, share * turned), np.sqrt(square), np.empty(0))


def _sizes(corners: np.ndarray) -> np.ndarray:
    """Volumes of hexahedra, from their corners (n, 8, 3) in VTK's order: by the mean edges.

    The volumes only weigh means; VTK's own do not know hexahedra of 27 nodes before version 9.4.
    """
    a = corners[:, [1, 2, 5, 6]].mean(axis=1) - corners[:, [0, 3, 4, 7]].mean(axis=1)
    b = corners[:, [2, 3, 6, 7]].mean(axis=1) - corners[:, [0, 1, 4, 5]].mean(axis=1)
    c = corners[:, 4:].mean(axis=1) - corners[:, :4].mean(axis=1)
    return np.abs(np.einsum("ni,ni->n", np.cross(a, b), c))


def _upright(
    x: np.ndarray, moved: np.ndarray, lower: np.ndarray, upper: np.ndarray, volume: np.ndarray
) -> np.ndarray:
    """Deformed places, turned and shifted so that the axis of the whole is the z axis again.

    The axis is the mean of what leads from `lower` to `upper`, one pitch higher; about it the body
    stays as it is.
    """
    share = volume / volume.sum()
    axis = share @ (moved[upper] - moved[lower])
    axis /= np.linalg.norm(axis)
    K = np.cross(np.eye(3), np.cross(axis, (0.0, 0.0, 1.0)))  # v x for v = axis x e_z
    back = np.eye(3) + K + K @ K / (1 + axis[2])
    return (moved - share @ moved[lower]) @ back.T + share @ x[lower]


def _angle(x: np.ndarray) -> np.ndarray:
    return np.arctan2(x[:, 1], x[:, 0])


def _turns(x: np.ndarray, pitch: float) -> int:
    """Number of turns; a cap at z < 0 and one as thick above do not count."""
    return round(abs(float(x[:, 2].max() + x[:, 2].min()) / pitch)) - 1


def _height(x: np.ndarray, pitch: float) -> np.ndarray:
    """Height above the lowest turn's underside in pitches."""
    share = np.mod(_angle(x) / (2 * np.pi) + 1e-9, 1.0)
    return x[:, 2] / pitch - share + 1e-9
