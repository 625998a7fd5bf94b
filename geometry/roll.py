"""A film that is wound up in a spiral: a section across the roll, or the whole roll in space."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.support.units import in_si

from . import _check
from ._lattice import FlatLattice, GroupBox, Lattice, side_boxes
from ._polar import circle
from ._structured import Floats, Ints, lattice_points, nodes_of_cells
from .base import Layer, OfLattice, boxes_of_layers, checked_layers, ends_of_layers, refuse_clash


@dataclass(frozen=True)
@in_si(inner="m", height="m")
class Roll(OfLattice):
    """A film of one or more layers, wound around the z axis without a gap, each turn on the last.

    The inner face of the film has the radius ``inner + pitch * angle / (2 pi)``, where the pitch
    is the thickness of the film.  The outer face of each turn is the inner face of the next one,
    and both are bonded there.  An electrode on it is named ``"winding"``; the other one lies
    between two layers of the film, on ``"interface_1"``.

    Parameters
    ----------
    inner
        Inner radius in metres where the winding starts.
    turns
        Number of turns, 2 or more.
    layers
        Of the film, from the inside out.
    height
        Length along z in metres; None for the section in x and y.
    angular
        Cells around each turn.
    axial
        Cells along z.
    order
        Degree of the cells' geometry, 1 or 2.

    Notes
    -----
    Volume groups: the layers' names.  Facet groups: ``winding``, ``inner`` (the inner face of the
    first turn), ``outer`` (the outer face of the last one), ``start`` and ``end`` of the film,
    ``interface_1``, ... between layers 1 and 2, ..., and ``bottom`` and ``top`` in space.

    Raises
    ------
    InputError
        A parameter is not usable.
    """

    inner: float
    turns: int
    layers: Sequence[Layer]
    height: float | None = None
    angular: int = 16
    axial: int = 4
    order: int = 2

    def __post_init__(self) -> None:
        _check.length("Roll", "inner", self.inner)
        _check.count("Roll", "turns", self.turns, least=2)
        object.__setattr__(self, "layers", checked_layers("Roll", self.layers))
        if self.height is not None:
            _check.length("Roll", "height", self.height)
        _check.count("Roll", "angular", self.angular, least=4)
        _check.count("Roll", "axial", self.axial)
        _check.order("Roll", self.order)
        ends = set() if self.height is None else {"bottom", "top"}
        names = {layer.name for layer in self.layers}
        refuse_clash("Roll", names, ends | set(self._facet_areas()))

    @property
    def dimension(self) -> int:
        """3, or 2 for the section."""
        return 2 if self.height is None else 3

    @property
    def pitch(self) -> float:
        """Thickness of the film in metres, by which the radius grows in each turn."""
        return sum(layer.thickness for layer in self.layers)

    def _area(self, low: float, high: float) -> float:
        """Area in the section between two spirals, by their radii where they start."""
        grown = self.pitch * self.turns / 2  # the mean radius of a spiral over that at its start
        return 2 * math.pi * self.turns * (high - low) * ((low + high) / 2 + grown)

    def _length(self, radius: float, turns: int) -> float:
        """Length in m of a spiral that starts at a radius."""
        c = self.pitch / (2 * math.pi)

        def primitive(r: float) -> float:
            return (r * math.hypot(r, c) + c**2 * math.asinh(r / c)) / (2 * c)

        return primitive(radius + turns * self.pitch) - primitive(radius)

    def _facet_areas(self) -> dict[str, float]:
        """Area (length) of every facet group but the ends of the roll."""
        high = 1.0 if self.height is None else self.height
        last = self.inner + self.turns * self.pitch
        found = {
            "inner": high * self._length(self.inner, 1),
            "outer": high * self._length(last, 1),
            "winding": high * self._length(self.inner + self.pitch, self.turns - 1),
        } | dict.fromkeys(("start", "end"), high * self.pitch)
        faces = self.inner + np.cumsum([layer.thickness for layer in self.layers[:-1]])
        for k, radius in enumerate(faces, 1):
            found[f"interface_{k}"] = high * self._length(float(radius), self.turns)
        return found

    def measures(self) -> dict[str, float]:
        """Exact volume (area) of every layer name and area (length) of every facet group."""
        high = 1.0 if self.height is None else self.height
        found: dict[str, float] = {}
        radius = self.inner
        for layer in self.layers:
            area = self._area(radius, radius + layer.thickness)
            found[layer.name] = found.get(layer.name, 0.0) + high * area
            radius += layer.thickness
        if self.height is not None:
            whole = self._area(self.inner, self.inner + self.pitch)
            found |= dict.fromkeys(("bottom", "top"), whole)
        return found | self._facet_areas()

    def refine(self, factor: int) -> Roll:
        """The same roll with all divisions multiplied by ``factor``."""
        k = _check.count("Roll.refine", "factor", factor)
        layers = tuple(replace(layer, divisions=k * layer.divisions) for layer in self.layers)
        return replace(self, layers=layers, angular=k * self.angular, axial=k * self.axial)

    def lattice(self) -> Lattice:
        """See `OfLattice.lattice`."""
        plane = self._plane()
        if self.height is None:
            return plane.unswept(self.order, self._boxes())
        heights = np.linspace(0.0, self.height, self.axial + 1)
        return plane.swept(heights, self.order, self._boxes())

    def _plane(self) -> FlatLattice:
        """The quadrilaterals of the section, through the film and along it."""
        ends = ends_of_layers(self.layers)
        through, around = lattice_points(ends, self.order), self.order * self.angular
        last, along = len(through) - 1, around * self.turns + 1
        shared = around * (self.turns - 1) + 1  # nodes outside that the next turn has inside
        directions = circle(around)

        def cells(cell: Sequence[Ints]) -> Ints:
            i, j = nodes_of_cells(cell, self.order)
            joined = (i == last) & (j < shared)
            i, j = np.where(joined, 0, i), np.where(joined, j + around, j)
            return i * along + j - np.where(i == last, shared, 0)

        def places(number: Ints) -> Floats:
            i, j = np.divmod(number + np.where(number < last * along, 0, shared), along)
            r = self.inner + self.pitch * j / around + through[i]
            return r[:, None] * directions[j % around]

        counts = len(ends) - 1, self.angular * self.turns
        return FlatLattice(counts, len(through) * along - shared, cells, places)

    def _boxes(self) -> list[GroupBox]:
        """The groups by the logical indices of cells: through the film, along it, along z."""
        others = [] if self.height is None else [range(self.axial)]
        film = range(sum(layer.divisions for layer in self.layers))
        last = self.angular * (self.turns - 1)
        along = range(last + self.angular)
        whole = (film, along, *others)
        regions, interfaces = boxes_of_layers(self.layers, whole, 0)
        faces = [
            GroupBox("inner", (film[:1], along[: self.angular], *others), (0, 0)),
            GroupBox("outer", (film[-1:], along[last:], *others), (0, 1)),
            GroupBox("winding", (film[-1:], along[:last], *others), (0, 1)),
        ]
        ends = side_boxes(whole, 2, "bottom", "top") if others else []
        return [*regions, *ends, *faces, *side_boxes(whole, 1, "start", "end"), *interfaces]
