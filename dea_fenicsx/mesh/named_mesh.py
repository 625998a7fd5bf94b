"""A mesh as plain arrays with the names of its regions and surfaces, to hand over to others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dea_fenicsx.support.cell_types import CORNERS, GMSH, HEX, TET

_HEX_EDGES = (8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15)
_TET_EDGES = (4, 5, 6, 7, 9, 8)


@dataclass(frozen=True)
class NamedMesh:
    """A mesh of cells of one shape and of first or second degree.

    Attributes
    ----------
    points : ndarray (nodes, 3), m
    cells : ndarray (cells, nodes of a cell), in VTK's order; of second degree the nodes within
        faces and cells may be there or not
    kind : DOLFINx's name of the cells
    regions : rows of `cells` of each region, by name
    surfaces : corners of the facets of each surface, by name, shape (facets, corners)
    surface_nodes : all nodes on each surface
    """

    points: np.ndarray
    cells: np.ndarray
    kind: str
    regions: Mapping[str, np.ndarray] = field(default_factory=dict)
    surfaces: Mapping[str, np.ndarray] = field(default_factory=dict)
    surface_nodes: Mapping[str, np.ndarray] = field(default_factory=dict)


def of_model(model: Any, names: Mapping[str, tuple[int, int]], dim: int, unit: float) -> NamedMesh:
    """The current gmsh model as a named mesh.

    Parameters
    ----------
    model
        The current gmsh model, with cells of one type.
    names
        Dimension and tag of each group of regions and of facets.
    dim
        Dimension of the cells.
    unit
        The model's unit of length in m.
    """
    tags, flat, _ = model.mesh.getNodes()
    place = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    place[tags] = np.arange(len(tags))
    points = np.asarray(flat).reshape(-1, 3) * unit
    (kind,) = model.mesh.getElementTypes(dim)
    found: list[np.ndarray] = []
    regions: dict[str, np.ndarray] = {}
    surfaces, on_surface = {}, {}
    count = 0
    for name, (d, tag) in names.items():
        tables = [_table(model, d, entity, place)
                  for entity in model.getEntitiesForPhysicalGroup(d, tag)]  # fmt: skip
        table = np.vstack([t for t in tables if len(t)])
        if d == dim:
            found.append(table)
            regions[name] = np.arange(count, count + len(table))
            count += len(table)
        else:
            corners = {2: 2, 3: 2, 4: 4, 9: 4, 8: 4}.get(table.shape[1], 3) if dim == 3 else 2
            surfaces[name], on_surface[name] = table[:, :corners], np.unique(table)
    cells = np.vstack(found)
    shape = GMSH[int(kind)].shape
    if shape == HEX and cells.shape[1] > 8:
        cells = cells[:, [*range(8), *_HEX_EDGES]]
    elif shape == TET and cells.shape[1] > 4:
        cells = cells[:, [*range(4), *_TET_EDGES]]
    return NamedMesh(points, cells, shape, regions, surfaces, on_surface)


def _table(model: Any, dim: int, entity: int, place: np.ndarray) -> np.ndarray:
    """Nodes of the cells of an entity, by their row."""
    kinds, _, nodes = model.mesh.getElements(dim, entity)
    if len(kinds) == 0:
        return np.empty((0, 1), dtype=np.int64)
    return place[np.asarray(nodes[0]).reshape(-1, GMSH[int(kinds[0])].nodes)]


def serendipity(mesh: NamedMesh) -> np.ndarray:
    """The cells without their nodes within faces and cells: corners, then middles of edges."""
    corners = CORNERS[mesh.kind][1]
    edges = {TET: 6, HEX: 12}.get(mesh.kind, corners)
    return mesh.cells[:, : corners + edges]
