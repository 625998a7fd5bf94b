"""A flat round membrane with an electrode in its middle: a section, or the whole disc."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si

from . import _check
from ._lattice import GroupBox, Lattice, between
from ._polar import o_grid
from ._structured import Floats, joined_ends
from .base import OfLattice
from .grading import graded


@dataclass(frozen=True)
@in_si(radius="m", electrode_radius="m", thickness="m", taper="m")
class MembraneDisc(OfLattice):
    """A disc of one layer over 0 <= z <= thickness; the electrode covers its middle.

    Parameters
    ----------
    radius
        Of the disc in metres, undeformed.
    electrode_radius
        Radius in metres up to which the electrode has its full potential.
    thickness
        In metres.  With the middle plane as the ground, half of the membrane's thickness.
    taper
        Width in metres of a ring around the electrode that has names of its own; 0 for none.
    cells
        Cells along the radius: over the electrode, over the ring, over the rest.
    layers
        Cells through the thickness.
    grading
        Largest over smallest cell along the radius; the small ones lie at the electrode's edge.
    angular
        Cells around; 0 for the section in the (r, z) plane, for `Axisymmetric`.
    order
        Degree of the cells' geometry, 1 or 2.

    Notes
    -----
    Volume groups: ``active``, ``edge`` (with a taper), ``passive``.  Facet groups: ``top_active``,
    ``top_edge``, ``top_passive``, ``bottom``, ``rim``, and of the section ``axis``.

    Raises
    ------
    InputError
        A parameter is not usable.
    """

    radius: float
    electrode_radius: float
    thickness: float
    taper: float = 0.0
    cells: tuple[int, int, int] = (6, 4, 6)
    layers: int = 1
    grading: float = 8.0
    angular: int = 0
    order: int = 2

    def __post_init__(self) -> None:
        owner = "MembraneDisc"
        for name in ("radius", "electrode_radius", "thickness"):
            _check.length(owner, name, getattr(self, name))
        _check.length(owner, "taper", self.taper, zero=True)
        if self.electrode_radius + self.taper >= self.radius:
            raise InputError(
                f"{owner}: the electrode reaches r = {self.electrode_radius + self.taper:g} m, but "
                f"must end before the rim at {self.radius:g} m."
            )
        if not isinstance(self.cells, tuple | list) or len(self.cells) != 3:
            raise InputError(
                f"{owner}: cells is {shown(self.cells)}; it must hold 3 numbers: over the "
                "electrode, its ring, and the rest."
            )
        object.__setattr__(self, "cells", tuple(self.cells))
        for n in self.cells:
            _check.count(owner, "cells", n)
        _check.count(owner, "layers", self.layers)
        _check.ratio(owner, "grading", self.grading)
        _check.count(owner, "angular", self.angular, least=0)
        if self.angular % 4:
            raise InputError(
                f"{owner}: angular is {self.angular}; it must be a multiple of 4, or 0 for the "
                "section."
            )
        _check.order(owner, self.order)

    @property
    def dimension(self) -> int:
        """3, or 2 for the section."""
        return 3 if self.angular else 2

    @property
    def _edges(self) -> dict[str, float]:
        """Outer radius of each region, from the middle."""
        end = self.electrode_radius + self.taper
        ring = {"edge": end} if self.taper else {}
        return {"active": self.electrode_radius, **ring, "passive": self.radius}

    def measures(self) -> dict[str, float]:
        """Exact volume of every region and area of every facet group; areas, lengths in 2-D."""
        found: dict[str, float] = {}
        inner = 0.0
        solid = bool(self.angular)
        for name, outer in self._edges.items():
            area = math.pi * (outer**2 - inner**2) if solid else outer - inner
            found[name] = area * self.thickness
            found[f"top_{name}"] = area
            inner = outer
        found["bottom"] = math.pi * self.radius**2 if solid else self.radius
        found["rim"] = (2 * math.pi * self.radius if solid else 1.0) * self.thickness
        if not solid:
            found["axis"] = self.thickness
        return found

    def refine(self, factor: int) -> MembraneDisc:
        """The same disc with all divisions multiplied by ``factor``."""
        k = _check.count("MembraneDisc.refine", "factor", factor)
        return replace(
            self,
            cells=tuple(k * n for n in self.cells),  # type: ignore[arg-type]
            layers=k * self.layers,
            angular=k * self.angular,
        )

    def _outside(self) -> Floats:
        """Cell ends from the electrode's edge to the rim, in metres behind the edge."""
        _, over, rest = self.cells
        pieces = []
        if self.taper:
            pieces.append(self.taper * graded(over, 1.0, "none"))
        room = self.radius - self.electrode_radius - self.taper
        pieces.append(self.taper + room * graded(rest, self.grading, "start"))
        return joined_ends(*pieces)

    def lattice(self) -> Lattice:
        """See `OfLattice.lattice`."""
        a, through = self.electrode_radius, self.thickness * graded(self.layers, 1.0, "none")
        inside, outside = graded(self.cells[0], self.grading, "end"), self._outside()
        if not self.angular:
            radial = joined_ends(a * inside, a + outside)
            return between([radial, through], self.order, self._boxes())
        ends = joined_ends(inside, 1.0 + outside)
        plane = o_grid(ends, self.cells[0], a, self.angular, self.order)
        return plane.swept(through, self.order, self._boxes())

    def _boxes(self) -> list[GroupBox]:
        """The groups by the indices of cells in the plane or section and through the thickness."""
        around, core = max(self.angular, 1), (self.angular // 4) ** 2
        active, over, rest = self.cells
        last = active + (over if self.taper else 0) + rest
        disc, through = range(core + last * around), range(self.layers)
        across = 2 if self.angular else 1  # the direction through the thickness in a cell
        outer = GroupBox("rim", (disc[-around:], through), (0, 1))
        bottom = GroupBox("bottom", (disc, through[:1]), (across, 0))
        axis = GroupBox("axis", (disc[:1], through), (0, 0))
        found = [bottom, outer] if self.angular else [axis, outer, bottom]
        bounds = [0, *(core + k * around for k in (active, *([last - rest] if self.taper else [])))]
        for name, a, b in zip(self._edges, bounds, [*bounds[1:], len(disc)], strict=True):
            found.append(GroupBox(name, (disc[a:b], through)))
            found.append(GroupBox(f"top_{name}", (disc[a:b], through[-1:]), (across, 1)))
        return found
