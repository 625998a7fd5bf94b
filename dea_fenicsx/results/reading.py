"""Reading a run's results back: light, without MPI or DOLFINx."""

from __future__ import annotations

import csv
import json
import os
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.results.axes import ABOUT_AN_AXIS, FIXED, axes_told
from dea_fenicsx.results.components import component
from dea_fenicsx.results.history import Columns, columns_of
from dea_fenicsx.results.surface_names import NODAL_DOCUMENT, surface_document
from dea_fenicsx.results.untrusted import read_data, read_xml
from dea_fenicsx.support.cell_types import BY_XDMF, LINES
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.files import clean, listed

FIELDS_DOCUMENT = "fields.xdmf"
"""The document of a run's fields on the whole device."""


def read_history(folder: str | os.PathLike) -> Columns:
    """The history in a run's history.csv, by columns.

    Returns
    -------
    Columns
        A dict of numbers as float arrays (NaN where empty), else of strings.  Its ``rows`` are the
        steps, as in `Run.history`.

    Raises
    ------
    InputError
        If there is no such file, it cannot be read, or it is no history.
    """
    file = Path(folder) / "history.csv"
    if not file.is_file():
        raise InputError(f"There is no history.csv in {folder}; give the folder of a run.")
    try:
        with open(file, newline="", encoding="utf-8") as f:
            reader = csv.DictReader(f)
            rows = list(reader)
            names = list(reader.fieldnames or [])
    except OSError as error:
        raise InputError(f"{file} cannot be read ({error.strerror}).") from error
    except (csv.Error, ValueError) as error:
        told = clean(error, 120)
        raise InputError(f"{file} is not a history of this package ({told}).") from error
    if any(None in row or None in row.values() for row in rows):
        raise InputError(f"{file} is damaged: a row has more or fewer cells than its head.")
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"{file} is damaged: it has two columns {clean(twice, 60)!r}.")
    return columns_of(names if rows else [], rows)


def read_summary(folder: str | os.PathLike) -> dict[str, Any]:
    """A run's summary.json."""
    file = Path(folder) / "summary.json"
    if not file.is_file():
        raise InputError(f"There is no summary.json in {folder}; give the folder of a run.")
    return json_object(file)


def json_object(file: Path) -> dict[str, Any]:
    """The object that a JSON file holds.

    Raises
    ------
    InputError
        If the file cannot be read or holds anything else.
    """
    try:
        found = json.loads(file.read_text("utf-8"))
    except OSError as error:
        raise InputError(f"{file} cannot be read ({error.strerror}).") from error
    except (ValueError, RecursionError, MemoryError) as error:
        raise InputError(f"{file} is not valid JSON.") from error
    if not isinstance(found, dict):
        raise InputError(f"{file} holds no object, but must hold the JSON object that was written.")
    return found


def moved_ramps(summary: dict[str, Any]) -> list[str]:
    """Names of the ramps that the items of a path move, in order, as far as a summary tells."""
    names: list[Any] = []
    path: Any = ()
    with suppress(KeyError, TypeError):
        path = list(summary["settings"]["path"])
    for item in path:
        with suppress(KeyError, TypeError, AttributeError):  # of this item alone
            what = next((item[key] for key in ("ramps", "what", "drive") if key in item), ())
            names += [what] if isinstance(what, str) else list(what or [])
    return [name for name in names if isinstance(name, str)]


def load_columns(history: Mapping[str, np.ndarray], summary: dict[str, Any]) -> list[str]:
    """Columns of a history that hold the loads, those of the last ramp first.

    A ramp that moves electrodes of given potential has a column in V, any other one its factor.
    Without a summary only ``voltage_V`` and the factors are known for loads.
    """
    names = moved_ramps(summary)[::-1]
    known = [f"{name}_{end}" for name in names for end in ("V", "factor")]
    found = [name for name in known if name in history]
    others = [name for name in history if name.endswith("_factor") or name == "voltage_V"]
    return list(dict.fromkeys([*found, *others]))


@dataclass(frozen=True)
class Frame:
    """One step of a run.

    Attributes
    ----------
    grid : pyvista.UnstructuredGrid, undeformed, with the step's fields
    flat : whether the device lies in a plane
    time : path parameter of the step
    """

    grid: Any
    flat: bool
    time: float


def _grids(folder: Path, name: str = FIELDS_DOCUMENT) -> list[ET.Element]:
    """The steps in fields.xdmf, or in another document of a run."""
    file = folder / name
    if not file.is_file():
        raise InputError(f"There is no {name} in {folder}; give the folder of a run.")
    grids = read_xml(file).findall("./Domain/Grid/Grid")
    for grid in grids:
        attributes = grid.findall("Attribute")
        if any(not {"Name", "Center"} <= set(a.attrib) for a in attributes):
            raise InputError(f"{file} is damaged: a field has no name or no place.")
        grid_time(file, grid)
    return grids


def grid_time(file: Path, grid: ET.Element) -> float:
    """Path parameter of a step."""
    time = grid.find("Time")
    try:
        return float(time.attrib["Value"]) if time is not None else 0.0
    except (KeyError, ValueError) as error:
        raise InputError(f"{file} is damaged: the time of a step is no number.") from error


