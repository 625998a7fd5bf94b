"""The outside of a device as triangles between nodes, thinned, with its steps and fields.

Triangles join nodes, so that the values of a step need no interpolation: they are those of the
nodes that were kept.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dea_fenicsx.pictures.faces import faces_of
from dea_fenicsx.pictures.revolved import drawn
from dea_fenicsx.pictures.stored import DISPLACEMENT, Stored, stored_step
from dea_fenicsx.results.reading import frame_times
from dea_fenicsx.results.reading_surfaces import Facets

MOST_POINTS_OF_REPORT = 20_000
"""Points to which the surface of a device is thinned."""

MOST_BYTES_OF_REPORT = 20_000_000
"""Bytes of all steps in single precision, beyond which steps are left out evenly."""

_RING = [(k, 4 + k, 8) for k in range(4)] + [(4 + k, (k + 1) % 4, 8) for k in range(4)]
TRIANGLES_OF_CELLS = {
    28: _RING, 9: [(0, 1, 2), (0, 2, 3)],
    22: [(0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)], 5: [(0, 1, 2)],
}  # fmt: skip
"""Of each of VTK's flat cells: triangles between its nodes."""


@dataclass(frozen=True)
class Skin:
    """The outside of a device in some steps.

    Attributes
    ----------
    points : ndarray (n, 3), undeformed, m
    triangles : ndarray (m, 3)
    flat : whether the device lies in a plane
    steps : numbers of the steps on disk that are there
    times : time of each
    moved : of each step the displacements, shape (n, 3), m
    fields : of each field, by the name of what is shown, the values of each step
    lines : ndarray (k, 3), the nodes that `wanted` asked for, undeformed, m
    line_moved : of each step their displacements, shape (k, 3), m
    """

    points: np.ndarray
    triangles: np.ndarray
    flat: bool
    steps: list[int]
    times: list[float]
    moved: list[np.ndarray] = field(default_factory=list)
    fields: dict[str, list[np.ndarray]] = field(default_factory=dict)
    lines: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    line_moved: list[np.ndarray] = field(default_factory=list)


