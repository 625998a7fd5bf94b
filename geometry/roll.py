"""A film that is wound up in a spiral: a section across the roll, or the whole roll in space."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.support.units import in_si

from . import _check
from ._structured import (
    Floats,
    Ints,
    StructuredMesh,
    block,
    compact,
    joined_ends,
    lattice_points,
    sweep,
)
from .base import Geometry, Layer, checked_layers, refuse_clash
from .grading import graded


@dataclass(frozen=True)
@in_si(inner="m", height="m")
class Roll(Geometry):
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

    def _section(self) -> tuple[Floats, Ints, tuple[Ints, Ints]]:
        """Nodes in x and y, the cells' nodes, and of each cell its place through and along."""
        starts = np.cumsum([0.0, *(layer.thickness for layer in self.layers)])
        ends = joined_ends(*(
            start + layer.thickness * graded(layer.divisions, layer.grading, layer.ends)
            for start, layer in zip(starts, self.layers, strict=False)
        ))  # fmt: skip
        through = lattice_points(ends, self.order)
        cell, node = block((len(ends) - 1, self.angular * self.turns), self.order)
        last, around = len(through) - 1, self.order * self.angular
        # the outer face of a turn is the inner one of the next
        joined = (node[0] == last) & (node[1] < around * (self.turns - 1) + 1)
        i, j = np.where(joined, 0, node[0]), np.where(joined, node[1] + around, node[1])
        keys = i * (around * self.turns + 1) + j
        cells, used = compact(keys)
        i, j = np.divmod(used, around * self.turns + 1)
        r = self.inner + self.pitch * j / around + through[i]
        angle = 2 * math.pi * (j % around) / around
        return np.column_stack([r * np.cos(angle), r * np.sin(angle)]), cells, (cell[0], cell[1])

    def mesh(self) -> StructuredMesh:
        """Nodes, cells and named parts as plain arrays."""
        plane, cells, (i, j) = self._section()
        if self.height is None:
            mesh = StructuredMesh(np.column_stack([plane, 0 * plane[:, 0]]), cells)
        else:
            mesh, i, j = self._raised(plane, cells, i, j)
        first, last = j < self.angular, j >= self.angular * (self.turns - 1)
        bounds = np.cumsum([0, *(layer.divisions for layer in self.layers)])
        for k, layer in enumerate(self.layers):
            mesh.add_region(layer.name, (i >= bounds[k]) & (i < bounds[k + 1]))
        outside = i == bounds[-1] - 1
        mesh.add_facets("inner", (i == 0) & first, 0, 0)
        mesh.add_facets("outer", outside & last, 0, 1)
        mesh.add_facets("winding", outside & ~last, 0, 1)
        mesh.add_facets("start", j == 0, 1, 0)
        mesh.add_facets("end", j == j.max(), 1, 1)
        for k in range(1, len(self.layers)):
            mesh.add_facets(f"interface_{k}", i == bounds[k] - 1, 0, 1)
        return mesh

    def _raised(
        self, plane: Floats, cells: Ints, i: Ints, j: Ints
    ) -> tuple[StructuredMesh, Ints, Ints]:
        """The section along z, with the places of its cells and the faces at both ends."""
        assert self.height is not None
        z = lattice_points(np.linspace(0.0, self.height, self.axial + 1), self.order)
        solid, base, level = sweep(cells, self.axial, self.order)
        points = np.column_stack([np.repeat(plane, len(z), axis=0), np.tile(z, len(plane))])
        mesh = StructuredMesh(points, solid)
        mesh.add_facets("bottom", level == 0, 2, 0)
        mesh.add_facets("top", level == self.axial - 1, 2, 1)
        return mesh, i[base], j[base]
