"""The accepted states of a run, so that one can go back to a step.

The latest ones stay in memory.  The derivative at a step of a march needs all states before it, and
so those that memory has no room for go to a temporary file, which ends with the run.
"""

from __future__ import annotations

import os
import pickle
import tempfile
from types import MappingProxyType
from typing import Any

import numpy as np

from dea_fenicsx.model.motion import Motion
from dea_fenicsx.model.state import State
from dea_fenicsx.model.viscous_history import ViscousHistory
from dea_fenicsx.support.errors import InputError

MOST_BYTES_OF_STATES = 200_000_000
"""Memory of the states that are kept, on each rank.  The last one is always kept."""

MOST_BYTES_OF_MARCH = 2_000_000_000
"""The same where states have a past; what is more goes to disk."""


class KeptStates:
    """The latest accepted states of a run, by the number of their row in the history.

    Parameters
    ----------
    most_bytes, most_bytes_of_march
        Memory that they may take without and with a past.  The earliest are let go, and those with
        a past are written to the folder for temporary files (``TMPDIR``), as far as it has room.
    """

    def __init__(
        self, most_bytes: int = MOST_BYTES_OF_STATES, most_bytes_of_march: int = MOST_BYTES_OF_MARCH
    ) -> None:
        self._most, self._most_of_march = most_bytes, most_bytes_of_march
        self._states = dict[int, State]()
        self._items = dict[int, tuple[Any, float]]()
        self._on_disk = OnDisk()

    def put(self, row: int, state: State, item: Any = None, began: float = 0.0) -> None:
        """Keep the state of a row, and let go of the earliest ones that are too many.

        `item` is where on the path it lies, and `began` the time in s at which that began.
        """
        self._states[row], self._items[row] = state, (item, began)
        most = self._most_of_march if state.history else self._most
        room = max(1, most // max(1, _bytes_of(state)))
        for old in sorted(self._states)[:-room]:
            let_go = self._states.pop(old)
            if state.history:  # also what a march began from
                self._on_disk.put(old, let_go)

    def item_of(self, row: int) -> tuple[Any, float]:
        """The item of the path in which a row lies, and the time in s at which that began."""
        return self._items[row]

    def of(self, step: int, rows: int) -> State:
        """The state of a row of a history; negative numbers count from its end.

        Raises
        ------
        InputError
            If there is no such row, or its state is not in memory.
        """
        row = step + rows if step < 0 else step
        if not 0 <= row < rows:
            raise InputError(
                f"step={step} is no row of the history, which has {rows}; give one of 0 to "
                f"{rows - 1}, or -1 for the last."
            )
        if row not in self._states and (found := self._on_disk.of(row)) is not None:
            return found
        if row not in self._states:
            kept = ", ".join(map(str, sorted(self._states)[:3]))
            raise InputError(
                f"The state of step={step} is not in memory: earlier steps of a large or resumed "
                f"run are not kept; the first that are kept are {kept}."
            )
        return self._states[row]


class OnDisk:
    """States in a temporary file of this rank, by their numbers.

    A state that cannot be written is not kept.
    """

    def __init__(self) -> None:
        self._file: Any = None
        self._places = dict[int, int]()

    def put(self, row: int, state: State) -> None:
        """Write the state of a row."""
        try:
            if self._file is None:
                self._file = tempfile.TemporaryFile(prefix="dea_fenicsx_")  # noqa: SIM115
            place = self._file.seek(0, os.SEEK_END)
            _Pickler(self._file, pickle.HIGHEST_PROTOCOL).dump(state)
            self._file.flush()
        # a full disk, or a history of one's own
        except (OSError, TypeError, AttributeError, pickle.PicklingError):
            return
        self._places[row] = place

    def of(self, row: int) -> State | None:
        """The state of a row, or None if it is not there."""
        if row not in self._places:
            return None
        self._file.seek(self._places[row])
        found: State = pickle.load(self._file)
        return found


def _fixed(values: dict[str, Any]) -> MappingProxyType:
    return MappingProxyType(values)


class _Pickler(pickle.Pickler):
    """Writes mappings that cannot be changed, too."""

    def reducer_override(self, thing: Any) -> Any:
        if type(thing) is MappingProxyType:
            return _fixed, (dict(thing),)
        return NotImplemented


def _bytes_of(state: State) -> int:
    """Memory that one more state takes: values, newest viscous strains, and its motion."""
    found = state.values.nbytes
    for told in state.history.values():
        if isinstance(told, ViscousHistory):
            found += told.strains[0].nbytes  # earlier strains are shared with earlier states
        elif isinstance(told, Motion):
            found += 4 * np.asarray(told.velocity).nbytes
    return int(found)
