"""Names for facets by their places, given once, while a mesh becomes a device.

The rank that owns a facet judges its midpoint and tells the others, so that all ranks agree; from
then on only the names count.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import basix
import numpy as np
from mpi4py import MPI

from dea_fenicsx.mesh.places import Interior, Place, PlaceNear, judges
from dea_fenicsx.support import compat
from dea_fenicsx.support.agreement import together
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import check_declared, shown
from dea_fenicsx.support.validation import known

Where = Place | Interior | Callable[[np.ndarray], np.ndarray]
"""Where a surface is: a place, facets inside of the body, or a function of midpoints in m."""

TRIED_ALONE = 5
"""Number of midpoints that a function judges a second time, each by itself."""


class Named(NamedTuple):
    """The named groups of a mesh.

    Attributes
    ----------
    cells, regions
        Tags of the cells, and the tag of each region.
    facets, surfaces, further
        Tags of the facets or None, the tag of each surface, and its further tags, as in `Device`.
    """

    cells: Any
    regions: dict[str, int]
    facets: Any
    surfaces: dict[str, int]
    further: dict[str, tuple[int, ...]]


def check_wanted(wanted: Any, what: str) -> None:
    """Raise InputError unless `wanted` names places in a dictionary.

    Parameters
    ----------
    wanted
        What the user gives as ``surfaces=``.
    what
        The function that takes it, for messages.
    """
    if not isinstance(wanted, Mapping):
        raise InputError(
            f"surfaces= of {what} is {shown(wanted)}, but must be a dictionary of names, each with "
            'a place, as in {"root": OnPlane("x", 0.0)}.'
        )
    for name, where in wanted.items():
        if not isinstance(name, str) or not name:
            raise InputError(f"surfaces= of {what} has the name {shown(name)}, but must have text.")
        for one in where if isinstance(where, list | tuple) and where else [where]:
            if not (isinstance(one, Interior) or judges(one)):
                raise InputError(
                    f"The surface {name!r} is given as {shown(one)}, but must be given as a "
                    "place such as OnPlane, InBox, OnCylinder or InCylinder, as Interior(...), as "
                    "a function of midpoints, or as a list of them."
                )
            check_declared(one)
            if isinstance(one, Interior):
                one.check()


def named_by_place(
    mesh: Any, length: float, named: Named, wanted: Mapping[str, Where | Sequence[Where]]
) -> Named:
    """The groups of a mesh together with surfaces that are given by their places.  Collective.

    A new surface may share facets with others; each of them then has the facets.

    Parameters
    ----------
    mesh
        The mesh, with coordinates in units of `length`.
    length
        The unit of length in m: the largest extent of the mesh.
    named
        The groups that it has already.
    wanted
        The new surfaces.

    Raises
    ------
    InputError
        If a name is taken, a place finds no facet, or a function fails or returns no truth values.
    """
    facets = _Facets(mesh, length, named)
    masks = {name: facets.at(name, where) for name, where in wanted.items()}
    return _with_masks(mesh, named, masks)


class _Facets:
    """The facets of a mesh, each with what is needed to judge it.

    Parameters
    ----------
    mesh, length, named
        As of `named_by_place`.
    """

    def __init__(self, mesh: Any, length: float, named: Named) -> None:
        self._mesh, self._length, self._named = mesh, length, named
        topology, dim = mesh.topology, mesh.topology.dim
        self._map = topology.index_map(dim - 1)
        self._owned = self._map.size_local
        outer = np.zeros(self._owned, dtype=bool)
        exterior = dolfinx.mesh.exterior_facet_indices(topology)
        outer[exterior[exterior < self._owned]] = True
        self._outer = outer
        self._x = _midpoints(mesh)[:, : self._owned] * length

    def at(self, name: str, where: Where | Sequence[Where]) -> np.ndarray:
        """Mask of the local facets at one place or several, ghosts included.  Collective."""
        comm = self._mesh.comm
        if name in self._named.surfaces or name in self._named.regions:
            raise InputError(
                f"The mesh has a group named {name!r} already; give the surface another name."
            )
        found = np.zeros(self._owned, dtype=bool)
        several: Sequence[Any] = where if isinstance(where, list | tuple) else [where]
        for one in several:
            mine = together(comm, partial(self._judge, name, one), f"The place of {name!r}")
            if not comm.allreduce(bool(mine.any()), op=MPI.LOR):
                raise InputError(f"The surface {name!r} finds no facet{self._hint(one)}.")
            found |= mine
        return self._shared(found)

    def _judge(self, name: str, where: Where) -> np.ndarray:
        """Mask of the owned facets at one place."""
        candidates, label = self._outer, f"The function of the surface {name!r}"
        if isinstance(where, Interior):
            candidates, where = self._inside(name, where), where.where or _everywhere
            label += " (where=)"
        found = np.zeros(self._owned, dtype=bool)
        places = np.flatnonzero(candidates)
        x = self._x[:, places]
        if isinstance(where, Place):
            where.check(self._mesh.geometry.dim)
            found[places] = where.holds(x, self._length)
        elif len(places):
            found[places] = _judged(label, where, x)
        return found

    def _inside(self, name: str, where: Interior) -> np.ndarray:
        """Mask of the owned facets that two cells share, of two regions where these are named."""
        if where.between is None:
            return ~self._outer
        regions = self._named.regions
        for region in where.between:
            known(region, regions, f"region beside the surface {name!r}")
        topology = self._mesh.topology
        imap = topology.index_map(topology.dim)
        tags = np.full(imap.size_local + imap.num_ghosts, -1)
        tags[self._named.cells.indices] = self._named.cells.values
        link = topology.connectivity(topology.dim - 1, topology.dim)
        pair = sorted(regions[region] for region in where.between)
        found = np.zeros(self._owned, dtype=bool)
        for facet in np.flatnonzero(~self._outer):
            found[facet] = sorted(tags[link.links(facet)]) == pair
        return found

    def _hint(self, where: Where) -> str:
        """How near the nearest facet is, where the place has a distance.  Collective."""
        inside = isinstance(where, Interior)
        place = where.where if isinstance(where, Interior) else where
        kind = "inside of the body" if inside else "on the boundary"
        if not isinstance(place, PlaceNear):
            given = "a place (where=)" if inside else "a place"
            return f" {kind}; give {given} in metres at which midpoints of facets lie"
        x = self._x[:, ~self._outer if inside else self._outer]
        mine = float(np.min(place.distance(x), initial=np.inf))
        nearest = self._mesh.comm.allreduce(mine, op=MPI.MIN)
        return (
            f" {kind}: the nearest midpoint is {nearest:.3g} m away from the {type(place).__name__}"
            "; move it there in metres, or give a tolerance"
        )

    def _shared(self, owned: np.ndarray) -> np.ndarray:
        """A mask of owned facets, with what the owners say of ghosts.  Collective."""
        vector = dolfinx.la.vector(self._map, 1, dtype=np.float64)
        vector.array[: self._owned] = owned
        vector.scatter_forward()
        return np.asarray(vector.array > 0.5)


def _everywhere(x: np.ndarray) -> np.ndarray:
    return np.ones(x.shape[1], dtype=bool)


def _judged(label: str, where: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    """What a user's function says of midpoints, after a check that it judges each by itself."""
    found = _called(label, where, x)
    for k in np.unique(np.linspace(0, x.shape[1] - 1, TRIED_ALONE).astype(int)):
        if _called(label, where, x[:, k : k + 1])[0] != found[k]:
            raise InputError(
                f"{label} judges a midpoint otherwise when it sees "
                "others beside it, so that the surface would depend on the number of ranks; let "
                "it compare coordinates with numbers in metres."
            )
    return found


