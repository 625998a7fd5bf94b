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

import dataclasses
import hashlib
import json
import math
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy

from dea_fenicsx.path.cursor import Cursor
from dea_fenicsx.path.items import Close, Item, March, Open, Trace
from dea_fenicsx.path.trace_memory import TraceMemory
from dea_fenicsx.results.columns import COUNTS, load_column
from dea_fenicsx.results.history import TEXTS
from dea_fenicsx.results.moment import moment_told
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.files import clean
from dea_fenicsx.support.type_checks import check_declared, is_number

FORMAT = 2
"""Version of the format of a checkpoint.  A checkpoint of another version is refused."""

NUMBER_TOLERANCE = 1e-9
"""Largest difference of two positions on the path, or relative one of two load factors."""

TIME_TOLERANCE = 1e-12
"""Rounding error of the time (number of a ramp plus position in it) in a history."""

MOST_EARLIER = 40
"""Most earlier states that a checkpoint may hold."""

MOST_LOADS = 10_000
"""Most loads that a checkpoint may name where its run started."""


class Unusable(Exception):
    """A checkpoint that contradicts itself.  The message is a clause that says why."""


# --------------------------------------------------------------------------------------- the file


def write(target: Path, states: Sequence[np.ndarray], told: Mapping[str, Any]) -> None:
    """Write a checkpoint: the last accepted state, earlier ones after it, and what is told."""
    text = json.dumps({"format": FORMAT, **told}, allow_nan=True)
    state, *others = (np.ascontiguousarray(values, dtype=float) for values in states)
    arrays: dict[str, Any] = {"state": state, "told": text}
    if others:
        arrays["earlier"] = np.stack(others)
    with open(target, "wb") as file:
        np.savez(file, **arrays, digest=digest(state, text, arrays.get("earlier")))


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


# ----------------------------------------------------------------------------------- what it tells


def cursor_of(
    told: Mapping[str, Any], scene: Scene, path: Sequence[Any], columns: Sequence[str],
    fields: Sequence[str],
) -> Cursor:  # fmt: skip
    """The cursor of a checkpoint, if its contents agree with one another and with the path.

    Parameters
    ----------
    told
        What `read` gave.
    scene, path
        Those of this run, which the fingerprint has been compared with.
    columns
        Names of the columns of this run's history.
    fields
        Names of the fields of this run's problem.

    Raises
    ------
    Unusable
        If it does not.
    """
    factors = _load(told.get("factors"), scene)
    cursor = _cursor(told.get("cursor"), scene, path, len(earlier_told(told)))
    rows = told.get("history")
    _check_rows(rows, columns, cursor)
    assert isinstance(rows, list)
    _check_start(cursor, factors, rows, scene, path[cursor.ramp])
    _check_place(cursor, factors, rows, scene, path)
    _check_rest(told, fields, factors)
    return cursor


def earlier_told(told: Mapping[str, Any]) -> list[dict[str, Any]]:
    """What a checkpoint tells of its earlier states.

    Raises
    ------
    Unusable
        If it is no list, or not as long as the states that it holds.
    """
    found = told.get("earlier", [])
    if not isinstance(found, list) or not all(isinstance(one, dict) for one in found):
        raise Unusable("what it tells of its earlier states is not usable")
    return found


def _are_finite(found: Any, names: Iterable[str]) -> bool:
    """Whether something is a finite number for each of some names."""
    return isinstance(found, dict) and set(found) == set(names) and all(
        is_number(factor) and math.isfinite(factor) for factor in found.values()
    )  # fmt: skip


def _load(found: Any, scene: Scene) -> dict[str, float]:
    """A load factor for each of the scene's ramps."""
    if not isinstance(found, dict) or set(found) != set(scene.ramps):
        raise Unusable("its load factors are not those of the scene's ramps")
    if not _are_finite(found, scene.ramps):
        raise Unusable("its load factors are no finite numbers")
    return found


def _cursor(found: Any, scene: Scene, path: Sequence[Any], earlier: int) -> Cursor:
    names = [field.name for field in dataclasses.fields(Cursor)]
    if isinstance(found, dict):
        known = {"began": 0.0, "passed": 0, "memory": None}  # which earlier checkpoints lack
        found = known | found
    if not isinstance(found, dict) or set(found) != set(names):
        raise Unusable("its place on the path is missing or not of this version")
    if found["memory"] is not None:
        try:
            found = found | {"memory": TraceMemory.read(found["memory"], earlier)}
        except ValueError as error:
            raise Unusable(f"what it tells of the trace is not usable: {error}") from error
    cursor = Cursor(**found)
    try:
        check_declared(cursor)
    except InputError as error:
        raise Unusable("its place on the path holds what is no number") from error
    _load(cursor.start, scene)
    if not all(map(math.isfinite, (cursor.position, cursor.size, cursor.direction, cursor.began))):
        raise Unusable("its place on the path holds what is no finite number")
    if not (0 <= cursor.ramp < len(path) and 0 <= cursor.position <= 1 and cursor.size >= 0):
        raise Unusable("its place lies outside of the path")
    return cursor


