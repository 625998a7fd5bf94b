"""The accepted states of a run that stay in memory, so that one can go back to a step."""

from __future__ import annotations

from typing import Any

import numpy as np

from dea_fenicsx.model.motion import Motion
from dea_fenicsx.model.state import State
from dea_fenicsx.model.viscous_history import ViscousHistory
from dea_fenicsx.support.errors import InputError

MOST_BYTES_OF_STATES = 200_000_000
"""Memory of the states that are kept, on each rank.  The last one is always kept."""

MOST_BYTES_OF_MARCH = 2_000_000_000
"""The same where states have a past, for the derivative of each needs all before it."""


class KeptStates:
    """The latest accepted states of a run, by the number of their row in the history.

    Parameters
    ----------
    most_bytes, most_bytes_of_march
        Memory that they may take without and with a past; the earliest are let go.
    """

    def __init__(
        self, most_bytes: int = MOST_BYTES_OF_STATES, most_bytes_of_march: int = MOST_BYTES_OF_MARCH
    ) -> None:
        self._most, self._most_of_march = most_bytes, most_bytes_of_march
        self._states = dict[int, State]()
        self._items = dict[int, tuple[Any, float]]()

    def put(self, row: int, state: State, item: Any = None, began: float = 0.0) -> None:
        """Keep the state of a row, and let go of the earliest ones that are too many.

        `item` is where on the path it lies, and `began` the time in s at which that began.
        """
        self._states[row], self._items[row] = state, (item, began)
        most = self._most_of_march if state.history else self._most
        room = max(1, most // max(1, _bytes_of(state)))
        for old in sorted(self._states)[:-room]:
            del self._states[old]

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
        if row not in self._states:
            kept = ", ".join(map(str, sorted(self._states)[:3]))
            raise InputError(
                f"The state of step={step} is not in memory: earlier steps of a large or resumed "
                f"run are not kept; the first that are kept are {kept}."
            )
        return self._states[row]


def _bytes_of(state: State) -> int:
    """Memory that one more state takes: values, newest viscous strains, and its motion."""
    found = state.values.nbytes
    for told in state.history.values():
        if isinstance(told, ViscousHistory):
            found += told.strains[0].nbytes  # earlier strains are shared with earlier states
        elif isinstance(told, Motion):
            found += 4 * np.asarray(told.velocity).nbytes
    return int(found)
