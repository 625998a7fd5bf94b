"""Reading a run's results back: light, without MPI or DOLFINx."""

from __future__ import annotations

import csv
import json
import os
import xml.etree.ElementTree as ET
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.errors import InputError

# XDMF's name of a quadratic cell: VTK's number, whether it is a flat one
_CELLS = {
    "Triangle_6": (22, True),
    "Quadrilateral_9": (28, True),
    "Tetrahedron_10": (24, False),
    "Hexahedron_27": (29, False),
}


def read_history(folder: str | os.PathLike) -> dict[str, np.ndarray]:
    """Columns of a run's history.csv: numbers as float arrays (NaN where empty), else strings."""
    file = Path(folder) / "history.csv"
    if not file.is_file():
        raise InputError(f"There is no history.csv in {folder}; give the folder of a run.")
    try:
        with open(file, newline="", encoding="utf-8") as f:
            rows = list(csv.DictReader(f))
    except (csv.Error, UnicodeDecodeError) as error:
        raise InputError(f"{file} is not a history of this package ({error}).") from error
    if any(None in row or None in row.values() for row in rows):
        raise InputError(f"{file} is damaged: a row has more or fewer cells than its head.")
    columns: dict[str, np.ndarray] = {}
    for name in rows[0] if rows else []:
        values = [row[name] for row in rows]
        try:
            columns[name] = np.array([float(v) if v else np.nan for v in values])
        except ValueError:
            columns[name] = np.array(values)
    return columns


def read_summary(folder: str | os.PathLike) -> dict[str, Any]:
    """A run's summary.json."""
    file = Path(folder) / "summary.json"
    if not file.is_file():
        raise InputError(f"There is no summary.json in {folder}; give the folder of a run.")
    with suppress(json.JSONDecodeError, UnicodeDecodeError):
        found = json.loads(file.read_text("utf-8"))
        if isinstance(found, dict):
            return found
        raise InputError(f"{file} is no summary of a run: it holds no object.")
    raise InputError(f"{file} is not valid JSON.")


def load_columns(history: dict[str, np.ndarray], summary: dict[str, Any]) -> list[str]:
    """Columns of a history that hold the loads, those of the last ramp first.

    A ramp that moves electrodes of given potential has a column in V, any other one its factor.
    Without a summary only ``voltage_V`` and the factors are known for loads.
    """
    names: list[str] = []
    with suppress(KeyError, TypeError, AttributeError):
        for ramp in reversed(summary["settings"]["path"]):
            what = ramp["what"] or []
            names += [what] if isinstance(what, str) else list(what)
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


def _grids(folder: Path) -> list[ET.Element]:
    """The steps in fields.xdmf."""
    file = folder / "fields.xdmf"
    if not file.is_file():
        raise InputError(f"There is no fields.xdmf in {folder}; give the folder of a run.")
    try:
        return ET.parse(file).getroot().findall("./Domain/Grid/Grid")
    except (ET.ParseError, UnicodeDecodeError) as error:
        raise InputError(f"{file} is not valid XML ({error}).") from error


def _grid(folder: Path, step: int) -> ET.Element:
    """One of the steps in fields.xdmf."""
    grids = _grids(folder)
    if not -len(grids) <= step < len(grids):
        raise InputError(
            f"Step {step} is not in {folder / 'fields.xdmf'}; it holds steps 0 to "
            f"{len(grids) - 1} (-1 is the last one)."
        )
    return grids[step]


def check_field(folder: Path, field: str, step: int = -1) -> None:
    """Raise InputError unless fields.xdmf has that field at that step."""
    names = [a.attrib["Name"] for a in _grid(folder, step).findall("Attribute")]
    if field not in names:
        raise InputError(
            f"There is no field {field!r} in the results; there are: {', '.join(sorted(names))}."
        )


def frame_times(folder: str | os.PathLike) -> list[float]:
    """Path parameter of each step in fields.xdmf."""
    times = [grid.find("Time") for grid in _grids(Path(folder))]
    return [float(t.attrib["Value"]) if t is not None else 0.0 for t in times]


def field_names(folder: str | os.PathLike) -> list[str]:
    """Names of the fields in fields.xdmf."""
    names = [a.attrib["Name"] for grid in _grids(Path(folder)) for a in grid.findall("Attribute")]
    return list(dict.fromkeys(names))


def read_frame(folder: str | os.PathLike, step: int = -1) -> Frame:
    """Read a step of a run from fields.xdmf and the HDF5 files it names, without VTK's readers.

    Parameters
    ----------
    folder
        The run's folder; the run may still be going on.
    step
        Which of the steps on disk, from 0; negative ones count from the last.

    Raises
    ------
    InputError
        If there are no fields, or no such step.
    """
    import h5py
    import pyvista

    folder = Path(folder)
    xml = _grid(folder, step)

    def data(element: ET.Element | None) -> np.ndarray:
        assert element is not None
        name, _, where = (element.findtext("DataItem") or "").strip().partition(":")
        try:
            # without a lock: the run, or another program, may have the file open
            with h5py.File(folder / name, locking=False) as h5:
                return h5[where][()]
        except (OSError, KeyError, ValueError) as error:
            raise InputError(f"{folder / name} cannot be read, or lacks {where!r}.") from error

    topology = xml.find("Topology")
    assert topology is not None
    number, flat = _CELLS[topology.attrib["TopologyType"]]
    cells = data(topology)
    table = np.column_stack([np.full(len(cells), cells.shape[1]), cells]).ravel()
    types = np.full(len(cells), number, dtype=np.uint8)
    grid = pyvista.UnstructuredGrid(table, types, data(xml.find("Geometry")))
    for attribute in xml.findall("Attribute"):
        target = grid.point_data if attribute.attrib["Center"] == "Node" else grid.cell_data
        target[attribute.attrib["Name"]] = data(attribute)
    time = xml.find("Time")
    return Frame(grid, flat, float(time.attrib["Value"]) if time is not None else 0.0)
