"""The checkpoint: a state and its position on the path.  All that it holds is checked when read.

    state    values of all unknowns in each cell, shape (cells, unknowns of a cell)
    earlier  the same of earlier states from which the next step is predicted and judged, if there
             are any, shape (states, cells, unknowns of a cell)
    told     JSON: cursor, history, fingerprint, references, failures, seconds; load and time of
             each earlier state; for another run that starts from it, what its fields and ramps
             are; where it started itself
    digest   SHA-256 of all of them

A file may have been damaged or made up.  So its sizes are compared with those of the file before
anything is read, and all that it tells must agree with itself, with the run's path and columns, and
with the scene.
"""

from __future__ import annotations

import hashlib
import json
import math
import zipfile
from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy

from dea_fenicsx.results.spread import Table, pieces
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.files import clean

FORMAT = 2
"""Version of the format of a checkpoint.  A checkpoint of another version is refused."""

MOST_EARLIER = 40
"""Most earlier states that a checkpoint may hold."""


def write(target: Path, states: Sequence[Table], told: Mapping[str, Any]) -> None:
    """Write a checkpoint: the last accepted state, earlier ones after it, and what is told.

    The file is one of `numpy.savez`, but no table need be in memory as a whole.
    """
    text = json.dumps({"format": FORMAT, **told}, allow_nan=True)
    found = hashlib.sha256(text.encode())
    state, *others = states
    with zipfile.ZipFile(target, "w", zipfile.ZIP_STORED) as archive:

        def put(name: str, shape: tuple[int, ...], tables: Sequence[Table]) -> None:
            head = {"descr": "<f8", "fortran_order": False, "shape": shape}
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                npy.write_array_header_1_0(file, head)
                for part in chain.from_iterable(map(pieces, tables)):
                    data = np.ascontiguousarray(part, dtype="<f8").data.cast("B")
                    found.update(data)
                    file.write(data)

        put("state", state.shape, [state])
        if others:
            put("earlier", (len(others), *state.shape), others)
        for name, words in (("told", text), ("digest", found.hexdigest())):
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                npy.write_array(file, np.asanyarray(words), allow_pickle=False)


def digest(state: np.ndarray, text: str, earlier: np.ndarray | None = None) -> str:
    """SHA-256 hash of a checkpoint, which shows whether it was changed after it was written."""
    found = hashlib.sha256(text.encode())
    for values in (state, earlier):
        if values is not None:
            found.update(np.ascontiguousarray(values, dtype=float).tobytes())
    return found.hexdigest()


def read(file: Path) -> tuple[dict[str, Any], list[np.ndarray]]:
    """What a checkpoint tells, and its states, each of shape (cells, unknowns of a cell).

    The last accepted state is the first of them; the earlier ones are after it.

    Raises
    ------
    InputError
        If it is no checkpoint, is damaged, or is of another version of this package.
    """
    try:
        with zipfile.ZipFile(file) as archive:
            state = _array(archive, "state.npy")
            text = str(_array(archive, "told.npy"))
            sealed = str(_array(archive, "digest.npy")) if _has(archive, "digest.npy") else ""
            earlier = _array(archive, "earlier.npy") if _has(archive, "earlier.npy") else None
        told = json.loads(text)
    except Exception as error:  # A damaged file may cause any exception.
        raise InputError(
            f"{file} is no checkpoint of this package ({clean(error, 120) or 'damaged'})."
        ) from error
    if not isinstance(told, dict) or told.get("format") != FORMAT:
        raise InputError(
            f"{file} is a checkpoint of another version of this package, which this one does not "
            "read; start anew without resume, or in another folder."
        )
    _check_tables(file, state, earlier)
    place = told.get("cursor")
    if "factors" not in told and isinstance(place, dict):
        told["factors"] = place.pop("factors", None)  # where version 0.1.0 has written them
    told["digest_agrees"] = sealed == digest(state, text, earlier)
    return told, [state, *([] if earlier is None else earlier)]


def _check_tables(file: Path, state: np.ndarray, earlier: np.ndarray | None) -> None:
    """Check that the states of a checkpoint are tables of numbers, all of the same shape."""
    if state.dtype.kind != "f" or state.ndim != 2:
        raise InputError(f"{file} is no checkpoint of this package (its state is no table).")
    if earlier is None:
        return
    same = earlier.ndim == 3 and earlier.shape[1:] == state.shape
    if earlier.dtype.kind != "f" or not same or len(earlier) > MOST_EARLIER:
        raise InputError(
            f"{file} is no checkpoint of this package (its earlier states are no tables like that "
            "of its state)."
        )


def _has(archive: zipfile.ZipFile, name: str) -> bool:
    return name in archive.namelist()


def _array(archive: zipfile.ZipFile, name: str) -> np.ndarray:
    """An array of an archive, if its size is what the archive and the file itself say it is."""
    about = archive.getinfo(name)
    if about.compress_type != zipfile.ZIP_STORED or about.file_size != about.compress_size:
        raise ValueError(f"{name} is compressed")
    with archive.open(about) as file:
        shape, dtype = _head(file)
        rest = file.read()
    if dtype.hasobject or math.prod(shape) * dtype.itemsize != len(rest):
        raise ValueError(f"{name} is not as long as it says")
    return np.frombuffer(rest, dtype=dtype).reshape(shape)


def _head(file: IO[bytes]) -> tuple[tuple[int, ...], np.dtype]:
    version = npy.read_magic(file)
    if version == (1, 0):
        shape, fortran, dtype = npy.read_array_header_1_0(file)
    elif version == (2, 0):
        shape, fortran, dtype = npy.read_array_header_2_0(file)
    else:
        raise ValueError(f"version {version} of an array")
    if fortran and len(shape) > 1:
        raise ValueError("an array by columns")
    return tuple(int(n) for n in shape), dtype
