"""Where the fields of a surface lie: the name of its document, and of its group in HDF5 files."""

from __future__ import annotations

from urllib.parse import quote, unquote

NODAL = "nodal"
"""Group in the HDF5 files of the split grid and of its fields."""

ORIGIN = "node"
"""Name of the numbers that the nodes of a split grid have in the device's grid."""

NODAL_DOCUMENT = "nodal.xdmf"
"""The document of the fields at nodes; that of a surface has another beginning."""

SURFACES = "surfaces"
"""The group that holds those of all surfaces."""


def surface_group(name: str) -> str:
    """Group in the HDF5 files of a grid and of a step."""
    return f"{SURFACES}/{_file_name(name)}"


def surface_of(group: str) -> str:
    """The surface whose group has a name within `SURFACES`."""
    return unquote(group)


def surface_document(name: str) -> str:
    """Name of the XDMF document of a surface."""
    return f"fields_{_file_name(name)}.xdmf"


def _file_name(name: str) -> str:
    """A surface's name without signs that mean something in paths; another one for each name."""
    return quote(name, safe="").replace(".", "%2E")
