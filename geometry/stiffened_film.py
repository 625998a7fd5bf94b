"""Film with a stiff strip along its diagonal or, as a flat section, across it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import in_si

from . import _check
from ._structured import Floats, Ints, StructuredMesh, compact, joined_ends, lattice, sweep
from .base import Geometry
from .grading import graded


@dataclass(frozen=True, kw_only=True)
@in_si(thickness="m", stiffener="m", offset="m")
class _Stiffened(Geometry):
    """What section and sheet share: the layers.

    The film lies from 0 to ``thickness``; the stiffener's middle lies ``offset`` above the film's:
    inside the film, whose place it takes, or on its top face at an offset of
    ``(thickness + stiffener)/2``.  ``stiffener=0`` leaves the film alone.
    """

    thickness: float = 0.2e-3
    stiffener: float = 50e-6
    offset: float | None = None
    through: int = 2

    def _check_layers(self, who: str) -> None:
        _check.length(who, "thickness", self.thickness)
        _check.length(who, "stiffener", self.stiffener, zero=True)
        _check.count(who, "through", self.through)
        on_top = (self.thickness + self.stiffener) / 2
        if self.offset is None:
            object.__setattr__(self, "offset", on_top)
        offset = _check.number(who, "offset", self.offset)
        inside = (self.thickness - self.stiffener) / 2
        within = 0 <= offset < inside * (1 - 1e-9)
        if self.stiffener and not (within or abs(offset - on_top) <= 1e-9 * on_top):
            raise InputError(
                f"{who}: offset is {offset:g} m; the stiffener lies inside the film at 0 to less "
                f"than {inside:g} m, or on its top at {on_top:g} m."
            )

    @property
    def on_top(self) -> bool:
        """Whether the stiffener lies on the film rather than in it."""
        assert self.offset is not None
        return bool(self.stiffener) and self.offset > self.thickness / 2

    def _rows(self) -> tuple[Floats, int, int]:
        """Heights of the cells' faces, and the rows from which and up to which the strip lies."""
        h, t, n = self.thickness, self.stiffener, self.through
        assert self.offset is not None
        if not t:
            return h * np.linspace(0, 1, n + 1), 0, 0
        if self.on_top:
            return np.append(h * np.linspace(0, 1, n + 1), h + t), n, n + 1
        low = h / 2 + self.offset - t / 2
        below = max(1, round(n * low / (h - t))) if n > 1 else 1
        above = max(1, n - below)
        heights = joined_ends(
            low * np.linspace(0, 1, below + 1), [low, low + t],
            low + t + (h - low - t) * np.linspace(0, 1, above + 1),
        )  # fmt: skip
        return heights, below, below + 1

    def _name(self, mesh: StructuredMesh, row: Ints, strip: np.ndarray, across: int) -> None:
        """Regions and the groups of the faces; `strip` masks the cells under or over the strip."""
        heights, start, stop = self._rows()
        stiff = strip & (row >= start) & (row < stop)
        mesh.add_region("film", ~stiff)
        last = start - 1 if self.on_top else len(heights) - 2
        if stiff.any():
            mesh.add_region("stiffener", stiff)
        mesh.add_facets("bottom", row == 0, across, 0)
        # the film's own upper face, also under a strip that lies on it
        mesh.add_facets("top", row == last, across, 1)
        if self.on_top:
            mesh.add_facets("back", stiff, across, 1)

    def _film_and_strip(self, plane: float, strip: float) -> dict[str, float]:
        """Measures of regions and faces, given the areas of the whole and of the strip."""
        found = {"bottom": plane, "top": plane, "film": plane * self.thickness}
        if self.stiffener:
            found["stiffener"] = strip * self.stiffener
            if self.on_top:
                found["back"] = strip
            else:
                found["film"] -= strip * self.stiffener
        return found


