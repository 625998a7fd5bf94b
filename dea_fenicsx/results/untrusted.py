"""Safe reading of results folders of unknown origin: XML and HDF5 are read as data only.

A document names the files that hold its numbers.  Only files inside the folder are opened, and
only data that lie in them: no links to other files, and no more numbers than the file has room for.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.files import clean

LARGEST_XML = 500_000_000
"""Bytes of fields.xdmf beyond which it is no document of this package."""

MOST_COMPRESSION = 200
"""Largest factor by which compression may reduce a data set in its file."""


BLOCK_ROWS = 50_000
"""Rows that are read at once where a large data set is read in blocks."""


class Foreign(Exception):
    """Data that are not read; the message is a clause that says why."""


def read_xml(file: Path) -> ET.Element:
    """The root of an XML document without a document type, which could define entities.

    Raises
    ------
    InputError
        If it is not valid XML in UTF-8, has a document type, or is far too large.
    """
    try:
        if file.stat().st_size > LARGEST_XML:
            raise Foreign("it is too large")
        text = file.read_bytes().decode("utf-8")
        if "<!DOCTYPE" in text or "<!ENTITY" in text or "\0" in text:
            raise Foreign("it has a document type or NUL characters")
        # A text, unlike bytes, is parsed without regard to the encoding that it declares.
        return ET.fromstring(text)
    except OSError as error:
        raise InputError(f"{file} cannot be read ({error.strerror}).") from error
    except Foreign as error:
        raise InputError(f"{file} is no document of this package ({error}).") from error
    except (ET.ParseError, ValueError, RecursionError, MemoryError) as error:
        raise InputError(f"{file} is not valid XML ({clean(error, 120)}).") from error


def inside(folder: Path, name: str) -> Path:
    """A file of a folder by a name from a document; `Foreign` if it lies outside, or is a link."""
    if not name or os.path.isabs(name) or "\0" in name or ".." in Path(name).parts:
        raise Foreign("it lies outside of the folder")
    path = folder / name
    try:
        root, real = folder.resolve(), path.resolve()
    except (OSError, RuntimeError) as error:
        raise Foreign("it cannot be found") from error
    if real != root / name or not real.is_relative_to(root):
        raise Foreign("it is a link, or lies outside of the folder")
    if not real.is_file():
        raise Foreign("there is no such file")
    return real


def read_data(folder: Path, place: str) -> np.ndarray:
    """Numbers of a data set, by a place such as ``fields.h5:/step_00001/node/potential_V``.

    Raises
    ------
    InputError
        If it is not there, lies outside of the folder, or does not hold plain numbers.
    """
    with _stored(folder, place) as data:
        return _plain(data[()])


def shape_of(folder: Path, place: str) -> tuple[int, ...]:
    """Shape of a data set; places and errors are those of `read_data`."""
    with _stored(folder, place) as data:
        return tuple(int(n) for n in data.shape)


def read_blocks(folder: Path, place: str, rows: int = BLOCK_ROWS) -> Iterator[np.ndarray]:
    """The numbers of a data set in blocks of so many rows; places and errors as of `read_data`."""
    with _stored(folder, place) as data:
        for begin in range(0, data.shape[0] if data.shape else 0, rows):
            yield _plain(data[begin : begin + rows])


@contextmanager
def _stored(folder: Path, place: str) -> Iterator[Any]:
    """A data set to read from."""
    import h5py

    name, _, where = place.strip().partition(":")
    try:
        file = inside(folder, name)
        # without a lock: the run, or another program, may have the file open
        with h5py.File(file, "r", locking=False) as h5:
            yield _data_set(h5py, h5, where, file.stat().st_size)
            return
    except Foreign as error:
        why = f" ({error})"
    except (OSError, KeyError, ValueError, TypeError, RuntimeError, MemoryError) as error:
        why = "" if isinstance(error, KeyError) else f" ({clean(error, 100)})"
    raise InputError(f"{clean(folder / name)} cannot be read, or lacks {clean(where, 80)!r}{why}.")


def _plain(values: Any) -> np.ndarray:
    """Numbers in double precision; VTK takes neither half nor quadruple one, nor other orders."""
    values = np.asarray(values)
    return values.astype(np.float64 if values.dtype.kind == "f" else np.int64, copy=False)


def _data_set(h5py: Any, h5: Any, where: str, size: int) -> Any:
    """A data set that is reached without links, with its numbers in the file itself."""
    here = h5
    for part in [part for part in where.split("/") if part not in ("", ".")]:
        if not isinstance(here, h5py.Group):
            raise KeyError(part)
        link = here.get(part, getlink=True)
        if not isinstance(link, h5py.HardLink):
            raise Foreign("it is a link" if link is not None else "it is not there")
        here = here[part]
    if not isinstance(here, h5py.Dataset):
        raise Foreign("it is no data set")
    if here.is_virtual or here.external:
        raise Foreign("its numbers lie in another file")
    if here.dtype.kind not in "fiu":
        raise Foreign("it does not hold numbers")
    packed = here.compression or here.chunks
    if here.nbytes > (MOST_COMPRESSION if packed else 1) * size:
        raise Foreign("it says that it is larger than its file")
    return here
