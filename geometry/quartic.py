"""The structured mesh of a family with cells of fourth order, closer to curved surfaces."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from dea_fenicsx.support.later import Later

from ._check import HigherOrder
from ._structured import Floats, Ints, StructuredMesh, compact
from .base import Geometry, OfLattice

spatial = Later("scipy.spatial")

QUARTIC_ORDER = 4
"""Degree of the geometry of these meshes."""

CURVED = 1e-9
"""Distance from straight cells that counts as a curve, relative to the device."""


def quartic(family: Geometry) -> StructuredMesh:
    """The mesh of a family with cells of fourth order.

    Nodes of curved cells lie where the family has them: on its own cells of fourth order, or else
    on a mesh of half the size.  If neither holds the nodes of this mesh, cells keep their shape.
    """
    mesh = family.mesh()
    if mesh.order == 1 or not is_curved(mesh):
        return _elevated(mesh)
    own = _of_family(family, mesh)
    if own is not None:
        return own
    found = _elevated(mesh)
    exact = family.refine(2).mesh().points
    if len(exact) == len(found.points):
        room = CURVED * float(np.ptp(exact, axis=0).max())
        far, which = spatial.cKDTree(exact).query(found.points)
        near, _ = spatial.cKDTree(exact).query(mesh.points)
        if near.max() < room and len(np.unique(which)) == len(which):
            found.points = exact[which]
    return found


def some_of_both(
    family: OfLattice, numbers: Ints, extent: float
) -> tuple[StructuredMesh, StructuredMesh] | None:
    """Some cells of a family as they are, and the same ones with fourth order; without groups.

    Parameters
    ----------
    family
        The family.
    numbers
        Of the cells in the order of the regions.
    extent
        Of the whole device in metres.

    Returns
    -------
    tuple of two StructuredMesh, or None
        None if the cells of fourth order do not go through the nodes of the others.
    """
    made, higher = family.lattice().some(numbers), _higher(family)
    assert isinstance(higher, OfLattice)
    found = higher.lattice().some(numbers)
    return (made, found) if _goes_through(found, made, extent) else None


def _of_family(family: Geometry, mesh: StructuredMesh) -> StructuredMesh | None:
    """The family's own mesh of fourth order, or None if it has none that goes through `mesh`."""
    found = family.mesh_of_order(QUARTIC_ORDER)
    if found is None and (higher := _higher(family)) is not None:
        found = higher.mesh()
    if found is None or found.order != QUARTIC_ORDER or len(found.cells) != len(mesh.cells):
        return None
    return found if _goes_through(found, mesh, float(np.ptp(mesh.points, axis=0).max())) else None


def _goes_through(found: StructuredMesh, mesh: StructuredMesh, extent: float) -> bool:
    """Whether cells of fourth order have the nodes of other ones, in a device of some extent."""
    off = found.points[_thinned(found.cells, mesh.order)] - mesh.points[mesh.cells]
    return bool(np.abs(off).max(initial=0.0) < CURVED * extent)


def _higher(family: Geometry) -> Geometry | None:
    """A family whose cells are of fourth order, also where it lies around another one."""
    made: Any = family
    changed: dict[str, Any] = {}
    names = [one.name for one in fields(made)] if is_dataclass(made) else []
    for name in names:
        given = getattr(made, name)
        if name == "order":
            changed["order"] = HigherOrder(QUARTIC_ORDER)
        elif isinstance(given, Geometry) and (inner := _higher(given)) is not None:
            changed[name] = inner
    return replace(made, **changed) if changed else None


def of_order(mesh: StructuredMesh, order: int) -> StructuredMesh:
    """A mesh of fourth order with each second or fourth of its nodes along each axis."""
    cells, used = compact(_thinned(mesh.cells, order))
    number = np.full(len(mesh.points), -1, dtype=np.int64)
    number[used] = np.arange(len(used))
    facets = {name: number[_thinned(faces, order)] for name, faces in mesh.facets.items()}
    return StructuredMesh(mesh.points[used], cells, dict(mesh.regions), facets)


