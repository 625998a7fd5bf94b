"""What all device families have in common."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Any

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si

from . import _check, _gmsh
from ._lattice import GroupBox, Lattice, within
from ._structured import Floats, StructuredMesh, joined_ends
from .grading import check_ends, graded


class Geometry(ABC):
    """A device family: parameters in, named mesh out.

    Making one checks the parameters and needs no gmsh; it is cheap and may be done on every rank.
    ``build`` and ``write`` are for one rank.
    """

    @property
    def dimension(self) -> int:
        """Of space: 3, or 2 for a flat strip in x and y."""
        return 3

    @abstractmethod
    def mesh(self) -> StructuredMesh:
        """Nodes, cells and named parts as plain arrays."""

    def mesh_of_order(self, order: int) -> StructuredMesh | None:
        """The mesh with cells of a degree beyond 2; None if a parameter ``order`` chooses it."""
        return None

    @abstractmethod
    def measures(self) -> dict[str, float]:
        """Exact measure of every group in closed form.

        Volumes in m^3 and areas in m^2; in two dimensions areas in m^2 and lengths in m.
        """

    @abstractmethod
    def refine(self, factor: int) -> Geometry:
        """The same device with all divisions multiplied by ``factor``."""

    def build(self, name: str | None = None) -> Any:
        """Add a gmsh model, make it current, and return ``gmsh.model``.

        gmsh is initialised where it is not running.  Call it on one rank only.
        """
        return _gmsh.add_model(self.mesh(), name or type(self).__name__)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write a .msh 4.1 file.  It appears whole or not at all.

        Raises
        ------
        InputError
            The path does not end in .msh or can't be written.
        """
        target = _gmsh.checked_path(path)
        with _gmsh.temporary_model(self.mesh(), type(self).__name__):
            _gmsh.write_current(target)

    def groups(self) -> dict[str, int]:
        """Names of all physical groups, each with its dimension."""
        mesh = self.mesh()
        dim = mesh.dimension
        return {**dict.fromkeys(mesh.regions, dim), **dict.fromkeys(mesh.facets, dim - 1)}


class InParts(Geometry):
    """A family of which each of several ranks makes its part, so that none holds the whole."""

    @abstractmethod
    def mesh_part(self, part: int, parts: int) -> StructuredMesh:
        """What one of several ranks makes of the mesh.

        Its cells are an equal part of those of `mesh`, in the order of the regions there, and its
        points an equal part of the points; the numbers in `cells` and `facets` are those of the
        whole mesh.  Groups in which the part has nothing may be missing.

        Parameters
        ----------
        part, parts
            Which part, from 0, and how many there are.
        """

    @abstractmethod
    def groups_of_parts(self) -> dict[str, int]:
        """What `groups` gives, without making a mesh."""

    @abstractmethod
    def cell_shape(self, part: int = 0, parts: int = 1) -> tuple[float, float]:
        """Least scaled Jacobian and largest aspect of the cells of a part; (inf, 0) of no cell."""


class OfLattice(InParts):
    """A family whose mesh is a lattice of cells."""

    @abstractmethod
    def lattice(self) -> Lattice:
        """What the mesh and its parts are made of."""

    def mesh(self) -> StructuredMesh:
        """Nodes, cells and named parts as plain arrays."""
        return self.lattice().mesh()

    def mesh_part(self, part: int, parts: int) -> StructuredMesh:
        """See `InParts.mesh_part`."""
        return self.lattice().part(part, parts)

    def groups_of_parts(self) -> dict[str, int]:
        """See `InParts.groups_of_parts`."""
        return self.lattice().groups()

    def cell_shape(self, part: int = 0, parts: int = 1) -> tuple[float, float]:
        """See `InParts.cell_shape`."""
        return self.lattice().shape(part, parts)


class LayeredGeometry(Geometry):
    """A device of flat layers."""

    layers: Sequence[Layer]

    @property
    def height(self) -> float:
        """Sum of the thicknesses in metres."""
        return sum(layer.thickness for layer in self.layers)


