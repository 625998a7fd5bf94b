"""A step of a membrane whose mesh is its meridian, as the surface that it forms about its axis."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dea_fenicsx.pictures.stored import Stored
from dea_fenicsx.results.axes import FIXED
from dea_fenicsx.support.cell_types import LINEAR, QUAD

SECTORS = 72
"""Flat cells around the axis; each is 5 degrees wide."""


class Revolved(Stored):
    """The surface that a meridian in (r, z) forms when it is turned about the axis r = 0.

    Each node of the meridian becomes a ring of nodes, and each line between two nodes a ring of
    cells with four corners.  The axis is z in space.

    Parameters
    ----------
    meridian
        The step as it is stored: lines in the plane.
    """

    def __init__(self, meridian: Stored) -> None:
        self.meridian = meridian
        self.folder, self.file, self.time = meridian.folder, meridian.file, meridian.time
        self.nodal, self.cellwise = meridian.nodal, meridian.cellwise
        self.cell = LINEAR[QUAD]
        self._along = [0, 1] if meridian.cell.nodes == 2 else [0, 2, 1]
        self._pieces = len(self._along) - 1
        self.count = meridian.count * self._pieces * SECTORS
        self.size = meridian.size * SECTORS
        angle = np.arange(SECTORS) * (2 * np.pi / SECTORS)
        self._turn = np.stack([np.cos(angle), np.sin(angle)], axis=1)

    @property
    def flat(self) -> bool:  # type: ignore[override]
        """It lies in space, and so does a disc, which may leave its plane."""
        return False

    def tables(self) -> Iterator[tuple[int, np.ndarray]]:
        """Nodes of the cells in blocks, each with the number of its first cell."""
        here = np.arange(SECTORS)
        there = (here + 1) % SECTORS
        for begin, table in self.meridian.tables():
            nodes = table[:, self._along]
            first, second = (n.reshape(-1, 1) * SECTORS for n in (nodes[:, :-1], nodes[:, 1:]))
            cells = np.stack([first + here, second + here, second + there, first + there], axis=-1)
            yield begin * self._pieces * SECTORS, cells.reshape(-1, 4)

    def height(self, axis: int) -> np.ndarray:
        """One coordinate of all nodes, in single precision."""
        return self.points(np.ones(self.size, dtype=bool))[:, axis].astype(np.float32)

    def points(self, kept: np.ndarray) -> np.ndarray:
        """Positions of some nodes, which are told by one truth value for each node."""
        return self._turned(self.meridian.points(self._all))[kept]

    def displacements(self, kept: np.ndarray) -> np.ndarray:
        """Displacements of some nodes; zero where the run has written none."""
        return self._turned(self.meridian.displacements(self._all))[kept]

    @property
    def _all(self) -> np.ndarray:
        return np.ones(self.meridian.size, dtype=bool)

    def _turned(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors (r, z) of the meridian's nodes, in space at all nodes of their rings."""
        found = np.empty((len(vectors), SECTORS, 3))
        found[..., :2] = vectors[:, None, :1] * self._turn
        found[..., 2] = vectors[:, 1, None]
        return found.reshape(-1, 3)

    @property
    def origin(self) -> np.ndarray | None:
        """The number of each node before nodes were doubled at regions; None if none were."""
        found = self.meridian.origin
        return None if found is None else (found[:, None] * SECTORS + np.arange(SECTORS)).ravel()

    @property
    def regions(self) -> np.ndarray:
        """Number of the region of each cell."""
        return np.repeat(self.meridian.regions, self._pieces * SECTORS)

    def values(
        self, field: str, axes: tuple[str, str, str] = FIXED
    ) -> tuple[np.ndarray, str, bool]:
        """A field, or a component by its axes, as one number a node or cell; see `Stored`."""
        values, told, nodal = self.meridian.values(field, axes)
        return np.repeat(values, SECTORS * (1 if nodal else self._pieces)), told, nodal


def drawn(stored: Stored) -> Stored:
    """A step as it is drawn: the lines of a meridian become a surface."""
    return Revolved(stored) if stored.is_meridian else stored
