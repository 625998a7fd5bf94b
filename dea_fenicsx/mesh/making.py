"""From a geometry or a file to a mesh on all ranks with its named groups.

A family that can make parts of its mesh makes one on each rank, and no rank holds the whole.  All
other meshes are built or read by gmsh on rank 0.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple, TypeGuard

import basix
import basix.ufl
import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.geometry._gmsh import quality
from dea_fenicsx.geometry.base import InParts
from dea_fenicsx.mesh.cad import name_the_body, open_file, read_names
from dea_fenicsx.mesh.foreign.model import checked
from dea_fenicsx.mesh.foreign.options import gmsh_for, is_family
from dea_fenicsx.mesh.named_by_place import Named
from dea_fenicsx.support import dolfinx_meshes
from dea_fenicsx.support.agreement import together
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError


class Told(NamedTuple):
    """The facts of a mesh that all ranks know.

    Attributes
    ----------
    groups, further : dimension and tag of each named group; tags that groups of facets share
    dim, space : dimension of the cells; number of coordinates, one more for a membrane
    quality, source : as in `Device`
    """

    groups: dict[str, tuple[int, int]]
    further: dict[str, tuple[int, ...]]
    dim: int
    space: int
    quality: dict[str, float]
    source: str


def comes_in_parts(source: Any, options: dict[str, Any]) -> TypeGuard[InParts]:
    """Whether a device can be made of parts: a family that makes them, with no other wish.

    A class in a script that inherits from such a family may move the nodes of its mesh, and so does
    not count.
    """
    plain = options["size"] is None and not options["names"] and not options["surfaces"]
    return plain and is_family(source) and isinstance(source, InParts)


def by_parts(
    source: InParts, comm: MPI.Comm, label: str, dim: int | None
) -> tuple[Any, Named, Told]:
    """The mesh of a family of which each rank makes its part.  Collective."""
    part = source.mesh_part(comm.rank, comm.size)
    cells = part.dimension
    _check_dimension(dim, cells, label)
    names = {cells: dict[str, int](), cells - 1: dict[str, int]()}
    for tag, (name, d) in enumerate(source.groups_of_parts().items(), 1):
        names[d][name] = tag
    values = np.zeros(len(part.cells), dtype=np.int32)
    for name, numbers in part.regions.items():
        values[numbers] = names[cells][name]
    facets = [np.empty((0, *part.cells.shape[2:]), dtype=np.int64), *part.facets.values()]
    tags = [np.full(len(f), names[cells - 1][name]) for name, f in part.facets.items()]
    mesh = _mesh(comm, part.cells, part.points[:, : source.dimension])
    of_cells = _tags(mesh, part.cells, values)
    of_facets = _tags(mesh, np.concatenate(facets), np.concatenate([np.empty(0, int), *tags]))
    named = Named(of_cells, names[cells], of_facets, names[cells - 1], {})
    groups = {name: (d, tag) for d, found in names.items() for name, tag in found.items()}
    least, aspect = source.cell_shape(comm.rank, comm.size)
    shape = {
        "least_scaled_jacobian": comm.allreduce(least, op=MPI.MIN),
        "largest_aspect": comm.allreduce(aspect, op=MPI.MAX),
    }
    return mesh, named, Told(groups, {}, cells, source.dimension, shape, label)


def _mesh(comm: MPI.Comm, cells: np.ndarray, points: np.ndarray) -> Any:
    """The mesh of quadrilaterals or hexahedra that are given as lattices of nodes.  Collective."""
    kind = {3: "quadrilateral", 4: "hexahedron"}[cells.ndim]
    element = basix.ufl.element(
        "Lagrange", kind, cells.shape[1] - 1, basix.LagrangeVariant.equispaced,
        shape=(points.shape[1],),
    )  # fmt: skip
    table, places = _from_lattice(cells), np.ascontiguousarray(points)
    return dolfinx_meshes.create_mesh(comm, table, places, ufl.Mesh(element))


def _tags(mesh: Any, entities: np.ndarray, values: np.ndarray) -> Any:
    """Tags of cells or facets that are given as lattices of nodes, on any ranks.  Collective."""
    d = entities.ndim - 1
    found, numbers = dolfinx_meshes.gmsh_io().distribute_entity_data(
        mesh, d, _from_lattice(entities), values.astype(np.int32)
    )
    mesh.topology.create_connectivity(d, mesh.topology.dim)
    links = dolfinx.graph.adjacencylist(found)
    return dolfinx.mesh.meshtags_from_entities(mesh, d, links, numbers.astype(np.int32, copy=False))


def _from_lattice(entities: np.ndarray) -> np.ndarray:
    """Nodes of lattices (n, q[, q[, q]]) in basix's order, shape (n, nodes)."""
    dim, order = entities.ndim - 1, entities.shape[1] - 1
    cell = {1: "interval", 2: "quadrilateral", 3: "hexahedron"}[dim]
    places = basix.create_element(
        basix.ElementFamily.P, getattr(basix.CellType, cell), order,
        basix.LagrangeVariant.equispaced,
    ).points  # fmt: skip
    index = np.rint(places * order).astype(np.int64)
    flat = np.ravel_multi_index(tuple(index.T), (order + 1,) * dim)
    return np.ascontiguousarray(entities.reshape(len(entities), (order + 1) ** dim)[:, flat])


