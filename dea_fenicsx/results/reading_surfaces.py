"""Reading back the named surfaces of a run: the facets by the numbers of the device's nodes."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.results.untrusted import read_data, read_xml
from dea_fenicsx.support.cell_types import BY_XDMF, LINES

SURFACE_DOCUMENTS = ("electrodes.xdmf", "surfaces.xdmf")


@dataclass(frozen=True)
class Facets:
    """The facets of a surface.

    Attributes
    ----------
    nodes : ndarray (facets, nodes of a facet), numbers in fields.xdmf, in VTK's order
    vtk : VTK's number of the facets
    are_lines : whether they are lines, of a device in the plane
    is_electrode : whether the surface is an electrode
    """

    nodes: np.ndarray
    vtk: int
    are_lines: bool
    is_electrode: bool


def read_surfaces(folder: str | os.PathLike) -> dict[str, Facets]:
    """The named surfaces of a run; none of a run that has not written them."""
    folder, found = Path(folder), {}
    for document in SURFACE_DOCUMENTS:
        if not (folder / document).is_file():
            continue
        is_electrode = document == SURFACE_DOCUMENTS[0]
        for name, block in _blocks(read_xml(folder / document)):
            topology = block.find("Topology")
            kind = "" if topology is None else topology.attrib.get("TopologyType", "")
            if topology is None or kind not in BY_XDMF:
                continue
            nodes = read_data(folder, topology.findtext("DataItem") or "")
            if nodes.ndim != 2 or nodes.shape[1] != BY_XDMF[kind].nodes:
                continue
            name = name.removeprefix("electrode ") if is_electrode else name
            found[name] = Facets(nodes, BY_XDMF[kind].vtk, kind in LINES, is_electrode)
    return found


def _blocks(document: Any) -> Iterator[tuple[str, Any]]:
    """Name of each block, and its grid at the last step.

    Earlier versions wrote a collection of steps, each with all blocks in it.
    """
    for block in document.findall("./Domain/Grid"):
        steps = block.findall("Grid")
        if not steps:
            continue
        inner = steps[-1].findall("Grid")
        if inner:
            yield from ((grid.attrib.get("Name", ""), grid) for grid in inner)
        else:
            yield block.attrib.get("Name", ""), steps[-1]
