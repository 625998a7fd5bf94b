"""Named surfaces of a run as blocks for ParaView: electrodes.xdmf and surfaces.xdmf.

The files hold no numbers of their own.  A block has the facets of a surface by the numbers of the
device's nodes, and takes positions and fields from those of the device.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote
from xml.sax.saxutils import quoteattr

from dea_fenicsx.results import xdmf
from dea_fenicsx.results.grids import SurfaceGrid
from dea_fenicsx.scene.scene import Scene

DOCUMENTS = {"electrodes.xdmf": True, "surfaces.xdmf": False}
"""The two documents, and whether they hold the surfaces that are electrodes."""


@dataclass(frozen=True)
class Blocks:
    """Named surfaces of a device.

    Attributes
    ----------
    facets : grid of each surface, on rank 0
    electrodes : names of those that are electrodes
    """

    facets: Mapping[str, SurfaceGrid] = field(default_factory=dict)
    electrodes: Sequence[str] = ()

    def put(self, h5: Any) -> None:
        """Write the facets of each surface into the group of the grid."""
        for name, grid in self.facets.items():
            place = f"{xdmf.FACETS}/{quote(name, safe='').replace('.', '%2E')}"
            h5[place] = grid.nodes[grid.cells]
            h5[place].attrs["cell"] = grid.kind
            h5[place].attrs["degree"] = grid.degree
            h5[place].attrs["electrode"] = name in self.electrodes


def electrode_surfaces(scene: Scene) -> tuple[str, ...]:
    """Facet groups that are electrodes, in order."""
    names = dict.fromkeys(name for e in scene.electrodes for name in e.names)
    return tuple(name for name in names if name in scene.device.surfaces)


def blocks_in(mesh: tuple[Path, str], electrodes: bool) -> dict[str, str]:
    """Keys of the surfaces that a grid's file holds, and the names of their blocks.

    Parameters
    ----------
    mesh
        File of the grid, and the group in it.
    electrodes
        Whether the surfaces that are electrodes are wanted, or all others.
    """
    file, prefix = mesh
    if not file.is_file():
        return {}
    here = xdmf.mesh_in(file, prefix, xdmf.stamp(file))
    title = "electrode " if electrodes else ""
    return {key: title + unquote(key) for key, *_, mine in here.facets if mine == electrodes}


def block_xml(
    name: str, time: float, mesh: tuple[Path, str], fields: tuple[Path, str], root: Path, key: str
) -> str:
    """The block of a surface at one step, seen from a folder.

    Parameters
    ----------
    name, time
        Of the step.
    mesh, fields
        File of the grid and of the step's fields, and the group in it.
    root
        The folder of the document.
    key
        The key of the surface in the file.
    """
    (mesh_file, mesh_prefix), (file, prefix) = mesh, fields
    here = xdmf.mesh_in(mesh_file, mesh_prefix, xdmf.stamp(mesh_file))
    shape, kind = next(surface[1:3] for surface in here.facets if surface[0] == key)
    found = xdmf.fields_in(file, prefix, xdmf.stamp(file)) or {"node": {}}
    source = f"{mesh_file.relative_to(root).as_posix()}:/{mesh_prefix}"
    place = f"{file.relative_to(root).as_posix()}:/{prefix}node/"
    table, points = f"{source}{xdmf.FACETS}/{key}", f"{source}points"
    lines = [
        f'   <Grid Name={quoteattr(name)} GridType="Uniform">', f'    <Time Value="{time:.12g}"/>',
        *xdmf.geometry(kind, shape, table, here.points, points),
        *(xdmf.attribute(n, size, f"{place}{n}") for n, size in found["node"].items()),
    ]  # fmt: skip
    return "\n".join([*lines, "   </Grid>\n"])
