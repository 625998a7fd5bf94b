"""Stack of rectangular layers, in space or as a flat strip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si

from . import _check
from ._lattice import GroupBox, Lattice, between, side_boxes
from ._structured import Floats
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
from .grading import check_ends, graded


@dataclass(frozen=True)
@in_si(length="m", width="m", x0="m")
class BoxStack(FlatStack, OfLattice):
    """Rectangular layers stacked in z from z = 0, over 0 <= x <= length and 0 <= y <= width.

    With ``width=None`` a flat strip of quadrilaterals: x along the length, y through the layers.

    Parameters
    ----------
    length, width
        In metres; ``width=None`` for the strip.
    layers
        From the bottom up.
    divisions
        Cells along x and y, or one number for both; the strip uses the first.
    order
        Degree of the cells' geometry, 1 or 2.
    grading, ends
        Largest over smallest cell along x and y, and where the small ones lie (see ``graded``); or
        one value for both.
    x0
        Least x in metres.  With ``x0 >= 0`` the strip can be an axisymmetric section, x = r.

    Notes
    -----
    Volume groups: the layers' names.  Facet groups: ``x_min``, ``x_max``, ``y_min``, ``y_max``
    (the last two in space only), ``bottom``, ``top``, and ``interface_1``, ``interface_2``, ...
    between layers 1 and 2, 2 and 3, ...

    Raises
    ------
    InputError
        A parameter is not usable.
    """

    length: float
    width: float | None
    layers: Sequence[Layer]
    divisions: int | tuple[int, ...] = (1, 1)
    order: int = 2
    grading: float | tuple[float, ...] = 1.0
    ends: str | tuple[str, ...] = "both"
    x0: float = 0.0

    def __post_init__(self) -> None:
        _check.length("BoxStack", "length", self.length)
        if self.width is not None:
            _check.length("BoxStack", "width", self.width)
        layers = checked_layers("BoxStack", self.layers)
        object.__setattr__(self, "layers", layers)
        for name, test in (
            ("divisions", _check.count),
            ("grading", _check.ratio),
            ("ends", check_ends),
        ):
            values = self._per_direction(name)
            for value in values:
                test("BoxStack", name, value)
            object.__setattr__(self, name, values)
        _check.order("BoxStack", self.order)
        _check.number("BoxStack", "x0", self.x0)
        refuse_clash("BoxStack", {layer.name for layer in layers}, set(self._facet_names()))

    def _per_direction(self, name: str) -> tuple[object, ...]:
        value = getattr(self, name)
        needed = 1 if self.width is None else 2
        if not isinstance(value, tuple | list):
            return (value,) * needed
        if len(value) < needed:
            raise InputError(
                f"BoxStack: {name} is {shown(value)}; it must hold {needed} values, one for each "
                "direction."
            )
        return tuple(value[:needed])

    def _facet_names(self) -> list[str]:
        sides = ["x_min", "x_max"] + ([] if self.width is None else ["y_min", "y_max"])
        inner = [f"interface_{i}" for i in range(1, len(self.layers))]
        return [*sides, "bottom", "top", *inner]

    @property
    def volume(self) -> float:
        """Volume in m^3; of the strip, its area in m^2."""
        return sum(self.measures()[name] for name in {layer.name for layer in self.layers})

    def measures(self) -> dict[str, float]:
        """Exact volume (area) of every layer name and area (length) of every facet group."""
        width = 1.0 if self.width is None else self.width
        base = self.length * width
        found = sizes_of_layers(self.layers, base)
        for name in self._facet_names():
            if name.startswith("x_"):
                found[name] = width * self.height
            elif name.startswith("y_"):
                found[name] = self.length * self.height
            else:
                found[name] = base
        return found

    def refine(self, factor: int) -> BoxStack:
        """The same stack with all divisions multiplied by ``factor``."""
        k = _check.count("BoxStack.refine", "factor", factor)
        layers = tuple(replace(layer, divisions=k * layer.divisions) for layer in self.layers)
        assert isinstance(self.divisions, tuple)
        return replace(self, layers=layers, divisions=tuple(k * n for n in self.divisions))

    def lattice(self) -> Lattice:
        """See `OfLattice.lattice`."""
        return between(self.cell_ends(), self.order, self.boxes())

    def cell_shape(self, part: int = 0, parts: int = 1) -> tuple[float, float]:
        """See `InParts.cell_shape`; here of all cells, which are boxes, for any part."""
        edges = [np.diff(e) for e in self.cell_ends()]
        pairs = [(a, b) for i, a in enumerate(edges) for k, b in enumerate(edges) if i != k]
        aspect = max(float(a.max() / b.min()) for a, b in pairs)
        return 1.0, max(aspect, 1.0)

    def cell_ends(self) -> list[Floats]:
        """Ends of the cells in m along x, y (in space only) and through the layers."""
        assert isinstance(self.divisions, tuple)
        assert isinstance(self.grading, tuple) and isinstance(self.ends, tuple)
        sizes = [self.length] if self.width is None else [self.length, self.width]
        ends = [
            size * graded(n, g, e)
            for size, n, g, e in zip(sizes, self.divisions, self.grading, self.ends, strict=True)
        ]
        ends[0] = ends[0] + self.x0
        return [*ends, ends_of_layers(self.layers)]

    def boxes(self) -> list[GroupBox]:
        """The groups by the logical indices of cells, as `Lattice` has them."""
        assert isinstance(self.divisions, tuple)
        last = len(self.divisions)  # the direction through the layers
        deep = sum(layer.divisions for layer in self.layers)
        whole = (*(range(n) for n in self.divisions), range(deep))
        regions, interfaces = boxes_of_layers(self.layers, whole, last)
        sides: list[GroupBox] = []
        for axis, letter in enumerate("xy"[:last]):
            sides += side_boxes(whole, axis, f"{letter}_min", f"{letter}_max")
        return [*regions, *sides, *side_boxes(whole, last, "bottom", "top"), *interfaces]


def main(arguments: list[str] | None = None) -> int:
    """``python -m dea_fenicsx.geometry.box_stack``: write a .msh, print measures."""
    from ._cli import add_layers, parameter_parser, run, value, values

    parser = parameter_parser(
        "dea_fenicsx.geometry.box_stack",
        "Mesh of rectangular layers, in space or as a flat strip.",
        BoxStack,
        {
            "length": "along x in m",
            "order": "degree of the cells' geometry, 1 or 2",
            "x0": "least x in m",
        },
    )
    add_layers(parser)
    parser.add_argument("--width", type=value, help="along y in m; without it a flat strip")
    parser.add_argument(
        "--divisions", type=values, default=(1, 1), help="cells along x and y, as 8,2"
    )
    parser.add_argument(
        "--grading",
        type=values,
        default=(1.0, 1.0),
        help="largest over smallest cell along x and y, as 4,1",
    )
    parser.add_argument(
        "--ends",
        type=lambda text: tuple(text.split(",")),
        default=("both", "both"),
        help="where the small cells lie along x and y: both, start, end or none, as start,both",
    )
    return run(parser, BoxStack, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
