"""What a checkpoint tells, checked against itself, the path, the columns and the scene."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

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

NUMBER_TOLERANCE = 1e-9
"""Largest difference of two positions on the path, or relative one of two load factors."""

TIME_TOLERANCE = 1e-12
"""Rounding error of the time (number of a ramp plus position in it) in a history."""

MOST_LOADS = 10_000
"""Most loads that a checkpoint may name where its run started."""


class Unusable(Exception):
    """A checkpoint that contradicts itself.  The message is a clause that says why."""


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
