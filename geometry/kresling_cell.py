"""One storey of a Kresling box as a solid: thin panels that hang together by hinges."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import in_si

from . import _check
from ._panel import ORDER, Panel
from ._structured import Floats, Ints, StructuredMesh, lattice_points, sweep
from .base import Geometry
from .grading import graded

CREASES = ("side", "edge", "diagonal")
"""What lies along the three sides of a panel, in the order of its corners."""


@dataclass(frozen=True)
@in_si(side="m", height="m", twist="rad", thickness="m", hinge="m")
class KreslingCell(Geometry):
    """Storey of a Kresling box, folded and free of stress: two triangular panels a side.

    Regular polygons of the given side lie at z = 0 and z = height, the upper one turned by the
    twist about z.  Edges join each lower corner to its own partner above, diagonals to the next
    one: as in `dea_fenicsx.origami`, whose closed forms hold for this body where it is thin.

    In place of each crease there is a hinge, a smooth fold: a strip as thick as the panels and bent
    round to an arc that they touch.  The planes of the panels meet where the crease would be.
    Hinges end before the corners, as round a corner a smooth fold would have to stretch; that of
    thesis section 5.4.3 ends there too, by 0.6 of 5.

    Parameters
    ----------
    side
        Side a of the polygons in m.
    height, twist
        Of the storey as it was made, in m and rad.
    thickness
        Of panels and hinges in m.
    hinge
        Width of a hinge, along its arc, in m; at the polygons, where another storey or a plate
        begins, there is half of one.
    relief
        Share of a crease that is cut out at each of its ends.
    sides
        Of the polygons.
    along
        Cells along half a hinge.
    tip
        Cells along the panel's side beside the cut.
    strip
        Cells across half a hinge.
    through
        Cells through the thickness.
    grading, grading_strip, grading_through
        Largest over smallest cell along half a hinge and beside the cut, across half a hinge, and
        through the thickness.  The small ones lie where the stress is singular: at the ends of the
        hinges, where these meet the panels or what holds them, and at the faces.

    Notes
    -----
    Volume groups: ``panel``, and the hinges ``side`` (at the polygons), ``edge`` and ``diagonal``.
    Facet groups: ``bottom`` and ``top``, the end faces at the polygons, ``inner`` and ``outer``.

    Raises
    ------
    InputError
        A parameter is not usable: panels would go through each other or are too thick for a fold,
        hinges leave no panel or reach round a corner.
    """

    side: float
    height: float
    twist: float
    thickness: float
    hinge: float
    relief: float = 0.15
    sides: int = 4
    along: int = 3
    tip: int = 1
    strip: int = 1
    through: int = 1
    grading: float = 1.0
    grading_strip: float = 1.0
    grading_through: float = 1.0

    def __post_init__(self) -> None:
        for name in ("side", "height", "thickness", "hinge"):
            _check.length("KreslingCell", name, getattr(self, name))
        _check.number("KreslingCell", "twist", self.twist)
        _check.count("KreslingCell", "sides", self.sides, least=3)
        for name in ("along", "tip", "strip", "through"):
            _check.count("KreslingCell", name, getattr(self, name))
        for name in ("grading", "grading_strip", "grading_through"):
            _check.ratio("KreslingCell", name, getattr(self, name))
        if not 0 < _check.number("KreslingCell", "relief", self.relief) < 0.5:
            raise InputError(
                f"KreslingCell: relief is {self.relief:g}; it must be a share of a crease above 0 "
                "and below 0.5."
            )
        contact = math.pi - 2 * math.pi / self.sides
        if not 0 <= self.twist < contact:
            raise InputError(
                f"KreslingCell: the pattern cannot close at a twist of {self.twist:g} rad; it must "
                f"be at least 0 and below {contact:g}, where the panels of {self.sides} sides meet "
                "on the axis."
            )
        least = self.thickness * float(np.max(np.abs(self._half_folds())))
        if self.hinge <= least:
            raise InputError(
                f"KreslingCell: panels {self.thickness:g} m thick are too thick for their fold: "
                f"hinges must be wider than {least:g} m to bend round that far, but hinge is "
                f"{self.hinge:g} m."
            )
        share = float(np.max(self._insets().sum(axis=1)))
        if share >= 0.9:
            raise InputError(
                f"KreslingCell: hinges of {self.hinge:g} m leave no panel between them; make them "
                f"narrower than {0.9 / share * self.hinge:g} m."
            )
        if self.relief <= self._cut():
            raise InputError(
                f"KreslingCell: relief is {self.relief:g}, but with hinges of {self.hinge:g} m "
                f"panels begin {self._cut():.3g} of a crease from its ends; make the relief larger "
                "than that, or hinges narrower."
            )

    # ------------------------------------------------------------------ shape

    @property
    def _corners(self) -> Floats:
        """Corners of the lower, then of the upper polygon, shape (2 n, 3)."""
        radius = self.side / (2 * math.sin(math.pi / self.sides))
        angle = 2 * math.pi / self.sides * np.arange(self.sides)
        rings = [(angle, 0.0), (angle + self.twist, self.height)]
        return np.concatenate([
            np.column_stack([radius * np.cos(a), radius * np.sin(a), np.full(len(a), z)])
            for a, z in rings
        ])  # fmt: skip

    @property
    def _triangles(self) -> Ints:
        """Corner numbers, counterclockwise from outside: side, edge, diagonal; shape (2 n, 3)."""
        n = self.sides
        i = np.arange(n)
        after = (i + 1) % n
        lower = np.stack([i, after, n + after], axis=1)
        upper = np.stack([n + after, n + i, i], axis=1)
        return np.stack([lower, upper], axis=1).reshape(-1, 3)

    @property
    def _panels(self) -> Floats:
        """Corners of the triangles, shape (2 n, 3, 3)."""
        return self._corners[self._triangles]

    @property
    def _normals(self) -> Floats:
        p = self._panels
        normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
        return normal / np.linalg.norm(normal, axis=1, keepdims=True)

    def _half_folds(self) -> Floats:
        """Half the fold at each side of each triangle in rad, mountains > 0; 0 at the polygons."""
        p, normals, k = self._panels, self._normals, np.arange(2 * self.sides)
        # the neighbour across the edge of a lower panel is the upper one of the next side
        beside = np.stack([k, (k + np.where(k % 2, -3, 3)) % len(k), k ^ 1], axis=1)
        along = np.roll(p, -1, axis=1) - p
        along /= np.linalg.norm(along, axis=2, keepdims=True)
        own, other = normals[:, None], normals[beside]
        sine = np.sum(np.cross(own, other) * along, axis=2)
        return np.arctan2(sine, np.sum(own * other, axis=2)) / 2

    def _insets(self) -> Floats:
        """Distance from each crease at which a panel begins, over the triangle's height there.

        A fold 2 A of radius r = hinge/(2 A) touches its panels at r tan(A) from the crease.
        """
        p, half = self._panels, self._half_folds()
        lengths = np.linalg.norm(np.roll(p, -1, axis=1) - p, axis=2)
        double = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
        return self.hinge / 2 * _over(np.tan(half), half, 1.0) * lengths / double[:, None]

    def _inner_weights(self) -> Floats:
        """Corners of the panels proper, between their hinges, in barycentric coordinates."""
        inset = self._insets()
        weights = np.zeros((len(inset), 3, 3))
        for k in range(3):
            weights[:, k, k - 1] = inset[:, k]
            weights[:, k, (k + 1) % 3] = inset[:, k - 1]
            weights[:, k, k] = 1 - inset[:, k] - inset[:, k - 1]
        return weights

    def _inner(self) -> Floats:
        """Corners of the panels proper, shape (2 n, 3, 3)."""
        return self._inner_weights() @ self._panels

    def _feet(self) -> Floats:
        """Share of each side of the first triangle at which its height stands."""
        p = self._panels[0]
        along, up = np.roll(p, -1, axis=0) - p, np.roll(p, -2, axis=0) - p
        return np.sum(along * up, axis=1) / np.sum(along**2, axis=1)

    def _cut(self) -> float:
        """Least share of a crease that must be cut out for hinges to begin on their panels."""
        weights, feet = self._inner_weights()[0], self._feet()
        ends = []
        for j in range(3):
            start, end = (
                w[(j + 1) % 3] + feet[j] * w[j - 1] for w in (weights[j], weights[(j + 1) % 3])
            )
            ends += [start, 1 - end]
        return float(max(ends))

    def measures(self) -> dict[str, float]:
        """Exact volume (m^3) of every region and area (m^2) of every facet group."""
        t, left = self.thickness, 1 - 2 * self.relief
        found = dict.fromkeys((*CREASES, "panel", "bottom", "top", "inner", "outer"), 0.0)
        for p, q, half in zip(self._panels, self._inner(), self._half_folds(), strict=True):
            panel = float(np.linalg.norm(np.cross(q[1] - q[0], q[2] - q[0])) / 2)
            found["panel"] += t * panel
            strips = self.hinge / 2 * left * np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1)
            for kind, area in zip(CREASES, strips, strict=True):
                found[kind] += t * float(area)
            # the outer face of a mountain is longer than the middle by t/2 times the fold
            extra = strips * half * t / self.hinge
            found["outer"] += panel + float(np.sum(strips + extra))
            found["inner"] += panel + float(np.sum(strips - extra))
        found["bottom"] = found["top"] = self.sides * self.side * left * t
        return found

    def refine(self, factor: int) -> KreslingCell:
        """The same storey with all divisions multiplied by ``factor``."""
        k = _check.count("KreslingCell.refine", "factor", factor)
        names = ("along", "tip", "strip", "through")
        return replace(self, **{name: k * getattr(self, name) for name in names})

    # ------------------------------------------------------------------ mesh

    def mesh(self) -> StructuredMesh:
        """Nodes, cells and named parts as plain arrays."""
        quads, weights, bend, of, rims = self._panel().mesh()
        numbers, count = self._number(len(weights), rims)
        levels = graded(self.through, self.grading_through)
        z = self.thickness * (lattice_points(levels, ORDER) - 0.5)
        points = np.zeros((count, len(z), 3))
        shapes = (numbers, self._panels, self._normals, self._half_folds())
        for own, p, normal, half in zip(*shapes, strict=True):
            along = (np.roll(p, -1, axis=0) - p)[of]
            along /= np.linalg.norm(along, axis=1, keepdims=True)
            out = np.cross(along, normal)
            # from the panel's rim by an angle along an arc of length hinge/2 that turns by `half`
            angle = bend * half[of]
            forth = self.hinge / 2 * _over(np.sin(angle), half[of], bend)
            down = self.hinge / 2 * _over(1 - np.cos(angle), half[of], 0.0)
            middle = weights @ p + forth[:, None] * out - down[:, None] * normal
            director = np.cos(angle)[:, None] * normal + np.sin(angle)[:, None] * out
            points[own] = middle[:, None] + z[:, None] * director[:, None]

        plane = numbers[:, quads].reshape(-1, *quads.shape[1:])
        cells, base, level = sweep(plane, self.through, ORDER)
        mesh = StructuredMesh(points.reshape(-1, 3), cells)
        triangle, quad = np.divmod(base, len(quads))
        row = 2 * self.along  # cells of a strip in one row; the rows beside the rim come first
        kind = np.minimum(quad // (row * self.strip), 3)
        for j, name in enumerate((*CREASES, "panel")):
            mesh.add_region(name, kind == j)
        mesh.add_facets("bottom", (quad < row) & (triangle % 2 == 0), 1, 0)
        mesh.add_facets("top", (quad < row) & (triangle % 2 == 1), 1, 0)
        mesh.add_facets("inner", level == 0, 2, 0)
        mesh.add_facets("outer", level == self.through - 1, 2, 1)
        return mesh

    def _number(self, nodes: int, rims: Ints) -> tuple[Ints, int]:
        """Numbers of each triangle's nodes, those on shared creases the same; and how many."""
        numbers = np.full((2 * self.sides, nodes), -1, dtype=np.int64)
        shared: dict[tuple[int, int, int], int] = {}
        for own, triangle in zip(numbers, self._triangles, strict=True):
            for j, rim in enumerate(rims):
                start, end = int(triangle[j]), int(triangle[(j + 1) % 3])
                # counted from the crease's corner of lower number
                for i, node in enumerate(rim if start < end else rim[::-1]):
                    key = (min(start, end), max(start, end), i)
                    own[node] = shared.setdefault(key, len(shared))
        inner = numbers < 0
        numbers[inner] = len(shared) + np.arange(np.count_nonzero(inner))
        return numbers, int(numbers.max()) + 1

    def _panel(self) -> Panel:
        """The first triangle with its halves of hinges; all others are meshed like it."""
        hinge = self.relief + (0.5 - self.relief) * graded(self.along, self.grading, "start")
        return Panel(
            corners=self._panels[0],
            feet=self._feet(),
            tips=self._inner_weights()[0],
            inset=self._insets()[0],
            hinge=hinge,
            tip=graded(self.tip, self.grading, "both"),
            across=1 - graded(self.strip, self.grading_strip),
        )


