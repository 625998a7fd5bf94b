"""XDMF documents that point into HDF5 files: one temporal collection of grids.

DOLFINx's own writer makes a collection for each function, which ParaView shows as a block each and
its plain reader cannot read.  Here every grid holds every field.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape, quoteattr

from dea_fenicsx.results.surface_names import ORIGIN
from dea_fenicsx.support.cell_types import BY_DEGREE
from dea_fenicsx.support.later import Later

h5py = Later("h5py")

FACETS = "facets"
"""Group beside a grid that holds the facets of each named surface."""

_KINDS = {1: "Scalar", 3: "Vector", 9: "Tensor"}


def collection(grids: str, name: str) -> str:
    """A temporal collection of grids under a name."""
    head = f'  <Grid Name={quoteattr(name)} GridType="Collection" CollectionType="Temporal">\n'
    return head + grids + "  </Grid>\n"


def document(grids: str, name: str = "device", note: str = "") -> str:
    """An XDMF document that holds a temporal collection of grids, under a name."""
    return whole_document(collection(grids, name), note)


def whole_document(collections: str, note: str = "") -> str:
    """An XDMF document that holds temporal collections, each of which ParaView shows as a block.

    A note stands in it as a comment; readers of XDMF do not agree on elements for such texts.
    """
    comment = f"<!-- {note.replace('--', '- -')} -->\n" if note else ""
    head = f'<?xml version="1.0"?>\n{comment}<Xdmf Version="3.0">\n <Domain>\n'
    return head + collections + " </Domain>\n</Xdmf>\n"


Stamp = tuple[int, int, int]
"""What changes when a file is written again; see `stamp`."""


@dataclass(frozen=True)
class MeshFile:
    """What a grid in a file holds.

    Attributes
    ----------
    cells, points : shapes of the tables of nodes and of positions
    kind : XDMF's name of the cells
    facets : of each named surface its key, the shape of its table, XDMF's name of its cells, and
        whether it is an electrode
    origin : whether it is split and has the numbers of its nodes in another grid
    note : its regions, and the axes by which components are ordered
    """

    cells: tuple[int, int]
    points: tuple[int, int]
    kind: str
    facets: tuple[tuple[str, tuple[int, int], str, bool], ...]
    origin: bool
    note: str


# A run writes its documents again at each step.  The files of the earlier steps are as they were,
# and are not opened again, so that the time of a step does not grow with the number of steps.


@lru_cache(maxsize=20_000)
def fields_in(
    file: Path, prefix: str, changed: Stamp
) -> dict[str, dict[str, tuple[tuple[int, ...], int]]] | None:
    """The fields at nodes and of cells in a group of a file; None if it is not there.

    Each has its shape and the bytes of a number.
    """
    with h5py.File(file, locking=False) as h5:
        if prefix and prefix not in h5:
            return None
        where = h5[prefix] if prefix else h5
        return {
            group: {
                name: (data.shape, data.dtype.itemsize)
                for name, data in where.get(group, {}).items()
            }
            for group in ("node", "cell")
        }


@lru_cache(maxsize=1000)
def mesh_in(file: Path, prefix: str, changed: Stamp) -> MeshFile:
    """What a grid in a group of a file holds."""
    with h5py.File(file, locking=False) as h5:
        where = h5[prefix] if prefix else h5
        kind = BY_DEGREE[int(where.attrs.get("degree", 2))][str(where.attrs["cell"])].xdmf
        facets = tuple(
            (
                key, table.shape,
                BY_DEGREE[int(table.attrs["degree"])][str(table.attrs["cell"])].xdmf,
                bool(table.attrs["electrode"]),
            )
            for key, table in where.get(FACETS, {}).items()
        )  # fmt: skip
        return MeshFile(
            where["cells"].shape, where["points"].shape, kind, facets, ORIGIN in where,
            _note(where.attrs),
        )  # fmt: skip


def note_of(mesh: tuple[Path, str]) -> str:
    """What a grid says of its regions and axes, or nothing if it is not there."""
    file, prefix = mesh
    return mesh_in(file, prefix, stamp(file)).note if file.is_file() else ""


def _note(attributes: Any) -> str:
    parts = []
    if axes := str(attributes.get("axes", "")):
        parts.append(f"Components are ordered ({', '.join(axes.split())}).")
    if names := json.loads(str(attributes.get("region_names", "{}"))):
        parts.append(f"Regions: {', '.join(f'{tag} {name}' for tag, name in names.items())}.")
    return " ".join(parts).encode("ascii", "replace").decode()


def grid_xml(
    name: str, time: float, mesh: tuple[Path, str], fields: tuple[Path, str], root: Path
) -> str:
    """One grid: its mesh and its fields, each a file and a group in it, seen from a folder.

    Empty where the file does not hold the group.
    """
    (mesh_file, mesh_prefix), (file, prefix) = mesh, fields
    found = fields_in(file, prefix, stamp(file))
    if found is None:
        return ""
    here = mesh_in(mesh_file, mesh_prefix, stamp(mesh_file))
    source = f"{mesh_file.relative_to(root).as_posix()}:/{mesh_prefix}"
    place = f"{file.relative_to(root).as_posix()}:/{prefix}"
    head = f'   <Grid Name="{name}" GridType="Uniform">\n    <Time Value="{time:.12g}"/>\n'
    lines = [
        *geometry(here.kind, here.cells, f"{source}cells", here.points, f"{source}points"),
        _attribute("region", "Scalar", "Cell", _item(here.cells[:1], "Int", f"{source}regions")),
        *(
            [_attribute(ORIGIN, "Scalar", "Node", _item(here.points[:1], "Int", source + ORIGIN))]
            if here.origin else []
        ),
        *(
            attribute(field, size, f"{place}{group}/{field}", group.capitalize())
            for group, sizes in found.items()
            for field, size in sizes.items()
        ),
    ]  # fmt: skip
    return head + "\n".join([*lines, "   </Grid>\n"])


def stamp(file: Path) -> Stamp:
    """What changes when a file is written again."""
    found = file.stat()
    return found.st_ino, found.st_mtime_ns, found.st_size


def geometry(
    kind: str, shape: tuple[int, ...], cells: str, points: tuple[int, ...], places: str
) -> list[str]:
    """The topology and the geometry of a grid.

    Parameters
    ----------
    kind
        XDMF's name of the cells.
    shape, cells
        Shape of the table of nodes of each cell, and where it lies.
    points, places
        Shape of the table of positions, and where it lies.
    """
    # XDMF does not know how many nodes a polyline has
    size = f' NodesPerElement="{shape[1]}"' if kind == "Polyline" else ""
    return [
        f'    <Topology TopologyType="{kind}"{size} NumberOfElements="{shape[0]}">',
        _item(shape, "Int", cells),
        "    </Topology>",
        '    <Geometry GeometryType="XYZ">',
        _item(points, "Float", places),
        "    </Geometry>",
    ]


def attribute(
    name: str, size: tuple[tuple[int, ...], int], where: str, center: str = "Node"
) -> str:
    """A field at nodes or of cells: its name, its shape with the bytes of a number, its place."""
    shape, precision = size
    kind = _KINDS[shape[1] if len(shape) > 1 else 1]
    return _attribute(name, kind, center, _item(shape, "Float", where, precision))


def _item(shape: tuple[int, ...], kind: str, where: str, precision: int = 8) -> str:
    size = " ".join(map(str, shape))
    return (
        f'     <DataItem Dimensions="{size}" NumberType="{kind}" Precision="{precision}" '
        f'Format="HDF">{escape(where)}</DataItem>'
    )


def _attribute(name: str, kind: str, center: str, item: str) -> str:
    return (
        f'    <Attribute Name={quoteattr(name)} AttributeType="{kind}" Center="{center}">\n'
        f"{item}\n    </Attribute>"
    )


