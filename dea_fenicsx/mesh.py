"""From a gmsh model or a file to one frozen object: mesh, tags and their names."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx import compat
from dea_fenicsx.agreement import check_same, together
from dea_fenicsx.cad import Names, lengths, open_file, read_names
from dea_fenicsx.errors import InputError, install_hook
from dea_fenicsx.geometry._gmsh import quality


@dataclass(frozen=True, eq=False)
class Device:
    """The meshed device, distributed over the ranks of `comm`.

    Coordinates of `mesh` are dimensionless: metres divided by `length`.

    Attributes
    ----------
    mesh
        The DOLFINx mesh.
    cells, facets
        Tags of cells and of facets; `facets` is None where no facet group is named.
    regions, surfaces
        Tag of each named group of cells and of facets.
    length
        Length unit of the coordinates in metres: the largest extent of the device.
    source
        Where the mesh came from, for reports.
    quality
        ``least_scaled_jacobian`` of its cells (1 in a cell with right angles) and
        ``largest_aspect``, the longest over the shortest edge of a cell.
    """

    mesh: Any
    cells: Any
    facets: Any
    regions: dict[str, int]
    surfaces: dict[str, int]
    length: float
    source: str = ""
    quality: dict[str, float] = field(default_factory=dict)
    _cache: dict[str, Any] = field(default_factory=dict, repr=False)

    @property
    def comm(self) -> MPI.Comm:
        return self.mesh.comm

    @property
    def dim(self) -> int:
        return self.mesh.topology.dim

    def cells_of(self, name: str) -> np.ndarray:
        """Local cells (owned and ghost) of a region."""
        return self.cells.find(self.regions[name])

    def facets_of(self, name: str) -> np.ndarray:
        """Local facets (owned and ghost) of a surface."""
        if self.facets is None:
            return np.empty(0, dtype=np.int32)
        return self.facets.find(self.surfaces[name])

    def owned_cells(self) -> int:
        """Number of cells this rank owns."""
        return self.mesh.topology.index_map(self.dim).size_local


def read_gmsh(
    source: Any,
    comm: MPI.Comm = MPI.COMM_WORLD,
    *,
    dim: int | None = None,
    unit: float | None = None,
    size: float | None = None,
    names: Names | None = None,
) -> Device:
    """Read a mesh, or mesh a drawing, and distribute it.

    Parameters
    ----------
    source
        A geometry of `dea_fenicsx.geometry` (anything with ``build()``), or the path of a file:
        .msh and .geo with a named physical group for each part and each surface that the scene
        needs, or STEP (.step, .stp).  Only rank 0 builds or reads it.
    comm
        The MPI communicator.
    dim
        Dimension of the coordinates, 2 or 3; by default that of the cells.
    unit
        Length of the file's coordinate unit in metres (1e-3 for a mesh in millimetres); 1 unless
        given.  A STEP file states its own.
    size
        Largest size of an element in metres, for .geo and STEP files.
    names
        For STEP files: new names, each with the name or names that ``dea mesh FILE`` shows, as in
        ``{"root": "surface_1", "top": ["surface_8", "surface_9"]}``.  Solids keep the names they
        have in the file; what has none is numbered.

    Raises
    ------
    InputError
        If the file is missing, gmsh cannot read or mesh it, or it has cells that no named group
        holds.
    """
    install_hook()
    label = str(source) if isinstance(source, str | os.PathLike) else type(source).__name__
    check_same(comm, {"dim": dim, "unit": unit})
    unit, size = lengths(label, unit, size)
    groups: dict[str, tuple[int, int]] = {}
    cell_dim, model, good = 0, None, {}

    def open_and_name() -> None:
        nonlocal model, groups, cell_dim, good
        if comm.rank == 0:
            model = _open(source, None if size is None else size / unit, names)
            groups, cell_dim = read_names(model, label)
            good = quality(model)

    try:
        together(comm, open_and_name, f"The mesh of {label}")
    except Exception:
        if model is not None:
            model.remove()
        raise
    groups, cell_dim, good = comm.bcast((groups, cell_dim, good), root=0)
    try:
        mesh, cells, facets = compat.model_to_mesh(model, comm, dim or cell_dim)
    except RuntimeError as error:
        raise InputError(
            f"The mesh of {label} cannot be used ({error}); every cell must lie in exactly one "
            "named physical group."
        ) from error
    finally:
        if comm.rank == 0 and model is not None:
            model.remove()

    tdim = mesh.topology.dim
    for d in (tdim - 1, tdim):
        mesh.topology.create_connectivity(d, tdim)
    mesh.topology.create_connectivity(tdim, tdim - 1)
    x = mesh.geometry.x
    corners = comm.allgather((x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)))
    low, high = np.min([c[0] for c in corners], axis=0), np.max([c[1] for c in corners], axis=0)
    extent = float(np.max(high - low))
    x /= extent
    return Device(
        mesh=mesh,
        cells=cells,
        facets=facets,
        regions={n: tag for n, (d, tag) in groups.items() if d == tdim},
        surfaces={n: tag for n, (d, tag) in groups.items() if d == tdim - 1},
        length=extent * unit,
        source=label,
        quality=good,
    )


def _open(source: Any, size: float | None, names: Names | None) -> Any:
    """The gmsh model of a geometry or of a file (rank 0 only)."""
    if not hasattr(source, "build"):
        return open_file(Path(source), size, names)
    if size is not None or names:
        raise InputError(
            f"size= and names= are for files that are still to be meshed; {type(source).__name__} "
            "has its own."
        )
    return source.build()


def one_sided(device: Device, surface: str, prefer: frozenset[int] | None = None) -> np.ndarray:
    """Each facet of a surface once over all ranks, seen from one of its cells.

    Parameters
    ----------
    device, surface
        The device and the name of a facet group.
    prefer
        Tags of the regions from whose side the facets are seen; by default the side whose cell
        has the lower global number.

    Returns
    -------
    ndarray of shape (n, 2)
        Pairs (cell, facet number within the cell); all cells are owned by this rank, so that an
        integral over the pairs counts every facet once.
    """
    mesh, tdim = device.mesh, device.dim
    facets = device.facets_of(surface)
    cells_of_facet = mesh.topology.connectivity(tdim - 1, tdim)
    facets_of_cell = mesh.topology.connectivity(tdim, tdim - 1)
    index_map = mesh.topology.index_map(tdim)
    owned = index_map.size_local
    local = np.arange(owned + index_map.num_ghosts, dtype=np.int32)
    number = index_map.local_to_global(local)
    tags = np.zeros(len(local), dtype=np.int64)
    tags[device.cells.indices] = device.cells.values

    pairs = []
    for facet in facets:
        cells = cells_of_facet.links(facet)
        if prefer is not None:
            cells = [c for c in cells if int(tags[c]) in prefer]
        if len(cells) == 0:
            continue
        cell = min(cells, key=lambda c: number[c])
        if cell < owned:
            pairs.append((cell, int(np.flatnonzero(facets_of_cell.links(cell) == facet)[0])))
    return np.array(pairs, dtype=np.int32).reshape(-1, 2)
