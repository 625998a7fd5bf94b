"""Folding hinge: a stack of dielectric films on a passive sheet that is thinner along the fold."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import in_si

from . import _check
from ._structured import StructuredMesh, joined_ends, lattice
from .base import Geometry
from .grading import graded


@dataclass(frozen=True)
@in_si(
    thin="m", thick="m", width="m", film="m", electrode="m", cover="m", sheet_thin="m",
    sheet_thick="m",
)  # fmt: skip
class DEAHinge(Geometry):
    """Thick, thin, thick along x; the stack lies on the sheet, in y (flat) or z (in space).

    From the bottom up: sheet, electrode, then film and electrode for each film, cover.  The sheet's
    upper face is flat; where it is thick, it is so downwards.  The lower face of the thin region is
    at 0.

    Parameters
    ----------
    thin, thick
        Lengths along x in m of the thin region and of each of the two thick ones; ``thick=0``
        leaves the thin region alone.
    width
        In m; None for the flat section.
    films
        Number of dielectric films; there is one electrode more.
    film, electrode, cover, sheet_thin, sheet_thick
        Thicknesses in m.
    cells
        Cells along x in each thick region and in each quarter of the thin one.
    across
        Cells over the width.
    through
        Cells through each film; all other layers have one.
    grading
        Largest over smallest cell of the thick regions; the small ones lie at their ends, where a
        voltage may fall off and the fold begins.

    Notes
    -----
    Regions: ``sheet``, ``electrode_1``, ``film_1``, ``electrode_2``, ..., ``cover``.  Facet groups:
    ``x_min``, ``x_max``, ``y_min``, ``y_max`` (in space only), ``bottom``, ``top``; the faces of
    each film, ``film_1_bottom``, ``film_1_top``, ...; across the thin region its cross-sections
    ``section_0`` to ``section_4``, the outer two at its ends (with ``thick=0`` those are ``x_min``
    and ``x_max``).

    Raises
    ------
    InputError
        A parameter is not usable.
    """

    thin: float = 2e-3
    thick: float = 4e-3
    width: float | None = None
    films: int = 3
    film: float = 50e-6
    electrode: float = 10e-6
    cover: float = 15e-6
    sheet_thin: float = 10e-6
    sheet_thick: float = 15e-6
    cells: tuple[int, int] = (8, 3)
    across: int = 4
    through: int = 1
    grading: float = 4.0
    order: int = 1

    def __post_init__(self) -> None:
        who = "DEAHinge"
        for name in ("thin", "film", "electrode", "cover", "sheet_thin", "sheet_thick"):
            _check.length(who, name, getattr(self, name))
        _check.length(who, "thick", self.thick, zero=True)
        if self.width is not None:
            _check.length(who, "width", self.width)
        for name in ("films", "across", "through"):
            _check.count(who, name, getattr(self, name))
        if not isinstance(self.cells, tuple | list) or len(self.cells) != 2:
            raise InputError(
                f"{who}: cells is {self.cells!r}; it must hold two values, for a thick region and "
                "for a quarter of the thin one."
            )
        object.__setattr__(self, "cells", tuple(_check.count(who, "cells", n) for n in self.cells))
        _check.ratio(who, "grading", self.grading)
        _check.order(who, self.order)
        if self.sheet_thick <= self.sheet_thin:
            raise InputError(
                f"{who}: sheet_thick is {self.sheet_thick!r}; it must be above sheet_thin, "
                f"{self.sheet_thin!r} m."
            )

    @property
    def dimension(self) -> int:
        """3, or 2 for the flat section."""
        return 2 if self.width is None else 3

    @property
    def length(self) -> float:
        """Along x in m."""
        return self.thin + 2 * self.thick

    def layers(self) -> Iterator[tuple[str, float]]:
        """Name and thickness of each layer above the sheet."""
        yield "electrode_1", self.electrode
        for k in range(1, self.films + 1):
            yield f"film_{k}", self.film
            yield f"electrode_{k + 1}", self.electrode
        yield "cover", self.cover

    @property
    def height(self) -> float:
        """Of the thin region in m; the thick ones have ``sheet_thick - sheet_thin`` more."""
        return self.sheet_thin + sum(t for _, t in self.layers())

    @property
    def _step(self) -> float:
        return self.sheet_thick - self.sheet_thin if self.thick else 0.0

    def measures(self) -> dict[str, float]:
        """Exact volume (area) of every region and area (length) of every facet group."""
        width = 1.0 if self.width is None else self.width
        plane, end = self.length * width, (self.height + self._step) * width
        found = {name: plane * t for name, t in self.layers()}
        found["sheet"] = plane * self.sheet_thin + 2 * self.thick * width * self._step
        found |= {"x_min": end, "x_max": end, "bottom": plane, "top": plane}
        for k in range(1, self.films + 1):
            found |= {f"film_{k}_bottom": plane, f"film_{k}_top": plane}
        inner = range(5) if self.thick else range(1, 4)
        found |= {f"section_{k}": self.height * width for k in inner}
        if self.width is not None:
            side = self.length * self.height + 2 * self.thick * self._step
            found |= {"y_min": side, "y_max": side}
        return found

    def refine(self, factor: int) -> DEAHinge:
        """The same hinge with all divisions multiplied by ``factor``."""
        k = _check.count("DEAHinge.refine", "factor", factor)
        cells = (k * self.cells[0], k * self.cells[1])
        return replace(self, cells=cells, across=k * self.across, through=k * self.through)

    def mesh(self) -> StructuredMesh:
        """Nodes, cells and named parts as plain arrays."""
        outer, quarter = self.cells
        thin = self.thick + self.thin * np.linspace(0, 1, 4 * quarter + 1)
        pieces = [thin]
        if self.thick:
            left = self.thick * graded(outer, self.grading)
            right = self.length - left[::-1]
            pieces = [left, thin, right]
        else:
            outer = 0
        # rows of cells: the step below the thin region, then one or more for each layer
        rows = [("sheet", self._step, 1)] if self._step else []
        rows.append(("sheet", self.sheet_thin, 1))
        rows += [(n, t, self.through if n.startswith("film") else 1) for n, t in self.layers()]
        heights = np.concatenate([[-self._step], *(np.full(n, t / n) for _, t, n in rows)])
        names = np.array([name for name, _, n in rows for _ in range(n)])
        ends = [joined_ends(*pieces), np.cumsum(heights)]
        if self.width is not None:
            ends.insert(1, self.width * np.linspace(0, 1, self.across + 1))
        last = len(ends) - 1
        first, stop, low = outer, outer + 4 * quarter, 1 if self._step else 0

        mesh, cell = lattice(
            ends, self.order, lambda *c: (c[last] >= low) | (c[0] < first) | (c[0] >= stop)
        )
        x, row = cell[0], cell[last]
        for name in dict.fromkeys(names):
            mesh.add_region(str(name), names[row] == name)
        mesh.add_facets("x_min", x == 0, 0, 0)
        mesh.add_facets("x_max", x == len(ends[0]) - 2, 0, 1)
        if last == 2:
            mesh.add_facets("y_min", cell[1] == 0, 1, 0)
            mesh.add_facets("y_max", cell[1] == self.across - 1, 1, 1)
        thin_cell = (x >= first) & (x < stop)
        mesh.add_facets("bottom", row == np.where(thin_cell, low, 0), last, 0)
        mesh.add_facets("top", row == len(names) - 1, last, 1)
        for k in range(1, self.films + 1):
            inside = np.flatnonzero(names == f"film_{k}")
            mesh.add_facets(f"film_{k}_bottom", row == inside[0], last, 0)
            mesh.add_facets(f"film_{k}_top", row == inside[-1], last, 1)
        for k in range(5) if self.thick else range(1, 4):
            at = first + k * quarter
            # seen from within the thin region, so that the step's own face is no part of it
            near, end = (at, 0) if k == 0 else (at - 1, 1)
            mesh.add_facets(f"section_{k}", (x == near) & (row >= low), 0, end)
        return mesh


def main(arguments: list[str] | None = None) -> int:
    """``python -m dea_fenicsx.geometry.dea_hinge``: write a .msh, print measures."""
    from ._cli import parameter_parser, run, value, values

    parser = parameter_parser(
        "dea_fenicsx.geometry.dea_hinge",
        "Mesh of a folding hinge, in space or as a flat section.",
        DEAHinge,
        {
            "thin": "length of the thin region in m",
            "thick": "length of each thick region in m",
            "films": "number of films",
            "film": "thickness of a film in m",
            "electrode": "thickness of an electrode in m",
            "cover": "thickness of the cover in m",
            "sheet_thin": "thickness of the sheet in the thin region in m",
            "sheet_thick": "thickness of the sheet in the thick regions in m",
            "across": "cells over the width",
            "through": "cells through a film",
            "grading": "largest over smallest cell of a thick region",
            "order": "degree of the cells' geometry, 1 or 2",
        },
    )
    parser.add_argument("--width", type=value, help="in m; without it a flat section")
    parser.add_argument(
        "--cells", type=values, default=(8, 3),
        help="cells along a thick region and along a quarter of the thin one, as 8,3",
    )  # fmt: skip
    return run(parser, DEAHinge, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