class FlatStack(LayeredGeometry):
    """A box of flat layers, or its section, a strip, where it has no width."""

    width: float | None

    @property
    def dimension(self) -> int:
        """3, or 2 for the strip."""
        return 2 if self.width is None else 3


@dataclass(frozen=True)
@in_si(thickness="m")
class Layer:
    """One layer of a stack.

    Parameters
    ----------
    name
        Name of its volume group; layers may share one.
    thickness
        In metres.
    divisions
        Cells through it.
    electrode
        It is a conductor (used by :class:`DiskStack`, which keeps it off the rim).
    grading, ends
        Largest over smallest cell through it, and where the small ones lie (see ``graded``).

    Raises
    ------
    InputError
        A parameter is not usable.
    """

    name: str
    thickness: float
    divisions: int = 1
    electrode: bool = False
    grading: float = 1.0
    ends: str = "both"

    def __post_init__(self) -> None:
        _check.group_name("Layer", "name", self.name)
        owner = f"Layer {self.name}"
        _check.length(owner, "thickness", self.thickness)
        _check.count(owner, "divisions", self.divisions)
        _check.ratio(owner, "grading", self.grading)
        check_ends(owner, "ends", self.ends)
        if not isinstance(self.electrode, bool):
            raise InputError(
                f"{owner}: electrode is {shown(self.electrode)}; it must be True or False."
            )


def checked_layers(owner: str, layers: Sequence[Layer]) -> tuple[Layer, ...]:
    """A stack's layers, from the bottom; there must be one at least."""
    try:
        checked = tuple(layers)
    except TypeError:
        checked = (layers,)  # type: ignore[assignment]
    if not checked:
        raise InputError(f"{owner}: layers is empty; give at least one Layer, from the bottom up.")
    for i, layer in enumerate(checked):
        if not isinstance(layer, Layer):
            raise InputError(f"{owner}: layers[{i}] is {shown(layer)}; it must be a Layer.")
    return checked


def refuse_clash(owner: str, regions: set[str], facets: set[str]) -> None:
    """A name may stand for a volume or for facets, not for both."""
    both = sorted(regions & facets)
    if both:
        raise InputError(
            f"{owner}: the layer name {both[0]!r} is also the name of a facet group; call the "
            "layer otherwise."
        )


def ends_of_layers(layers: Sequence[Layer], start: float = 0.0) -> Floats:
    """Ends in metres of the cells through layers, from the outer face of the first one."""
    faces = start + np.cumsum([0.0, *(layer.thickness for layer in layers)])
    return joined_ends(*(
        face + layer.thickness * graded(layer.divisions, layer.grading, layer.ends)
        for face, layer in zip(faces, layers, strict=False)
    ))  # fmt: skip


def rows_of_layers(layers: Sequence[Layer]) -> list[range]:
    """The indices of the cells of each layer in the direction through all of them."""
    bounds = [0, *accumulate(layer.divisions for layer in layers)]
    return [range(a, b) for a, b in pairwise(bounds)]


def boxes_of_layers(
    layers: Sequence[Layer], cells: tuple[range, ...], axis: int
) -> tuple[list[GroupBox], list[GroupBox]]:
    """The layers, and the interfaces between them, in a box of cells.

    Parameters
    ----------
    layers
        From the first one along the axis.
    cells
        The indices of the cells of the box.
    axis
        The direction through the layers.
    """
    rows = rows_of_layers(layers)
    regions = [
        GroupBox(layer.name, within(cells, axis, row))
        for layer, row in zip(layers, rows, strict=True)
    ]
    interfaces = [
        GroupBox(f"interface_{k}", within(cells, axis, row[-1:]), (axis, 1))
        for k, row in enumerate(rows[:-1], 1)
    ]
    return regions, interfaces


def sizes_of_layers(layers: Sequence[Layer], base: float) -> dict[str, float]:
    """Volume in m^3 (area in m^2 of a section) of each name of flat layers, by that of their base.

    The base is an area in m^2, or a length in m.
    """
    found: dict[str, float] = {}
    for layer in layers:
        found[layer.name] = found.get(layer.name, 0.0) + base * layer.thickness
    return found
