"""The outer faces of a grid whose nodes are split at the faces between regions.

VTK takes each face of a split grid at which two regions meet for two outer ones.  These faces
cannot be seen, but to draw them takes time and memory.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dea_fenicsx.results.surface_names import ORIGIN

_HEX = ((0, 4, 7, 3, 16, 15, 19, 11, 20), (1, 2, 6, 5, 9, 18, 13, 17, 21),
        (0, 1, 5, 4, 8, 17, 12, 16, 22), (3, 7, 6, 2, 19, 14, 18, 10, 23),
        (0, 3, 2, 1, 11, 10, 9, 8, 24), (4, 5, 6, 7, 12, 13, 14, 15, 25))  # fmt: skip
_TET = ((0, 1, 3, 4, 8, 7), (1, 2, 3, 5, 9, 8), (2, 0, 3, 6, 7, 9), (0, 2, 1, 6, 5, 4))

FACES = {
    29: (28, 4, np.array(_HEX)), 12: (9, 4, np.array(_HEX)[:, :4]),
    24: (22, 3, np.array(_TET)), 10: (5, 3, np.array(_TET)[:, :3]),
}  # fmt: skip
"""Of each of VTK's cells in space: the kind of its faces, their corners, and their nodes."""


def is_split(mesh: Any) -> bool:
    """Whether a mesh is a split grid of cells in space, as `read_frame` gives it."""
    kinds = getattr(mesh, "celltypes", None)
    return (
        kinds is not None and ORIGIN in mesh.point_data and len(kinds) > 0 and kinds[0] in FACES
    )


def outer_faces(grid: Any) -> Any:
    """The outer faces of a split grid as cells in space, with the grid's nodes and fields."""
    import pyvista

    kind, corners, table = FACES[int(grid.celltypes[0])]
    cells = grid.cells_dict[int(grid.celltypes[0])]
    faces = cells[:, table].reshape(-1, table.shape[1])
    before = np.sort(np.asarray(grid.point_data[ORIGIN])[faces[:, :corners]], axis=1)
    order = np.lexsort(before.T)
    ordered = before[order]
    same = (ordered[1:] == ordered[:-1]).all(axis=1)
    inner = np.zeros(len(faces), dtype=bool)
    inner[order[1:][same]] = inner[order[:-1][same]] = True
    kept = np.flatnonzero(~inner)
    faces = faces[kept]
    nodes, numbers = np.unique(faces.ravel(), return_inverse=True)
    rows = np.column_stack([np.full(len(faces), faces.shape[1]), numbers.reshape(faces.shape)])
    kinds = np.full(len(faces), kind, dtype=np.uint8)
    found = pyvista.UnstructuredGrid(rows.ravel(), kinds, np.asarray(grid.points)[nodes])
    for name, values in grid.point_data.items():
        found.point_data[name] = np.asarray(values)[nodes]
    for name, values in grid.cell_data.items():
        found.cell_data[name] = np.asarray(values)[kept // len(table)]
    return found
