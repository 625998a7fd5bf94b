"""Stack of layers with interdigitated electrodes on its upper face: unimorphs and bimorphs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si

from . import _check
from ._lattice import Lattice, between, side_boxes, within
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

SIDES = ("a", "b", "gap")


@dataclass(frozen=True)
@in_si(finger="m", gap="m", margin="m", width="m")
class FingerStack(FlatStack, OfLattice):
    """Rectangular layers in z from z = 0, with electrodes in fingers along y on the upper face.

    With ``width=None`` a flat strip: x along the length, y through the layers.  The fingers belong
    in turn to the electrodes ``top_a`` and ``top_b``.  A film on a passive layer is a unimorph;
    with ``both=True`` the lower face has fingers too, as of a bimorph.

    Parameters
    ----------
    layers
        From the bottom up.
    fingers
        Number of fingers, 2 or more.
    finger, gap, margin
        In metres along x: the width of a finger, the distance between two, and the distance of the
        first and the last one from the ends, which may be 0.
    width
        Along y in metres; None for the strip.
    both
        Whether the lower face has fingers: ``bottom_a``, ``bottom_b`` and ``bottom_gap``.
    divisions
        Cells along x in each finger, in each gap and in each margin, and along y.
    order
        Degree of the cells' geometry, 1 or 2.

    Notes
    -----
    Volume groups: the layers' names.  Facet groups: ``top_a``, ``top_b``, ``top_gap`` with the
    margins, ``bottom`` or its three parts, ``x_min``, ``x_max``, ``y_min``, ``y_max`` (the last two
    in space only), and ``interface_1``, ... between layers 1 and 2, ...

    Raises
    ------
    InputError
        A parameter is not usable.
    """

    layers: Sequence[Layer]
    fingers: int
    finger: float
    gap: float
    margin: float = 0.0
    width: float | None = None
    both: bool = False
    divisions: tuple[int, int, int, int] = (2, 2, 1, 1)
    order: int = 2

    def __post_init__(self) -> None:
        owner = "FingerStack"
        object.__setattr__(self, "layers", checked_layers(owner, self.layers))
        _check.count(owner, "fingers", self.fingers, least=2)
        for name in ("finger", "gap"):
            _check.length(owner, name, getattr(self, name))
        _check.length(owner, "margin", self.margin, zero=True)
        if self.width is not None:
            _check.length(owner, "width", self.width)
        if not isinstance(self.both, bool):
            raise InputError(f"{owner}: both is {shown(self.both)}; it must be True or False.")
        if not isinstance(self.divisions, tuple | list) or len(self.divisions) != 4:
            raise InputError(
                f"{owner}: divisions is {shown(self.divisions)}; it must hold 4 numbers: cells in "
                "each finger, gap and margin, and along y."
            )
        for count in self.divisions:
            _check.count(owner, "divisions", count)
        object.__setattr__(self, "divisions", tuple(self.divisions))
        _check.order(owner, self.order)
        refuse_clash(owner, {layer.name for layer in self.layers}, set(self._areas()))

    @property
    def length(self) -> float:
        """Length along x in metres."""
        return self.fingers * self.finger + (self.fingers - 1) * self.gap + 2 * self.margin

    def _areas(self) -> dict[str, float]:
        """Area (length) of every facet group."""
        width = 1.0 if self.width is None else self.width
        even = (self.fingers + 1) // 2
        a, b = even * self.finger * width, (self.fingers - even) * self.finger * width
        parts = {"a": a, "b": b, "gap": self.length * width - a - b}
        found = {f"top_{side}": parts[side] for side in SIDES}
        if self.both:
            found |= {f"bottom_{side}": parts[side] for side in SIDES}
        else:
            found["bottom"] = self.length * width
        found |= dict.fromkeys(("x_min", "x_max"), width * self.height)
        if self.width is not None:
            found |= dict.fromkeys(("y_min", "y_max"), self.length * self.height)
        between = (f"interface_{i}" for i in range(1, len(self.layers)))
        return found | dict.fromkeys(between, self.length * width)

    def measures(self) -> dict[str, float]:
        """Exact volume (area) of every layer name and area (length) of every facet group."""
        base = self.length * (1.0 if self.width is None else self.width)
        return sizes_of_layers(self.layers, base) | self._areas()

    def refine(self, factor: int) -> FingerStack:
        """The same stack with all divisions multiplied by ``factor``."""
        k = _check.count("FingerStack.refine", "factor", factor)
        layers = tuple(replace(layer, divisions=k * layer.divisions) for layer in self.layers)
        one, two, three, four = (k * n for n in self.divisions)
        return replace(self, layers=layers, divisions=(one, two, three, four))

    def _along(self) -> tuple[Floats, list[tuple[str, range]]]:
        """Cell ends along x, and the cells of each finger, gap and margin with its side."""
        in_finger, in_gap, in_margin, _ = self.divisions
        pieces: list[tuple[float, int, str]] = [(self.margin, in_margin, "gap")]
        for k in range(self.fingers):
            pieces += [(self.finger, in_finger, SIDES[k % 2]), (self.gap, in_gap, "gap")]
        pieces[-1] = (self.margin, in_margin, "gap")
        pieces = [piece for piece in pieces if piece[0] > 0]
        starts = np.cumsum([0.0, *(size for size, _, _ in pieces)])
        ends = joined_ends(*(
            start + np.linspace(0.0, size, count + 1)
            for start, (size, count, _) in zip(starts, pieces, strict=False)
        ))  # fmt: skip
        bounds = [0, *accumulate(count for _, count, _ in pieces)]
        cells = [range(a, b) for a, b in pairwise(bounds)]
        return ends, [(side, r) for (_, _, side), r in zip(pieces, cells, strict=True)]

    def lattice(self) -> Lattice:
        """See `OfLattice.lattice`."""
        along, pieces = self._along()
        ends = [along, ends_of_layers(self.layers)]
        if self.width is not None:
            ends.insert(1, np.linspace(0.0, self.width, self.divisions[3] + 1))
        whole = tuple(range(len(e) - 1) for e in ends)
        last = len(ends) - 1  # the direction through the layers
        regions, interfaces = boxes_of_layers(self.layers, whole, last)
        found = regions
        for axis, letter in enumerate("xy"[:last]):
            found += side_boxes(whole, axis, f"{letter}_min", f"{letter}_max")
        for side in SIDES:
            for name, cells in pieces:
                if name == side:
                    here = within(whole, 0, cells)
                    bottom, top = side_boxes(here, last, f"bottom_{side}", f"top_{side}")
                    found += [top, bottom] if self.both else [top]
        if not self.both:
            found += side_boxes(whole, last, "bottom", "top")[:1]
        return between(ends, self.order, [*found, *interfaces])