def skin_of(
    folder: Path, fields: Sequence[str], axes: tuple[str, str, str], wanted: np.ndarray
) -> Skin:
    """The outside of a run's device with some fields at its steps on disk.

    Parameters
    ----------
    folder, fields
        The run, and the names of fields or of their components.
    axes
        Names of the axes of the run's fields.
    wanted
        Numbers of nodes in fields.xdmf whose places and displacements are wanted too.
    """
    first = DISPLACEMENT if not fields else fields[0]
    last = drawn(stored_step(folder, -1, first, axes))
    ids, triangles = _thinned(last)
    origin = last.origin
    where = wanted if origin is None else _first_of_each(origin)[wanted]
    kept, asked = _Rows(ids, last.size), _Rows(where, last.size)
    times = frame_times(folder)
    each = 4 * (len(ids) * (3 + len(fields)) + 3 * len(wanted))
    steps = _chosen(len(times), max(2, MOST_BYTES_OF_REPORT // max(each, 1)))
    found = Skin(kept.of(last.points), triangles, last.flat, steps, [times[k] for k in steps],
                 lines=asked.of(last.points))  # fmt: skip
    for step in steps:
        now = drawn(stored_step(folder, step, first, axes))
        found.moved.append(kept.of(now.displacements))
        found.line_moved.append(asked.of(now.displacements))
        for name in fields:
            values, shown, nodal = now.values(name, axes)
            values = values if nodal else _at_nodes(now, values)
            found.fields.setdefault(shown, []).append(values[ids])
    return found


class _Rows:
    """Some nodes in an order, of which a step tells numbers by one truth value for each node."""

    def __init__(self, nodes: np.ndarray, size: int) -> None:
        self._kept = np.zeros(size, dtype=bool)
        self._kept[nodes] = True
        self._order = (np.cumsum(self._kept) - 1)[nodes]

    def of(self, read: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """What a function reads for these nodes, in their order."""
        return read(self._kept)[self._order]


def _chosen(count: int, most: int) -> list[int]:
    """Numbers of at most so many steps, evenly chosen, the first and the last among them."""
    if count <= most:
        return list(range(count))
    return sorted({int(k) for k in np.linspace(0, count - 1, most).round()})


def _first_of_each(origin: np.ndarray) -> np.ndarray:
    """For each number that nodes had before a split, one of the nodes."""
    found = np.zeros(int(origin.max(initial=-1)) + 1, dtype=np.int64)
    found[origin[::-1]] = np.arange(len(origin))[::-1]
    return found


def _at_nodes(stored: Stored, values: np.ndarray) -> np.ndarray:
    """Means at the nodes of values of cells; for runs without fields at nodes."""
    known = np.isfinite(values)
    filled = np.where(known, values, 0.0)
    counts, sums = np.zeros(stored.size), np.zeros(stored.size)
    for begin, table in stored.tables():
        mine, nodes = slice(begin, begin + len(table)), table.ravel()
        each = table.shape[1]
        counts += np.bincount(nodes, np.repeat(known[mine], each), minlength=stored.size)
        sums += np.bincount(nodes, np.repeat(filled[mine], each), minlength=stored.size)
    return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)


def _thinned(stored: Stored) -> tuple[np.ndarray, np.ndarray]:
    """Nodes that are kept, and triangles between them by their place among these."""
    faces = faces_of(stored)
    ids = np.flatnonzero(faces.kept)
    table = ids[faces.nodes[faces.seen]]
    corners = faces.corners
    simple = TRIANGLES_OF_CELLS[9] if corners == 4 else TRIANGLES_OF_CELLS[5]
    many = len(np.unique(table)) > MOST_POINTS_OF_REPORT
    kind = {(4, 9): 28, (3, 6): 22}.get((corners, table.shape[1]))
    local = simple if many or kind is None else TRIANGLES_OF_CELLS[kind]
    triangles = table[:, np.array(local)].reshape(-1, 3)
    kept, numbers = np.unique(triangles.ravel(), return_inverse=True)
    triangles = numbers.reshape(-1, 3)
    if len(kept) > MOST_POINTS_OF_REPORT:
        points = faces.points[np.searchsorted(ids, kept)]
        kept, triangles = _decimated(points, triangles, kept)
    return kept, triangles


def _decimated(
    points: np.ndarray, triangles: np.ndarray, ids: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Fewer triangles, whose corners are some of the points; flat places lose most."""
    import pyvista

    rows = np.column_stack([np.full(len(triangles), 3), triangles]).ravel()
    mesh = pyvista.PolyData(points, rows)
    mesh.point_data["kept"] = ids
    for _ in range(4):
        reduction = 1 - 0.95 * MOST_POINTS_OF_REPORT / mesh.n_points
        mesh = mesh.decimate_pro(min(0.99, reduction), preserve_topology=False)
        used, numbers = np.unique(mesh.faces.reshape(-1, 4)[:, 1:], return_inverse=True)
        if len(used) <= MOST_POINTS_OF_REPORT:
            break
    return np.asarray(mesh.point_data["kept"])[used].astype(np.int64), numbers.reshape(-1, 3)


def outline(surfaces: Mapping[str, Facets]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Lines around surfaces.

    Parameters
    ----------
    surfaces
        The facets of each surface.

    Returns
    -------
    nodes, lines
        Numbers of all nodes that are needed; and of each surface its lines as pairs of places
        among these.
    """
    found = {name: _border(facets) for name, facets in surfaces.items()}
    parts = [pairs.ravel() for pairs in found.values()]
    nodes = np.unique(np.concatenate(parts)) if parts else np.empty(0, dtype=np.int64)
    return nodes, {name: np.searchsorted(nodes, pairs) for name, pairs in found.items()}


def _border(facets: Facets) -> np.ndarray:
    """Pairs of nodes on the edges that one facet alone has; of a flat device, all edges."""
    table = facets.nodes
    if facets.are_lines:
        return table if table.shape[1] == 2 else np.vstack([table[:, [0, 2]], table[:, [2, 1]]])
    corners = 4 if table.shape[1] in (4, 9) else 3
    ends = np.array([(k, (k + 1) % corners) for k in range(corners)])
    edges = table[:, ends].reshape(-1, 2)
    ordered = np.sort(edges, axis=1)
    _, inverse, counts = np.unique(ordered, axis=0, return_inverse=True, return_counts=True)
    alone = counts[inverse.ravel()] == 1
    if table.shape[1] == corners:
        return edges[alone]
    middles = table[:, corners : 2 * corners].reshape(-1)[alone]
    first, second = edges[alone].T
    return np.vstack([np.column_stack([first, middles]), np.column_stack([middles, second])])
