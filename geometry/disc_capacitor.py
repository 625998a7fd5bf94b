"""Two coaxial discs without thickness in a box of air, as an axisymmetric section."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si

from . import _check
from ._lattice import GroupBox, Lattice, between, side_boxes
from ._structured import joined_ends
from .base import OfLattice
from .grading import graded


@dataclass(frozen=True)
@in_si(radius="m", gap="m", box="m")
class DiscCapacitor(OfLattice):
    """Two equal discs that face each other, in a cylinder of air: the section (x = r, y = z).

    The middle of the gap is at z = 0.  Cells are small at the rims of the discs.

    Parameters
    ----------
    radius
        Of the discs, in metres.
    gap
        Distance of the discs in metres.
    box
        Radius of the box in metres; above and below the discs it ends at the same distance.
    divisions
        Cells along the radius of the discs, through the gap, and from the discs to the box.  A gap
        that is wider than the radius gets more, by 2 log10(gap/radius) times their number.
    grading
        Largest over smallest cell along the radius of the discs, and through the gap if that is
        wider than the radius; the air outside begins with cells as small as those.
    order
        Degree of the cells' geometry, 1 or 2.

    Notes
    -----
    Region: ``air``.  Facet groups: ``lower_disc``, ``upper_disc``, which lie inside; ``axis``, and
    ``side``, ``bottom``, ``top`` of the box.

    Raises
    ------
    InputError
        A parameter is not usable.
    """

    radius: float
    gap: float
    box: float
    divisions: tuple[int, int, int] = (12, 8, 20)
    grading: float = 100.0
    order: int = 1

    def __post_init__(self) -> None:
        for name in ("radius", "gap", "box"):
            _check.length("DiscCapacitor", name, getattr(self, name))
        if not isinstance(self.divisions, tuple | list) or len(self.divisions) != 3:
            raise InputError(
                f"DiscCapacitor: divisions is {shown(self.divisions)}; it must hold 3 numbers of "
                "cells: along the discs, through the gap, and outside."
            )
        for n in self.divisions:
            _check.count("DiscCapacitor", "divisions", n)
        object.__setattr__(self, "divisions", tuple(self.divisions))
        _check.ratio("DiscCapacitor", "grading", self.grading)
        _check.order("DiscCapacitor", self.order)
        if self.box <= max(self.radius, self.gap / 2):
            raise InputError(
                f"DiscCapacitor: box is {self.box:g} m; it must be larger than the radius "
                f"{self.radius:g} m of the discs and than half of the gap, {self.gap / 2:g} m."
            )

    @property
    def dimension(self) -> int:
        """2: it is a section."""
        return 2

    def measures(self) -> dict[str, float]:
        """Exact area of the region, and length of every facet group, in the section."""
        height = self.gap + 2 * self.box
        discs = dict.fromkeys(("lower_disc", "upper_disc"), self.radius)
        walls = dict.fromkeys(("bottom", "top"), self.box)
        sides = dict.fromkeys(("axis", "side"), height)
        return {"air": self.box * height, **discs, **walls, **sides}

    def refine(self, factor: int) -> DiscCapacitor:
        """The same with all divisions multiplied by ``factor``."""
        k = _check.count("DiscCapacitor.refine", "factor", factor)
        along, through, outside = self.divisions
        return replace(self, divisions=(k * along, k * through, k * outside))

    def lattice(self) -> Lattice:
        """See `OfLattice.lattice`."""
        along, through, outside = self.divisions
        through = int(np.ceil(through * (1 + 2 * np.log10(max(self.gap / self.radius, 1.0)))))
        disc = self.radius * graded(along, self.grading, "end")
        least = disc[-1] - disc[-2]
        wide = max(self.gap / self.radius, 1e-3)
        gap = self.gap * (graded(through, max(self.grading * wide, 1.0), "both") - 0.5)
        far = self.box - self.radius
        radial = joined_ends(disc, self.radius + far * _from_small(outside, least / far))
        above = self.gap / 2 + self.box * _from_small(outside, least / self.box)
        axial = joined_ends(-above[::-1], gap, above)
        whole = range(along + outside), range(2 * outside + through)
        faces = range(outside - 1, outside), range(outside + through - 1, outside + through)
        boxes = [
            GroupBox("air", whole),
            GroupBox("lower_disc", (range(along), faces[0]), (1, 1)),
            GroupBox("upper_disc", (range(along), faces[1]), (1, 1)),
            *side_boxes(whole, 0, "axis", "side"),
            *side_boxes(whole, 1, "bottom", "top"),
        ]
        return between([radial, axial], self.order, boxes)


def _from_small(n: int, least: float) -> np.ndarray:
    """Ends of n cells in [0, 1] that grow geometrically, the first about `least` long."""
    low, high = 1.0, 1e16
    for _ in range(200):
        ratio = (low * high) ** 0.5
        first = graded(n, ratio, "start")[1]
        low, high = (ratio, high) if first > least else (low, ratio)
    return graded(n, (low * high) ** 0.5, "start")


def main(arguments: list[str] | None = None) -> int:
    """``python -m dea_fenicsx.geometry.disc_capacitor``: write a .msh, print measures."""
    from ._cli import parameter_parser, run, values

    parser = parameter_parser(
        "dea_fenicsx.geometry.disc_capacitor",
        "Mesh of two coaxial discs in a box of air, an axisymmetric section.",
        DiscCapacitor,
        {
            "radius": "of the discs in m",
            "gap": "distance of the discs in m",
            "box": "radius of the box in m",
            "grading": "largest over smallest cell along the discs",
            "order": "degree of the cells' geometry, 1 or 2",
        },
    )
    parser.add_argument(
        "--divisions",
        type=values,
        default=(12, 8, 20),
        help="cells along the discs, through the gap and outside, as 12,8,20",
    )
    return run(parser, DiscCapacitor, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