def _called(label: str, where: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    try:
        found = np.asarray(where(x.copy()))
    except Exception as error:  # the function is the user's own
        told = " ".join(str(error).split()).rstrip(".")
        raise InputError(
            f"{label} fails ({type(error).__name__}: {told}); it "
            "takes midpoints of facets in m, of shape (3, n), and returns n truth values."
        ) from error
    if found.dtype != bool or found.shape != (x.shape[1],):
        raise InputError(
            f"{label} returns {found.dtype} of shape {found.shape} "
            f"for {x.shape[1]} midpoints, but must return as many truth values, as in "
            "lambda x: x[0] < 1e-6."
        )
    return found


def _midpoints(mesh: Any) -> np.ndarray:
    """Midpoints of all local facets by the map of one of their cells, shape (3, facets)."""
    topology, dim = mesh.topology, mesh.topology.dim
    kind = getattr(basix.CellType, topology.cell_name())
    corners = basix.geometry(kind)
    references = np.array([corners[list(f)].mean(axis=0) for f in basix.topology(kind)[dim - 1]])
    shapes = compat.coordinate_element(mesh).tabulate(0, references)[0, :, :, 0]
    link = topology.connectivity(dim, dim - 1)
    table = link.array.reshape(link.num_nodes, len(references))
    imap = topology.index_map(dim - 1)
    found = np.full((imap.size_local + imap.num_ghosts, 3), np.nan)
    nodes = mesh.geometry.x[compat.geometry_dofmap(mesh)]
    for k in range(len(references)):
        found[table[:, k]] = np.einsum("n,cnd->cd", shapes[k], nodes[: len(table)])
    return found.T


def _with_masks(mesh: Any, named: Named, masks: Mapping[str, np.ndarray]) -> Named:
    """Enter new groups, given by masks over the local facets, into the tags.  Collective.

    Each facet has one tag, so facets that are in several groups have a tag of their own, which all
    of these groups have.
    """
    topology, comm = mesh.topology, mesh.comm
    dim = topology.dim - 1
    imap = topology.index_map(dim)
    tags = np.full(imap.size_local + imap.num_ghosts, -1, dtype=np.int32)
    if named.facets is not None:
        tags[named.facets.indices] = named.facets.values
    known_tags = [*named.surfaces.values(), *(t for ts in named.further.values() for t in ts)]
    groups = {n: [tag, *named.further.get(n, ())] for n, tag in named.surfaces.items()}
    largest = comm.allreduce(int(np.max(tags, initial=0)), op=MPI.MAX)
    new = max([largest, *known_tags]) + 1
    for name, mask in masks.items():
        shared = sorted(set().union(*comm.allgather(set(tags[mask & (tags >= 0)].tolist()))))
        tags[mask & (tags < 0)] = new
        groups[name] = [new]
        new += 1
        for old in shared:
            tags[mask & (tags == old)] = new
            for tagged in groups.values():
                if old in tagged:
                    tagged.append(new)
            groups[name].append(new)
            new += 1
    indices = np.flatnonzero(tags >= 0).astype(np.int32)
    return named._replace(
        facets=dolfinx.mesh.meshtags(mesh, dim, indices, tags[indices]),
        surfaces={name: tagged[0] for name, tagged in groups.items()},
        further={name: tuple(tagged[1:]) for name, tagged in groups.items() if len(tagged) > 1},
    )