@dataclass(frozen=True)
@in_si(length="m", strip="m")
class StiffenedSection(_Stiffened):
    """Flat section of a film, x along its width and y through it, with a stiffener from x1 to x2.

    Parameters
    ----------
    length
        Of the film along x in m.
    strip
        x1 and x2 in m.
    thickness, stiffener, offset
        Film, stiffener, and how far its middle lies above the film's, in m; on top by default.
    cells
        Cells along x before, in and behind the strip.
    through
        Cells through the film.
    grading
        Largest over smallest cell beside the strip; the small ones lie at its edges.

    Notes
    -----
    Regions ``film`` and ``stiffener``; facet groups ``x_min``, ``x_max``, ``bottom``, ``top`` (the
    film's upper face) and, for a strip on top, ``back`` (its own).

    Raises
    ------
    InputError
        A parameter is not usable: the stiffener outside the film, an offset beyond it, and so on.
    """

    length: float = 53.975e-3
    strip: tuple[float, float] = (26.5e-3, 27.5e-3)
    cells: tuple[int, int, int] = (14, 4, 14)
    grading: float = 8.0
    order: int = 1

    def __post_init__(self) -> None:
        who = "StiffenedSection"
        _check.length(who, "length", self.length)
        self._check_layers(who)
        first, last = (_check.number(who, "strip", x) for x in self.strip)
        if not 0 <= first < last <= self.length:
            raise InputError(
                f"{who}: the stiffener reaches from {first:g} to {last:g} m; it must lie on the "
                f"film, between 0 and {self.length:g} m."
            )
        for n in self.cells:
            _check.count(who, "cells", n)
        _check.ratio(who, "grading", self.grading)
        _check.order(who, self.order)

    @property
    def dimension(self) -> int:
        """2."""
        return 2

    def measures(self) -> dict[str, float]:
        """Exact area of the regions and length of the facet groups."""
        first, last = self.strip
        found = self._film_and_strip(self.length, last - first)
        more = self.stiffener if self.on_top else 0.0
        found["x_min"] = self.thickness + (more if first == 0 else 0.0)
        found["x_max"] = self.thickness + (more if last == self.length else 0.0)
        return found

    def refine(self, factor: int) -> StiffenedSection:
        """The same section with all divisions multiplied by ``factor``."""
        k = _check.count("StiffenedSection.refine", "factor", factor)
        a, b, c = self.cells
        return replace(self, cells=(k * a, k * b, k * c), through=k * self.through)

    def mesh(self) -> StructuredMesh:
        """Nodes, cells and named parts as plain arrays."""
        first, last = self.strip
        before, inside, behind = self.cells
        pieces, start = [], 0
        if first > 0:
            pieces.append(first * graded(before, self.grading, "end"))
            start = before
        pieces.append(first + (last - first) * np.linspace(0, 1, inside + 1))
        if last < self.length:
            rest = self.length - last
            pieces.append(last + rest * graded(behind, self.grading, "start"))
        heights, low, high = self._rows()
        solid = low if self.on_top else len(heights) - 1

        def strip(x: Ints) -> np.ndarray:
            return (x >= start) & (x < start + inside)

        ends = [joined_ends(*pieces), heights]
        mesh, (x, row) = lattice(ends, self.order, lambda x, row: (row < solid) | strip(x))
        self._name(mesh, row, strip(x), 1)
        mesh.add_facets("x_min", x == 0, 0, 0)
        mesh.add_facets("x_max", x == len(ends[0]) - 2, 0, 1)
        return mesh


