"""Stack of layers with interdigitated electrodes on its upper face: unimorphs and bimorphs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si

from . import _check
from ._structured import Ints, StructuredMesh, joined_ends, lattice
from .base import FlatStack, Layer, checked_layers, refuse_clash, sizes_of_layers
from .grading import graded

SIDES = ("a", "b", "gap")


@dataclass(frozen=True)
@in_si(finger="m", gap="m", margin="m", width="m")
class FingerStack(FlatStack):
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

    def _along(self) -> tuple[np.ndarray, Ints]:
        """Cell ends along x, and of each cell its side: 0 for a, 1 for b, 2 for a gap."""
        in_finger, in_gap, in_margin, _ = self.divisions
        pieces: list[tuple[float, int, int]] = [(self.margin, in_margin, 2)]
        for k in range(self.fingers):
            pieces += [(self.finger, in_finger, k % 2), (self.gap, in_gap, 2)]
        pieces[-1] = (self.margin, in_margin, 2)
        pieces = [piece for piece in pieces if piece[0] > 0]
        starts = np.cumsum([0.0, *(size for size, _, _ in pieces)])
        ends = joined_ends(*(
            start + np.linspace(0.0, size, count + 1)
            for start, (size, count, _) in zip(starts, pieces, strict=False)
        ))  # fmt: skip
        return ends, np.repeat([side for *_, side in pieces], [n for _, n, _ in pieces])

    def mesh(self) -> StructuredMesh:
        """Nodes, cells and named parts as plain arrays."""
        ends, sides = self._along()
        starts = np.cumsum([0.0, *(layer.thickness for layer in self.layers)])
        through = joined_ends(*(
            start + layer.thickness * graded(layer.divisions, layer.grading, layer.ends)
            for start, layer in zip(starts, self.layers, strict=False)
        ))  # fmt: skip
        across = [] if self.width is None else [
            np.linspace(0.0, self.width, self.divisions[3] + 1)
        ]  # fmt: skip
        mesh, cell = lattice([ends, *across, through], self.order)
        last = self.dimension - 1  # the direction through the layers
        bounds = np.cumsum([0, *(layer.divisions for layer in self.layers)])
        for i, layer in enumerate(self.layers):
            mesh.add_region(layer.name, (cell[last] >= bounds[i]) & (cell[last] < bounds[i + 1]))
        for axis, letter in enumerate("xy"[:last]):
            mesh.add_facets(f"{letter}_min", cell[axis] == 0, axis, 0)
            mesh.add_facets(f"{letter}_max", cell[axis] == cell[axis].max(), axis, 1)
        for k, side in enumerate(SIDES):
            here = sides[cell[0]] == k
            mesh.add_facets(f"top_{side}", here & (cell[last] == bounds[-1] - 1), last, 1)
            if self.both:
                mesh.add_facets(f"bottom_{side}", here & (cell[last] == 0), last, 0)
        if not self.both:
            mesh.add_facets("bottom", cell[last] == 0, last, 0)
        for i in range(1, len(self.layers)):
            mesh.add_facets(f"interface_{i}", cell[last] == bounds[i] - 1, last, 1)
        return mesh
