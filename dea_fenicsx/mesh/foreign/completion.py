"""Second-order elements without nodes inside their faces get them, on the same curved shape.

gmsh calls them incomplete: 8 nodes in a quadrilateral, 20 in a brick, 15 in a prism, 13 in a
pyramid.  Their shape functions lie in the space of the complete ones.  So the complete element with
its new nodes in the right places is the same body, to rounding.
"""

from __future__ import annotations

import numpy as np

from dea_fenicsx.mesh.foreign.arrays import (
    CELL_FACES,
    ElementType,
    Ints,
    PlainMesh,
    element_type,
)
from dea_fenicsx.support.cell_types import GMSH, HEX, PRISM, PYRAMID, QUAD, gmsh_number

COMPLETE = {
    number: gmsh_number(cell.shape, 2)
    for number, cell in GMSH.items() if cell.order == 2 and not cell.complete
}  # fmt: skip
"""gmsh's number of the complete type of each incomplete one of second order."""

_PLURALS = {QUAD: "quadrilaterals", HEX: "bricks", PRISM: "prisms", PYRAMID: "pyramids"}


def complete(mesh: PlainMesh) -> None:
    """Add the missing nodes of incomplete second-order elements, in place."""
    old = [number for number in mesh.cells if number in COMPLETE]
    added = _Points(mesh)
    for number in old:
        table = _completed(mesh, added, number, mesh.cells.pop(number))
        region = mesh.region.pop(number)
        new = COMPLETE[number]
        if new in mesh.cells:
            table = np.concatenate([mesh.cells[new], table])
            region = np.concatenate([mesh.region[new], region])
        mesh.cells[new], mesh.region[new] = table, region
    for blocks in mesh.facets.values():
        for number in [n for n in blocks if n in COMPLETE]:
            table, new = _completed(mesh, added, number, blocks.pop(number)), COMPLETE[number]
            blocks[new] = np.concatenate([blocks[new], table]) if new in blocks else table
    added.store()
    if old:
        names = " and ".join(f"{GMSH[n].nodes}-node {_PLURALS[GMSH[n].shape]}" for n in old)
        mesh.notes.append(f"{names} completed")


class _Points:
    """New points in the middle of sets of corners; a set that comes again has the same point."""

    def __init__(self, mesh: PlainMesh) -> None:
        self.mesh = mesh
        self.keys = np.empty(0, dtype=np.uint64)
        self.points = np.empty((0, 3))

    def number(self, corners: Ints, points: np.ndarray) -> Ints:
        """Number of the point of each row of corners."""
        keys = self.mesh.keys(corners)
        known, first = np.unique(keys, return_index=True)
        new = ~np.isin(known, self.keys)
        self.keys = np.concatenate([self.keys, known[new]])
        self.points = np.concatenate([self.points, points[first[new]]])
        order = np.argsort(self.keys)
        return len(self.mesh.points) + order[np.searchsorted(self.keys[order], keys)]

    def store(self) -> None:
        self.mesh.points = np.concatenate([self.mesh.points, self.points])


def _completed(mesh: PlainMesh, added: _Points, number: int, nodes: Ints) -> Ints:
    """The same elements as rows of nodes of the complete type."""
    old, new = element_type(number), element_type(COMPLETE[number])
    middles: list[tuple[int, ...]] = [f for f in CELL_FACES[old.shape] if len(f) == 4]
    middles += [tuple(range(old.corners))] if old.shape in (QUAD, HEX) else []
    table = np.full((len(nodes), len(new.local)), -1, dtype=np.int64)
    for k, local in enumerate(new.local):
        far = np.abs(old.local - local).max(axis=1)
        if far.min() < 1e-9:
            table[:, k] = nodes[:, int(np.argmin(far))]
    for corners in middles:
        place = new.node_at(corners)
        assert place is not None
        table[:, place] = added.number(nodes[:, list(corners)], _middle(mesh, old, nodes, corners))
    return table


def _middle(
    mesh: PlainMesh, kind: ElementType, nodes: Ints, corners: tuple[int, ...]
) -> np.ndarray:
    """Where an incomplete element has the middle of a face of four corners, or of a brick.

    The serendipity functions there are -1/4 at each corner, and 1/2 at each of the four middle
    nodes of a face, or 1/4 at each of the twelve of a brick.
    """
    pairs = [(a, b) for i, a in enumerate(corners) for b in corners[i + 1 :]]
    edges = [m for pair in pairs if (m := kind.node_at(pair)) is not None]
    assert len(edges) in (4, 12)
    x = mesh.points
    return (2 * x[nodes[:, edges]].mean(axis=1) if len(edges) == 4
            else 3 * x[nodes[:, edges]].mean(axis=1)) - (
        x[nodes[:, list(corners)]].mean(axis=1) * (1 if len(corners) == 4 else 2))  # fmt: skip