def grid_element(
    folder: Path, step: int, name: str = FIELDS_DOCUMENT, time: float | None = None
) -> ET.Element:
    """One of the steps in fields.xdmf, or in another document of a run.

    Parameters
    ----------
    folder, name
        The run's folder and the document in it.
    step
        Which of the steps, from 0; negative ones count from the last.
    time
        The path parameter that the step is to have; it is then searched for, whatever its number.

    Raises
    ------
    InputError
        If there is no such document or step, or it is damaged.
    """
    grids = _grids(folder, name)
    if time is not None:
        times = [grid_time(folder / name, grid) for grid in grids]
        step = times.index(time) if time in times else len(grids)
    if not -len(grids) <= step < len(grids):
        raise InputError(
            f"Step {step} is not in {folder / name}; it holds steps 0 to "
            f"{len(grids) - 1} (-1 is the last one)."
        )
    return grids[step]


def check_field(folder: Path, field: str, step: int = -1) -> None:
    """Raise InputError unless fields.xdmf has that field, or what it is a component of, at a step.

    Components are named by the axes of the run's fields, see `components`.
    """
    names = [a.attrib["Name"] for a in grid_element(folder, step).findall("Attribute")]
    axes = FIXED
    with suppress(InputError):
        axes = axes_told(read_summary(folder))
    if field not in names and component(field, names, axes) is None:
        raise InputError(
            f"There is no field {field!r} in the results; there are: {listed(sorted(names))}."
        )


def frame_times(folder: str | os.PathLike) -> list[float]:
    """Path parameter of each step in fields.xdmf."""
    folder = Path(folder)
    return [grid_time(folder / "fields.xdmf", grid) for grid in _grids(folder)]


def field_names(folder: str | os.PathLike) -> list[str]:
    """Names of the fields in fields.xdmf."""
    names = [a.attrib["Name"] for grid in _grids(Path(folder)) for a in grid.findall("Attribute")]
    return list(dict.fromkeys(names))


def read_frame(
    folder: str | os.PathLike, step: int = -1, surface: str | None = None, nodal: bool = False
) -> Frame:
    """Read a step of a run from fields.xdmf and the HDF5 files it names, without VTK's readers.

    Parameters
    ----------
    folder
        The run's folder; the run may still be going on.
    step
        Which of the steps on disk, from 0; negative ones count from the last.
    surface
        A surface that the run has written for itself; None for the whole device.
    nodal
        Whether to read nodal.xdmf, where all fields are at nodes.  At the faces between regions
        and at named surfaces each side has nodes of its own, so that a field can jump there.

    Raises
    ------
    InputError
        If there are no fields, or no such step.
    """
    import pyvista

    folder = Path(folder)
    whole = NODAL_DOCUMENT if nodal else FIELDS_DOCUMENT
    file = folder / (whole if surface is None else surface_document(surface))
    xml = grid_element(folder, step, file.name)

    def data(element: ET.Element | None) -> np.ndarray:
        place = "" if element is None else element.findtext("DataItem") or ""
        return read_data(folder, place)

    topology = xml.find("Topology")
    kind = "" if topology is None else topology.attrib.get("TopologyType", "")
    if kind not in BY_XDMF:
        raise InputError(f"{file} is damaged: it has cells of an unknown kind {clean(kind, 60)!r}.")
    cell = BY_XDMF[kind]
    cells, points = data(topology), data(xml.find("Geometry"))
    _check_grid(file, cells, points, cell.nodes)
    table = np.column_stack([np.full(len(cells), cell.nodes), cells]).ravel()
    grid = pyvista.UnstructuredGrid(table, np.full(len(cells), cell.vtk, dtype=np.uint8), points)
    for attribute in xml.findall("Attribute"):
        nodal = attribute.attrib["Center"] == "Node"
        name, values = attribute.attrib["Name"], data(attribute)
        if values.ndim not in (1, 2) or len(values) != (len(points) if nodal else len(cells)):
            raise InputError(
                f"{file} is damaged: its field {clean(name, 60)!r} has not a value for each "
                f"{'node' if nodal else 'cell'}."
            )
        (grid.point_data if nodal else grid.cell_data)[name] = values
    # the surface of a device in space lies in no plane, that of a flat one consists of lines
    flat = cell.flat and (surface is None or kind in LINES)
    return Frame(grid, flat, grid_time(file, xml))


def frame_for(folder: str | os.PathLike, step: int, field: str) -> Frame:
    """A step with a field at the nodes if the run has written it there, else as in fields.xdmf.

    Both are of the same time, so that a run that is writing at this moment gives no other step.
    """
    folder = Path(folder)
    time = grid_time(folder / FIELDS_DOCUMENT, grid_element(folder, step))
    if (folder / NODAL_DOCUMENT).is_file():
        with suppress(InputError):
            grids = _grids(folder, NODAL_DOCUMENT)
            times = [grid_time(folder / NODAL_DOCUMENT, grid) for grid in grids]
            found = read_frame(folder, times.index(time), nodal=True) if time in times else None
            if found is not None and _has(found.grid, field):
                return found
    return read_frame(folder, step)


def _has(grid: Any, field: str) -> bool:
    """Whether a grid has a field at its nodes, or what the field may be a component of."""
    names = list(grid.point_data)
    return field in names or any(component(field, names, axes) for axes in (FIXED, ABOUT_AN_AXIS))


def _check_grid(file: Path, cells: np.ndarray, points: np.ndarray, nodes: int) -> None:
    """Raise InputError unless cells refer to points that are there; VTK would not ask."""
    good = (
        points.ndim == 2 and points.shape[1] == 3 and points.dtype.kind == "f"
        and bool(np.isfinite(points).all()) and len(points) > 0
        and cells.ndim == 2 and cells.shape[1] == nodes and cells.dtype.kind in "iu"
        and len(cells) > 0 and int(cells.min()) >= 0 and int(cells.max()) < len(points)
    )  # fmt: skip
    if not good:
        raise InputError(f"{file} is damaged: its cells do not fit its nodes.")
