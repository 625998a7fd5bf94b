"""Stack of round layers: the disk-shaped dielectric elastomer actuator (DDEA)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si

from . import _check
from ._lattice import FlatLattice, GroupBox, Lattice
from ._polar import circle, o_grid, rings
from ._structured import Floats, joined_ends, lattice_points
from .base import (
    Layer,
    LayeredGeometry,
    OfLattice,
    checked_layers,
    ends_of_layers,
    refuse_clash,
    rows_of_layers,
)
from .grading import graded


@dataclass(frozen=True)
@in_si(radius="m", inset="m", inner_radius="m", inner_inset="m")
class DiskStack(LayeredGeometry, OfLattice):
    """Round layers stacked in z from z = 0 around the z axis, full or with a hole.

    A full disk is meshed as an O-grid: a square core with bulging sides, and rings around it.

    Parameters
    ----------
    radius
        Outer radius in metres.
    layers
        From the bottom up.
    inset, inner_inset
        Distance in metres of the electrodes from the outer rim, and from the hole.  Layers with
        ``electrode=True`` fill only the part between; their rims belong to ``margin``.
    margin
        Region of those rims; default: the name of the nearest dielectric layer, below if any.
    inner_radius
        Radius of the hole in metres; 0 for a full disk.
    angular
        Cells around; a multiple of 4 for a full disk.
    radial, rim
        Cells over the electrode's radius (for a full disk: from the core to its edge), and over
        each inset.
    grading
        Largest over smallest cell over ``radial``; the small ones lie at the electrode's edges.
    end_electrodes
        The end faces carry electrodes: instead of ``bottom`` and ``top`` there are
        ``bottom_active``, ``bottom_margin``, ``top_active``, ``top_margin``.
    order
        Degree of the cells' geometry, 1 or 2.

    Notes
    -----
    Volume groups: the layers' names and ``margin``.  Facet groups: ``bottom``, ``top``, ``side``,
    ``inner`` (with a hole); ``interface_1``, ... between layers 1 and 2, ..., only where an
    electrode lies, that is off the insets; ``rim_k``, the edges of layer k (counted from 1) towards
    its rims, where layer k is an electrode.

    Raises
    ------
    InputError
        A parameter is not usable.
    """

    radius: float
    layers: Sequence[Layer]
    inset: float = 0.0
    margin: str | None = None
    inner_radius: float = 0.0
    inner_inset: float = 0.0
    angular: int = 16
    radial: int = 3
    rim: int = 1
    grading: float = 2.0
    end_electrodes: bool = False
    order: int = 2

    def __post_init__(self) -> None:
        owner = "DiskStack"
        _check.length(owner, "radius", self.radius)
        for name in ("inset", "inner_inset", "inner_radius"):
            _check.length(owner, name, getattr(self, name), zero=True)
        if self.inner_radius >= self.radius:
            raise InputError(
                f"{owner}: inner_radius {self.inner_radius:g} m is not below radius "
                f"{self.radius:g} m; make it smaller."
            )
        if self.inner_inset > 0 and self.inner_radius == 0:
            raise InputError(
                f"{owner}: inner_inset is {self.inner_inset:g} m on a disk without a hole; give an "
                "inner_radius or leave it 0."
            )
        room = self.radius - self.inner_radius
        if self.inset + self.inner_inset >= room:
            raise InputError(
                f"{owner}: inset {self.inset + self.inner_inset:g} m leaves no electrode over the "
                f"{room:g} m between centre or hole and rim; it must be below {room:g} m."
            )
        object.__setattr__(self, "layers", checked_layers(owner, self.layers))
        for name in ("radial", "rim"):
            _check.count(owner, name, getattr(self, name))
        _check.count(owner, "angular", self.angular, least=3)
        if self.inner_radius == 0 and self.angular % 4:
            raise InputError(
                f"{owner}: angular is {self.angular}; a full disk needs a multiple of 4."
            )
        _check.ratio(owner, "grading", self.grading)
        _check.order(owner, self.order)
        if not isinstance(self.end_electrodes, bool):
            raise InputError(
                f"{owner}: end_electrodes is {shown(self.end_electrodes)}; it must be True or "
                "False."
            )
        if self.margin is not None:
            _check.group_name(owner, "margin", self.margin)
            if self.margin in {layer.name for layer in self.layers if layer.electrode}:
                raise InputError(
                    f"{owner}: margin is {shown(self.margin)}, the name of an electrode; the rims "
                    "are dielectric, name them otherwise."
                )
        refuse_clash(owner, set(self._volumes()), set(self._areas()))

    # ---- closed forms -----------------------------------------------------------------------

    @property
    def _inset_anywhere(self) -> bool:
        return self.inset > 0 or self.inner_inset > 0

    @property
    def electrode_radii(self) -> tuple[float, float]:
        """Inner and outer radius of the electrodes in metres (0 where there is no hole)."""
        return self.inner_radius + self.inner_inset, self.radius - self.inset

    @property
    def volume(self) -> float:
        """Volume in m^3."""
        return math.pi * (self.radius**2 - self.inner_radius**2) * self.height

    @property
    def electrode_area(self) -> float:
        """Area of one electrode face in m^2."""
        r1, r2 = self.electrode_radii
        return math.pi * (r2**2 - r1**2)

    def _margin(self, i: int) -> str:
        """Region of the rim of layer ``i``, an electrode."""
        if self.margin is not None:
            return self.margin
        for layer in [*reversed(self.layers[:i]), *self.layers[i + 1 :]]:
            if not layer.electrode:
                return layer.name
        raise InputError(
            f"DiskStack: there is no dielectric layer to name the rim of electrode "
            f"{self.layers[i].name!r} after; give margin a name."
        )

    def measures(self) -> dict[str, float]:
        """Exact volume (m^3) or area (m^2) of every group."""
        return {**self._volumes(), **self._areas()}

    def _volumes(self) -> dict[str, float]:
        active = self.electrode_area
        whole = math.pi * (self.radius**2 - self.inner_radius**2)
        found: dict[str, float] = {}

        def add(name: str, size: float) -> None:
            found[name] = found.get(name, 0.0) + size

        for i, layer in enumerate(self.layers):
            if layer.electrode and self._inset_anywhere:
                add(layer.name, active * layer.thickness)
                add(self._margin(i), (whole - active) * layer.thickness)
            else:
                add(layer.name, whole * layer.thickness)
        return found

    def _areas(self) -> dict[str, float]:
        active = self.electrode_area
        whole = math.pi * (self.radius**2 - self.inner_radius**2)
        found: dict[str, float] = {}
        for end in ("bottom", "top"):
            if self.end_electrodes:
                found[f"{end}_active"] = active
                if self._inset_anywhere:
                    found[f"{end}_margin"] = whole - active
            else:
                found[end] = whole
        found["side"] = 2 * math.pi * self.radius * self.height
        if self.inner_radius > 0:
            found["inner"] = 2 * math.pi * self.inner_radius * self.height
        insets = self.inner_inset, self.inset
        rims = zip(self.electrode_radii, insets, strict=True)
        edges = 2 * math.pi * sum(r for r, inset in rims if inset > 0)
        for i, layer in enumerate(self.layers, start=1):
            if i < len(self.layers):
                found[f"interface_{i}"] = active
            if layer.electrode and edges > 0:
                found[f"rim_{i}"] = edges * layer.thickness
        return found

    # ---- mesh -------------------------------------------------------------------------------

    def refine(self, factor: int) -> DiskStack:
        """The same stack with all divisions multiplied by ``factor``."""
        k = _check.count("DiskStack.refine", "factor", factor)
        return replace(
            self,
            layers=tuple(replace(layer, divisions=k * layer.divisions) for layer in self.layers),
            angular=k * self.angular,
            radial=k * self.radial,
            rim=k * self.rim,
        )

    def _rings(self) -> tuple[Floats, int, int]:
        """Cell ends from the core (0) or hole to the rim, first electrode ring, first one beyond.

        For a full disk the ends up to the electrode's edge are fractions of the way from the core.
        """
        r1, r2 = self.electrode_radii
        full = self.inner_radius == 0
        between = graded(self.radial, self.grading, "end" if full else "both")
        pieces = [between if full else r1 + (r2 - r1) * between]
        if self.inner_inset > 0:
            pieces.insert(0, np.linspace(self.inner_radius, r1, self.rim + 1))
        if self.inset > 0:
            edge = pieces[-1][-1]
            pieces.append(np.linspace(edge, edge + self.inset, self.rim + 1))
        first = self.rim if self.inner_inset > 0 else 0
        return joined_ends(*pieces), first, first + self.radial

    def lattice(self) -> Lattice:
        """See `OfLattice.lattice`."""
        return self._plane().swept(ends_of_layers(self.layers), self.order, self._boxes())

    def _plane(self) -> FlatLattice:
        """The quadrilaterals across the axis, one index for each: the core, then ring by ring."""
        ends, _, beyond = self._rings()
        if self.inner_radius == 0:
            return o_grid(ends, beyond, self.electrode_radii[1], self.angular, self.order)
        directions = circle(self.order * self.angular)
        return rings(lattice_points(ends, self.order), directions, self.angular, self.order).flat()

    def _boxes(self) -> list[GroupBox]:
        """The groups by the indices of cells in the plane and through the layers."""
        ends, first, beyond = self._rings()
        around, last = self.angular, len(ends) - 1
        core = 0 if self.inner_radius > 0 else (around // 4) ** 2  # cells before the first ring
        plane = range(core + last * around)
        active = range(first * around, core + beyond * around)
        margins = [r for r in (plane[: active.start], plane[active.stop :]) if len(r)]
        rows = rows_of_layers(self.layers)
        deep = range(rows[-1].stop)

        def ring(k: int) -> range:
            return range(core + k * around, core + (k + 1) * around)

        found = []
        for i, (layer, level) in enumerate(zip(self.layers, rows, strict=True)):
            if layer.electrode and self._inset_anywhere:
                found.append(GroupBox(layer.name, (active, level)))
                found += [GroupBox(self._margin(i), (margin, level)) for margin in margins]
                if self.inner_inset > 0:
                    found.append(GroupBox(f"rim_{i + 1}", (ring(first), level), (0, 0)))
                if self.inset > 0:
                    found.append(GroupBox(f"rim_{i + 1}", (ring(beyond - 1), level), (0, 1)))
            else:
                found.append(GroupBox(layer.name, (plane, level)))
            if i > 0:
                found.append(GroupBox(f"interface_{i}", (active, rows[i - 1][-1:]), (2, 1)))
        for name, row, end in (("bottom", deep[:1], 0), ("top", deep[-1:], 1)):
            if self.end_electrodes:
                found.append(GroupBox(f"{name}_active", (active, row), (2, end)))
                found += [GroupBox(f"{name}_margin", (margin, row), (2, end)) for margin in margins]
            else:
                found.append(GroupBox(name, (plane, row), (2, end)))
        found.append(GroupBox("side", (ring(last - 1), deep), (0, 1)))
        if self.inner_radius > 0:
            found.append(GroupBox("inner", (ring(0), deep), (0, 0)))
        return found


def main(arguments: list[str] | None = None) -> int:
    """``python -m dea_fenicsx.geometry.disk_stack``: write a .msh, print measures."""
    from ._cli import add_layers, parameter_parser, run

    parser = parameter_parser(
        "dea_fenicsx.geometry.disk_stack",
        "Mesh of round layers, full or with a hole.",
        DiskStack,
        {
            "radius": "outer radius in m",
            "inset": "distance of the electrodes from the outer rim in m",
            "inner_radius": "radius of the hole in m; 0 for a full disk",
            "inner_inset": "distance of the electrodes from the hole in m",
            "angular": "cells around; a multiple of 4 for a full disk",
            "radial": "cells over the electrode's radius",
            "rim": "cells over each inset",
            "grading": "largest over smallest cell over the electrode's radius",
            "order": "degree of the cells' geometry, 1 or 2",
        },
    )
    add_layers(parser)
    parser.add_argument("--margin", help="region of the electrodes' rims")
    parser.add_argument(
        "--end-electrodes", action="store_true", help="the end faces carry electrodes"
    )
    return run(parser, DiskStack, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
