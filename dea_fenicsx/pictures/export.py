"""Results in the files of others: VTU for VTK's family, an input file of Abaqus, tables as CSV."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.pictures.curves import write_whole
from dea_fenicsx.results.axes import FIXED, axes_told
from dea_fenicsx.results.components import column_names, component
from dea_fenicsx.results.reading import Frame, frame_times, read_frame, read_summary
from dea_fenicsx.results.reading_surfaces import Facets, read_surfaces
from dea_fenicsx.results.surface_names import NODAL_DOCUMENT, ORIGIN
from dea_fenicsx.support.cell_types import BY_DEGREE
from dea_fenicsx.support.errors import InputError

KINDS = ("vtu", "inp", "csv")
"""Endings of the files that results can be exported to."""


def export(
    folder: str | os.PathLike, kind: str, step: int = -1, out: str | os.PathLike | None = None
) -> Path:
    """Write a step of a run into a file for another program.

    vtu
        The undeformed grid with all fields, for VTK, ParaView, pyvista and meshio.  Each region is
        a field of cells, 1 in the region and 0 elsewhere, and each surface one of nodes: "region
        film", "surface top".
    inp
        The undeformed mesh for Abaqus, C3D20H or C3D10H (hybrid where a material is
        incompressible), with regions as element sets and surfaces as node sets and surfaces.
    csv
        A table of nodes with their places, displacements and fields; on each side of a face
        between regions there is a row.

    Parameters
    ----------
    folder
        The run's folder.
    kind
        "vtu", "inp" or "csv".
    step
        Which step on disk, from 0; negative ones count from the last.
    out
        The file; by default ``export/step_00003.vtu`` in the folder, with the step's number.

    Raises
    ------
    InputError
        If there are no fields, no such step, or pyvista is not installed.
    """
    place = Path(folder)
    if kind not in KINDS:
        raise InputError(f"Results are exported as {', '.join(KINDS)}, not as {kind!r}.")
    try:
        frame = read_frame(place, step)
    except ImportError as error:
        raise InputError("An export needs pyvista; pip install pyvista.") from error
    number = range(len(frame_times(place)))[step]
    summary: dict[str, Any] = {}
    with suppress(InputError):
        summary = read_summary(place)
    write: Callable[[Path], None]
    if kind == "vtu":
        grid = named(frame, _region_names(summary), read_surfaces(place), axes_told(summary))

        def write(file: Path) -> None:
            _put_vtu(grid, file)

    elif kind == "inp":
        text = _abaqus(place, frame, summary)

        def write(file: Path) -> None:
            file.write_text(text, "ascii")

    else:
        nodal = (place / NODAL_DOCUMENT).is_file()
        rows = _table(read_frame(place, step, nodal=True) if nodal else frame, summary)

        def write(file: Path) -> None:
            with open(file, "w", newline="", encoding="utf-8") as f:
                csv.writer(f).writerows(rows)

    if out is None:
        (place / "export").mkdir(exist_ok=True)
        out = place / "export" / f"step_{number:05d}.{kind}"
    return write_whole(Path(out), write)


def _region_names(summary: dict[str, Any]) -> dict[int, str]:
    """Name of each region by its number, as far as the summary tells."""
    with suppress(KeyError, TypeError, ValueError, AttributeError):
        return {int(tag): str(name) for name, tag in summary["settings"]["regions"].items()}
    return {}


def named(
    frame: Frame, regions: dict[int, str], surfaces: dict[str, Facets], axes: tuple[str, str, str]
) -> Any:
    """A step's grid with a field for each region and surface, and with names of components."""
    grid = frame.grid
    tags = np.asarray(grid.cell_data["region"])
    for tag, name in regions.items():
        grid.cell_data[f"region {name}"] = (tags == tag).astype(np.int8)
    for name, facets in surfaces.items():
        on_it = np.zeros(grid.n_points, dtype=np.int8)
        on_it[facets.nodes.ravel()] = 1
        grid.point_data[f"surface {name}"] = on_it
    for data in (grid.GetPointData(), grid.GetCellData()):
        for k in range(data.GetNumberOfArrays()):
            array = data.GetArray(k)
            for column, text in enumerate(column_names(array.GetName() or "", axes)):
                array.SetComponentName(column, text)
    return grid


