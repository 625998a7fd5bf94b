"""From a gmsh model or a file to one frozen object: mesh, tags and their names."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypedDict, Unpack

import numpy as np
from mpi4py import MPI

from dea_fenicsx.geometry.base import Geometry
from dea_fenicsx.mesh.cad import Names, lengths
from dea_fenicsx.mesh.facets_by_tags import FacetsByTags
from dea_fenicsx.mesh.foreign.options import is_family
from dea_fenicsx.mesh.making import by_gmsh, by_parts, comes_in_parts
from dea_fenicsx.mesh.named_by_place import Where, check_wanted, named_by_place
from dea_fenicsx.support.agreement import check_same
from dea_fenicsx.support.errors import InputError, install_hook
from dea_fenicsx.support.validation import keywords


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
        Tag of each named group of cells and of facets.  A group of facets that overlaps another one
        has further tags, and `facets_by_surface` has all of its facets.
    length
        Length unit of the coordinates in metres: the largest extent of the device.
    source
        Where the mesh came from, for reports.
    quality
        ``least_scaled_jacobian`` of its cells (1 in a cell with right angles) and
        ``largest_aspect``, the longest over the shortest edge of a cell.
    further
        For each group of facets that overlaps others, the tags of the facets that it shares.
    checked_cells
        For each degree of quadrature at which the cells have been found valid, a digest of the
        coordinates of the nodes; see `cell_quality.check_cells`.
    family, rebuilt
        The family of `dea_fenicsx.geometry` of which this is the mesh, and a function that makes
        the device of another one in the same way; None for other meshes.
    """

    mesh: Any
    cells: Any
    facets: Any
    regions: dict[str, int]
    surfaces: dict[str, int]
    length: float
    source: str = ""
    quality: dict[str, float] = field(default_factory=dict)
    further: dict[str, tuple[int, ...]] = field(default_factory=dict)
    checked_cells: dict[int, str] = field(default_factory=dict, repr=False)
    family: Geometry | None = field(default=None, repr=False, metadata={"checked": False})
    rebuilt: Callable[[Geometry], Device] | None = field(default=None, repr=False)

    @property
    def comm(self) -> MPI.Comm:
        return self.mesh.comm

    @property
    def dim(self) -> int:
        return self.mesh.topology.dim

    def __str__(self) -> str:
        """The names that a scene may use: "BoxStack: 10 cells; regions film; surfaces top"."""
        cells = self.mesh.topology.index_map(self.dim).size_global
        regions, surfaces = (", ".join(sorted(of)) for of in (self.regions, self.surfaces))
        return (
            f"{self.source or 'Device'}: {cells} cells; regions {regions}; "
            f"surfaces {surfaces or 'none'}"
        )

    def cells_of(self, name: str) -> np.ndarray:
        """Local cells (owned and ghost) of a region."""
        return self.cells.find(self.regions[name])

    @property
    def facets_by_surface(self) -> dict[str, np.ndarray]:
        """Local facets (owned and ghost) of each surface, sorted; do not change the arrays."""
        tags = {name: (tag, *self.further.get(name, ())) for name, tag in self.surfaces.items()}
        return {name: self._facets_by_tags[several] for name, several in tags.items()}

    @cached_property
    def _facets_by_tags(self) -> FacetsByTags:
        return FacetsByTags(self.facets)

    def facets_of(self, name: str) -> np.ndarray:
        """Local facets (owned and ghost) of a surface, sorted; an array of the caller's own."""
        return self.facets_by_surface[name].copy()

    def owned_cells(self) -> int:
        """Number of cells this rank owns."""
        return self.mesh.topology.index_map(self.dim).size_local


class ReadingOptions(TypedDict, total=False):
    """Keywords of `device` that tell how a file is meshed and checked.

    Attributes
    ----------
    size
        Largest size of an element in metres, for .geo and STEP files.
    names
        For STEP files: new names, each with the name or names that ``dea mesh FILE`` shows, as in
        ``{"root": "surface_1", "top": ["surface_8", "surface_9"]}``.  Solids keep the names they
        have in the file; what has none is numbered.
    curved
        Whether the cells of .geo and STEP files follow curved surfaces; False gives straight cells.
    apart
        Whether parts may touch that share no nodes, such as the two sides of a crack.  They move
        independently of each other, and may run into each other.
    programs
        Whether a .geo file may run: it is a program, which can do all that its reader may.  By
        default it may, unless the environment variable DEA_FENICSX_NO_PROGRAMS is set.
    surfaces
        New surfaces by their places, as in ``{"root": OnPlane("x", 0.0)}`` or ``{"root": lambda x:
        x[0] < 1e-6}``: the facets of the boundary whose midpoints lie there, in metres.  A place is
        `OnPlane`, `InBox`, `OnCylinder` or `InCylinder`, also with ``&``, ``|`` and ``~`` between
        them, a function of midpoints of shape (3, n) that returns n truth values, or a list of such
        for their union.  `Interior` takes facets inside of the body.  A new surface may share
        facets with others; its name must be new.  Where no region is named either, all cells are
        the region ``"body"``.
    """

    size: float | None
    names: Names | None
    curved: bool
    apart: bool
    programs: bool | None
    surfaces: Mapping[str, Where | Sequence[Where]]