def by_gmsh(
    source: Any, comm: MPI.Comm, label: str, dim: int | None, unit: float, options: dict[str, Any]
) -> tuple[Any, Named, Told]:
    """The mesh that gmsh builds or reads on rank 0.  Collective."""
    model, told = None, None

    def open_and_check() -> None:
        nonlocal model, told
        if comm.rank == 0:
            model = _open(source, unit, options)
            if options["surfaces"]:
                name_the_body(model)
            model, told = _look_at(model, source, label, dim, unit, options["apart"])

    with gmsh_for(source, comm):
        try:
            together(comm, open_and_check, f"The mesh of {label}")
            told = comm.bcast(told, root=0)
            assert told is not None
            try:
                mesh, cells, facets = dolfinx_meshes.model_to_mesh(model, comm, told.space)
            except RuntimeError as error:
                told_by = " ".join(str(error).split()).rstrip(".")
                raise InputError(f"The mesh of {label} cannot be used ({told_by}).") from error
        finally:
            if model is not None:
                model.remove()
    regions = {n: tag for n, (d, tag) in told.groups.items() if d == told.dim}
    surfaces = {n: tag for n, (d, tag) in told.groups.items() if d == told.dim - 1}
    return mesh, Named(cells, regions, facets, surfaces, told.further), told


def _check_dimension(dim: int | None, cells: int, label: str) -> None:
    """Raise InputError if a mesh has cells of another dimension than is wanted."""
    if dim is not None and dim != cells:
        raise InputError(
            f"{label} has cells of dimension {cells}, but dim is {dim}; leave dim= out, or mesh "
            f"{'the volumes' if dim == 3 else 'a flat section'}."
        )


def _open(source: Any, unit: float, options: dict[str, Any]) -> Any:
    """The gmsh model of a geometry or of a file (rank 0 only)."""
    size, names = options["size"], options["names"]
    if not hasattr(source, "build"):
        largest = None if size is None else size / unit
        return open_file(
            Path(source), largest, names, curved=options["curved"], programs=options["programs"]
        )
    if size is not None or names:
        raise InputError(
            f"size= and names= are for files that are still to be meshed; {type(source).__name__} "
            "has its own."
        )
    return source.build()


def _look_at(
    model: Any, source: Any, label: str, dim: int | None, unit: float, apart: bool
) -> tuple[Any, Told]:
    """Check a model, and bring it into cells that can be computed on (rank 0 only).

    Raises
    ------
    InputError
        If it cannot be used; the model stays then.
    """
    family = is_family(source)
    groups, cells = read_names(model, label, lines=family)
    _check_dimension(dim, cells, label)
    further: dict[str, tuple[int, ...]] = {}
    notes: tuple[str, ...] = ()
    if not family:
        model, groups, further, notes = checked(model, groups, cells, label, unit, apart)
    name = f"{label} ({', '.join(notes)})" if notes else label
    space = source.dimension if family else cells
    return model, Told(groups, further, cells, space, quality(model), name)