def _put_vtu(grid: Any, file: Path) -> None:
    """Write a grid as VTU with its numbers as base64, which meshio reads too."""
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    writer = vtkXMLUnstructuredGridWriter()
    writer.SetFileName(str(file))
    writer.SetInputData(grid)
    writer.SetDataModeToBinary()
    if not writer.Write():
        raise InputError(f"VTK could not write {file}.")


def _abaqus(place: Path, frame: Frame, summary: dict[str, Any]) -> str:
    """The input file of a run's undeformed mesh."""
    from dea_fenicsx.mesh.named_mesh import NamedMesh
    from dea_fenicsx.results.abaqus import input_file

    grid = frame.grid
    ((vtk, cells),) = grid.cells_dict.items()
    kind = next(k for kinds in BY_DEGREE.values() for k, cell in kinds.items() if cell.vtk == vtk)
    tags = np.asarray(grid.cell_data["region"])
    names = _region_names(summary)
    regions = {names.get(int(t), f"region_{int(t)}"): np.flatnonzero(tags == t)
               for t in np.unique(tags)}  # fmt: skip
    corners, nodes = {}, {}
    for name, facets in read_surfaces(place).items():
        several = 2 if facets.are_lines else {4: 4, 9: 4}.get(facets.nodes.shape[1], 3)
        corners[name], nodes[name] = facets.nodes[:, :several], np.unique(facets.nodes)
    mesh = NamedMesh(np.asarray(grid.points, float), cells, kind, regions, corners, nodes)
    compressible, kinematics = [], ""
    with suppress(KeyError, TypeError, AttributeError):
        settings = summary["settings"]
        kinematics = str(settings["kinematics"]["type"])
        compressible = [name for name, material in settings["materials"].items()
                        if material.get("bulk_modulus") is not None]  # fmt: skip
    return input_file(mesh, compressible, kinematics, f"{place.resolve().name}, undeformed")


def _table(frame: Frame, summary: dict[str, Any]) -> list[list[Any]]:
    """Rows of a table of nodes, the head first."""
    grid, axes = frame.grid, axes_told(summary) if summary else FIXED
    fields = list(grid.point_data)
    numbers = np.asarray(grid.point_data[ORIGIN]) if ORIGIN in fields else np.arange(grid.n_points)
    tags, names = np.asarray(grid.cell_data["region"]), _region_names(summary)
    table = grid.cells_dict.popitem()[1]
    of_nodes = np.zeros(grid.n_points, dtype=np.int64)
    of_nodes[table.ravel()] = np.repeat(tags, table.shape[1])
    head = ["node", "region", *(f"{axis}_m" for axis in axes)]
    columns = [numbers + 1, [names.get(int(tag), str(tag)) for tag in of_nodes],
               *np.asarray(grid.points, float).T]  # fmt: skip
    for name in fields:
        if name == ORIGIN:
            continue
        values = np.asarray(grid.point_data[name], dtype=float).reshape(grid.n_points, -1)
        for k, title in enumerate(_titles(name, values.shape[1], axes)):
            if title not in head:  # a tensor is symmetric
                head.append(title)
                columns.append([f"{value:.9g}" for value in values[:, k]])
    return [head, *map(list, zip(*columns, strict=True))]


def _titles(name: str, size: int, axes: tuple[str, str, str]) -> list[str]:
    """Titles of the columns of a field; the two halves of a symmetric tensor have the same."""
    if size == 1:
        return [name]
    found = []
    for k, part in enumerate(column_names(name, axes)):
        i, j = divmod(k, 3) if size == 9 else (0, k)
        mirrored = column_names(name, axes)[3 * j + i] if size == 9 and i > j else part
        start, unit = name.rsplit("_", 1) if "V_per_m" not in name else (name[:-8], "V_per_m")
        title = f"{start}_{mirrored}_{unit}"
        assert component(title, [name], axes) is not None
        found.append(title)
    return found
