"""The history of a run: a row for each accepted step, or an array for each column."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, SupportsIndex, overload

import numpy as np

from dea_fenicsx.results.tables import history_html
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.files import clean

TEXTS = ("ramp", "event")
"""Columns of a history that hold texts."""


class History(list[dict[str, Any]]):
    """The accepted steps of a run: a list of rows, which gives its columns by name as well.

    ``history[-1]["stretch"]`` is a value at the last step, ``history["stretch"]`` the column of
    that name as an array, and ``"stretch" in history`` tells whether there is one.  Iteration, len,
    slices and comparison are those of a list of rows; a slice has columns, too.

    Parameters
    ----------
    rows
        For each step the value of each column, all rows with the same columns.
    """

    def __repr__(self) -> str:
        many = f"{len(self)} step{'s' * (len(self) != 1)}"
        return f"History({many}; columns: {', '.join(self.names) or 'none yet'})"

    def _repr_html_(self) -> str:
        """The steps as a table in a notebook."""
        return history_html(self)

    @property
    def names(self) -> list[str]:
        """Names of the columns, in the order of history.csv; none before the first step."""
        return list(self[0]) if self else []

    @property
    def columns(self) -> Columns:
        """All columns: name to array."""
        return Columns({name: self.column(name) for name in self.names})

    def column(self, name: str) -> np.ndarray:
        """A column as an array of shape (steps,): numbers, NaN where there is none, or texts.

        Raises
        ------
        InputError
            If there is no such column, or no step yet.
        """
        if not self:
            raise InputError("The history holds no step yet, so it has no columns.")
        if name not in self[0]:
            raise InputError(
                f"The history has no column {clean(name, 60)!r}; it has: {', '.join(self[0])}."
            )
        values = [row[name] for row in self]
        if any(isinstance(value, str) for value in values):
            return np.array(["" if value is None else str(value) for value in values])
        return np.array(values, dtype=float)

    def get(self, name: str, default: Any = None) -> Any:
        """A column as an array, or the default if there is no such column."""
        return self.column(name) if name in self.names else default

    def __contains__(self, key: object) -> bool:
        """Whether there is a column of that name, or such a row."""
        return key in self.names if isinstance(key, str) else super().__contains__(key)

    @overload  # type: ignore[override]
    def __getitem__(self, key: SupportsIndex) -> dict[str, Any]: ...
    @overload
    def __getitem__(self, key: slice) -> History: ...
    @overload
    def __getitem__(self, key: str) -> np.ndarray: ...
    def __getitem__(self, key: SupportsIndex | slice | str) -> Any:
        """The row of a step, the rows of some, or the column of a name."""
        if isinstance(key, str):
            return self.column(key)
        if isinstance(key, slice):
            return History(super().__getitem__(key))
        return super().__getitem__(key)


class Columns(dict[str, np.ndarray]):
    """The same history seen by columns: a dict of arrays, as `read_history` gives it.

    Iteration goes over the names.  `rows` gives the `History`.
    """

    @property
    def rows(self) -> History:
        """The steps: numbers as floats (NaN where there is none), texts as str."""
        texts = {name for name, values in self.items() if values.dtype.kind != "f"}
        empty = {n for n in TEXTS if n in self and n not in texts and np.isnan(self[n]).all()}
        lists = [
            [""] * len(values) if name in empty else values.tolist()
            for name, values in self.items()
        ]
        return History(dict(zip(self, row, strict=True)) for row in zip(*lists, strict=True))


def columns_of(names: Iterable[str], rows: Sequence[Mapping[str, str]]) -> Columns:
    """Columns of a table of texts: numbers as float arrays (NaN where empty), else strings."""
    columns = Columns()
    for name in names:
        values = [row[name] for row in rows]
        try:
            if name in TEXTS and any(values):
                raise ValueError("a text, even where it looks like a number")
            columns[name] = np.array([float(v) if v else np.nan for v in values])
        except ValueError:
            columns[name] = np.array(values)
    return columns


EQUAL_TIMES_APART = 1e-9
"""Distance of states at one time in ParaView's files, as a share of the whole time."""


def field_times(columns: Mapping[str, Any]) -> list[float]:
    """The time value of each row in files for ParaView: in s, or the place on a path without time.

    States at one time, such as those of a jump, are moved apart, since ParaView shows one of them
    only.

    Parameters
    ----------
    columns
        ``time`` of each row, and ``time_s`` on a path with time.
    """
    if "time_s" not in columns:
        return [float(time) for time in columns["time"]]
    times = [float(time) for time in columns["time_s"]]
    apart = EQUAL_TIMES_APART * (times[-1] if times else 0.0) or EQUAL_TIMES_APART
    found: list[float] = []
    for time in times:
        found.append(max(time, found[-1] + apart) if found else time)
    return found
