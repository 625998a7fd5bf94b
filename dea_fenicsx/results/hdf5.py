"""HDF5 files of a run: a grid, a step, and all steps joined in one file."""

from __future__ import annotations

import io
import json
import re
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.results.grids import Grid
from dea_fenicsx.results.split_grid import SplitGrid
from dea_fenicsx.results.surface_names import ORIGIN
from dea_fenicsx.support.later import Later

h5py = Later("h5py")

PACKED_FROM = 32_768
"""Bytes from which on fields at nodes are packed."""


def image(put: Callable[[Any], None]) -> Callable[[Path], None]:
    """A writer of HDF5 files that builds them in memory.

    HDF5 cannot close a file on a full disk.
    """

    def write(target: Path) -> None:
        image = io.BytesIO()
        with h5py.File(image, "w") as h5:
            put(h5)
        target.write_bytes(image.getbuffer())

    return write


def reason(error: Exception) -> str:
    """Why a file could not be written, in a few words; HDF5's own account has many lines."""
    text = str(getattr(error, "strerror", None) or error)
    found = re.search(r"error message = '([^']*)'", text)
    return found[1] if found else " ".join(text.split())[:160] or type(error).__name__


def put_grid(h5: Any, grid: Grid) -> None:
    """Write an undeformed grid."""
    h5["points"] = grid.points
    h5["cells"] = grid.cells
    h5["regions"] = grid.regions.astype(np.int64)
    h5.attrs["cell"] = grid.kind
    if grid.degree != 2:  # 2 where nothing is said
        h5.attrs["degree"] = grid.degree
    h5.attrs["axes"] = " ".join(grid.axes)
    if grid.names:
        h5.attrs["region_names"] = json.dumps({str(tag): name for tag, name in grid.names.items()})


def put_split_grid(h5: Any, split: SplitGrid) -> None:
    """Write a split grid, and the number of each of its nodes in the device's grid."""
    put_grid(h5, split.grid)
    h5[ORIGIN] = split.origin.astype(np.int64)


def put_fields(h5: Any, nodes: Mapping[str, np.ndarray], cells: Mapping[str, np.ndarray]) -> None:
    """Write fields at the nodes and of the cells of a grid."""
    for group, fields in (("node", nodes), ("cell", cells)):
        for name, values in fields.items():
            h5[f"{group}/{name}"] = values


def put_nodal_fields(h5: Any, fields: Mapping[str, np.ndarray]) -> None:
    """Write fields at the nodes of a split grid; large ones are packed to about half."""
    for name, values in fields.items():
        packing = {"compression": 1, "shuffle": True} if values.nbytes > PACKED_FROM else {}
        h5.create_dataset(f"node/{name}", data=values, **packing)


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
