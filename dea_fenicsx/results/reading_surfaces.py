"""Reading back the named surfaces of a run: the facets by the numbers of the device's nodes."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dea_fenicsx.results.untrusted import read_data, read_xml
from dea_fenicsx.support.cell_types import BY_XDMF, LINES

DOCUMENTS = ("electrodes.xdmf", "surfaces.xdmf")


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
    for document in DOCUMENTS:
        if not (folder / document).is_file():
            continue
        steps = read_xml(folder / document).findall("./Domain/Grid/Grid")
        is_electrode = document == DOCUMENTS[0]
        for block in steps[-1].findall("Grid") if steps else ():
            topology = block.find("Topology")
            kind = "" if topology is None else topology.attrib.get("TopologyType", "")
            if topology is None or kind not in BY_XDMF:
                continue
            nodes = read_data(folder, topology.findtext("DataItem") or "")
            if nodes.ndim != 2 or nodes.shape[1] != BY_XDMF[kind].nodes:
                continue
            name = block.attrib.get("Name", "")
            name = name.removeprefix("electrode ") if is_electrode else name
            found[name] = Facets(nodes, BY_XDMF[kind].vtk, kind in LINES, is_electrode)
    return found
