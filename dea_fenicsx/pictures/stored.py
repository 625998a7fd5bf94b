"""A step of a run on disk, of which only those parts are read that a picture shows.

Large tables are read in blocks, so that memory does not grow with all nodes of all cells.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import suppress
from functools import cached_property
from pathlib import Path

import numpy as np

from dea_fenicsx.results.axes import FIXED
from dea_fenicsx.results.components import component
from dea_fenicsx.results.reading import FIELDS_DOCUMENT, grid_element, grid_time
from dea_fenicsx.results.surface_names import NODAL_DOCUMENT, ORIGIN
from dea_fenicsx.results.untrusted import read_blocks, read_data, shape_of
from dea_fenicsx.support.cell_types import BY_XDMF, LINES, WrittenCell
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.files import clean

DISPLACEMENT = "displacement_m"


class Stored:
    """A step in one of a run's documents.

    Parameters
    ----------
    folder, name
        The run's folder and the document in it.
    grid
        The step in the document.

    Attributes
    ----------
    cell : kind of the cells
    count, size : number of cells, and of nodes
    time : path parameter of the step
    nodal, cellwise : names of the fields at nodes and of cells

    Raises
    ------
    InputError
        If the document is damaged.
    """

    def __init__(self, folder: Path, name: str, grid: ET.Element) -> None:
        self.folder, self.file = folder, folder / name
        self.time = grid_time(self.file, grid)
        topology = grid.find("Topology")
        kind = "" if topology is None else topology.attrib.get("TopologyType", "")
        if kind not in BY_XDMF:
            raise InputError(
                f"{self.file} is damaged: it has cells of an unknown kind {clean(kind, 60)!r}."
            )
        self.cell: WrittenCell = BY_XDMF[kind]
        self._cells, self._points = _place(topology), _place(grid.find("Geometry"))
        fields = [(a.attrib["Center"], a.attrib["Name"], _place(a))
                  for a in grid.findall("Attribute")]  # fmt: skip
        self.nodal = {name: place for center, name, place in fields if center == "Node"}
        self.cellwise = {name: place for center, name, place in fields if center != "Node"}
        cells, points = shape_of(folder, self._cells), shape_of(folder, self._points)
        if len(cells) != 2 or cells[1] != self.cell.nodes or len(points) != 2 or points[1] != 3:
            raise self._damaged()
        self.count, self.size = cells[0], points[0]
        if not self.count or not self.size:
            raise self._damaged()

    @property
    def is_meridian(self) -> bool:
        """Whether its cells are lines, the meridian of an axisymmetric membrane."""
        return self.cell.xdmf in LINES

    @cached_property
    def flat(self) -> bool:
        """Whether the device lies in a plane and stays there; a membrane in space need not."""
        if not self.cell.flat or np.ptp(self.height(2)) > 0:
            return False
        place = self.nodal.get(DISPLACEMENT)
        if place is None or shape_of(self.folder, place) != (self.size, 3):
            return True
        return not any(block[:, 2].any() for block in read_blocks(self.folder, place))

    def _damaged(self) -> InputError:
        return InputError(f"{self.file} is damaged: its cells do not fit its nodes.")

    def tables(self) -> Iterator[tuple[int, np.ndarray]]:
        """Nodes of the cells in blocks, each with the number of its first cell."""
        begin = 0
        for table in read_blocks(self.folder, self._cells):
            if table.dtype.kind != "i" or table.min() < 0 or table.max() >= self.size:
                raise self._damaged()
            yield begin, table
            begin += len(table)

    def height(self, axis: int) -> np.ndarray:
        """One coordinate of all nodes, in single precision."""
        parts = [block[:, axis].astype(np.float32) for block in self._places()]
        return np.concatenate(parts)

    def points(self, kept: np.ndarray) -> np.ndarray:
        """Positions of some nodes, which are told by one truth value for each node."""
        return self._chosen(self._places(), kept)

    def _places(self) -> Iterator[np.ndarray]:
        for block in read_blocks(self.folder, self._points):
            if block.dtype.kind != "f" or not np.isfinite(block).all():
                raise self._damaged()
            yield block

    def displacements(self, kept: np.ndarray) -> np.ndarray:
        """Displacements of some nodes; zero where the run has written none."""
        place = self.nodal.get(DISPLACEMENT)
        if place is None or shape_of(self.folder, place) != (self.size, 3):
            return np.zeros((int(kept.sum()), 3))
        return self._chosen(read_blocks(self.folder, place), kept)

    @staticmethod
    def _chosen(blocks: Iterator[np.ndarray], kept: np.ndarray) -> np.ndarray:
        begin, parts = 0, []
        for block in blocks:
            parts.append(block[kept[begin : begin + len(block)]])
            begin += len(block)
        return np.concatenate(parts)

    @property
    def origin(self) -> np.ndarray | None:
        """The number of each node before nodes were doubled at regions; None if none were."""
        place = self.nodal.get(ORIGIN)
        return None if place is None else read_data(self.folder, place)

    @property
    def regions(self) -> np.ndarray:
        """Number of the region of each cell."""
        place = self.cellwise.get("region")
        found = np.zeros(self.count, np.int64) if place is None else read_data(self.folder, place)
        if found.shape != (self.count,):
            raise self._damaged()
        return found

    def values(
        self, field: str, axes: tuple[str, str, str] = FIXED
    ) -> tuple[np.ndarray, str, bool]:
        """A field, or a component by its axes, as one number a node or cell.

        The magnitude of a vector; von Mises' equivalent of a stress.  Regions without an electric
        field (conductors) become NaN in pictures of it, and are shown in grey.

        Returns
        -------
        values, name with the unit as suffix, whether they are nodal
        """
        names = [*self.nodal, *self.cellwise]
        part = component(field, names, axes)
        whole, column = (field, None) if part is None else part
        if whole not in names:
            raise InputError(
                f"There is no field {field!r} in the results; there are: "
                f"{', '.join(sorted(names))}."
            )
        nodal = whole in self.nodal
        parts, told = [], field
        for block in read_blocks(self.folder, (self.nodal if nodal else self.cellwise)[whole]):
            numbers, told = one_number(block.astype(float), field, column)
            parts.append(numbers)
        values = np.concatenate(parts) if parts else np.empty(0)
        if len(values) != (self.size if nodal else self.count):
            raise InputError(
                f"{self.file} is damaged: its field {clean(whole, 60)!r} has not a value for each "
                f"{'node' if nodal else 'cell'}."
            )
        if "V_per_m" in field and values.any():
            self._without_field(values, nodal)
        return values, told, nodal

    def _without_field(self, values: np.ndarray, nodal: bool) -> None:
        """Give NaN to the values of regions in which all are zero."""
        regions = self.regions
        if nodal:  # each node belongs to cells of one region
            of_nodes = np.zeros(self.size, dtype=regions.dtype)
            for begin, table in self.tables():
                of_nodes[table] = regions[begin : begin + len(table), None]
            regions = of_nodes
        for region in np.unique(regions):
            if not values[regions == region].any():
                values[regions == region] = np.nan


def one_number(values: np.ndarray, field: str, column: int | None) -> tuple[np.ndarray, str]:
    """One number for each row of a field, and the name of what it is."""
    if column is not None:
        return values[:, column], field
    if values.ndim > 1 and values.shape[1] == 9:
        stress = values.reshape(-1, 3, 3)
        deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
        return np.sqrt(1.5 * np.einsum("nij,nij->n", deviator, deviator)), "von_Mises_stress_Pa"
    if values.ndim > 1:
        return np.linalg.norm(values, axis=1), field
    return values, field


def _place(element: ET.Element | None) -> str:
    return "" if element is None else element.findtext("DataItem") or ""


def stored_step(folder: Path, step: int, field: str, axes: tuple[str, str, str]) -> Stored:
    """A step with a field at the nodes if the run has written it there, else as in fields.xdmf.

    Both are of the same time, so that a run that is writing at this moment gives no other step.

    Raises
    ------
    InputError
        If there are no fields, or no such step.
    """
    whole = Stored(folder, FIELDS_DOCUMENT, grid_element(folder, step))
    if (folder / NODAL_DOCUMENT).is_file():
        with suppress(InputError):
            grid = grid_element(folder, step, NODAL_DOCUMENT, whole.time)
            found = Stored(folder, NODAL_DOCUMENT, grid)
            names = list(found.nodal)
            if field in names or component(field, names, axes):
                return found
    return whole
