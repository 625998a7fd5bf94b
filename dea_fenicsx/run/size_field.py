"""The sizes that cells would need for an accuracy, as a background field of gmsh."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dea_fenicsx.gradients.discretisation import DiscretisationError, not_seen
from dea_fenicsx.mesh.device import Device
from dea_fenicsx.results.file_order import FileOrder
from dea_fenicsx.results.spread import Spread, serving
from dea_fenicsx.support import compat
from dea_fenicsx.support.cell_types import HEX, QUAD, TET, TRIANGLE

SIZES = "sizes.pos"
"""Name of the file in a results folder."""

LEAST_SHARE = 1 / 16
"""Least new size of a cell over its present one; a search for sizes goes in steps."""

IN_GMSH: dict[str, tuple[str, tuple[int, ...]]] = {
    TRIANGLE: ("ST", (0, 1, 2)), QUAD: ("SQ", (0, 1, 3, 2)), TET: ("SS", (0, 1, 2, 3)),
    HEX: ("SH", (0, 1, 3, 2, 4, 5, 7, 6)),
}  # fmt: skip
"""Gmsh's letters of a cell with a value at each corner, and its order of the corners."""


def wanted_sizes(device: Device, found: DiscretisationError, asked: float) -> np.ndarray:
    """Size in m that each owned cell should have, so that all hold the same share.  Collective.

    A part of an error that falls as size^(k + 1) is assumed, in elements of degree k.

    Parameters
    ----------
    device
        The device.
    found
        The error with its parts by cells.
    asked
        The relative error that is wanted.
    """
    assert found.cells is not None
    owned, mesh = device.owned_cells(), device.mesh
    count = mesh.topology.index_map(device.dim).size_global
    share = asked * abs(found.value) / not_seen(found.degree) / count
    parts = np.maximum(np.abs(found.cells[:, -1]), 1e-300)
    factor = np.clip((share / parts) ** (1 / (found.degree + 1)), LEAST_SHARE, 1.0)
    sizes = device.length * mesh.h(device.dim, np.arange(owned, dtype=np.int32))
    return np.asarray(factor * sizes)


def write_sizes(path: Path, device: Device, found: DiscretisationError, asked: float) -> None:
    """Write the sizes as a view of gmsh, in m, in the order of the mesh file.  Collective."""
    letters, order = IN_GMSH[device.mesh.topology.cell_name()]
    owned, comm = device.owned_cells(), device.comm
    nodes = compat.geometry_dofmap(device.mesh)[:owned][:, list(order)]
    places = device.length * device.mesh.geometry.x[nodes].reshape(owned, 3 * len(order))
    mine = np.column_stack([places, wanted_sizes(device, found, asked)])
    original = np.asarray(device.mesh.topology.original_cell_index)[:owned]
    rows = Spread(comm, FileOrder(comm, original).rows(mine))

    def write() -> None:
        with path.open("w", encoding="utf-8") as file:
            file.write('View "sizes in m" {\n')
            for *place, size in (row for piece in rows.pieces() for row in piece):
                corners = ",".join(f"{x:.9g}" for x in place)
                sizes = ",".join([f"{size:.4g}"] * len(order))
                file.write(f"{letters}({corners}){{{sizes}}};\n")
            file.write("};\n")

    serving(comm, write)
