"""HDF5 files of a run: a grid, a step, and all steps joined in one file."""

from __future__ import annotations

import io
import json
import re
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from dea_fenicsx.results.grids import Grid
from dea_fenicsx.results.split_grid import SplitGrid
from dea_fenicsx.results.spread import Table, pieces
from dea_fenicsx.results.surface_names import ORIGIN
from dea_fenicsx.support.later import Later

h5py = Later("h5py")

PACKED_FROM = 32_768
"""Bytes from which on fields at nodes are packed."""


class _Patient(io.RawIOBase):
    """A file that keeps the first error of writing for later, since HDF5 cannot close one else.

    Parameters
    ----------
    target
        The file, which is emptied.
    """

    def __init__(self, target: Path) -> None:
        self._file = open(target, "w+b", buffering=0)  # noqa: SIM115 - closed in `close`
        self.fault: OSError | None = None

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        view = memoryview(buffer).cast("B")
        found = self._file.readinto(view) or 0
        view[found:] = bytes(len(view) - found)
        return len(view)

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        return self._file.tell()

    def write(self, data: Any) -> int:
        rest = memoryview(data).cast("B")
        size = len(rest)
        try:
            while len(rest):
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            self.fault = self.fault or error
        return size

    def truncate(self, size: int | None = None) -> int:
        try:
            return self._file.truncate(size)
        except OSError as error:
            self.fault = self.fault or error
            return size or 0

    def close(self) -> None:
        self._file.close()
        super().close()


def image(put: Callable[[Any], None]) -> Callable[[Path], None]:
    """A writer of HDF5 files, which raises what went wrong after HDF5 has closed the file."""

    def write(target: Path) -> None:
        with _Patient(target) as file:
            try:
                with h5py.File(file, "w") as h5:
                    put(h5)
            finally:
                if file.fault is not None:
                    raise file.fault

    return write


def put_table(h5: Any, name: str, table: Table, **packing: Any) -> None:
    """Write a table as a data set, one piece after another if it is spread over the ranks."""
    data = h5.create_dataset(name, table.shape, table.dtype, **packing)
    start = 0
    for part in pieces(table):
        if part.size:
            data[start : start + len(part)] = part
        start += len(part)


def reason(error: Exception) -> str:
    """Why a file could not be written, in a few words; HDF5's own account has many lines."""
    text = str(getattr(error, "strerror", None) or error)
    found = re.search(r"error message = '([^']*)'", text)
    return found[1] if found else " ".join(text.split())[:160] or type(error).__name__


def put_grid(h5: Any, grid: Grid) -> None:
    """Write an undeformed grid."""
    put_table(h5, "points", grid.points)
    put_table(h5, "cells", grid.cells)
    put_table(h5, "regions", grid.regions)
    h5.attrs["cell"] = grid.kind
    if grid.degree != 2:  # 2 where nothing is said
        h5.attrs["degree"] = grid.degree
    h5.attrs["axes"] = " ".join(grid.axes)
    if grid.names:
        h5.attrs["region_names"] = json.dumps({str(tag): name for tag, name in grid.names.items()})


def put_split_grid(h5: Any, split: SplitGrid) -> None:
    """Write a split grid, and the number of each of its nodes in the device's grid."""
    put_grid(h5, split.grid)
    put_table(h5, ORIGIN, split.origin)


def put_fields(h5: Any, nodes: Mapping[str, Table], cells: Mapping[str, Table]) -> None:
    """Write fields at the nodes and of the cells of a grid."""
    for group, fields in (("node", nodes), ("cell", cells)):
        for name, values in fields.items():
            put_table(h5, f"{group}/{name}", values)


def put_nodal_fields(h5: Any, fields: Mapping[str, Table]) -> None:
    """Write fields at the nodes of a split grid; large ones are packed to about half."""
    for name, values in fields.items():
        packing = {"compression": 1, "shuffle": True} if values.nbytes > PACKED_FROM else {}
        put_table(h5, f"node/{name}", values, **packing)


def carry_over(h5: Any, file: Path, prefix: str, name: str) -> list[str]:
    """Copy what a group of another file has and this one has not.

    Parameters
    ----------
    h5
        The file to write.
    file, prefix
        The other file, which need not be there, and the group in it that stands for `h5`.
    name
        Name of the group.

    Returns
    -------
    list of str
        What the group holds now.
    """
    if file.is_file():
        with h5py.File(file, locking=False) as other:
            for key, value in other.get(f"{prefix}{name}", {}).items():
                if f"{name}/{key}" not in h5:
                    other.copy(value, h5.require_group(name), key)
    return list(h5.get(name, {}))


def join(target: Path, whole: Path, sources: Mapping[str, Path]) -> None:
    """Write a file that holds a group for each of some files, beside what it has held so far.

    Parameters
    ----------
    target
        The file to write, which is there and empty.
    whole
        What it has held so far, if there is such a file.
    sources
        Name of each group and its file; a file that is not there leaves the group as it is.
    """
    before = whole.is_file()
    if before:
        shutil.copyfile(whole, target)
    with h5py.File(target, "a" if before else "w") as h5:
        for name, source in sources.items():
            if not source.exists():
                continue
            if name in h5:
                del h5[name]
            with h5py.File(source, locking=False) as part:
                group = h5.create_group(name)
                for key, value in part.attrs.items():
                    group.attrs[key] = value
                for key in part:
                    part.copy(key, group)