@dataclass(frozen=True)
@in_si(length="m", width="m", corners="m")
class StiffenedFilm(_Stiffened):
    """Rectangle of film, 0 to ``length`` in x, 0 to ``width`` in y, with a strip along a diagonal.

    Parameters
    ----------
    length, width
        Of the film in m.
    corners
        p1, p2, p3, p4 of the strip in the plane in m, counterclockwise: p1 and p4 near the corner
        (0, 0), p2 and p3 near the opposite one; p1 p2 is the side that faces (length, 0).
    thickness, stiffener, offset
        Film, stiffener, and how far its middle lies above the film's, in m; on top by default.
    along, beside, through
        Cells along half of the strip, from the strip to a corner of the film, through the film.
    grading
        Largest over smallest cell beside the strip; the small ones lie at its edges.

    Notes
    -----
    Regions ``film`` and ``stiffener``; facet groups ``x_min``, ``x_max``, ``y_min``, ``y_max`` (the
    film's sides), ``bottom``, ``top`` (the film's upper face) and, for a strip on top, ``back``.
    Two cells lie across the strip; cells are straight.

    Raises
    ------
    InputError
        A parameter is not usable: the stiffener outside the film, an offset beyond it, and so on.
    """

    length: float = 53.975e-3
    width: float = 69.85e-3
    corners: Sequence[Sequence[float]] = (
        (6.72e-3, 7.95e-3), (47.6e-3, 61.4e-3), (47.2e-3, 61.9e-3), (6.37e-3, 8.45e-3),
    )  # fmt: skip
    along: int = 6
    beside: int = 5
    grading: float = 6.0
    parts: int = 1
    order = 1

    def __post_init__(self) -> None:
        who = "StiffenedFilm"
        _check.length(who, "length", self.length)
        _check.length(who, "width", self.width)
        self._check_layers(who)
        p = np.asarray(self.corners, dtype=float)
        if p.shape != (4, 2) or not np.all(np.isfinite(p)):
            raise InputError(f"{who}: corners must be four points in the plane, in m.")
        object.__setattr__(self, "corners", tuple((float(x), float(y)) for x, y in p))
        outside = np.any((p <= 0) | (p >= [self.length, self.width]), axis=1)
        if outside.any():
            x, y = p[int(np.argmax(outside))]
            raise InputError(
                f"{who}: the stiffener's corner ({x:g}, {y:g}) m lies outside the film, which "
                f"reaches from 0 to {self.length:g} and {self.width:g} m."
            )
        for name in ("along", "parts"):
            _check.count(who, name, getattr(self, name))
        _check.count(who, "beside", self.beside)
        _check.ratio(who, "grading", self.grading)
        if any(_area(c) <= 0 for _, c, _, _ in self._blocks()):
            raise InputError(
                f"{who}: the strip must run from near (0, 0) to near (length, width), its corners "
                "given counterclockwise from the lower right one."
            )

    @property
    def _strip_area(self) -> float:
        return _area(np.array(self.corners))

    def measures(self) -> dict[str, float]:
        """Exact volume of the regions and area of the facet groups."""
        found = self._film_and_strip(self.length * self.width, self._strip_area)
        x, y = self.width * self.thickness, self.length * self.thickness
        return found | {"x_min": x, "x_max": x, "y_min": y, "y_max": y}

    def refine(self, factor: int) -> StiffenedFilm:
        """The same film with every cell divided by ``factor`` in all directions."""
        k = _check.count("StiffenedFilm.refine", "factor", factor)
        return replace(self, parts=k * self.parts, through=k * self.through)

    def _blocks(self) -> list[tuple[str, np.ndarray, Floats, Floats]]:
        """Quadrilaterals of the plane: name of their outer side, corners, divisions along both."""
        p1, p2, p3, p4 = np.array(self.corners)
        x, y = self.length, self.width
        v1, right, v2, left = np.array([[0, 0], [x, 0], [x, y], [0, y]], dtype=float)
        m, n, c1, c2 = (p1 + p2) / 2, (p3 + p4) / 2, (p1 + p4) / 2, (p2 + p3) / 2
        # the feet of the strip's corners on the film's sides
        f1, f2, f3, f4 = np.array([[p1[0], 0], [x, p2[1]], [p3[0], y], [0, p4[1]]])
        along, across = np.linspace(0, 1, self.along + 1), np.linspace(0, 1, 3)
        towards = graded(self.beside, self.grading, "end")  # from outside to the strip
        one = np.array([0.0, 1.0])
        blocks = [
            ("strip", (p1, m, n, p4), along, across),
            ("strip", (m, p2, p3, n), along, across),
            ("y_min", (v1, f1, p1, c1), one, towards),
            ("y_min", (f1, right, m, p1), along, towards),
            ("x_max", (right, f2, p2, m), along, towards),
            ("x_max", (f2, v2, c2, p2), one, towards),
            ("y_max", (v2, f3, p3, c2), one, towards),
            ("y_max", (f3, left, n, p3), along, towards),
            ("x_min", (left, f4, p4, n), along, towards),
            ("x_min", (f4, v1, c1, p4), one, towards),
        ]
        return [(name, np.array(c), s, t) for name, c, s, t in blocks]

    def _plane(self) -> tuple[Floats, Ints, np.ndarray]:
        """Nodes (N, 2) and cells (M, 2, 2) of the plane, and the name of each cell's block."""
        points, cells, names = [], [], []
        count = 0
        for name, c, s, t in self._blocks():
            s, t = _divided(s, self.parts), _divided(t, self.parts)
            u, v = s[:, None, None], t[None, :, None]
            grid = (1 - u) * (1 - v) * c[0] + u * (1 - v) * c[1] + u * v * c[2] + (1 - u) * v * c[3]
            numbers = count + np.arange(grid[..., 0].size).reshape(len(s), len(t))
            count += grid[..., 0].size
            points.append(grid.reshape(-1, 2))
            quads = np.stack([numbers[:-1, :-1], numbers[:-1, 1:], numbers[1:, :-1],
                              numbers[1:, 1:]], axis=-1)  # fmt: skip
            cells.append(quads.reshape(-1, 2, 2))
            # the outer side of a block is its first line of cells in t
            kind = np.full(quads.shape[:2], "strip" if name == "strip" else "", dtype="<U5")
            if name != "strip":
                kind[:, 0] = name
            names.append(kind.ravel())
        every = np.concatenate(points)
        scale = 1e-7 * min(self.length, self.width)
        _, first, number = np.unique(
            np.rint(every / scale).astype(np.int64), axis=0, return_index=True, return_inverse=True
        )
        return every[first], number.ravel()[np.concatenate(cells)], np.concatenate(names)

    def mesh(self) -> StructuredMesh:
        """Nodes, cells and named parts as plain arrays."""
        points, plane, names = self._plane()
        heights, low, _ = self._rows()
        layers = len(heights) - 1
        cells, base, row = sweep(plane, layers, 1)
        strip = names[base] == "strip"
        there = (row < (low if self.on_top else layers)) | strip
        cells, used = compact(cells[there])
        node, level = np.divmod(used, layers + 1)
        mesh = StructuredMesh(np.column_stack([points[node], heights[level]]), cells)
        base, row, strip = base[there], row[there], strip[there]
        self._name(mesh, row, strip, 2)
        for side in ("x_min", "x_max", "y_min", "y_max"):
            mesh.add_facets(side, names[base] == side, 1, 0)
        return mesh


def _divided(ends: Floats, parts: int) -> Floats:
    """Cell ends with every cell divided evenly."""
    return np.interp(np.arange(parts * (len(ends) - 1) + 1) / parts, np.arange(len(ends)), ends)


def _area(polygon: np.ndarray) -> float:
    """Signed area, positive if counterclockwise."""
    x, y = polygon[:, 0], polygon[:, 1]
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) / 2)


def main(arguments: list[str] | None = None) -> int:
    """``python -m dea_fenicsx.geometry.stiffened_film``: write a .msh, print measures."""
    from ._cli import parameter_parser, run

    parser = parameter_parser(
        "dea_fenicsx.geometry.stiffened_film",
        "Mesh of a rectangular film with a stiff strip along its diagonal.",
        StiffenedFilm,
        {
            "length": "along x in m",
            "width": "along y in m",
            "thickness": "of the film in m",
            "stiffener": "thickness of the stiffener in m; 0 for none",
            "offset": "of the stiffener's middle above the film's, in m; on top by default",
            "along": "cells along half of the strip",
            "beside": "cells from the strip to a corner of the film",
            "through": "cells through the film",
            "grading": "largest over smallest cell beside the strip",
        },
    )
    return run(parser, StiffenedFilm, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
