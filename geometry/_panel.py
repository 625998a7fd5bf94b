"""Mesh of a triangular panel and of the strips along its sides, in barycentric coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ._structured import Floats, Ints, block, joined_ends, lattice_points

ORDER = 2
"""Degree of the cells' geometry: folds are curved."""


class PanelMesh(NamedTuple):
    """Quadrilaterals of a triangle with the strips along its sides.

    Attributes
    ----------
    quads : ndarray (cells, 3, 3)
        Node numbers; three strips, each row by row from the middle of the fold, then the panel.
    weights : ndarray (nodes, 3)
        Barycentric coordinates; in a strip those of the panel's rim beside it.
    bend : ndarray (nodes,)
        1 in the middle of the folds, 0 in the panel, linear through the strips.
    of : ndarray (nodes,)
        Side of the triangle in whose strip a node is.
    rims : ndarray (3, 4 along + 1)
        Nodes along the middle of each fold.
    """

    quads: Ints
    weights: Floats
    bend: Floats
    of: Ints
    rims: Ints


@dataclass(frozen=True)
class Panel:
    """A triangle whose sides are creases, each with half a hinge along it.

    Attributes
    ----------
    corners : ndarray (3, 3)
        Positions of the triangle's corners in m.
    feet : ndarray (3,)
        Share of each side at which the triangle's height stands.
    tips : ndarray (3, 3)
        Corners of the panel proper, between its hinges, in barycentric coordinates.
    inset : ndarray (3,)
        Distance from each crease at which the panel begins, over the triangle's height there.
    hinge : ndarray (along + 1,)
        Ends of the cells along the first half of a hinge, as shares of the crease.
    tip : ndarray (cells + 1,)
        Ends of the cells from a tip of the panel to the next hinge, from 0 to 1.
    across : ndarray (strip + 1,)
        Ends of the cells across half a hinge, from 1 in the middle of the fold to 0 at the panel.
    """

    corners: Floats
    feet: Floats
    tips: Floats
    inset: Floats
    hinge: Floats
    tip: Floats
    across: Floats

    def beside(self, j: int, s: Floats) -> Floats:
        """Points of the panel's rim straight across from the shares s of crease j."""
        a, b, opposite = (np.eye(3)[k] for k in (j, (j + 1) % 3, j - 1))
        inwards = self.inset[j] * (opposite - (1 - self.feet[j]) * a - self.feet[j] * b)
        return (1 - s[:, None]) * a + s[:, None] * b + inwards

    def half_rim(self, k: int, j: int, s: Floats) -> Floats:
        """From the tip k of the panel to the hinge of side j, and along half of it."""
        hinge = self.beside(j, s)
        tip = self.tip[:, None]
        ends = np.vstack([(1 - tip) * self.tips[k] + tip * hinge[0], hinge[1:]])
        return np.column_stack([lattice_points(x, ORDER) for x in ends.T])

    def rims_at(self, k: int) -> tuple[Floats, Floats]:
        """The two half rims that begin at the tip k: along its own side, and along the one before.
        """
        return self.half_rim(k, k, self.hinge), self.half_rim(k, k - 1, 1 - self.hinge)

    def strips(self) -> list[Floats]:
        """Lattice of the half hinge along each side, shape (rows, columns, 5).

        The last axis holds barycentric coordinates (3), bend and side, as in `PanelMesh`.
        """
        line = lattice_points(joined_ends(self.hinge, 1 - self.hinge[::-1]), ORDER)
        across = lattice_points(self.across, ORDER)
        grids = []
        for j in range(3):
            place = np.broadcast_to(self.beside(j, line), (len(across), len(line), 3))
            b = np.broadcast_to(across[:, None, None], (*place.shape[:2], 1))
            grids.append(np.concatenate([place, b, np.where(b > 0, j, 0)], axis=2))
        return grids

    def patches(self) -> list[Floats]:
        """Three lattices that fill the panel, each from a tip to the centre, as in `strips`."""
        centre = self.tips.mean(axis=0)
        # Nodes lie as densely towards the centre as along the rims, on the average of the rims.
        lines = [rim @ self.corners for k in range(3) for rim in self.rims_at(k)]
        away = np.array([np.linalg.norm(x - x[0], axis=1) for x in lines])
        share = np.mean(away / away[:, -1:], axis=0)[:, None]
        v, u = share[:, None], share[None, :]
        grids = []
        for k in range(3):
            low, left = self.rims_at(k)
            high, right = ((1 - share) * x[-1] + share * centre for x in (left, low))
            # transfinite interpolation between the four sides of the patch
            place = (1 - v) * low[None] + v * high[None] + (1 - u) * left[:, None]
            place = place + u * right[:, None] - (1 - v) * ((1 - u) * low[0] + u * low[-1])
            place -= v * ((1 - u) * left[-1] + u * centre)
            grids.append(np.dstack([place, np.zeros((*place.shape[:2], 2))]))
        return grids

    def mesh(self) -> PanelMesh:
        """Cells of the strips and of the panel, with one number for each node that they share."""
        grids = [*self.strips(), *self.patches()]
        places = np.concatenate([grid.reshape(-1, 5) for grid in grids])
        _, chosen, number = np.unique(
            np.rint(places * 1e9).astype(np.int64), axis=0, return_index=True, return_inverse=True
        )
        along, tip, strip = len(self.hinge) - 1, len(self.tip) - 1, len(self.across) - 1
        side, patch = 4 * along + 1, 2 * (tip + along)
        assert len(chosen) == 3 * (2 * strip * side + patch * (patch + 1)) + 1
        number, first, quads, rims = number.ravel(), 0, [], []
        for grid in grids:
            rows, columns = grid.shape[:2]
            own = number[first : first + rows * columns].reshape(rows, columns)
            first += rows * columns
            rims.append(own[0])
            # columns run along the crease, rows from it inwards
            _, (row, column) = block((rows // ORDER, columns // ORDER), ORDER)
            quads.append(np.swapaxes(own[row, column], 1, 2))
        found = places[chosen]
        return PanelMesh(np.concatenate(quads), found[:, :3], found[:, 3],
                         found[:, 4].astype(int), np.array(rims[:3]))  # fmt: skip
