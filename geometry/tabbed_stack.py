"""Stack of films whose electrodes keep off the edges, and reach one side each by a tab."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si

from . import _check
from ._lattice import GroupBox, Lattice, between, side_boxes
from ._structured import Floats, joined_ends
from .base import (
    FlatStack,
    Layer,
    OfLattice,
    boxes_of_layers,
    checked_layers,
    ends_of_layers,
    refuse_clash,
    sizes_of_layers,
)


@dataclass(frozen=True)
@in_si(length="m", margin="m", width="m", tab="m")
class TabbedStack(FlatStack, OfLattice):
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

    def lattice(self) -> Lattice:
        """See `OfLattice.lattice`."""
        divided = [_divided(sizes, counts) for sizes, counts in self._pieces()]
        ends = [*(line for line, _ in divided), ends_of_layers(self.layers)]
        whole = tuple(range(len(e) - 1) for e in ends)
        last = len(ends) - 1  # the direction through the layers
        sides: list[GroupBox] = []
        for axis, letter in enumerate("xy"[:last]):
            sides += side_boxes(whole, axis, f"{letter}_min", f"{letter}_max")
        sides += side_boxes(whole, last, "bottom", "top")
        regions, interfaces = boxes_of_layers(self.layers, whole, last)
        x = divided[0][1]
        y = divided[1][1] if last == 2 else []
        film = (x[1], *([range(y[1].start, y[3].stop)] if y else []))
        electrodes = []
        for k, interface in enumerate(interfaces, 1):
            tab = (x[0] if k % 2 else x[2], *y[2:3])  # it leads through a margin
            # in the order of the cells along x
            for base in (tab, film) if k % 2 else (film, tab):
                name, cells = f"electrode_{'a' if k % 2 else 'b'}", (*base, interface.cells[last])
                electrodes.append(GroupBox(name, cells, interface.side))
        return between(ends, self.order, [*regions, *sides, *electrodes])


def _divided(sizes: Sequence[float], counts: Sequence[int]) -> tuple[Floats, list[range]]:
    """Cell ends along pieces, and the cells of each piece; pieces of no length have none."""
    starts = np.cumsum([0.0, *sizes])
    there = [count if size > 0 else 0 for size, count in zip(sizes, counts, strict=True)]
    ends = joined_ends(*(
        starts[k] + np.linspace(0.0, sizes[k], count + 1) for k, count in enumerate(there) if count
    ))  # fmt: skip
    bounds = [0, *accumulate(there)]
    return ends, [range(a, b) for a, b in pairwise(bounds)]
