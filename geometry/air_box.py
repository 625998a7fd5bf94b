"""A stack of rectangular layers in a box of air."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si

from . import _check
from ._lattice import name_boxes
from ._structured import Floats, StructuredMesh, joined_ends, lattice
from .base import Geometry, refuse_clash
from .box_stack import BoxStack
from .grading import graded


@dataclass(frozen=True)
@in_si(thickness="m")
class AirBox(Geometry):
    """A `BoxStack` in a box of air, whose material is `Air`.

    Parameters
    ----------
    stack
        The layers.
    thickness
        From the stack to the walls of the box in m.
    sides
        The sides of the stack beside which there is air, names of its facet groups; None for all.
        At a plane of symmetry, and at the axis of an axisymmetric section, there is none.
    divisions
        Cells from the stack to each wall.
    grading
        Largest over smallest of these cells; the small ones lie at the stack.
    region
        Name of the air.

    Notes
    -----
    Groups: those of the stack, the volume of the air, and ``walls``, the outside of the box where
    it is not beside the stack.  On a side without air there is also ``x_min_air`` and so on, the
    part of the plane of this side that bounds air.

    Raises
    ------
    InputError
        A parameter is not usable.
    """

    stack: BoxStack
    thickness: float
    sides: tuple[str, ...] | None = None
    divisions: int = 4
    grading: float = 4.0
    region: str = "air"

    def __post_init__(self) -> None:
        if not isinstance(self.stack, BoxStack):
            raise InputError(f"AirBox: stack is {shown(self.stack)}; it must be a BoxStack.")
        _check.length("AirBox", "thickness", self.thickness)
        all_sides = tuple(side for pair in self._pairs() for side in pair)
        sides = all_sides if self.sides is None else self.sides
        if isinstance(sides, str):
            sides = (sides,)
        if not isinstance(sides, tuple | list) or not set(sides) <= set(all_sides) or not sides:
            raise InputError(
                f"AirBox: sides is {shown(self.sides)}; it must hold names of sides of the stack: "
                f"{', '.join(all_sides)}."
            )
        object.__setattr__(self, "sides", tuple(side for side in all_sides if side in sides))
        _check.count("AirBox", "divisions", self.divisions)
        _check.ratio("AirBox", "grading", self.grading)
        _check.group_name("AirBox", "region", self.region)
        if self.region in {layer.name for layer in self.stack.layers}:
            raise InputError(
                f"AirBox: region is {self.region!r}, the name of a layer; call the air otherwise."
            )
        layers = {layer.name for layer in self.stack.layers}
        facets = set(self.stack.measures()) - layers
        facets |= {"walls", *(f"{side}_air" for side in all_sides)}
        refuse_clash("AirBox", layers | {self.region}, facets)

    def _pairs(self) -> list[tuple[str, str]]:
        """The two sides of the stack along each direction."""
        found = [("x_min", "x_max"), ("y_min", "y_max"), ("bottom", "top")]
        return found if self.stack.width is not None else [found[0], found[2]]

    @property
    def dimension(self) -> int:
        """3, or 2 for a strip."""
        return self.stack.dimension

    @property
    def order(self) -> int:
        """Degree of the cells' geometry."""
        return self.stack.order

    def measures(self) -> dict[str, float]:
        """Exact volume (area) of every region and area (length) of every facet group."""
        assert self.sides is not None
        stack, pairs = self.stack, self._pairs()
        sizes = [stack.length, *([] if stack.width is None else [stack.width]), stack.height]
        pads = [sum(side in self.sides for side in pair) * self.thickness for pair in pairs]
        outer = np.array(sizes) + np.array(pads)
        found = stack.measures()
        found[self.region] = float(np.prod(outer) - np.prod(sizes))
        walls = 0.0
        for axis, pair in enumerate(pairs):
            face = float(np.prod(np.delete(outer, axis)))
            own = float(np.prod(np.delete(np.array(sizes), axis)))
            for side in pair:
                if side in self.sides:
                    walls += face
                elif face > own:
                    found[f"{side}_air"] = face - own
        found["walls"] = walls
        return found

    def refine(self, factor: int) -> AirBox:
        """The same box with all divisions multiplied by ``factor``."""
        k = _check.count("AirBox.refine", "factor", factor)
        return replace(self, stack=self.stack.refine(k), divisions=k * self.divisions)

    def mesh(self) -> StructuredMesh:
        """Nodes, cells and named parts as plain arrays."""
        assert self.sides is not None
        ends, pairs = self.stack.cell_ends(), self._pairs()
        counts = [len(along) - 1 for along in ends]
        padded = [self._padded(along, pair) for along, pair in zip(ends, pairs, strict=True)]
        mesh, found = lattice(padded, self.stack.order)
        first = [self.divisions * (pair[0] in self.sides) for pair in pairs]
        cell = [c - k for c, k in zip(found, first, strict=True)]
        name_boxes(mesh, cell, self.stack.boxes())
        inside = np.all([(c >= 0) & (c < n) for c, n in zip(cell, counts, strict=True)], axis=0)
        mesh.add_region(self.region, ~inside)
        for axis, pair in enumerate(pairs):
            for end, side in enumerate(pair):
                beyond = found[axis] == (len(padded[axis]) - 2 if end else 0)
                name = "walls" if side in self.sides else f"{side}_air"
                mesh.add_facets(name, ~inside & beyond, axis, end)
        return mesh

    def _padded(self, along: Floats, pair: tuple[str, str]) -> Floats:
        """Ends of cells along one direction, those of the air included."""
        assert self.sides is not None
        t, n, grading = self.thickness, self.divisions, self.grading
        pieces = [along]
        if pair[0] in self.sides:
            pieces.insert(0, along[0] - t + t * graded(n, grading, "end"))
        if pair[1] in self.sides:
            pieces.append(along[-1] + t * graded(n, grading, "start"))
        return joined_ends(*pieces)
