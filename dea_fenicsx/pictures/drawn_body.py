"""What a picture of a step shows: the faces of the device, its section, and obstacles around it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from dea_fenicsx.pictures import level_sets
from dea_fenicsx.pictures.faces import Faces, edges_of, faces_of, normals, sharp
from dea_fenicsx.pictures.obstacles import DrawnObstacle, obstacles_of
from dea_fenicsx.pictures.pieces import lines_of
from dea_fenicsx.pictures.revolved import drawn
from dea_fenicsx.pictures.section import Section, section_of
from dea_fenicsx.pictures.stored import stored_step

X, Y, Z = np.eye(3)
ISOMETRIC = np.array([1, 1, 0]) / 2**0.5, np.array([-1, 1, 2]) / 6**0.5

ROOM_FOR_OBSTACLES, ROOM_FOR_ENDLESS = 0.25, 0.08
"""How far around the device obstacles are drawn, in units of its largest side.

The second value is for planes, and for cylinders along their axes.
"""


def room_for(obstacle: DrawnObstacle) -> np.ndarray:
    """How far around the device an obstacle is drawn along each axis, in these units."""
    less = ROOM_FOR_OBSTACLES - ROOM_FOR_ENDLESS
    return np.asarray(ROOM_FOR_OBSTACLES - less * obstacle.endless)


class DrawnBody:
    """A step of a run as it is drawn: its faces and its section in the colours of a field.

    Parameters
    ----------
    folder, field, step, axes
        The run, one of its fields or a component, the step, and the names of the run's axes.

    Raises
    ------
    InputError
        If there are no fields, no such field or no such step.
    """

    def __init__(self, folder: Path, field: str, step: int, axes: tuple[str, str, str]) -> None:
        self._folder, self._step = folder, step
        self._stored = drawn(stored_step(folder, step, field, axes))
        self.time, self.flat = self._stored.time, self._stored.flat
        self.values, self.name, self.nodal = self._stored.values(field, axes)

    @cached_property
    def faces(self) -> Faces:
        """The faces of the device."""
        return faces_of(self._stored)

    @cached_property
    def section(self) -> Section | None:
        """The section of a device in space, if its plane meets a cell."""
        if self._stored.cell.flat:
            return None
        return section_of(self._stored, self.faces, self.values, self.nodal)

    @cached_property
    def obstacles(self) -> list[DrawnObstacle]:
        """The obstacles of the run at this step."""
        return obstacles_of(self._folder, self._step)

    def shells(self, warp: float) -> list[np.ndarray]:
        """What is drawn of the surface of each obstacle, around the device.

        Corners of triangles, shape (n, 3, 3), or ends of lines in a plane, shape (n, 2, 3).
        """
        return [
            level_sets.lines(one.warped(warp).gap, *self._box(warp, one), 2) if self.flat
            else level_sets.surface(one.warped(warp).gap, *self._box(warp, one))
            for one in self.obstacles
        ]  # fmt: skip

    def _box(self, warp: float, obstacle: DrawnObstacle) -> tuple[np.ndarray, np.ndarray]:
        """Corners of the box in which an obstacle is drawn."""
        at = self.faces.points
        points = np.vstack([_extreme(at), _extreme(at + warp * self.faces.moves)]).astype(float)
        low, high = points.min(axis=0), points.max(axis=0)
        pad = room_for(obstacle) * (high - low).max() * (high > low if self.flat else np.ones(3))
        return low - pad, high + pad

    def outlines(self, shapes: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Ends of the lines at edges that are sharp, for each position of the nodes."""
        if self.flat:
            edges, pairs = edges_of(self.faces, [])
            return [lines_of(edges[sharp(pairs, None)], points) for points in shapes]
        turned = [normals(self.faces, points) for points in shapes]
        edges, pairs = edges_of(self.faces, turned)
        return [
            lines_of(edges[sharp(pairs, normal)], points)
            for normal, points in zip(turned, shapes, strict=True)
        ]

    def facing(self, points: np.ndarray, towards: np.ndarray) -> np.ndarray:
        """Numbers of the faces that are drawn.

        Of a solid that has many plane ones these are those that look towards the viewer.
        """
        seen = self.faces.seen
        if not self._stored.cell.flat and self.faces.nodes.shape[1] == self.faces.corners:
            # the halves of a face with four corners may be turned to each other
            seen = seen & (normals(self.faces, points) @ towards.astype(np.float32) > -0.1)
        return np.flatnonzero(seen)

    def seen(self, warp: float) -> tuple[np.ndarray, np.ndarray]:
        """Outermost points of what is drawn, and of its section, shapes (n, 3).

        They are those of the device, deformed and not, and of obstacles around it.
        """
        at, section = self.faces.points, self.section
        outside = [at, at + warp * self.faces.moves, *self.shells(warp)]
        seen = np.vstack([_extreme(points.reshape(-1, 3)) for points in outside if len(points)])
        if section is None:
            return seen, np.empty((0, 3))
        cut = [section.points, section.points + warp * section.moves]
        for obstacle in self.obstacles:
            low, high = self._box(warp, obstacle)
            low[1] = high[1] = section.at
            cut.append(level_sets.lines(obstacle.warped(warp).gap, low, high, 1))
        return seen, np.vstack([_extreme(at.reshape(-1, 3)) for at in cut if len(at)])


def _extreme(points: np.ndarray) -> np.ndarray:
    """The points that lie farthest in the directions of a picture's axes, shape (n, 3)."""
    along = points @ np.array([X, Y, Z, *ISOMETRIC, np.cross(*ISOMETRIC)]).T
    return points[np.unique([*along.argmin(axis=0), *along.argmax(axis=0)])]


