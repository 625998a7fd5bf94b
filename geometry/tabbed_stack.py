"""Stack of films whose electrodes keep off the edges, and reach one side each by a tab."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si

from . import _check
from ._structured import Floats, Ints, StructuredMesh, joined_ends, lattice
from .base import FlatStack, Layer, checked_layers, refuse_clash, sizes_of_layers
from .grading import graded


@dataclass(frozen=True)
@in_si(length="m", margin="m", width="m", tab="m")
class TabbedStack(FlatStack):
    """Rectangular layers in z from z = 0, with an electrode between each layer and the next one.

    The electrodes are surfaces.  They belong in turn to ``electrode_a`` and ``electrode_b``, from
    the bottom up.  Each keeps a margin off all sides, where the layers are bonded to each other.
    A tab in the middle of the width leads through the margin: that of ``electrode_a`` to the side
    x = 0, that of ``electrode_b`` to the side x = length.  Tabs of one side are connected there.

    With ``width=None`` a flat strip: x along the length, y through the layers.  Its electrodes
    reach one end each, and keep the margin off the other one.

    Parameters
    ----------
    length
        Along x in metres, with both margins.
    layers
        From the bottom up, 3 or more.  The first and the last one are covers, since their outer
        faces carry no electrodes.
    margin
        In metres.
    width
        Along y in metres, with both margins; None for the strip.
    tab
        Width of a tab in metres, at most that of the electrode; in space only.
    divisions
        Cells along x in each margin and between the margins; and in space along y in each margin,
        on each side of the tab, and in the tab.
    order
        Degree of the cells' geometry, 1 or 2.

    Notes
    -----
    Volume groups: the layers' names.  Facet groups: ``electrode_a``, ``electrode_b``, ``bottom``,
    ``top``, ``x_min``, ``x_max``, and ``y_min``, ``y_max`` in space.

    Raises
    ------
    InputError
        A parameter is not usable.
    """

    length: float
    layers: Sequence[Layer]
    margin: float
    width: float | None = None
    tab: float | None = None
    divisions: tuple[int, int, int, int, int] = (2, 6, 1, 1, 2)
    order: int = 2

    def __post_init__(self) -> None:
        owner = "TabbedStack"
        for name in ("length", "margin"):
            _check.length(owner, name, getattr(self, name))
        layers = checked_layers(owner, self.layers)
        object.__setattr__(self, "layers", layers)
        if len(layers) < 3:
            raise InputError(
                f"{owner}: there are {len(layers)} layers; two electrodes need 3 or more."
            )
        if not isinstance(self.divisions, tuple | list) or len(self.divisions) != 5:
            raise InputError(
                f"{owner}: divisions is {shown(self.divisions)}; it must hold 5 numbers: cells "
                "along x in a margin and between, along y in a margin, beside the tab, in it."
            )
        for count in self.divisions:
            _check.count(owner, "divisions", count)
        object.__setattr__(self, "divisions", tuple(self.divisions))
        _check.order(owner, self.order)
        self._check_room()
        names = {layer.name for layer in layers}
        refuse_clash(owner, names, set(self._areas()))

    def _check_room(self) -> None:
        """Electrodes must be left between the margins, and a tab be narrower than they are."""
        owner, margins = "TabbedStack", 2 * self.margin
        if margins >= self.length:
            raise InputError(
                f"{owner}: margin is {self.margin:g} m; twice that must be less than the length of "
                f"{self.length:g} m."
            )
        if self.width is None:
            if self.tab is not None:
                raise InputError(f"{owner}: tab is {shown(self.tab)}; a strip has none, give None.")
            return
        _check.length(owner, "width", self.width)
        _check.length(owner, "tab", self.tab)
        if margins >= self.width:
            raise InputError(
                f"{owner}: margin is {self.margin:g} m; twice that must be less than the width of "
                f"{self.width:g} m."
            )
        assert self.tab is not None
        if self.tab > (self.width - margins) * (1 + 1e-12):
            raise InputError(
                f"{owner}: tab is {self.tab:g} m; it must be at most the width of the electrode, "
                f"{self.width - margins:g} m."
            )

    @property
    def active_area(self) -> float:
        """Area in m^2 in which two electrodes face each other; of the strip, a length in m."""
        across = 1.0 if self.width is None else self.width - 2 * self.margin
        return (self.length - 2 * self.margin) * across

    def _areas(self) -> dict[str, float]:
        """Area (length) of every facet group."""
        width = 1.0 if self.width is None else self.width
        tab = 1.0 if self.tab is None else self.tab
        one, count = self.active_area + self.margin * tab, len(self.layers) - 1
        found = {"electrode_a": (count + 1) // 2 * one, "electrode_b": count // 2 * one}
        found |= dict.fromkeys(("bottom", "top"), self.length * width)
        found |= dict.fromkeys(("x_min", "x_max"), width * self.height)
        if self.width is not None:
            found |= dict.fromkeys(("y_min", "y_max"), self.length * self.height)
        return found

    def measures(self) -> dict[str, float]:
        """Exact volume (area) of every layer name and area (length) of every facet group."""
        base = self.length * (1.0 if self.width is None else self.width)
        return sizes_of_layers(self.layers, base) | self._areas()

    def refine(self, factor: int) -> TabbedStack:
        """The same stack with all divisions multiplied by ``factor``."""
        k = _check.count("TabbedStack.refine", "factor", factor)
        layers = tuple(replace(layer, divisions=k * layer.divisions) for layer in self.layers)
        one, two, three, four, five = (k * n for n in self.divisions)
        return replace(self, layers=layers, divisions=(one, two, three, four, five))

    def _pieces(self) -> list[tuple[list[float], list[int]]]:
        """Along x, and along y in space: lengths of the pieces, and the cells in each."""
        edge, active, edge_y, beside, in_tab = self.divisions
        x = [self.margin, self.length - 2 * self.margin, self.margin]
        found = [(x, [edge, active, edge])]
        if self.width is not None:
            assert self.tab is not None
            rest = (self.width - 2 * self.margin - self.tab) / 2
            rest = 0.0 if rest < 1e-12 * self.width else rest
            y = [self.margin, rest, self.tab, rest, self.margin]
            found.append((y, [edge_y, beside, in_tab, beside, edge_y]))
        return found

    def mesh(self) -> StructuredMesh:
        """Nodes, cells and named parts as plain arrays."""
        lines, kinds = [], []
        for sizes, counts in self._pieces():
            line, kind = _divided(sizes, counts)
            lines.append(line)
            kinds.append(kind)
        starts = np.cumsum([0.0, *(layer.thickness for layer in self.layers)])
        through = joined_ends(*(
            start + layer.thickness * graded(layer.divisions, layer.grading, layer.ends)
            for start, layer in zip(starts, self.layers, strict=False)
        ))  # fmt: skip
        mesh, cell = lattice([*lines, through], self.order)
        last = self.dimension - 1  # the direction through the layers
        for axis, letter in enumerate("xy"[:last]):
            mesh.add_facets(f"{letter}_min", cell[axis] == 0, axis, 0)
            mesh.add_facets(f"{letter}_max", cell[axis] == cell[axis].max(), axis, 1)
        bounds = np.cumsum([0, *(layer.divisions for layer in self.layers)])
        mesh.add_facets("bottom", cell[last] == 0, last, 0)
        mesh.add_facets("top", cell[last] == bounds[-1] - 1, last, 1)
        x = kinds[0][cell[0]]
        y = kinds[1][cell[1]] if last == 2 else np.full(len(x), 2)  # a strip is all tab
        for i, layer in enumerate(self.layers):
            mesh.add_region(layer.name, (cell[last] >= bounds[i]) & (cell[last] < bounds[i + 1]))
            if i:
                side = 2 * ((i + 1) % 2)  # the piece along x through which the tab leads
                covered = ((x == 1) & (y >= 1) & (y <= 3)) | ((x == side) & (y == 2))
                name = "electrode_a" if i % 2 else "electrode_b"
                mesh.add_facets(name, covered & (cell[last] == bounds[i] - 1), last, 1)
        return mesh


def _divided(sizes: Sequence[float], counts: Sequence[int]) -> tuple[Floats, Ints]:
    """Cell ends along pieces, and of each cell the number of its piece; pieces of no length go."""
    starts = np.cumsum([0.0, *sizes])
    there = [k for k, size in enumerate(sizes) if size > 0]
    ends = joined_ends(*(
        starts[k] + np.linspace(0.0, sizes[k], counts[k] + 1) for k in there
    ))  # fmt: skip
    return ends, np.repeat(there, [counts[k] for k in there])
