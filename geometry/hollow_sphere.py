"""A hollow sphere, such as a balloon: half a section, a whole section, or an eighth in space."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si

from . import _check
from ._lattice import GroupBox, Lattice, side_boxes
from ._polar import rings
from ._structured import Floats, Ints, lattice_points, nodes_of_cells
from .base import OfLattice

Part = Literal["half", "whole", "octant"]
PARTS: tuple[Part, ...] = get_args(Part)


@dataclass(frozen=True)
@in_si(inner="m", outer="m")
class HollowSphere(OfLattice):
    """A spherical wall about the origin.

    Parameters
    ----------
    inner, outer
        Radii in metres.
    part
        ``"half"``: the section above the equator in the (r, z) plane; ``"whole"``: the section from
        pole to pole; ``"octant"``: the eighth in space with x, y, z >= 0.
    layers
        Cells through the wall.
    cells
        Cells from the equator to a pole; of an octant an even number.
    order
        Degree of the cells' geometry, 1 or 2.

    Notes
    -----
    Volume group: ``wall``.  Facet groups: ``inner``, ``outer``; of the sections ``axis``, of the
    upper half ``equator``; of an octant ``x_min``, ``y_min``, ``z_min``.

    Raises
    ------
    InputError
        A parameter is not usable.
    """

    inner: float
    outer: float
    part: Part = "half"
    layers: int = 2
    cells: int = 8
    order: int = 2

    def __post_init__(self) -> None:
        owner = "HollowSphere"
        for name in ("inner", "outer"):
            _check.length(owner, name, getattr(self, name))
        if self.inner >= self.outer:
            raise InputError(
                f"{owner}: inner is {self.inner:g} m, but must be less than outer, "
                f"{self.outer:g} m."
            )
        if self.part not in PARTS:
            raise InputError(
                f"{owner}: part is {shown(self.part)}; it must be one of {', '.join(PARTS)}."
            )
        for name in ("layers", "cells"):
            _check.count(owner, name, getattr(self, name))
        if self.part == "octant" and self.cells % 2:
            raise InputError(f"{owner}: cells is {self.cells}; it must be even for an octant.")
        _check.order(owner, self.order)

    @property
    def dimension(self) -> int:
        """3, or 2 for a section."""
        return 3 if self.part == "octant" else 2

    def measures(self) -> dict[str, float]:
        """Exact volume of the wall and area of every facet group; areas, lengths in 2-D."""
        a, b = self.inner, self.outer
        if self.part == "octant":
            quarter = math.pi / 4 * (b**2 - a**2)
            return {
                "wall": math.pi / 6 * (b**3 - a**3),
                "inner": math.pi / 2 * a**2, "outer": math.pi / 2 * b**2,
                "x_min": quarter, "y_min": quarter, "z_min": quarter,
            }  # fmt: skip
        angle = math.pi / (2 if self.part == "half" else 1)
        found = {
            "wall": angle / 2 * (b**2 - a**2), "inner": angle * a, "outer": angle * b,
            "axis": (b - a) * (1 if self.part == "half" else 2),
        }  # fmt: skip
        return found | ({"equator": b - a} if self.part == "half" else {})

    def refine(self, factor: int) -> HollowSphere:
        """The same sphere with all divisions multiplied by ``factor``."""
        k = _check.count("HollowSphere.refine", "factor", factor)
        return replace(self, layers=k * self.layers, cells=k * self.cells)

    def lattice(self) -> Lattice:
        """See `OfLattice.lattice`."""
        return self._octant() if self.part == "octant" else self._section()

    @property
    def _radii(self) -> Floats:
        """Radii of the nodes through the wall."""
        return lattice_points(np.linspace(self.inner, self.outer, self.layers + 1), self.order)

    def _section(self) -> Lattice:
        """Cells along the radius and from pole to pole, upwards."""
        around = self.cells * (1 if self.part == "half" else 2)
        low = 0.0 if self.part == "half" else -math.pi / 2
        angles = lattice_points(np.linspace(low, math.pi / 2, around + 1), self.order)
        directions = np.column_stack([np.cos(angles), np.sin(angles)])
        directions[np.abs(directions) < 1e-12] = 0.0  # the cosine of a right angle
        whole = range(self.layers), range(around)
        lowest, highest = side_boxes(
            whole, 1, "axis" if self.part == "whole" else "equator", "axis"
        )
        faces = side_boxes(whole, 0, "inner", "outer")
        boxes = [GroupBox("wall", whole), *faces, highest, lowest]
        plane = rings(self._radii, directions, around, self.order)
        return plane.unswept(self.order, boxes)

    def _octant(self) -> Lattice:
        """Three patches, each the central projection of a quarter of a cube's face.

        A cell's indices are its patch, its place along the two sides, and through the wall.
        """
        n, radii = self.cells // 2, self._radii
        line = np.tan(math.pi / 4 * lattice_points(np.linspace(0, 1, n + 1), self.order))
        line[-1] = 1.0  # the tangent of an eighth of a turn is no exact 1
        last, levels = len(line) - 1, len(radii)

        def cells(cell: Sequence[Ints]) -> Ints:
            i, j, k = nodes_of_cells(cell[1:], self.order)
            return _on_patches(cell[0][:, None, None, None], i, j, last) * levels + k

        def places(number: Ints) -> Floats:
            base, k = np.divmod(number, levels)
            patch, i, j = _of_patches(base, last)
            s, t, one = line[i], line[j], np.ones(len(base))
            axes = np.stack([np.stack(face) for face in ((one, s, t), (t, one, s), (s, t, one))])
            scale = radii[k] / np.sqrt(1 + s**2 + t**2)
            return np.asarray(axes[patch, :, np.arange(len(base))] * scale[:, None])

        nodes = (3 * last * (last + 1) + 1) * levels
        counts = (3, n, n, self.layers)
        return Lattice(counts, self.order, nodes, cells, places, self._boxes(counts))

    def _boxes(self, counts: tuple[int, ...]) -> list[GroupBox]:
        """The groups of an octant by the indices of its cells."""
        patches, along, across, through = (range(count) for count in counts)
        found = [GroupBox("wall", (patches, along, across, through))]
        for name, level, end in (("inner", through[:1], 0), ("outer", through[-1:], 1)):
            found.append(GroupBox(name, (patches, along, across, level), (2, end)))
        for k, name in enumerate(("x_min", "y_min", "z_min")):
            one, other = (k + 2) % 3, (k + 1) % 3
            found.append(GroupBox(name, (patches[one:][:1], along[:1], across, through), (0, 0)))
            found.append(GroupBox(name, (patches[other:][:1], along, across[:1], through), (1, 0)))
        return found


def _on_patches(patch: Ints, i: Ints, j: Ints, last: int) -> Ints:
    """Number of a node on the surface of an octant by its patch and its place there.

    The inner nodes of the patches come first, then those between two patches, then the common one.
    The side ``i == last`` of a patch is the side ``j == last`` of the next one.
    """
    found = patch * last**2 + i * last + j
    between = 3 * last**2
    found = np.where(i == last, between + patch * last + j, found)
    found = np.where(j == last, between + (patch + 2) % 3 * last + i, found)
    return np.where((i == last) & (j == last), between + 3 * last, found)


def _of_patches(number: Ints, last: int) -> tuple[Ints, Ints, Ints]:
    """Patch and place of a node by its number, the inverse of `_on_patches`."""
    between = 3 * last**2
    patch, place = np.divmod(number, last**2)
    i, j = np.divmod(place, last)
    edge, along = np.divmod(number - between, last)
    outer, common = number >= between, number == between + 3 * last
    patch = np.where(common, 0, np.where(outer, edge, patch))
    return patch, np.where(outer, last, i), np.where(common, last, np.where(outer, along, j))
