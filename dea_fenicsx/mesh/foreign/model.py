"""From a gmsh model of others to one that DOLFINx can read, with the same names."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from dea_fenicsx.mesh.foreign.arrays import Ints, PlainMesh, to_arrays
from dea_fenicsx.mesh.foreign.completion import complete
from dea_fenicsx.mesh.foreign.joining import check_joined
from dea_fenicsx.mesh.foreign.overlap import check_overlap
from dea_fenicsx.mesh.foreign.splitting import to_one_shape
from dea_fenicsx.support.errors import InputError

Groups = dict[str, tuple[int, int]]


class Checked(NamedTuple):
    """A model whose cells and facets were checked.

    Attributes
    ----------
    model
        The current gmsh model.
    groups
        Dimension and tag of each named group.
    further
        For each group of facets that overlaps another one, the tags of its other parts.
    notes
        What was changed, in a few words each.
    """

    model: Any
    groups: Groups
    further: dict[str, tuple[int, ...]]
    notes: tuple[str, ...]


def checked(
    model: Any, groups: Groups, dim: int, label: str, unit: float = 1.0, apart: bool = False
) -> Checked:
    """Replace the current gmsh model by one that can be computed on.

    Parameters
    ----------
    model
        The current gmsh model; it is removed, unless there is an error.
    groups
        Dimension and tag of each group of regions and of facets.
    dim
        Dimension of the cells, 2 or 3.
    label
        What to call the mesh in messages.
    unit
        Its unit of length in m.
    apart
        Whether parts may touch that are not joined; they may not lie in one another.

    Raises
    ------
    InputError
        If the mesh cannot be computed on.
    """
    import gmsh

    name = model.getCurrent()
    try:
        mesh = to_arrays(model, groups, dim, label)
        if dim == 2:
            _check_plane(mesh)
        complete(mesh)
        to_one_shape(mesh)
        check_overlap(mesh, unit, apart)
        if not apart:
            check_joined(mesh, unit)
    except InputError:
        raise
    except Exception as error:
        told = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        raise InputError(f"The mesh of {label} cannot be used ({told}).") from error
    model.remove()
    gmsh.model.add(name)
    groups, further = _write(mesh)
    return Checked(gmsh.model, groups, further, tuple(mesh.notes))


def _check_plane(mesh: PlainMesh) -> None:
    """Refuse a flat mesh that does not lie in a plane z = const."""
    x = mesh.points - mesh.points.mean(axis=0)
    extent = np.ptp(x, axis=0)
    flat = 1e-6 * extent.max()  # what seven digits in a file leave of a plane
    if extent[2] <= flat:
        return
    thin = [axis for axis, width in zip("xyz", extent, strict=True) if width <= flat]
    if thin:
        other = " and ".join(axis for axis in "xyz" if axis not in thin)
        lies = f"lies in a plane of {other}"
    elif np.linalg.svd(x, compute_uv=False)[-1] <= flat * np.sqrt(len(x)):
        lies = "lies in a plane that is tilted"
    else:
        lies = "is a curved surface in space, which has no plane"
    raise InputError(
        f"{mesh.label} {lies}; a flat mesh must lie in a plane z = const (for Axisymmetric with "
        "the radius along x and the axis along y), and a sheet in space must be drawn with its "
        "thickness."
    )


def _write(mesh: PlainMesh) -> tuple[Groups, dict[str, tuple[int, ...]]]:
    """Fill the empty current gmsh model; groups of facets that overlap are written in parts."""
    import gmsh

    model = gmsh.model
    ((kind, cells),) = mesh.cells.items()
    region = mesh.region[kind]
    free = np.ones(len(mesh.points), dtype=bool)
    numbers = _Numbers()
    for k, (name, tag) in enumerate(mesh.regions.items()):
        mine = cells[region == k]
        nodes = np.unique(mine)
        nodes = nodes[free[nodes]]
        free[nodes] = False
        model.addDiscreteEntity(mesh.dim, tag)
        model.mesh.addNodes(mesh.dim, tag, nodes + 1, mesh.points[nodes].ravel())
        model.mesh.addElementsByType(tag, kind, numbers.next(len(mine)), (mine + 1).ravel())
        model.addPhysicalGroup(mesh.dim, [tag], tag=tag, name=name)
    parts, further = _parts(mesh)
    for (name, tag), blocks in parts.items():
        model.addDiscreteEntity(mesh.dim - 1, tag)
        for kind, nodes in blocks.items():
            model.mesh.addElementsByType(tag, kind, numbers.next(len(nodes)), (nodes + 1).ravel())
        model.addPhysicalGroup(mesh.dim - 1, [tag], tag=tag, name=name)
    groups = {name: (mesh.dim, tag) for name, tag in mesh.regions.items()}
    groups |= {name: (mesh.dim - 1, tag) for name, tag in mesh.surfaces.items()}
    return groups, further


class _Numbers:
    """Numbers of elements, from 1 without gaps."""

    def __init__(self) -> None:
        self.used = 0

    def next(self, count: int) -> Ints:
        self.used += count
        return np.arange(self.used - count + 1, self.used + 1)


def _parts(
    mesh: PlainMesh,
) -> tuple[dict[tuple[str, int], dict[int, Ints]], dict[str, tuple[int, ...]]]:
    """Facets by the set of groups that they lie in, each with a tag of its own.

    DOLFINx keeps one tag for a facet.  So what several groups share is a part of its own, and a
    group is the union of its parts.  What lies in one group alone keeps the group's tag.
    """
    names = list(mesh.surfaces)
    found: dict[tuple[str, int], dict[int, Ints]] = {}
    tags: dict[tuple[int, ...], int] = {}
    free = max([0, *mesh.surfaces.values()]) + 1
    for kind in sorted({kind for blocks in mesh.facets.values() for kind in blocks}):
        members = [(k, mesh.facets[n][kind]) for k, n in enumerate(names) if kind in mesh.facets[n]]
        nodes = np.concatenate([rows for _, rows in members])
        group = np.concatenate([np.full(len(rows), k) for k, rows in members])
        _, first, inverse = np.unique(mesh.keys(nodes), return_index=True, return_inverse=True)
        inside = np.zeros((len(first), len(names)), dtype=bool)
        inside[inverse.reshape(-1), group] = True
        sets, which = np.unique(inside, axis=0, return_inverse=True)
        for k, row in enumerate(sets):
            chosen = tuple(int(i) for i in np.flatnonzero(row))
            if chosen not in tags:
                tags[chosen] = mesh.surfaces[names[chosen[0]]] if len(chosen) == 1 else free
                free += len(chosen) > 1
            name = " and ".join(names[i] for i in chosen)
            rows = nodes[np.sort(first[which.reshape(-1) == k])]
            found.setdefault((name, tags[chosen]), {})[kind] = rows
    further = {
        name: tuple(tag for chosen, tag in tags.items() if len(chosen) > 1 and k in chosen)
        for k, name in enumerate(names)
    }
    return found, {name: rest for name, rest in further.items() if rest}