def _check_rows(rows: Any, columns: Sequence[str], cursor: Cursor) -> None:
    """Check that the history has one row for each step, with the columns of this run."""
    if not isinstance(rows, list) or not rows:
        raise Unusable("its history is missing")
    before = 0.0
    for number, row in enumerate(rows):
        if not isinstance(row, dict) or set(row) != set(columns):
            raise Unusable(f"row {number} of its history does not have this run's columns")
        for name, value in row.items():
            good = isinstance(value, str) if name in TEXTS else value is None or is_number(value)
            if name in COUNTS:
                good = is_number(value) and 0 <= value < math.inf and value == int(value)
            if not good:
                raise Unusable(f"row {number} of its history holds {clean(value, 40)!r}")
        time = row["time"]
        time = math.nan if time is None else float(time)
        if row["step"] != number or not before - NUMBER_TOLERANCE <= time <= math.inf:
            raise Unusable(f"row {number} of its history is not the next step")
        before = time
    last = rows[-1]
    apart = abs(cursor.ramp + cursor.position - last["time"])
    if cursor.step != last["step"] or apart > NUMBER_TOLERANCE:
        raise Unusable("its place on the path is not that of the last row of its history")


def _factors(row: Mapping[str, Any], scene: Scene) -> dict[str, float]:
    """Load factors of a row of the history."""
    found = {}
    for ramp in scene.ramps:
        column, unit = load_column(scene, ramp)
        found[ramp] = math.nan if row[column] is None else float(row[column]) / unit
    return found


def _check_start(
    cursor: Cursor,
    factors: Mapping[str, float],
    rows: list[Any],
    scene: Scene,
    item: Item,
) -> None:
    """Check that the loads are those of the last row of the history.

    The loads at the start of the item must be those of the row at which the item began, unless it
    is a march, which may begin with a jump, or sets a source to the potential of its electrode.
    """
    begun = [row for row in rows if row["time"] <= cursor.ramp + TIME_TOLERANCE]
    pairs = [(factors, _factors(rows[-1], scene))]
    if cursor.ramp + cursor.position > 0 and not isinstance(item, March | Close):
        pairs.append((cursor.start, _factors(begun[-1], scene)))
    for mine, theirs in pairs:
        for ramp, factor in mine.items():
            if not abs(factor - theirs[ramp]) <= NUMBER_TOLERANCE * max(1.0, abs(factor)):
                raise Unusable("its load factors are not those of its history")


def _check_place(
    cursor: Cursor,
    factors: Mapping[str, float],
    rows: list[Any],
    scene: Scene,
    path: Sequence[Any],
) -> None:
    """Check that the position on an item of the path agrees with the loads or the steps."""
    item = path[cursor.ramp]
    if isinstance(item, Trace):
        taken = sum(row["time"] > cursor.ramp + TIME_TOLERANCE for row in rows)
        ended = cursor.position == 1.0 and _reached(item, rows[-1])
        if not ended and round(cursor.position * item.steps) > taken:
            raise Unusable("its place on the trace is beyond the steps of its history")
        return
    if isinstance(item, March):
        _check_march(cursor, factors, item)
        return
    for ramp in () if isinstance(item, Open) else item.names(scene):
        here = (1 - cursor.position) * cursor.start[ramp] + cursor.position * item.to
        if not abs(factors[ramp] - here) <= NUMBER_TOLERANCE * max(1.0, abs(here)):
            raise Unusable("its load factors are not those of its place on the path")


def _check_march(cursor: Cursor, factors: Mapping[str, float], item: March) -> None:
    """Check that the loads are those of the drive, or lie within its present jump."""
    now = cursor.position * item.seconds
    for ramp, wave in item.waves.items():
        ends = [wave(now), wave.before(now), *([cursor.start[ramp]] if now == 0 else [])]
        room = NUMBER_TOLERANCE * max(1.0, *map(abs, ends))
        if not min(ends) - room <= factors[ramp] <= max(ends) + room:
            raise Unusable("its load factors are not those of the drive at its place on the path")


def _reached(item: Trace, row: Mapping[str, Any]) -> bool:
    """Whether a trace has come to the value at which it ends."""
    if item.until is None:
        return False
    column, value = item.until
    found = row.get(column)
    return found is not None and abs(found - value) <= 1e-4 * max(abs(value), abs(found))


def _check_rest(
    told: Mapping[str, Any], fields: Sequence[str], factors: Mapping[str, float]
) -> None:
    sizes, failures, seconds = (told.get(k) for k in ("references", "failures", "wall_s"))
    if not isinstance(sizes, dict) or not all(
        key in fields and is_number(size) and 0 <= size < math.inf
        for key, size in sizes.items()
    ):
        raise Unusable("its references of the residual are not usable")
    if not isinstance(failures, list) or not all(isinstance(f, dict) for f in failures):
        raise Unusable("its list of failures is not usable")
    if not _are_notes(told.get("notes", {})):
        raise Unusable("what it tells of its events is not usable")
    if moment_told(told.get("moment")) is None:
        raise Unusable("it does not say at which time its state is")
    for one in earlier_told(told):
        if not _are_finite(one.get("factors"), factors) or moment_told(one.get("moment")) is None:
            raise Unusable("it does not say at which load and time its earlier states are")
    if not _is_start(told.get("start")):
        raise Unusable("it does not say where it started")
    if not is_number(seconds) or not 0 <= float(seconds or 0) < math.inf:
        raise Unusable("its time is not usable")


def _are_notes(found: Any) -> bool:
    """Whether a value can be what a run tells of its events: numbers by name, for each step."""
    return isinstance(found, dict) and all(
        isinstance(note, dict) and all(is_number(value) for value in note.values())
        for note in found.values()
    )


def _is_start(found: Any) -> bool:
    """Whether a value can be what a summary says of where a run started."""
    return found is None or (
        isinstance(found, dict)
        and len(found) <= MOST_LOADS
        and all(value is None or isinstance(value, str | int | float) for value in found.values())
    )
