"""Cells, regions and facets of a gmsh model as arrays, checked for what DOLFINx takes for granted.

A gmsh model may hold an element twice, in no group, in two groups, or as a facet of no cell.  For
some of these DOLFINx ends the process; for others it silently takes one of two groups.  So each of
them is either corrected here or refused with a message.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dea_fenicsx.support.cell_types import (
    HEX,
    POINT,
    PRISM,
    PYRAMID,
    QUAD,
    SHAPES,
    TET,
    TRIANGLE,
)
from dea_fenicsx.support.errors import InputError

Ints = np.ndarray

CELL_FACES: dict[str, tuple[tuple[int, ...], ...]] = {
    TRIANGLE: ((0, 1), (1, 2), (2, 0)),
    QUAD: ((0, 1), (1, 2), (2, 3), (3, 0)),
    TET: ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)),
    HEX: ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    PRISM: ((0, 1, 2), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    PYRAMID: ((0, 1, 2, 3), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
}
"""Corners of each face of a shape in gmsh's numbering, in the order in which they follow it."""


@dataclass(frozen=True)
class ElementType:
    """One of gmsh's types of elements.

    Attributes
    ----------
    number, name : gmsh's number and name
    dim, order : dimension, and polynomial order of the edges
    shape : one of the shapes above
    corners : number of corners
    local : reference coordinates of the nodes, shape (nodes, dim)
    """

    number: int
    name: str
    dim: int
    order: int
    shape: str
    corners: int
    local: np.ndarray

    def node_at(self, corners: tuple[int, ...]) -> int | None:
        """The node in the middle of some corners; None where this type has none there."""
        middle = self.local[list(corners)].mean(axis=0)
        far = np.abs(self.local - middle).max(axis=1)
        return int(np.argmin(far)) if far.min() < 1e-9 else None


def check_known(numbers: Ints, label: str) -> None:
    """Raise InputError, naming the cells, if gmsh itself cannot describe a type of element.

    gmsh writes prisms of third and higher order, but has no functions of their faces.  Asked for
    these, it fails at the first time, and ends the process at a later one.
    """
    import gmsh

    orders = {
        gmsh.model.mesh.getElementType("Prism", order, incomplete): order
        for order in range(3, 10) for incomplete in (False, True)
    }  # fmt: skip
    for number in (int(n) for n in numbers if n > 0):
        if number in orders:
            raise InputError(
                f"{label} has cells of gmsh's type 'Prism of order {orders[number]}', which cannot "
                "be computed on; mesh it with Mesh.ElementOrder 1 or 2."
            )


def element_type(number: int) -> ElementType:
    """gmsh's description of a type of element."""
    import gmsh

    name, dim, order, nodes, local, corners = gmsh.model.mesh.getElementProperties(number)
    shape = SHAPES.get((dim, corners), POINT)
    return ElementType(
        int(number), name, dim, order, shape, corners, np.reshape(local, (nodes, dim))
    )


@dataclass
class PlainMesh:
    """A mesh as arrays.

    Attributes
    ----------
    label
        The file or object that it came from, for messages.
    dim
        Dimension of the cells.
    points
        Coordinates of the nodes of the cells, shape (nodes, 3), in the unit of the file.
    cells
        For each of gmsh's types, the nodes of its cells, shape (cells, nodes of a cell).
    region
        For each type, the index of each cell's region in `regions`.
    regions
        Tag of each region by name.
    surfaces
        Tag of each named group of facets.
    facets
        For each group, its facets by type, like `cells`.
    notes
        What was changed on the way, in a few words each.
    """

    label: str
    dim: int
    points: np.ndarray
    cells: dict[int, Ints]
    region: dict[int, Ints]
    regions: dict[str, int]
    surfaces: dict[str, int]
    facets: dict[str, dict[int, Ints]]
    notes: list[str] = field(default_factory=list)

    def keys(self, nodes: Ints) -> Ints:
        """A number for each row of nodes that does not depend on their order.

        Each node has a random number of 64 bits and a row has their sum, so two different rows
        agree with a probability of 5e-20.
        """
        random = np.random.default_rng(1).integers(
            2**64, size=len(self.points), dtype=np.uint64
        )
        return random[nodes].sum(axis=1, dtype=np.uint64)

    def faces(self) -> list[tuple[int, Ints, Ints]]:
        """All faces of all cells, in blocks of (type of the cells, cells, corners of the face)."""
        found = []
        for number, nodes in self.cells.items():
            for corners in CELL_FACES[element_type(number).shape]:
                found.append((number, np.arange(len(nodes)), nodes[:, list(corners)]))
        return found