def _thinned(blocks: Ints, order: int) -> Ints:
    """Of blocks of nodes of fourth order those of a lower order."""
    for axis in range(1, blocks.ndim):
        kept = np.arange(0, QUARTIC_ORDER + 1, QUARTIC_ORDER // order)
        blocks = np.take(blocks, kept, axis=axis)
    return blocks


def is_curved(mesh: StructuredMesh, extent: float | None = None) -> bool:
    """Whether the nodes of cells of second order lie elsewhere than in straight cells.

    ``extent`` is that of the whole device in metres, which is the mesh's own by default.
    """
    if extent is None:
        extent = float(np.ptp(mesh.points, axis=0).max())
    straight = np.einsum(
        "lk,mkx->mlx", _shares(mesh.dimension, mesh.order), mesh.points[mesh.corners(mesh.cells)]
    )
    there = mesh.points[mesh.cells.reshape(len(mesh.cells), straight.shape[1])]
    return bool(np.abs(straight - there).max(initial=0.0) > CURVED * extent)


def _shares(dim: int, order: int) -> Floats:
    """Values of the multilinear functions of the corners at the nodes, shape (nodes, corners)."""
    nodes = np.array(list(product(np.arange(order + 1) / order, repeat=dim)))
    ends = np.array(list(product((0, 1), repeat=dim)))
    factors = np.where(ends[None] == 1, nodes[:, None], 1 - nodes[:, None])
    return np.asarray(np.prod(factors, axis=2))


def lagrange(order: int, places: Floats) -> Floats:
    """Values of the Lagrange polynomials of equal steps on [0, 1], shape (places, order + 1)."""
    nodes = np.arange(order + 1) / order
    found = [
        np.prod([(places - b) / (a - b) for b in nodes if b != a], axis=0) for a in nodes
    ]  # fmt: skip
    return np.stack(found, axis=-1)


def _elevated(mesh: StructuredMesh) -> StructuredMesh:
    """The mesh in cells of fourth order, of the same shape.

    A node is known by the corners of its cell and its shares in them, so that cells side by side
    have the same nodes, whatever the order of their axes.
    """
    blocks = [mesh.cells, *mesh.facets.values()]
    keys = [_keys(mesh, block) for block in blocks]
    widest = keys[0].shape[-1]
    padded = [
        np.pad(k, ((0, 0), (0, 0), (widest - k.shape[-1], 0)), constant_values=-1) for k in keys
    ]  # fmt: skip
    rows = np.concatenate([k.reshape(-1, widest) for k in padded])
    unique, first, number = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    number = number.ravel()
    line = lagrange(mesh.order, np.arange(QUARTIC_ORDER + 1) / QUARTIC_ORDER)
    places = mesh.points[mesh.cells]
    for axis in range(1, mesh.cells.ndim):
        places = np.moveaxis(np.tensordot(line, places, axes=(1, axis)), 0, axis)
    points = np.zeros((len(unique), 3))
    count = keys[0].shape[0] * keys[0].shape[1]
    points[number[:count]] = places.reshape(-1, 3)
    shaped, at = [], 0
    for block, key in zip(blocks, keys, strict=True):
        size = key.shape[0] * key.shape[1]
        nodes = (QUARTIC_ORDER + 1,) * (block.ndim - 1)
        shaped.append(number[at : at + size].reshape(len(block), *nodes))
        at += size
    return StructuredMesh(
        points, shaped[0], dict(mesh.regions), dict(zip(mesh.facets, shaped[1:], strict=True))
    )


def _keys(mesh: StructuredMesh, block: Ints) -> Ints:
    """For each node of fourth order of each block its corners with its shares, sorted."""
    dim = block.ndim - 1
    shares = np.rint(_shares(dim, QUARTIC_ORDER) * QUARTIC_ORDER**dim).astype(np.int64)
    # shares of nodes on a side are the same seen from the side and from the cell
    shares *= QUARTIC_ORDER ** (mesh.dimension - dim)
    corners = mesh.corners(block)
    keys = corners[:, None, :] * (QUARTIC_ORDER**mesh.dimension + 1) + shares[None]
    return np.sort(np.where(shares[None] > 0, keys, -1), axis=2)
