"""Meshes of boxes, handed to DOLFINx without gmsh.

The arrays of a family whose cells are boxes need no program to be read, and their quality is known.
So such a device is there in a third of the time, and a script that has no other need not load gmsh.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import basix
import basix.ufl
import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.geometry._structured import Ints, StructuredMesh
from dea_fenicsx.geometry.base import Geometry
from dea_fenicsx.mesh.foreign.options import is_family
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx

RIGHT_ANGLE = 1e-9
"""Largest cosine between two edges of a box."""


class Boxes(NamedTuple):
    """Cells that are boxes, on rank 0.

    Attributes
    ----------
    given
        Their nodes and names.
    groups
        Dimension and tag of each named group; tags count from 1, regions first.
    quality
        As of `Device`.
    """

    given: StructuredMesh
    groups: dict[str, tuple[int, int]]
    quality: dict[str, float]


def boxes_of(source: Any) -> Boxes | None:
    """The mesh of a family whose cells are boxes (rank 0 only); None for any other source."""
    if compat.VERSION < (0, 11) or not (is_family(source) and isinstance(source, Geometry)):
        return None
    given = source.mesh()
    if given.dimension < 2 or given.dimension != source.dimension:
        return None
    aspect = _aspect(given)
    if aspect is None:
        return None
    given.check()
    dim = given.dimension
    names = [(name, dim) for name in given.regions] + [(name, dim - 1) for name in given.facets]
    groups = {name: (d, tag) for tag, (name, d) in enumerate(names, start=1)}
    return Boxes(given, groups, {"least_scaled_jacobian": 1.0, "largest_aspect": aspect})


def _aspect(given: StructuredMesh) -> float | None:
    """The longest over the shortest edge of a cell; None unless all cells are boxes."""
    dim, x = given.dimension, given.points[given.cells]
    corner: tuple[Any, ...] = (slice(None), *(0,) * dim)
    edges, place = [], x[corner]
    for axis in range(1, dim + 1):
        end: list[Any] = list(corner)
        end[axis] = -1
        edges.append(x[tuple(end)] - place)
    lengths = np.array([np.linalg.norm(edge, axis=1) for edge in edges])
    if not lengths.min() > 0:
        return None
    for k, edge in enumerate(edges):
        for m in range(k):
            cosine = np.einsum("ni,ni->n", edge, edges[m]) / lengths[k] / lengths[m]
            if not np.abs(cosine).max() < RIGHT_ANGLE:
                return None
    steps = np.linspace(0.0, 1.0, given.order + 1)
    straight = place[(slice(None), *(None,) * dim)]
    for axis, edge in enumerate(edges):
        along = steps.reshape([-1 if k == axis else 1 for k in range(dim)])
        straight = straight + edge[(slice(None), *(None,) * dim)] * along[None, ..., None]
    if not np.abs(x - straight).max() < RIGHT_ANGLE * lengths.min():
        return None
    return float((lengths.max(axis=0) / lengths.min(axis=0)).max())


def distributed(boxes: Boxes | None, comm: MPI.Comm) -> tuple[Any, Any, Any]:
    """The mesh of rank 0's boxes: mesh, cell tags, facet tags or None.  Collective."""
    shape: Any = None
    parts: list[tuple[Ints, Ints]] = []
    points = np.empty((0, 0))
    if boxes is not None:
        given, tags = boxes.given, {name: tag for name, (_, tag) in boxes.groups.items()}
        parts = [_tagged({n: given.cells[c] for n, c in given.regions.items()}, tags)]
        if given.facets:
            parts.append(_tagged(given.facets, tags))
        points = given.points[:, : given.dimension]
        shape = given.dimension, given.order, len(parts) > 1
    dim, order, has_facets = comm.bcast(shape, root=0)
    if boxes is None:
        q = order + 1
        points = np.empty((0, dim))
        parts = [
            (np.empty((0, q**d), dtype=np.int64), np.empty(0, dtype=np.int64))
            for d in (dim, dim - 1)[: 1 + has_facets]
        ]
    cell = {2: "quadrilateral", 3: "hexahedron"}[dim]
    return _mesh_of_arrays(comm, cell, order, points, parts)


def _tagged(groups: dict[str, Ints], tags: dict[str, int]) -> tuple[Ints, Ints]:
    """The nodes of the members of groups in the lattice's order, and the tag of each."""
    nodes = [members.reshape(len(members), -1) for members in groups.values()]
    values = [np.full(len(members), tags[name]) for name, members in groups.items()]
    return np.concatenate(nodes), np.concatenate(values)


def _mesh_of_arrays(
    comm: MPI.Comm, cell: str, order: int, points: np.ndarray,
    parts: Sequence[tuple[np.ndarray, np.ndarray]],
) -> tuple[Any, Any, Any]:
    """The mesh of cells on rank 0, as of `compat.model_to_mesh`.  Collective.

    Parameters
    ----------
    comm
        The ranks.
    cell, order
        Shape of the cells, and degree of their geometry.
    points
        Nodes, shape (n, dim); none on other ranks.
    parts
        For the cells, and then for facets if any is named: nodes in the order of a lattice, the
        last direction fastest, and tags.
    """
    dim = points.shape[1]
    element = basix.ufl.element(
        "Lagrange", cell, order, basix.LagrangeVariant.equispaced, shape=(dim,)
    )
    mesh = dolfinx.mesh.create_mesh(
        comm, parts[0][0][:, _lattice_numbers(cell, order)], ufl.Mesh(element), points,
        dolfinx.mesh.create_cell_partitioner(dolfinx.mesh.GhostMode.shared_facet, 2),
        max_facet_to_cell_links=2,
    )
    sides = {"quadrilateral": "interval", "hexahedron": "quadrilateral"}
    tags: list[Any] = []
    for (nodes, values), shape in zip(parts, (cell, sides[cell]), strict=False):
        of = dim - len(tags)
        nodes = nodes[:, _lattice_numbers(shape, order)].astype(np.int64)
        entities, found = dolfinx.io.utils.distribute_entity_data(
            mesh, of, nodes, values.astype(np.int32)
        )
        mesh.topology.create_connectivity(of, dim)
        tags.append(dolfinx.mesh.meshtags_from_entities(
            mesh, of, dolfinx.graph.adjacencylist(entities), found.astype(np.int32)
        ))  # fmt: skip
    return mesh, *tags, *[None] * (2 - len(tags))


@cache
def _lattice_numbers(cell: str, order: int) -> np.ndarray:
    """Place in the lattice of each node of a cell as DOLFINx numbers them."""
    made = basix.create_element(
        basix.ElementFamily.P, getattr(basix.CellType, cell), order,
        basix.LagrangeVariant.equispaced,
    )
    index = np.rint(made.points * order).astype(np.int64)
    shape = (order + 1,) * index.shape[1]
    return np.asarray(np.ravel_multi_index(tuple(index.T), shape))
