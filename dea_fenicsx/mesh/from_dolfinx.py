"""A DOLFINx mesh of the user's own becomes a device."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.mesh.device import Device, scale
from dea_fenicsx.mesh.named_by_place import Named, Where, check_wanted, named_by_place
from dea_fenicsx.support import compat
from dea_fenicsx.support.agreement import check_same, together
from dea_fenicsx.support.cell_types import HEX, INTERVAL, QUAD, TET, TRIANGLE
from dea_fenicsx.support.errors import InputError, install_hook
from dea_fenicsx.support.exchange import ghosts_at_owners
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.validation import is_whole, positive

NO_TAG = -(2.0**40)
"""Stands for no tag; tags themselves have 32 bits."""


def from_dolfinx(
    mesh: Any,
    cell_tags: Any = None,
    facet_tags: Any = None,
    *,
    regions: str | Mapping[str, int] = "body",
    surfaces: Mapping[str, int | Where] | None = None,
    unit: float = 1.0,
) -> Device:
    """A device of a DOLFINx mesh, whose regions and surfaces get names.  Collective.

    The mesh itself stays as it is: the device has a copy of its coordinates.

    Parameters
    ----------
    mesh
        A mesh of triangles, quadrilaterals, tetrahedra or hexahedra, in as many coordinates as its
        cells have dimensions.  On several ranks it must have been made with
        ``ghost_mode=dolfinx.mesh.GhostMode.shared_facet``.
    cell_tags
        Tags of its cells; None where all cells are one region.
    facet_tags
        Tags of its facets; None where no surface is named by a tag.
    regions
        The name of the one region, or the tag of each region by its name.
    surfaces
        For each name the tag of its facets, or its place as in `read_gmsh`.
    unit
        Length of the mesh's coordinate unit in metres; 1e-3 for a mesh in millimetres.

    Raises
    ------
    InputError
        If the mesh cannot be computed on, a cell has no name, a tag or a place finds nothing, or a
        name is given twice.
    """
    install_hook()
    surfaces = {} if surfaces is None else surfaces
    _check_mesh(mesh)
    places: dict[str, Any] = {n: w for n, w in surfaces.items() if not is_whole(w, -(2**31))}
    check_wanted(places, "from_dolfinx")
    check_same(mesh.comm, {"regions": regions, "surfaces": surfaces, "unit": unit})
    positive(unit, "The unit of from_dolfinx", "a length > 0 in m")
    together(mesh.comm, lambda: _check_tags(mesh, cell_tags, facet_tags), "The tags of the mesh")
    copy = compat.copied_mesh(mesh)
    extent = scale(copy)
    _check_ghosts(copy)
    cells, tags = _regions(copy, cell_tags, regions)
    given: dict[str, Any] = {n: w for n, w in surfaces.items() if n not in places}
    given = {name: int(tag) for name, tag in given.items()}
    facets = None if facet_tags is None else tags_alike(copy, facet_tags, copy.topology.dim - 1)
    _check_surfaces(copy, facets, given, tags)
    named = Named(cells, tags, facets, given, {})
    if places:
        named = named_by_place(copy, extent * unit, named, places)
    return Device(
        mesh=copy, cells=cells, facets=named.facets, regions=tags, surfaces=named.surfaces,
        length=extent * unit, source="a DOLFINx mesh", further=named.further,
    )  # fmt: skip


def _check_mesh(mesh: Any) -> None:
    """Raise InputError unless `mesh` is a DOLFINx mesh that can be computed on.  Collective."""
    if not isinstance(mesh, compat.dolfinx.mesh.Mesh):
        raise InputError(
            f"from_dolfinx is given {shown(mesh)}, but needs a dolfinx.mesh.Mesh; files and "
            "geometries are read by read_gmsh."
        )
    cell, dim = mesh.topology.cell_name(), mesh.topology.dim
    in_plane = mesh.geometry.dim == 2
    if cell not in (TRIANGLE, QUAD, TET, HEX) and not (cell == INTERVAL and in_plane):
        raise InputError(
            f"The mesh has cells of the kind {cell}, but must have triangles, quadrilaterals, "
            "tetrahedra or hexahedra, or lines in the plane for a membrane's meridian."
        )
    fits = mesh.geometry.dim == dim if cell in (TET, HEX) else mesh.geometry.dim - dim in (0, 1)
    if not fits:
        raise InputError(
            f"The mesh has cells of dimension {dim} in {mesh.geometry.dim} coordinates, but must "
            "have as many coordinates as dimensions; the surface of a membrane has one more."
        )
    if mesh.geometry.x.dtype != np.float64:
        raise InputError(
            f"The coordinates of the mesh are {mesh.geometry.x.dtype}, but must be float64."
        )


def _check_tags(mesh: Any, cell_tags: Any, facet_tags: Any) -> None:
    """Raise InputError unless the tags are of the cells and of the facets of a mesh."""
    dim = mesh.topology.dim
    for name, tags, due in (("cell_tags", cell_tags, dim), ("facet_tags", facet_tags, dim - 1)):
        if tags is None:
            continue
        if not isinstance(tags, compat.dolfinx.mesh.MeshTags) or tags.dim != due:
            raise InputError(
                f"{name} is {shown(tags)}, but must be the dolfinx.mesh.MeshTags of entities of "
                f"dimension {due} of the mesh."
            )
        imap = mesh.topology.index_map(due)
        if imap is None or np.max(tags.indices, initial=-1) >= imap.size_local + imap.num_ghosts:
            raise InputError(f"{name} names entities that the mesh lacks; take tags of this mesh.")


def _check_ghosts(mesh: Any) -> None:
    """Raise InputError if a rank lacks the cells behind facets of its own cells.  Collective."""
    topology, dim = mesh.topology, mesh.topology.dim
    link = topology.connectivity(dim - 1, dim)
    imap = topology.index_map(dim - 1)
    outer = np.zeros(imap.size_local + imap.num_ghosts, dtype=bool)
    outer[compat.dolfinx.mesh.exterior_facet_indices(topology)] = True
    alone = np.diff(link.offsets)[: imap.size_local] == 1
    lacking = bool(np.any(alone & ~outer[: imap.size_local]))
    if mesh.comm.allreduce(lacking, op=MPI.LOR):
        raise InputError(
            "The mesh was distributed without the cells behind shared facets; make it with "
            "ghost_mode=dolfinx.mesh.GhostMode.shared_facet."
        )


def tags_alike(mesh: Any, tags: Any, dim: int) -> Any:
    """Tags of another mesh with the same topology, complete on each rank.  Collective.

    A user may have tagged owned entities alone, or an entity on a rank that does not own it.
    """
    imap = mesh.topology.index_map(dim)
    owned = imap.size_local
    values = compat.dolfinx.la.vector(imap, 1, dtype=np.float64)
    values.array[:] = NO_TAG
    values.array[tags.indices] = tags.values
    ghosts = np.flatnonzero(values.array[owned:] != NO_TAG)
    mine, found = ghosts_at_owners(imap, mesh.comm, ghosts, values.array[owned + ghosts])
    open_ = values.array[mine] == NO_TAG
    mine, found = mine[open_][::-1], found[open_][::-1]  # the first rank that tells a tag counts
    values.array[mine] = found
    values.scatter_forward()
    indices = np.flatnonzero(values.array != NO_TAG).astype(np.int32)
    return compat.dolfinx.mesh.meshtags(
        mesh, dim, indices, values.array[indices].astype(np.int32)
    )


def _regions(
    mesh: Any, cell_tags: Any, regions: str | Mapping[str, int]
) -> tuple[Any, dict[str, int]]:
    """Tags of the cells, and the tag of each region.  Collective."""
    topology = mesh.topology
    imap = topology.index_map(topology.dim)
    local = np.arange(imap.size_local + imap.num_ghosts, dtype=np.int32)
    if isinstance(regions, str) and regions:
        ones = np.ones(len(local), dtype=np.int32)
        return compat.dolfinx.mesh.meshtags(mesh, topology.dim, local, ones), {regions: 1}
    if not isinstance(regions, Mapping) or not regions or not all(
        isinstance(n, str) and n and is_whole(t, -(2**31)) for n, t in regions.items()
    ):
        raise InputError(
            f"regions= of from_dolfinx is {shown(regions)}, but must be one name, or the tag of "
            'each region by its name, as in {"film": 1}.'
        )
    if cell_tags is None:
        raise InputError(
            "from_dolfinx is given tags of regions, but no cell_tags; hand them over, or give the "
            "name of the one region."
        )
    tags = tags_alike(mesh, cell_tags, topology.dim)
    values = np.full(len(local), NO_TAG)
    values[tags.indices] = tags.values
    owned = values[: imap.size_local]
    for name, tag in regions.items():
        if list(regions.values()).count(tag) > 1:
            raise InputError(f"The tag {tag} names two regions; give each region a tag of its own.")
        if not mesh.comm.allreduce(bool(np.any(owned == tag)), op=MPI.LOR):
            raise InputError(f"The region {name!r} has the tag {tag}, which no cell has.")
    missing = np.unique(owned[~np.isin(owned, list(regions.values()))]).tolist()
    every = sorted(set().union(*mesh.comm.allgather(set(missing))))
    if every:
        what = f"the tag {every[-1]:.0f}" if every[-1] != NO_TAG else "no tag"
        raise InputError(
            f"Cells with {what} lie in no named region; name the tags of all cells in regions=."
        )
    return tags, {n: int(t) for n, t in regions.items()}


def _check_surfaces(
    mesh: Any, facet_tags: Any, given: Mapping[str, int], regions: Mapping[str, int]
) -> None:
    """Raise InputError unless each surface that is named by a tag has facets.  Collective."""
    for name, tag in given.items():
        if name in regions:
            raise InputError(
                f"The mesh has a group named {name!r} already; give the surface another name."
            )
        if facet_tags is None:
            raise InputError(
                f"The surface {name!r} has the tag {tag}, but from_dolfinx is given no facet_tags; "
                "hand them over, or name the surface by its place."
            )
        if not mesh.comm.allreduce(len(facet_tags.find(tag)), op=MPI.SUM):
            raise InputError(f"The surface {name!r} has the tag {tag}, which no facet has.")