def to_arrays(model: Any, groups: dict[str, tuple[int, int]], dim: int, label: str) -> PlainMesh:
    """Take a mesh out of the current gmsh model.

    Parameters
    ----------
    model
        The gmsh model.
    groups
        Dimension and tag of each group of regions and of facets.
    dim
        Dimension of the cells.
    label
        What to call the mesh in messages.

    Raises
    ------
    InputError
        If a cell lies in no region or in two, a facet is a face of no cell, or three cells share a
        face.
    """
    tags, x, _ = model.mesh.getNodes()
    tags, first = np.unique(np.asarray(tags, dtype=np.int64), return_index=True)
    x = np.reshape(x, (-1, 3))[first]
    if not np.all(np.isfinite(x)):
        raise InputError(f"{label} has a node whose coordinates are no numbers; write it anew.")
    raw = {name: _elements(model, *group) for name, group in groups.items()}
    regions = {name: tag for name, (d, tag) in groups.items() if d == dim}
    surfaces = {name: tag for name, (d, tag) in groups.items() if d == dim - 1}
    cells, region = _gathered([raw[name] for name in regions])
    if not cells:
        raise InputError(f"{label} has no cells in its named regions; mesh what they name.")
    used = np.unique(np.concatenate([nodes.ravel() for nodes in cells.values()]))
    place_of = np.searchsorted(tags, used)
    known = tags[np.minimum(place_of, len(tags) - 1)] == used
    if not np.all(known):
        raise InputError(f"{label} has a cell with a node that it does not hold; write it anew.")
    mesh = PlainMesh(
        label, dim, x[place_of], {k: np.searchsorted(used, n) for k, n in cells.items()}, region,
        regions, surfaces, {},
    )  # fmt: skip
    _one_region_each(mesh, _unnamed(model, dim))
    for name in surfaces:
        mesh.facets[name] = {
            k: np.where(np.isin(n, used), np.searchsorted(used, n), -1)
            for k, n in raw[name].items()
        }
    _check_facets(mesh)
    return mesh


def _unnamed(model: Any, dim: int) -> int:
    """Number of cells that lie in no physical group."""
    return sum(
        len(tags)
        for _, entity in model.getEntities(dim)
        if not len(model.getPhysicalGroupsForEntity(dim, entity))
        for tags in model.mesh.getElements(dim, entity)[1]
    )


def _elements(model: Any, dim: int, tag: int) -> dict[int, Ints]:
    """Nodes of the elements of a physical group, by type."""
    found: dict[int, list[Ints]] = {}
    for entity in model.getEntitiesForPhysicalGroup(dim, tag):
        kinds, elements, nodes = model.mesh.getElements(dim, entity)
        for kind, members, table in zip(kinds, elements, nodes, strict=True):
            rows = np.reshape(np.asarray(table, dtype=np.int64), (len(members), -1))
            found.setdefault(int(kind), []).append(rows)
    return {kind: np.concatenate(rows) for kind, rows in found.items()}


def _gathered(parts: list[dict[int, Ints]]) -> tuple[dict[int, Ints], dict[int, Ints]]:
    """Cells of all regions by type, and the region of each."""
    cells: dict[int, list[Ints]] = {}
    region: dict[int, list[Ints]] = {}
    for k, part in enumerate(parts):
        for kind, nodes in part.items():
            cells.setdefault(kind, []).append(nodes)
            region.setdefault(kind, []).append(np.full(len(nodes), k))
    return (
        {kind: np.concatenate(rows) for kind, rows in cells.items()},
        {kind: np.concatenate(rows) for kind, rows in region.items()},
    )


def _one_region_each(mesh: PlainMesh, unnamed: int) -> None:
    """Drop cells that are listed twice; refuse cells in two regions or in none."""
    if unnamed:
        total = unnamed + sum(map(len, mesh.cells.values()))
        raise InputError(
            f"{mesh.label} has {unnamed} of {total} cells in no region; every cell must lie in "
            f"exactly one named physical group of dimension {mesh.dim}."
        )
    names = list(mesh.regions)
    for number, nodes in mesh.cells.items():
        keys = mesh.keys(nodes[:, : element_type(number).corners])
        _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
        inverse = inverse.reshape(-1)
        region = mesh.region[number]
        other = region != region[first][inverse]
        if np.any(other):
            k = int(np.argmax(other))
            one, two = names[region[first][inverse[k]]], names[region[k]]
            raise InputError(
                f"{mesh.label} has {np.count_nonzero(other)} cells in two regions, {one!r} and "
                f"{two!r}; every cell must lie in exactly one named group of dimension {mesh.dim}."
            )
        keep = np.sort(first)
        mesh.cells[number], mesh.region[number] = nodes[keep], region[keep]


def _check_facets(mesh: PlainMesh) -> None:
    """Refuse facets that are no faces, and faces of three cells; drop facets listed twice."""
    all_keys = np.concatenate([mesh.keys(corners) for _, _, corners in mesh.faces()])
    keys, counts = np.unique(all_keys, return_counts=True)
    if counts.max() > 2:
        raise InputError(
            f"{mesh.label} has {np.count_nonzero(counts > 2)} faces that belong to three or more "
            "cells; cells lie in one another there, so mesh the parts anew without overlap."
        )
    order = {element_type(number).order for number in mesh.cells}
    for name, blocks in mesh.facets.items():
        for number, nodes in blocks.items():
            kind = element_type(number)
            corners = nodes[:, : kind.corners]
            mine = mesh.keys(np.maximum(corners, 0))
            found = np.minimum(np.searchsorted(keys, mine), len(keys) - 1)
            loose = (keys[found] != mine) | (corners < 0).any(axis=1)
            if np.any(loose):
                raise InputError(
                    f"{mesh.label} has {np.count_nonzero(loose)} of {len(nodes)} facets of group "
                    f"{name!r} that are faces of no cell; take them out of the group, or join the "
                    "surface to its part (BooleanFragments in gmsh) before meshing."
                )
            if order != {kind.order} or (nodes < 0).any():
                raise InputError(
                    f"{mesh.label} has facets in group {name!r} whose middle nodes are not those "
                    "of the cells; write cells and facets with one order of elements."
                )
            _, first = np.unique(mine, return_index=True)
            blocks[number] = nodes[np.sort(first)]


def point(x: np.ndarray, dim: int) -> str:
    """A place in words, in metres; what rounding left of a zero is a zero."""
    zero = 1e-9 * np.max(np.abs(x))
    return f"({', '.join(f'{v if abs(v) > zero else 0.0:.4g}' for v in x[:dim])}) m"
