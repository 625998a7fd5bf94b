"""Triangles and lines as pixels, by a depth for each pixel.

This needs no OpenGL, which many machines without a screen lack, and little memory.
"""

from __future__ import annotations

import numpy as np

CANDIDATES = 100_000
"""Pairs of a triangle and a pixel that are looked at together."""

TRIANGLES_AT_ONCE = 50_000
"""Triangles that are looked at together."""

_EDGE = 1e-4
"""How far outside of a triangle, as a share of its height, a pixel still belongs to it."""

LINE_DEPTH = 4.0
"""Pixels by which a line is moved to the viewer, so that the faces beside it do not hide it."""


class Canvas:
    """An image that is drawn by triangles and lines.

    Places are in pixels: x to the right, y upwards, and a depth that grows towards the viewer.

    Parameters
    ----------
    width, height
        In pixels.

    Attributes
    ----------
    pixels : ndarray (height * width, 3), colours from the lowest row up
    """

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        self.pixels = np.full((width * height, 3), 255, dtype=np.uint8)
        self._depth = np.full(width * height, -np.inf, dtype=np.float32)

    def image(self) -> np.ndarray:
        """The image from the top down, shape (height, width, 3)."""
        return self.pixels.reshape(self.height, self.width, 3)[::-1]

    def fill(
        self, at: np.ndarray, triangles: np.ndarray, values: np.ndarray, nodal: bool,
        colour: np.ndarray, grey: np.ndarray, limits: tuple[float, float],
        shade: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        """Draw triangles in the colours of a field.

        Parameters
        ----------
        at
            Places of the nodes, shape (n, 3).
        triangles
            Nodes of each, shape (m, 3).
        values
            One for each node or for each triangle; NaN is drawn in grey.
        nodal
            Whether there is one for each node.
        colour, grey
            Colours of the scale, shape (k, 3), and of NaN, shape (3,), from 0 to 255.
        limits
            Ends of the scale.
        shade
            Brightness of each triangle; 1 by default.
        """
        owner = np.full(self.width * self.height, -1, dtype=np.int32)
        for begin in range(0, len(triangles), TRIANGLES_AT_ONCE):
            self._own(owner, at, triangles[begin : begin + TRIANGLES_AT_ONCE], begin)
        mine = np.flatnonzero(owner >= 0)
        low, high = limits
        for begin in range(0, len(mine), CANDIDATES):
            where = mine[begin : begin + CANDIDATES]
            which = owner[where]
            if nodal:
                shown = self._interpolated(at, triangles[which], values, where)
            else:
                shown = values[which]
            known = np.isfinite(shown)
            share = np.clip((np.where(known, shown, low) - low) / (high - low), 0.0, 1.0)
            drawn = colour[np.rint(share * (len(colour) - 1)).astype(np.intp)].astype(np.float32)
            drawn[~known] = grey
            if shade is not None:
                drawn *= shade[which][:, None]
            self.pixels[where] = np.clip(np.rint(drawn), 0, 255)

    def paint_behind(
        self, here: np.ndarray, row: int, colour: tuple[int, int, int]
    ) -> None:
        """Paint what no triangle has been drawn on.

        Parameters
        ----------
        here
            Which pixels, shape (rows, width), of the rows from `row` up.
        row
            The lowest row.
        colour
            From 0 to 255.
        """
        some = slice(row * self.width, row * self.width + here.size)
        empty = np.isneginf(self._depth[some])
        self.pixels[some][here.ravel() & empty] = colour

    def glaze(
        self, at: np.ndarray, triangles: np.ndarray, colour: np.ndarray, shade: np.ndarray,
        share: float,
    ) -> None:  # fmt: skip
        """Draw triangles that one can look through; what lies before them hides them.

        Parameters
        ----------
        at, triangles, shade
            As of `fill`.
        colour
            Shape (3,), from 0 to 255.
        share
            How much of the colour of a pixel is theirs, 0 to 1.
        """
        depth, owner = self._depth.copy(), np.full(len(self._depth), -1, dtype=np.int32)
        for begin in range(0, len(triangles), TRIANGLES_AT_ONCE):
            self._own(owner, at, triangles[begin : begin + TRIANGLES_AT_ONCE], begin)
        mine = np.flatnonzero(owner >= 0)
        own = colour * shade[owner[mine]][:, None]
        mixed = (1 - share) * self.pixels[mine] + share * own
        self.pixels[mine] = np.clip(np.rint(mixed), 0, 255)
        self._depth = depth

    def _own(self, owner: np.ndarray, at: np.ndarray, triangles: np.ndarray, begin: int) -> None:
        """Give each pixel to the triangle that is nearest to the viewer there."""
        x, y, z = (at[:, k][triangles] for k in range(3))
        x0 = np.maximum(np.ceil(x.min(axis=1) - 0.5), 0).astype(np.int64)
        y0 = np.maximum(np.ceil(y.min(axis=1) - 0.5), 0).astype(np.int64)
        wide = np.minimum(np.floor(x.max(axis=1) - 0.5), self.width - 1).astype(np.int64) - x0 + 1
        tall = np.minimum(np.floor(y.max(axis=1) - 0.5), self.height - 1).astype(np.int64) - y0 + 1
        twice = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (
            y[:, 1] - y[:, 0]
        )
        kept = np.flatnonzero((wide > 0) & (tall > 0) & (twice != 0))
        counts = (wide * tall)[kept]
        ends = np.cumsum(counts)
        first = 0
        while first < len(kept):
            before = ends[first - 1] if first else 0
            last = max(int(np.searchsorted(ends, before + CANDIDATES, "right")), first + 1)
            some = kept[first:last]
            self._own_few(
                owner, (x[some], y[some], z[some]), (x0[some], y0[some], wide[some]),
                counts[first:last], twice[some], some + begin,
            )  # fmt: skip
            first = last

    def _own_few(
        self, owner: np.ndarray, places: tuple[np.ndarray, ...], box: tuple[np.ndarray, ...],
        counts: np.ndarray, twice: np.ndarray, names: np.ndarray,
    ) -> None:  # fmt: skip
        """The same for triangles whose boxes have few pixels together."""
        (x, y, z), (x0, y0, wide) = places, box
        which = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
        place = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
        row, column = np.divmod(place, wide[which])
        # shares of the second and of the third corner, linear in the pixel's place in its box
        dx, dy = x0 + 0.5 - x[:, 0], y0 + 0.5 - y[:, 0]
        b = (y[:, 2] - y[:, 0]) / twice, -(x[:, 2] - x[:, 0]) / twice
        c = -(y[:, 1] - y[:, 0]) / twice, (x[:, 1] - x[:, 0]) / twice
        second = _plane(b, dx, dy, which, column, row)
        third = _plane(c, dx, dy, which, column, row)
        inside = np.flatnonzero(
            (second >= -_EDGE) & (third >= -_EDGE) & (second + third <= 1 + _EDGE)
        )
        which, second, third = which[inside], second[inside], third[inside]
        pixel = (y0[which] + row[inside]) * self.width + x0[which] + column[inside]
        deep = z[:, 0][which] + second * (z[:, 1] - z[:, 0])[which]
        deep = (deep + third * (z[:, 2] - z[:, 0])[which]).astype(np.float32)
        np.maximum.at(self._depth, pixel, deep)
        nearest = deep == self._depth[pixel]
        owner[pixel[nearest]] = names[which[nearest]]

    def _interpolated(
        self, at: np.ndarray, corners: np.ndarray, values: np.ndarray, where: np.ndarray
    ) -> np.ndarray:
        """Values in some pixels, each in a triangle with values at its corners."""
        row, column = np.divmod(where, self.width)
        x, y = at[:, 0][corners], at[:, 1][corners]
        px, py = column + 0.5 - x[:, 0], row + 0.5 - y[:, 0]
        ax, ay, bx, by = x[:, 1] - x[:, 0], y[:, 1] - y[:, 0], x[:, 2] - x[:, 0], y[:, 2] - y[:, 0]
        twice = ax * by - bx * ay
        second, third = (px * by - bx * py) / twice, (ax * py - px * ay) / twice
        a, b, c = values[corners].T
        return np.asarray(a + second * (b - a) + third * (c - a))

    def lines(
        self, ends: np.ndarray, colour: tuple[int, int, int], width: int, hidden: bool
    ) -> None:
        """Draw lines.

        Parameters
        ----------
        ends
            Places of both ends of each line, shape (n, 2, 3).
        colour
            From 0 to 255.
        width
            In pixels, an odd number.
        hidden
            Whether triangles before a line hide it.
        """
        for begin in range(0, len(ends), TRIANGLES_AT_ONCE // 4):
            some = ends[begin : begin + TRIANGLES_AT_ONCE // 4]
            way = np.abs(some[:, 1, :2] - some[:, 0, :2]).max(axis=1)
            counts = np.ceil(np.minimum(way, 4.0 * (self.width + self.height))).astype(int) + 1
            which = np.repeat(np.arange(len(some)), counts)
            place = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
            share = (place / np.maximum(counts - 1, 1)[which])[:, None]
            at = some[which, 0] + share * (some[which, 1] - some[which, 0])
            self._dots(at, colour, width, hidden)

    def _dots(
        self, at: np.ndarray, colour: tuple[int, int, int], width: int, hidden: bool
    ) -> None:
        column, row = np.floor(at[:, 0]).astype(int), np.floor(at[:, 1]).astype(int)
        here = (column >= 0) & (row >= 0) & (column < self.width) & (row < self.height)
        if hidden:
            pixel = np.where(here, row * self.width + column, 0)
            here &= at[:, 2] + LINE_DEPTH >= self._depth[pixel]
        column, row = column[here], row[here]
        for dx in range(-(width // 2), width // 2 + 1):
            for dy in range(-(width // 2), width // 2 + 1):
                x = np.clip(column + dx, 0, self.width - 1)
                y = np.clip(row + dy, 0, self.height - 1)
                self.pixels[y * self.width + x] = colour


def _plane(
    slopes: tuple[np.ndarray, np.ndarray], dx: np.ndarray, dy: np.ndarray, which: np.ndarray,
    column: np.ndarray, row: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """A linear function of each triangle at pixels in its box."""
    start = slopes[0] * dx + slopes[1] * dy
    return np.asarray(start[which] + slopes[0][which] * column + slopes[1][which] * row)
