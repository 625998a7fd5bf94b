"""XDMF documents that point into HDF5 files: one temporal collection of grids.

DOLFINx's own writer makes a collection for each function, which ParaView shows as a block each and
its plain reader cannot read.  Here every grid holds every field.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

import h5py

from dea_fenicsx.support.cell_types import BY_DEGREE

_KINDS = {1: "Scalar", 3: "Vector", 9: "Tensor"}


def document(grids: str, name: str = "device") -> str:
    """An XDMF document that holds a temporal collection of grids, under a name."""
    return (
        '<?xml version="1.0"?>\n<Xdmf Version="3.0">\n <Domain>\n'
        f'  <Grid Name={quoteattr(name)} GridType="Collection" CollectionType="Temporal">\n'
        + grids
        + "  </Grid>\n </Domain>\n</Xdmf>\n"
    )


def grid_xml(
    name: str, time: float, mesh: tuple[Path, str], fields: tuple[Path, str], root: Path
) -> str:
    """One grid: its mesh and its fields, each a file and a group in it, seen from a folder.

    Empty where the file does not hold the group.
    """
    body = _grid_body(mesh, fields, root, _stamp(mesh[0]), _stamp(fields[0]))
    if not body:
        return ""
    head = f'   <Grid Name="{name}" GridType="Uniform">\n    <Time Value="{time:.12g}"/>\n'
    return head + body


def _stamp(file: Path) -> tuple[int, int, int]:
    """What changes when a file is written again."""
    found = file.stat()
    return found.st_ino, found.st_mtime_ns, found.st_size


@lru_cache(maxsize=20_000)
def _grid_body(
    mesh: tuple[Path, str], fields: tuple[Path, str], root: Path, *stamps: tuple[int, int, int]
) -> str:
    """A grid without its name and its time.

    A run writes its document again at each step.  The files of the earlier steps are as they were,
    and are not opened again, so that the time of a step does not grow with the number of steps.
    """
    (mesh_file, mesh_prefix), (file, prefix) = mesh, fields
    file_name = file.relative_to(root).as_posix()
    attributes = []
    with h5py.File(file, locking=False) as h5:
        if prefix and prefix not in h5:
            return ""
        where = h5[prefix] if prefix else h5
        for group, center in (("node", "Node"), ("cell", "Cell")):
            for field, data in where.get(group, {}).items():
                kind = _KINDS[data.shape[1] if data.ndim > 1 else 1]
                place = f"{file_name}:/{prefix}{group}/{field}"
                attributes.append(_attribute(field, kind, center, data.shape, "Float", place))
    with h5py.File(mesh_file, locking=False) as h5:
        where = h5[mesh_prefix] if mesh_prefix else h5
        n_cells, per_cell = where["cells"].shape
        n_points = where["points"].shape[0]
        kind = BY_DEGREE[int(where.attrs.get("degree", 2))][str(where.attrs["cell"])].xdmf
    # XDMF does not know how many nodes a polyline has
    size = f' NodesPerElement="{per_cell}"' if kind == "Polyline" else ""
    source = f"{mesh_file.relative_to(root).as_posix()}:/{mesh_prefix}"
    lines = [
        f'    <Topology TopologyType="{kind}"{size} NumberOfElements="{n_cells}">',
        _item((n_cells, per_cell), "Int", f"{source}cells"),
        "    </Topology>",
        '    <Geometry GeometryType="XYZ">',
        _item((n_points, 3), "Float", f"{source}points"),
        "    </Geometry>",
        _attribute("region", "Scalar", "Cell", (n_cells,), "Int", f"{source}regions"),
    ]
    return "\n".join([*lines, *attributes, "   </Grid>\n"])


def _item(shape: tuple[int, ...], kind: str, where: str) -> str:
    size = " ".join(map(str, shape))
    precision = 8
    return (
        f'     <DataItem Dimensions="{size}" NumberType="{kind}" Precision="{precision}" '
        f'Format="HDF">{escape(where)}</DataItem>'
    )


def _attribute(
    name: str, kind: str, center: str, shape: tuple[int, ...], number: str, where: str
) -> str:
    return (
        f'    <Attribute Name={quoteattr(name)} AttributeType="{kind}" Center="{center}">\n'
        f"{_item(shape, number, where)}\n    </Attribute>"
    )