def _over(above: Floats, below: Floats, limit: Floats | float) -> Floats:
    """A quotient, with its limit where the divisor vanishes."""
    flat = np.abs(below) < 1e-9
    return np.where(flat, limit, above / np.where(flat, 1.0, below))


def main(arguments: list[str] | None = None) -> int:
    """``python -m dea_fenicsx.geometry.kresling_cell``: write a .msh, print its measures."""
    from ._cli import parameter_parser, run

    parser = parameter_parser(
        "dea_fenicsx.geometry.kresling_cell",
        "Mesh of one storey of a Kresling box: panels and hinges.",
        KreslingCell,
        {
            "side": "side of the polygons in m",
            "height": "of the storey in m",
            "twist": "of the storey in rad",
            "thickness": "of panels and hinges in m",
            "hinge": "width of a hinge in m",
            "relief": "share of a crease that is cut out at each end",
            "sides": "sides of the polygons",
            "along": "cells along half a hinge",
            "tip": "cells along the panel's side beside the cut",
            "strip": "cells across half a hinge",
            "through": "cells through the thickness",
            "grading": "largest over smallest cell along half a hinge",
            "grading_strip": "the same across half a hinge",
            "grading_through": "the same through the thickness",
        },
    )
    return run(parser, KreslingCell, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
