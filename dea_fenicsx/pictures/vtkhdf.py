"""All steps of a run in one VTKHDF file, which ParaView 5.13 and newer and VTK 9.4 read.

The grid stands in the file once, the fields once for each step, as VTK's documentation of the
format "VTKHDF" says for unstructured grids that change in time.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.pictures.curves import write_whole
from dea_fenicsx.pictures.stored import Stored
from dea_fenicsx.results.reading import FIELDS_DOCUMENT, frame_times, grid_element, read_summary
from dea_fenicsx.results.reading_surfaces import Facets, read_surfaces
from dea_fenicsx.results.surface_names import NODAL_DOCUMENT, ORIGIN
from dea_fenicsx.results.untrusted import read_data
from dea_fenicsx.support.errors import InputError

FORMAT_VERSION = (2, 0)
"""Version of the format, the first one with steps."""


def export_vtkhdf(folder: str | os.PathLike, out: str | os.PathLike | None = None) -> Path:
    """Write all steps of a run into one VTKHDF file.

    The fields are those at the nodes if the run has written them, else those of fields.xdmf.  Each
    region is a field of cells, 1 in the region and 0 elsewhere, and each surface one of nodes:
    "region film", "surface top".  The time of a step is that of fields.xdmf.

    Parameters
    ----------
    folder
        The run's folder.
    out
        The file; by default ``export/fields.vtkhdf`` in the folder.

    Raises
    ------
    InputError
        If there are no fields, or they are damaged.
    """
    place = Path(folder)
    name = NODAL_DOCUMENT if (place / NODAL_DOCUMENT).is_file() else FIELDS_DOCUMENT
    times = frame_times(place)
    if not times:
        raise InputError(f"There are no steps in {place / FIELDS_DOCUMENT} yet.")
    steps = [Stored(place, name, grid_element(place, 0, name, time)) for time in times]
    if out is None:
        (place / "export").mkdir(exist_ok=True)
        out = place / "export" / "fields.vtkhdf"

    def write(file: Path) -> None:
        import h5py

        with h5py.File(file, "w") as h5:
            _put(h5.create_group("VTKHDF"), place, steps)

    return write_whole(Path(out), write)


def _put(root: Any, place: Path, steps: list[Stored]) -> None:
    """Write the group of the format."""
    first, count = steps[0], len(steps)
    root.attrs["Version"] = np.array(FORMAT_VERSION, dtype=np.int64)
    root.attrs["Type"] = np.bytes_(b"UnstructuredGrid")
    cells = np.concatenate([table for _, table in first.tables()])
    every = np.ones(first.size, dtype=bool)
    root["Points"] = first.points(every)
    root["Connectivity"] = cells.ravel()
    root["Offsets"] = np.arange(len(cells) + 1, dtype=np.int64) * cells.shape[1]
    root["Types"] = np.full(len(cells), first.cell.vtk, dtype=np.uint8)
    for title, number in (("Points", first.size), ("Cells", len(cells)),
                          ("ConnectivityIds", cells.size)):  # fmt: skip
        root[f"NumberOf{title}"] = np.array([number], dtype=np.int64)
    told = root.create_group("Steps")
    told.attrs["NSteps"] = count
    told["Values"] = np.array([step.time for step in steps])
    told["NumberOfParts"] = np.ones(count, dtype=np.int64)
    none = np.zeros(count, dtype=np.int64)
    told["PartOffsets"] = told["PointOffsets"] = none
    for title in ("CellOffsets", "ConnectivityIdOffsets"):
        told[title] = none[:, None]
    for group, size in (("PointData", first.size), ("CellData", first.count)):
        names = [n for n in _fields(first, group) if all(n in _fields(s, group) for s in steps)]
        for name in names:
            some = steps[:1] if name in (ORIGIN, "region") else steps
            values = [read_data(place, _fields(step, group)[name]) for step in some]
            if any(v.shape != (size, *values[0].shape[1:]) for v in values):
                raise InputError(f"{first.file} is damaged: {name!r} does not fit its grid.")
            _put_field(root, group, name, values, count)
    _put_names(root, place, first, count)


def _fields(stored: Stored, group: str) -> dict[str, str]:
    """Places of the fields at nodes or of cells by their names."""
    return stored.nodal if group == "PointData" else stored.cellwise


def _put_field(root: Any, group: str, name: str, values: list[np.ndarray], count: int) -> None:
    """Write a field of each step, or one that is the same in all steps."""
    size = len(values[0])
    shape = (len(values) * size, *values[0].shape[1:])
    kind = np.float32 if values[0].dtype.kind == "f" else values[0].dtype
    data = root.create_dataset(f"{group}/{name.replace('/', '_')}", shape, kind)
    for k, array in enumerate(values):
        data[k * size : (k + 1) * size] = array
    offsets = np.arange(count, dtype=np.int64) * (size if len(values) > 1 else 0)
    root[f"Steps/{group}Offsets/{name.replace('/', '_')}"] = offsets


def _put_names(root: Any, place: Path, first: Stored, count: int) -> None:
    """A field for each region and each surface."""
    regions: dict[str, Any] = {}
    with suppress(InputError, KeyError, TypeError):
        regions = dict(read_summary(place)["settings"]["regions"])
    tags = first.regions
    for name, tag in regions.items():
        mine = (tags == int(tag)).astype(np.int8)
        _put_field(root, "CellData", f"region {name}", [mine], count)
    surfaces: dict[str, Facets] = {}
    with suppress(InputError):
        surfaces = read_surfaces(place)
    origin = first.origin
    numbers = np.arange(first.size) if origin is None else origin
    for name, facets in surfaces.items():
        on_it = np.isin(numbers, facets.nodes).astype(np.int8)
        _put_field(root, "PointData", f"surface {name}", [on_it], count)
