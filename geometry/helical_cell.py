"""Cross-section of one pitch of a helical actuator, for the helically periodic cell."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si

from . import _check
from ._structured import Floats, Ints, StructuredMesh, block, compact, joined_ends, lattice_points
from .base import Geometry
from .grading import graded
from .hdea import HDEA


@dataclass(frozen=True)
@in_si(outer_radius="m", inner_radius="m", inset="m", elastomer="m", electrode="m")
class HelicalCell(Geometry):
    """One pitch of `HDEA`'s cross-section in (r, zeta), for the kinematics ``Helical(pitch)``.

    The period begins where least is cut: with finite electrodes in the middle of electrode b
    (half of b, elastomer, a, elastomer, half of b), with ideal ones in the middle of an elastomer
    layer (half, a, layer, b, half).  Given pressures on the faces of an elastomer layer thus
    belong to one period.

    Parameters
    ----------
    outer_radius, inner_radius, inset, elastomer, electrode
        As in `HDEA`, in metres.
    radial, rim, through, through_electrode
        Cells over the electrode's width, over each rim, through each elastomer layer (two at
        least), and through each electrode (half an electrode takes half, rounded up).
    grading, grading_rim, grading_through
        Largest over smallest cell over the electrode's width, over each rim and through each
        elastomer layer; the small ones lie at the electrodes' edges and faces.
    films
        Gives the elastomer between the electrodes names of its own, for `ThinFilm`: ``film_below``
        and ``film_above`` electrode a, at the heights of ``film_spans``.  Not with ideal
        electrodes, where the period cuts a film in two.

    Notes
    -----
    Regions: ``elastomer``, ``electrode_a``, ``electrode_b``, and the films where wanted.  Facet
    groups: ``electrode_a_active``, ``electrode_b_active`` (broad faces, or ideal electrodes),
    ``electrode_a_rim``, ``electrode_b_rim`` (edges of finite electrodes off the cylinders),
    ``bottom``, ``top`` (the two ends of the period), ``inner``, ``outer``.

    Raises
    ------
    InputError
        A parameter is not usable.
    """

    outer_radius: float = 7e-3
    inner_radius: float = 2e-3
    inset: float = 0.3e-3
    elastomer: float = 0.5e-3
    electrode: float = 0.05e-3
    radial: int = 8
    rim: int = 2
    through: int = 4
    through_electrode: int = 1
    grading: float = 8.0
    grading_rim: float = 2.0
    grading_through: float = 2.0
    films: bool = False
    order = 1  # all edges are straight

    def __post_init__(self) -> None:
        self.device(1)  # checks what both share
        _check.count("HelicalCell", "through", self.through, least=1 if self.electrode > 0 else 2)
        _check.ratio("HelicalCell", "grading_rim", self.grading_rim)
        if not isinstance(self.films, bool):
            raise InputError(
                f"HelicalCell: films is {shown(self.films)}; it must be True or False."
            )
        if self.films and self.electrode == 0:
            raise InputError(
                "HelicalCell: films need electrodes with a thickness; give electrode > 0, or leave "
                "films out."
            )

    @property
    def dimension(self) -> int:
        """Of space: 2, for r and zeta."""
        return 2

    @property
    def pitch(self) -> float:
        """Height of the cell and rise per turn, 2 (elastomer + electrode), in metres."""
        return 2 * (self.elastomer + self.electrode)

    @property
    def film_spans(self) -> dict[str, tuple[float, float]]:
        """Height in metres of each film's face on electrode b and on electrode a."""
        b, a = self.electrode / 2, self.electrode / 2 + self.elastomer
        return {"film_below": (b, a), "film_above": (self.pitch - b, self.pitch - a)}

    def device(self, turns: int) -> HDEA:
        """The three-dimensional device of this cross-section."""
        return HDEA(
            self.outer_radius, self.inner_radius, self.inset, self.elastomer, self.electrode, turns,
            radial=self.radial, rim=self.rim, through=self.through,
            through_electrode=self.through_electrode, grading=self.grading,
            grading_through=self.grading_through,
        )  # fmt: skip

    def measures(self) -> dict[str, float]:
        """Exact area (m^2) or length (m) of every group, in the plane of (r, zeta)."""
        ring = self.outer_radius - self.inner_radius
        width = ring - 2 * self.inset
        found = {"elastomer": ring * self.pitch - 2 * width * self.electrode}
        if self.films:
            found |= dict.fromkeys(self.film_spans, width * self.elastomer)
            found["elastomer"] -= 2 * width * self.elastomer
        faces = 2 if self.electrode > 0 else 1
        for e in ("electrode_a", "electrode_b"):
            found |= {
                e: width * self.electrode,
                f"{e}_active": faces * width,
                f"{e}_rim": 2 * self.electrode if self.inset > 0 else 0.0,
            }
        found |= {"bottom": ring, "top": ring, "inner": self.pitch, "outer": self.pitch}
        return {name: value for name, value in found.items() if value > 0}

    def refine(self, factor: int) -> HelicalCell:
        """The same cell with all divisions multiplied by ``factor``."""
        k = _check.count("HelicalCell.refine", "factor", factor)
        names = ("radial", "rim", "through", "through_electrode")
        return replace(self, **{name: k * getattr(self, name) for name in names})

    def _radii(self) -> tuple[Floats, int, int]:
        """Cell ends in r, and the first electrode column and the first one beyond."""
        r1, r2 = self.inner_radius + self.inset, self.outer_radius - self.inset
        middle = r1 + (r2 - r1) * graded(self.radial, self.grading)
        if self.inset == 0:
            return middle, 0, self.radial
        inner = self.inner_radius + self.inset * graded(self.rim, self.grading_rim, "end")
        outer = r2 + self.inset * graded(self.rim, self.grading_rim, "start")
        return joined_ends(inner, middle, outer), self.rim, self.rim + self.radial

    def _layers(self) -> tuple[Floats, Ints]:
        """Cell ends in zeta, and the first row of each layer (and the row above the last)."""
        soft = self.elastomer * graded(self.through, self.grading_through)
        if self.electrode > 0:
            hard = np.linspace(0.0, self.electrode, self.through_electrode + 1)
            half = np.linspace(0.0, self.electrode / 2, (self.through_electrode + 1) // 2 + 1)
            pieces = [half, soft, hard, soft, half]
        else:
            cells = (self.through + 1) // 2
            lower, upper = (
                self.elastomer / 2 * graded(cells, self.grading_through, end)
                for end in ("end", "start")
            )
            pieces = [lower, soft, upper]
        starts = np.cumsum([0.0] + [piece[-1] for piece in pieces[:-1]])
        ends = joined_ends(*(a + piece for a, piece in zip(starts, pieces, strict=True)))
        return ends, np.cumsum([0] + [len(piece) - 1 for piece in pieces])

    def mesh(self) -> StructuredMesh:
        """Nodes, cells and named parts as plain arrays."""
        radii, first, beyond = self._radii()
        ends, rows = self._layers()
        (column, row), (kr, kz) = block((len(radii) - 1, len(ends) - 1), 1)
        r, z = lattice_points(radii, 1), lattice_points(ends, 1)
        cells, used = compact(kr * len(z) + kz)
        kr, kz = np.divmod(used, len(z))
        mesh = StructuredMesh(np.column_stack([r[kr], z[kz], np.zeros(len(used))]), cells)

        under = (column >= first) & (column < beyond)
        if self.electrode > 0:
            a = under & (row >= rows[2]) & (row < rows[3])
            b = under & ((row < rows[1]) | (row >= rows[4]))
            films = {}
            if self.films:
                films = {"film_below": under & (row >= rows[1]) & (row < rows[2]),
                         "film_above": under & (row >= rows[3]) & (row < rows[4])}  # fmt: skip
            rest = ~(a | b | np.logical_or.reduce([*films.values(), np.zeros_like(a)]))
            for name, cells in films.items():
                mesh.add_region(name, cells)
            if np.any(rest):
                mesh.add_region("elastomer", rest)
            mesh.add_region("electrode_a", a)
            mesh.add_region("electrode_b", b)
            mesh.add_facets("electrode_b_active", b & (row == rows[1] - 1), 1, 1)
            mesh.add_facets("electrode_a_active", a & (row == rows[2]), 1, 0)
            mesh.add_facets("electrode_a_active", a & (row == rows[3] - 1), 1, 1)
            mesh.add_facets("electrode_b_active", b & (row == rows[4]), 1, 0)
            if self.inset > 0:
                for name, part in (("electrode_a_rim", a), ("electrode_b_rim", b)):
                    mesh.add_facets(name, part & (column == first), 0, 0)
                    mesh.add_facets(name, part & (column == beyond - 1), 0, 1)
        else:
            mesh.add_region("elastomer", np.ones(len(row), dtype=bool))
            mesh.add_facets("electrode_a_active", under & (row == rows[1] - 1), 1, 1)
            mesh.add_facets("electrode_b_active", under & (row == rows[2] - 1), 1, 1)
        mesh.add_facets("bottom", row == 0, 1, 0)
        mesh.add_facets("top", row == rows[-1] - 1, 1, 1)
        mesh.add_facets("inner", column == 0, 0, 0)
        mesh.add_facets("outer", column == len(radii) - 2, 0, 1)
        return mesh


def main(arguments: list[str] | None = None) -> int:
    """``python -m dea_fenicsx.geometry.helical_cell``: write a .msh, print its measures."""
    from ._cli import parameter_parser, run

    parser = parameter_parser(
        "dea_fenicsx.geometry.helical_cell",
        "Mesh of one pitch of a helical actuator's cross-section.",
        HelicalCell,
        {
            "outer_radius": "outer radius in m",
            "inner_radius": "inner radius in m",
            "inset": "distance of the electrodes from both cylinders in m",
            "elastomer": "thickness of an elastomer layer in m",
            "electrode": "thickness of an electrode in m; 0 for ideal surfaces",
            "radial": "cells over the electrode's width",
            "rim": "cells over each rim",
            "through": "cells through each elastomer layer",
            "through_electrode": "cells through each electrode",
            "grading": "largest over smallest cell over the electrode's width",
            "grading_rim": "largest over smallest cell over each rim",
            "grading_through": "largest over smallest cell through an elastomer layer",
        },
    )
    return run(parser, HelicalCell, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
