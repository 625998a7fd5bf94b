"""The rigid obstacles of a run as pictures show them, by what its files tell.

A picture needs the gap alone: an obstacle is where its gap is negative.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.pictures.stored import Stored
from dea_fenicsx.results.history import field_times
from dea_fenicsx.results.reading import (
    FIELDS_DOCUMENT,
    grid_element,
    read_history,
    read_summary,
)
from dea_fenicsx.results.reading_surfaces import read_surfaces
from dea_fenicsx.support.errors import InputError

SECTIONS = {"ThreeD": "xyz", "PlaneStrain": "xy", "GeneralisedPlaneStrain": "xy",
            "Axisymmetric": "rz"}  # fmt: skip
"""Kinematics whose obstacles are drawn, with the axes of their pictures."""

Gap = Callable[[np.ndarray], np.ndarray]
"""The gap in m at points in the space of a picture, of shape (..., 3)."""


@dataclass(frozen=True)
class DrawnObstacle:
    """An obstacle in one step.

    Attributes
    ----------
    where : the surface that touches it
    shape : gap in m where the obstacle is in the undeformed device
    endless : how far along each axis it has no end, 0 to 1, shape (3,)
    turn, shift : its motion x -> turn x + shift, of shapes (3, 3) and (3,), in m
    """

    where: str
    shape: Gap
    endless: np.ndarray
    turn: np.ndarray
    shift: np.ndarray

    def warped(self, warp: float) -> DrawnObstacle:
        """The same with displacements times a factor, as those of the device are drawn."""
        turn = np.eye(3) + warp * (self.turn - np.eye(3))
        return replace(self, turn=turn, shift=warp * self.shift)

    def gap(self, points: np.ndarray) -> np.ndarray:
        """The gap at points of the picture: that of where they lay before the obstacle moved."""
        inverse = np.linalg.inv(self.turn)
        return self.shape((points - self.shift) @ inverse.T)

    def displacements(self, points: np.ndarray) -> np.ndarray:
        """Displacements in m of points of the obstacle, shape (n, 3)."""
        return np.asarray(points @ self.turn.T + self.shift - points)


def obstacles_of(folder: Path, step: int) -> list[DrawnObstacle]:
    """The obstacles of a run at a step on disk, as far as its summary tells them.

    Planes between two parts of the device are no bodies, and functions are not kept in files; both
    are left out, and so is what a damaged summary tells wrongly.
    """
    try:
        settings: Any = read_summary(folder)["settings"]
        axes = SECTIONS[settings["kinematics"]["type"]]
        supports = [one for one in settings["supports"] if one["type"] == "Obstacle"]
    except (InputError, KeyError, TypeError):
        return []
    found = []
    for told in supports:
        with suppress(InputError, KeyError, TypeError, ValueError, IndexError):
            gap = gap_of(told["shape"], axes)
            if gap is not None:
                turn, shift = _motion(folder, step, told, settings, axes)
                endless = _endless(told["shape"], axes)
                found.append(DrawnObstacle(str(told["where"]), gap, endless, turn, shift))
    return found


def gap_of(shape: Mapping[str, Any], axes: str) -> Gap | None:
    """The gap of a shape as a summary tells it; None for one that is not drawn.

    Parameters
    ----------
    shape
        Its type and its constants.
    axes
        Axes of the picture: "xyz", "xy", or "rz" of a section about the axis r = 0.

    Raises
    ------
    KeyError, TypeError, ValueError
        If the constants do not make a shape.
    """
    kind = shape["type"]
    if kind == "Plane":
        if shape.get("between"):
            return None
        point, normal = _vector(shape["point"], axes), _vector(shape["normal"], axes)
        normal = normal / _length(normal)
        return lambda x: (x - point) @ normal
    if kind not in ("Sphere", "Cylinder"):
        return None
    sign = -1.0 if shape.get("hollow") else 1.0
    radius = float(shape["radius"])
    centre = _vector(shape["centre" if kind == "Sphere" else "point"], axes)
    across = np.eye(3)
    if kind == "Cylinder":
        along = _along(shape, axes)
        across = across - np.outer(along, along)
    if not (radius > 0 and np.isfinite(radius)):
        raise ValueError("no radius")
    return lambda x: sign * (np.linalg.norm((x - centre) @ across, axis=-1) - radius)


def _endless(shape: Mapping[str, Any], axes: str) -> np.ndarray:
    """How far along each axis of a picture a shape has no end, 0 to 1."""
    if shape["type"] == "Cylinder":
        return np.abs(_along(shape, axes)) * (axes != "xy")
    return np.full(3, float(shape["type"] == "Plane"))


def _along(shape: Mapping[str, Any], axes: str) -> np.ndarray:
    """Unit vector along the axis of a cylinder."""
    if axes != "xyz":  # normal to a plane section, and the axis r = 0 of an axisymmetric one
        return np.array([0.0, 1.0, 0.0] if axes == "rz" else [0.0, 0.0, 1.0])
    along = _vector(shape["axis"], axes)
    return np.asarray(along / _length(along))


def _vector(values: Any, axes: str) -> np.ndarray:
    """Components in space, or in a section, as three components in the picture."""
    found = np.zeros(3)
    numbers = np.array([float(value) for value in values])
    if axes == "rz" and len(numbers) == 3:
        numbers = numbers[[0, 2]]
    found[: min(len(axes), len(numbers))] = numbers[: len(axes)]
    if not np.isfinite(found).all():
        raise ValueError("no vector")
    return found


def _length(vector: np.ndarray) -> float:
    found = float(np.linalg.norm(vector))
    if found == 0:
        raise ValueError("no direction")
    return found


def _motion(
    folder: Path, step: int, told: Mapping[str, Any], settings: Mapping[str, Any], axes: str
) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and shift of an obstacle, by its ramp and by the rigid part that carries it."""
    turn, shift = np.eye(3), np.zeros(3)
    carrier = told.get("carried_by")
    if told.get("displacement") is None and carrier is None:
        return turn, shift
    stored = Stored(folder, FIELDS_DOCUMENT, grid_element(folder, step))
    if told.get("displacement") is not None:
        history = read_history(folder)
        row = int(np.argmin(np.abs(np.array(field_times(history)) - stored.time)))
        column = history.get(f"{told['ramp']}_factor")
        factor = 0.0 if column is None else float(column[row])
        shift = factor * _vector(told["displacement"], axes)
    if carrier is None:
        return turn, shift
    nodes = _nodes_of(folder, stored, str(carrier), settings)
    points, moves = stored.points(nodes), stored.displacements(nodes)
    turn, moved = rigid_motion(points, points + moves)
    return turn, turn @ shift + moved


def _nodes_of(
    folder: Path, stored: Stored, name: str, settings: Mapping[str, Any]
) -> np.ndarray:
    """Which nodes belong to a surface or a region, one truth value for each node."""
    found = np.zeros(stored.size, dtype=bool)
    surfaces = read_surfaces(folder)
    if name in surfaces:
        found[surfaces[name].nodes] = True
        return found
    mine = stored.regions == settings["regions"][name]
    for begin, table in stored.tables():
        found[table[mine[begin : begin + len(table)]]] = True
    return found


def rigid_motion(before: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rotation R and the shift t of after = R before + t, in the sense of least squares.

    By the singular values of the moment matrix (Kabsch 1976).  Nodes on a line leave the rotation
    about it open, and are taken to move without one.
    """
    middle, moved = before.mean(axis=0), after.mean(axis=0)
    left, size, right = np.linalg.svd((after - moved).T @ (before - middle))
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    if size[1] <= 1e-12 * size[0]:
        turn = np.eye(3)
    return turn, moved - turn @ middle