READING: dict[str, Any] = {
    "size": None, "names": None, "curved": True, "apart": False, "programs": None, "surfaces": {},
}  # fmt: skip
"""Values of the options that are left out."""


def device(
    source: Any,
    comm: MPI.Comm = MPI.COMM_WORLD,
    *,
    dim: int | None = None,
    unit: float | None = None,
    **options: Unpack[ReadingOptions],
) -> Device:
    """The device of a geometry or of a file: build or read its mesh, and distribute it.

    Parameters
    ----------
    source
        A geometry of `dea_fenicsx.geometry` (anything with ``build()``), or the path of a file:
        .msh and .geo with a named physical group for each part and each surface that the scene
        needs, or STEP (.step, .stp).  Only rank 0 builds or reads it, but of `HDEA`, `Tube` and
        other families of stacks, rolls, disks and spheres each rank makes its own part.  Groups
        of surfaces may overlap.  Prisms, pyramids and mixed cells are divided into tetrahedra (in
        the plane: triangles), and `Device.source` says so.
    comm
        The MPI communicator.
    dim
        Dimension that the cells must have, 2 or 3; any unless given.
    unit
        Length of the file's coordinate unit in metres (1e-3 for a mesh in millimetres); 1 unless
        given.  A STEP file states its own.
    options
        ``size``, ``names``, ``curved``, ``apart``, ``programs`` and ``surfaces``: see
        `ReadingOptions`.

    Raises
    ------
    InputError
        If the file is missing, gmsh cannot read or mesh it, cells lie in no named group or in two,
        facets of a group are faces of no cell, parts touch that are not joined, parts lie in one
        another, a flat mesh does not lie in a plane z = const., or a new surface has no facets or
        a name that is taken.
    """
    install_hook()
    label = str(source) if isinstance(source, str | os.PathLike) else type(source).__name__
    chosen = keywords("device", options, ReadingOptions, READING)
    check_wanted(chosen["surfaces"], "device")
    check_same(comm, {"dim": dim, "unit": unit, "surfaces": chosen["surfaces"]})
    unit, chosen["size"] = lengths(label, unit, chosen["size"])
    _check_options(dim, **{name: chosen[name] for name in ("curved", "apart", "programs")})
    if comes_in_parts(source, chosen):
        mesh, named, told = by_parts(source, comm, label, dim)
    else:
        mesh, named, told = by_gmsh(source, comm, label, dim, unit, chosen)
    extent = scale(mesh)
    if chosen["surfaces"]:
        named = named_by_place(mesh, extent * unit, named, chosen["surfaces"])
    return Device(
        mesh=mesh,
        length=extent * unit,
        source=told.source,
        quality=told.quality,
        **named._asdict(),
        **_of_family(source, lambda other: device(other, comm, dim=dim, unit=unit, **options)),
    )


def _of_family(source: Any, rebuilt: Callable[[Geometry], Device]) -> dict[str, Any]:
    """What a device knows of the family that made it; nothing if it comes from elsewhere."""
    made = is_family(source) and isinstance(source, Geometry)
    return {"family": source, "rebuilt": rebuilt} if made else {}


def read_gmsh(
    source: Any,
    comm: MPI.Comm = MPI.COMM_WORLD,
    *,
    dim: int | None = None,
    unit: float | None = None,
    **options: Unpack[ReadingOptions],
) -> Device:
    """The earlier name of `device`, which goes on working.

    Warns
    -----
    PendingDeprecationWarning
        Once for each place in a program; Python hides this kind of warning unless it is asked for.
    """
    warnings.warn(
        "read_gmsh is called dea_fenicsx.device now; both take the same arguments.",
        PendingDeprecationWarning, stacklevel=2,
    )  # fmt: skip
    return device(source, comm, dim=dim, unit=unit, **options)


def _check_options(dim: Any, **switches: Any) -> None:
    """Raise InputError if `dim` is no dimension, or a switch is neither True nor False."""
    if dim is not None and (not isinstance(dim, int | float | np.number) or dim not in (2, 3)):
        raise InputError(f"dim is {dim!r}, but must be 2 or 3; leave it out to take the cells'.")
    for name, value in switches.items():
        if not isinstance(value, bool | np.bool_) and not (name == "programs" and value is None):
            raise InputError(f"{name} is {value!r}, but must be True or False.")


def scale(mesh: Any) -> float:
    """Divide the coordinates by the largest extent, and return it.  Collective."""
    tdim = mesh.topology.dim
    for d in (tdim - 1, tdim):
        mesh.topology.create_connectivity(d, tdim)
    mesh.topology.create_connectivity(tdim, tdim - 1)
    x = mesh.geometry.x
    corners = mesh.comm.allgather((x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)))
    low, high = np.min([c[0] for c in corners], axis=0), np.max([c[1] for c in corners], axis=0)
    extent = float(np.max(high - low))
    x /= extent
    return extent


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
    facets = device.facets_by_surface[surface]
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


def group_size(device: Device, name: str) -> int:
    """Number of cells or facets in a named group; shared ones count on each rank.  Collective."""
    local = device.cells_of(name) if name in device.regions else device.facets_by_surface[name]
    return device.comm.allreduce(len(local), op=MPI.SUM)
